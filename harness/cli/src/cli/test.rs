//! `karat test`: runs the tests, and prints their verdicts from the records.

mod progress;
pub(super) mod subjects;

use std::collections::{BTreeSet, HashSet};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

use anyhow::Context;
use karat::Package;
use karat::unstable::diagnostic::{nearest, shown};
use karat::unstable::output::{Output, counted, name};
use karat::unstable::package::LeftOut;
use karat::unstable::record::{self, Record, Recorded, Run, Running};
use karat::unstable::reflect::{Invalid, Opinion};
use karat_suite::{Suite, Test};

use self::progress::Progress;
use self::subjects::Subjects;
use super::project::{Project, tests_beside};
use super::report::{OutputArgs, Sum, colour, is_failure, short, tables, untested};
use super::search::{self, Found};
use super::table::{BAD, DIM, KNOWN};
use super::{NotThere, Outcome, PackageArgs, check, child, suite};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Runs only tests whose names contain this text, or that check a function or a golden whose name contains the
    /// text. A folder or file of shaders runs its own tests: functions with `@test`, and `*.test.toml`
    #[arg(value_name = "FILTER|FOLDER")]
    what: Option<String>,
    /// With a folder, runs only tests whose name contains this text, or that call a function whose name contains the
    /// text
    filter: Option<String>,
    /// Runs only the test with exactly this name
    #[arg(long)]
    exact: bool,
    /// Runs only the test with exactly this name; may be repeated, as an editor's lens may have several tests
    #[arg(long, value_name = "NAME", hide = true, conflicts_with_all = ["exact", "failed", "filter"])]
    named: Vec<String>,
    /// Runs only the tests that failed in the last run
    #[arg(long, conflicts_with_all = ["exact", "filter"])]
    failed: bool,
    /// Runs only tests of this Cargo package; may be repeated [default: the whole workspace]
    #[arg(short = 'p', long = "package", value_name = "NAME")]
    cargo_packages: Vec<String>,
    /// Runs only this test target, the name of a file in `tests/`; may be repeated
    #[arg(long = "test", value_name = "NAME")]
    targets: Vec<String>,
    /// Runs the checks on these paths: `vulkan`, `vulkan,gl`, or `all` for all drivers that open [default: the first
    /// driver that opens, else `cpu`]
    #[arg(long, value_name = "PATHS", env = "KARAT_PATHS")]
    paths: Option<String>,
    /// Fails if one of these paths didn't run
    #[arg(long, value_name = "PATHS", env = "KARAT_REQUIRE")]
    require: Option<String>,
    /// Samples this many orders of invocations for each compute pass that has more than 4,096 orders [default: 16]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(..=65536))]
    schedules: Option<u64>,
    /// Leaves out frames, which need a driver
    #[arg(long, alias = "functions")]
    no_frames: bool,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    package: PackageArgs,
}

