//! `karat unreferenced`: gives no verdict without the record of a full run that passed.

use std::path::PathBuf;

use karat::Image;
use karat::image::Precision;
use karat::unstable::record::Run;

use super::pending::pending_frame;
use super::report::{frame, function};
use super::*;

const LAVAPIPE: &str = "llvmpipe (LLVM 15.0.6, 256 bits)";

/// A project with the goldens `scene` and `room`, and the goldens of `scene` for the profile of GL and for another
/// adapter.
fn goldens() -> TempDir {
    let project = project();
    let golden = project.path().join("golden");
    for case in ["scene", "room"] {
        pending_frame(&golden, case, LAVAPIPE);
    }
    let accept = ["accept", "*", "--because", "the first ones"];
    karat(project.path(), &accept).good();
    for profile in ["@gl-llvmpipe", "@metal-apple"] {
        std::fs::create_dir(golden.join(profile)).expect("a folder");
        for file in ["scene.exr", "scene.toml"] {
            std::fs::copy(golden.join(file), golden.join(profile).join(file)).expect("copied");
        }
    }
    project
}

fn record(project: &TempDir, lines: &[String], run: Option<(&[&str], bool)>) -> PathBuf {
    let folder = project.path().join("target/karat/record");
    if folder.is_dir() {
        std::fs::remove_dir_all(&folder).expect("removed");
    }
    write(&folder, "1.jsonl", &lines.concat());
    if let Some((selected, passed)) = run {
        let selected = selected.iter().map(|text| (*text).to_owned()).collect();
        let run = Run { selected, passed, ..Run::default() };
        run.write(&folder).expect("written");
    }
    folder
}

