//! Tests `karat watch` on a terminal, with keys.

use std::io::{Read, Write};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use portable_pty::{Child, CommandBuilder, MasterPty, PtySize, native_pty_system};

use super::pending::pending_frame;
use super::*;

const SHADER: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n";

const TESTS: &str = "import package::calc::half;\nimport karat::expect_near;\n\
@test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n";

/// A limit far longer than any step takes, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

const ROWS: u16 = 24;

struct Terminal {
    folder: TempDir,
    child: Box<dyn Child + Send + Sync>,
    master: Box<dyn MasterPty + Send>,
    keys: Box<dyn Write + Send>,
    written: Receiver<Vec<u8>>,
    screen: vt100::Parser,
}

impl Terminal {
    fn start(columns: u16) -> Self {
        Self::with(columns, &[])
    }

    fn with(columns: u16, env: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let shaders = folder.path().join("shaders");
        write(&shaders, "calc.wgsl", SHADER);
        write(&shaders, "calc_test.wgsl", TESTS);
        let size = PtySize { rows: ROWS, cols: columns, ..PtySize::default() };
        let pair = native_pty_system().openpty(size).expect("a terminal");
        let program = command(folder.path(), &[]).get_program().to_owned();
        let mut command = CommandBuilder::new(program);
        command.args(["watch", "shaders", "--paths", "cpu"]);
        command.cwd(folder.path());
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("KARAT_") {
                command.env_remove(name);
            }
        }
        // Removes the settings of the surrounding run. Each process has its own path.
        command.env("KARAT_REQUIRE", "vulkan");
        // `CI` isn't set, because a person looks at this screen.
        command.env_remove("CI");
        command.env("KARAT_TIMEOUT", "1");
        // The programs that open pages on this machine must not run.
        command.env("PATH", "");
        command.env("TERM", "xterm");
        for (name, value) in env {
            command.env(name, value);
        }
        let child = pair.slave.spawn_command(command).expect("it starts");
        let mut reader = pair.master.try_clone_reader().expect("its output");
        let keys = pair.master.take_writer().expect("its input");
        let (sender, written) = channel();
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = reader.read(&mut bytes) {
                if sender.send(bytes[..count].to_vec()).is_err() {
                    return;
                }
            }
        });
        let screen = vt100::Parser::new(ROWS, columns, 0);
        Self { folder, child, master: pair.master, keys, written, screen }
    }

    /// Waits until the screen is complete and shows `part`, and returns its text.
    #[track_caller]
    fn until(&mut self, part: &str) -> String {
        let began = Instant::now();
        while began.elapsed() < PATIENCE {
            let more = self.written.recv_timeout(Duration::from_millis(50));
            if let Ok(bytes) = &more {
                self.screen.process(bytes);
            }
            let shown = self.screen.screen().contents();
            if more.is_err() && shown.contains(part) {
                return shown;
            }
        }
        panic!("no `{part}` on:\n{}", self.screen.screen().contents());
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).expect("it listens");
        self.keys.flush().expect("it listens");
    }

    fn edit(&self, file: &str, text: &str) {
        let shaders = self.folder.path().join("shaders");
        write(&shaders, "saved.tmp", text);
        std::fs::rename(shaders.join("saved.tmp"), shaders.join(file)).expect("renamed");
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

// Lesson 101
#[test]
fn a_person_breaks_and_mends_a_shader() {
    let mut terminal = Terminal::start(80);
    terminal.until("cpu: 1 test passes; 1 ran");
    terminal.edit("calc.wgsl", &SHADER.replace("0.5", "0.25"));
    let red = terminal.until("cpu: 1 of 1 tests fail");
    for part in
        ["changed: calc.wgsl", "calc_test::halves on cpu", "calc_test.wgsl:3:21", "saw 0.75"]
    {
        assert!(red.contains(part), "no `{part}` on:\n{red}");
    }
    terminal.edit("calc.wgsl", SHADER);
    let green = terminal.until("cpu: 1 test passes; 1 ran");
    assert!(!green.contains("saw 0.75"), "what was red is gone:\n{green}");
    terminal.edit("calc.wgsl", "fn half(x: f32) -> f32 { return 0.5 * ; }\n");
    let broken = terminal.until("cpu: no verdict");
    assert!(broken.contains("calc.wgsl:1:39"), "{broken}");
    let hangs = "fn half(x: f32) -> f32 {\n    var y = x;\n    \
                 for (var i = 0; i < 2000000000; i++) { y += 1.0; }\n    return y;\n}\n";
    terminal.edit("calc.wgsl", hangs);
    let slow = terminal.until("was stopped");
    assert!(slow.contains("calc.wgsl:3:5"), "{slow}");
    let (here, away) = ["shaders", "away"].map(|name| terminal.folder.path().join(name)).into();
    std::fs::rename(&here, &away).expect("renamed");
    terminal.until("cpu: no verdict");
    std::fs::rename(&away, &here).expect("renamed");
    terminal.until("cpu: 1 of 1 tests fail");
    terminal.edit("calc.wgsl", SHADER);
    terminal.until("cpu: 1 test passes");
}

#[test]
fn keys_do_what_the_last_line_says() {
    let mut terminal = Terminal::start(80);
    terminal.until("cpu: 1 test passes; 1 ran");
    terminal.until("r run all   f filter   a accept   o report   q quit");
    terminal.press("fnothing\r");
    terminal.until("cpu: there are no tests");
    terminal.press("f");
    terminal.until("run only tests whose names contain: _");
    terminal.press("half\u{7f}v\r");
    terminal.until("cpu: 1 test passes; 1 ran");
    terminal.press("a");
    terminal.until("no frame is pending");
    terminal.edit("calc.wgsl", &SHADER.replace("0.5", "0.25"));
    terminal.until("cpu: 1 of 1 tests fail");
    terminal.press("o");
    terminal.until("watch.html");
    let page = terminal.folder.path().join("shaders/.karat/run/watch.html");
    let page = std::fs::read_to_string(page).expect("the report is there");
    assert!(page.contains("calc_test::halves") && page.contains("1 check, 1 failed"), "{page}");
    terminal.press("q");
    let began = Instant::now();
    while terminal.child.try_wait().expect("a process").is_none() {
        assert!(began.elapsed() < PATIENCE, "it doesn't end");
        std::thread::sleep(Duration::from_millis(20));
    }
    let _ = &terminal.master;
}

/// On a screen of 80 x 24, the user can reach each failure, and each line of a failure, with keys.
#[test]
fn the_user_can_page_and_scroll_through_failures() {
    let mut terminal = Terminal::start(80);
    terminal.until("cpu: 1 test passes; 1 ran");
    let more: String = ["again", "other"]
        .iter()
        .map(|name| format!("@test fn {name}() {{ expect_near(half(3.0), 1.25, 0.0); }}\n"))
        .collect();
    terminal.edit("calc_test.wgsl", &format!("{TESTS}{more}"));
    let first = terminal.until("1 of 2: calc_test::again on cpu");
    assert!(first.contains("n next"), "{first}");
    terminal.press("n");
    terminal.until("2 of 2: calc_test::other on cpu");
    terminal.press("n");
    terminal.until("1 of 2: calc_test::again on cpu");
    // The message is longer than the screen.
    let lines: String =
        (0..40).map(|at| format!("    expect_near(half(3.0), {at}.0, 0.0);\n")).collect();
    terminal.edit("calc_test.wgsl", &format!("{TESTS}@test fn long() {{\n{lines}}}\n"));
    let top = terminal.until("calc_test::long on cpu");
    assert!(top.contains("\u{2191}\u{2193} scroll") && top.lines().count() <= 24, "{top}");
    terminal.press("\u{1b}[B\u{1b}[B");
    let below = terminal.until("calc_test::long on cpu");
    assert!(below != top && below.contains("q quit"), "{below}");
    // The last line doesn't scroll further.
    terminal.press(&" ".repeat(30));
    let end = terminal.until("calc_test::long on cpu");
    terminal.press("k");
    let above = terminal.until("calc_test::long on cpu");
    assert!(above != end, "one line up is seen at once:\n{end}");
}

/// A person accepts new frames, and must give a reason. Karat writes each golden beside the frame's test.
#[test]
fn a_pending_frame_is_accepted() {
    let mut terminal = Terminal::start(100);
    terminal.until("cpu: 1 test passes; 1 ran");
    let golden = terminal.folder.path().join("shaders/golden");
    pending_frame(&golden, "scene", "llvmpipe (LLVM 15.0.6, 256 bits)");
    terminal.press("a");
    terminal.until("accept scene because: _");
    terminal.press("\r");
    terminal.until("no frame was accepted: a reason is required");
    assert!(!golden.join("scene.exr").exists());
    terminal.press("a");
    terminal.until("accept scene because: _");
    terminal.press("a new lamp\r");
    terminal.until("accepted scene");
    assert!(golden.join("scene.exr").is_file());
    // The test is in a folder below, and its goldens are beside it.
    let below = terminal.folder.path().join("shaders/sky/golden");
    pending_frame(&below, "room/dusk", "llvmpipe (LLVM 15.0.6, 256 bits)");
    terminal.press("a");
    terminal.until("accept room/dusk because: _");
    terminal.press("it is late\r");
    terminal.until("accepted room/dusk");
    assert!(below.join("room/dusk.exr").is_file());
}

/// On a terminal that can't move its cursor (`TERM=dumb`), the output is a list of lines.
#[test]
fn a_dumb_terminal_has_lines() {
    let mut terminal = Terminal::with(80, &[("TERM", "dumb")]);
    let shown = terminal.until("cpu: 1 test passes; 1 ran");
    assert!(!shown.contains("r run all"), "{shown}");
    terminal.edit("calc.wgsl", &SHADER.replace("0.5", "0.25"));
    let red = terminal.until("cpu: 1 of 1 tests fail");
    assert!(red.contains("cpu: 1 test passes; 1 ran") && red.contains("saw 0.75"), "{red}");
}

/// All lines fit on a terminal of 40 columns, and Karat clears the screen even if colours are off.
#[test]
fn a_narrow_terminal_has_no_line_that_wraps() {
    let mut terminal = Terminal::with(40, &[("NO_COLOR", "1")]);
    terminal.until("cpu: 1 test passes");
    terminal.edit("calc.wgsl", &SHADER.replace("0.5", "0.25"));
    let red = terminal.until("cpu: 1 of 1 tests fail");
    assert!(red.lines().next().is_some_and(|line| line.starts_with("karat watch")), "{red}");
    assert!(red.lines().all(|line| line.chars().count() <= 40), "{red}");
    // Karat wraps values, and doesn't cut them.
    let joined: String = red.lines().map(str::trim).collect();
    assert!(joined.contains("saw 0.75, expected 1.5"), "{red}");
}
