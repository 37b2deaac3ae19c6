//! `karat init`: a first test that passes, and what goes with it.

mod npm;
mod pass;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail, ensure};
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::hazards::Kind;
use karat::unstable::output::counted;
use karat::unstable::package::FunctionItem;
use karat::unstable::probe::Probed;
use karat::unstable::record::{self, Recorded};
use karat::unstable::reflect::Stage;
use karat::value::{Scalar, Shape};

use super::doctor::profile::unoptimised;
use super::goldens::CiArgs;
use super::list::{callable, tested_functions};
use super::project::{self, Project, text_of};
use super::table::{DIM, GOOD, HEAD, KNOWN};
use super::{Ending, Outcome, PackageArgs, check};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder of shaders [default: the first that `karat test` finds, such as `shaders`, else the working
    /// directory]
    folder: Option<PathBuf>,
    /// Write a workflow for GitHub Actions
    #[arg(long)]
    github: bool,
    /// Write a pipeline for GitLab
    #[arg(long)]
    gitlab: bool,
    #[command(flatten)]
    ci: CiArgs,
}

/// Functions that are tried until a test of one passes.
const TRIED: usize = 40;

/// Where numbers of which nothing is known are tried. Roughness and cosines leave out 0 at last, at which lobes and divisions
/// are infinite.
const RANGES: [&str; 2] = ["0..1", "0.01..1"];

/// What runs leave behind and nobody commits.
const IGNORED: [&str; 4] = ["**/.karat/run/", "*.new.exr", "*.new.csv", "*.new.png"];

const GITHUB: &str = include_str!("init/github.yml");
const GITLAB: &str = include_str!("init/gitlab.yml");

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    args.ci.check("write a first test")?;
    let folder = match &args.folder {
        Some(folder) => folder.clone(),
        None => usual_folder()?,
    };
    ensure!(folder.is_dir(), "there is no folder `{}`", folder.display());
    expect_no_package_around(&folder)?;
    let package = Package::open(&folder)?;
    let mut invalid = Vec::new();
    let valid = check::validate(std::slice::from_ref(&package), false, &mut invalid)?;
    out.write_all(&invalid)?;
    ensure!(valid, "mend these modules first: a test of them can't pass");
    let mut items = callable(&package)?;
    // A fragment or vertex function is called as any other, where there is none.
    items.extend(entry_points(&package, |stage| stage != Stage::Compute)?);
    let passes = entry_points(&package, |stage| stage == Stage::Compute)?;
    ensure!(
        !items.is_empty() || !passes.is_empty(),
        "`{}` has no function and no entry point: write one, and run this again",
        folder.display()
    );
    // Who has tests in Rust and asks for a workflow wants that alone.
    let is_cargo = Project::around(&folder.canonicalize()?)?.is_cargo();
    // Before all else: where no test can be offered, nothing is written.
    let written = if (args.github || args.gitlab) && is_cargo && tested(&folder)?.any() {
        writeln!(out, "{DIM}there are tests in Rust: none is written{DIM:#}")?;
        None
    } else {
        first_test(&package, &folder, (&items, &passes), out)?
    };
    ignore(out)?;
    optimise(&folder, out)?;
    npm::adapt(&folder, out)?;
    if args.github {
        keep(Path::new(".github/workflows/karat.yml"), &with_folder(GITHUB, &folder), out)?;
    }
    if args.gitlab {
        keep(Path::new(".gitlab-ci.karat.yml"), &with_folder(GITLAB, &folder), out)?;
    }
    let good = run_tests(&folder, out)?;
    let folder = folder.display();
    writeln!(out, "\n{HEAD}what to do next{HEAD:#}")?;
    writeln!(
        out,
        "  karat watch {folder}     the tests again at each edit: break a function, and see it"
    )?;
    writeln!(out, "  karat hazards {folder}   what can go wrong, with no test")?;
    match written {
        Some(file) => writeln!(
            out,
            "  {}   more assertions: agrees_with, table, monotone, limit, ...",
            file.display()
        )?,
        None => writeln!(
            out,
            "  *.test.toml   more assertions: agrees_with, table, monotone, limit, ..."
        )?,
    }
    if !args.github && !args.gitlab {
        writeln!(
            out,
            "  karat init --github (or --gitlab)   the same tests in CI, on Mesa's lavapipe"
        )?;
    }
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// A folder is one package by its karat.toml, and none within it has another one.
fn expect_no_package_around(folder: &Path) -> anyhow::Result<()> {
    let (whole, here) = (folder.canonicalize()?, Path::new(".").canonicalize()?);
    let around = whole.ancestors().skip(1).take_while(|around| around.starts_with(&here));
    let mut packages = around.filter(|around| around.join(project::MANIFEST).is_file());
    match packages.next() {
        Some(package) => bail!(
            "`{0}` is a package by its {1}, and `{2}` is a part of it: run `karat init {0}`",
            shown(package),
            project::MANIFEST,
            folder.display()
        ),
        None => Ok(()),
    }
}