#[test]
fn goldens_that_all_are_compared_pass() {
    let project = goldens();
    let golden = project.path().join("golden");
    let all = [
        frame(&golden, "scene", &["vulkan", "gl"], "pass"),
        frame(&golden, "room", &["vulkan"], "pass"),
    ];
    record(&project, &all, Some((&[], true)));
    let out = karat(project.path(), &["unreferenced"]).good();
    assert!(out.contains(
        "not judged, because the golden's profile didn't run: scene of profile metal-apple"
    ));
    assert!(out.ends_with("3 goldens compared, 0 unreferenced, 0 stray files\n"), "{out}");
    // A record that `cargo ci test` wrote is read, too.
    let folder = record(&project, &all, None);
    write(&folder, "run.json", r#"{"passed":true,"schema":5,"selected":[]}"#);
    karat(project.path(), &["unreferenced"]).good();
}

// Lesson 43
#[test]
fn an_uncompared_golden_fails_and_can_be_deleted() {
    let project = goldens();
    let golden = project.path().join("golden");
    // A frame of the same name in another folder is a different frame.
    let elsewhere = frame(&project.path().join("other"), "room", &["vulkan"], "pass");
    std::fs::create_dir(project.path().join("other")).expect("a folder");
    let scene = frame(&golden, "scene", &["vulkan"], "pass");
    // Another check ran on GL, so a test might have compared the golden of GL.
    let lines = [elsewhere, scene, function("m::f", "gl", "pass", None)];
    record(&project, &lines, Some((&[], true)));
    let ran = karat(project.path(), &["unreferenced"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains("no test compares golden room  "), "{ran:?}");
    assert!(ran.out.contains("no test compares golden scene of profile gl-llvmpipe  "), "{ran:?}");
    assert!(ran.out.ends_with("1 golden compared, 2 unreferenced, 0 stray files\n"), "{ran:?}");
    let ran = karat(project.path(), &["unreferenced", "--json"]);
    let report = json(&ran.out);
    assert_eq!((ran.code, &report["compared"]), (Some(1), &1.into()));
    assert_eq!(report["unreferenced"][1]["case"], "room");
    assert_eq!(report["unreferenced"][0]["profile"], "gl-llvmpipe");
    assert_eq!(report["unjudged"][0]["profile"], "metal-apple");

    let out = karat(project.path(), &["unreferenced", "--delete"]).good();
    assert!(out.ends_with("deleted 4 files\n"), "{out}");
    assert!(golden.join("scene.exr").is_file() && golden.join("@metal-apple/scene.exr").is_file());
    for file in ["room.exr", "room.toml", "@gl-llvmpipe/scene.exr", "@gl-llvmpipe/scene.toml"] {
        assert!(!golden.join(file).exists(), "{file}");
    }
    karat(project.path(), &["unreferenced"]).good();
}

// Lesson 43
#[test]
fn without_evidence_there_is_no_verdict() {
    let project = goldens();
    let folder = project.path();
    let error = karat(folder, &["unreferenced"]).failure(3);
    assert!(error.contains("there is no record of a run"), "{error}");
    let all = [frame(&folder.join("golden"), "scene", &["vulkan"], "pass")];
    for (run, message) in [
        (None, "doesn't say that its run ended"),
        (Some((&["scene"][..], true)), "the last run ran only some tests (`scene`)"),
        (Some((&["-p tests"], true)), "the last run ran only some tests (`-p tests`)"),
        (Some((&[], false)), "a test failed in the last run"),
    ] {
        record(&project, &all, run);
        let error = karat(folder, &["unreferenced", "--delete"]).failure(3);
        assert!(error.contains(message), "{error}");
    }
    let overlaid = all[0].replace("\"message\"", "\"overlay\":\"mutants\",\"message\"");
    record(&project, &[overlaid], Some((&[], true)));
    let error = karat(folder, &["unreferenced", "--delete"]).failure(3);
    assert!(error.contains("files of KARAT_OVERLAY=mutants replaced shaders"), "{error}");
    let record_folder = record(&project, &["not a record\n".to_owned()], Some((&[], true)));
    let error = karat(folder, &["unreferenced"]).error();
    assert!(error.contains("1.jsonl` line 1 isn't a record of version 5"), "{error}");
    write(&record_folder, "run.json", "{}");
    let error = karat(folder, &["unreferenced"]).error();
    assert!(error.contains("run.json` line 1 isn't a record of version 5"), "{error}");
    assert!(folder.join("golden/room.exr").is_file(), "nothing was deleted");
}

#[test]
fn a_run_that_compared_nothing_of_a_folder_deletes_nothing_there() {
    let project = goldens();
    record(&project, &[function("m::f", "vulkan", "pass", None)], Some((&[], true)));
    assert_eq!(karat(project.path(), &["unreferenced"]).code, Some(1));
    let error = karat(project.path(), &["unreferenced", "--delete"]).error();
    assert!(error.contains("the run compared no golden in"), "{error}");
    assert!(project.path().join("golden/room.exr").is_file());
}

#[test]
fn a_folder_without_goldens_has_no_verdict() {
    let project = goldens();
    let folder = project.path();
    record(&project, &[function("m::f", "vulkan", "pass", None)], Some((&[], true)));
    std::fs::create_dir(folder.join("empty")).expect("a folder");
    write(folder, "empty/README.md", "goldens will be here");
    for arguments in [&[][..], &["--json"], &["--delete"]] {
        let all = [&["unreferenced", "--goldens", "empty"], arguments].concat();
        let ran = karat(folder, &all);
        assert_eq!(ran.out, "", "{arguments:?}");
        assert!(ran.failure(3).contains("there is no golden in `empty`"), "{arguments:?}");
    }
    // Remains of a deleted golden get a verdict.
    write(folder, "empty/gone.png", "");
    assert_eq!(karat(folder, &["unreferenced", "--goldens", "empty"]).code, Some(1));
}

#[test]
fn a_run_that_compared_frames_only_elsewhere_has_no_verdict() {
    let project = goldens();
    let folder = project.path();
    let other = folder.join("other");
    std::fs::create_dir(&other).expect("a folder");
    let mean = frame(FilePath::new(""), "mean of (0, 0) to (1, 1)", &["vulkan"], "pass");
    let elsewhere = frame(&other, "scene", &["vulkan"], "pass");
    record(&project, &[elsewhere, mean.clone()], Some((&[], true)));
    for arguments in [&["unreferenced"][..], &["unreferenced", "--delete"]] {
        let error = karat(folder, arguments).failure(3);
        assert!(error.contains("the last run compared no frame with a golden of"), "{error}");
        assert!(error.contains(&format!("only with goldens of `{}`;", other.display())), "{error}");
    }
    assert!(folder.join("golden/room.exr").is_file(), "nothing was deleted");
    // A comparison with a number uses no folder. So no golden of this folder is compared.
    record(&project, &[mean], Some((&[], true)));
    assert_eq!(karat(folder, &["unreferenced"]).code, Some(1));
}

/// The provenance may differ because of an edit, a merge, or a forgotten file.
#[test]
fn facts_that_are_not_those_of_their_golden_fail() {
    let project = goldens();
    let (folder, golden) = (project.path(), project.path().join("golden"));
    let all = ["scene", "room"].map(|case| frame(&golden, case, &["vulkan", "gl"], "pass"));
    record(&project, &all, Some((&[], true)));
    karat(folder, &["unreferenced"]).good();
    let facts = std::fs::read_to_string(golden.join("scene.toml")).expect("facts");
    let other = facts.replace("the first ones", "another side").replace("rel 1e-3", "rel 1");
    let marked = format!("<<<<<<< ours\n{facts}=======\n{facts}>>>>>>> theirs\n");
    let fails = |file: &str, case: &str, problem: &str| {
        let ran = karat(folder, &["unreferenced"]);
        assert_eq!(ran.code, Some(1), "{problem}: {ran:?}");
        let start = format!("{case}: `{}` {problem}", golden.join(file).display());
        let line = ran.out.lines().find(|line| line.starts_with(&start));
        let line = line.unwrap_or_else(|| panic!("no `{start}` in:\n{}", ran.out));
        assert!(line.ends_with("run the test and accept its frame again"), "{line}");
        let end = "3 goldens compared, 0 unreferenced, 0 stray files, 1 with wrong or missing provenance\n";
        assert!(ran.out.ends_with(end), "{ran:?}");
        let ran = karat(folder, &["unreferenced", "--delete", "--json"]);
        let report = json(&ran.out);
        assert_eq!((ran.code, &report["deleted"]), (Some(1), &serde_json::json!([])));
        let doubt = &report["doubtful"][0];
        assert_eq!(doubt["file"], golden.join(file).with_extension("exr").display().to_string());
        assert!(doubt["problem"].as_str().is_some_and(|text| text.contains(problem)), "{report}");
    };
    for (file, case) in [
        ("scene.toml", "scene"),
        ("@gl-llvmpipe/scene.toml", "scene of profile gl-llvmpipe"),
        ("@metal-apple/scene.toml", "scene of profile metal-apple"),
    ] {
        write(&golden, file, &other);
        fails(file, case, "differs from the provenance of `");
        let out = karat(folder, &["unreferenced"]).out;
        assert!(
            out.contains("scene.exr` in the fields `because`, `tolerance`; restore the image"),
            "{out}"
        );
        write(&golden, file, &marked);
        fails(file, case, "has no readable provenance: ");
        write(&golden, file, "");
        fails(file, case, "has no readable provenance: missing field");
        std::fs::remove_file(golden.join(file)).expect("removed");
        fails(file, case, "is missing");
        // Git may have changed the line ends.
        write(&golden, file, &facts.replace('\n', "\r\n"));
        karat(folder, &["unreferenced"]).good();
    }
    // A golden of another tool has no provenance.
    let room = golden.join("room.exr");
    Image::new(1, 1, vec![[1.0; 4]]).write_exr(&room, Precision::Half, None).expect("written");
    fails("room.toml", "room", "has provenance, but another tool wrote `");
    std::fs::remove_file(golden.join("room.toml")).expect("removed");
    karat(folder, &["unreferenced"]).good();
    // An unreadable file has no provenance.
    write(&golden, "@metal-apple/scene.exr", "version https://git-lfs.github.com/spec/v1\n");
    let ran = karat(folder, &["unreferenced"]);
    let told = "scene of profile metal-apple: `golden/@metal-apple/scene.exr` is a Git LFS pointer";
    assert!(ran.code == Some(1) && ran.out.contains(told), "{ran:?}");
}

/// `--delete` succeeds only if no unreferenced golden remains.
#[test]
fn files_that_delete_keeps_still_fail() {
    let project = goldens();
    let golden = project.path().join("golden");
    let all = ["scene", "room"].map(|case| frame(&golden, case, &["vulkan", "gl"], "pass"));
    record(&project, &all, Some((&[], true)));
    let sky = golden.join("sky.exr");
    Image::new(1, 1, vec![[1.0; 4]]).write_exr(&sky, Precision::Half, None).expect("written");
    let ran = karat(project.path(), &["unreferenced", "--delete"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let end = format!("compare the file in a test  {}\ndeleted 0 files\n", sky.display());
    assert!(ran.out.contains("not deleted, because this file has no provenance"), "{ran:?}");
    assert!(ran.out.ends_with(&end), "{ran:?}");
    let ran = karat(project.path(), &["unreferenced", "--delete", "--json"]);
    let report = json(&ran.out);
    assert_eq!((ran.code, &report["deleted"]), (Some(1), &serde_json::json!([])));
    assert_eq!(report["left"], serde_json::json!([sky]));
    assert!(sky.is_file());
    // Karat's files are deleted. Other files stay, and the command fails.
    record(&project, &all[..1], Some((&[], true)));
    let ran = karat(project.path(), &["unreferenced", "--delete"]);
    assert_eq!((ran.code, golden.join("room.exr").exists()), (Some(1), false), "{ran:?}");
    std::fs::remove_file(&sky).expect("removed");
    karat(project.path(), &["unreferenced", "--delete"]).good();
}

#[test]
fn stray_files_are_reported_and_only_ours_are_deleted() {
    let project = goldens();
    let golden = project.path().join("golden");
    for profile in ["@gl-llvmpipe", "@metal-apple"] {
        std::fs::remove_dir_all(golden.join(profile)).expect("removed");
    }
    let all = ["scene", "room"].map(|case| frame(&golden, case, &["vulkan"], "pass"));
    record(&project, &all, Some((&[], true)));
    for file in ["README.md", ".gitattributes", "scene.png"] {
        write(&golden, file, "");
    }
    karat(project.path(), &["unreferenced"]).good();
    for file in ["cameras.toml", "room.exr.orig", "gone.png"] {
        write(&golden, file, "");
    }
    std::fs::copy(golden.join("scene.toml"), golden.join("gone.toml")).expect("copied");
    // Another tool wrote this image, and no test compares it.
    let sky = Image::new(1, 1, vec![[1.0; 4]]);
    sky.write_exr(&golden.join("sky.exr"), Precision::Half, None).expect("written");
    let ran = karat(project.path(), &["unreferenced"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for reason in [
        "this file is the provenance of a golden that doesn't exist",
        "this file doesn't belong to a golden",
        "this file is the preview of an image that doesn't exist",
    ] {
        assert!(ran.out.contains(reason), "no `{reason}`: {ran:?}");
    }
    let ran = karat(project.path(), &["unreferenced", "--delete"]);
    assert_eq!(ran.code, Some(1), "what isn't ours is left: {ran:?}");
    assert!(!golden.join("gone.toml").exists());
    assert!(golden.join("room.exr.orig").is_file() && golden.join("gone.png").is_file());
    assert!(golden.join("cameras.toml").is_file() && golden.join("sky.exr").is_file());
    assert!(golden.join("README.md").is_file() && golden.join("scene.png").is_file());
}
