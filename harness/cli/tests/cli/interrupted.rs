//! Tests what follows if `karat accept` is killed. Later commands report and delete the temporary files that the killed
//! command left. A second `karat accept` completes the work of the first.

use std::path::PathBuf;
use std::time::Duration;

use karat::Image;
use karat::image::Precision;
use karat::unstable::image::ExrFile;

use super::pending::{LAVAPIPE, pending_frame, provenance};
use super::report::frame;
use super::*;

/// Writes a pending frame. `compared_with` is the hash of the golden with which the frame was compared.
fn differing(golden: &FilePath, value: f32, compared_with: &str) -> PathBuf {
    let image = Image::new(2, 1, vec![[value; 4]; 2]);
    let facts = provenance("scene", &image.hash(), LAVAPIPE, compared_with);
    let metadata = serde_json::to_string(&facts).expect("plain data");
    let path = golden.join("scene.new.exr");
    image.write_exr(&path, Precision::Half, Some(&metadata)).expect("written");
    path
}

const ACCEPT: [&str; 4] = ["accept", "scene", "--because", "why"];

/// A project with an accepted golden `scene`, and the record of a run in which the frame agreed with this golden.
fn with_golden() -> (TempDir, PathBuf) {
    let project = project();
    let golden = project.path().join("golden");
    differing(&golden, 0.25, "");
    karat(project.path(), &ACCEPT).good();
    let folder = project.path().join("record");
    write(&folder, "1.jsonl", &frame(&golden, "scene", &["vulkan"], "pass"));
    write(&folder, "run.json", r#"{"passed":true,"schema":5,"selected":[]}"#);
    karat(project.path(), &["unreferenced", "--record", "record"]).good();
    (project, golden)
}

fn files(folder: &FilePath) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| {
        let entry = entry.expect("readable");
        entry.file_name().to_string_lossy().into_owned()
    });
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}

/// Names of temporary files that Karat writes before it renames them. 4194999 stands for the id of a process that has
/// ended: no running process has an id this large.
const LEFTOVERS: [&str; 3] =
    ["scene.exr.4194999-0.tmp", "scene.toml.4194999-1.tmp", "room.new.exr.4194999-12.tmp"];