/// The folder whose tests `karat test` runs here, if there is one.
fn usual_folder() -> anyhow::Result<PathBuf> {
    let packages = Project::find()?.packages(&PackageArgs::default()).unwrap_or_default();
    let root = packages.first().map(Package::root).filter(|root| root.is_dir());
    Ok(PathBuf::from(root.map_or_else(|| ".".to_owned(), |root| shown(&root))))
}

/// Runs the folder's tests. In a project with a record of a run they add none: of its Rust tests nothing would
/// be left in it.
fn run_tests(folder: &Path, out: &mut dyn Write) -> anyhow::Result<bool> {
    let suite = karat_suite::Suite::open(folder)?;
    if suite.tests.is_empty() && suite.broken.is_empty() {
        return Ok(true);
    }
    writeln!(out)?;
    let project = Project::around(&folder.canonicalize()?)?;
    let recorded = project.is_cargo() && Recorded::read(&project.record())?.is_some();
    let status = this()?.arg(if recorded { "suite" } else { "test" }).arg(folder).status();
    if recorded {
        writeln!(out, "{DIM}the record of the last run stays: `karat test` runs all tests{DIM:#}")?;
    }
    Ok(status.context("the tests don't run")?.success())
}

fn this() -> anyhow::Result<Command> {
    Ok(Command::new(std::env::current_exe().context("this program isn't where it was")?))
}

/// Writes a test of the first function for which one passes, beside its module. `None` if there are tests, or
/// if each function has one in Rust.
fn first_test(
    package: &Package,
    folder: &Path,
    (items, entry_points): (&[FunctionItem], &[FunctionItem]),
    out: &mut dyn Write,
) -> anyhow::Result<Option<PathBuf>> {
    let suite = karat_suite::Suite::open(folder)?;
    if !suite.tests.is_empty() || !suite.broken.is_empty() {
        writeln!(out, "{DIM}there are tests already: none is written{DIM:#}")?;
        return Ok(None);
    }
    let tested = tested(folder)?;
    let (own, others): (Vec<_>, Vec<_>) = items.iter().partition(|item| !tested.is(&item.name));
    let mut found = Functions::default();
    for item in &own {
        found.add(package, item);
    }
    let mut pass = None;
    for item in entry_points.iter().filter(|item| !tested.is(&item.name)).take(TRIED) {
        match try_pass(package, item, folder)? {
            Ok(file) => {
                writeln!(out, "{GOOD}wrote{GOOD:#} {}, a test of `{}`", file.display(), item.name)?;
                pass = Some(file);
                break;
            }
            Err(why) => found.passes.push((item, why)),
        }
    }
    let function = first_of_functions(&found, folder, out)?;
    if function.is_none() && pass.is_none() {
        if !found.are_none() || others.is_empty() {
            anyhow::bail!(found.told(folder));
        }
        writeln!(out, "{DIM}each function has a test already: none is written{DIM:#}")?;
    }
    // Of a pass that races its author wants to know, whatever else there is to test.
    for (item, why) in &found.passes {
        writeln!(out, "{KNOWN}no first test{KNOWN:#} of `{}`: {why}", item.name)?;
    }
    Ok(function.or(pass))
}

/// Writes a test of the first function for which one passes.
fn first_of_functions(
    found: &Functions<'_>,
    folder: &Path,
    out: &mut dyn Write,
) -> anyhow::Result<Option<PathBuf>> {
    for attempt in [Attempt::Names, Attempt::Away, Attempt::Table] {
        let candidates = if attempt == Attempt::Table { &found.others } else { &found.floats };
        // Functions with arguments show more.
        let has = |probed: &Probed| !probed.function().parameters.is_empty();
        let (with, without): (Vec<_>, Vec<_>) =
            candidates.iter().partition(|(_, probed)| has(probed));
        for (item, probed) in with.into_iter().chain(without).take(TRIED) {
            if let Some(file) = try_test(item, probed, attempt, folder)? {
                writeln!(out, "{GOOD}wrote{GOOD:#} {}, a test of `{}`", file.display(), item.name)?;
                return Ok(Some(file));
            }
        }
    }
    Ok(None)
}

