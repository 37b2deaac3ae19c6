//! Tests that `karat watch` prints verdicts after each edit.

use std::io::{BufRead, BufReader};
use std::process::Child;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use karat::Image;
use karat::image::Precision;

use super::*;

const SHADER: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n";

const TESTS: &str = "import package::calc::half;\nimport karat::{expect_near, expect_true};\n\
@test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n\
@test fn other() { expect_true(true); }\n";

/// A limit far longer than any step takes, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

pub(crate) struct Watching {
    child: Child,
    lines: Receiver<String>,
    /// The watched folder, if this value owns it.
    folder: Option<TempDir>,
}

impl Watching {
    fn start() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let shaders = folder.path().join("shaders");
        write(&shaders, "calc.wgsl", SHADER);
        write(&shaders, "calc_test.wgsl", TESTS);
        Self::at(folder, ".", &["shaders"])
    }

    /// Starts watching in a folder of the project.
    fn at(folder: TempDir, here: &str, arguments: &[&str]) -> Self {
        let mut watching = Self::of(&folder.path().join(here), arguments, |_| {});
        watching.folder = Some(folder);
        watching
    }

    /// Starts watching in a folder. `more` may change the command before it starts.
    pub(crate) fn of(here: &FilePath, arguments: &[&str], more: impl Fn(&mut Command)) -> Self {
        let arguments = [&["watch"], arguments, &["--paths", "cpu", "--lines"]].concat();
        let mut command = command(here, &arguments);
        command.env("KARAT_TIMEOUT", "1").stdin(Stdio::null()).stdout(Stdio::piped());
        more(&mut command);
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
        Self { child, lines, folder: None }
    }

    fn folder(&self) -> &FilePath {
        self.folder.as_ref().expect("it is its own").path()
    }

    /// Waits for a line that contains `part`, and returns all lines up to it.
    #[track_caller]
    pub(crate) fn until(&self, part: &str) -> String {
        self.until_any(part, &[""])
    }

    /// Waits for a line in which one of `words` follows `part`.
    #[track_caller]
    pub(crate) fn until_any(&self, part: &str, words: &[&str]) -> String {
        let (began, mut all) = (Instant::now(), String::new());
        while let Some(left) = PATIENCE.checked_sub(began.elapsed()) {
            let Ok(line) = self.lines.recv_timeout(left) else { break };
            all += &line;
            all.push('\n');
            if line.contains(part) && words.iter().any(|word| line.contains(word)) {
                return all;
            }
        }
        panic!("no `{part}` with one of {words:?} in:\n{all}");
    }

    fn edit(&self, file: &str, text: &str) {
        // Replaces the file by a new file, as editors do.
        let shaders = self.folder().join("shaders");
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

// Lesson 101
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
    watch.until("cpu: 2 tests pass; no code changed");
    // A syntax error is reported with its line, and an edit fixes it.
    watch.edit("calc.wgsl", "fn half(x: f32) -> f32 { return 0.5 * ; }\n");
    let broken = watch.until("cpu: no verdict");
    let told = watch.until("calc.wgsl:1:39");
    assert!(broken.contains("changed: calc.wgsl"), "{broken}{told}");
    // After an edit of another file, the module still has no verdict.
    watch.edit("more.wgsl", "fn more() {}\n");
    watch.until("cpu: no verdict");
    watch.edit("calc.wgsl", SHADER);
    watch.until("cpu: 2 tests pass");
    // Karat ends a shader that hangs, and the next edit gets its verdict.
    let hangs = "fn half(x: f32) -> f32 {\n    var y = x;\n    \
                 for (var i = 0; i < 2000000000; i++) { y += 1.0; }\n    return y;\n}\n";
    watch.edit("calc.wgsl", hangs);
    let slow = watch.until("cpu: 1 of 2 tests fail");
    assert!(slow.contains("was stopped: ") && slow.contains("calc.wgsl:3:5"), "{slow}");
    watch.edit("calc.wgsl", SHADER);
    watch.until("cpu: 2 tests pass; 1 ran");
    // The position of a domain's attribute is part of the test.
    let over = "import karat::expect_in_range;\n@test fn over(\n@over(0, 1)\na: f32,\n\
                b: f32) { expect_in_range(a, 0.0, 1.0); }\n";
    watch.edit("over_test.wgsl", over);
    watch.until("cpu: 3 tests pass; 1 ran");
    watch.edit(
        "over_test.wgsl",
        &over.replace("\n@over(0, 1)\na: f32,\n", "\na: f32,\n@over(0, 1)\n"),
    );
    watch.until("cpu: 1 of 3 tests fail; 1 ran");
    // A folder of modules appears, and disappears.
    let shaders = watch.folder().join("shaders");
    let away = watch.folder().join("more");
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
    // A deleted test is forgotten, and a new test runs.
    watch.edit("calc_test.wgsl", &TESTS.replace("@test fn other", "@test fn third"));
    watch.until("cpu: 2 tests pass; 1 ran");
    // The folder disappears and appears again.
    let (here, there) = (watch.folder().join("shaders"), watch.folder().join("away"));
    std::fs::rename(&here, &there).expect("renamed");
    watch.until("cpu: no verdict");
    std::fs::rename(&there, &here).expect("renamed");
    watch.until("cpu: 2 tests pass");
    watch.edit("calc.wgsl", &SHADER.replace("0.5", "0.75"));
    watch.until("cpu: 1 of 2 tests fail");
}

