//! Tests faults that need their own process, such as hangs, missing adapters, replays and settings.

use karat::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use crate::goldens::golden_fault;

/// Runs the program `planted` with a fault, in its own process. Returns the output, and its stderr as text.
pub(crate) fn planted(fault: &[&str], environment: &[(&str, &str)]) -> (Output, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_planted"));
    for name in ["CI", "KARAT_PATHS", "KARAT_REQUIRE", "KARAT_RECORD"] {
        command.env_remove(name);
    }
    command.env("KARAT_FAILURES", "off");
    let output = command
        .args(fault)
        .envs(environment.iter().copied())
        .output()
        .expect("the planted program was built with this test");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, text)
}

// Lesson 40: arguments from storage buffers, with controls
#[test]
fn no_fault_succeeds() {
    let (output, text) = planted(&["none"], &[]);
    assert!(output.status.success(), "{text}");
}

/// If the types of a check don't fit its function, the message shows the difference, and the record has the location of
/// the function.
#[test]
fn a_signature_that_does_not_fit_is_recorded_where_it_stands() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder_name = folder.path().display().to_string();
    let (output, text) = planted(&["signature"], &[("KARAT_RECORD", &folder_name)]);
    let told = "member 1 of `Pair` is `a: f32` in the function, but `b: f32` in the test";
    assert!(!output.status.success() && text.contains(told), "{text}");
    let records = karat::unstable::record::read(folder.path()).expect("the verdict was recorded");
    let [record] = &*records else { panic!("one check, {} records", records.len()) };
    let karat::unstable::record::Subject::Function { location, .. } = &record.subject else {
        panic!("{record:?}")
    };
    assert_eq!(location, "<planted>:2:1");
}

/// The verb `is_valid`, which checks a whole package, writes a record as other verbs do.
// Lesson 184
#[test]
fn the_validity_of_a_package_is_recorded() {
    for (fault, verdict, failures) in [
        ("valid", karat::unstable::record::Verdict::Pass, 0),
        ("invalid", karat::unstable::record::Verdict::Fail, 1),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let folder_name = folder.path().display().to_string();
        let alone = [("KARAT_RECORD", &*folder_name), ("KARAT_TINT", "off")];
        let (output, text) = planted(&[fault], &alone);
        assert_eq!(output.status.success(), failures == 0, "{text}");
        let records =
            karat::unstable::record::read(folder.path()).expect("the verdict was recorded");
        let [record] = &*records else { panic!("one check, {} records", records.len()) };
        let karat::unstable::record::Subject::Function { function, check, location, .. } =
            &record.subject
        else {
            panic!("{record:?}")
        };
        assert_eq!((&**function, &**check, record.verdict), ("planted", "is_valid", verdict));
        let [path] = &*record.paths else { panic!("naga alone looks: {record:?}") };
        assert_eq!((&*path.adapter.path, path.cases, path.failures), ("naga", 1, failures));
        assert_eq!(location == "<planted>:1:31", failures > 0, "{location}");
        assert_eq!(record.message.is_some(), failures > 0, "{record:?}");
    }
}

/// If `KARAT_CASE` names no check of the program, the run fails, and the message suggests the most similar check. If
/// `KARAT_CASE` names the second check of the program, the replay passes.
// Lesson 65
#[test]
fn a_replay_of_nothing() {
    let (output, text) = planted(&["two"], &[("KARAT_CASE", "g/agrees_with/3")]);
    assert!(output.status.success() && text.contains("both agree"), "{text}");
    for case in
        ["f/agree_with/3", "h/agrees_with/3", "f/agrees_with#2/3", "f/agrees_with@uniform/3"]
    {
        let (output, text) = planted(&["two"], &[("KARAT_CASE", case)]);
        assert!(!output.status.success(), "{case}: {text}");
        assert!(
            text.contains(&format!(
                "test `main` replays nothing: KARAT_CASE={case} names none of the test's"
            )),
            "{text}"
        );
        assert!(text.contains("; did you mean `f/agrees_with`?"), "{text}");
    }
    let (output, text) = planted(&["two"], &[("KARAT_CASE", "g/agrees_with/65536")]);
    assert!(!output.status.success() && text.contains("no case with index 65536"), "{text}");
    // A case that a transformation doesn't change proves nothing about the other cases.
    for case in ["f/invariant_under/0", "f/invariant_under/1"] {
        let (output, text) = planted(&["mirrored"], &[("KARAT_CASE", case)]);
        assert!(output.status.success(), "{text}");
    }
    let (output, text) = planted(&["in_a_thread"], &[("KARAT_CASE", "g/agrees_with/3")]);
    let reason = "KARAT_CASE selects `g/agrees_with`, but `f/agrees_with` runs in a thread";
    assert!(!output.status.success() && text.contains(reason), "{text}");
    // A frame has no cases.
    let folder = tempfile::tempdir().expect("a temporary folder");
    let picture = ["golden", &folder.path().display().to_string()];
    let (output, text) = planted(&picture, &[("KARAT_CASE", "gradient/matches/0")]);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("names none of the test's checks: `frame gradient`"), "{text}");
}