/// Writes a test of a compute entry point beside its module. If none passes, why.
fn try_pass(
    package: &Package,
    item: &FunctionItem,
    folder: &Path,
) -> anyhow::Result<Result<PathBuf, String>> {
    let (_, file) = beside(item, folder);
    if file.exists() {
        return Ok(Err(format!("`{}` is there", file.display())));
    }
    let mut why = "it has resources that no size follows for, or writes none: `[[compute]]` in `*.test.toml` says \
                   what they hold"
        .to_owned();
    // Over some sizes no two invocations meet.
    if let Some(race) = race_in(package, &item.name) {
        return Ok(Err(format!("{race} (`karat hazards {}` says where)", folder.display())));
    }
    for text in pass::declarations(package, item) {
        match passes(item, Attempt::Names, &file, ("", &text), folder)? {
            Ok(()) => return Ok(Ok(file)),
            Err(other) => why = other,
        }
    }
    Ok(Err(why))
}

/// A race that a compute entry point has whatever its resources hold, in a line.
fn race_in(package: &Package, name: &str) -> Option<String> {
    let hazards = package.hazards().only([name]).run().ok()?;
    let mut races = hazards.faults().filter(|one| one.kind == Kind::Race && one.function == name);
    races.find_map(|one| Some(one.violation.as_ref()?.headline.clone()))
}

/// The entry points of some stages in a package.
fn entry_points(
    package: &Package,
    of: impl Fn(Stage) -> bool,
) -> anyhow::Result<Vec<FunctionItem>> {
    let modules = package.modules()?;
    let functions = modules.iter().filter_map(|module| package.functions_in(module).ok());
    Ok(functions.flatten().filter(|item| item.entry_point.is_some_and(&of)).collect())
}

/// A module's file without its extension, and that of its tests.
fn beside(item: &FunctionItem, folder: &Path) -> (PathBuf, PathBuf) {
    let (module, _) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let mut beside = folder.to_owned();
    beside.extend(module.split("::"));
    let file = PathBuf::from(format!("{}.test.toml", beside.display()));
    (beside, file)
}