// Lesson 101
#[test]
fn another_folder_in_the_place_of_the_working_directory_is_watched() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "calc.wgsl", SHADER);
    write(&shaders, "calc_test.wgsl", TESTS);
    let watch = Watching::at(folder, "shaders", &["."]);
    watch.until("cpu: 2 tests pass; 2 ran");
    // As in `git checkout` of another branch, the folder exists all the time.
    let other = watch.folder().join("other");
    write(&other, "calc.wgsl", &SHADER.replace("0.5", "0.25"));
    write(&other, "calc_test.wgsl", TESTS);
    std::fs::rename(&shaders, watch.folder().join("away")).expect("renamed");
    std::fs::rename(&other, &shaders).expect("renamed");
    watch.until("cpu: 1 of 2 tests fail");
    watch.edit("calc.wgsl", SHADER);
    watch.until("cpu: 2 tests pass");
}

/// If a test can't run on a path, the test neither passes nor fails there, and Karat says so.
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
    assert!(cpu.out.contains("1 frame isn't judged: frames need a driver"), "{cpu:?}");
    assert_eq!(cpu.code, Some(1), "nobody drew it: {cpu:?}");
    let red = once("cpu,vulkan");
    assert!(red.code == Some(1) && red.out.contains("vulkan: 1 of 3 tests fail"), "{red:?}");
    let accept = ["accept", "grey", "--goldens", "shaders/golden", "--any-adapter"];
    karat(folder.path(), &[&accept[..], &["--because", "it is grey"]].concat()).good();
    let green = once("cpu,vulkan").good();
    assert!(green.contains(told) && green.contains("vulkan: 3 tests pass"), "{green}");
    // A path that only leaves out frames doesn't make the run fail.
    std::fs::remove_file(folder.path().join("shaders/calc_test.wgsl")).expect("it is there");
    assert!(once("cpu,vulkan").good().contains("vulkan: 1 test passes"));
}

/// A program that expands modules may read any file, so `karat watch` runs this program again after each edit.
#[cfg(unix)]
#[test]
fn watch_reruns_after_an_edit_of_the_preprocessor_or_its_files() {
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
    watch.until("cpu: 1 test passes; no code changed");
}