/// The tests that the user asked for. The first argument is either a folder or a filter.
struct Asked<'a> {
    args: &'a Args,
    /// The folder or file of shaders. If it is set, only the tests beside the shaders run.
    folder: Option<PathBuf>,
    filter: Option<&'a str>,
    /// The Rust tests that, in their last run, checked a function or golden with a name that contains the filter.
    about: Vec<String>,
    /// The exact names of the tests to run, with `--failed` or `--named`.
    names: Option<Vec<String>>,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    // Then Karat prints only the lines of failures.
    let mut unread = std::io::sink();
    let asked = Asked::of(args)?;
    let project = asked.project()?;
    let asked = asked.with_failed(&project)?.with_tests_of_functions(&project);
    args.output.spare(&project.record())?;
    args.output.clear()?;
    let held = args.output.hold_commands(out)?;
    let told: &mut dyn Write = if args.output.short { &mut unread } else { &mut *out };
    let mut subjects = Subjects::read(&project.record());
    asked.write_unknown(&project, &subjects, told)?;
    // The record of the last run stays until the new one is complete.
    let running = Running::begin(&project.record()).with_context(|| unwritable(&project))?;
    let (mut passed, mut ran) = (true, false);
    let mut progress = Progress::of(subjects.count().filter(|_| asked.is_whole()));
    if asked.folder.is_none() && project.is_cargo() {
        if !args.package.features.is_empty() {
            let theirs = "`--feature` doesn't apply to Rust tests: a Rust test sets its features by `package.feature(..)`";
            writeln!(told, "{KNOWN}{theirs}{KNOWN:#}")?;
        }
        passed = asked.run_cargo(&project, running.folder(), &mut progress, told)?;
        ran = true;
    }
    // Tests call single functions, but all modules of their packages must be valid.
    let of_rust = check::linked(running.folder())?;
    let used = project.used_by(&record::read(running.folder())?, &of_rust);
    let found = asked.packages(&project, &used)?;
    let packages: Vec<Package> = found.iter().map(|one| one.package.clone()).collect();
    let mut suites_passed = true;
    let suites = asked.suites(&found)?;
    for folder in &suites {
        suites_passed &= asked.run_suite(folder, running.folder(), &mut progress, told)?;
        ran = true;
    }
    passed &= suites_passed;
    // A run of selected tests doesn't list the others.
    let is_of_cargo = asked.folder.is_none() && project.is_cargo();
    if (asked.filter.is_none() || !ran) && !is_of_cargo {
        search::write_outside(asked.folder.as_deref(), told)?;
    }
    let left_out = asked.write_left_out(&packages, told)?;
    if !ran {
        // A misspelt test may be invalid WGSL: `@tset`.
        let mut invalid = Vec::new();
        check::validate(&packages, false, &mut invalid)?;
        told.write_all(&invalid)?;
        return Err(asked.nothing(&packages).into());
    }
    let records = record::read(running.folder())?;
    let used = project.used_in(&records, &check::linked(running.folder())?);
    subjects.add_packages(used.clone(), asked.is_whole());
    subjects.add(&records, asked.is_whole().then(|| progress.done()), progress.failed());
    // A replay of one case, or a run that counts lines on `cpu`, doesn't replace the record of the last run.
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_replay = is_set("KARAT_CASE") || is_set("KARAT_COVERAGE");
    if !is_replay {
        subjects
            .write(&project.record())
            .context("can't store which tests check which functions")?;
    }
    if !passed && suites_passed && progress.done() == 0 && records.is_empty() {
        anyhow::bail!("no test ran: the build failed, or the test programs ended early");
    }
    // Suites that can't run record nothing, and have already reported their error.
    if suites_passed || !records.is_empty() {
        tables::expect_some(&records, asked.filter)?;
    }
    // If no packages are declared, the tests show which folders are packages. A folder that no test uses doesn't make
    // the run fail.
    let is_used =
        |one: &Found| one.stated || one.place().is_some_and(|place| used.contains(&place));
    let (judged, idle): (Vec<Found>, Vec<Found>) = found.into_iter().partition(is_used);
    let (invalid, opinion) = check::invalid(&judged, running.folder())?;
    let (modules, without_modules) = check::names(&invalid);
    let run = Run {
        selected: asked.selected(project.is_cargo()),
        passed: passed && invalid.is_empty(),
        failed: progress.failed().iter().map(|test| name(test).into_owned()).collect(),
        invalid: modules,
        errors: short::errors(&invalid),
        invalid_packages: without_modules,
        remarks: remarks(left_out, &opinion).into_iter().chain(tests_beside(&packages)).collect(),
        ..Run::default()
    };
    run.write(running.folder()).context("can't write the `run.json` of the record")?;
    let sum = Sum::of(&records, Some(&run));
    let (folder, _of_replay) = match is_replay {
        true => (project.record(), Some(running)),
        false => (running.end().context("can't write the record of the run")?, None),
    };
    tables::write(&records, args.output.all, told)?;
    // With a filter, or with selected test programs, most functions are left out on purpose.
    let is_part = !(args.cargo_packages.is_empty() && args.targets.is_empty());
    if asked.filter.is_none() && asked.names.is_none() && !is_part {
        write_untested(&records, packages, &invalid, told)?;
    }
    if asked.is_whole() {
        for Found { package, .. } in idle.iter().filter(|one| !suites.contains(&one.package.root()))
        {
            let folder = shown(&package.root());
            writeln!(
                told,
                "{DIM}no test uses the shaders in `{folder}`: `karat check` validates these shaders{DIM:#}"
            )?;
        }
    }
    check::write(&invalid, told)?;
    check::write_remarks(&opinion, told)?;
    tables::write_sum(&records, &sum, &folder, told)?;
    if args.leaves_frames_out() {
        writeln!(told, "{KNOWN}no frame was drawn{KNOWN:#}")?;
    }
    if asked.is_whole() {
        write_silent(&records, progress.passed(), args.output.all, told)?;
    }
    if args.output.short {
        short::write(&records, (&invalid, &opinion), &sum, project.root(), out)?;
    }
    args.output.write(&records, Some(&run), &sum, held, &project, out)?;
    Ok(sum.ending())
}

