//! Tests that text from other people, such as a shader or a zip file, can't send commands to the terminal.

use karat::Image;
use karat::image::Precision;
use karat::unstable::golden::Provenance;
use karat::unstable::image::{ExrFile, Part};

use super::pending::{LAVAPIPE, provenance, zip};
use super::report::function;
use super::*;

/// Text that changes the window's title, clears the screen, moves to the start of the line, hides text, contains an
/// 8-bit control, and reverses the direction of the text that follows.
const HOSTILE: &str = "a\u{1b}]0;owned\u{7}\u{1b}[2J\r\u{1b}[8mb\u{9b}31m\u{7f}\u{202e}c\u{2066}";
/// `HOSTILE` as Karat shows it.
const SHOWN: &str = r"a\u{1b}]0;owned\u{7}\u{1b}[2J\u{d}\u{1b}[8mb\u{9b}31m\u{7f}\u{202e}c\u{2066}";
/// Hostile text without control characters: it only reverses the direction of the text that follows.
const TURNED: &str = "x\u{202e}c\u{2066}";
const TURNED_SHOWN: &str = r"x\u{202e}c\u{2066}";
/// The hostile characters that a file's name can contain.
const NAME: &str = "a\u{1b}]0;owned\u{7}\u{1b}[31mb\u{9b}31m\u{202e}c";
const NAME_SHOWN: &str = r"a\u{1b}]0;owned\u{7}\u{1b}[31mb\u{9b}31m\u{202e}c";

