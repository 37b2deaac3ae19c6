//! `karat init`: writes a first test, runs it, and adds settings, such as lines of `.gitignore`.

mod npm;
mod pass;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::output::counted;
use karat::unstable::package::FunctionItem;
use karat::unstable::probe::Probed;
use karat::unstable::record::Recorded;
use karat::unstable::reflect::{Program, Stage};
use karat::unstable::value::Shape;

use super::doctor::profile::unoptimised;
use super::goldens::CiArgs;
use super::list::{callable, tested_functions};
use super::project::{self, Project, text_of};
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN};
use super::{Ending, Outcome, PackageArgs, check};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder of shaders [default: the first folder that `karat test` finds, such as `shaders`, else the working
    /// directory]
    folder: Option<PathBuf>,
    /// Writes a workflow for GitHub Actions
    #[arg(long)]
    github: bool,
    /// Writes a pipeline for GitLab
    #[arg(long)]
    gitlab: bool,
    #[command(flatten)]
    ci: CiArgs,
}

/// The lines of `.gitignore` for the files that runs write.
const IGNORED: [&str; 4] = ["**/.karat/run/", "*.new.exr", "*.new.csv", "*.new.png"];

const GITHUB: &str = include_str!("init/github.yml");
const GITLAB: &str = include_str!("init/gitlab.yml");
const GITLAB_FILE: &str = ".gitlab-ci.karat.yml";

/// Lines of the CI files, each with its replacement for a project whose `package.json` depends on Karat.
const BY_NPM: [(&str, &str); 4] = [
    ("      # Karat isn't on crates.io yet: write the address of your copy of Karat.\n", ""),
    ("    # Karat isn't on crates.io yet: write the address of your copy of Karat.\n", ""),
    (
        "      - run: cargo install --locked --git https://example.org/karat karat-cli\n      - run: karat",
        "      - uses: actions/setup-node@v4\n        with:\n          node-version: 22\n      - run: npm ci\n      - run: npx karat",
    ),
    (
        "    - cargo install --locked --git https://example.org/karat karat-cli\n    - karat",
        "    - npm ci\n    - npx karat",
    ),
];

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
    if !valid {
        writeln!(out, "{DIM}the tests of these modules fail until you correct the modules{DIM:#}")?;
    }
    let mut items = callable(&package)?;
    // Karat calls fragment and vertex functions as it calls any other function.
    items.extend(entry_points(&package, |stage| stage != Stage::Compute)?);
    let mut passes = entry_points(&package, |stage| stage == Stage::Compute)?;
    if !valid {
        let is_whole = |item: &FunctionItem| {
            let (module, _) = item.name.rsplit_once("::").unwrap_or_default();
            Program::of_module(&package, module).is_ok()
        };
        items.retain(is_whole);
        passes.retain(is_whole);
        ensure!(!items.is_empty() || !passes.is_empty(), "correct the invalid modules first");
    }
    ensure!(
        !items.is_empty() || !passes.is_empty(),
        "`{}` has no function and no entry point: write a function, and run `karat init` again",
        folder.display()
    );
    // If a project with Rust tests asks for a workflow, it gets only the workflow.
    let is_cargo = Project::around(&folder.canonicalize()?)?.is_cargo();
    // This step comes first: if Karat can't write a test, it must write no other file.
    let written = if (args.github || args.gitlab) && is_cargo && tested(&folder)?.any() {
        writeln!(out, "{DIM}Karat writes no test, because the project has tests in Rust{DIM:#}")?;
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
        keep(Path::new(GITLAB_FILE), &with_folder(GITLAB, &folder), out)?;
    }
    let good = run_tests(&folder, out)?;
    if let (false, true, Some(file)) = (good, valid, &written) {
        writeln!(
            out,
            "\n{BAD}the first test fails{BAD:#}: correct the function, or write in {} which inputs your program passes to the function",
            file.display()
        )?;
    }
    let folder = folder.display();
    writeln!(out, "\n{HEAD}what to do next{HEAD:#}")?;
    writeln!(
        out,
        "  karat watch {folder}     runs the tests after each edit: break a function to see a failure"
    )?;
    writeln!(out, "  karat hazards {folder}   lists operations that can go wrong, without a test")?;
    match written {
        Some(file) => writeln!(
            out,
            "  {}   can contain more assertions: agrees_with, table, monotone, limit, ...",
            file.display()
        )?,
        None => writeln!(
            out,
            "  *.test.toml   can contain more assertions: agrees_with, table, monotone, limit, ..."
        )?,
    }
    if !args.github && !args.gitlab {
        writeln!(
            out,
            "  karat init --github (or --gitlab)   writes a workflow that runs the same tests in CI, on Mesa's lavapipe"
        )?;
    }
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// Returns an error if the folder is inside a package with a karat.toml.
fn expect_no_package_around(folder: &Path) -> anyhow::Result<()> {
    let (whole, here) = (folder.canonicalize()?, Path::new(".").canonicalize()?);
    let around = whole.ancestors().skip(1).take_while(|around| around.starts_with(&here));
    let mut packages = around.filter(|around| around.join(project::MANIFEST).is_file());
    match packages.next() {
        Some(package) => bail!(
            "`{0}` is a package with a {1}, and contains the folder `{2}`: run `karat init {0}`",
            shown(package),
            project::MANIFEST,
            folder.display()
        ),
        None => Ok(()),
    }
}

