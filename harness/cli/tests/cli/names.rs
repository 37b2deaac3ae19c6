//! Tests hostile names of tests, functions, goldens and files, in each format that other programs read.

use std::collections::BTreeSet;

use super::report::{frame, function};
use super::*;

/// Names that could break a report: with characters that XML forbids, with a line break before a GitHub command such as
/// `::error`, with markup, with characters that a shell interprets, and one too long for a command line.
fn nasty() -> Vec<String> {
    // Linux allows 128 KiB for an argument or a variable.
    let long = "n".repeat(1 << 18);
    let mut all: Vec<String> = [
        "a\u{fffe}b\u{ffff}",
        "a\n::error file=x.rs,line=1::planted",
        "::error file=x.rs::planted",
        "\r\n::warning::planted",
        "a\0b",
        "a\u{1}\u{1b}[2J\u{7f}\u{85}",
        "<img src=x onerror=alert(1)>",
        "]]></failure><testcase name=\"x\"/>",
        "&amp; \"double\" 'single' `back` $(id) \\ %0A %25",
        "a | b || c",
        "![x](http://example.org/x.png)",
        "\u{202e}reversed\u{2028}\u{2029}",
        "\u{1f980} crab",
        "--exact",
        " #2",
        "[[ATTACHMENT|/etc/passwd]]",
    ]
    .map(str::to_owned)
    .to_vec();
    all.push(long);
    // Mixtures of these names, from a fixed seed.
    let mut state = 1_u64;
    let mut next = |below: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(state >> 33).expect("31 bits") % below
    };
    let parts: Vec<char> = all[..16].iter().flat_map(|name| name.chars()).collect();
    for _ in 0..100 {
        let length = 1 + next(40);
        all.push((0..length).map(|_| parts[next(parts.len())]).collect());
    }
    all
}

/// Records in which each name belongs to a function, a test and a golden.
fn records(folder: &FilePath, names: &[String]) -> String {
    let named = |line: String, name: &str| {
        let mut record: serde_json::Value = serde_json::from_str(&line).expect("a record");
        record["test"] = name.into();
        record["message"] = format!("error: {name} fails").into();
        let replay = serde_json::json!({
            "variables": [], "program": "karat", "arguments": ["test", name]
        });
        let adapter =
            serde_json::json!({ "path": "gl", "name": name, "driver": "", "software": true });
        record["details"] = serde_json::json!({
            "headline": format!("{name} fails"),
            "paths": [{ "adapter": adapter, "worst": { "replay": replay } }]
        });
        for key in ["function", "golden", "check"] {
            if record["subject"].get(key).is_some() {
                record["subject"][key] = name.into();
            }
        }
        record["paths"][0]["worst"] = name.into();
        format!("{record}\n")
    };
    let of = |name: &String| {
        let function = named(function("m::f", "gl", "fail", Some("")), name);
        // The record also has a check twice, and a frame.
        let frame = named(frame(&folder.join("golden"), "x", &["vulkan"], "fail"), name);
        format!("{function}{function}{frame}")
    };
    names.iter().map(of).collect()
}

/// Checks the reports of a run in every format, and the lines that GitHub's runner reads as commands.
fn check(project: &TempDir, lines: &str, checks: usize) -> Vec<String> {
    let folder = project.path();
    let record = folder.join("target/karat/record");
    write(&record, "1.jsonl", lines);
    karat::unstable::record::Run { passed: false, ..Default::default() }
        .write(&record)
        .expect("written");
    let summary = folder.join("summary.md");
    drop(std::fs::remove_file(&summary));
    let mut command = command(folder, &["report", "--all"]);
    command.args(["--junit", "r.xml", "--html", "r.html", "--json", "r.json"]);
    command.env("GITHUB_ACTIONS", "true").env("GITHUB_STEP_SUMMARY", &summary);
    let ran = output(&mut command);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    let read = |file: &str| std::fs::read_to_string(folder.join(file)).expect("written");

    let text = read("r.xml");
    let xml = roxmltree::Document::parse(&text).unwrap_or_else(|error| panic!("{error}"));
    let cases: Vec<_> = xml.descendants().filter(|node| node.has_tag_name("testcase")).collect();
    assert_eq!(cases.len(), checks);
    let name = |case: &roxmltree::Node<'_, '_>| {
        ["classname", "name"].map(|key| case.attribute(key).expect(key).to_owned())
    };
    let names: BTreeSet<_> = cases.iter().map(name).collect();
    assert_eq!(names.len(), checks, "no two cases have one name");
    let attached = xml.descendants().filter_map(|node| node.text());
    let mut attached = attached.flat_map(str::lines);
    assert!(!attached.any(|line| line.starts_with("[[ATTACHMENT|/etc")), "{text}");

    assert!(!read("r.html").contains("<img src=x"));
    let all: serde_json::Value = serde_json::from_str(&read("r.json")).expect("JSON");
    assert_eq!(all["records"].as_array().map(Vec::len), Some(checks));

    let summary = read("summary.md");
    // The text outside of `<pre>` contains no Markdown from a name.
    let outside = summary.split("<pre>").map(|part| part.rsplit("</pre>").next().unwrap_or(part));
    let outside: String = outside.collect();
    assert!(!summary.contains("<img") && !outside.contains("]("), "{outside}");
    // A backslash before a `|` may belong to a name.
    let mut rows = outside.lines().filter(|line| line.starts_with('|'));
    let broken = rows.find(|row| row.matches('|').count() != 8);
    assert_eq!(broken, None);

    // Between the lines that stop and resume commands, GitHub reads none.
    let (before, rest) = ran.out.split_once("::stop-commands::").expect("commands are held");
    assert_eq!(before, "");
    let (word, rest) = rest.split_once('\n').expect("a line");
    let (_, commands) = rest.split_once(&format!("\n::{word}::\n")).expect("they are released");
    commands.lines().filter(|line| line.starts_with("::")).map(str::to_owned).collect()
}