/// Karat watches every file that a test reads, whatever its extension, and packages outside of the folder.
// Lesson 192
#[test]
fn an_edit_of_any_file_that_is_read_counts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    write(path, "noise/value.wgsl", "fn quarter(x: f32) -> f32 { return 0.25 * x; }\n");
    write(path, "shaders/karat.toml", "[dependencies]\nnoise = { path = \"../noise\" }\n");
    let own = "import noise::value::quarter;\n\
               @group(0) @binding(0) var image: texture_2d<f32>;\n\
               @group(0) @binding(1) var<uniform> gain: f32;\n\
               fn half(x: f32) -> f32 { return 2.0 * quarter(x); }\n\
               fn red(x: f32) -> f32 { return gain * x * textureLoad(image, vec2u(), 0).x; }\n";
    write(path, "shaders/calc.wgsl", own);
    let tables = ["rows.tsv", "ROWS.CSV", "rows.dat", "rows"];
    let table = |name: &str| {
        format!(
            "[[test]]\nname = \"{name}\"\nfunction = \"half\"\ntable = \"{name}\"\ntolerance = \"exact\"\n"
        )
    };
    let declared: String = tables.iter().map(|name| table(name)).collect();
    let bound = "[[test]]\nfunction = \"red\"\nover = { x = 1 }\nequals = 2\ntolerance = \"exact\"\n\
                 with = { image = \"white\", gain = \"gain.json\" }\n";
    write(path, "shaders/calc.test.toml", &(declared + bound));
    const ROWS: &str = "x,result\n2,1\n";
    for name in tables {
        write(path, &format!("shaders/{name}"), ROWS);
    }
    let place = path.to_owned();
    let image = |value: f32| {
        let image = Image::new(1, 1, vec![[value, value, value, 1.0]]);
        image.write_exr(&place.join("image.exr"), Precision::Float, None).expect("written");
        std::fs::read(place.join("image.exr")).expect("it is there")
    };
    let (white, grey) = (image(1.0), image(0.5));
    std::fs::write(path.join("shaders/white"), &white).expect("written");
    write(path, "shaders/gain.json", "2");
    let watch = Watching::at(folder, ".", &["shaders"]);
    watch.until("cpu: 5 tests pass; 5 ran");
    for name in tables {
        watch.edit(name, "x,result\n2,2\n");
        let red = watch.until("cpu: 1 of 5 tests fail; 1 ran");
        assert!(red.contains(&format!("changed: {name}")), "{red}");
        watch.edit(name, ROWS);
        watch.until("cpu: 5 tests pass; 1 ran");
    }
    let shaders = watch.folder().join("shaders");
    std::fs::write(shaders.join("white"), &grey).expect("written");
    watch.until("cpu: 1 of 5 tests fail; 1 ran");
    std::fs::write(shaders.join("white"), &white).expect("written");
    watch.until("cpu: 5 tests pass; 1 ran");
    watch.edit("gain.json", "3");
    watch.until("cpu: 1 of 5 tests fail; 1 ran");
    watch.edit("gain.json", "2");
    watch.until("cpu: 5 tests pass; 1 ran");
    watch.edit("../noise/value.wgsl", "fn quarter(x: f32) -> f32 { return 0.5 * x; }\n");
    watch.until("cpu: 4 of 5 tests fail; 4 ran");
    // Karat ignores files that no test reads.
    write(&shaders, "notes.md", "a note");
    watch.edit("../noise/value.wgsl", "fn quarter(x: f32) -> f32 { return 0.25 * x; }\n");
    let told = watch.until("cpu: 5 tests pass; 4 ran");
    assert!(!told.contains("notes.md"), "{told}");
}

/// If the output of `karat watch` goes into a file in the watched folder, this file triggers at most one run.
// Lesson 192
#[cfg(unix)]
#[test]
fn watch_does_not_react_to_its_own_output() {
    // A program that expands modules may read any file, so each file counts. The two watches wait at the same time.
    std::thread::scope(|scope| {
        for (manifest, end) in [
            ("", "> log.txt 2>&1"),
            ("", "2>&1 | tee log.txt"),
            ("preprocess = [\"/bin/cat\"]\n", "> log.txt 2>&1"),
            ("preprocess = [\"/bin/cat\"]\n", "| tee log.txt"),
        ] {
            scope.spawn(move || wakes_once(manifest, end));
        }
    });
}

