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
        Self::at(folder, ".", &["shaders"])
    }

    /// Watches from a folder of the project.
    fn at(folder: TempDir, here: &str, arguments: &[&str]) -> Self {
        let arguments = [&["watch"], arguments, &["--paths", "cpu", "--lines"]].concat();
        let mut command = command(&folder.path().join(here), &arguments);
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
    // An edit that doesn't mend it leaves it without a verdict.
    watch.edit("more.wgsl", "fn more() {}\n");
    watch.until("cpu: no verdict");
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
    // Which parameter a domain belongs to is part of its test.
    let over = "import karat::expect_in_range;\n@test fn over(\n@over(0, 1)\na: f32,\n\
                b: f32) { expect_in_range(a, 0.0, 1.0); }\n";
    watch.edit("over_test.wgsl", over);
    watch.until("cpu: 3 tests pass; 1 ran");
    watch.edit(
        "over_test.wgsl",
        &over.replace("\n@over(0, 1)\na: f32,\n", "\na: f32,\n@over(0, 1)\n"),
    );
    watch.until("cpu: 1 of 3 tests fail; 1 ran");
    // A folder of modules comes, and goes.
    let shaders = watch.folder.path().join("shaders");
    let away = watch.folder.path().join("more");
    std::fs::remove_file(shaders.join("over_test.wgsl")).expect("removed");
    watch.until("cpu: 2 tests pass");
    write(
        &away.join("deep"),
        "bad_test.wgsl",
        "import karat::expect_true;\n@test fn bad() { expect_true(false); }\n",
    );
    std::fs::rename(&away, shaders.join("more")).expect("renamed");
    watch.until("cpu: 1 of 3 tests fail");
    std::fs::rename(shaders.join("more"), &away).expect("renamed");
    watch.until("cpu: 2 tests pass");
    write(
        &shaders.join("new").join("deep"),
        "bad_test.wgsl",
        "import karat::expect_true;\n@test fn bad() { expect_true(false); }\n",
    );
    watch.until("cpu: 1 of 3 tests fail");
    std::fs::remove_dir_all(shaders.join("new")).expect("removed");
    watch.until("cpu: 2 tests pass");
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
fn another_folder_in_the_place_of_the_working_directory_is_watched() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "calc.wgsl", SHADER);
    write(&shaders, "calc_test.wgsl", TESTS);
    let watch = Watching::at(folder, "shaders", &["."]);
    watch.until("cpu: 2 tests pass; 2 ran");
    // As `git checkout` of another branch may: there is no moment without a folder.
    let other = watch.folder.path().join("other");
    write(&other, "calc.wgsl", &SHADER.replace("0.5", "0.25"));
    write(&other, "calc_test.wgsl", TESTS);
    std::fs::rename(&shaders, watch.folder.path().join("away")).expect("renamed");
    std::fs::rename(&other, &shaders).expect("renamed");
    watch.until("cpu: 1 of 2 tests fail");
    watch.edit("calc.wgsl", SHADER);
    watch.until("cpu: 2 tests pass");
}

/// What a path can't judge is told, and is no verdict.
#[test]
fn a_frame_on_cpu_is_neither_passed_nor_failed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shader =
        format!("{SHADER}@fragment fn fs() -> @location(0) vec4f {{ return vec4f(0.5); }}\n");
    write(folder.path(), "shaders/calc.wgsl", &shader);
    write(folder.path(), "shaders/calc_test.wgsl", TESTS);
    let frame = "[[frame]]\nname = \"grey\"\nfragment = \"fs\"\nsize = [8, 8]\n";
    write(folder.path(), "shaders/calc.test.toml", frame);
    let once = |paths: &str| {
        karat(folder.path(), &["watch", "shaders", "--lines", "--once", "--paths", paths])
    };
    let cpu = once("cpu");
    let told = "cpu: 2 tests pass; 2 ran";
    assert!(cpu.out.contains(told), "{cpu:?}");
    assert!(cpu.out.contains("1 isn't judged here: a frame needs a driver"), "{cpu:?}");
    assert_eq!(cpu.code, Some(1), "nobody drew it: {cpu:?}");
    let red = once("cpu,vulkan");
    assert!(red.code == Some(1) && red.out.contains("vulkan: 1 of 3 tests fail"), "{red:?}");
    let accept = ["accept", "grey", "--golden", "shaders/golden", "--because", "it is grey"];
    karat(folder.path(), &accept).good();
    let green = once("cpu,vulkan").good();
    assert!(green.contains(told) && green.contains("vulkan: 3 tests pass"), "{green}");
    // A path that has frames alone to leave out makes no other one red.
    std::fs::remove_file(folder.path().join("shaders/calc_test.wgsl")).expect("it is there");
    assert!(once("cpu,vulkan").good().contains("vulkan: 1 test passes"));
}