/// Functions that have no test, by what a first test of them can be.
#[derive(Default)]
struct Functions<'i> {
    /// Those that return floats, alone or among others: they should be finite.
    floats: Vec<(&'i FunctionItem, Probed)>,
    /// Those that return integers or booleans alone: a table has what they return, exactly.
    others: Vec<(&'i FunctionItem, Probed)>,
    /// Those that read what a test has to bind.
    bound: Vec<&'i FunctionItem>,
    /// Those that can't be called, with why.
    refused: Vec<(&'i FunctionItem, String)>,
    /// Compute entry points whose first test doesn't pass, with why.
    passes: Vec<(&'i FunctionItem, String)>,
}

impl<'i> Functions<'i> {
    fn add(&mut self, package: &Package, item: &'i FunctionItem) {
        let probed = match Probed::new(package, &item.name) {
            Ok(probed) => probed,
            Err(error) => return self.refused.push((item, error.to_string())),
        };
        let function = probed.function();
        if !function.bindings.is_empty() {
            self.bound.push(item);
        } else if function.result.lanes().iter().any(|lane| lane.is_float()) {
            self.floats.push((item, probed));
        } else {
            self.others.push((item, probed));
        }
    }

    fn are_none(&self) -> bool {
        let Self { floats, others, bound, refused, .. } = self;
        floats.is_empty() && others.is_empty() && bound.is_empty() && refused.is_empty()
    }

    /// Says what was found, where no test passes.
    fn told(&self, folder: &Path) -> String {
        let named = |items: &mut dyn Iterator<Item = &FunctionItem>| {
            let names: Vec<&str> = items.map(|item| &*item.name).collect();
            let more = if names.len() > SHOWN { ", .." } else { "" };
            let first = names[..names.len().min(SHOWN)].join("`, `");
            (names.len(), format!("`{first}`{more}"))
        };
        let mut text = "no first test passes, so nothing is written".to_owned();
        let mut tell = |(count, names): (usize, String), what: &str| {
            if count > 0 {
                text += &format!("\n  {}: {what}: {names}", counted(count, "function"));
            }
        };
        let folder = folder.display();
        tell(
            named(&mut self.floats.iter().map(|(item, _)| *item)),
            &format!(
                "not finite for arguments that names and types suggest; `karat hazards {folder}` \
                 says why"
            ),
        );
        tell(
            named(&mut self.others.iter().map(|(item, _)| *item)),
            "returns no floats, and a table of its values on `cpu` isn't what it returns on the other paths",
        );
        tell(
            named(&mut self.bound.iter().copied()),
            "reads a binding, so its test says what that holds: `with = { name = .. }` in `*.test.toml`",
        );
        tell(
            named(&mut self.refused.iter().map(|(item, _)| *item)),
            "can't be called by a test; `karat call` says why",
        );
        for (item, why) in &self.passes {
            text += &format!("\n  `{}`: {why}", item.name);
        }
        text
    }
}

/// Names that a line shows.
const SHOWN: usize = 4;

/// How a first test of a function is made.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Attempt {
    /// It is finite for arguments that names and types suggest.
    Names,
    /// The same, where floats are from 0 to 1, or a step away from 0.
    Away,
    /// It returns what it returns now, as a table.
    Table,
}

/// Writes a test of a function beside its module. `None` if it doesn't pass: then nothing is left of it.
fn try_test(
    item: &FunctionItem,
    probed: &Probed,
    attempt: Attempt,
    folder: &Path,
) -> anyhow::Result<Option<PathBuf>> {
    let (_, name) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let (beside, file) = beside(item, folder);
    // That of a pass may be there.
    let before = match std::fs::read_to_string(&file) {
        Ok(text) => text + "\n",
        Err(none) if none.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(error).with_context(|| format!("`{}`", file.display())),
    };
    let function = probed.function();
    if attempt == Attempt::Table {
        let table = beside.with_file_name(format!("{name}.csv"));
        if table.exists() || !write_table(item, probed, folder, &table)? {
            return Ok(None);
        }
        let text = format!(
            "# {function}\n[[test]]\nfunction = \"{name}\"\n# What it returned when this was written, on `cpu`: \
             correct what is wrong, and add rows of your own.\ntable = \"{name}.csv\"\ntolerance = \"exact\"\n"
        );
        let written = passes(item, attempt, &file, (&before, &text), folder)?.is_ok();
        if !written {
            std::fs::remove_file(&table).with_context(|| format!("`{}`", table.display()))?;
        }
        return Ok(written.then_some(file));
    }
    let float = |shape: &Shape| matches!(shape, Shape::Scalar(scalar) if scalar.is_float());
    let numbers = function.parameters.iter().filter(|(_, shape)| float(shape));
    let numbers: Vec<&str> = numbers.map(|(name, _)| name.as_str()).collect();
    let over: Vec<String> = match attempt {
        Attempt::Away if numbers.is_empty() => return Ok(None),
        Attempt::Away => RANGES
            .iter()
            .map(|range| {
                let over = numbers.iter().map(|name| format!("{name} = \"{range}\""));
                format!(
                    "# Where arguments come from; what isn't named comes from its name and type. Over all that names \
                     and types allow\n# some results are NaN or infinite: `karat hazards` shows them.\nover = {{ {} }}\n",
                    over.collect::<Vec<_>>().join(", ")
                )
            })
            .collect(),
        _ => {
            let is_of_floats = |shape: &Shape| shape.lanes().iter().all(|lane| lane.is_float());
            let mut own = function.parameters.iter().filter(|(_, shape)| is_of_floats(shape));
            let line = own.next().map_or_else(String::new, |(name, _)| {
                format!(
                    "# Where arguments come from; what isn't named comes from its name and type:\n\
                     # over = {{ {name} = \"0..1\" }}\n"
                )
            });
            vec![line]
        }
    };
    for over in over {
        for assertion in ["in_range = [0, 1]\n", ""] {
            let text = format!(
                "# {function}\n[[test]]\nfunction = \"{name}\"\n{over}finite = true\n{assertion}"
            );
            if passes(item, attempt, &file, (&before, &text), folder)?.is_ok() {
                return Ok(Some(file));
            }
        }
    }
    Ok(None)
}

/// Writes a test behind what a file holds, and removes it if it doesn't pass: then why it doesn't.
fn passes(
    item: &FunctionItem,
    attempt: Attempt,
    file: &Path,
    (before, text): (&str, &str),
    folder: &Path,
) -> anyhow::Result<Result<(), String>> {
    std::fs::write(file, format!("{before}{text}"))
        .with_context(|| format!("`{}`", file.display()))?;
    let mut command = this()?;
    command.arg("suite").arg(folder).arg(&item.name);
    // A table of what `cpu` returns holds on the other paths, too.
    if attempt != Attempt::Table {
        command.env("KARAT_PATHS", "cpu");
    }
    // What a test that is thrown away fails on isn't to be remembered.
    command.env("KARAT_FAILURES", "off");
    let record = tempfile::tempdir().context("a temporary folder")?;
    command.env("KARAT_RECORD", record.path());
    command.stdout(Stdio::null()).stderr(Stdio::null());
    let passes = command.status().is_ok_and(|status| status.success());
    if !passes {
        match before {
            "" => std::fs::remove_file(file),
            before => std::fs::write(file, before.trim_end().to_owned() + "\n"),
        }
        .with_context(|| format!("`{}`", file.display()))?;
        let faults = record::read(record.path())?.into_iter().filter_map(|one| one.fault);
        let first = faults.map(|fault| fault.headline).next();
        let told = |first| {
            format!(
                "over the resources that it makes up, {first} (`karat hazards {} --all` says where)",
                folder.display()
            )
        };
        return Ok(Err(first.map_or_else(|| "it can't be run by a test".to_owned(), told)));
    }
    Ok(Ok(()))
}

/// Writes a table of what a function returns for some arguments, each of which has small and large ones.
/// False if it can't be called.
fn write_table(
    item: &FunctionItem,
    probed: &Probed,
    folder: &Path,
    table: &Path,
) -> anyhow::Result<bool> {
    /// Rows of a table: what a person looks through.
    const ROWS: usize = 8;
    let function = probed.function();
    let columns = function.parameters.iter().flat_map(|(name, shape)| {
        let names = shape.lane_names().into_iter().map(move |lane| format!("{name}{lane}"));
        names.zip(shape.lanes())
    });
    let columns: Vec<(String, Scalar)> = columns.collect();
    if columns.is_empty() {
        return Ok(false);
    }
    let cell = |row: usize, column: usize, scalar: Scalar| {
        // Neighbouring columns have other values in a row.
        let at = (row + 3 * column) % ROWS;
        match scalar {
            Scalar::Bool => ["false", "true"][(row >> (column % 3)) % 2],
            Scalar::U32 => ["0", "1", "2", "3", "7", "64", "255", "65535"][at],
            Scalar::I32 => ["0", "1", "-1", "2", "7", "-8", "64", "255"][at],
            _ => ["0", "1", "0.25", "0.5", "0.75", "2", "-1", "10"][at],
        }
    };
    let names: Vec<&str> = columns.iter().map(|(name, _)| &**name).collect();
    let mut text = names.join(",") + "\n";
    for row in 0..ROWS {
        let cells = columns.iter().enumerate().map(|(at, (_, scalar))| cell(row, at, *scalar));
        text += &(cells.collect::<Vec<_>>().join(",") + "\n");
    }
    let arguments =
        tempfile::NamedTempFile::new().context("there is no room for temporary files")?;
    std::fs::write(arguments.path(), text).context("there is no room for temporary files")?;
    let mut command = this()?;
    command.args(["call", &item.name, "--path", "cpu", "--hex", "--table"]).arg(arguments.path());
    let ran = command.arg("--shaders").arg(folder).stderr(Stdio::null()).output();
    let Some(output) = ran.ok().filter(|ran| ran.status.success()) else { return Ok(false) };
    let called = String::from_utf8_lossy(&output.stdout);
    // Columns of results are called after the path there, and `result` in a test's table.
    let head = called.lines().next().unwrap_or_default();
    let renamed = head.split(',').map(|column| match column.strip_prefix("cpu") {
        Some(lane) if !names.contains(&column) => format!("result{lane}"),
        _ => column.to_owned(),
    });
    let renamed = renamed.collect::<Vec<_>>().join(",");
    let rows = called.strip_prefix(head).unwrap_or_default();
    std::fs::write(table, renamed + rows).with_context(|| format!("`{}`", table.display()))?;
    Ok(true)
}

/// Functions that have tests: in the last run, or by their names in the Rust files of `tests`.
struct Tested {
    ran: BTreeSet<String>,
    texts: Vec<String>,
}

impl Tested {
    /// Whether there is a test of Karat's.
    fn any(&self) -> bool {
        !self.ran.is_empty() || self.texts.iter().any(|text| text.contains("karat"))
    }

    fn is(&self, function: &str) -> bool {
        let named = format!("\"{function}\"");
        self.ran.contains(function) || self.texts.iter().any(|text| text.contains(&named))
    }
}

/// What Rust tests of the project check.
fn tested(folder: &Path) -> anyhow::Result<Tested> {
    let folder = folder.canonicalize()?;
    let project = Project::around(&folder)?;
    let mut texts = Vec::new();
    // In a workspace tests are in the member's folder.
    for around in folder.ancestors().take_while(|around| around.starts_with(project.root())) {
        read_rust(&around.join("tests"), &mut texts);
    }
    // Without Cargo all tests stand beside the modules, and there are none: a record is of tests that are gone.
    let ran = if project.is_cargo() { tested_functions(&project)? } else { BTreeSet::new() };
    Ok(Tested { ran, texts })
}

/// The Rust files below a folder. What can't be read says nothing.
fn read_rust(folder: &Path, texts: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            read_rust(&path, texts);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            texts.extend(std::fs::read_to_string(path));
        }
    }
}

