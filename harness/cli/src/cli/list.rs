//! `karat list`

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::ensure;
use karat::Package;
use karat::package::PackageError;
use karat::unstable::diagnostic::shown;
use karat::unstable::package::FunctionItem;
use karat::unstable::record::{self, Run, Subject};
use karat::unstable::reflect::{Program, ReflectError};
use karat_suite::{Broken, Suite, Test, Wrong};
use serde::Serialize;

use super::project::Project;
use super::report::Place;
use super::search;
use super::table::{BAD, DIM, GOOD, PLAIN, Table};
use super::{Ending, Outcome, PlaceArgs, resolved, write_json};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Lists the tests beside the shaders, in place of functions
    #[arg(long)]
    tests: bool,
    /// Prints JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    place: PlaceArgs,
}

/// The largest number of functions that Karat reads one by one in an invalid module. Each function takes a few
/// milliseconds.
const MOST_ALONE: usize = 200;

#[derive(Serialize)]
struct Entry {
    package: String,
    function: String,
    location: String,
    signature: Option<String>,
    doc: String,
    /// `true` if the last `karat test` checked the function.
    tested: bool,
    /// The reason why a test can't call the function.
    error: Option<String>,
}

/// A test beside the shaders, or an unreadable file of tests.
#[derive(Serialize)]
struct TestEntry {
    package: PathBuf,
    name: String,
    file: PathBuf,
    /// The line of the test. Lines and columns count from 1.
    line: u32,
    column: u32,
    /// The reason why the test isn't valid.
    error: Option<Wrong>,
}

/// Lists the tests of packages: functions with `@test`, and tests in `*.test.toml`.
fn list_tests(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let mut all: Vec<TestEntry> = Vec::new();
    for package in project.packages(&args.place.package())? {
        let (suite, root) = (Suite::of(package.clone())?, resolved(&package.root()));
        let mut add = |name: &str, place: Option<String>, error: Option<&Wrong>| {
            let whole = || Place { file: name.to_owned(), line: 1, column: 1 };
            let place = place.as_deref().and_then(Place::of).unwrap_or_else(whole);
            all.push(TestEntry {
                package: root.clone(),
                name: name.to_owned(),
                file: resolved(Path::new(&place.file)),
                line: place.line,
                column: place.column,
                error: error.cloned(),
            });
        };
        suite.tests.iter().for_each(|test| add(&test.name, Some(test.span.to_string()), None));
        for Broken { name, wrong, .. } in &suite.broken {
            add(name, wrong.place.clone(), Some(wrong));
        }
    }
    ensure!(!all.is_empty(), "there is no test beside the shaders: run `karat init`");
    let good = all.iter().all(|one| one.error.is_none());
    match args.json {
        true => write_json(&all, out)?,
        false => {
            for TestEntry { name, file, line, column, error, .. } in &all {
                let (style, more) = match error {
                    Some(wrong) => (BAD, format!(": {}", wrong.headline)),
                    None => (PLAIN, String::new()),
                };
                writeln!(out, "{}:{line}:{column} {style}{name}{style:#}{more}", shown(file))?;
            }
            args.place.write_outside(out)?;
        }
    }
    Ok(if good { Ending::Good } else { Ending::Bad })
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if args.tests {
        return list_tests(args, out);
    }
    let project = Project::last_tested()?;
    let ran = tested_functions(&project)?;
    let mut entries = Vec::new();
    let mut valid = true;
    let packages = project.packages(&args.place.package())?;
    let no_tests = search::broken_files(&packages)?;
    for package in packages {
        let tested = with_called(&package, &ran);
        for module in package.modules()? {
            // An invalid module doesn't hide the other modules.
            match Program::of_module(&package, &module) {
                Ok(program) => {
                    let items = package.functions_in(&module)?;
                    entries.extend(
                        items.into_iter().map(|item| entry(&package, &program, item, &tested)),
                    );
                }
                // The error belongs to the package, not to this module.
                Err(ReflectError::Package(error @ PackageError::UnknownFeature { .. })) => {
                    return Err(error.into());
                }
                Err(error) => {
                    valid = false;
                    let sound = sound(&package, &module, &tested);
                    if !sound.iter().any(|entry| entry.error.is_some()) {
                        entries.push(broken(&package, module, &error));
                    }
                    entries.extend(sound);
                }
            }
        }
    }
    ensure!(!entries.is_empty(), "the packages have no functions");
    let good = valid && no_tests.is_empty();
    let verdict = if good { Ending::Good } else { Ending::Bad };
    if args.json {
        entries.extend(no_tests.into_iter().map(no_test));
        write_json(&entries, out)?;
        return Ok(verdict);
    }
    // A filtered run skips functions that may have tests.
    let selected = last_selection(&project)?;
    let untested = if selected.is_some() { "not last time" } else { "no" };
    let mut table = Table::new(&["function", "tested", "at"], &[]);
    for entry in &entries {
        let (style, state) = match (entry.tested, &entry.error) {
            (_, Some(_)) => (BAD, "can't be called"),
            (true, None) => (GOOD, "yes"),
            (false, None) => (DIM, untested),
        };
        let name = entry.signature.as_ref().unwrap_or(&entry.function).clone();
        table.row(style, vec![name, state.to_owned(), entry.location.clone()]);
    }
    table.write(out)?;
    if let Some(selected) = selected {
        writeln!(
            out,
            "{DIM}the last run ran only the tests that `{selected}` selects: `karat test` runs all tests{DIM:#}"
        )?;
    }
    for error in entries.iter().filter_map(|entry| entry.error.as_ref()) {
        writeln!(out, "\n{error}")?;
    }
    search::write_broken(&no_tests, out)?;
    args.place.write_outside(out)?;
    Ok(verdict)
}

