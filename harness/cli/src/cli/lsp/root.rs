//! A project that is open in the editor: its packages, and the results of its last runs.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use karat::Package;
use karat::unstable::record::{Record, Recorded, Subject};
use karat::unstable::reflect::{Invalid, Opinion};

use super::super::PackageArgs;
use super::super::check;
use super::super::project::Project;
use super::super::report::located;
use super::documents::{Documents, Now};
use super::place::resolved;

pub(super) struct Root {
    pub(super) project: Project,
    pub(super) packages: Vec<Package>,
    /// The packages that no manifest declares. Karat finds them beside a manifest or in the records of tests.
    unstated: Vec<PathBuf>,
    /// The packages with the features and dependencies that tests used.
    uses: Vec<Package>,
    /// The latest records of each test.
    records: Vec<Record>,
    /// The records of the last run. `karat replay` replays the failures of this run.
    pub(super) last: Vec<Record>,
    /// `true` if one of the runs included all tests, so that a function without a record is untested.
    whole: bool,
    stamp: Option<Stamp>,
}

/// The last run that ended, and the time of its end.
type Stamp = (String, Option<SystemTime>);

/// The verdicts, separated into current and outdated ones.
#[derive(Default)]
pub(super) struct Verdicts {
    pub(super) current: Vec<Record>,
    /// The records whose verdict is outdated, because a file that it depends on has changed since the run.
    pub(super) stale: Vec<Record>,
}

impl Root {
    pub(super) fn open(project: Project) -> anyhow::Result<Self> {
        let (packages, unstated, uses, records, last) = Default::default();
        let mut root =
            Self { project, packages, unstated, uses, records, last, whole: false, stamp: None };
        root.find_packages()?;
        Ok(root)
    }

    /// Searches for the packages again, with the same rules as `karat test`.
    pub(super) fn find_packages(&mut self) -> anyhow::Result<()> {
        let used = self.project.used_by(&self.records, &[]);
        let mut found = self.project.search_with(&PackageArgs::default(), &used)?;
        // A folder without a module isn't a package. Validation reports other errors.
        found.retain(|one| one.package.modules().is_ok());
        let unstated = found.iter().filter(|one| !one.stated);
        self.unstated = unstated.map(|one| one.package.root()).collect();
        self.packages = found.into_iter().map(|one| one.package).collect();
        Ok(())
    }

    /// Checks if Karat knows all tests. Without Cargo, it always does, because there are no Rust tests.
    pub(super) fn knows_all(&self) -> bool {
        self.whole || !self.project.is_cargo()
    }

    /// Returns the package that contains a file, and the name of the file's module.
    pub(super) fn module_of(&self, file: &Path) -> Option<(&Package, String)> {
        self.packages.iter().find_map(|package| Some((package, module_in(package, file)?)))
    }

    /// If a run has ended since the previous call, reads its record. Returns `true` if the records may have changed.
    pub(super) fn read_record(&mut self) -> anyhow::Result<bool> {
        let folder = self.project.record();
        let name = std::fs::read_to_string(folder.join("last")).unwrap_or_default();
        let changed = folder.join("last").metadata().and_then(|facts| facts.modified()).ok();
        let stamp = Some((name, changed));
        if self.stamp == stamp {
            return Ok(false);
        }
        self.stamp = stamp;
        let recorded = match Recorded::read(&folder) {
            Ok(found) => found,
            Err(error) => {
                (self.records, self.last, self.whole) = Default::default();
                return Err(error.into());
            }
        };
        let Some(Recorded { folder, records, run }) = recorded else {
            (self.records, self.last, self.whole) = Default::default();
            return Ok(true);
        };
        match run.is_some_and(|run| run.selected.is_empty()) {
            true => (self.records, self.whole) = (records.clone(), true),
            // Only some tests ran. The records of the other tests come from earlier runs.
            false => {
                let has = |test: &str| records.iter().any(|record| record.test == test);
                self.records.retain(|record| !has(&record.test));
                self.records.extend(records.iter().cloned());
            }
        }
        self.last = records;
        self.uses = check::uses(&folder).unwrap_or_default();
        self.find_packages()?;
        Ok(true)
    }

    /// Validates all modules, including unsaved edits. Returns the errors, and the remarks of other compilers.
    pub(super) fn invalid(&self, documents: &Documents) -> (Vec<Invalid>, Opinion) {
        let uses: Vec<Package> = self.uses.iter().map(|used| documents.applied(used)).collect();
        let (mut all, mut opinion) = (Vec::new(), Opinion::default());
        for package in &self.packages {
            let of_tests = self.unstated.contains(&package.root());
            let package = documents.applied(package);
            match package.try_is_valid() {
                Ok(found) => opinion.add(&found.opinion),
                Err(invalid) => {
                    opinion.add(invalid.opinion().unwrap_or(&Opinion::default()));
                    let uses = if of_tests { &*uses } else { &[] };
                    all.extend(check::as_used(invalid, &package, uses));
                }
            }
        }
        (all, opinion)
    }

    /// Returns the recorded verdicts, separated into current and outdated ones.
    pub(super) fn verdicts(&self, now: &Now<'_>) -> Verdicts {
        self.sorted(self.records.iter().cloned(), now)
    }

    /// Separates the current records from the outdated ones, whose files have changed since the run.
    pub(super) fn sorted(&self, records: impl Iterator<Item = Record>, now: &Now<'_>) -> Verdicts {
        // Tests write paths relative to their own folders.
        let records = records.map(|mut record| {
            if let Subject::Function { location, package, .. } = &mut record.subject {
                let root = self.project.root();
                if let Some(at) = located(location, Path::new(package), root) {
                    let file = resolved(&root.join(at.file));
                    *location = format!("{}:{}:{}", file.display(), at.line, at.column);
                }
                *package = resolved(&root.join(&*package)).display().to_string();
            }
            record
        });
        let (current, stale) =
            records.partition(|record| now.is_current(record, self.declared(record).as_deref()));
        Verdicts { current, stale }
    }

    /// Returns the file that may declare the test of a record: the `*.test.toml` beside the function's module.
    fn declared(&self, record: &Record) -> Option<PathBuf> {
        let Subject::Function { location, package, .. } = &record.subject else { return None };
        let root = self.project.root();
        let place = located(location, Path::new(package), root)?;
        Some(root.join(place.file).with_extension("test.toml"))
    }
}

pub(super) fn module_in(package: &Package, file: &Path) -> Option<String> {
    let root = resolved(&package.root());
    if root.is_file() {
        return (root == file).then(String::new);
    }
    let below = file.strip_prefix(&root).ok()?;
    if !below.extension().is_some_and(|ending| ending == "wgsl" || ending == "wesl") {
        return None;
    }
    let stem = below.with_extension("");
    let parts: Vec<_> = stem.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    let module = parts.join("::");
    package.modules().ok()?.contains(&module).then_some(module)
}
