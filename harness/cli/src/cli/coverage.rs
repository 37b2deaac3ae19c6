//! `karat coverage`

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::image::write_whole;
use karat::unstable::interpret::{Ran, statements_of};
use karat::unstable::output::{counted, tell};
use karat::unstable::reflect::Program;
use karat_suite::Suite;
use tempfile::TempDir;

use super::git::lines_since;
use super::project::{Project, tests_beside};
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN, Table};
use super::{Ending, Outcome, PlaceArgs, child, suite, write_json};

mod html;
mod lcov;
mod union;

use self::union::{Sum, Union};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Runs only tests whose names contain this text
    #[arg(long, value_name = "FILTER")]
    tests: Option<String>,
    /// Lists the lines that no test runs, and the outcomes that a branch never had
    #[arg(long)]
    missing: bool,
    /// Counts only lines that changed since your branch left this revision of git, such as `main`
    #[arg(long, value_name = "REVISION")]
    in_diff: Option<String>,
    /// Fails if the tests ran less than this share of the measured lines, in per cent
    #[arg(long, value_name = "PERCENT", value_parser = super::percent)]
    fail_under_lines: Option<f64>,
    /// Writes an LCOV tracefile to this file, with a record for each test
    #[arg(long, value_name = "FILE")]
    lcov: Option<PathBuf>,
    /// Writes an HTML page to this file; a click on a line shows the tests and inputs that run it
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Prints JSON
    #[arg(long, conflicts_with = "missing")]
    json: bool,
    /// Runs the tests on these paths; only the path `cpu` counts lines
    #[arg(long, value_name = "PATHS", default_value = "cpu")]
    paths: String,
    #[command(flatten)]
    place: PlaceArgs,
    /// More arguments for `karat test`
    #[arg(last = true, value_name = "ARGUMENTS")]
    more: Vec<String>,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let paths = karat::unstable::path::named("--paths", &args.paths)?;
    let is_engine = |path: &karat::Path| path.api() == karat::unstable::path::Api::Cpu;
    ensure!(
        paths.iter().any(is_engine),
        "--paths `{}` doesn't include `cpu`, the only path that counts lines: add `cpu` to --paths",
        args.paths
    );
    let project = Project::find()?;
    // Karat reports wrong arguments before it runs the tests.
    let mut packages = project.packages(&args.place.package())?;
    let mut changed = BTreeMap::new();
    for package in &packages {
        if let Some(revision) = &args.in_diff {
            changed.extend(lines_since(revision, &package.root())?);
        }
    }
    let folder = tempfile::tempdir().context("can't make a temporary folder")?;
    let only_engine = paths.iter().all(is_engine);
    let (passed, folder) = tests(args, folder, only_engine)?;
    let ran = Ran::all(folder.path()).context("can't read the line counts of the tests")?;
    ensure!(!ran.is_empty(), "no test ran a shader on the path `cpu`, so Karat counted no lines");
    let used = ran.iter().flat_map(|ran| &ran.statements).map(|one| one.file.as_path());
    let used: BTreeSet<_> = used.collect();
    if args.place.package().package.is_none() {
        // As in `karat test`, a folder of shaders counts only if a test uses it.
        let is_used = |package: &Package| {
            let root = std::path::absolute(package.root()).unwrap_or_else(|_| package.root());
            used.iter().any(|file| file.starts_with(&root))
        };
        packages.retain(is_used);
    }
    let (mut union, mut invalid) = (Union::default(), Vec::new());
    for package in &packages {
        invalid.extend(add(&mut union, package, only_engine)?);
    }
    ran.iter().for_each(|ran| union.run(ran));
    if args.in_diff.is_some() {
        union.keep_lines(&changed);
    }
    let sum = union.sum();
    if let Some(file) = &args.lcov {
        write_whole(file, lcov::written(&union).as_bytes())
            .with_context(|| format!("can't write `{}`", file.display()))?;
    }
    if let Some(file) = &args.html {
        write_whole(file, html::page(&union)?.as_bytes())
            .with_context(|| format!("can't write `{}`", file.display()))?;
    }
    let least = args.fail_under_lines.unwrap_or_default();
    // An edit of other files than shaders has nothing to measure.
    let enough = match sum.percent() {
        Some(percent) => percent >= least,
        None => args.in_diff.is_some(),
    };
    let good = passed && enough;
    let tests: BTreeSet<&str> = ran.iter().map(|ran| &*ran.test).collect();
    let short = (!enough).then_some(least);
    let mut parts = parts(&sum, tests.len(), &invalid, passed, short);
    parts.extend(tests_beside(&packages));
    if args.json {
        write_json(&union.as_json(), out)?;
        tell(&parts.join("; "));
    } else if let (Some(revision), 0, true) = (&args.in_diff, sum.lines, passed) {
        writeln!(out, "{DIM}no line of a shader has changed since {revision}{DIM:#}")?;
    } else {
        write_files(&union, out)?;
        write_variants(&union, out)?;
        if args.missing {
            write_missing(&union, out)?;
        }
        let style = if good { GOOD } else { BAD };
        writeln!(out, "{style}{}{style:#}", parts.join("; "))?;
    }
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// Returns the phrases of the last line of output: the coverage, and the code that isn't counted or checked. If the
/// coverage is lower than an option requires, `short` is the required percentage.
fn parts(
    sum: &Sum,
    tests: usize,
    invalid: &[String],
    passed: bool,
    short: Option<f64>,
) -> Vec<String> {
    let mut parts = vec![format!("{sum} by {}", counted(tests, "test"))];
    if sum.weak > 0 {
        let lines = counted(sum.weak, "line");
        parts.push(format!("no test checks the value of {lines}"));
    }
    if sum.unmeasured > 0 {
        let lines = counted(sum.unmeasured, "line");
        parts.push(format!("{lines} not measured: this code ran only in frames or on drivers"));
    }
    if !invalid.is_empty() {
        let invalid: Vec<&str> = invalid.iter().map(String::as_str).collect();
        let named = super::test::some(&invalid);
        parts.push(format!("{} not valid: {named}", counted(invalid.len(), "module")));
    }
    if !passed {
        parts.push("tests failed, see above: code after a failed check isn't counted".to_owned());
    }
    parts.extend(short.map(|least| format!("the options require that {least}% of lines run")));
    parts
}