/// Checks that the text contains no command for a terminal.
#[track_caller]
fn assert_tame(text: &str, of: &[&str]) {
    let wild = |c: char| {
        (c.is_control() && c != '\n' && c != '\t')
            || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    assert!(!text.contains(wild), "{of:?}: {text:?}");
}

/// Runs a command, and checks its output with and without colours. Returns the output.
#[track_caller]
fn tame(folder: &FilePath, arguments: &[&str]) -> String {
    let ran = karat(folder, arguments);
    for text in [&ran.out, &ran.err] {
        assert_tame(text, arguments);
    }
    // The only escapes in the output are Karat's colours.
    let coloured = output(command(folder, arguments).env("CLICOLOR_FORCE", "1"));
    for text in [&coloured.out, &coloured.err] {
        let mut plain = text.clone();
        for number in [0, 1, 2, 31, 32, 33, 4] {
            plain = plain.replace(&format!("\x1b[{number}m"), "");
        }
        assert_tame(&plain, arguments);
    }
    ran.out + &ran.err
}

// Lesson 62
#[cfg(unix)]
#[test]
fn names_of_files_are_shown_and_not_obeyed() {
    let project = project();
    let folder = project.path();
    let golden = folder.join("golden");
    write(folder, &format!("shaders/{NAME}.wgsl"), "fn f( {}\n");
    write(&golden, &format!("{NAME}.txt"), "");
    write(&golden, &format!("{NAME}.new.exr"), "");
    write(folder, "record/1.jsonl", &function("m::f", "gl", "pass", None));
    write(folder, "record/run.json", r#"{"passed":true,"schema":5,"selected":[]}"#);
    let exr = format!("{NAME}.exr");
    let image = Image::new(1, 1, vec![[1.0; 4]]);
    image.write_exr(&folder.join(&exr), Precision::Float, None).expect("written");
    for arguments in [
        &["list"][..],
        &["list", "--shaders", NAME],
        &["pending"],
        &["accept", NAME, "--because", "why"],
        &["reject", NAME],
        &["unreferenced", "--record", "record"],
        &["unreferenced", "--record", NAME],
        &["diff", &exr, &exr],
        &["diff", &exr, NAME],
        &["preview", &exr],
        &["call", "calc::double", "--table", NAME],
        &["call", NAME, "1"],
        &["show", NAME],
        &["pending", "--from", NAME],
        &["report", "--record", NAME],
        &["render", NAME],
        &[NAME],
        &["review", "--static", NAME],
    ] {
        let text = tame(folder, arguments);
        if !["render", "show"].contains(&arguments[0]) {
            assert!(text.contains(NAME_SHOWN), "{arguments:?}: {text}");
        }
    }
    // JSON contains the same name, escaped.
    for arguments in [
        &["list", "--json"][..],
        &["pending", "--json"],
        &["unreferenced", "--record", "record", "--json"],
        &["diff", &exr, &exr, "--json"],
    ] {
        let text = karat(folder, arguments).out;
        assert_tame(&text, arguments);
        assert!(json(&text).to_string().contains('\u{9b}'), "{arguments:?}: {text}");
    }
}

/// Karat escapes hostile text from zip files, images, records and shaders.
// Lesson 62
#[test]
fn contents_of_files_are_shown_and_not_obeyed() {
    let project = project();
    let folder = project.path();
    let golden = folder.join("golden");
    std::fs::create_dir(&golden).expect("a folder");
    zip(&folder.join("slip.zip"), &[(&format!("../{HOSTILE}.new.exr"), b"")]);
    zip(&folder.join("bad.zip"), &[(&format!("{HOSTILE}.new.exr"), b"")]);
    // The frame comes from another machine. Its driver and its folder of goldens are hostile.
    let image = Image::new(2, 1, vec![[0.25; 4]; 2]);
    // Provenance refuses control characters. A direction mark isn't a control character.
    let facts = provenance("scene", &image.hash(), &format!("{TURNED} {LAVAPIPE}"), "");
    let metadata = serde_json::to_string(&facts).expect("plain data");
    let frame = golden.join("scene.new.exr");
    image.write_exr(&frame, Precision::Half, Some(&metadata)).expect("written");
    for case in ["a", "b"] {
        let facts = provenance(HOSTILE, &image.hash(), LAVAPIPE, "");
        let metadata = serde_json::to_string(&facts).expect("plain data");
        let frame = golden.join(format!("{case}.new.exr"));
        image.write_exr(&frame, Precision::Half, Some(&metadata)).expect("written");
    }
    // Images have named parts.
    let part = |name: &str| Part::new(name, Precision::Half, image.clone());
    let name = "n".repeat(HOSTILE.len());
    let parts = ExrFile { parts: vec![part("color"), part(&name)], metadata: None };
    parts.write(&folder.join("parts.exr")).expect("written");
    // Karat writes no such name, but another tool may.
    let mut bytes = std::fs::read(folder.join("parts.exr")).expect("written");
    let mut places = bytes.windows(name.len()).enumerate();
    let place = places.find(|(_, part)| *part == name.as_bytes()).expect("it is there").0;
    bytes[place..place + name.len()].copy_from_slice(HOSTILE.as_bytes());
    std::fs::write(folder.join("parts.exr"), bytes).expect("written");
    let (name, why) = (format!("m::{HOSTILE}"), format!("it fails: {HOSTILE}\n{HOSTILE}"));
    let line = function(&name, "gl", "fail", Some(&why)).replace("llvmpipe", "\\u001b[2Jllvmpipe");
    write(folder, "record/1.jsonl", &line);
    write(folder, "record/run.json", r#"{"passed":false,"schema":5,"selected":["\u009b2J"]}"#);
    write(folder, "table.csv", &format!("\"{HOSTILE}\"\n1\n"));
    write(folder, "shaders/hostile.wgsl", &format!("fn f() -> f32 {{ return x; }} // {HOSTILE}\n"));
    for (arguments, told) in [
        (&["pending", "--from", "slip.zip"][..], true),
        (&["pending", "--from", "bad.zip"], true),
        (&["pending"], true),
        (&["accept", "*", "--because", HOSTILE], false),
        (&["diff", "parts.exr", "parts.exr"], true),
        (&["report", "--record", "record", "--github"], true),
        (&["unreferenced", "--record", "record"], false),
        (&["call", "calc::double", "--table", "table.csv"], true),
        (&["call", "hostile::f"], true),
    ] {
        let text = tame(folder, arguments);
        // Karat shows the names of entries as Rust's escapes do, with `\r`.
        let shown = text.contains(TURNED_SHOWN)
            || text.contains(SHOWN)
            || text.contains(&SHOWN.replace(r"\u{d}", r"\r"));
        assert!(shown || !told, "{arguments:?}: {text}");
    }
    // The reason contains pasted colour codes. Karat stores it so that it can read it again.
    let (_, facts) = Image::read_exr(&golden.join("scene.exr")).expect("accepted");
    let facts = Provenance::parse(&facts.expect("it has facts")).expect("they can be read");
    assert_eq!(facts.because, SHOWN);
    let parts = karat(folder, &["diff", "parts.exr", "parts.exr", "--json"]).good();
    assert_tame(&parts, &["diff"]);
    assert!(json(&parts).to_string().contains('\u{9b}'), "{parts}");
    // The command writes files for people and programs.
    let junit = ["report", "--record", "record", "--junit", "junit.xml"];
    let summary = folder.join("summary.md");
    let mut report = command(folder, &junit);
    report.env("GITHUB_ACTIONS", "true").env("GITHUB_STEP_SUMMARY", &summary);
    assert_eq!(output(&mut report).code, Some(1));
    for file in [summary, folder.join("junit.xml")] {
        let text = std::fs::read_to_string(&file).expect("written");
        assert_tame(&text, &junit);
        assert!(text.contains(r"\u{202e}c"), "{text}");
    }
}

/// `karat test` prints the output of tests, but escapes terminal commands other than colours.
// Lesson 62
#[cfg(unix)]
#[test]
fn escapes_in_the_output_of_tests_are_not_obeyed() {
    let project = project();
    let folder = project.path();
    write(folder, "lines.jsonl", &function("calc::double", "gl", "pass", None));
    let script = "printf '\\033]0;owned\\007 out\\n\\033[31mred\\033[0m\\n\\302\\2332J\\n\\377\\n'\n\
                  printf '\\033[2J err\\n' >&2\n\
                  mkdir -p \"$KARAT_RECORD\"\ncp lines.jsonl \"$KARAT_RECORD/1.jsonl\"\n";
    write(folder, "test", script);
    let ran = output(command(folder, &["test"]).env("CARGO", "/bin/sh"));
    for text in [&ran.out, &ran.err] {
        assert_tame(text, &["test"]);
    }
    assert!(ran.code == Some(0) && ran.out.contains("1 check, 0 failed"), "{ran:?}");
    assert!(ran.out.contains("\nred\n") && ran.err.contains(" err\n"), "colours go: {ran:?}");
}

/// If a line is longer than the screen, Karat shows the part around the error, and reports the column in the whole
/// line.
// Lesson 63
#[test]
fn a_long_line_is_cut_around_the_caret() {
    let project = project();
    let folder = project.path();
    let comment = "/*".to_owned() + &"#".repeat(1 << 20) + "*/";
    let text = format!("\n{comment} fn f() -> f32 {{ return undefined; }} {comment}\n");
    write(folder, "shaders/long.wgsl", &text);
    let place = 1 + text.lines().nth(1).expect("a line").find("undefined").expect("it is there");
    let error = karat(folder, &["call", "long::f"]).error();
    assert!(error.contains(&format!("long.wgsl:2:{place}")), "{}", &error[..error.len().min(2000)]);
    assert!(error.len() < 2000, "{} bytes", error.len());
    for line in error.lines() {
        assert!(line.chars().count() <= 130, "{line}");
    }
    let line = error.lines().find(|line| line.starts_with("2 |")).expect("the excerpt");
    assert!(line.starts_with("2 | …#") && line.ends_with("#…"), "{line}");
    assert!(line.contains("fn f() -> f32 { return undefined; }"), "{line}");
    let caret = error.lines().find(|line| line.contains('^')).expect("the caret");
    let column = |line: &str, mark: &str| {
        let at = line.find(mark).expect("it is there");
        line[..at].chars().count()
    };
    assert_eq!(column(caret, "^"), column(line, "undefined"), "{error}");
    assert!(caret.contains("^^^^^^^^^") && !caret.contains("^^^^^^^^^^"), "{caret}");
}
