//! A long-lived process that runs the tests of one source on one path, for `karat watch` and `karat lsp`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use karat_suite::Wrong;

use super::{Request, Said, Source, Worker};

pub(in crate::cli) struct Resident {
    pub(in crate::cli) path: String,
    pub(in crate::cli) source: Source,
    /// The folder of the records that the process writes.
    records: PathBuf,
    worker: Option<Worker>,
    pub(in crate::cli) tests: BTreeSet<String>,
    pub(in crate::cli) failing: BTreeMap<String, Wrong>,
    pub(in crate::cli) busy: bool,
    /// The request that the process gets after the running tests have ended.
    waiting: Option<Request>,
}

impl Resident {
    pub(in crate::cli) fn new(path: &str, source: Source, records: PathBuf) -> Self {
        let (path, worker, waiting) = (path.to_owned(), None, None);
        let (tests, failing) = Default::default();
        Self { path, source, records, worker, tests, failing, busy: false, waiting }
    }

    /// Asks the process to run tests, the failing ones first. Returns `false` if tests are running: then the request
    /// waits until they end.
    pub(in crate::cli) fn ask(
        &mut self,
        request: Request,
        tell: impl Fn(Said) -> bool + Send + 'static,
    ) -> anyhow::Result<bool> {
        if self.busy {
            let waiting = self.waiting.get_or_insert_default();
            let changed = std::mem::take(&mut waiting.changed).into_iter().chain(request.changed);
            let (all, changed) = (waiting.all || request.all, changed.collect());
            *waiting = Request { all, changed, ..request };
            return Ok(false);
        }
        let worker = match &mut self.worker {
            Some(worker) => worker,
            none => none.insert(Worker::start(&self.path, &self.source, &self.records, tell)?),
        };
        let first = self.failing.keys().cloned().collect();
        self.busy = true;
        // If the process has ended, its `Ended` message follows.
        drop(worker.ask(&Request { first, ..request }));
        Ok(true)
    }

    /// Handles a message from the process.
    pub(in crate::cli) fn hear(&mut self, said: &Said) {
        match said {
            Said::Test { name, wrong: Some(wrong) } => {
                self.failing.insert(name.clone(), wrong.clone());
            }
            Said::Test { name, wrong: None } => drop(self.failing.remove(name)),
            Said::Done { tests, .. } => {
                self.failing.retain(|name, _| tests.contains(name));
                (self.tests, self.busy) = (tests.clone(), false);
            }
            Said::Reported { .. } => {}
            Said::Ended { .. } => (self.worker, self.busy) = (None, false),
        }
    }

    /// If no test runs, removes and returns the waiting request.
    pub(in crate::cli) fn waited(&mut self) -> Option<Request> {
        self.waiting.take_if(|_| !self.busy)
    }

    /// Asks the process to write its records into [the report file](Self::report). Returns `false` if there is no
    /// process.
    pub(in crate::cli) fn ask_for_records(&mut self) -> bool {
        let request = Request { report: Some(self.report()), ..Request::default() };
        self.worker.as_mut().is_some_and(|worker| worker.ask(&request).is_ok())
    }

    /// Returns the file into which the process writes its records.
    pub(in crate::cli) fn report(&self) -> PathBuf {
        self.records.with_extension("jsonl")
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn requests_during_a_run_are_merged() {
        let folder = PathBuf::from("shaders");
        let mut tests = Resident::new("cpu", Source::Shaders(folder.clone()), folder);
        tests.busy = true;
        for (all, file) in [(true, "a.wgsl"), (false, "b.wgsl")] {
            let request = Request { all, changed: vec![file.into()], ..Request::default() };
            assert!(!tests.ask(request, |_| true).expect("it only waits"));
        }
        assert!(tests.waited().is_none(), "tests run");
        tests.busy = false;
        let waited = tests.waited().expect("both wait");
        assert!(waited.all && waited.changed == [Path::new("a.wgsl"), Path::new("b.wgsl")]);
        assert!(tests.waited().is_none(), "once");
    }
}
