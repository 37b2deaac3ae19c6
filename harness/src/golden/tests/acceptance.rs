//! Acceptance: a pending frame becomes a golden.

use super::*;
use crate::diagnostic::text_hash;
use crate::package::Package;
use crate::reflect::Program;

#[test]
fn the_exposures_are_pinned_when_a_golden_is_accepted() {
    let project = Project::with_golden();
    let facts = std::fs::read_to_string(project.folder.path().join("room/ramp.toml"));
    let facts: Provenance = toml::from_str(&facts.expect("written")).expect("ours");
    let expected = ExposureRange::of(&ramp());
    assert_eq!(facts.exposures, Some(expected));
    let lit = with(&[(1, 1), (2, 1)], 400.0);
    let failed = project.check("vulkan", &lit, None, None).expect_err("two lights");
    assert!(failed.to_string().contains(&format!("FLIP used exposures of {expected}")), "{failed}");
}

/// The hashes of modules explain a difference, and don't affect the comparison. So Karat still compares frames with
/// older goldens, which lack these hashes.
#[test]
fn a_golden_has_the_hash_of_each_of_its_modules() {
    let project = Project::with_golden();
    let put = |file: &str, text: &str| {
        let file = project.folder.path().join(file);
        std::fs::create_dir_all(file.parent().expect("in the project")).expect("a folder");
        std::fs::write(file, text).expect("written");
    };
    put("Cargo.lock", "");
    put("shaders/light.wgsl", "const SUN = 1.0;\nfn unused() -> f32 { return 2.0; }\n");
    put(
        "shaders/scene.wgsl",
        "import package::light::SUN;\nimport noise::grey;\nconst LIT = SUN * grey;\n",
    );
    put("shaders/other.wgsl", "const OTHER = 1.0;\n");
    let noise = Package::from_source("noise", "const grey = 0.5;\n");
    let package = Package::open(project.folder.path().join("shaders")).expect("a folder");
    let package = package.depends_on("noise", &noise);
    let program = Program::of_items(&package, "scene", &["LIT"]).expect("valid");
    let old = project.folder.path().join("room/ramp.toml");
    assert!(!std::fs::read_to_string(&old).expect("there").contains("modules"));
    let (image, changed, adapter) = (ramp(), spot(2.0), adapter("vulkan"));
    let frame =
        |image| Rendered { modules: program.modules().to_vec(), ..rendered(image, &adapter) };
    project.goldens.check("room/ramp", &frame(&image)).expect("an old golden is a golden");

    let failed = project.goldens.check("room/ramp", &frame(&changed)).expect_err("a spot");
    project.accept(&failed, "a spot", None).expect("accepted");
    let stored = pending_at(&project.folder.path().join("room/ramp.exr")).provenance;
    let hash = |file: &str| FileRead::now(&project.folder.path().join(file)).hash;
    let expected = BTreeMap::from([
        ("noise".to_owned(), blake3::hash(b"const grey = 0.5;\n").to_hex().to_string()),
        ("shaders/light.wgsl".to_owned(), hash("shaders/light.wgsl")),
        ("shaders/scene.wgsl".to_owned(), hash("shaders/scene.wgsl")),
    ]);
    assert_eq!(stored.modules, expected);
    let beside = std::fs::read_to_string(old).expect("there");
    assert_eq!(toml::from_str::<Provenance>(&beside).expect("ours"), stored);
    project.check("vulkan", &changed, None, None).expect("its modules aren't compared");
}

/// On Windows, Git may check files out with `\r\n`.
#[test]
fn hashes_do_not_depend_on_windows_line_ends() {
    let folder = tempfile::tempdir().expect("a folder");
    let program = |ends: &str| {
        let text = "// The sun.\nconst SUN = 1.0;\n/* Two\nlines. */\nfn sun() -> f32 {\n    return SUN;\n}\n";
        let shared =
            "import package::light::sun;\n\nfn lit() -> f32 {\n    return 2.0 * sun();\n}\n";
        for (name, text) in [("light.wgsl", text), ("scene.wgsl", shared)] {
            std::fs::write(folder.path().join(name), text.replace('\n', ends)).expect("written");
        }
        let package = Package::open(folder.path()).expect("a folder");
        let program = Program::of_function(&package, "scene::lit").expect("valid");
        let modules = program.modules().iter().map(|module| module.hash.clone());
        (modules.collect::<Vec<_>>(), text_hash(program.text().as_bytes()))
    };
    let (unix, windows) = (program("\n"), program("\r\n"));
    assert_eq!(unix.0.len(), 2);
    assert_eq!(unix, windows);
}