/// Returns the remarks that follow the last line of the run.
fn remarks(left_out: usize, opinion: &Opinion) -> Vec<String> {
    let left_out = (left_out > 0)
        .then(|| format!("{} left out because of false conditions", counted(left_out, "test")));
    left_out.into_iter().chain(opinion.remark()).collect()
}

impl Args {
    /// Finds a test whose name contains `word`, and which isn't in the folder `word`: `karat test WORD` may mean the
    /// folder or the test. Returns the root of the test's package, and the name of the test.
    fn other_test(&self, word: &str) -> Option<(PathBuf, String)> {
        let folder = Path::new(word).canonicalize().ok()?;
        // If the project isn't readable, the word means the folder.
        let packages = Project::find().and_then(|project| project.packages(&self.package));
        let others = packages.unwrap_or_default().into_iter();
        let mut others = others.filter_map(|package| {
            let root = package.root().canonicalize().ok()?;
            // Both meanings run the tests in the folder.
            let inside = folder.strip_prefix(&root).ok().map(|own| {
                own.iter().map(|part| format!("{}::", part.to_string_lossy())).collect::<String>()
            });
            let is_inside = |name: &str| match &inside {
                Some(own) => name.starts_with(own.as_str()),
                None => root.starts_with(&folder),
            };
            let mut tests = Suite::of(package).ok()?.tests.into_iter();
            let test = tests.find(|test| search::has_word(test, word) && !is_inside(&test.name))?;
            Some((root, test.name))
        });
        others.next()
    }

    /// Checks if `--no-frames` or `KARAT_FRAMES=off` leaves out frames.
    fn leaves_frames_out(&self) -> bool {
        self.no_frames || std::env::var("KARAT_FRAMES").is_ok_and(|frames| frames == "off")
    }
}

impl<'a> Asked<'a> {
    fn of(args: &'a Args) -> anyhow::Result<Self> {
        // Karat reports a misspelt path before the build, because the build takes minutes.
        for (option, names) in [("--paths", &args.paths), ("--require", &args.require)] {
            // An empty variable counts as unset.
            let names = names.as_deref().filter(|names| !names.trim().is_empty());
            names.map_or(Ok(Vec::new()), |names| karat::unstable::path::named(option, names))?;
        }
        let (what, filter) = (args.what.as_deref(), args.filter.as_deref());
        let named = what.map(Path::new).filter(|path| path.exists());
        let is_path = |what: &str| what.contains(['/', '\\']) || what.ends_with(".wgsl");
        match (what, named) {
            (Some(what), None) if filter.is_some() || is_path(what) => {
                let more = filter.map_or(
                    "",
                    |_| ": if you write two arguments, the first argument must be a folder",
                );
                anyhow::bail!("there is no folder or file `{what}`{more}")
            }
            (_, Some(file)) if file.extension().is_some_and(|ending| ending == "toml") => {
                let of = file.to_string_lossy();
                let of = of.strip_suffix(".test.toml").unwrap_or(&of);
                anyhow::bail!(
                    "`{}` declares tests, but has no shader: name the module of these tests, such as `{of}.wgsl`",
                    file.display()
                )
            }
            (_, Some(folder)) => {
                let word = what.filter(|what| !is_path(what) && filter.is_none());
                if let Some((word, (root, test))) =
                    word.and_then(|word| Some((word, args.other_test(word)?)))
                {
                    let modules = Package::open(folder).and_then(|package| package.modules());
                    // A folder without shaders isn't a package.
                    if matches!(modules, Err(karat::package::PackageError::Empty(_))) {
                        return Ok(Self {
                            args,
                            folder: None,
                            filter: what,
                            about: Vec::new(),
                            names: None,
                        });
                    }
                    anyhow::bail!(
                        "`{word}` is a folder, and also a part of the name of the test `{test}`: write `karat test ./{word}` for the \
                         folder's tests, or `karat test {} --exact '{test}'` for this test",
                        shown(&root)
                    );
                }
                search::expect_filter(folder, filter.filter(|_| !args.exact))?;
                let (folder, about, names) = (Some(folder.to_owned()), Vec::new(), None);
                Ok(Self { args, folder, filter, about, names })
            }
            (Some(what), None) if args.failed => {
                anyhow::bail!("`{what}` isn't a folder: with `--failed`, write no filter")
            }
            (what, None) => {
                Ok(Self { args, folder: None, filter: what, about: Vec::new(), names: None })
            }
        }
    }

