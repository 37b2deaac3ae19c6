//! Tests the messages about files that Karat can't use. Each message names the problem, the file and the reason once.

use super::pending::zip;
use super::*;

/// Runs a command that fails, and returns its error message. Checks that the message doesn't repeat
/// itself, as `a: b: a` does.
#[track_caller]
fn error(folder: &FilePath, arguments: &[&str]) -> String {
    let error = karat(folder, arguments).error();
    let parts: Vec<&str> = error.trim_end().split(": ").collect();
    for (index, part) in parts.iter().enumerate() {
        assert!(!parts[..index].contains(part), "`{part}` is told twice: {error}");
    }
    error
}

#[test]
fn each_cause_is_printed_once() {
    let project = project();
    let folder = project.path();
    std::fs::create_dir_all(folder.join("golden")).expect("a folder");
    std::fs::create_dir(folder.join("folder.exr")).expect("a folder");
    write(folder, "text.zip", "no zip");
    write(folder, "run/run.json", r#"{"passed":true,"schema":5,"selected":[]}"#);
    std::fs::create_dir(folder.join("run/1.jsonl")).expect("a folder");
    let image = karat::Image::new(1, 1, vec![[1.0; 4]]);
    image.write_exr(&folder.join("a.exr"), karat::image::Precision::Float, None).expect("written");
    let same = "can't read `folder.exr`: it is a folder\n";
    for (arguments, message) in [
        (&["diff", "folder.exr", "folder.exr"][..], same),
        (&["preview", "folder.exr"], same),
        (&["diff", "a.exr", "."], "can't read `.`: it is a folder\n"),
        // A file isn't a folder. This makes the path unreadable for every user, even for root.
        (&["diff", "text.zip/a.exr", "text.zip"], "can't read `text.zip/a.exr`: "),
        (&["pending", "--from", "text.zip"], "can't use `text.zip`: this isn't a readable zip: "),
        (&["unreferenced", "--record", "run"], "can't read the record `run/1.jsonl`: "),
        (&["report", "--record", "run"], "can't read the record `run/1.jsonl`: "),
        (&["call", "calc::same", "--table", "text.zip/a.csv"], "can't read `text.zip/a.csv`"),
        (&["list", "--shaders", "text.zip/a.wgsl"], "text.zip/a.wgsl"),
    ] {
        let error = error(folder, arguments);
        assert!(error.contains(message), "{arguments:?}: {error}");
    }
    let error = error(folder, &["preview", "a.exr", "--out", "text.zip/a.png"]);
    assert!(error.contains("can't write `text.zip/a.png`: "), "{error}");
}

/// It is an error if `--from` names a folder or zip file that has neither pending frames nor the record of a run.
#[test]
fn a_folder_without_a_run_has_no_verdict() {
    let project = project();
    let folder = project.path();
    std::fs::create_dir_all(folder.join("golden")).expect("a folder");
    std::fs::create_dir(folder.join("empty")).expect("a folder");
    zip(&folder.join("empty.zip"), &[]);
    let run: &[u8] = br#"{"passed":true,"schema":5,"selected":[]}"#;
    zip(&folder.join("green.zip"), &[("record/run.json", run)]);
    let green = std::fs::read(folder.join("green.zip")).expect("written");
    zip(&folder.join("outer.zip"), &[("ci/green.zip", &green), ("records/1.jsonl", b"{}")]);
    write(folder, "[wrong]/scene.exr", "");
    write(folder, "[wrong]/1.jsonl", "");
    std::fs::create_dir(folder.join("outer")).expect("a folder");
    std::fs::copy(folder.join("green.zip"), folder.join("outer/green.zip")).expect("copied");
    for (from, inner) in [
        ("empty", None),
        ("empty.zip", None),
        ("[wrong]", None),
        ("outer.zip", Some("ci/green.zip")),
        ("outer", Some("outer/green.zip")),
    ] {
        for command in [
            &["pending"][..],
            &["pending", "--json"],
            &["accept", "*", "--because", "why"],
            &["review", "--static", "page"],
        ] {
            let ran = karat(folder, &[command, &["--from", from]].concat());
            assert_eq!(ran.out, "", "{from}");
            let error = ran.failure(3);
            let start = format!(
                "error: `{from}` isn't the artefact of a run, because it contains no frame"
            );
            assert!(error.starts_with(&start), "{error}");
            assert!(
                error.contains("name the folder or zip that CI uploaded from `target/karat`"),
                "{error}"
            );
            let told = inner.map(|inner| format!("you may mean the zip `{inner}` in this folder"));
            assert!(told.is_none_or(|told| error.contains(&told)), "{error}");
        }
    }
    assert!(!folder.join("page").exists());
    // The run left no frame, but a record.
    write(folder, "[green]/ci/record/1.jsonl", "");
    for from in ["green.zip", "[green]", "outer/green.zip"] {
        let out = karat(folder, &["pending", "--from", from]).good();
        assert_eq!(out, "nothing is pending\n", "{from}");
    }
}

#[test]
fn conflicting_entries_of_an_archive_are_errors() {
    let project = project();
    let folder = project.path();
    std::fs::create_dir_all(folder.join("golden")).expect("a folder");
    let (file, below) = (("x.new.exr", &b"a"[..]), ("x.new.exr/a.new.exr", &b"b"[..]));
    zip(&folder.join("below.zip"), &[file, below]);
    zip(&folder.join("above.zip"), &[below, file]);
    zip(&folder.join("dot.zip"), &[("a/x.new.exr", b"a"), ("a/./x.new.exr", b"b")]);
    // Programs that write zips refuse to write this zip.
    zip(&folder.join("twice.zip"), &[("a.new.exr", b"a"), ("b.new.exr", b"b")]);
    let mut bytes = std::fs::read(folder.join("twice.zip")).expect("written");
    let places = bytes.windows(9).enumerate().filter(|(_, part)| *part == b"b.new.exr");
    let places: Vec<usize> = places.map(|(place, _)| place).collect();
    assert_eq!(places.len(), 2, "the entry's own head and the directory");
    places.iter().for_each(|place| bytes[*place] = b'a');
    std::fs::write(folder.join("twice.zip"), bytes).expect("written");
    let unpacked =
        |name: &str, why: &str| format!("entry `{name}` of the zip can't be unpacked: {why}");
    for (from, why) in [
        ("below.zip", unpacked(below.0, "`x.new.exr` is both a file and a folder")),
        ("above.zip", unpacked(file.0, "the zip has a file and a folder with this name")),
        ("dot.zip", unpacked("a/./x.new.exr", "another entry of the zip has the same path")),
        ("twice.zip", "two entries of the zip have the same name".to_owned()),
    ] {
        let error = error(folder, &["pending", "--from", from]);
        assert_eq!(error, format!("error: can't use `{from}`: {why}\n"));
    }
}