#[test]
fn a_golden_that_would_not_change_is_not_written() {
    let project = Project::with_golden();
    let golden_file = project.folder.path().join("room/ramp.exr");
    let before = std::fs::read(&golden_file).expect("there");
    let adapter = &adapter("vulkan");
    let image = &ramp();
    let against = Against {
        hash: image.hash(),
        tolerance: FrameTolerance::default().to_string(),
        ..Against::default()
    };
    let case = "room/ramp".to_owned();
    let frame = rendered(image, adapter);
    let pending = project.goldens.write_pending(&case, &frame, &against).expect("written");
    let (golden, advice, pending) = (String::new(), String::new(), shown(&pending.path));
    let difference = Box::new(FrameDifference::Size { golden: (0, 0), actual: (0, 0) });
    let same = GoldenError::Differs { case, golden, difference, pending, advice };
    let accepted = project.accept(&same, "again", None).expect("nothing speaks against it");
    assert!(!accepted.written && accepted.warnings[0].contains("already has the accepted content"));
    assert_eq!(std::fs::read(&golden_file).expect("there"), before);
    // Accepting replaces facts that were edited by hand.
    let sidecar = golden_file.with_extension("toml");
    let facts = std::fs::read_to_string(&sidecar).expect("there");
    std::fs::write(&sidecar, facts.replace("first", "edited")).expect("written");
    let image = &ramp();
    let pending = project.goldens.write_pending("room/ramp", &rendered(image, adapter), &against);
    let acceptance = Acceptance { because: "why".to_owned(), ..Acceptance::default() };
    let accepted = project.goldens.accept(&pending.expect("written"), &acceptance);
    assert!(accepted.expect("nothing speaks against it").written);
    let facts = std::fs::read_to_string(&sidecar).expect("there");
    assert!(facts.contains("because = \"why\""), "{facts}");

    let edge = with(&[(3, 30)], 1.05);
    let strict = FrameTolerance::gate(1e-3);
    let failed = project.check("vulkan", &edge, Some(&strict), None).expect_err("it differs");
    assert!(project.accept(&failed, "another", None).expect("other pixels").written);
    assert_ne!(std::fs::read(&golden_file).expect("there"), before);
}

/// Pixels outside of the mask may have any value.
#[test]
fn a_frame_with_nan_under_its_mask_is_accepted() {
    let project = Project::new();
    let mut image = ramp();
    image.pixels_mut()[70] = [f32::NAN; 4];
    let (aside, beside) = (Rect::new(6, 1, 1, 1), Rect::new(7, 1, 1, 1));
    let mask = |rect| Mask::except(&[rect]);
    let failed = project.check("vulkan", &image, None, Some(&mask(aside))).expect_err("none");
    project.accept(&failed, "first", None).expect("nobody looks there");
    project.check("vulkan", &image, None, Some(&mask(aside))).expect("it agrees");
    project.check("vulkan", &ramp(), None, Some(&mask(aside))).expect("it agrees");
    let failed = project.check("vulkan", &image, None, Some(&mask(beside))).expect_err("NaN");
    let error = project.accept(&failed, "why", None).expect_err("NaN");
    assert!(matches!(error, AcceptError::NonFinite(_)), "{error}");
}

#[test]
fn the_preview_of_a_frame_is_removed_with_its_pending_file() {
    let project = Project::with_golden();
    let file = |ending: &str| project.folder.path().join(format!("room/ramp{ending}"));
    let preview = || file(".new.png");
    // The golden's own PNG belongs to the user, and Karat doesn't remove it.
    std::fs::write(file(".png"), "kept").expect("written");
    let differs = || {
        let failed = project.check("vulkan", &spot(1.5), None, None).expect_err("it differs");
        std::fs::write(preview(), "a preview").expect("written");
        failed
    };
    differs();
    project.goldens.reject(&pending_at(&file(".new.exr"))).expect("rejected");
    assert!(!preview().exists() && !file(".new.exr").exists(), "rejected");
    differs();
    project.check("vulkan", &ramp(), None, None).expect("it agrees again");
    assert!(!preview().exists(), "it agrees again");
    let failed = differs();
    project.accept(&failed, "brighter", None).expect("accepted");
    assert!(!preview().exists() && file(".png").exists(), "accepted");
}