    /// With `--failed` or `--named`, sets the exact names of the tests to run.
    fn with_failed(self, project: &Project) -> anyhow::Result<Self> {
        if !self.args.failed {
            let names = (!self.args.named.is_empty()).then(|| self.args.named.clone());
            return Ok(Self { names, ..self });
        }
        let none = || NotThere("there is no record of a run: run `karat test` first".to_owned());
        let last = Recorded::read(&project.record())?.ok_or_else(none)?;
        let failed = last.records.iter().filter(|record| is_failure(record));
        let mut names: Vec<String> = failed.map(|record| record.test.clone()).collect();
        // If a test fails without a failing check, it has no record.
        names.extend(Subjects::read(&project.record()).failed().iter().cloned());
        names.sort();
        names.dedup();
        if names.is_empty() {
            let passed = last.run.as_ref().is_some_and(|run| run.passed);
            let why = match passed {
                true => "no test failed in the last run",
                false => {
                    "no check failed in the last run. A test failed outside of Karat's checks, but Karat doesn't know the test's name: run \
                     `karat test` without `--failed`"
                }
            };
            return Err(NotThere(why.to_owned()).into());
        }
        Ok(Self { names: Some(names), ..self })
    }

    /// Adds the tests that, in their last run, checked a function or golden with a name that contains the filter.
    fn with_tests_of_functions(self, project: &Project) -> Self {
        let Some(filter) = self.filter.filter(|_| !self.args.exact) else { return self };
        Self { about: Subjects::read(&project.record()).about(filter), ..self }
    }

    /// If the filter may be the name of a function, prints the note that Karat doesn't know yet which functions a new
    /// Rust test checks.
    fn write_unknown(
        &self,
        project: &Project,
        subjects: &Subjects,
        out: &mut dyn Write,
    ) -> std::io::Result<()> {
        let Some(filter) = self.filter.filter(|_| !self.args.exact) else { return Ok(()) };
        let by_function = subjects.count().is_none() || subjects.checks(filter);
        if self.folder.is_some() || !project.is_cargo() || !by_function {
            return Ok(());
        }
        writeln!(
            out,
            "{DIM}the filter finds a new Rust test only by its name; after `karat test` has run all tests, the filter \
             also finds tests by the functions that the tests check{DIM:#}"
        )
    }

    fn is_whole(&self) -> bool {
        let whole = self.folder.is_none() && self.names.is_none() && !self.args.exact;
        whole && self.selected(false).is_empty()
    }

    fn wants(&self, test: &Test) -> bool {
        match (&self.names, self.filter) {
            (Some(names), _) => names.contains(&test.name),
            (None, Some(name)) if self.args.exact => test.name == name,
            (None, filter) => filter.is_none_or(|filter| test.is_about(filter)),
        }
    }

    fn project(&self) -> anyhow::Result<Project> {
        let Some(folder) = &self.folder else {
            // The failures may belong to a folder that the last run named.
            return if self.args.failed { Project::last_tested() } else { Project::find() };
        };
        let folder = folder.canonicalize().context("can't read the folder")?;
        let folder = if folder.is_file() { folder.parent().unwrap_or(&folder) } else { &folder };
        Project::around(folder)
    }

    fn packages(&self, project: &Project, used: &BTreeSet<PathBuf>) -> anyhow::Result<Vec<Found>> {
        let Some(folder) = &self.folder else {
            return project.search_with(&self.args.package, used);
        };
        let package = Package::open(search::stands_for(folder)?)?;
        Ok(vec![Found::stated(self.args.package.featured(package))])
    }

    /// Lists the tests that a false condition turns off, and returns their number.
    fn write_left_out(&self, packages: &[Package], out: &mut dyn Write) -> anyhow::Result<usize> {
        let of = |package: &Package| package.tests_left_out(&package.modules().unwrap_or_default());
        let is_wanted =
            |test: &LeftOut| self.filter.is_none_or(|filter| test.name.contains(filter));
        let tests: Vec<LeftOut> = packages.iter().flat_map(of).filter(is_wanted).collect();
        if tests.is_empty() || self.names.is_some() {
            return Ok(0);
        }
        let count = tests.len();
        let name = |test: &LeftOut| format!("{} {}", test.name, test.condition);
        let names: Vec<String> = tests.iter().map(name).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let names = some_of(&names, self.args.output.all);
        let tests = counted(tests.len(), "test");
        writeln!(
            out,
            "{KNOWN}{tests} not run because of a false condition: {names}; `--feature NAME` turns a feature on{KNOWN:#}"
        )?;
        Ok(count)
    }