// Lesson 182
#[test]
fn no_name_breaks_a_report() {
    let project = project();
    let names = nasty();
    for (some, annotations) in [(&names[..], 10), (&names[..2], 6)] {
        let commands = check(&project, &records(project.path(), some), 3 * some.len());
        assert_eq!(commands.len(), annotations, "{commands:?}");
        for command in commands {
            assert!(command.starts_with("::error "), "{command}");
            let (properties, _) = command["::error ".len()..].split_once("::").expect("a message");
            let known = ["file", "line", "col", "title"];
            let key =
                |property: &str| property.split('=').next().is_some_and(|k| known.contains(&k));
            assert!(properties.split(',').all(key), "{command}");
        }
    }
    // Editors get one line for each failure.
    let ran = karat(project.path(), &["report", "--short"]);
    assert_eq!(ran.out.lines().count(), 7, "{ran:?}");
    assert!(ran.out.lines().take(6).all(|line| line.contains("error: ")), "{ran:?}");
}

/// Karat can run and replay a test with any name.
// Lesson 182
#[test]
fn no_name_breaks_a_run_or_its_replay() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", "fn f(x: f32) -> f32 { return 0.5 * x; }\n");
    let names = &nasty()[..17];
    let test = |name: &String| {
        let name = toml::Value::String(name.clone());
        format!(
            "[[test]]\nname = {name}\nfunction = \"f\"\nover = {{ x = \"1..2\" }}\nin_range = [2, 3]\n"
        )
    };
    write(folder.path(), "m.test.toml", &names.iter().map(test).collect::<String>());
    let mut run = command(folder.path(), &["test", ".", "--paths", "cpu", "--junit", "r.xml"]);
    let ran = output(run.env("GITHUB_ACTIONS", "true"));
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    let count = names.len();
    assert!(ran.out.contains(&format!("{count} checks, {count} failed")), "{}", ran.out);
    let planted = |line: &&str| line.starts_with("::error file=x") || line.starts_with("::warning");
    assert!(!ran.out.lines().any(|line| planted(&line)), "{}", ran.out);
    let xml = std::fs::read_to_string(folder.path().join("r.xml")).expect("written");
    let xml = roxmltree::Document::parse(&xml).expect("well-formed");
    let cases = xml.descendants().filter(|node| node.has_tag_name("testcase"));
    assert_eq!(cases.count(), count);
    // Each test runs again by its short name, and fails again.
    let listed = karat(folder.path(), &["replay"]).failure(3);
    let short: Vec<&str> =
        listed.lines().filter_map(|line| line.strip_prefix("  ")?.split(' ').next()).collect();
    assert_eq!(short.len(), count, "{listed}");
    for name in short {
        let ran = karat(folder.path(), &["replay", name]);
        assert!(ran.code == Some(1) && ran.out.contains("0 passed; 1 failed"), "{name}: {ran:?}");
    }
}

/// The page of `karat matrix` escapes the file's name, so that the name isn't read as HTML.
// Lesson 182
#[test]
fn no_file_breaks_the_page_of_translations() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let name = "<img src=x>";
    write(&folder.path().join(name), "m.wgsl", "fn f(x: f32) -> f32 { return x; }\nfn g(\n");
    write(&folder.path().join(name), "n.wgsl", "fn f(x: f32) -> f32 { return x; }\n");
    let arguments = ["matrix", "--shaders", name, "--columns", "cpu", "--markdown", "m.md"];
    karat(folder.path(), &arguments);
    let page = std::fs::read_to_string(folder.path().join("m.md")).expect("written");
    assert!(page.contains("&lt;img") && !page.contains("<img"), "{page}");
}

/// Karat reports a file with a name that no module can have. No line of the report begins with a part of this name.
// Lesson 182
#[cfg(unix)]
#[test]
fn no_file_begins_a_line_with_a_command() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "a\n::error file=x::planted.wgsl", "fn f(x: f32) -> f32 { return y; }\n");
    write(&shaders, "m.wgsl", "fn g(x: f32) -> f32 { return x; }\n");
    write(&shaders, "m.test.toml", "[[test]]\nfunction = \"g\"\nfinite = true\n");
    for arguments in [&["check"][..], &["test", "shaders", "--paths", "cpu"], &["list"]] {
        let ran = karat(folder.path(), arguments);
        assert_ne!(ran.code, Some(0), "{ran:?}");
        let mut lines = ran.out.lines().chain(ran.err.lines());
        assert!(!lines.any(|line| line.starts_with("::error")), "{ran:?}");
    }
}
