//! Runs the tests beside the shaders after each save, in long-lived processes, as `karat watch` does.

use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::time::SystemTime;

use anyhow::bail;
use karat::unstable::record::Record;
use karat_suite::{Suite, Wrong};

use super::super::watch::{Request, Resident, Said, Source};
use super::Event;
use super::place::resolved;

/// The tests of one package on one path.
pub(super) struct Lane {
    pub(super) package: PathBuf,
    pub(super) resident: Resident,
    asked: SystemTime,
    /// `true` after all tests have a verdict.
    pub(super) done: bool,
    /// The files and functions that can't be read as tests.
    pub(super) broken: Vec<Wrong>,
    pub(super) verdicts: Vec<Record>,
}

/// The effect of a message from a process that runs tests.
pub(super) enum Told {
    Nothing,
    Verdicts,
    /// The process ended, with this error text.
    Ended(String),
}

pub(super) struct Live {
    paths: Vec<String>,
    lanes: Vec<Lane>,
    records: tempfile::TempDir,
    sender: Sender<Event>,
}

impl Live {
    pub(super) fn new(paths: Vec<String>, sender: Sender<Event>) -> std::io::Result<Self> {
        Ok(Self { paths, lanes: Vec::new(), records: tempfile::tempdir()?, sender })
    }

    pub(super) fn lanes(&self) -> impl Iterator<Item = &Lane> {
        self.lanes.iter()
    }

    /// Runs the tests that an edit in a package affects. If necessary, starts the package's processes.
    pub(super) fn ask(&mut self, package: &karat::Package) -> anyhow::Result<()> {
        let folder = resolved(&package.root());
        if !self.lanes.iter().any(|lane| lane.package == folder) {
            let has = Suite::of(package.clone())
                .is_ok_and(|suite| !suite.tests.is_empty() || !suite.broken.is_empty());
            if !has {
                return Ok(());
            }
            for path in self.paths.clone() {
                let records = self.records.path().join(self.lanes.len().to_string());
                self.lanes.push(Lane {
                    package: folder.clone(),
                    resident: Resident::new(&path, Source::Shaders(folder.clone()), records),
                    asked: SystemTime::now(),
                    done: false,
                    broken: Vec::new(),
                    verdicts: Vec::new(),
                });
            }
        }
        for index in 0..self.lanes.len() {
            if self.lanes[index].package == folder {
                self.lanes[index].ask(index, &self.sender)?;
            }
        }
        Ok(())
    }

    pub(super) fn hear(&mut self, index: usize, said: Said) -> anyhow::Result<Told> {
        let Some(lane) = self.lanes.get_mut(index) else { return Ok(Told::Nothing) };
        let told = lane.hear(said);
        // A waiting request is sent after the next message of the process.
        if lane.resident.waited().is_some() {
            lane.ask(index, &self.sender)?;
        }
        told
    }
}

impl Lane {
    fn ask(&mut self, index: usize, sender: &Sender<Event>) -> anyhow::Result<()> {
        let sender = sender.clone();
        let tell = move |said| sender.send(Event::Worker(index, said)).is_ok();
        if self.resident.ask(Request::default(), tell)? {
            self.asked = SystemTime::now();
        }
        Ok(())
    }

    fn hear(&mut self, said: Said) -> anyhow::Result<Told> {
        self.resident.hear(&said);
        Ok(match said {
            Said::Test { .. } => Told::Nothing,
            Said::Done { tests, broken, .. } => {
                self.verdicts.retain(|record| tests.contains(&record.test));
                (self.broken, self.done) = (broken, true);
                // The process stays busy until it has written its records.
                self.resident.busy = self.resident.ask_for_records();
                Told::Verdicts
            }
            Said::Reported { error } => {
                self.resident.busy = false;
                // The lane keeps the last verdicts that the process could write.
                if let Some(error) = error {
                    bail!("can't read the verdicts of the tests: {error}");
                }
                self.verdicts = read(&self.resident.report());
                // Tests that the edit didn't affect also count as judged at this time.
                let asked = humantime::format_rfc3339_millis(self.asked).to_string();
                for time in self.verdicts.iter_mut().filter_map(|record| record.time.as_mut()) {
                    time.started = asked.clone().max(std::mem::take(&mut time.started));
                }
                Told::Verdicts
            }
            Said::Ended { why } => {
                self.done = false;
                // The verdicts of the ended process remain true for the files that it read.
                Told::Ended(why)
            }
        })
    }

    pub(super) fn has(&self, test: &str) -> bool {
        self.resident.tests.contains(test)
    }
}

/// Reads the records in a file. Ignores an invalid line, which comes from a process that ended while it wrote the line.
fn read(file: &Path) -> Vec<Record> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}