    /// Returns the folders of packages with tests beside their modules.
    fn suites(&self, found: &[Found]) -> anyhow::Result<Vec<PathBuf>> {
        // These options select tests that Cargo runs. Cargo doesn't run the tests beside modules.
        if !self.args.cargo_packages.is_empty() || !self.args.targets.is_empty() {
            return Ok(Vec::new());
        }
        let mut folders = Vec::new();
        for Found { package, stated } in found {
            let suite = Suite::of(package.clone())?;
            // An unreadable test file counts, even if no test uses its package.
            let broken = suite.broken.iter().any(|broken| *stated || broken.is_file);
            let has = suite.tests.iter().any(|test| self.wants(test)) || broken;
            if has && !package.root().as_os_str().is_empty() {
                folders.push(package.root());
            }
        }
        Ok(folders)
    }

    /// Returns the error that there is no test to run. The error suggests similar names.
    fn nothing(&self, packages: &[Package]) -> NotThere {
        if let Some(names) = &self.names {
            let names = some(&names.iter().map(String::as_str).collect::<Vec<_>>());
            return NotThere(format!("no test has one of these names: {names}"));
        }
        let left_out = |package: &Package| {
            let tests = package.tests_left_out(&package.modules().unwrap_or_default());
            tests.iter().any(|test| self.filter.is_none_or(|filter| test.name.contains(filter)))
        };
        if packages.iter().any(left_out) {
            let none = "no test runs, because the conditions of all tests are false; `--feature NAME` turns a feature on";
            return NotThere(none.to_owned());
        }
        let Some(filter) = self.filter else {
            if let Some(folder) = &self.folder {
                let none = format!(
                    "`{0}` has no tests: no function with `@test`, and no `*.test.toml`; `karat init {0}` writes a \
                 first test, and `karat test` without arguments runs tests in Rust",
                    folder.display()
                );
                return NotThere(none);
            }
            let none = "there are no tests: no function with `@test`, no `*.test.toml`, and no Cargo project; `karat init` writes a \
                    first test";
            return NotThere(none.to_owned());
        };
        let suites = packages.iter().filter_map(|package| Suite::of(package.clone()).ok());
        let names: Vec<String> =
            suites.flat_map(|suite| suite.tests).map(|test| test.name).collect();
        // The similar name may belong to a test, to the subject of several tests, or to a folder.
        let of = |name: &String| name.split(' ').next().unwrap_or_default().to_owned();
        let mut known: Vec<String> = names.iter().cloned().chain(names.iter().map(of)).collect();
        let here = std::fs::read_dir(".").into_iter().flatten().flatten();
        let folders = here.filter(|entry| entry.path().is_dir());
        let folders = folders.filter(|_| !self.args.exact);
        known.extend(folders.map(|entry| entry.file_name().to_string_lossy().into_owned()));
        let near = nearest(filter, known.iter().map(String::as_str));
        let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
        let is_so = if self.args.exact { "is called" } else { "has a name that contains" };
        NotThere(match (names.len(), self.folder.is_some()) {
            (0, true) => {
                "there are no tests: no function with `@test`, and no `*.test.toml`; `karat init` writes a first test"
                    .to_owned()
            }
            (0, false) => {
                format!("there are no tests, and there is no folder or file `{filter}`{near}")
            }
            (count, _) => {
                format!("none of {} {is_so} `{filter}`{near}", counted(count, "test"))
            }
        })
    }

    /// Returns the arguments that select tests, as the user typed them.
    fn selected(&self, is_cargo: bool) -> Vec<String> {
        let args = self.args;
        let packages = args.cargo_packages.iter().map(|name| format!("-p {name}"));
        let targets = args.targets.iter().map(|name| format!("--test {name}"));
        let functions = args.no_frames.then(|| "--no-frames".to_owned());
        // In a Cargo project, the tests beside a folder's modules are only a part of the tests.
        let folder = self.folder.as_ref().filter(|_| is_cargo);
        let folder = folder.map(|folder| folder.display().to_string());
        let filter = self.filter.iter().map(ToString::to_string);
        let failed = self.args.failed.then(|| "--failed".to_owned());
        let filter = filter.chain(failed);
        let named = args.named.iter().map(|name| format!("--named {name}"));
        folder
            .into_iter()
            .chain(filter)
            .chain(named)
            .chain(packages)
            .chain(targets)
            .chain(functions)
            .collect()
    }

