//! Tests the reports that other programs read: JUnit XML, and GitHub's annotations and summary.

use std::time::{Duration, SystemTime};

use karat::Image;
use karat::image::Precision;
use karat::unstable::record::Run;

use super::faults::fault;
use super::pending::{pending_frame, provenance};
use super::*;

fn line(
    test: &str,
    subject: serde_json::Value,
    paths: &[&str],
    verdict: &str,
    message: Option<&str>,
) -> String {
    let failures = u32::from(verdict != "pass");
    let path = |path: &&str| {
        serde_json::json!({
            "adapter": {
                "path": path, "name": "llvmpipe (LLVM 15.0.6, 256 bits)", "driver": "", "software": true
            },
            "cases": 100, "failures": failures, "worst": "7 ulp | more", "ratio": 7.0,
            "asserted": "1 ulp", "known_issue": null
        })
    };
    let paths: Vec<_> = paths.iter().map(path).collect();
    let record = serde_json::json!({
        "schema": 5, "test": test, "subject": subject, "verdict": verdict, "paths": paths,
        "message": message, "details": message.map(fault)
    });
    format!("{record}\n")
}

/// The record of a frame that was compared with a golden in a folder.
pub(crate) fn frame(folder: &FilePath, golden: &str, paths: &[&str], verdict: &str) -> String {
    let message = (verdict != "pass").then_some("frame differs\n  by 100%");
    let subject = serde_json::json!({
        "kind": "frame", "golden": golden, "folder": folder, "location": "tests/frames.rs:7:3"
    });
    line("frames", subject, paths, verdict, message)
}

/// Returns the record of a function's check.
pub(crate) fn function(name: &str, path: &str, verdict: &str, message: Option<&str>) -> String {
    let subject = serde_json::json!({
        "kind": "function", "package": "shaders", "function": name, "check": "agrees_with",
        "assertion": "1 ulp", "location": "shaders/calc.wgsl:4:1", "seed": 1
    });
    line("tests::calc", subject, &[path], verdict, message)
}

/// Adds a start time and a duration to a record.
fn at(line: String, started: &str, seconds: &str) -> String {
    let time = format!("\"started\":\"{started}\",\"seconds\":{seconds},\"message\"");
    line.replace("\"message\"", &time)
}

/// Adds a start time, which is the current time, and a duration of 60 s to a record.
fn now(line: String) -> String {
    at(line, &humantime::format_rfc3339_millis(SystemTime::now()).to_string(), "60")
}

const MESSAGE: &str = "error: `calc::double` fails, 50%: <b>\n  worst\u{1b}[0m\n  \
                       replay: KARAT_CASE=calc::double/agrees_with/3 cargo test calc";