// Lesson 60
#[test]
fn leftovers_of_an_interrupted_acceptance_are_named_and_deleted() {
    let (project, golden) = with_golden();
    let unreferenced = |more: &[&str]| {
        karat(project.path(), &[&["unreferenced", "--record", "record"], more].concat())
    };
    for file in LEFTOVERS {
        write(&golden, file, "half of i");
        let ran = unreferenced(&[]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        let line = ran.out.lines().find(|line| line.ends_with(file)).expect("it is named");
        assert!(line.starts_with("an interrupted "), "{line}");
        assert!(unreferenced(&["--delete"]).good().ends_with("deleted 1 file\n"));
        assert_eq!(files(&golden), ["scene.exr", "scene.toml"]);
    }
    unreferenced(&[]).good();
}

// Lesson 60
#[test]
fn the_next_decision_removes_leftovers() {
    for command in [
        &["pending"][..],
        &["pending", "--json"],
        &["accept", "new", "--because", "why"],
        &["reject", "new"],
    ] {
        let (project, golden) = with_golden();
        pending_frame(&golden, "new", LAVAPIPE);
        std::fs::create_dir(golden.join("@gl-llvmpipe")).expect("a folder");
        for file in LEFTOVERS {
            write(&golden, file, "half of i");
            write(&golden.join("@gl-llvmpipe"), file, "half of i");
        }
        karat(project.path(), command);
        let left = files(&golden).into_iter().chain(files(&golden.join("@gl-llvmpipe")));
        let left: Vec<String> = left.filter(|name| name.ends_with(".tmp")).collect();
        assert!(left.is_empty(), "{command:?}: {left:?}");
        assert!(golden.join("scene.exr").is_file() && golden.join("scene.toml").is_file());
    }
}

/// Karat never deletes files with names that only resemble leftovers, or files that a process is still writing.
// Lesson 60
#[test]
fn files_with_other_names_are_never_deleted() {
    let (project, golden) = with_golden();
    let foreign = [
        "scene.exr.tmp",
        "scene.exr.12-0.tmp.txt",
        "scene.exr.12-x.tmp",
        "scene.exr.x-0.tmp",
        "scene.exr.-.tmp",
        "scene.exr.+1-0.tmp",
        "notes.12-0.tmp",
        "a b.exr.12-0.tmp",
        ".exr.12-0.tmp",
    ];
    for file in foreign {
        write(&golden, file, "precious");
    }
    std::fs::create_dir(golden.join("scene.exr.12-0.tmp")).expect("a folder");
    // The process that writes the file still runs, and has locked the file.
    let live = std::fs::File::create(golden.join("room.exr.4194999-7.tmp")).expect("created");
    live.lock().expect("nobody else has it");
    let ran = karat(project.path(), &["unreferenced", "--record", "record", "--delete"]);
    assert_eq!(ran.code, Some(1), "foreign files are stray: {ran:?}");
    assert!(!ran.out.contains("room.exr"), "what is being written isn't: {ran:?}");
    karat(project.path(), &["pending"]).good();
    for file in foreign.iter().chain(&["scene.exr.12-0.tmp", "room.exr.4194999-7.tmp"]) {
        assert!(golden.join(file).exists(), "{file}");
    }
    drop(live);
    karat(project.path(), &["pending"]).good();
    assert!(!golden.join("room.exr.4194999-7.tmp").exists(), "its writer is gone");
}

/// The acceptance was killed after both files were renamed: the golden is written, and its frame is still pending.
// Lesson 60
#[test]
fn accepting_again_after_the_golden_was_written_succeeds() {
    let (project, golden) = with_golden();
    let (before, _) = Image::read_exr(&golden.join("scene.exr")).expect("there");
    let waiting = differing(&golden, 0.5, &before.hash());
    let bytes = std::fs::read(&waiting).expect("there");
    karat(project.path(), &ACCEPT).good();
    let accepted = ["scene.exr", "scene.toml"].map(|file| std::fs::read(golden.join(file)));
    let accepted = accepted.map(|read| read.expect("there"));
    std::fs::write(&waiting, &bytes).expect("written");

    let ran = karat(project.path(), &[&ACCEPT[..], &["--json"]].concat());
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let list = json(&ran.out);
    assert_eq!((&list[0]["accepted"], &list[0]["written"]), (&true.into(), &false.into()));
    assert!(!waiting.exists(), "nothing is left pending");
    let after = ["scene.exr", "scene.toml"].map(|file| std::fs::read(golden.join(file)));
    assert!(after.map(|read| read.expect("there")) == accepted, "as it was accepted first");
    // If the pending frame differs from the golden, it is still stale.
    differing(&golden, 0.75, &before.hash());
    let error = karat(project.path(), &ACCEPT).failure(1);
    assert!(error.contains("the golden of `scene` has changed since"), "{error}");
}

/// The acceptance was killed between the two renames: the provenance belongs to the new golden, and the image is the
/// old one.
// Lesson 60
#[test]
fn accepting_again_after_the_facts_were_written_succeeds() {
    let (project, golden) = with_golden();
    let old = std::fs::read(golden.join("scene.exr")).expect("there");
    let (before, _) = Image::read_exr(&golden.join("scene.exr")).expect("there");
    let waiting = differing(&golden, 0.5, &before.hash());
    let bytes = std::fs::read(&waiting).expect("there");
    karat(project.path(), &ACCEPT).good();
    let new = std::fs::read(golden.join("scene.exr")).expect("there");
    std::fs::write(&waiting, &bytes).expect("written");
    std::fs::write(golden.join("scene.exr"), &old).expect("written");
    std::fs::write(golden.join(LEFTOVERS[0]), &new[..100]).expect("written");

    karat(project.path(), &ACCEPT).good();
    let image = |bytes: &FilePath| Image::read_exr(bytes).expect("readable").0.hash();
    let expected = Image::new(2, 1, vec![[0.5; 4]; 2]).hash();
    assert_eq!(image(&golden.join("scene.exr")), expected);
    assert_eq!(files(&golden), ["scene.exr", "scene.toml"]);
    karat(project.path(), &["unreferenced", "--record", "record"]).good();
}

/// After `kill -9` at any time, the golden is completely the old or completely the new one. Accepting again does the
/// remaining steps.
// Lesson 60
#[test]
fn an_acceptance_may_be_killed_at_any_time() {
    let project = project();
    let golden = project.path().join("golden");
    std::fs::create_dir(&golden).expect("a folder");
    let noise = |seed: u32| {
        let mut state = seed;
        let mut value = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f32::from_bits(0x3f80_0000 | state >> 9)
        };
        let pixels = (0..128 * 128).map(|_| [value(), value(), value(), 1.0]).collect();
        // A golden in half floats returns rounded values.
        Image::new(128, 128, pixels).rounded_to(Precision::Half)
    };
    let wait = |image: &Image, compared_with: &str| {
        let mut facts = provenance("scene", &image.hash(), LAVAPIPE, compared_with);
        (facts.width, facts.height) = (128, 128);
        let metadata = serde_json::to_string(&facts).expect("plain data");
        let path = golden.join("scene.new.exr");
        image.write_exr(&path, Precision::Half, Some(&metadata)).expect("written");
    };
    let mut current = noise(0);
    wait(&current, "");
    let begun = std::time::Instant::now();
    karat(project.path(), &ACCEPT).good();
    let whole = begun.elapsed();
    let mut killed = 0;
    for round in 1..=50_u32 {
        let next = noise(round);
        wait(&next, &current.hash());
        let mut command = command(project.path(), &ACCEPT);
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let mut child = child.expect("the binary was built with this test");
        // The kills are spread over the duration of an acceptance, in mixed order.
        std::thread::sleep(whole * (round * 37 % 50) / 50 + Duration::from_micros(200));
        child.kill().expect("ours");
        killed += u32::from(!child.wait().expect("it ends").success());

        let (image, metadata) = Image::read_exr(&golden.join("scene.exr")).expect("whole");
        let known = [&current, &next].iter().any(|known| known.hash() == image.hash());
        assert!(known && metadata.is_some(), "round {round}: neither the old nor the new golden");
        if golden.join("scene.new.exr").exists() {
            karat(project.path(), &ACCEPT).good();
        } else {
            karat(project.path(), &["pending"]).good();
        }
        assert_eq!(files(&golden), ["scene.exr", "scene.toml"], "round {round}");
        let file = ExrFile::read(&golden.join("scene.exr")).expect("whole");
        assert_eq!(file.parts[0].image.hash(), next.hash(), "round {round}");
        let facts = std::fs::read_to_string(golden.join("scene.toml")).expect("text");
        assert!(facts.contains(&next.hash()), "round {round}: facts of another golden");
        current = next;
    }
    assert!(killed >= 10, "only {killed} of 50 were killed before they ended");
}