    /// Runs the tests beside the modules of a package, and checks if all passed.
    fn run_suite(
        &self,
        folder: &Path,
        record: &Path,
        progress: &mut Progress,
        out: &mut dyn Write,
    ) -> anyhow::Result<bool> {
        let program = std::env::current_exe().context("can't find karat's executable file")?;
        let suite = Suite::of(self.args.package.featured(Package::open(folder)?))?;
        let no_frames = self.args.leaves_frames_out();
        let asked: Vec<&Test> = suite
            .tests
            .iter()
            .filter(|test| self.wants(test) && !(no_frames && test.is_frame()))
            .collect();
        let mut run = |filter: Option<&str>, exact: bool| {
            let mut command = Command::new(&program);
            command.arg("suite").arg(folder).args(filter).args(exact.then_some("--exact"));
            // The tests end when this program ends.
            command.arg("--attended").stdin(Stdio::piped());
            command.args(no_frames.then_some("--no-frames"));
            for feature in suite::written(&self.args.package.features) {
                command.args(["--feature", &feature]);
            }
            let status = self.run_tests(command, record, progress, out)?;
            // A driver, the system or the deadline ended the process.
            if !matches!(status.code(), Some(0..=2)) {
                let is_of_run = |test: &&&Test| !exact || filter == Some(&*test.name);
                let names = asked.iter().filter(is_of_run).map(|test| test.name.clone());
                let untold = progress.end_without(names);
                let names: Vec<&str> = untold.iter().map(String::as_str).collect();
                let before = if names.is_empty() {
                    String::new()
                } else {
                    format!(" before these tests had a verdict: {}", some(&names))
                };
                writeln!(
                    out,
                    "{BAD}error{BAD:#}: the process that runs the tests ended ({status}){before}"
                )?;
            }
            Ok(status.success())
        };
        let Some(names) = &self.names else { return run(self.filter, self.args.exact) };
        let has = |name: &&String| suite.tests.iter().any(|test| test.name == **name);
        let mut passed = true;
        for name in names.iter().filter(has) {
            passed &= run(Some(name), true)?;
        }
        Ok(passed)
    }

    /// Runs `cargo test`, and checks if all tests passed.
    fn run_cargo(
        &self,
        project: &Project,
        record: &Path,
        progress: &mut Progress,
        out: &mut dyn Write,
    ) -> anyhow::Result<bool> {
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut command = Command::new(cargo);
        command.current_dir(project.root()).args(["test", "--no-fail-fast"]);
        match self.args.cargo_packages.as_slice() {
            [] => {
                command.arg("--workspace");
            }
            packages => {
                for package in packages {
                    command.args(["--package", package]);
                }
            }
        }
        // Unit tests and integration tests run. Examples, benchmarks and documentation have no checks.
        match self.args.targets.as_slice() {
            [] => {
                command.arg("--tests");
            }
            targets => {
                for target in targets {
                    command.args(["--test", target]);
                }
            }
        }
        if progress.line().is_seen() {
            // Cargo writes into a pipe, but a person reads its output on a terminal.
            if std::env::var_os("CARGO_TERM_COLOR").is_none() {
                command.args(["--config", "term.color='always'"]);
            }
            command.args(["--config", "term.hyperlinks=false"]);
        }
        command.args(self.filter);
        match &self.names {
            Some(names) => {
                command.args(["--", "--exact"]).args(names);
            }
            None if self.args.exact => {
                command.args(["--", "--exact"]);
            }
            // A test runs if its name contains one of these names.
            None if !self.about.is_empty() => {
                command.arg("--").args(&self.about);
            }
            None => {}
        }
        Ok(self.run_tests(command, record, progress, out)?.success())
    }

