//! `karat watch`: verdicts after each edit.

use std::io::{BufRead, BufReader};
use std::process::Child;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use super::*;

const SHADER: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n";

const TESTS: &str = "import package::calc::half;\nimport karat::{expect_near, expect_true};\n\
@test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n\
@test fn other() { expect_true(true); }\n";

/// Far more than anything here takes, on a machine that is busy with other tests.
const PATIENCE: Duration = Duration::from_secs(60);

struct Watching {
    child: Child,
    lines: Receiver<String>,
    folder: TempDir,
}

impl Watching {
    fn start() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let shaders = folder.path().join("shaders");
        write(&shaders, "calc.wgsl", SHADER);
        write(&shaders, "calc_test.wgsl", TESTS);
        let mut command =
            command(folder.path(), &["watch", "shaders", "--paths", "cpu", "--lines"]);
        command.env("KARAT_DEADLINE", "1").stdin(Stdio::null()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("it starts");
        let out = child.stdout.take().expect("it is piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Self { child, lines, folder }
    }

    /// Waits for a line, and returns all up to it.
    #[track_caller]
    fn until(&self, part: &str) -> String {
        let (began, mut all) = (Instant::now(), String::new());
        while let Some(left) = PATIENCE.checked_sub(began.elapsed()) {
            let Ok(line) = self.lines.recv_timeout(left) else { break };
            all += &line;
            all.push('\n');
            if line.contains(part) {
                return all;
            }
        }
        panic!("no `{part}` in:\n{all}");
    }

    fn edit(&self, file: &str, text: &str) {
        // As editors do: a new file takes the place of the old one.
        let shaders = self.folder.path().join("shaders");
        write(&shaders, "saved.tmp", text);
        std::fs::rename(shaders.join("saved.tmp"), shaders.join(file)).expect("renamed");
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

#[test]
fn verdicts_follow_edits() {
    let watch = Watching::start();
    watch.until("cpu: 2 tests pass; 2 ran");
    watch.edit("calc.wgsl", &SHADER.replace("0.5", "0.25"));
    let red = watch.until("cpu: 1 of 2 tests fail; 1 ran");
    for part in [
        "changed: calc.wgsl",
        "FAILED calc_test::halves on cpu",
        "calc_test.wgsl:3:21: `expect_near(half(3.0), 1.5, 0.0)` saw 0.75, expected 1.5",
    ] {
        assert!(red.contains(part), "no `{part}` in {red}");
    }
    watch.edit("calc.wgsl", SHADER);
    watch.until("cpu: 2 tests pass; 1 ran");
    watch.edit("calc.wgsl", &format!("// a comment\n{SHADER}"));
    watch.until("cpu: 2 tests pass; nothing changed in meaning");
    // Syntax that is broken is told with its place, and mended.
    watch.edit("calc.wgsl", "fn half(x: f32) -> f32 { return 0.5 * ; }\n");
    let broken = watch.until("cpu: no verdict");
    let told = watch.until("calc.wgsl:1:39");
    assert!(broken.contains("changed: calc.wgsl"), "{broken}{told}");
    watch.edit("calc.wgsl", SHADER);
    watch.until("cpu: 2 tests pass");
    // A shader that hangs is ended, and the next edit has its verdict.
    let hangs = "fn half(x: f32) -> f32 {\n    var y = x;\n    \
                 for (var i = 0; i < 2000000000; i++) { y += 1.0; }\n    return y;\n}\n";
    watch.edit("calc.wgsl", hangs);
    let slow = watch.until("cpu: 1 of 2 tests fail");
    assert!(slow.contains("was stopped: ") && slow.contains("calc.wgsl:3:5"), "{slow}");
    watch.edit("calc.wgsl", SHADER);
    watch.until("cpu: 2 tests pass; 1 ran");
    // A test that goes is forgotten, one that comes runs.
    watch.edit("calc_test.wgsl", &TESTS.replace("@test fn other", "@test fn third"));
    watch.until("cpu: 2 tests pass; 1 ran");
    // The folder goes and comes back.
    let (here, there) = (watch.folder.path().join("shaders"), watch.folder.path().join("away"));
    std::fs::rename(&here, &there).expect("renamed");
    watch.until("cpu: no verdict");
    std::fs::rename(&there, &here).expect("renamed");
    watch.until("cpu: 2 tests pass");
    watch.edit("calc.wgsl", &SHADER.replace("0.5", "0.75"));
    watch.until("cpu: 1 of 2 tests fail");
}

#[test]
fn what_cannot_be_watched_is_an_error() {
    let folder = project();
    for (arguments, part) in [
        (&["nowhere"][..], "there is no folder or file `nowhere`"),
        (&["shaders", "--paths", "vulcan"], "did you mean `vulkan`"),
    ] {
        let error = karat(folder.path(), &[&["watch"], arguments].concat()).error();
        assert!(error.contains(part), "{error}");
    }
    // A folder without a test has no verdict.
    let ran = karat(folder.path(), &["watch", "shaders", "--paths", "cpu", "--once"]);
    assert!(ran.out.contains("there are no tests"), "{ran:?}");
    assert_eq!(ran.code, Some(1), "{ran:?}");
}