/// A project, and the lines of the record of its run: a function that passes, a function that fails, a frame that
/// differs from its golden, and a frame without a golden.
fn run() -> (TempDir, String) {
    let project = project();
    let golden = project.path().join("golden");
    pending_frame(&golden, "furnace/scene", "llvmpipe (LLVM 15.0.6, 256 bits)");
    karat(project.path(), &["accept", "furnace/scene", "--because", "why"]).good();
    pending_frame(&golden, "furnace/scene", "llvmpipe (LLVM 15.0.6, 256 bits)");
    write(project.path(), "tests/frames.rs", "");
    let package = project.path().join("shaders");
    let failing = function("calc::double", "gl", "fail", Some(MESSAGE));
    let lines = [
        function("calc::same", "gl", "pass", None),
        failing.replace(r#""package":"shaders""#, &format!("\"package\":{package:?}")),
        now(frame(&golden, "furnace/scene", &["vulkan"], "fail")),
        frame(&golden, "new", &[], "error"),
    ];
    (project, lines.concat())
}

fn record(project: &TempDir, lines: &str, passed: bool) {
    let folder = project.path().join("target/karat/record");
    write(&folder, "1.jsonl", lines);
    let run = Run { passed, ..Run::default() };
    run.write(&folder).expect("written");
}

fn attribute<'a>(node: roxmltree::Node<'a, '_>, name: &str) -> &'a str {
    node.attribute(name).unwrap_or_else(|| panic!("no `{name}` in {node:?}"))
}

#[test]
fn junit_has_a_case_for_each_check_and_frame() {
    let (project, lines) = run();
    record(&project, &lines, false);
    let ran = karat(project.path(), &["report", "--junit", "out/junit.xml"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains("4 checks, 3 failed"), "{ran:?}");
    let text = std::fs::read_to_string(project.path().join("out/junit.xml")).expect("written");
    let xml = roxmltree::Document::parse(&text).expect("well-formed");
    let root = xml.root_element();
    assert_eq!(root.tag_name().name(), "testsuites");
    let counts = ["tests", "failures", "errors"].map(|name| attribute(root, name));
    assert_eq!(counts, ["4", "2", "1"]);
    let cases: Vec<_> = root.descendants().filter(|node| node.has_tag_name("testcase")).collect();
    let find = |name: &str| {
        *cases
            .iter()
            .find(|case| attribute(**case, "name") == name)
            .unwrap_or_else(|| panic!("{text}"))
    };
    let double = find("calc::double agrees_with on gl");
    assert_eq!(attribute(double, "classname"), "tests::calc");
    let child = |case: roxmltree::Node<'_, '_>, name: &str| {
        let child = case.children().find(|node| node.has_tag_name(name));
        let child = child.unwrap_or_else(|| panic!("no {name} in:\n{text}"));
        (child.attribute("message").map(str::to_owned), child.text().unwrap_or_default().to_owned())
    };
    let (message, description) = child(double, "failure");
    assert_eq!(message.as_deref(), Some("`calc::double` fails, 50%: <b>"));
    assert!(description.contains("worst"), "{description}");
    let (_, out) = child(double, "system-out");
    assert!(
        out.ends_with("replay: KARAT_CASE=calc::double/agrees_with/3 cargo test calc"),
        "{out}"
    );
    child(find("frame furnace/scene on vulkan"), "failure");
    child(find("frame new"), "error");
    assert!(
        !find("calc::same agrees_with on gl").children().any(|node| node.has_tag_name("failure"))
    );
}

/// The record of a check that passes on `vulkan` and fails on `gl`. `more` contains additional members of the record's
/// JSON.
fn on_two_paths(package: &FilePath, more: &str) -> String {
    let subject = serde_json::json!({
        "kind": "function", "package": package, "function": "calc::double", "check": "agrees_with",
        "assertion": "1 ulp", "location": "shaders/calc.wgsl:4:1", "seed": 1
    });
    let message = "error: `calc::double` fails\n  replay: KARAT_PATHS=vulkan cargo test\n  \
                   replay: KARAT_PATHS=gl cargo test";
    let line = line("tests::calc", subject, &["vulkan", "gl"], "fail", Some(message));
    // The first path, Vulkan, agrees.
    let line = line.replacen("\"failures\":1", "\"failures\":0", 1);
    line.replace("\"schema\":5", &format!("\"schema\":5,{more}"))
}

fn junit(project: &TempDir, folder: &FilePath, environment: &[(&str, &FilePath)]) -> String {
    let file = project.path().join("junit.xml");
    let mut command = command(folder, &["report", "--junit"]);
    output(command.arg(&file).envs(environment.iter().copied()));
    std::fs::read_to_string(file).expect("written")
}

/// The JUnit report has a test case for each path. Only the test case of the failing path contains a failure
/// and a replay command.
// Lesson 136
#[test]
fn junit_has_a_case_for_each_path() {
    let project = project();
    let package = project.path().join("shaders");
    let of = r#""cargo_package":"pbr","seconds":3.0,"started":"2026-01-31T12:00:00.000Z""#;
    record(&project, &on_two_paths(&package, of), false);
    let text = junit(&project, project.path(), &[]);
    let xml = roxmltree::Document::parse(&text).expect("well-formed");
    let counts = ["tests", "failures"].map(|name| attribute(xml.root_element(), name));
    assert_eq!(counts, ["2", "1"], "{text}");
    let cases: Vec<_> = xml.descendants().filter(|node| node.has_tag_name("testcase")).collect();
    let seen = cases.iter().map(|case| {
        let failed = case.children().any(|node| node.has_tag_name("failure"));
        (attribute(*case, "name"), attribute(*case, "time"), failed)
    });
    let expected = [
        ("calc::double agrees_with on vulkan", "1.500", false),
        ("calc::double agrees_with on gl", "1.500", true),
    ];
    assert_eq!(seen.collect::<Vec<_>>(), expected);
    for case in &cases {
        let of = ["classname", "file", "line"].map(|name| attribute(*case, name));
        assert_eq!(of, ["pbr::tests::calc", "shaders/calc.wgsl", "4"], "{text}");
    }
    let out = cases[1].children().find(|node| node.has_tag_name("system-out"));
    let out = out.and_then(|node| node.text()).expect("what it printed");
    assert!(out.ends_with("replay: KARAT_PATHS=gl cargo test"), "{out}");
    // A known issue that no longer occurs also fails. The other path passes.
    let gone = on_two_paths(&package, of).replace("\"failures\":1", "\"failures\":0");
    let at = gone.rfind("\"known_issue\":null").expect("that of gl");
    let gone = format!("{}\"known_issue\":\"mesa#1\"{}", &gone[..at], &gone[at + 18..]);
    record(&project, &gone, false);
    let text = junit(&project, project.path(), &[]);
    assert_eq!(text.matches("<failure").count(), 1, "{text}");
    assert!(text.find("on gl").expect("gl") < text.find("<failure").expect("one"), "{text}");
}

/// CI reads paths relative to the repository's root. A project may be in a subfolder.
// Lesson 135
#[test]
fn places_are_relative_to_what_ci_checked_out() {
    let repository = tempfile::tempdir().expect("a temporary folder");
    let folder = repository.path().join("engine");
    write(&folder, "Cargo.toml", "[workspace]\n");
    write(&folder, "shaders/calc.wgsl", "\n\n\nfn double(x: f32) -> f32 { return x; }\n");
    let records = folder.join("target/karat/record");
    write(&records, "1.jsonl", &on_two_paths(&folder.join("shaders"), "\"overlay\":null"));
    let run = Run { passed: false, ..Run::default() };
    run.write(&records).expect("written");
    for (variable, value, file) in [
        ("GITHUB_WORKSPACE", repository.path(), "engine/shaders/calc.wgsl"),
        ("GITHUB_WORKSPACE", folder.as_path(), "shaders/calc.wgsl"),
        // A folder that doesn't contain the project has no effect.
        ("GITHUB_WORKSPACE", FilePath::new("/nowhere"), "shaders/calc.wgsl"),
        ("CI_PROJECT_DIR", repository.path(), "engine/shaders/calc.wgsl"),
        ("WORKSPACE", repository.path(), "engine/shaders/calc.wgsl"),
    ] {
        // The paths are also right if the command runs in a subfolder of the project.
        for here in [&folder, &folder.join("shaders")] {
            let mut command = command(here, &["report", "--github"]);
            let ran = output(command.env(variable, value));
            let start = format!("::error file={file},line=4,col=1,");
            assert!(annotations(&ran)[0].starts_with(&start), "{variable}={value:?}: {ran:?}");
            let text = junit(&repository, here, &[(variable, value)]);
            assert!(text.contains(&format!("file=\"{file}\" line=\"4\"")), "{text}");
        }
    }
}

/// A JUnit test case names its pictures, each on a line of its own. GitLab and Jenkins show these pictures.
#[test]
fn junit_names_the_pictures_of_a_frame_that_fails() {
    let (project, lines) = run();
    record(&project, &lines, false);
    let text = junit(&project, project.path(), &[("CI_PROJECT_DIR", project.path())]);
    let attached: Vec<&str> = text
        .lines()
        .filter_map(|line| {
            line.trim().strip_prefix("<system-out>").unwrap_or(line).strip_prefix("[[ATTACHMENT|")
        })
        .filter_map(|line| line.split("]]").next())
        .collect();
    let expected = ["actual", "golden", "flip"]
        .map(|name| format!("target/karat/report/furnace/scene.{name}.png"));
    assert_eq!(attached, expected, "{text}");
    for file in attached {
        Image::read(&project.path().join(file)).expect("a picture");
    }
    assert_eq!(text.matches("ATTACHMENT").count(), 3, "only of the frame that fails: {text}");
}

/// Many programs show only the first line of a failure. So this line names what fails, and doesn't name the adapter,
/// which is the same for many failures.
#[test]
fn the_first_line_of_a_failure_leaves_out_the_adapter() {
    let project = project();
    let golden = project.path().join("golden");
    let failing = |name: &str| {
        let adapter = "on vulkan: llvmpipe (LLVM 15.0.6, 256 bits)";
        let message = format!("frame `{name}` differs, 5%\n{adapter}\n  worst: pixel (2, 1)");
        let line = frame(&golden, name, &["gl", "vulkan"], "fail");
        let line =
            line.replace("\"frame differs\\n  by 100%\"", &serde_json::json!(message).to_string());
        line.replace("\"frame differs\"", &format!("\"frame `{name}` differs, 5%\""))
    };
    let lines = [failing("one"), failing("two")].concat();
    assert_eq!(lines.matches("on vulkan").count(), 2, "{lines}");
    record(&project, &lines, false);
    let ran = karat(project.path(), &["report", "--junit", "junit.xml", "--github"]);
    let text = std::fs::read_to_string(project.path().join("junit.xml")).expect("written");
    let xml = roxmltree::Document::parse(&text).expect("well-formed");
    let failures: Vec<_> = xml.descendants().filter(|node| node.has_tag_name("failure")).collect();
    let messages: Vec<_> = failures.iter().map(|node| attribute(*node, "message")).collect();
    // Each frame has one case for each path.
    let [one, two] = ["frame `one` differs, 5%", "frame `two` differs, 5%"];
    assert_eq!(messages, [one, one, two, two]);
    let whole = "frame `one` differs, 5%\non vulkan: llvmpipe (LLVM 15.0.6, 256 bits)\n  \
                 worst: pixel (2, 1)";
    assert_eq!(failures[0].text(), Some(whole));
    let annotation = "::error title=frame two::frame `two` differs, 5%25%0Aon vulkan: llvmpipe \
                      (LLVM 15.0.6, 256 bits)%0A  worst: pixel (2, 1)";
    assert_eq!(annotations(&ran)[1], annotation);
}

#[test]
fn junit_says_when_and_how_long() {
    let project = project();
    let pass = |name: &str| function(name, "gl", "pass", None);
    let scene = frame(&project.path().join("golden"), "scene", &["gl"], "pass");
    let lines = [
        at(pass("calc::double"), "2026-01-31T12:00:01.500Z", "1.25"),
        at(pass("calc::same"), "2026-01-31T12:00:00.000Z", "0.5"),
        // One record is old and has no time. One record has an invalid time.
        pass("calc::sum"),
        at(pass("calc::third"), "yesterday", "-1"),
        at(scene, "2026-01-31T12:00:02.000Z", "3.21"),
    ];
    record(&project, &lines.concat(), true);
    let out = karat(project.path(), &["report", "--junit", "junit.xml"]).good();
    assert!(
        out.contains("\nslowest: frame scene 3.2 s, calc::double agrees_with 1.2 s\n"),
        "{out}"
    );
    let text = std::fs::read_to_string(project.path().join("junit.xml")).expect("written");
    let xml = roxmltree::Document::parse(&text).expect("well-formed");
    let of = |tag: &str| {
        let nodes = xml.descendants().filter(|node| node.has_tag_name(tag));
        let times = nodes.map(|node| (node.attribute("timestamp"), node.attribute("time")));
        times.collect::<Vec<_>>()
    };
    let (first, second) = ("2026-01-31T12:00:00.000+00:00", "2026-01-31T12:00:01.500+00:00");
    let third = "2026-01-31T12:00:02.000+00:00";
    assert_eq!(of("testsuites"), [(Some(first), Some("4.960"))]);
    assert_eq!(of("testsuite"), [(Some(first), Some("1.750")), (Some(third), Some("3.210"))]);
    let cases = [
        (Some(second), Some("1.250")),
        (Some(first), Some("0.500")),
        (None, None),
        (None, None),
        (Some(third), Some("3.210")),
    ];
    assert_eq!(of("testcase"), cases);
}

#[test]
fn a_failure_outside_of_checks_is_in_junit_too() {
    let project = project();
    record(&project, &function("calc::same", "gl", "pass", None), false);
    let ran = karat(project.path(), &["report", "--junit", "junit.xml"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let text = std::fs::read_to_string(project.path().join("junit.xml")).expect("written");
    let xml = roxmltree::Document::parse(&text).expect("well-formed");
    assert_eq!(attribute(xml.root_element(), "errors"), "1", "{text}");
}

#[test]
fn github_gets_annotations_a_summary_and_pictures() {
    let (project, lines) = run();
    record(&project, &lines, false);
    write(project.path(), "summary.md", "before\n");
    let mut command = command(project.path(), &["report"]);
    command.env("GITHUB_ACTIONS", "true");
    command.env("GITHUB_STEP_SUMMARY", project.path().join("summary.md"));
    let ran = output(&mut command);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let annotations = annotations(&ran);
    assert_eq!(annotations.len(), 3, "{ran:?}");
    let start = "::error file=shaders/calc.wgsl,line=4,col=1,title=calc%3A%3Adouble agrees_with::\
                 error: `calc::double` fails, 50%25: <b>%0A  worst";
    assert!(annotations[0].starts_with(start), "{annotations:?}");
    let frame = "::error file=tests/frames.rs,line=7,col=3,title=frame furnace/scene::\
                 frame differs%0A  by 100%25";
    assert_eq!(annotations[1], frame, "{annotations:?}");
    let new = "::error file=tests/frames.rs,line=7,col=3,title=frame new::";
    assert!(annotations.iter().any(|line| line.starts_with(new)), "{annotations:?}");

    let summary = std::fs::read_to_string(project.path().join("summary.md")).expect("written");
    assert!(summary.starts_with("before\n## Karat\n\n4 checks, 3 failed"), "{summary}");
    for part in [
        "| calc::double agrees_with | gl | 100 | 1 | 7 ulp &#124; more | 700% | 1 ulp |\n",
        "| frame furnace/scene | vulkan | 100 | 1 | 7 ulp &#124; more | 700% | 1 ulp |\n",
        "| frame new | - | 0 | - | error | | |\n",
        "fails, 50%: &lt;b&gt;",
        "Replay: <code>KARAT_CASE=calc::double/agrees_with/3 cargo test calc</code>",
        "golden `report/furnace/scene.golden.png`, actual `report/furnace/scene.actual.png`, \
         flip `report/furnace/scene.flip.png`",
    ] {
        assert!(summary.contains(part), "no `{part}` in:\n{summary}");
    }
    for name in ["golden", "actual", "flip"] {
        let file = format!("target/karat/report/furnace/scene.{name}.png");
        Image::read(&project.path().join(file)).expect("a picture");
    }
    // Outside of GitHub, Karat prints annotations only on request.
    assert!(!karat(project.path(), &["report"]).out.contains("::error"));
    assert!(karat(project.path(), &["report", "--github"]).out.contains("::error"));
}

/// A report has a picture of a pending frame only if the reported run wrote this frame.
#[test]
fn pictures_are_of_the_run_that_is_reported() {
    let (project, _) = run();
    let folder = project.path();
    let (golden, pending) = (folder.join("golden"), folder.join("target/karat/pending"));
    let (now, hour) = (SystemTime::now(), Duration::from_secs(3600));
    let wait = |folder: &FilePath, width: u32, written: SystemTime| {
        let image = Image::new(width, 1, vec![[0.5, 0.5, 0.5, 1.0]; width as usize]);
        let facts = provenance("furnace/scene", &image.hash(), "llvmpipe", "");
        let facts = serde_json::to_string(&facts).expect("plain data");
        let path = folder.join("furnace/scene.new.exr");
        image.write_exr(&path, Precision::Half, Some(&facts)).expect("written");
        let file = std::fs::File::options().append(true).open(path).expect("there");
        file.set_modified(written).expect("a time");
    };
    let failing = frame(&golden, "furnace/scene", &["vulkan"], "fail");
    let started = humantime::format_rfc3339_millis(now).to_string();
    record(&project, &at(failing.clone(), &started, "5"), false);
    let picture = |name: &str| folder.join(format!("target/karat/report/furnace/scene.{name}.png"));
    let actual = || {
        for name in ["golden", "actual", "flip"] {
            write(picture(name).parent().expect("a folder"), &format!("scene.{name}.png"), "old");
        }
        write(folder, "summary.md", "");
        let mut command = command(folder, &["report", "--github"]);
        let ran = output(command.env("GITHUB_STEP_SUMMARY", folder.join("summary.md")));
        assert_eq!(ran.code, Some(1), "{ran:?}");
        let summary = std::fs::read_to_string(folder.join("summary.md")).expect("written");
        let told = summary.contains("Pictures in the artefact of this run");
        assert_eq!(told, picture("actual").exists(), "{summary}");
        let image = || Image::read(&picture("actual")).expect("a picture, and not the old text");
        picture("actual").exists().then(|| image().width())
    };
    wait(&pending, 3, now - hour);
    wait(&golden, 4, now - 2 * hour);
    assert_eq!(actual(), None, "both are of runs before");
    assert!(!picture("golden").exists() && !picture("flip").exists());
    wait(&golden, 4, now);
    assert_eq!(actual(), Some(4), "one is of this run");
    wait(&pending, 3, now + Duration::from_secs(2));
    assert_eq!(actual(), Some(3), "the newest of this run");
    wait(&pending, 3, now + hour);
    assert_eq!(actual(), Some(4), "one is of a run afterwards");
    // File times may be coarse, and an older record has no time.
    wait(&pending, 3, now - Duration::from_millis(900));
    wait(&golden, 4, now - hour);
    assert_eq!(actual(), Some(3));
    record(&project, &failing, false);
    assert_eq!(actual(), None);
    // A frame that passes needs no picture.
    record(&project, &frame(&golden, "furnace/scene", &["vulkan"], "pass"), true);
    write(picture("actual").parent().expect("a folder"), "scene.actual.png", "old");
    karat(folder, &["report", "--github"]).good();
    assert!(!picture("actual").exists());
}

/// The lines that GitHub's runner reads as errors. Checks that `::error` occurs nowhere else: neither inside of a line
/// nor on stderr.
#[track_caller]
fn annotations(ran: &Ran) -> Vec<&str> {
    let lines: Vec<&str> = ran.out.lines().filter(|line| line.starts_with("::error ")).collect();
    assert_eq!(ran.out.matches("::error ").count(), lines.len(), "{ran:?}");
    assert!(!ran.err.contains("::error "), "{ran:?}");
    lines
}

#[test]
fn github_shows_ten_annotations_and_the_last_names_the_rest() {
    let project = project();
    let failing = |count: u32| {
        let line = |index| function(&format!("calc::f{index:02}"), "gl", "fail", Some(MESSAGE));
        let lines: String = (0..count).map(line).collect();
        record(&project, &lines, false);
        karat(project.path(), &["report", "--github"])
    };
    let ran = failing(10);
    let shown = annotations(&ran);
    assert_eq!(shown.len(), 10);
    assert!(shown[9].contains("title=calc%3A%3Af09 agrees_with::error: "), "{shown:?}");
    let ran = failing(12);
    let shown = annotations(&ran);
    assert_eq!(shown.len(), 10);
    assert!(shown[8].contains("title=calc%3A%3Af08 agrees_with::error: "), "{shown:?}");
    let rest = "::error title=3 more checks failed::the log has the messages of these checks:%0A\
                calc::f09 agrees_with%0Acalc::f10 agrees_with%0Acalc::f11 agrees_with";
    assert_eq!(shown[9], rest);
}

#[test]
fn a_long_annotation_keeps_its_replay_command() {
    let project = project();
    let message = MESSAGE.replace("worst", &"100% off\n  ".repeat(1000));
    record(&project, &function("calc::double", "gl", "fail", Some(&message)), false);
    let ran = karat(project.path(), &["report", "--github"]);
    let shown = annotations(&ran);
    let message = shown[0].split_once("agrees_with::").expect("a message").1;
    let message = message.replace("%0A", "\n").replace("%25", "%");
    assert_eq!(message.encode_utf16().count(), 4096);
    let end = "\n  ... (the rest is in the log)\n  \
               replay: KARAT_CASE=calc::double/agrees_with/3 cargo test calc";
    assert!(message.ends_with(end), "{message}");
}

#[test]
fn a_failure_outside_of_checks_is_annotated_too() {
    let project = project();
    let lines = function("calc::same", "gl", "pass", None);
    record(&project, &lines, false);
    let ran = karat(project.path(), &["report", "--github"]);
    let outside = "::error title=karat::a test failed outside of Karat's checks";
    assert_eq!(annotations(&ran), [outside]);
    record(&project, &lines, true);
    assert!(annotations(&karat(project.path(), &["report", "--github"])).is_empty());
}

/// With `--short`, each failure is one line with its file, its line, and a count of failing cases. For a sampler, the
/// line counts configurations.
#[test]
fn a_short_line_counts_what_fails() {
    let project = project();
    let case = function("calc::double", "gl", "fail", Some(MESSAGE));
    let sampler = function("calc::same", "gl", "fail", None)
        .replace(r#""cases":100"#, r#""cases":524288,"configurations":8"#)
        .replace("7 ulp | more", "p 1.0e-9");
    assert!(sampler.contains("configurations"), "{sampler}");
    record(&project, &(case + &sampler), false);
    let ran = karat(project.path(), &["report", "--short"]);
    let expected = "shaders/calc.wgsl:4:1: error: `calc::double` fails agrees_with: 7 ulp | more (1 ulp) on gl, \
                    1 of 100 cases\n\
                    shaders/calc.wgsl:4:1: error: `calc::same` fails agrees_with: p 1.0e-9 (1 ulp) on gl, \
                    1 of 8 configurations\n\
                    2 checks, 2 failed\n";
    assert_eq!((ran.code, &*ran.out), (Some(1), expected), "{}", ran.err);
    let summary = project.path().join("summary.md");
    let mut github = command(project.path(), &["report", "--github"]);
    output(github.env("GITHUB_STEP_SUMMARY", &summary));
    let summary = std::fs::read_to_string(summary).expect("written");
    assert!(summary.contains("| 524288 | 1 configuration |"), "{summary}");
}

/// The report also counts Rust tests that fail outside of Karat's checks.
#[cfg(unix)]
#[test]
fn tests_that_fail_outside_of_checks_are_counted() {
    let project = project();
    let folder = project.path();
    let lines = function("calc::double", "gl", "fail", Some(MESSAGE));
    write(folder, "lines.jsonl", &lines);
    let script = "mkdir -p \"$KARAT_RECORD\"\ncp lines.jsonl \"$KARAT_RECORD/1.jsonl\"\n\
                  echo 'test tests::calc ... FAILED'\n[ -z \"$MORE\" ] || echo 'test plain ... FAILED'\nexit 101\n";
    write(folder, "test", script);
    let run = |arguments: &[&str], more: &str| {
        let mut command = command(folder, &[&["test"], arguments].concat());
        output(command.env("CARGO", "/bin/sh").env("MORE", more))
    };
    let told = "1 test failed outside of Karat's checks: plain";
    let both = run(&[], "yes");
    assert!(both.out.contains("1 check, 1 failed") && both.out.contains(told), "{both:?}");
    let short = run(&["--short"], "yes");
    let end = format!(
        "{told}; 1 check, 1 failed; Tint wasn't asked: KARAT_TINT=off; to see the message, run without --short\n"
    );
    assert!(short.out.ends_with(&end), "{short:?}");
    let by_check = run(&[], "");
    assert!(by_check.code == Some(1) && !by_check.out.contains("outside"), "{by_check:?}");
}

/// A filter finds functions in the record of earlier runs. New Rust tests aren't in this record, so the filter finds
/// them only by their names, and the output says so.
#[cfg(unix)]
#[test]
fn a_filter_that_cannot_find_new_rust_tests_says_so() {
    let project = project();
    let folder = project.path();
    write(folder, "lines.jsonl", &function("calc::double", "gl", "pass", None));
    let script = "mkdir -p \"$KARAT_RECORD\"\ncp lines.jsonl \"$KARAT_RECORD/1.jsonl\"\necho 'test tests::calc ... ok'\n";
    write(folder, "test", script);
    let run = |arguments: &[&str]| {
        output(command(folder, &[&["test"], arguments].concat()).env("CARGO", "/bin/sh")).good()
    };
    let told = "the filter finds a new Rust test only by its name";
    assert!(run(&["double"]).contains(told), "nothing has ever run whole");
    assert!(!run(&[]).contains(told));
    assert!(run(&["double"]).contains(told));
    assert!(!run(&["tests::calc"]).contains(told), "it is the name of a test");
    assert!(!run(&["tests::calc", "--exact"]).contains(told));
}

#[test]
fn a_report_needs_a_record() {
    let project = project();
    let error = karat(project.path(), &["report"]).failure(3);
    assert!(error.contains("there is no record of a run"), "{error}");
    record(&project, "", true);
    let error = karat(project.path(), &["report"]).error();
    assert!(error.contains("A run that compared nothing isn't a success"), "{error}");
}

/// Runs `karat test` with a script in place of Cargo. The script copies given lines into the record.
#[cfg(unix)]
#[test]
fn a_run_says_what_it_left_out_and_writes_its_reports() {
    let (project, lines) = run();
    let folder = project.path();
    write(folder, "lines.jsonl", &lines);
    // `sh test --no-fail-fast ...` runs the file `test`.
    let script =
        "mkdir -p \"$KARAT_RECORD\"\ncp lines.jsonl \"$KARAT_RECORD/1.jsonl\"\nexit $STATUS\n";
    write(folder, "test", script);
    let test = |arguments: &[&str], status: &str| {
        let mut command = command(folder, &[&["test"], arguments].concat());
        output(command.env("CARGO", "/bin/sh").env("STATUS", status))
    };
    let read = || {
        let run = Run::read(&folder.join("target/karat/record")).expect("readable");
        run.expect("a run says how it was made")
    };
    let ran = test(&["--junit", "junit.xml", "--github"], "1");
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(annotations(&ran)[0].starts_with("::error file=shaders/calc.wgsl"), "{ran:?}");
    assert!(folder.join("junit.xml").is_file());
    assert_eq!((read().selected.len(), read().passed), (0, false));

    write(folder, "lines.jsonl", &function("calc::same", "gl", "pass", None));
    assert_eq!(test(&[], "0").code, Some(0));
    assert_eq!((read().selected.len(), read().passed), (0, true));
    assert_eq!(test(&["same", "-p", "a", "--test", "b"], "0").code, Some(0));
    assert_eq!(read().selected, ["same", "-p a", "--test b"]);
    // If a run records nothing, Karat deletes the report of an earlier run.
    write(folder, "lines.jsonl", "");
    assert_eq!(test(&["--junit", "junit.xml"], "101").code, Some(2));
    assert!(!folder.join("junit.xml").exists());
}

/// If one test makes several checks with one verb, each check has a test case with a distinct name: many programs show
/// only the first test case of a name.
// Lesson 182
#[test]
fn junit_has_no_two_cases_of_one_name() {
    let project = project();
    let check = function("calc::same", "gl", "pass", None).replace("agrees_with", "satisfies");
    record(&project, &check.repeat(3), true);
    let text = junit(&project, project.path(), &[]);
    let xml = roxmltree::Document::parse(&text).expect("well-formed");
    let cases = xml.descendants().filter(|node| node.has_tag_name("testcase"));
    let names: Vec<&str> = cases.map(|case| attribute(case, "name")).collect();
    let own = "calc::same satisfies on gl";
    assert_eq!(names, [own.to_owned(), format!("{own} #2"), format!("{own} #3")]);
}

/// The last line of each command, its exit code and its files agree about the result of the run.
// Lesson 183
#[test]
fn no_closing_line_contradicts_its_run() {
    let project = project();
    let folder = project.path().join("target/karat/record");
    let pass = function("calc::same", "gl", "pass", None);
    let known = function("calc::double", "gl", "known_issue", None);
    let names = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
    for (lines, run, line) in [
        (pass.clone() + &known, Run::default(), "2 checks, 0 failed, 1 known issue"),
        (
            pass.clone() + &known,
            Run { invalid: names(&["a::b"]), passed: false, ..Run::default() },
            "1 module isn't valid: a::b; 1 check passed, 1 known issue",
        ),
        (
            String::new(),
            Run { failed: names(&["other"]), passed: false, ..Run::default() },
            "1 test failed outside of Karat's checks: other; no check ran",
        ),
        (
            pass.clone(),
            Run { not_run: 7, passed: false, ..Run::default() },
            "7 tests didn't run because another test failed: run with --no-fail-fast; 1 check passed",
        ),
    ] {
        write(&folder, "1.jsonl", &lines);
        run.write(&folder).expect("written");
        let good = run.passed;
        let ran = karat(project.path(), &["report", "--junit", "r.xml", "--html", "r.html"]);
        assert_eq!(ran.code, Some(i32::from(!good)), "{ran:?}");
        assert!(ran.out.contains(line), "{ran:?}");
        assert_eq!(ran.out.contains(" 0 failed"), good, "{ran:?}");
        let short = karat(project.path(), &["report", "--short"]);
        assert_eq!(short.code, Some(i32::from(!good)), "{short:?}");
        assert!(short.out.lines().any(|found| found.starts_with(line)), "{short:?}");
        let read = |file| std::fs::read_to_string(project.path().join(file)).expect("written");
        let page = read("r.html");
        assert_eq!(page.contains(">passed</h1>"), good, "{page}");
        assert!(page.contains(&line.replace('\'', "&#39;")) || page.contains(line), "{page}");
        let xml = read("r.xml");
        let xml = roxmltree::Document::parse(&xml).expect("well-formed");
        assert_eq!(attribute(xml.root_element(), "errors") == "0", good, "{line}");
        let summary = project.path().join("summary.md");
        let mut github = command(project.path(), &["report", "--github"]);
        let ran = output(github.env("GITHUB_STEP_SUMMARY", &summary));
        assert_eq!(annotations(&ran).is_empty(), good, "{ran:?}");
        let summary = std::fs::read_to_string(summary).expect("written");
        assert!(summary.contains(&format!("{line}.")), "{summary}");
        drop(std::fs::remove_file(project.path().join("summary.md")));
    }
}

/// If a runner stops at the first failure, the report says that tests are missing. If this run is
/// merged with other runs, the merged report says the same.
// Lesson 183
#[cfg(unix)]
#[test]
fn a_run_and_a_merge_that_lack_checks_say_so() {
    let project = project();
    let folder = project.path();
    let part = |name: &str, verdict: &str, words: &str| {
        let lines = function(&format!("calc::{name}"), "gl", verdict, Some("error: it fails"));
        write(folder, &format!("{name}.jsonl"), &lines);
        let script = format!(
            "mkdir -p \"$KARAT_RECORD\"\ncp {name}.jsonl \"$KARAT_RECORD/1.jsonl\"\n\
             echo '{words}' >&2\n[ {verdict} = pass ]\n"
        );
        write(folder, &format!("{name}.sh"), &script);
        let script = format!("{name}.sh");
        let arguments = ["record", "--into", name, "--", "/bin/sh", &script];
        karat(folder, &arguments)
    };
    let words = "warning: 4/5 tests were not run due to test failure (run with --no-fail-fast ..)";
    let stopped = part("a", "fail", words);
    let told = "4 tests didn't run because another test failed: run with --no-fail-fast; 1 check, 1 failed";
    assert!(stopped.code == Some(1) && stopped.out.contains(told), "{stopped:?}");
    part("b", "pass", "");
    let cargo = part("c", "fail", "error: test failed, to rerun pass `--lib`");
    assert!(cargo.out.contains("the runner stopped at a failure"), "{cargo:?}");
    let whole = karat(folder, &["report", "--merge", "a", "b", "c"]);
    assert_eq!(whole.code, Some(1), "{whole:?}");
    for told in [
        "`a` has 1 check, and lacks 4 tests that didn't run after a failure (run with --no-fail-fast); ",
        "; `c` has 1 check, and may lack other checks, because its runner stopped at a failure (run with --no-fail-fast); ",
        "; 3 checks, 2 failed",
    ] {
        assert!(whole.out.contains(told), "no `{told}` in {}", whole.out);
    }
    let good = karat(folder, &["report", "--merge", "b"]).good();
    assert!(good.contains("1 check, 0 failed") && !good.contains("lack"), "{good}");
}

/// The JSON of a record has all details of a failure, so a program doesn't need to parse the record's message.
#[test]
fn a_failure_record_is_complete_without_its_messages() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", "fn half(x: f32) -> f32 { return 0.6 * x; }\n");
    let declared = "[[test]]\nfunction = \"half\"\nover = { x = \"1..2\" }\nin_range = [0, 1]\n";
    write(folder.path(), "m.test.toml", declared);
    let test = "import package::m::half;\nimport karat::expect_near;\n\
                @test fn halves(@over(1, 2) x: f32) {\n    expect_near(half(x), 0.5 * x, 1e-3);\n    \
                expect_near(half(x), x, 1e-3);\n}\n";
    write(folder.path(), "m_test.wgsl", test);
    let test =
        |more: &[&str]| karat(folder.path(), &[&["test", ".", "--paths", "cpu"], more].concat());
    assert_eq!(test(&[]).code, Some(1));
    let record = folder.path().join(".karat/run/record");
    for run in std::fs::read_dir(&record).expect("a record").map(|run| run.expect("a run").path()) {
        if !run.is_dir() {
            continue;
        }
        for file in std::fs::read_dir(run).expect("a run").map(|file| file.expect("a file").path())
        {
            if file.extension().is_none_or(|kind| kind != "jsonl") {
                continue;
            }
            let text = std::fs::read_to_string(&file).expect("records");
            let worded = text.lines().map(|line| {
                let mut record: serde_json::Value = serde_json::from_str(line).expect("a record");
                record["message"] = "word".into();
                format!("{record}\n")
            });
            std::fs::write(&file, worded.collect::<String>()).expect("written");
        }
    }
    let report = |arguments: &[&str]| {
        let ran = karat(folder.path(), &[&["report"], arguments].concat());
        assert!(!ran.out.contains("expected 0.5 within 0.001\n   "), "no message: {}", ran.out);
        ran.out
    };
    let all = |text: &str, parts: &[&str]| {
        for part in parts {
            assert!(text.contains(part), "no `{part}` in {text}");
        }
    };
    let replay = "KARAT_CASE=m_test::halves/expects/0 karat test . --exact m_test::halves";
    let seen = "`expect_near(half(x), x, 1e-3)` saw 0.6, expected 1 within 0.001";
    let range = "doesn't hold (lies in 0..=1) on cpu";
    let short = report(&["--short"]);
    all(&short, &["m.wgsl:1:1: error: ", range, "m_test.wgsl:4:5: error: "]);
    all(&short, &[&format!("m_test.wgsl:5:5: error: {seen}")]);
    let github = report(&["--github"]);
    let at =
        |line: u32| format!("::error file=m_test.wgsl,line={line},col=5,title=m_test%3A%3Ahalves");
    all(&github, &["::error file=m.wgsl,line=1,col=1,", &at(4), &at(5), seen, replay]);
    report(&["--junit", "junit.xml", "--html", "report.html"]);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("written");
    let junit = read("junit.xml");
    all(&junit, &["file=\"m.wgsl\" line=\"1\"", "x = 2; returned = 1.2", seen, "x = 1", replay]);
    all(&junit, &["message=\"`m_test::halves` fails expects: all its expectations hold\""]);
    let html = read("report.html");
    all(&html, &["m.wgsl:1:1", replay, "Copy the replay command", "x = 2; returned = 1.2", seen]);
    let names = report(&[]);
    let names = names.lines().filter_map(|line| line.strip_prefix("karat replay "));
    let names: Vec<&str> = names.filter_map(|line| line.split(' ').next()).collect();
    let commands =
        names.iter().map(|name| karat(folder.path(), &["replay", name, "--print"]).good());
    all(&commands.collect::<String>(), &[replay, "KARAT_CASE=m::half/stays_within/1 karat test ."]);
    let again = test(&["--failed"]);
    assert!(again.code == Some(1) && again.out.contains("2 checks, 2 failed"), "{again:?}");
}