// Lesson 42: acceptance under interruption
#[test]
fn only_one_of_two_concurrent_acceptances_succeeds() {
    let project = Project::with_golden();
    for round in 0..20 {
        let changed = spot(1.5 + round as f32);
        project.check("vulkan", &changed, None, None).expect_err("it differs");
        let pending = pending_at(&project.folder.path().join("room/ramp.new.exr"));
        let because =
            |because: &str| Acceptance { because: because.into(), ..Acceptance::default() };
        let accept = |reason: &'static str| {
            let (goldens, pending) = (&project.goldens, &pending);
            move || goldens.accept(pending, &because(reason)).map(|_| reason)
        };
        let [one, other] = std::thread::scope(|scope| {
            [scope.spawn(accept("one")), scope.spawn(accept("other"))]
                .map(|thread| thread.join().expect("no panic"))
        });
        let (reason, error) = match (one, other) {
            (Ok(reason), Err(error)) | (Err(error), Ok(reason)) => (reason, error),
            both => panic!("one is carried out: {both:?}"),
        };
        assert!(matches!(error, AcceptError::NotPending { .. }), "{error}");
        let golden = pending_at(&project.folder.path().join("room/ramp.exr"));
        assert_eq!(golden.provenance.because, reason);
    }
}

/// A frame may be accepted only if the golden that it was compared with hasn't changed.
// Lesson 61
#[test]
fn a_stale_acceptance_is_refused() {
    let golden = |project: &Project| project.folder.path().join("room/ramp.exr");
    let replace = |path: &Path, image: &Image| {
        image.write_exr(path, Precision::Half, None).expect("written");
    };
    let waiting = |project: &Project, path: &str| {
        project.check(path, &spot(2.0), None, None).expect_err("it differs")
    };
    // Case 1: another process replaced, and then removed the golden. Case 2: the first golden appeared.
    let project = Project::with_golden();
    let failed = waiting(&project, "vulkan");
    replace(&golden(&project), &spot(3.0));
    let stale = |result: Result<Accepted, AcceptError>| {
        assert!(matches!(result, Err(AcceptError::Stale(case)) if case == "room/ramp"));
    };
    stale(project.accept(&failed, "why", None));
    let (image, _) = Image::read_exr(&golden(&project)).expect("there");
    assert_eq!(image.hash(), spot(3.0).rounded_to(Precision::Half).hash(), "as it was");
    assert!(project.folder.path().join("room/ramp.new.exr").is_file(), "it still waits");
    std::fs::remove_file(golden(&project)).expect("removed");
    stale(project.accept(&failed, "why", None));
    let new = Project::new();
    let failed = waiting(&new, "vulkan");
    replace(&golden(&new), &spot(3.0));
    stale(new.accept(&failed, "why", None));
    // Case 3: a profile got its own golden. Case 4: a profile's own golden was replaced.
    let project = Project::with_golden();
    let failed = waiting(&project, "gl");
    let own = project.folder.path().join("@gl-llvmpipe/room/ramp.exr");
    std::fs::create_dir_all(own.parent().expect("a folder")).expect("made");
    replace(&own, &spot(3.0));
    stale(project.accept(&failed, "why", Some("gl-llvmpipe")));
    let failed = waiting(&project, "gl");
    replace(&own, &spot(4.0));
    stale(project.accept(&failed, "why", Some("gl-llvmpipe")));
}

/// If `karat accept` is killed before it removes the pending frame, accepting again keeps the golden and removes the
/// frame.
// Lesson 60
#[test]
fn an_acceptance_may_be_repeated() {
    let project = Project::with_golden();
    for (path, profile) in [("vulkan", None), ("gl", Some("gl-llvmpipe"))] {
        let failed = project.check(path, &spot(2.0 + path.len() as f32), None, None);
        let failed = failed.expect_err("it differs");
        let waiting = project.folder.path().join("room/ramp.new.exr");
        let frame = std::fs::read(&waiting).expect("it waits");
        let first = project.accept(&failed, "first", profile).expect("accepted");
        assert!(first.written && !waiting.exists(), "{path}");
        let files = [first.golden.clone(), first.golden.with_extension("toml")];
        let read = || files.each_ref().map(|file| std::fs::read(file).expect("there"));
        let before = read();
        std::fs::write(&waiting, &frame).expect("written");
        let again = project.accept(&failed, "again", profile).expect("accepted");
        assert!(!again.written && !waiting.exists(), "{path}: {again:?}");
        assert!(read() == before, "{path}: as it was accepted first");
        // Edited facts differ from the facts of the first acceptance.
        std::fs::write(&waiting, &frame).expect("written");
        std::fs::write(&files[1], "edited").expect("written");
        let stale = project.accept(&failed, "again", profile);
        assert!(matches!(stale, Err(AcceptError::Stale(_))), "{path}: {stale:?}");
    }
}

