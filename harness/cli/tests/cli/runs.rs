//! Tests `karat test` with a stand-in for Cargo: several runs of one project, and runs that are killed.

use std::path::PathBuf;
use std::process::Child;
use std::time::{Duration, Instant};

use super::report::function;
use super::*;

/// Waits until `what` returns `true`, for at most a minute.
#[track_caller]
fn wait_for(what: impl Fn() -> bool) {
    let begun = Instant::now();
    while !what() {
        assert!(begun.elapsed() < Duration::from_secs(60), "waited for a minute");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A project in which a script replaces `cargo test`: the script records a function that is named after the run, waits
/// until the file `go.<run>` exists, and records another function.
struct Runs {
    project: TempDir,
}

impl Runs {
    fn new() -> Self {
        let project = project();
        // `sh test --no-fail-fast ...` runs the file `test`.
        let script = "mkdir -p \"$KARAT_RECORD\"\n\
                      cp \"$RUN.1\" \"$KARAT_RECORD/$RUN-1.jsonl\"\n\
                      echo > started.$RUN\n\
                      while [ ! -e go.$RUN ]; do sleep 0.02; done\n\
                      cp \"$RUN.2\" \"$KARAT_RECORD/$RUN-2.jsonl\"\n\
                      exit $STATUS\n";
        write(project.path(), "test", script);
        Self { project }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.project.path().join(name)
    }

    /// Starts a run that records two checks, and waits until the first is recorded.
    fn start(&self, run: &str, verdict: &str) -> Child {
        for number in ["1", "2"] {
            let line = function(&format!("{run}::f{number}"), "gl", verdict, None);
            write(self.project.path(), &format!("{run}.{number}"), &line);
        }
        let mut command = command(self.project.path(), &["test", "--junit", &format!("{run}.xml")]);
        command.env("CARGO", "/bin/sh").env("RUN", run);
        command.env("STATUS", if verdict == "pass" { "0" } else { "101" });
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        wait_for(|| self.path(&format!("started.{run}")).exists());
        child.expect("the binary was built with this test")
    }

    /// Lets a run end. Returns its exit code and its output.
    fn end(&self, run: &str, child: Child) -> (Option<i32>, String) {
        write(self.project.path(), &format!("go.{run}"), "");
        let ended = child.wait_with_output().expect("it ends");
        let out = String::from_utf8_lossy(&ended.stdout);
        (ended.status.code(), out.into_owned() + &String::from_utf8_lossy(&ended.stderr))
    }

    fn whole(&self, run: &str, verdict: &str) {
        let (code, text) = self.end(run, self.start(run, verdict));
        assert_eq!(code, Some(i32::from(verdict != "pass")), "{text}");
    }

    /// Checks that `karat report` shows only the checks of the run `run`, and ends with the exit code `code`.
    #[track_caller]
    fn assert_last(&self, run: &str, code: i32) {
        let ran = karat(self.project.path(), &["report"]);
        assert_eq!(ran.code, Some(code), "{ran:?}");
        assert!(ran.out.contains("2 checks"), "all of it, and nothing else: {ran:?}");
        for number in ["1", "2"] {
            assert!(ran.out.contains(&format!("{run}::f{number} ")), "{ran:?}");
        }
    }

    fn folders(&self) -> Vec<PathBuf> {
        let record = std::fs::read_dir(self.path("target/karat/record")).expect("a folder");
        let paths = record.map(|entry| entry.expect("readable").path());
        paths.filter(|path| path.is_dir()).collect()
    }
}

// Lesson 58
#[test]
fn runs_at_the_same_time_have_records_of_their_own() {
    let runs = Runs::new();
    let slow = runs.start("slow", "fail");
    let fast = runs.start("fast", "pass");
    let (code, text) = runs.end("fast", fast);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("2 checks, 0 failed") && !text.contains("slow::"), "{text}");
    runs.assert_last("fast", 0);
    let (code, text) = runs.end("slow", slow);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("2 checks, 2 failed") && !text.contains("fast::"), "{text}");
    runs.assert_last("slow", 1);
    for (run, other) in [("fast", "slow"), ("slow", "fast")] {
        let junit = std::fs::read_to_string(runs.path(&format!("{run}.xml"))).expect("written");
        assert!(junit.contains(&format!("{run}::f2")) && !junit.contains(other), "{junit}");
    }
    assert_eq!(runs.folders().len(), 1, "the record of a run that isn't the last is removed");
}

