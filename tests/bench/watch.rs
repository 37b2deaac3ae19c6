//! Times `karat watch` from the change of a file to the verdict, in a library of a hundred tested functions.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use super::Spread;

const FUNCTIONS: usize = 100;

const MODULES: usize = 10;

/// The number of edits. The benchmark prints the median of their times.
const EDITS: usize = 20;

/// The time limit for a verdict. A verdict usually needs far less time.
const PATIENCE: Duration = Duration::from_secs(120);

pub(super) fn run() {
    let Some(program) = karat() else {
        println!("\nwatch: there is no `karat` beside this program; `cargo build` makes it");
        return;
    };
    println!(
        "\nkarat watch: edit of one of {FUNCTIONS} tested functions to its verdict, median of {EDITS} [ms]"
    );
    // The benchmark has its own driver cache, because the user's cache contains the edits of an earlier run.
    let cache = tempfile::tempdir().expect("a temporary folder");
    let own = Some(cache.path());
    let runs = [
        ("cpu", None, "no driver"),
        ("vulkan", own, "driver cache empty at first"),
        ("vulkan", own, "driver cache with these edits"),
        ("vulkan", None, "no driver cache"),
    ];
    for (path, cache, caches) in runs {
        let folder = tempfile::tempdir().expect("a temporary folder");
        write_library(folder.path());
        let mut watch = Watch::start(&program, folder.path(), path, cache);
        let first = watch.verdict(path);
        let times = (0..EDITS).map(|edit| watch.edit(folder.path(), path, edit)).collect();
        println!("  {path:<7} {caches:<30} first run {first:.0}, then {}", Spread::of(times));
    }
}

/// The program `karat`; `None` if `cargo build` hasn't made it in the benchmark's profile.
fn karat() -> Option<PathBuf> {
    let own = std::env::current_exe().ok()?;
    let profile = own.ancestors().find(|folder| folder.join("deps").is_dir())?;
    let program = profile.join(format!("karat{}", std::env::consts::EXE_SUFFIX));
    program.is_file().then_some(program)
}

fn write_library(folder: &Path) {
    std::fs::write(folder.join("lib.wgsl"), library(0)).expect("written");
    for module in 0..MODULES {
        let own = module * FUNCTIONS / MODULES..(module + 1) * FUNCTIONS / MODULES;
        let names: Vec<String> = own.clone().map(|at| format!("curve{at}")).collect();
        let mut text = format!(
            "import karat::expect_in_range;\nimport package::lib::{{{}}};\n",
            names.join(", ")
        );
        for at in own {
            writeln!(
                text,
                "@test @cases(1000) fn t{at}(@over(0, 1) x: f32, @over(-1, 1) y: f32) {{ \
                 expect_in_range(curve{at}(x, y), -1.0, 1.0); }}"
            )
            .expect("text takes text");
        }
        std::fs::write(folder.join(format!("lib{module}_test.wgsl")), text).expect("written");
    }
}

/// The library after `edits` edits. Each edit changes a different function.
fn library(edits: usize) -> String {
    let mut text = String::new();
    for at in 0..FUNCTIONS {
        let edited = (0..edits).find(|edit| edit * 7 % FUNCTIONS == at);
        let factor = edited.map_or(format!("{at}.5"), |edit| format!("{at}.{}", 51 + edit));
        writeln!(
            text,
            "fn curve{at}(x: f32, y: f32) -> f32 {{\n    let z = x * {factor} + y;\n    \
             return z / (1.0 + abs(z));\n}}"
        )
        .expect("text takes text");
    }
    text
}

struct Watch {
    child: Child,
    lines: Receiver<String>,
}

impl Watch {
    /// Starts `karat watch` with a folder for the driver's cache, or without a cache.
    fn start(program: &Path, folder: &Path, path: &str, cache: Option<&Path>) -> Self {
        let mut command = Command::new(program);
        command.arg("watch").arg(folder).args(["--paths", path, "--lines"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        match cache {
            Some(cache) => command.env("MESA_SHADER_CACHE_DIR", cache),
            None => command.env("MESA_SHADER_CACHE_DISABLE", "true"),
        };
        let mut child = command.spawn().expect("karat starts");
        let out = child.stdout.take().expect("it is piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Self { child, lines }
    }

    /// Waits for the path's verdict, and returns the time in ms. Panics if a test fails.
    fn verdict(&mut self, path: &str) -> f64 {
        let (began, start) = (Instant::now(), format!("{path}: "));
        loop {
            let line = self.lines.recv_timeout(PATIENCE).expect("a verdict comes");
            if line.starts_with(&start) {
                assert!(line.contains(&format!("{FUNCTIONS} tests pass")), "{line}");
                return began.elapsed().as_secs_f64() * 1e3;
            }
        }
    }

    fn edit(&mut self, folder: &Path, path: &str, edit: usize) -> f64 {
        // Wait until the events of the last edit are over.
        std::thread::sleep(Duration::from_millis(200));
        let saved = folder.join("saved.tmp");
        std::fs::write(&saved, library(edit + 1)).expect("written");
        std::fs::rename(&saved, folder.join("lib.wgsl")).expect("renamed");
        self.verdict(path)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