/// A wrong `KARAT_CASE` also fails tests that Rust's test runner runs in threads. To show this, the test starts this
/// program again with one of its tests.
// Lesson 65
#[test]
fn a_test_that_replays_nothing() {
    let run = |case: &str| {
        let program = std::env::current_exe().expect("a test program");
        let mut command = Command::new(program);
        command
            .args(["--exact", "functions::the_unchanged_library_agrees"])
            .env("KARAT_CASE", case);
        command.env_remove("KARAT_RECORD").env("KARAT_FAILURES", "off");
        let output = command.output().expect("it runs");
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    // The test expects all cases, so it fails if only one case is replayed.
    let (passed, text) = run("fresnel::schlick/agrees_with/7");
    assert!(!passed && !text.contains("replays nothing"), "{text}");
    let (passed, text) = run("fresnel::schlik/agrees_with/7");
    assert!(!passed, "{text}");
    assert!(
        text.contains("test `functions::the_unchanged_library_agrees` replays nothing"),
        "{text}"
    );
    assert!(text.contains("; did you mean `fresnel::schlick/agrees_with`?"), "{text}");
}

/// Karat refuses environment variables with a misspelt name or a wrong value.
// Lesson 66
#[test]
fn settings_with_a_slip() {
    for (name, value, message) in [
        ("KARAT_FAILURES", "banana", "KARAT_FAILURES=banana isn't `on` or `off`"),
        ("KARAT_REQUIER", "vulkan", "did you mean `KARAT_REQUIRE`?"),
        ("KARAT_SEED", "1e9", "KARAT_SEED=1e9 isn't a number"),
        ("KARAT_TIMEOUT", "soon", "KARAT_TIMEOUT=soon isn't a number of seconds above 0"),
        ("KARAT_CASE", "id", "KARAT_CASE=id isn't a case, `function/check/index`"),
        ("KARAT_INPUT", "3f800000", "KARAT_INPUT needs KARAT_CASE"),
        ("KARAT_PATHS", "all,vulcan", "did you mean `vulkan`?"),
        ("KARAT_PATHS", "gl,gl", "KARAT_PATHS=gl,gl names `gl` twice"),
        ("KARAT_REQUIRE", "vulkan,", "there is no execution path ``"),
    ] {
        let (output, text) = planted(&["none"], &[(name, value)]);
        assert!(!output.status.success() && text.contains(message), "{name}={value}: {text}");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (passed, text) = golden_fault(folder.path(), &[(name, value)]);
        assert!(!passed && text.contains(message), "of a frame, {name}={value}: {text}");
    }
}

/// If a check fails only on the last path, Karat finds the simplest case on that path.
// Lesson 73
#[test]
fn a_fault_of_the_last_path_is_reduced_there() {
    let (output, text) = planted(&["one_path"], &[("KARAT_PATHS", "all")]);
    assert!(!output.status.success(), "{text}");
    let simplest = text.find("simplest (reduced from").expect("the worst case can be reduced");
    assert!(text[simplest..].contains("x = 1\n") && text[simplest..].contains("n = 3\n"), "{text}");
    let agree = text.matches("  all cases agree").count();
    let open =
        Path::ALL.into_iter().filter(|path| karat::unstable::path::adapter(*path).is_ok()).count();
    assert_eq!(agree, open - 1, "{text}");
}

/// The replay command runs only the failing case, with the same inputs.
// Lesson 21
// Lesson 41: replay
#[test]
fn replay() {
    let (_, text) = planted(&["too_large"], &[]);
    let line = text.lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words = line.expect("a failure says how to replay it").split(' ');
    let environment: Vec<(&str, &str)> = words.map_while(|word| word.split_once('=')).collect();
    assert!(environment.len() >= 3, "path, seed and case: {environment:?}");
    let (output, again) = planted(&["too_large"], &environment);
    assert!(!output.status.success(), "{again}");
    assert!(again.contains("1 of 1 case fails"), "{again}");
    let shown = |text: &str| {
        let titles = ["  simplest (reduced", "  worst (case"];
        let from = titles.iter().find_map(|title| text.find(title)).expect("a case is shown");
        text[from..].lines().skip(1).take(5).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(shown(&text), shown(&again));
    let (output, text) = planted(&["too_large"], &[("KARAT_CASE", "99999999")]);
    assert!(!output.status.success() && text.contains("no case with index 99999999"), "{text}");
}

/// On a machine without a usable driver, a run fails if a required path doesn't open, or if no path opens.
// Lesson 3
// Lesson 112
#[test]
fn no_adapter() {
    let hidden = [
        ("VK_DRIVER_FILES", "/dev/null"),
        ("VK_ICD_FILENAMES", "/dev/null"),
        ("KARAT_REQUIRE", "vulkan"),
    ];
    let (output, text) = planted(&["none"], &hidden);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("execution path `vulkan` is required, but unavailable"), "{text}");
    let (output, text) = planted(&["none"], &[("KARAT_ADAPTER", "no such adapter")]);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("no execution path opens on this machine"), "{text}");
    // If no driver is required and none exists, the engine runs functions, but no frames.
    let mut bare = vec![("__EGL_VENDOR_LIBRARY_FILENAMES", "/dev/null"), ("KARAT_REQUIRE", "")];
    bare.extend([hidden[0], hidden[1], ("KARAT_PATHS", "")]);
    let (_, text) = planted(&["too_large"], &bare);
    assert!(text.contains("cpu"), "{text}");
    let (output, text) = planted(&["golden", "nowhere"], &bare);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("path `cpu` draws no frames"), "{text}");
    bare.push(("KARAT_FRAMES", "off"));
    let (output, text) = planted(&["golden_or_panic"], &bare);
    assert!(output.status.success() && text.contains("0 paths"), "{text}");
    let (output, text) = planted(&["golden_or_panic"], &[("KARAT_FRAMES", "of")]);
    assert!(!output.status.success() && text.contains("did you mean `off`?"), "{text}");
    let (output, text) = planted(&["golden_or_panic"], &[]);
    assert!(!output.status.success() && text.contains("no golden"), "{text}");
    let (output, text) = planted(&["none"], &[("KARAT_PATHS", "vulcan")]);
    assert!(!output.status.success() && text.contains("did you mean `vulkan`?"), "{text}");
}