/// Many runs start and end in mixed order.
// Lesson 58
#[test]
fn many_runs_do_not_mix() {
    let runs = Runs::new();
    let names: Vec<String> = (0..8).map(|number| format!("run{number}")).collect();
    for name in &names {
        write(runs.project.path(), &format!("go.{name}"), "");
    }
    std::thread::scope(|scope| {
        for name in &names {
            scope.spawn(|| runs.whole(name, "pass"));
        }
        // A reader sees a complete record, or no record yet.
        for _ in 0..20 {
            let ran = karat(runs.project.path(), &["report"]);
            let whole = ran.code == Some(0) && ran.out.contains("2 checks, 0 failed");
            assert!(whole || ran.code == Some(3), "{ran:?}");
        }
    });
    assert_eq!(runs.folders().len(), 1);
}

// Lesson 58
#[test]
fn a_run_that_is_killed_leaves_the_record_of_the_one_before() {
    let runs = Runs::new();
    runs.whole("before", "pass");
    let mut killed = runs.start("killed", "fail");
    killed.kill().expect("it runs");
    killed.wait().expect("it ends");
    // `karat report` shows the last run that ended. A run that began later has no verdict.
    runs.assert_last("before", 1);
    let report = karat(runs.project.path(), &["report"]).out;
    assert!(report.contains("the last run was stopped early"), "{report}");
    // While one run is live, a third run begins and ends, and deletes the files of the killed run.
    let live = runs.start("live", "pass");
    write(runs.project.path(), "go.killed", "");
    runs.whole("third", "pass");
    runs.assert_last("third", 0);
    assert_eq!(runs.folders().len(), 2, "that of the live run, and the last one");
    let (code, text) = runs.end("live", live);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("2 checks, 0 failed"), "{text}");
    runs.assert_last("live", 0);
}

/// `karat report` ignores a run that recorded nothing.
// Lesson 58
#[test]
fn a_run_without_a_check_leaves_the_record_of_the_one_before() {
    let runs = Runs::new();
    runs.whole("before", "fail");
    for number in ["1", "2"] {
        write(runs.project.path(), &format!("empty.{number}"), "");
    }
    write(runs.project.path(), "go.empty", "");
    let mut test = command(runs.project.path(), &["test"]);
    let ran = output(test.env("CARGO", "/bin/sh").env("RUN", "empty").env("STATUS", "0"));
    assert!(ran.error().contains("A run that compared nothing isn't a success"));
    runs.assert_last("before", 1);
    assert_eq!(runs.folders().len(), 1);
}

/// The output names Rust tests that pass without comparing anything. If the build fails, the error says that no test
/// ran.
#[test]
fn tests_without_a_check_and_broken_builds_are_named() {
    let project = project();
    let record = function("calc::f", "gl", "pass", None);
    write(project.path(), "record", &record);
    let script = "mkdir -p \"$KARAT_RECORD\"\n\
                  if [ -e broken ]; then echo 'error: could not compile' >&2; exit 101; fi\n\
                  cp record \"$KARAT_RECORD/1.jsonl\"\n\
                  echo 'test tests::calc ... ok'\n\
                  for name in a b c d e f g; do echo \"test silent::$name ... ok\"; done\n";
    write(project.path(), "test", script);
    let run = || output(command(project.path(), &["test"]).env("CARGO", "/bin/sh"));
    let ran = run().good();
    let told = "7 tests passed without a check: silent::a, silent::b, silent::c, silent::d, silent::e and 2 more";
    assert!(ran.contains(told), "{ran}");
    write(project.path(), "broken", "");
    let error = run().error();
    assert!(
        error.contains("no test ran: the build failed, or the test programs ended early"),
        "{error}"
    );
}
