//! Runs jobs in another program: a program that KARAT_EXECUTORS names, or a program that is part of Karat.
//!
//! The program first writes a [`Greeting`] line. Then Karat writes one job in each line, and the program answers each
//! job with one line. If several threads run jobs at the same time, each thread has its own process.

use std::sync::{Mutex, PoisonError};

use super::web::{self, Runner, Running};
use super::{Ability, Adapter, Path, PathError};
use crate::diagnostic::{nearest, one_line};
use crate::lines::Broken;
use crate::settings;

/// The version of the format for jobs and replies. Increase the version if older programs would misread the new
/// format.
pub(crate) const JOBS: u32 = 1;

/// The first line that a program for jobs writes: `{"jobs": 1, "name": "Dawn", "can": ["f16", "textures"]}`.
///
/// ```
/// use karat::unstable::path::{Ability, Greeting};
///
/// let line = r#"{"jobs": 1, "name": "Dawn", "can": ["f16"]}"#;
/// let greeting: Greeting = serde_json::from_str(line)?;
/// assert_eq!((greeting.jobs, &*greeting.can), (1, &[Ability::F16][..]));
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Greeting {
    /// The version of the job format that the program reads.
    pub jobs: u32,
    /// The name of the WebGPU implementation: `Dawn on llvmpipe`.
    pub name: String,
    /// The version of the WebGPU implementation.
    #[serde(default)]
    pub driver: String,
    /// `true` if the implementation runs shaders on the CPU.
    #[serde(default)]
    pub software: bool,
    /// The program's abilities. Compute passes that use only buffers need no ability.
    #[serde(default)]
    pub can: Vec<Ability>,
}

/// A program that runs jobs.
#[derive(Debug)]
pub(crate) struct Process {
    path: Path,
    runner: Runner,
    greeting: Greeting,
    idle: Mutex<Vec<Running>>,
}

impl Process {
    pub(super) fn open(path: Path) -> Result<Self, PathError> {
        let known = &settings::current()?.executors;
        let names = || known.iter().map(|(name, _)| &**name);
        let unavailable = |reason| PathError::Unavailable { path, reason };
        if path.via() != super::Via::Direct {
            return Err(unavailable(
                "a program in KARAT_EXECUTORS gets WGSL, so its path can't have a route: remove the route from the path's name".to_owned(),
            ));
        }
        let Some(name) = path.driver() else {
            let reason = "write `process@NAME` with a name from KARAT_EXECUTORS".to_owned();
            return Err(unavailable(reason));
        };
        let given = known.iter().find(|(known, _)| known == name);
        let runner = match (given, Runner::of(name)) {
            (Some((_, command)), _) => Runner::Given(command.clone()),
            (None, Some(own)) => own.map_err(unavailable)?,
            (None, None) => {
                let guess = super::guess(nearest(name, names().chain(web::NAMES)));
                return Err(unavailable(format!("KARAT_EXECUTORS has no program `{name}`{guess}")));
            }
        };
        let started = start(&runner).map_err(|reason| unavailable(format!("{runner}: {reason}")));
        let (running, greeting) = started?;
        let idle = Mutex::new(vec![running]);
        Ok(Self { path, runner, greeting, idle })
    }

    pub(crate) fn path(&self) -> Path {
        self.path
    }

    pub(crate) fn adapter(&self) -> Adapter {
        let Greeting { name, driver, software, .. } = self.greeting.clone();
        Adapter { path: self.path.to_string(), name, driver, software }
    }

    pub(crate) fn can(&self, ability: Ability) -> bool {
        self.greeting.can.contains(&ability)
    }

    /// Sends a line to a process, and reads its reply. If the process doesn't reply, or if Karat can't read the reply,
    /// Karat ends the process. The next call then starts a new process.
    pub(crate) fn ask<T>(
        &self,
        line: &str,
        read: impl FnOnce(&str) -> Result<T, String>,
    ) -> Result<T, PathError> {
        let failed = |reason: String| PathError::Driver { path: self.path, message: reason };
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut lines = match idle {
            Some(lines) => lines,
            None => start(&self.runner).map_err(failed)?.0,
        };
        let deadline = settings::deadline();
        let answer = lines.send(line).and_then(|()| lines.receive(deadline));
        let answer = answer.map_err(|broken| {
            failed(match broken {
                Broken::Hung(_) => format!(
                    "the program did not finish within {} s. A loop may be endless, or the deadline may be too short \
                     for this program: set KARAT_TIMEOUT to a larger number of seconds",
                    deadline.as_secs_f64()
                ),
                broken => broken.to_string(),
            })
        })?;
        let answer = read(&answer).map_err(failed)?;
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(lines);
        Ok(answer)
    }
}

fn start(runner: &Runner) -> Result<(Running, Greeting), String> {
    let deadline = settings::deadline();
    let mut lines = runner.start(deadline).map_err(|error| error.to_string())?;
    let first = lines.receive(deadline).map_err(|broken| match broken {
        Broken::Hung(_) => {
            let seconds = deadline.as_secs_f64();
            format!("the program wrote no greeting within {seconds} s (KARAT_TIMEOUT=seconds)")
        }
        broken => broken.to_string(),
    })?;
    let greeting: Greeting = serde_json::from_str(&first).map_err(|error| {
        format!("the program's first line isn't a greeting: {} ({error})", one_line(&first))
    })?;
    if greeting.jobs != JOBS {
        let theirs = greeting.jobs;
        return Err(format!(
            "the program reads jobs of version {theirs}, but this Karat writes version {JOBS}"
        ));
    }
    Ok((lines, greeting))
}