#[cfg(unix)]
fn wakes_once(manifest: &str, end: &str) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    write(path, "calc.wgsl", SHADER);
    write(path, "calc_test.wgsl", TESTS);
    write(path, "karat.toml", manifest);
    let line = format!("\"$KARAT\" watch . --paths cpu --lines {end}");
    let mut shell = Command::new("/bin/sh");
    // The shell has its own process group, so all its processes end with it.
    shell.args(["-c", &format!("exec 3>&1; {line}")]).current_dir(path).stdin(Stdio::null());
    shell.env("KARAT", env!("CARGO_BIN_EXE_karat")).env("KARAT_TIMEOUT", "10");
    shell.stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = std::os::unix::process::CommandExt::process_group(&mut shell, 0)
        .spawn()
        .expect("it starts");
    let log = || std::fs::read_to_string(path.join("log.txt")).unwrap_or_default();
    let wait = |part: &str, count: usize| {
        let began = Instant::now();
        while log().matches(part).count() < count {
            assert!(began.elapsed() < PATIENCE, "no `{part}` in {}", log());
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait("2 tests pass", 1);
    // An edit triggers a run. The output of this run triggers nothing.
    std::thread::sleep(Duration::from_millis(700));
    // The file is moved into the folder in one step, so that a busy machine doesn't see an empty file.
    let saved = tempfile::tempdir().expect("a temporary folder");
    write(saved.path(), "calc.wgsl", &SHADER.replace("0.5", "0.25"));
    std::fs::rename(saved.path().join("calc.wgsl"), path.join("calc.wgsl")).expect("renamed");
    wait("1 of 2 tests fail", 1);
    std::thread::sleep(Duration::from_millis(1500));
    let told = log();
    drop(Command::new("kill").args(["--", &format!("-{}", child.id())]).status());
    drop(child.kill());
    drop(child.wait());
    assert_eq!(told.matches("changed: calc.wgsl").count(), 1, "{manifest}{end}: {told}");
    assert!(told.matches("changed: log.txt").count() <= 1, "{manifest}{end}: {told}");
    let verdicts = told.lines().filter(|line| line.starts_with("cpu: "));
    assert!(verdicts.count() <= 3, "{manifest}{end}: {told}");
}

/// Karat doesn't know the files that a Rust test reads, so an edit of any file starts the test again, unless each run
/// of the test writes this file.
// Lesson 192
#[test]
fn an_edit_of_any_file_runs_rust_tests() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    let manifest =
        "[package]\nname = \"engine\"\nversion = \"0.1.0\"\nedition = \"2024\"\n[workspace]\n";
    write(path, "Cargo.toml", manifest);
    write(path, "src/lib.rs", "");
    let test = "use std::io::Write;\n#[test]\nfn rows() {\n    \
                let log = std::fs::OpenOptions::new().create(true).append(true).open(\"out.log\");\n    \
                log.unwrap().write_all(b\"a run\\n\").unwrap();\n    \
                assert_eq!(std::fs::read_to_string(\"rows.dat\").unwrap(), \"1\");\n}\n";
    write(path, "tests/own.rs", test);
    write(path, "rows.dat", "1");
    write(path, "shaders/calc.wgsl", SHADER);
    let watch = Watching::at(folder, ".", &[]);
    watch.until("cpu (Rust): 1 test passes; 1 ran");
    let runs = || {
        std::thread::sleep(Duration::from_millis(1500));
        let log = std::fs::read_to_string(watch.folder().join("out.log"));
        log.expect("it is written").lines().count()
    };
    let first = runs();
    assert_eq!(runs(), first, "it wakes itself");
    write(watch.folder(), "rows.dat", "2");
    watch.until("cpu (Rust): 1 of 1 tests fail; 1 ran");
    write(watch.folder(), "rows.dat", "1");
    watch.until("cpu (Rust): 1 test passes; 1 ran");
    let last = runs();
    assert_eq!(runs(), last, "it wakes itself");
    // Karat also validates modules that no Rust test links.
    write(watch.folder(), "shaders/calc_test.wgsl", TESTS);
    watch.until("cpu (shaders): 2 tests pass; 2 ran");
    write(watch.folder(), "shaders/more.wgsl", "fn more() -> f32 { return nonsense; }\n");
    watch.until("cpu (shaders): WGSL error; 2 tests pass; 0 ran");
}

