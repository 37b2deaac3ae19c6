//! Runs jobs in a program that `KARAT_EXECUTORS` names.

use super::Executor;
use crate::diagnostic::one_line;
use crate::job::{Answer, Job, Reply};
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
        let line = job.line(self.can(Ability::Packed));
        self.ask(&line, |answer| {
            let read: Answer = serde_json::from_str(answer).map_err(|error| {
                format!(
                    "the executor wrote a line that isn't an answer: {} ({error})",
                    one_line(answer)
                )
            })?;
            match read.id == job.id {
                true => Ok(read.reply),
                false => {
                    Err(format!("the executor answered job {} instead of job {}", read.id, job.id))
                }
            }
        })
    }
}
