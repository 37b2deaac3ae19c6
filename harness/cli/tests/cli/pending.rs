//! Tests `karat pending`, `accept` and `reject`, for frames of the project and for frames from a CI run.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;

use karat::Image;
use karat::image::Precision;
use karat::unstable::golden::Provenance;
use karat::unstable::path::Adapter;
use zip::write::{SimpleFileOptions, ZipWriter};

use super::*;

pub(crate) const LAVAPIPE: &str = "llvmpipe (LLVM 15.0.6, 256 bits)";

pub(crate) fn pending_frame(golden: &FilePath, case: &str, adapter: &str) {
    write_frame(golden, case, case, adapter, "");
}

/// Writes a pending frame with the given adapter and golden in its provenance.
pub(crate) fn write_frame(
    golden: &FilePath,
    file: &str,
    case: &str,
    adapter: &str,
    compared_with: &str,
) {
    write_of(golden, file, ("", ""), provenance(case, "", adapter, compared_with));
}

/// Writes a pending frame. Its provenance names a crate and the crate's folder of goldens.
fn write_of(
    place: &FilePath,
    file: &str,
    (cargo_package, folder): (&str, &str),
    provenance: Provenance,
) {
    let image = Image::new(2, 1, vec![[0.25, 0.5, 4.0, 1.0], [1.0; 4]]);
    let (cargo_package, folder) = (cargo_package.to_owned(), folder.to_owned());
    let provenance = Provenance { pixels: image.hash(), cargo_package, folder, ..provenance };
    let metadata = serde_json::to_string(&provenance).expect("plain data");
    let path = place.join(format!("{file}.new.exr"));
    image.write_exr(&path, Precision::Half, Some(&metadata)).expect("written");
}

pub(crate) fn provenance(
    case: &str,
    pixels: &str,
    adapter: &str,
    compared_with: &str,
) -> Provenance {
    Provenance {
        schema: 1,
        case: case.to_owned(),
        shader: String::new(),
        modules: BTreeMap::new(),
        pixels: pixels.to_owned(),
        width: 2,
        height: 1,
        color_space: "linear sRGB".to_owned(),
        precision: Precision::Half,
        tolerance: "rel 1e-3".to_owned(),
        adapter: Adapter {
            path: "vulkan".to_owned(),
            name: adapter.to_owned(),
            driver: String::new(),
            software: true,
        },
        processor: String::new(),
        facts: BTreeMap::new(),
        folder: String::new(),
        cargo_package: String::new(),
        compared_with: compared_with.to_owned(),
        compared_profile: String::new(),
        finding: None,
        exposures: None,
        table: None,
        accepted_by: String::new(),
        accepted_at: String::new(),
        because: String::new(),
    }
}