/// `karat watch` validates modules that no test links, in a Cargo project and for `karat watch FOLDER`.
// Lesson 191
#[test]
fn modules_that_no_test_links_are_validated() {
    let watch = Watching::start();
    watch.until("cpu: 2 tests pass; 2 ran");
    watch.edit("more.wgsl", "fn more() -> f32 { return nonsense; }\n");
    let red = watch.until("cpu: WGSL error; 2 tests pass; 0 ran");
    let told = watch.until("more.wgsl:1:27");
    assert!(red.contains("changed: more.wgsl"), "{red}{told}");
    watch.edit("more.wgsl", "fn more() -> f32 { return 1.0; }\n");
    watch.until("cpu: 2 tests pass; no code changed");
    let once = |paths: &str| {
        karat(watch.folder(), &["watch", "shaders", "--lines", "--once", "--paths", paths])
    };
    once("cpu").good();
    write(&watch.folder().join("shaders"), "more.wgsl", "fn more() -> f32 { return true; }\n");
    assert_eq!(once("cpu").code, Some(1));
}

// Lesson 102
#[cfg(unix)]
#[test]
fn watch_ends_when_its_output_closes() {
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

/// Counts the processes with a folder's name in their command line.
#[cfg(target_os = "linux")]
fn processes_of(folder: &FilePath) -> usize {
    let all = std::fs::read_dir("/proc").expect("processes");
    let lines = all.filter_map(|entry| std::fs::read(entry.ok()?.path().join("cmdline")).ok());
    let name = folder.to_string_lossy().into_owned();
    lines.filter(|line| String::from_utf8_lossy(line).contains(&name)).count()
}

// Lesson 102
#[cfg(target_os = "linux")]
#[test]
fn a_killed_watch_leaves_no_process_behind() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().canonicalize().expect("it is there").join("shaders");
    let hangs = "import karat::expect_true;\n@test fn t() {\n    var y = 0.0;\n    \
                 for (var i = 0; i < 2000000000; i++) { y += 1.0; }\n    expect_true(y > 0.0);\n}\n";
    write(&shaders, "calc_test.wgsl", hangs);
    let wait = |count: usize| {
        let began = Instant::now();
        while processes_of(&shaders) != count {
            assert!(began.elapsed() < PATIENCE, "{} processes", processes_of(&shaders));
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    let watch = &["watch", "shaders", "--paths", "cpu", "--lines"][..];
    let path = shaders.to_string_lossy();
    // For `karat test`, both processes have the folder's name in their command line.
    for (arguments, count) in [(watch, 1), (&["test", &*path, "--paths", "cpu"], 2)] {
        let mut command = command(folder.path(), arguments);
        command.env("KARAT_TIMEOUT", "600").env("KARAT_FUEL", "4000000000");
        command.stdin(Stdio::null()).stdout(Stdio::null());
        let mut child = command.spawn().expect("it starts");
        wait(count);
        // By now the process runs the shader, or will soon run it.
        std::thread::sleep(Duration::from_millis(500));
        child.kill().expect("it is there");
        child.wait().expect("it ends");
        wait(0);
    }
}

#[test]
fn a_missing_folder_or_path_cannot_be_watched() {
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

/// Ctrl-C ends `karat watch`, and no temporary files remain.
#[cfg(unix)]
#[test]
fn watch_leaves_no_temporary_files_when_stopped() {
    let (shaders, own) = (tempfile::tempdir(), tempfile::tempdir());
    let (shaders, own) = (shaders.expect("a folder"), own.expect("a folder"));
    write(shaders.path(), "calc.wgsl", SHADER);
    write(shaders.path(), "calc_test.wgsl", TESTS);
    for signal in ["INT", "TERM"] {
        let mut watching = Watching::of(shaders.path(), &["."], |command| {
            command.env("TMPDIR", own.path());
        });
        watching.until("cpu: 2 tests pass");
        let count = || std::fs::read_dir(own.path()).expect("it is there").count();
        assert!(count() > 0, "records lie there");
        let id = watching.child.id().to_string();
        let told = Command::new("kill").args(["-s", signal, &id]).status();
        assert!(told.is_ok_and(|status| status.success()));
        assert!(watching.child.wait().is_ok_and(|status| status.success()), "{signal}");
        assert_eq!(count(), 0, "{signal}");
    }
}