/// Runs the tests, and checks if they passed. The tests' output goes to standard error, so that standard output has
/// only the coverage.
fn tests(args: &Args, folder: TempDir, only_engine: bool) -> anyhow::Result<(bool, TempDir)> {
    let program = std::env::current_exe().context("can't find karat's executable file")?;
    let mut command = Command::new(program);
    let place = args.place.package();
    command.arg("test").args(&place.package).args(&args.tests);
    for feature in suite::written(&place.features) {
        command.args(["--feature", &feature]);
    }
    command.args(&args.more).stdout(Stdio::from(std::io::stderr()));
    command.env("KARAT_PATHS", &args.paths).env("KARAT_COVERAGE", folder.path());
    for setting in ["KARAT_REQUIRE", "KARAT_RECORD", "KARAT_CASE", "KARAT_INPUT"] {
        command.env_remove(setting);
    }
    command.envs(only_engine.then_some(("KARAT_FRAMES", "off")));
    let (status, folder) =
        child::status_over(&mut command, folder).context("can't run the tests")?;
    match status.code() {
        Some(0) => Ok((true, folder)),
        Some(1) => Ok((false, folder)),
        // The tests have already printed the reason.
        Some(2 | 3) => Err(super::Reported.into()),
        _ => anyhow::bail!("the tests ended without a result ({status})"),
    }
}

/// Adds the statements of a package to `union`. Returns the names of the package's invalid modules, whose statements
/// Karat can't count.
fn add(union: &mut Union, package: &Package, no_frames: bool) -> anyhow::Result<Vec<String>> {
    let suite = Suite::of(package.clone())?;
    let tests: BTreeSet<&str> = suite.tests.iter().map(|test| &*test.name).collect();
    let mut invalid = Vec::new();
    for module in package.modules()? {
        match Program::of_module(package, &module) {
            // Test functions don't count.
            Ok(program) => union.add(
                &package.root(),
                statements_of(&program).into_iter().filter(|one| !tests.contains(&*one.function)),
            ),
            // The output of the tests has the reason.
            Err(_) => invalid.push(module),
        }
    }
    union.leave_out(tests.iter().map(|test| (*test).to_owned()));
    // If the tests drew no frames, the functions that only frames call aren't measured.
    for test in suite.tests.iter().filter(|test| no_frames && test.is_frame()) {
        for entry in test.draws() {
            let (module, own) = entry.rsplit_once("::").unwrap_or(("", &entry));
            let Ok(program) = Program::of_items(package, module, &[own]) else { continue };
            let mut statements = statements_of(&program);
            statements.iter_mut().for_each(|one| one.count = None);
            union.run(&Ran { test: test.name.clone(), variant: String::new(), statements });
        }
    }
    Ok(invalid)
}

fn write_files(union: &Union, out: &mut dyn Write) -> std::io::Result<()> {
    let head = ["file", "lines", "outcomes", "functions", "not run", "not checked", "not measured"];
    let mut table = Table::new(&head, &[1, 2, 3, 4, 5, 6]).leaving(&[3, 5, 6]);
    for (file, own) in union.files() {
        let sum = own.sum();
        let style = if sum.ran == sum.lines && sum.taken == sum.ways { GOOD } else { BAD };
        let counts = [sum.lines - sum.unmeasured - sum.ran, sum.weak, sum.unmeasured];
        let shares = [
            Sum::share(sum.ran, sum.lines - sum.unmeasured),
            Sum::share(sum.taken, sum.ways),
            Sum::share(sum.called, sum.functions),
        ];
        let cells = shares.into_iter().chain(counts.map(|count| count.to_string()));
        table.row(style, [shown(file)].into_iter().chain(cells).collect());
    }
    table.write(out)?;
    writeln!(out)
}

/// Prints the number of lines that ran in each variant, if there are several variants. The shaders have a variant for
/// each set of features that the tests use.
fn write_variants(union: &Union, out: &mut dyn Write) -> std::io::Result<()> {
    let variants = union.variants();
    if variants.len() < 2 {
        return Ok(());
    }
    let mut table = Table::new(&["variant", "lines run", "only by it"], &[1, 2]);
    for (variant, lines, alone) in variants {
        let name = if variant.is_empty() { "no feature" } else { variant };
        table.row(DIM, vec![name.to_owned(), lines.to_string(), alone.to_string()]);
    }
    table.write(out)?;
    writeln!(out)
}

fn write_missing(union: &Union, out: &mut dyn Write) -> std::io::Result<()> {
    for (file, own) in union.files() {
        let missing = own.missing();
        if !missing.is_empty() {
            writeln!(out, "{HEAD}{}{HEAD:#}", shown(file))?;
        }
        for (lines, why, is_gap) in missing {
            let style = if is_gap { BAD } else { KNOWN };
            let place = match lines {
                [first, last] if first == last => format!("{first}"),
                [first, last] => format!("{first}-{last}"),
            };
            writeln!(out, "{style}{place:>9}{style:#} {why}")?;
        }
    }
    Ok(())
}
