//! Turns this process into a program that runs jobs on one of its executors.

use std::io::{BufRead, Write};

use super::Executor;
use crate::job::{Answer, Job, Problem, Reply};
use crate::path::{Ability, Adapter, Greeting, JOBS};

/// Turns this process into an executor for another process. First writes a `Greeting`, the line with which an executor
/// introduces itself. Then reads jobs line by line, runs each job, and writes the replies. Returns at the end of the
/// input.
///
/// ```no_run
/// use karat::Path;
///
/// // A program for KARAT_EXECUTORS. It runs jobs on the path that its first argument names.
/// fn main() -> Result<(), Box<dyn std::error::Error>> {
///     let path: Path = std::env::args().nth(1).ok_or("name a path")?.parse()?;
///     let executor = karat::unstable::executor::of(path)?;
///     Ok(karat::unstable::executor::serve(executor, std::io::stdin().lock(), std::io::stdout().lock())?)
/// }
/// ```
///
/// # Errors
/// Returns an error if a line can't be read or written.
pub fn serve(
    executor: &dyn Executor,
    jobs: impl BufRead,
    mut replies: impl Write,
) -> std::io::Result<()> {
    let Adapter { name, driver, software, .. } = executor.adapter();
    let all =
        [Ability::F16, Ability::Textures, Ability::Immediates, Ability::Subgroups, Ability::Frames];
    let can = all.into_iter().filter(|ability| executor.can(*ability)).collect();
    let greeting = Greeting { jobs: JOBS, name, driver, software, can };
    writeln!(replies, "{}", serde_json::to_string(&greeting)?)?;
    replies.flush()?;
    for line in jobs.lines() {
        let failed = |message| Reply::Failed(Problem { message, pass: 0, bytes: None });
        let job = serde_json::from_str(&line?).map(|job: Job| (job.id, executor.run(&job)));
        let (id, reply) = match job {
            Ok((id, reply)) => (id, reply.unwrap_or_else(|error| failed(error.to_string()))),
            // The reply has the id 0, which no job has.
            Err(error) => (0, failed(format!("this isn't a job: {error}"))),
        };
        writeln!(replies, "{}", serde_json::to_string(&Answer { id, reply })?)?;
        replies.flush()?;
    }
    Ok(())
}