    /// Runs a command that runs tests. On a terminal, a bar counts the tests with a verdict.
    fn run_tests(
        &self,
        mut command: Command,
        record: &Path,
        progress: &mut Progress,
        out: &mut dyn Write,
    ) -> anyhow::Result<ExitStatus> {
        let args = self.args;
        command.env("KARAT_RECORD", record);
        command.envs(args.no_frames.then_some(("KARAT_FRAMES", "off")));
        command.envs(args.paths.as_ref().map(|paths| ("KARAT_PATHS", paths)));
        command.envs(args.schedules.map(|count| ("KARAT_SCHEDULES", count.to_string())));
        command.envs(args.require.as_ref().map(|paths| ("KARAT_REQUIRE", paths)));
        let mut told = false;
        let above = progress.line();
        let mut line = |line: &str| {
            if let Some((name, word)) = child::verdict(line) {
                progress.step(name, word);
                if word == "ok" {
                    return Ok(());
                }
            }
            // At most one blank line separates other lines.
            let blank = line.is_empty() && told;
            if blank || !is_noise(line) {
                above.above(|| writeln!(out, "{}", colour::line(line)))?;
                told = !blank;
            }
            Ok(())
        };
        let status = match above.is_seen() {
            // Cargo and drivers print messages while the progress line is visible.
            true => {
                let mut err = Output::new(std::io::stderr());
                let mut error = |text: &str| Ok(above.above(|| writeln!(err, "{text}"))?);
                child::run_heard(&mut command, &mut error, &mut line)?
            }
            false => child::run(&mut command, &mut line)?,
        };
        progress.pause();
        Ok(status)
    }
}

/// Returns the error that the output folder isn't writable.
pub(super) fn unwritable(project: &Project) -> String {
    let place = project.record();
    match project.is_cargo() {
        true => format!(
            "can't write the record of the run to `{}`: set CARGO_TARGET_DIR to another folder",
            place.display()
        ),
        false => format!(
            "can't write the record of the run to `{}`: if the folder is read-only, test a copy of the shaders",
            place.display()
        ),
    }
}

/// Lists the tests that passed without a check: their authors may have forgotten the check.
fn write_silent(
    records: &[Record],
    passed: &[String],
    all: bool,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    let recorded: HashSet<&str> = records.iter().map(|record| &*record.test).collect();
    let silent = passed.iter().map(String::as_str).filter(|test| !recorded.contains(&*name(test)));
    let silent: Vec<&str> = silent.collect();
    if silent.is_empty() {
        return Ok(());
    }
    let tests = counted(silent.len(), "test");
    writeln!(out, "{DIM}{tests} passed without a check: {}{DIM:#}", some_of(&silent, all))
}

/// The largest number of names in a list without `--all`.
const MOST_NAMES: usize = 5;

/// Returns the first names of a list, and the number of the others.
pub(super) fn some(names: &[&str]) -> String {
    some_of(names, false)
}

/// Returns all names, or only the first ones as [`some`] does.
fn some_of(names: &[&str], all: bool) -> String {
    let most = if all { names.len() } else { MOST_NAMES };
    let first = names[..names.len().min(most)].join(", ");
    match names.len().saturating_sub(most) {
        0 => first,
        more => format!("{first} and {more} more"),
    }
}

/// Checks if a line of a test program only repeats a part of Karat's table.
fn is_noise(line: &str) -> bool {
    line.is_empty() || line.starts_with("test result: ok") || is_count(line)
}

/// Checks if a line is the count of a program's tests: `running 12 tests`.
fn is_count(line: &str) -> bool {
    let rest = line
        .strip_prefix("running ")
        .and_then(|rest| rest.strip_suffix(" tests").or(rest.strip_suffix(" test")));
    rest.is_some_and(|count| count.parse::<u64>().is_ok())
}

fn write_untested(
    records: &[Record],
    packages: Vec<Package>,
    invalid: &[(String, Invalid)],
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    // The tests of an invalid module can't run, so its functions don't count as untested.
    let is_valid = |package: &Package| invalid.iter().all(|(name, _)| *name != package.name());
    let (valid, others): (Vec<_>, Vec<_>) = packages.into_iter().partition(is_valid);
    let untested = untested(records, &valid)?;
    if !untested.is_empty() {
        let names: Vec<&str> = untested.iter().map(|item| &*item.name).collect();
        let names = some(&names);
        writeln!(out, "\n{DIM}functions without a test: {names} (`karat list` lists all){DIM:#}")?;
    }
    for package in others {
        let name = package.name();
        writeln!(
            out,
            "\n{DIM}{name} isn't valid, so Karat doesn't list its untested functions{DIM:#}"
        )?;
    }
    Ok(())
}