/// Returns the entry of an unreadable file of tests.
fn no_test(Broken { name, wrong: Wrong { message, .. }, .. }: Broken) -> Entry {
    Entry {
        package: String::new(),
        location: name.clone(),
        function: name,
        signature: None,
        doc: String::new(),
        tested: false,
        error: Some(message),
    }
}

/// Returns the functions that a test can call: all functions of readable modules except entry points. Unreadable
/// modules are left out, because validation reports them.
pub(super) fn callable(package: &Package) -> anyhow::Result<Vec<FunctionItem>> {
    let modules = package.modules()?;
    let functions = modules.iter().filter_map(|module| package.functions_in(module).ok());
    Ok(functions.flatten().filter(|item| item.entry_point.is_none()).collect())
}

fn entry(
    package: &Package,
    program: &Program,
    item: FunctionItem,
    tested: &BTreeSet<String>,
) -> Entry {
    // A function that is read without its module has variables in place of texture parameters.
    let whole = program.function(&item.name);
    let whole = whole.map(|function| (program.signature(&function), function.doc));
    let described = whole.or_else(|_: ReflectError| described_alone(package, &item.name));
    of_function(package, item, described, tested)
}

/// Returns the signature of a function and the comment above it. Reads only the function and its dependencies.
fn described_alone(package: &Package, name: &str) -> Result<(String, String), ReflectError> {
    let program = Program::of_function(package, name)?;
    let function = program.function(name)?;
    Ok((program.signature(&function), function.doc))
}

fn of_function(
    package: &Package,
    item: FunctionItem,
    described: Result<(String, String), ReflectError>,
    tested: &BTreeSet<String>,
) -> Entry {
    let stage = item.entry_point;
    let (signature, doc, error) = match (described, stage) {
        (Ok((signature, doc)), _) => (Some(signature), doc, None),
        // A driver can still run such an entry point: it discards, or returns nothing.
        (Err(ReflectError::Unprobeable(_)), Some(stage)) => {
            (Some(format!("@{stage} {}", item.name)), String::new(), None)
        }
        (Err(error), _) => (None, String::new(), Some(error.to_string())),
    };
    Entry {
        package: package.name(),
        location: item.span.to_string(),
        tested: tested.contains(&item.name),
        function: item.name,
        signature,
        doc,
        error,
    }
}

/// Reads the functions of an invalid module one by one, and returns their entries. Returns no entries if the module has
/// more than [`MOST_ALONE`] functions.
fn sound(package: &Package, module: &str, tested: &BTreeSet<String>) -> Vec<Entry> {
    let items = package.functions_in(module).unwrap_or_default();
    if items.len() > MOST_ALONE {
        return Vec::new();
    }
    let alone = |item: FunctionItem| {
        let described = described_alone(package, &item.name);
        of_function(package, item, described, tested)
    };
    items.into_iter().map(alone).collect()
}

/// Returns the entry of a module that can't be read, linked or validated.
fn broken(package: &Package, module: String, error: &ReflectError) -> Entry {
    Entry {
        package: package.name(),
        function: module,
        location: String::new(),
        signature: None,
        doc: String::new(),
        tested: false,
        error: Some(error.to_string()),
    }
}

/// Returns all functions with tests: the functions that a test checks, calls or draws with, and the entry points of all
/// passes that a test runs.
fn with_called(package: &Package, ran: &BTreeSet<String>) -> BTreeSet<String> {
    let suite = Suite::of(package.clone()).ok();
    let tests = || suite.iter().flat_map(|suite| &suite.tests);
    let have_run = || tests().filter(|test| ran.contains(&test.name));
    let called = have_run().flat_map(Test::calls).map(str::to_owned);
    let drawn = have_run().flat_map(Test::draws);
    let of_ran = |test: &&Test| test.dispatches().last().is_some_and(|last| ran.contains(last));
    let dispatched = tests().filter(of_ran).flat_map(Test::dispatches);
    let dispatched = dispatched.map(str::to_owned);
    called.chain(drawn).chain(dispatched).chain(ran.iter().cloned()).collect()
}

/// If the last run skipped tests, returns the arguments that selected its tests: a filter, packages or targets.
fn last_selection(project: &Project) -> anyhow::Result<Option<String>> {
    let folder = project.output().join("record");
    let run = if folder.is_dir() { Run::read(&folder)? } else { None };
    Ok(run.map(|run| run.selected.join(" ")).filter(|selected| !selected.is_empty()))
}

/// Returns the functions that the last run checked, and the names of the tests that drew frames. Returns an empty set
/// if there was no run.
pub(super) fn tested_functions(project: &Project) -> anyhow::Result<BTreeSet<String>> {
    let folder = project.output().join("record");
    let records = if folder.is_dir() { record::read(&folder)? } else { Vec::new() };
    let functions = records
        .into_iter()
        .filter(|record| record.overlay.is_none())
        .map(|record| match record.subject {
            Subject::Function { function, .. } => function,
            Subject::Frame { .. } => record.test,
        })
        .collect();
    Ok(functions)
}
