//! A program that KARAT_EXECUTORS names: it runs jobs.

use super::Executor;
use crate::diagnostic::one_line;
use crate::job::{Job, Reply};
use crate::path::{Ability, Adapter, Path, PathError, Process};

impl Executor for Process {
    fn path(&self) -> Path {
        Self::path(self)
    }

    fn adapter(&self) -> Adapter {
        Self::adapter(self)
    }

    fn can(&self, ability: Ability) -> bool {
        Self::can(self, ability)
    }

    fn run(&self, job: &Job) -> Result<Reply, PathError> {
        let line = serde_json::to_string(job).expect("a job is plain data");
        let answer = self.ask(&line)?;
        serde_json::from_str(&answer).map_err(|error| {
            let message = format!("its answer is no reply: {} ({error})", one_line(&answer));
            PathError::Driver { path: Self::path(self), message }
        })
    }
}