// Lesson 60
#[test]
fn leftovers_are_removed_by_the_next_decision() {
    let project = Project::with_golden();
    let left = ["room/ramp.exr.4194999-0.tmp", "@gl-llvmpipe/room/ramp.toml.4194999-1.tmp"];
    let left = left.map(|file| project.folder.path().join(file));
    let leave = || {
        for file in &left {
            std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
            std::fs::write(file, "half of i").expect("written");
        }
    };
    let gone = || left.iter().all(|file| !file.exists());
    leave();
    let failed = project.check("vulkan", &spot(2.0), None, None).expect_err("it differs");
    assert!(!gone(), "a test decides nothing");
    project.accept(&failed, "why", None).expect("accepted");
    assert!(gone());
    leave();
    project.check("vulkan", &ramp(), None, None).expect_err("it differs");
    let waiting = pending_at(&project.folder.path().join("room/ramp.new.exr"));
    project.goldens.reject(&waiting).expect("deleted");
    assert!(gone());
}

/// Accepting writes both files of a golden, or neither file.
// Lesson 42: acceptance under interruption
#[test]
fn a_golden_without_its_facts_is_not_written() {
    let project = Project::with_golden();
    let folder = project.folder.path();
    let (image, facts) = (folder.join("room/ramp.exr"), folder.join("room/ramp.toml"));
    let before = std::fs::read(&image).expect("there");
    std::fs::remove_file(&facts).expect("removed");
    std::fs::create_dir_all(facts.join("in the way")).expect("a folder");
    let failed = project.check("vulkan", &spot(1.5), None, None).expect_err("another");
    let error = project.accept(&failed, "why", None).expect_err("a folder is in the way");
    assert!(error.to_string().contains("ramp.toml"), "{error}");
    assert_eq!(std::fs::read(&image).expect("there"), before);
    assert!(project.folder.path().join("room/ramp.new.exr").is_file(), "it still waits");
    std::fs::remove_dir_all(&facts).expect("removed");
    project.accept(&failed, "why", None).expect("nothing is in the way");

    std::fs::remove_file(&image).expect("removed");
    std::fs::create_dir_all(image.join("in the way")).expect("a folder");
    let known = std::fs::read(&facts).expect("there");
    let pending = project.goldens.write_pending(
        "room/ramp",
        &rendered(&ramp(), &adapter("vulkan")),
        &Against::default(),
    );
    let pending = pending.expect("written");
    let acceptance = Acceptance { because: "why".to_owned(), ..Acceptance::default() };
    project.goldens.accept(&pending, &acceptance).expect_err("a folder is in the way");
    assert_eq!(std::fs::read(&facts).expect("there"), known);
    let files = std::fs::read_dir(project.folder.path().join("room")).expect("a folder");
    assert_eq!(files.count(), 3, "no temporary file stays");
}

/// Karat accepts a frame only into the folder of goldens with which it compared the frame.
// Lesson 42: acceptance under interruption
#[test]
fn a_frame_of_another_folder_is_refused() {
    let project = Project::with_golden();
    std::fs::write(project.folder.path().join("Cargo.lock"), "").expect("written");
    let goldens = |name: &str| {
        let folder = project.folder.path().join(name);
        std::fs::create_dir_all(&folder).expect("a folder");
        Goldens { beside: true, ..Goldens::open(&folder) }
    };
    let (one, other) = (goldens("a/golden"), goldens("b/golden"));
    let adapter = &adapter("vulkan");
    one.check("logo", &rendered(&ramp(), adapter)).expect_err("no golden");
    other.check("logo", &rendered(&spot(2.0), adapter)).expect_err("no golden");
    let all = project.goldens.pending();
    let found: Vec<_> = all.frames.iter().map(|frame| &*frame.provenance.folder).collect();
    assert_eq!((found, all.unusable.len()), (vec!["a/golden", "b/golden"], 0));
    let acceptance = Acceptance { because: "why".to_owned(), ..Acceptance::default() };
    let error = other.accept(&all.frames[0], &acceptance).expect_err("it is the other's");
    let text = "`logo` was compared with the goldens in `a/golden`: pass --goldens a/golden";
    assert_eq!(error.to_string(), text);
    let accepted = one.accept(&all.frames[0], &acceptance).expect("it is its own");
    let golden = pending_at(&accepted.golden).provenance;
    assert!(golden.folder.is_empty() && golden.pixels == ramp().hash());
}