/// Returns the folder of the first package that `karat test` finds, or otherwise the working directory.
fn usual_folder() -> anyhow::Result<PathBuf> {
    let packages = Project::find()?.packages(&PackageArgs::default()).unwrap_or_default();
    let root = packages.first().map(Package::root).filter(|root| root.is_dir());
    Ok(PathBuf::from(root.map_or_else(|| ".".to_owned(), |root| shown(&root))))
}

/// Runs the folder's tests. If a Cargo project has the record of an earlier run, this run doesn't replace that record,
/// because the new record would lack the verdicts of the Rust tests.
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
        writeln!(out, "{DIM}this run left the record of the last `karat test` as it was{DIM:#}")?;
    }
    Ok(status.context("can't run the tests")?.success())
}

fn this() -> anyhow::Result<Command> {
    Ok(Command::new(std::env::current_exe().context("can't find karat's executable file")?))
}

/// Writes a first test beside a module. The test calls a function, preferably one that has arguments and returns
/// floats. If no function can be tested, the test runs a compute pass. Returns `None` if the folder already has tests,
/// or if Rust tests check all functions.
fn first_test(
    package: &Package,
    folder: &Path,
    (items, passes): (&[FunctionItem], &[FunctionItem]),
    out: &mut dyn Write,
) -> anyhow::Result<Option<PathBuf>> {
    let suite = karat_suite::Suite::open(folder)?;
    if !suite.tests.is_empty() || !suite.broken.is_empty() {
        writeln!(out, "{DIM}Karat writes no test, because the folder has tests already{DIM:#}")?;
        return Ok(None);
    }
    let tested = tested(folder)?;
    let is_open = |item: &&FunctionItem| !tested.is(&item.name);
    let mut why = Why::default();
    let mut best: Option<(u8, &FunctionItem, String)> = None;
    for item in items.iter().filter(is_open) {
        match function_test(package, item) {
            Ok((rank, text)) if best.as_ref().is_none_or(|(known, ..)| rank < *known) => {
                best = Some((rank, item, text));
            }
            Ok(_) => {}
            Err(Open::Bound) => why.bound.push(&item.name),
            Err(Open::Refused) => why.refused.push(&item.name),
        }
    }
    let pass = || {
        let of = |item| Some((item, pass::declaration(package, item)?));
        passes.iter().filter(is_open).find_map(of)
    };
    let Some((item, text)) = best.map(|(_, item, text)| (item, text)).or_else(pass) else {
        let all: Vec<_> = items.iter().chain(passes).collect();
        if !all.is_empty() && all.iter().all(|item| tested.is(&item.name)) {
            writeln!(out, "{DIM}Karat writes no test: each function has a test already{DIM:#}")?;
            return Ok(None);
        }
        why.passes.extend(passes.iter().filter(is_open).map(|item| item.name.as_str()));
        bail!(why.told());
    };
    let file = beside(item, folder);
    std::fs::write(&file, text).with_context(|| format!("`{}`", file.display()))?;
    writeln!(out, "{GOOD}wrote{GOOD:#} {}, a test of `{}`", file.display(), item.name)?;
    Ok(Some(file))
}

