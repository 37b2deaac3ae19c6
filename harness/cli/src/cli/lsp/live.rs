//! Tests without Rust that run after each save, in processes that stay, as under `karat watch`.

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
    /// When it was last asked.
    asked: SystemTime,
    /// Whether all tests have had a verdict.
    pub(super) done: bool,
    /// Files and functions that can't be read as tests.
    pub(super) broken: Vec<Wrong>,
    pub(super) verdicts: Vec<Record>,
}

/// What a process said that concerns others.
pub(super) enum Told {
    Nothing,
    /// Verdicts are new.
    Verdicts,
    /// It ended, with its last words.
    Ended(String),
}

/// All lanes.
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

    /// Runs what an edit in a package concerns. A package whose first test was written has processes
    /// from now on.
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
        // A request that waited goes on whatever was heard.
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
                // It stays busy until its records are there.
                self.resident.busy = self.resident.ask_for_records();
                Told::Verdicts
            }
            Said::Reported { error } => {
                self.resident.busy = false;
                // The verdicts that it has are the last ones that could be written.
                if let Some(error) = error {
                    bail!("verdicts can't be reported: {error}");
                }
                self.verdicts = read(&self.resident.report());
                // A test that nothing concerned since has its verdict from this time, too.
                let asked = humantime::format_rfc3339_millis(self.asked).to_string();
                for time in self.verdicts.iter_mut().filter_map(|record| record.time.as_mut()) {
                    time.started = asked.clone().max(std::mem::take(&mut time.started));
                }
                Told::Verdicts
            }
            Said::Ended { why } => {
                self.done = false;
                // What it knew is still true of the files that it saw.
                Told::Ended(why)
            }
        })
    }

    /// Whether a test is one of these.
    pub(super) fn has(&self, test: &str) -> bool {
        self.resident.tests.contains(test)
    }
}

/// The records of a file. A line that is none was written by a process that was ended.
fn read(file: &Path) -> Vec<Record> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}