/// If a shader never ends, Karat reports the shader after `KARAT_TIMEOUT` seconds, and the process ends.
// Lesson 23
#[test]
fn an_endless_loop() {
    let open = Path::ALL.into_iter().filter(|path| karat::unstable::path::adapter(*path).is_ok());
    let open: Vec<Path> = open.collect();
    assert!(!open.is_empty(), "no execution path opens, so nothing would be checked");
    for path in open {
        let start = Instant::now();
        let environment = [("KARAT_TIMEOUT", "1.5"), ("KARAT_PATHS", path.name())];
        let (output, text) = planted(&["endless_loop"], &environment);
        assert!(!output.status.success(), "{text}");
        // On a fast driver the limit on loop iterations ends the loop, and then the engine reports the loop.
        let driver = format!("`endless` (<planted>:1:1) on path {path}");
        let by_driver = text.contains(&driver) && text.contains("did not finish within 1.5 s");
        let engine =
            "`endless` was stopped: this loop was still running after 1.5 s\n  --> <planted>:1:";
        let slow = karat::unstable::path::adapter(path)
            .is_ok_and(|adapter| adapter.family() == "llvmpipe");
        assert!(by_driver || !slow && text.contains(engine), "{text}");
        // Collecting the output has waited for the process, so the process is gone and isn't a zombie.
        assert!(start.elapsed() < Duration::from_secs(30), "on {path}: {:?}", start.elapsed());
    }
}