// Lesson 27
// Lesson 42
#[test]
fn pending_frames_are_listed_accepted_and_rejected() {
    let project = project();
    let folder = project.path();
    let golden = folder.join("golden");
    let missing = karat(folder, &["pending"]);
    assert_eq!(missing.code, Some(2), "{missing:?}");
    assert!(missing.err.contains("which you can name with --goldens DIR"), "{missing:?}");
    std::fs::create_dir_all(golden.join("furnace")).expect("a folder");
    assert_eq!(karat(folder, &["pending"]).good(), "nothing is pending\n");
    assert_eq!(karat(folder, &["pending", "--json"]).good(), "[]\n");
    pending_frame(&golden, "scene", "llvmpipe (LLVM 15.0.6, 256 bits)");
    pending_frame(&golden, "furnace/rough", "llvmpipe (LLVM 15.0.6, 256 bits)");
    pending_frame(&golden, "furnace/smooth", "GeForce");

    let ran = karat(folder, &["pending"]);
    let out = ran.out;
    assert_eq!(ran.code, Some(3), "new frames, and none that differs");
    assert!(out.contains("scene            none    2 x 1  vulkan: llvmpipe"), "{out}");
    let list = json(&karat(folder, &["pending", "--json"]).out);
    assert_eq!((&list[0]["case"], &list[0]["status"]), (&"furnace/rough".into(), &"new".into()));
    assert_eq!(list[0]["profile"], "vulkan-llvmpipe");

    assert!(karat(folder, &["accept", "scene"]).error().contains("--because <REASON>"));
    let error = karat(folder, &["accept", "scene", "--because", " "]).error();
    assert!(error.contains("accepting `scene` needs a reason"), "{error}");
    let error = karat(folder, &["accept", "scne", "--because", "why"]).failure(3);
    assert!(error.contains("`scne` isn't pending; did you mean `scene`?"), "{error}");
    let error = karat(folder, &["reject", "scne"]).failure(3);
    assert!(error.contains("did you mean `scene`?"), "{error}");
    assert!(golden.join("scene.new.exr").is_file() && !golden.join("scene.exr").exists());

    let accept = ["accept", "scene", "--because", "the first one", "--by", "A. Reviewer"];
    assert_eq!(karat(folder, &accept).good(), "accepted scene\n");
    assert!(golden.join("scene.exr").is_file() && !golden.join("scene.new.exr").exists());
    let facts = std::fs::read_to_string(golden.join("scene.toml")).expect("written");
    assert!(facts.contains("because = \"the first one\"") && facts.contains("A. Reviewer"));

    let error = karat(folder, &["accept", "furnace/smooth", "--because", "why"]).failure(1);
    assert!(error.contains("goldens are made on lavapipe"), "{error}");
    let out = karat(folder, &["reject", "furnace/*", "furnace/rough"]).good();
    assert_eq!(out, "rejected furnace/rough\nrejected furnace/smooth\n");
    assert_eq!(karat(folder, &["pending"]).good(), "nothing is pending\n");
    let error = karat(folder, &["pending", "--goldens", "nowhere"]).error();
    assert!(error.contains("there is no folder `nowhere`"), "{error}");
}

fn write_other(golden: &FilePath) {
    let image = Image::new(2, 1, vec![[0.5; 4]; 2]);
    image.write_exr(&golden.join("scene.exr"), Precision::Half, None).expect("written");
}

fn with_goldens() -> TempDir {
    let project = project();
    std::fs::create_dir(project.path().join("golden")).expect("a folder");
    project
}

/// Writes the files that CI uploads from `target/karat`.
fn artefact(folder: &FilePath) {
    for case in ["scene", "furnace/rough"] {
        pending_frame(&folder.join("ci/pending"), case, LAVAPIPE);
    }
    pending_frame(&folder.join("ci/@overlay"), "mutant", LAVAPIPE);
    write(&folder.join("ci"), "record/1.jsonl", "{}");
}

pub(crate) fn zip(path: &FilePath, entries: &[(&str, &[u8])]) {
    let mut zip = ZipWriter::new(File::create(path).expect("created"));
    for (name, bytes) in entries {
        zip.start_file(*name, SimpleFileOptions::default()).expect("an entry");
        zip.write_all(bytes).expect("written");
    }
    zip.finish().expect("written");
}