/// The reason why Karat can't write a first test of a function.
enum Open {
    /// The function reads a variable to which a test must bind a value.
    Bound,
    /// A test can't call the function.
    Refused,
}

/// Returns a test of a function, and the rank of the test: rank 0 is the most useful. The test sets no ranges, so the
/// names and types of the arguments determine the ranges.
fn function_test(package: &Package, item: &FunctionItem) -> Result<(u8, String), Open> {
    let (_, name) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let probed = Probed::new(package, &item.name).map_err(|_| Open::Refused)?;
    let function = probed.function();
    if !function.bindings.is_empty() {
        return Err(Open::Bound);
    }
    let has_float = function.result.lanes().iter().any(|lane| lane.is_float());
    let rank = 2 * u8::from(!has_float) + u8::from(function.parameters.is_empty());
    let is_of_floats = |shape: &Shape| shape.lanes().iter().all(|lane| lane.is_float());
    let mut floats = function.parameters.iter().filter(|(_, shape)| is_of_floats(shape));
    let over = floats.next().map_or_else(String::new, |(name, _)| {
        format!(
            "# Ranges of arguments. If an argument has no range here, its name and type determine the range:\n\
             # over = {{ {name} = \"0..1\" }}\n"
        )
    });
    // Functions with integer results have hazards, too: an index outside of an array, a division by 0, a conversion out
    // of range.
    let assertion = if has_float { "finite" } else { "no_hazards" };
    let text = format!("# {function}\n[[test]]\nfunction = \"{name}\"\n{over}{assertion} = true\n");
    Ok((rank, text))
}

/// Returns the entry points in a package. The filter `of` chooses the stages.
fn entry_points(
    package: &Package,
    of: impl Fn(Stage) -> bool,
) -> anyhow::Result<Vec<FunctionItem>> {
    let modules = package.modules()?;
    let functions = modules.iter().filter_map(|module| package.functions_in(module).ok());
    Ok(functions.flatten().filter(|item| item.entry_point.is_some_and(&of)).collect())
}

/// Returns the file of a module's tests.
fn beside(item: &FunctionItem, folder: &Path) -> PathBuf {
    let (module, _) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let mut beside = folder.to_owned();
    beside.extend(module.split("::"));
    PathBuf::from(format!("{}.test.toml", beside.display()))
}

/// The functions and passes for which Karat can't write a first test, grouped by reason.
#[derive(Default)]
struct Why<'i> {
    bound: Vec<&'i str>,
    refused: Vec<&'i str>,
    passes: Vec<&'i str>,
}

impl Why<'_> {
    fn told(&self) -> String {
        /// The largest number of names in a line.
        const SHOWN: usize = 4;
        let mut text = "Karat can't write a first test".to_owned();
        for (names, thing, what) in [
            (
                &self.bound,
                "function",
                "a binding needs a value; write a test with `with = { name = .. }` in a `*.test.toml`",
            ),
            (&self.refused, "function", "no test can call this code; `karat call` prints why"),
            (
                &self.passes,
                "pass",
                "a resource has no known size, or the pass writes no resource; describe the resources in `[[compute]]` of a `*.test.toml`",
            ),
        ] {
            let more = if names.len() > SHOWN { ", .." } else { "" };
            let first = names[..names.len().min(SHOWN)].join("`, `");
            if !names.is_empty() {
                text += &format!("\n  {} (`{first}`{more}): {what}", counted(names.len(), thing));
            }
        }
        text
    }
}

/// The functions that Rust tests check. A function counts if a test checked it in the last run, or if a Rust file in
/// `tests` contains its name in quotes.
struct Tested {
    ran: BTreeSet<String>,
    texts: Vec<String>,
}

impl Tested {
    /// Checks if any test uses Karat.
    fn any(&self) -> bool {
        !self.ran.is_empty() || self.texts.iter().any(|text| text.contains("karat"))
    }

    fn is(&self, function: &str) -> bool {
        let named = format!("\"{function}\"");
        self.ran.contains(function) || self.texts.iter().any(|text| text.contains(&named))
    }
}

