//! What people see where a file can't be used: what, which file, and why, once.

use super::*;

/// The message, in which no part stands twice.
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
fn a_cause_is_told_once() {
    let project = project();
    let folder = project.path();
    std::fs::create_dir_all(folder.join("golden")).expect("a folder");
    std::fs::create_dir(folder.join("folder.exr")).expect("a folder");
    write(folder, "text.zip", "no zip");
    write(folder, "run/run.json", r#"{"passed":true,"schema":2,"selected":[]}"#);
    std::fs::create_dir(folder.join("run/1.jsonl")).expect("a folder");
    let image = karat::Image::new(1, 1, vec![[1.0; 4]]);
    image.write_exr(&folder.join("a.exr"), karat::Precision::Float, None).expect("written");
    let same = "can't read `folder.exr`: it is a folder\n";
    for (arguments, message) in [
        (&["diff", "folder.exr", "folder.exr"][..], same),
        (&["preview", "folder.exr"], same),
        (&["diff", "a.exr", "."], "can't read `.`: it is a folder\n"),
        // A file is no folder, which is how any file is unreadable, even for root.
        (&["diff", "text.zip/a.exr", "text.zip"], "can't read `text.zip/a.exr`: "),
        (&["pending", "--from", "text.zip"], "can't use `text.zip`: it isn't a readable zip: "),
        (&["unreferenced", "--record", "run"], "can't read the record `run/1.jsonl`: "),
        (&["report", "--record", "run"], "can't read the record `run/1.jsonl`: "),
        (&["call", "calc::same", "--cases", "text.zip/a.csv"], "can't read `text.zip/a.csv`"),
        (&["list", "--package", "text.zip/a.wgsl"], "text.zip/a.wgsl"),
    ] {
        let error = error(folder, arguments);
        assert!(error.contains(message), "{arguments:?}: {error}");
    }
    let error = error(folder, &["preview", "a.exr", "--out", "text.zip/a.png"]);
    assert!(error.contains("can't write `text.zip/a.png`: "), "{error}");
}