#[test]
fn changed_frames_and_new_frames_are_listed_differently() {
    let project = with_goldens();
    let golden = project.path().join("golden");
    pending_frame(&golden, "scene", LAVAPIPE);
    assert_eq!(karat(project.path(), &["pending"]).code, Some(3));
    write_frame(&golden, "room", "room", LAVAPIPE, "of another image");
    let ran = karat(project.path(), &["pending", "--json"]);
    assert_eq!(ran.code, Some(1));
    assert_eq!(json(&ran.out)[0]["status"], "differs");
    // The golden of one frame doesn't exist any more. The other frame is accepted.
    let ran = karat(project.path(), &["accept", "*", "--because", "why", "--json"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let list = json(&ran.out);
    assert_eq!((&list[0]["case"], &list[0]["accepted"]), (&"room".into(), &false.into()));
    let error = list[0]["error"].as_str().expect("a reason");
    assert!(error.contains("the golden of `room` has changed since"), "{error}");
    assert_eq!((&list[1]["accepted"], &list[1]["written"]), (&true.into(), &true.into()));
    let rejected = json(&karat(project.path(), &["reject", "room", "--json"]).good());
    assert_eq!(rejected[0]["case"], "room");
    karat(project.path(), &["pending"]).good();
}

/// If a command can't use one pending frame, the command reports the frame, and continues with the other frames.
#[test]
fn an_unusable_file_does_not_stop_the_others() {
    let project = with_goldens();
    let (folder, golden) = (project.path(), project.path().join("golden"));
    pending_frame(&golden, "scene", LAVAPIPE);
    pending_frame(&golden, "blocked", LAVAPIPE);
    std::fs::write(golden.join("cut.new.exr"), b"v/1\x01").expect("written");
    std::fs::create_dir_all(golden.join("blocked.toml/x")).expect("a folder");

    let ran = karat(folder, &["pending", "--json"]);
    assert_eq!(ran.code, Some(2), "{ran:?}");
    let list = json(&ran.out);
    assert_eq!(list.as_array().map(Vec::len), Some(3), "{list}");
    assert_eq!(list[2]["status"], "unusable");
    let error = list[2]["error"].as_str().expect("a reason");
    assert!(error.contains("golden/cut.new.exr` isn't a readable OpenEXR image"), "{error}");
    let ran = karat(folder, &["pending"]);
    assert!(ran.out.contains("scene") && ran.err.contains("cut.new.exr"), "{ran:?}");

    let ran = karat(folder, &["accept", "*", "--because", "why", "--json"]);
    assert_eq!(ran.code, Some(2), "{ran:?}");
    let list = json(&ran.out);
    assert_eq!((&list[0]["case"], &list[0]["accepted"]), (&"blocked".into(), &false.into()));
    assert!(list[0]["error"].as_str().is_some_and(|why| why.contains("blocked.toml")), "{list}");
    assert_eq!((&list[1]["case"], &list[1]["accepted"]), (&"scene".into(), &true.into()));
    assert!(golden.join("scene.exr").is_file() && !golden.join("blocked.exr").exists());
    assert!(ran.err.contains("cut.new.exr"), "{ran:?}");
    let error = karat(folder, &["accept", "cut", "--because", "why"]).failure(2);
    assert!(error.contains("cut.new.exr` isn't a readable OpenEXR image"), "{error}");
}

// Lesson 44
// Lesson 61
#[test]
fn frames_of_a_ci_run_are_accepted_from_a_folder_or_a_zip() {
    let project = with_goldens();
    let folder = project.path();
    artefact(folder);
    let read = |file: &str| std::fs::read(folder.join("ci/pending").join(file)).expect("written");
    let (scene, rough) = (read("scene.new.exr"), read("furnace/rough.new.exr"));
    let entries: [(&str, &[u8]); 4] = [
        ("pending/scene.new.exr", &scene),
        ("pending/furnace/rough.new.exr", &rough),
        ("@overlay/mutant.new.exr", &scene),
        ("record/1.jsonl", b"{}"),
    ];
    zip(&folder.join("ci.zip"), &entries);
    for from in ["ci", "ci.zip"] {
        let ran = karat(folder, &["pending", "--from", from, "--json"]);
        assert_eq!(ran.code, Some(3), "{ran:?}");
        let list = json(&ran.out);
        let count = list.as_array().expect("a list").len();
        assert_eq!(count, 2, "frames under an overlay aren't for accepting: {list}");
    }
    let accept = ["accept", "scene", "--from", "ci.zip", "--because", "as reviewed"];
    assert_eq!(karat(folder, &accept).good(), "accepted scene\n");
    assert!(
        folder.join("golden/scene.exr").is_file() && folder.join("golden/scene.toml").is_file()
    );
    assert!(folder.join("ci.zip").is_file(), "the zip stays as it is");
    // The frame is already accepted. Accepting it again is no error.
    let out = karat(folder, &accept).good();
    assert!(
        out.contains("the golden `golden/scene.exr` already has the accepted content"),
        "{out}"
    );
    // The frame wasn't compared with the golden that exists now.
    write_other(&folder.join("golden"));
    let error = karat(folder, &accept).failure(1);
    assert!(error.contains("the golden of `scene` has changed since"), "{error}");
    let error = karat(folder, &["accept", "scne", "--from", "ci.zip", "--because", "x"]).failure(3);
    assert!(error.contains("did you mean `scene`?"), "{error}");
    let accept = ["accept", "furnace/*", "--from", "ci", "--because", "as reviewed"];
    assert_eq!(karat(folder, &accept).good(), "accepted furnace/rough\n");
    assert!(folder.join("golden/furnace/rough.exr").is_file());
    assert_eq!(karat(folder, &["reject", "scene", "--from", "ci"]).good(), "rejected scene\n");
    assert_eq!(karat(folder, &["pending", "--from", "ci"]).good(), "nothing is pending\n");
    let error = karat(folder, &["reject", "scene", "--from", "ci.zip"]).error();
    assert!(error.contains("frames in a zip can't be rejected"), "{error}");
}

// Lesson 44
#[test]
fn a_hostile_or_damaged_artefact_changes_nothing() {
    let project = with_goldens();
    let folder = project.path();
    artefact(folder);
    let scene = std::fs::read(folder.join("ci/pending/scene.new.exr")).expect("written");
    zip(&folder.join("slip.zip"), &[("pending/../../evil.new.exr", &scene)]);
    zip(&folder.join("root.zip"), &[("/evil.new.exr", &scene)]);
    zip(&folder.join("foreign.zip"), &[("evil.new.exr", b"not an image")]);
    zip(&folder.join("bomb.zip"), &[("evil.new.exr", &vec![0; (64 << 20) + 1])]);
    zip(&folder.join("empty.zip"), &[("readme.txt", b"")]);
    zip(&folder.join("whole.zip"), &[("scene.new.exr", &scene)]);
    let whole = std::fs::read(folder.join("whole.zip")).expect("written");
    std::fs::write(folder.join("half.zip"), &whole[..whole.len() / 2]).expect("written");
    let mut damaged = whole.clone();
    damaged[100] ^= 0xff;
    std::fs::write(folder.join("damaged.zip"), &damaged).expect("written");
    write(folder, "text.zip", "not a zip");
    // The frame's name would leave the folder of goldens. The file's name wouldn't.
    write_frame(&folder.join("names"), "evil", "../../evil", LAVAPIPE, "");
    for case in ["a/scene", "b/scene"] {
        write_frame(&folder.join("twice"), case, "scene", LAVAPIPE, "");
    }
    write_frame(&folder.join("other"), "a", "scene", LAVAPIPE, "");
    for (from, code, message) in [
        ("slip.zip", 2, "would be unpacked outside of the target folder"),
        ("root.zip", 2, "would be unpacked outside of the target folder"),
        ("foreign.zip", 2, "isn't a readable OpenEXR image"),
        ("bomb.zip", 2, "the entry `evil.new.exr` has more than 67108864 bytes"),
        ("half.zip", 2, "can't use `half.zip`: this isn't a readable zip"),
        ("damaged.zip", 2, "entry `scene.new.exr` of the zip is damaged"),
        ("text.zip", 2, "can't use `text.zip`: this isn't a readable zip"),
        ("names", 2, "evil.new.exr` says that the file is frame `../../evil`"),
        ("other", 2, "a.new.exr` says that the file is frame `scene`"),
        (
            "twice",
            2,
            "frame `scene` is pending twice, as `a/scene.new.exr` and as `b/scene.new.exr`",
        ),
        ("empty.zip", 3, "`empty.zip` isn't the artefact of a run"),
        ("nowhere", 3, "there is no folder or zip `nowhere`"),
    ] {
        let accept = ["accept", "*", "--from", from, "--because", "why"];
        let ran = karat(folder, &accept);
        assert_eq!(ran.code, Some(code), "{from}: {ran:?}");
        assert!(ran.err.contains(message), "{from}: {ran:?}");
        assert_eq!(std::fs::read_dir(folder.join("golden")).expect("there").count(), 0, "{from}");
    }
    let above = folder.parent().expect("a folder").join("evil.new.exr");
    assert!(!above.exists() && !FilePath::new("/evil.new.exr").exists());
}

/// A workspace of the two crates `a` and `b`. Their names in Cargo differ from their folders' names. `a` has a golden.
fn workspace() -> TempDir {
    let project = tempfile::tempdir().expect("a temporary folder");
    let folder = project.path();
    write(folder, "Cargo.toml", "[workspace]\nmembers = [\"crates/*\"]\n");
    write(folder, "Cargo.lock", "");
    for name in ["lamp", "sky"] {
        let manifest = format!("[package]\nname = \"the-{name}\"\n");
        write(folder, &format!("crates/{name}/Cargo.toml"), &manifest);
    }
    std::fs::create_dir_all(folder.join("crates/lamp/golden")).expect("a folder");
    project
}

fn new(case: &str) -> Provenance {
    provenance(case, "", LAVAPIPE, "")
}

/// The first golden of a crate goes into a new folder of this crate, and never into another crate's folder of goldens.
// Lesson 179
// Lesson 180
#[test]
fn a_first_golden_goes_to_its_own_crate() {
    let project = workspace();
    let folder = project.path();
    let ci = folder.join("ci/pending");
    write_of(&ci, "crates/sky/golden/dusk", ("the-sky", "crates/sky/golden"), new("dusk"));
    let frame = std::fs::read(ci.join("crates/sky/golden/dusk.new.exr")).expect("written");
    zip(&folder.join("k.zip"), &[("pending/crates/sky/golden/dusk.new.exr", &frame)]);
    let accept = ["accept", "dusk", "--from", "k.zip", "--because", "x"];
    // In CI, Karat writes nothing, unless it may.
    let refused = output(command(folder, &accept).env("CI", "true")).error();
    assert!(
        refused.contains("`CI` is set, and Karat doesn't change your sources in CI"),
        "{refused}"
    );
    assert!(refused.contains("--ci-may-write"), "{refused}");
    assert!(!folder.join("crates/sky/golden").exists());
    assert_eq!(karat(folder, &accept).good(), "accepted dusk\n");
    assert!(folder.join("crates/sky/golden/dusk.exr").is_file());
    assert!(folder.join("crates/sky/golden/dusk.toml").is_file());
    assert!(!folder.join("golden").exists());
    assert_eq!(std::fs::read_dir(folder.join("crates/lamp/golden")).expect("there").count(), 0);
    // Karat also refuses another folder that the command names.
    let other = [&accept[..], &["--goldens", "crates/lamp/golden"]].concat();
    let error = karat(folder, &other).failure(1);
    assert!(error.contains("compared with the goldens in `crates/sky/golden`"), "{error}");
    let may = [&accept[..], &["--ci-may-write"]].concat();
    output(command(folder, &may).env("CI", "true")).good();
}

/// A project can have a folder `golden`, even if a crate of the workspace declares its own folder of goldens.
#[test]
fn a_project_has_its_own_goldens_beside_those_that_a_member_declares() {
    let project = workspace();
    let folder = project.path();
    let manifest = "[package]\nname = \"the-sky\"\n[package.metadata.karat]\ngolden = \"frames\"\n";
    write(folder, "crates/sky/Cargo.toml", manifest);
    for (golden, case) in [("golden", "scene"), ("crates/sky/frames", "dusk")] {
        std::fs::create_dir_all(folder.join(golden)).expect("a folder");
        pending_frame(&folder.join(golden), case, LAVAPIPE);
    }
    let pending = karat(folder, &["pending"]);
    assert_eq!(pending.code, Some(3), "{pending:?}");
    for case in ["scene", "dusk", "crates/sky/frames"] {
        assert!(pending.out.contains(case), "no {case} in {pending:?}");
    }
}

/// If one crate has two folders of goldens, the paths of the folders distinguish frames with the same name, as in
/// reports.
#[test]
fn frames_of_one_name_and_crate_are_named_by_their_folders() {
    let project = workspace();
    let folder = project.path();
    for golden in ["crates/lamp/golden", "crates/lamp/other"] {
        let place = folder.join("ci/pending").join(golden);
        write_of(&place, "dusk", ("the-lamp", golden), new("dusk"));
    }
    let name = "crates/lamp/other::dusk";
    let accept = ["accept", name, "--from", "ci", "--because", "x"];
    assert_eq!(karat(folder, &accept).good(), format!("accepted {name}\n"));
    assert!(folder.join("crates/lamp/other/dusk.exr").is_file());
}

/// If two crates have frames with the same name, the names of the crates distinguish these frames.
// Lesson 179
#[test]
fn frames_of_one_name_are_named_by_their_crates() {
    let project = workspace();
    let folder = project.path();
    let crates = [("the-lamp", "crates/lamp/golden"), ("the-sky", "crates/sky/golden")];
    for (at, (name, golden)) in crates.into_iter().enumerate() {
        write_of(&folder.join("ci/pending").join(golden), "dusk", (name, golden), new("dusk"));
        // In this run the frames are pending beside their goldens.
        write_of(&folder.join(golden), "dusk", (name, golden), new("dusk"));
        write_of(
            &folder.join(golden),
            &format!("own-{at}"),
            (name, golden),
            new(&format!("own-{at}")),
        );
    }
    for from in [&[][..], &["--from", "ci"]] {
        let pending = karat(folder, &[&["pending"], from].concat());
        assert_eq!(pending.code, Some(3), "{pending:?}");
        for name in ["the-lamp::dusk", "the-sky::dusk", "crates/sky/golden"] {
            assert!(pending.out.contains(name), "no {name} in {pending:?}");
        }
        let because = [from, &["--because", "x"]].concat();
        let both = karat(folder, &[&["accept", "dusk"][..], &because].concat()).error();
        let told = "several crates have a pending frame `dusk`: choose `the-lamp::dusk` or `the-sky::dusk`";
        assert!(both.contains(told), "{both}");
        let one = karat(folder, &[&["accept", "the-sky::dusk"][..], &because].concat()).good();
        assert!(one.contains("accepted the-sky::dusk\n"), "{one}");
        assert!(folder.join("crates/sky/golden/dusk.exr").is_file());
        assert!(!folder.join("crates/lamp/golden/dusk.exr").exists());
        for file in ["dusk.exr", "dusk.toml"] {
            std::fs::remove_file(folder.join("crates/sky/golden").join(file)).expect("written");
        }
        let none =
            karat(folder, &[&["accept", "the-moon::dusk"][..], &because].concat()).failure(3);
        assert!(none.contains("`the-moon::dusk` isn't pending"), "{none}");
    }
    // A name that only one crate has needs no prefix.
    let own = karat(folder, &["reject", "own-1", "the-lamp::*"]).good();
    assert_eq!(own, "rejected dusk\nrejected own-0\nrejected own-1\n");
}

/// The provenance of a frame from another machine names a folder of goldens. Karat refuses a folder that isn't in the
/// project.
// Lesson 179
#[test]
fn a_frame_that_belongs_outside_of_the_project_is_refused() {
    let project = workspace();
    let folder = project.path();
    for (at, golden) in ["../../elsewhere", "/tmp/elsewhere", ".git/hooks"].into_iter().enumerate()
    {
        let case = format!("evil-{at}");
        write_of(&folder.join("ci"), &case, ("the-sky", golden), new(&case));
        let accept = ["accept", &case, "--from", "ci", "--because", "x"];
        let error = karat(folder, &accept).error();
        assert!(error.contains("which isn't a folder of this project"), "{error}");
    }
    assert!(!FilePath::new("/tmp/elsewhere").exists() && !folder.join(".git").exists());
}

/// Commands that write into sources refuse to do so in CI.
// Lesson 180
#[test]
fn commands_that_write_refuse_to_in_ci() {
    let project = with_goldens();
    let folder = project.path();
    pending_frame(&folder.join("golden"), "scene", LAVAPIPE);
    for arguments in [
        &["accept", "scene", "--because", "x"][..],
        &["reject", "scene"],
        &["review"],
        &["unreferenced", "--delete"],
    ] {
        let error = output(command(folder, arguments).env("CI", "1")).error();
        assert!(error.contains("`CI` is set") && error.contains("--ci-may-write"), "{error}");
        assert!(folder.join("golden/scene.new.exr").is_file(), "{arguments:?}");
    }
    output(command(folder, &["review", "--static", "page"]).env("CI", "1"));
    assert!(folder.join("page/index.html").is_file(), "a page is no source");
    output(command(folder, &["reject", "scene", "--ci-may-write"]).env("CI", "1")).good();
}