/// Returns the functions that the project's Rust tests check.
fn tested(folder: &Path) -> anyhow::Result<Tested> {
    let folder = folder.canonicalize()?;
    let project = Project::around(&folder)?;
    let mut texts = Vec::new();
    // In a workspace, the tests are in the folder of the member.
    for around in folder.ancestors().take_while(|around| around.starts_with(project.root())) {
        read_rust(&around.join("tests"), &mut texts);
    }
    // Without Cargo, all tests are beside the modules. This folder has no tests, so a record would belong to deleted
    // tests.
    let ran = if project.is_cargo() { tested_functions(&project)? } else { BTreeSet::new() };
    Ok(Tested { ran, texts })
}

/// Adds the contents of the Rust files below a folder, and skips unreadable files.
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

/// Adds [`IGNORED`] to `.gitignore`, except for lines that it already has.
fn ignore(out: &mut dyn Write) -> anyhow::Result<()> {
    let file = Path::new(".gitignore");
    let mut text = text_of(file)?.unwrap_or_default();
    let missing: Vec<&str> = IGNORED
        .into_iter()
        // A line `.karat/` already covers the folder of runs.
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

/// Adds profiles to the Cargo.toml of a project that depends on Karat. With these profiles, Cargo optimises the crates
/// that would otherwise make tests slow. Existing profiles stay.
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
        // Debug information would make the first build take a third longer.
        let level = level.map_or_else(String::new, |level| format!("opt-level = {level}\n"));
        text += &format!("\n[profile.dev.package.{name}]\n{level}debug = false\n");
        added.push(name);
    }
    // The form of the existing tables may not allow new tables. Then `karat doctor` names the missing profiles.
    if added.is_empty() || text.parse::<toml::Table>().is_err() {
        return Ok(());
    }
    std::fs::write(&file, text).context("`Cargo.toml`")?;
    writeln!(out, "{GOOD}added{GOOD:#} build profiles for {} to Cargo.toml", added.join(", "))?;
    Ok(())
}

/// Writes a file for CI, unless the file exists.
fn keep(file: &Path, text: &str, out: &mut dyn Write) -> anyhow::Result<()> {
    if file.exists() {
        return Ok(writeln!(out, "{DIM}Karat keeps the existing {}{DIM:#}", file.display())?);
    }
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("`{}`", folder.display()))?;
    }
    std::fs::write(file, text).with_context(|| format!("`{}`", file.display()))?;
    writeln!(out, "{GOOD}wrote{GOOD:#} {}", file.display())?;
    if text.contains("example.org") {
        let hint = "write the address of your copy of Karat into this file, because Karat isn't released yet";
        writeln!(out, "  {KNOWN}{hint}{KNOWN:#}")?;
    }
    if file == Path::new(GITLAB_FILE) {
        let hint = "include: { local: .gitlab-ci.karat.yml }";
        writeln!(out, "  {KNOWN}add this line to .gitlab-ci.yml: {hint}{KNOWN:#}")?;
    }
    // In a worktree `.git` is a file.
    let here = Path::new(".").canonicalize()?;
    let repository = here.ancestors().find(|folder| folder.join(".git").exists());
    if let Some(root) = repository.filter(|root| *root != here) {
        let root = root.display();
        let hint = "let CI run the steps of this file in the current folder, but move the file to the root of the repository";
        writeln!(out, "  {KNOWN}{hint} ({root}){KNOWN:#}")?;
    }
    Ok(())
}

fn with_folder(template: &str, folder: &Path) -> String {
    let by_npm = npm::brings_karat(Path::new(".")).then(|| {
        let mut text = template.replace("image: rust:1.95", "image: node:22");
        for (cargo, npm) in BY_NPM {
            text = text.replace(cargo, npm);
        }
        // `npm ci` needs a lock file.
        match Path::new("package-lock.json").is_file() {
            true => text,
            false => text.replace("npm ci\n", "npm install\n"),
        }
    });
    let template = by_npm.as_deref().unwrap_or(template);
    // A Cargo project also has Rust tests, whose records are in Cargo's target folder.
    if Path::new("Cargo.toml").is_file() {
        return template.replace(" SHADERS", "").replace("**/.karat/run", "target/karat");
    }
    template.replace("SHADERS", &folder.display().to_string().replace('\\', "/"))
}