/// What a program prints of a module may be another text after any edit.
#[cfg(unix)]
#[test]
fn an_edit_of_what_expands_modules_counts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = "cat \"$1\"\ncat more.txt\n";
    write(folder.path(), "shaders/expand.sh", script);
    write(folder.path(), "shaders/more.txt", "const GAIN = 0.5;\n");
    write(folder.path(), "shaders/karat.toml", "preprocess = [\"/bin/sh\", \"expand.sh\"]\n");
    let text = "import karat::expect_near;\nfn half(x: f32) -> f32 { return GAIN * x; }\n\
                @test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n";
    write(folder.path(), "shaders/calc.wgsl", text);
    let watch = Watching::at(folder, "shaders", &["."]);
    watch.until("cpu: 1 test passes; 1 ran");
    watch.edit("more.txt", "const GAIN = 0.25;\n");
    watch.until("cpu: 1 of 1 tests fail; 1 ran");
    watch.edit("more.txt", "const GAIN = 0.5;\n");
    watch.until("cpu: 1 test passes; 1 ran");
    watch.edit("expand.sh", &format!("{script}echo 'const OTHER = 1;'\n"));
    watch.until("cpu: 1 test passes; nothing changed in meaning");
}

#[cfg(unix)]
#[test]
fn it_ends_when_nobody_reads_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        &folder.path().join("shaders"),
        "calc_test.wgsl",
        "import karat::expect_true;\n@test fn t() { expect_true(true); }\n",
    );
    let mut command = command(folder.path(), &["watch", "shaders", "--paths", "cpu", "--lines"]);
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    let mut out = BufReader::new(child.stdout.take().expect("it is piped"));
    out.read_line(&mut String::new()).expect("its first line");
    drop(out);
    let began = Instant::now();
    let ended = |child: &mut Child| child.try_wait().expect("it can be asked").is_some();
    while !ended(&mut child) && began.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(child.kill());
    let status = child.wait().expect("it ends");
    assert!(status.success(), "it lives on: {status}");
}

/// Processes whose command line names a folder.
#[cfg(target_os = "linux")]
fn processes_of(folder: &FilePath) -> usize {
    let all = std::fs::read_dir("/proc").expect("processes");
    let lines = all.filter_map(|entry| std::fs::read(entry.ok()?.path().join("cmdline")).ok());
    let name = folder.to_string_lossy().into_owned();
    lines.filter(|line| String::from_utf8_lossy(line).contains(&name)).count()
}

#[cfg(target_os = "linux")]
#[test]
fn a_killed_watch_leaves_no_process_behind() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().canonicalize().expect("it is there").join("shaders");
    let hangs = "import karat::expect_true;\n@test fn t() {\n    var y = 0.0;\n    \
                 for (var i = 0; i < 2000000000; i++) { y += 1.0; }\n    expect_true(y > 0.0);\n}\n";
    write(&shaders, "calc_test.wgsl", hangs);
    let mut command = command(folder.path(), &["watch", "shaders", "--paths", "cpu", "--lines"]);
    command.env("KARAT_DEADLINE", "600").env("KARAT_FUEL", "4000000000");
    command.stdin(Stdio::null()).stdout(Stdio::null());
    let mut child = command.spawn().expect("it starts");
    let wait = |count: usize| {
        let began = Instant::now();
        while processes_of(&shaders) != count {
            assert!(began.elapsed() < PATIENCE, "{} processes", processes_of(&shaders));
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait(1);
    // It runs the shader by now, or is about to.
    std::thread::sleep(Duration::from_millis(500));
    child.kill().expect("it is there");
    child.wait().expect("it ends");
    wait(0);
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
