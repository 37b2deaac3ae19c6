//! Starts programs that run jobs: programs in KARAT_EXECUTORS, and two programs that are part of Karat. The program
//! `dawn` runs jobs with Dawn in Node, and the program `chromium` runs jobs in a page of Chromium.

use std::fmt;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use super::swiftshader;
use crate::diagnostic::shown;
use crate::lines::{Answers, Broken, Lines};
use crate::tint::{self, NoVerdict, Page};

/// The names of the programs that are part of Karat. Each name is also short for a path: `dawn` means `process@dawn`.
pub(super) const NAMES: [&str; 2] = ["dawn", "chromium"];

/// The largest size of a program's reply, in bytes. A frame of 4096 x 4096 pixels fits, with four 32-bit words per
/// pixel and up to ten digits per word.
const LONGEST: u64 = 1 << 30;

/// The JavaScript that runs a job with WebGPU. `NODE` and `PAGE` are the scripts that receive the jobs.
const JOBS: &str = include_str!("jobs.js");
const NODE: &str = include_str!("dawn.mjs");
const PAGE: &str = include_str!("page.js");

/// The JavaScript of the page of `karat browser`. The page requests jobs from Karat, and runs them with WebGPU.
pub const BROWSER_SCRIPTS: &str = concat!(include_str!("jobs.js"), include_str!("browser.js"));

#[derive(Clone, Debug)]
pub(super) enum Runner {
    /// A command from KARAT_EXECUTORS.
    Given(Vec<String>),
    /// Dawn for Node: the path of the executable `node`, and the folder of the npm package `webgpu`.
    Dawn { node: PathBuf, package: PathBuf },
    /// The path of the executable of Chromium or Chrome.
    Chromium(PathBuf),
}

#[derive(Debug)]
pub(super) enum Running {
    Lines(Lines),
    Page(Box<Page>),
}

impl fmt::Display for Runner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Given(command) => {
                write!(f, "`{}`, which KARAT_EXECUTORS names", command.join(" "))
            }
            Self::Dawn { package, .. } => write!(f, "Dawn in `{}`", shown(package)),
            Self::Chromium(program) => write!(f, "the browser `{}`", program.display()),
        }
    }
}

impl Runner {
    /// The program of this name (`dawn` or `chromium`), or the reason why this machine can't run it. `None` for other
    /// names.
    pub(super) fn of(name: &str) -> Option<Result<Self, String>> {
        match name {
            "dawn" => {
                let here = std::env::current_dir().unwrap_or_default();
                let found = tint::dawn(&here);
                Some(found.map(|(node, package)| Self::Dawn { node, package }).map_err(|reason| {
                    format!("{reason}: install Node, and run `npm install --save-dev webgpu`")
                }))
            }
            "chromium" => {
                let found = tint::browser().map(Self::Chromium);
                Some(found.ok_or_else(|| "no folder of PATH has Chromium or Chrome".to_owned()))
            }
            _ => None,
        }
    }

    /// Starts the program, and reads the first line that the program writes: its `Greeting`.
    pub(super) fn start(&self, patience: Duration) -> Result<Running, Broken> {
        let lines = |command: &mut Command| {
            // The child process must not write records.
            command.env_remove("KARAT_RECORD");
            Lines::start(command, Answers::Stdout, b'\n', LONGEST).map(Running::Lines)
        };
        match self {
            Self::Given(command) => {
                let (program, arguments) = command.split_first().expect("a program has a name");
                lines(Command::new(program).args(arguments))
            }
            Self::Dawn { node, package } => {
                let script = format!("{JOBS}{NODE}");
                let mut command = Command::new(node);
                command.args(["--no-warnings", "--input-type=module", "--eval", &script, "--"]);
                // Dawn doesn't support a Vulkan as old as Debian 12's. A browser's SwiftShader is new enough.
                if let Some(manifest) = swiftshader::manifest().filter(|_| !has_chosen_drivers()) {
                    command.env(swiftshader::ADD, manifest);
                }
                lines(command.arg(package))
            }
            Self::Chromium(program) => {
                let script = format!("{JOBS}{PAGE}");
                let page = Page::open(program, patience, (&script, LONGEST));
                page.map(|page| Running::Page(Box::new(page))).map_err(broken)
            }
        }
    }
}

/// Checks if the user chose Vulkan's drivers with an environment variable of Vulkan's loader.
#[must_use]
pub fn has_chosen_drivers() -> bool {
    let chosen = [swiftshader::ADD, "VK_DRIVER_FILES", "VK_ICD_FILENAMES"];
    chosen.iter().any(|name| std::env::var_os(name).is_some())
}

impl Running {
    pub(super) fn send(&mut self, job: &str) -> Result<(), Broken> {
        match self {
            Self::Lines(lines) => lines.send(job),
            Self::Page(page) => page.send(job).map_err(broken),
        }
    }

    pub(super) fn receive(&mut self, patience: Duration) -> Result<String, Broken> {
        match self {
            Self::Lines(lines) => lines.receive(patience),
            Self::Page(page) => page.receive(patience).map_err(broken),
        }
    }
}

fn broken(error: NoVerdict) -> Broken {
    match error {
        NoVerdict::Process(broken) => broken,
        other => Broken::Start(other.to_string()),
    }
}