/// Adds to `.gitignore` what runs leave behind.
fn ignore(out: &mut dyn Write) -> anyhow::Result<()> {
    let file = Path::new(".gitignore");
    let mut text = text_of(file)?.unwrap_or_default();
    let missing: Vec<&str> = IGNORED
        .into_iter()
        // `.karat/` has the folder of runs in it.
        .filter(|line| {
            let whole = [".karat/", "**/.karat/"];
            let covers =
                |known: &str| known == *line || whole.contains(&known) && *line == IGNORED[0];
            !text.lines().any(|known| covers(known.trim()))
        })
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    if !text.is_empty() && !text.ends_with('\n') {
        text.push('\n');
    }
    for line in &missing {
        text += line;
        text.push('\n');
    }
    std::fs::write(file, text).context("`.gitignore`")?;
    writeln!(out, "{GOOD}added{GOOD:#} {} to .gitignore", missing.join(", "))?;
    Ok(())
}

/// Has Cargo optimise what tests wait for, in a project that depends on Karat. A level that somebody chose
/// stays.
fn optimise(folder: &Path, out: &mut dyn Write) -> anyhow::Result<()> {
    let project = Project::around(&folder.canonicalize()?)?;
    let file = project.root().join("Cargo.toml");
    let unoptimised = unoptimised(project.root());
    if unoptimised.is_empty() {
        return Ok(());
    }
    let mut text = std::fs::read_to_string(&file).context("`Cargo.toml`")?;
    let table: toml::Table = text.parse().context("`Cargo.toml`")?;
    let profiles = || table.get("profile")?.get("dev")?.get("package");
    let mut added = Vec::new();
    let levels = unoptimised.iter().map(|one| (one.name, Some(one.recommended)));
    for (name, level) in levels.chain([("karat", None)]) {
        if profiles().is_some_and(|profiles| profiles.get(name).is_some()) {
            continue;
        }
        if !text.ends_with('\n') {
            text.push('\n');
        }
        // With what debuggers read the first build would take a third longer.
        let level = level.map_or_else(String::new, |level| format!("opt-level = {level}\n"));
        text += &format!("\n[profile.dev.package.{name}]\n{level}debug = false\n");
        added.push(name);
    }
    // Tables may be written in a way that takes no more of them: then `karat doctor` says what is missing.
    if added.is_empty() || text.parse::<toml::Table>().is_err() {
        return Ok(());
    }
    std::fs::write(&file, text).context("`Cargo.toml`")?;
    writeln!(out, "{GOOD}added{GOOD:#} profiles of {} to Cargo.toml", added.join(", "))?;
    Ok(())
}

/// Writes a file for CI unless it is there.
fn keep(file: &Path, text: &str, out: &mut dyn Write) -> anyhow::Result<()> {
    if file.exists() {
        return Ok(writeln!(out, "{DIM}{} is there already: not written{DIM:#}", file.display())?);
    }
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("`{}`", folder.display()))?;
    }
    std::fs::write(file, text).with_context(|| format!("`{}`", file.display()))?;
    writeln!(out, "{GOOD}wrote{GOOD:#} {}", file.display())?;
    let hint = "write the address of your copy of Karat into it: Karat isn't released yet";
    Ok(writeln!(out, "  {KNOWN}{hint}{KNOWN:#}")?)
}

fn with_folder(template: &str, folder: &Path) -> String {
    // A Cargo project has Rust tests, too, and their records are with what it builds.
    if Path::new("Cargo.toml").is_file() {
        return template.replace(" SHADERS", "").replace("**/.karat/run", "target/karat");
    }
    template.replace("SHADERS", &folder.display().to_string().replace('\\', "/"))
}
