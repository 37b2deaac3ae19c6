//! Tests in Rust, as judges of mutants: by their programs, without Cargo, with the mutant as an overlay.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, bail};
use karat::Package;
use karat::unstable::output::tell;
use karat::unstable::record::{self, Verdict};
use karat::unstable::reflect::Dependence;
use karat_mutate::{Candidate, Judged, Others};

use super::super::suite::cargo::libtest;
use super::super::suite::cargo::programs::{Programs, TestProgram};

/// All tests of a project.
pub(super) struct RustTests {
    programs: Programs,
    /// What each test is made of, by its name in front of people.
    made: BTreeMap<String, Vec<Dependence>>,
    count: usize,
    /// One program runs at a time: each takes all cores.
    turn: Mutex<()>,
}

/// The tests of a project, as far as they use the shaders of a package.
pub(super) struct OfPackage<'t> {
    pub(super) tests: &'t RustTests,
    pub(super) package: &'t Package,
}

impl RustTests {
    /// Builds them, and runs all once. None in a project without any.
    pub(super) fn of(root: &Path, filter: Option<&str>) -> anyhow::Result<Self> {
        tell("building the tests in Rust, and running each once");
        let mut programs = Programs::of(root);
        if let Err(message) = programs.build()? {
            bail!("{message}");
        }
        let (mut made, mut count, mut red) = (BTreeMap::<String, Vec<_>>::new(), 0, Vec::new());
        for program in programs.all() {
            let tests: Vec<&str> = program
                .tests
                .iter()
                .map(String::as_str)
                .filter(|test| filter.is_none_or(|filter| program.show(test).contains(filter)))
                .collect();
            if tests.is_empty() {
                continue;
            }
            let folder = tempfile::tempdir().context("no temporary folder")?;
            libtest::run(program, &tests, (folder.path(), None), &mut |test, message| {
                red.extend(message.map(|message| (program.show(test), message)));
                Ok(())
            })?;
            let all = Dependence::all(folder.path()).context("what tests linked can't be read")?;
            // What a thread without a test's name linked may concern each test of its program.
            let names: HashSet<&str> = tests.iter().copied().collect();
            let is_shared = |one: &&Dependence| !names.contains(&*one.test);
            let shared: Vec<Dependence> = all.iter().filter(is_shared).cloned().collect();
            for test in &tests {
                let own = all.iter().filter(|one| one.test == **test).chain(&shared).cloned();
                let own: Vec<Dependence> = own.collect();
                count += usize::from(!own.is_empty());
                made.insert(program.show(test), own);
            }
        }
        if let Some((test, message)) = red.first() {
            let more =
                if red.len() > 1 { format!(", and {} more", red.len() - 1) } else { String::new() };
            bail!(
                "`{test}`{more} fails without a mutant, and would kill each: mend it first\n\n{}",
                message.trim_end()
            );
        }
        Ok(Self { programs, made, count, turn: Mutex::default() })
    }

    fn judge(&self, package: &Package, candidate: &Candidate) -> anyhow::Result<Judged> {
        let text = candidate.mutant.applied(&candidate.text);
        let root = package.root();
        // As an overlay names it, beside modules of other packages.
        let below = match root.is_file() {
            true => root.file_name().map(Path::new).unwrap_or(&root).to_owned(),
            false => Path::new(&package.name()).join(candidate.file.strip_prefix(&root)?),
        };
        let scratch = tempfile::tempdir().context("no temporary folder")?;
        let (overlay, records) = (scratch.path().join("overlay"), scratch.path().join("record"));
        let file = overlay.join(below);
        std::fs::create_dir_all(file.parent().unwrap_or(&overlay))?;
        std::fs::write(&file, &text)?;
        let mut judged = Judged::default();
        for program in self.programs.all() {
            let concerned = self.concerned(program, candidate, &text);
            if concerned.is_empty() {
                continue;
            }
            judged.concerned += concerned.len();
            let own = records.join(judged.concerned.to_string());
            std::fs::create_dir_all(&own)?;
            let mut failed: Vec<(String, String)> = Vec::new();
            let turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
            libtest::run(program, &concerned, (&own, Some(&overlay)), &mut |test, message| {
                failed.extend(message.map(|message| (test.to_owned(), message)));
                Ok(())
            })?;
            drop(turn);
            let records = record::read(&own)?;
            for (test, message) in failed {
                let verdicts = records.iter().filter(|one| one.test == test).map(|one| one.verdict);
                let verdicts: Vec<Verdict> = verdicts.collect();
                let name = program.show(&test);
                // Without an error of Karat's it is a check, or an assertion of the test's own, that fails.
                if verdicts.contains(&Verdict::Fail) || !verdicts.contains(&Verdict::Error) {
                    return Ok(Judged { killed: Some(name), ..judged });
                }
                let reason = message.lines().find(|line| !line.trim().is_empty());
                judged.stopped = Some((name, reason.unwrap_or_default().trim().to_owned()));
            }
        }
        Ok(judged)
    }

    /// The tests of a program that use what a mutant changes.
    fn concerned<'p>(
        &self,
        program: &'p TestProgram,
        candidate: &Candidate,
        text: &str,
    ) -> Vec<&'p str> {
        let is_concerned = |test: &&str| {
            let made = self.made.get(&program.show(test));
            // What another process can't open is of text in memory, which no overlay replaces.
            let changes =
                |one: &Dependence| one.is_current_with(&candidate.file, text) == Some(false);
            made.is_some_and(|made| made.iter().any(changes))
        };
        program.tests.iter().map(String::as_str).filter(is_concerned).collect()
    }
}

impl Others for OfPackage<'_> {
    fn count(&self) -> usize {
        self.tests.count
    }

    fn judge(&self, candidate: &Candidate) -> Judged {
        self.tests.judge(self.package, candidate).unwrap_or_else(|error| Judged {
            stopped: Some(("tests in Rust".to_owned(), format!("{error:#}"))),
            ..Judged::default()
        })
    }
}
