//! `karat mutate`

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::PathBuf;
use std::process::Command;
use std::sync::mpsc;
use std::time::Instant;

use anyhow::{Context, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::output::{counted, tell};
use karat::unstable::run::Host;
use karat_mutate::{
    Candidate, Fate, Form, Hidden, Hunted, Lived, MutateError, Others, Request, Score, Tried,
};

use super::git::lines_since;
use super::project::{self, Project, tests_beside};
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN, Table};
use super::test::some;
use super::{Ending, Outcome, PlaceArgs, child, report, write_json};

mod rust;
mod stryker;

use self::rust::{OfPackage, RustTests};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Tries only mutants of functions and constants whose names contain this text, or the mutant with this id; may
    /// be repeated
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Runs only tests whose names contain this text
    #[arg(long, value_name = "FILTER")]
    tests: Option<String>,
    /// Runs only the Rust tests of this Cargo package; may be repeated [default: the whole workspace]
    #[arg(short = 'p', long = "package", value_name = "NAME")]
    cargo_packages: Vec<String>,
    /// Tries a random sample of this many mutants of each package
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..))]
    sample: Option<u32>,
    /// Chooses the sample by this seed
    #[arg(long, value_name = "SEED", default_value_t = 1, requires = "sample")]
    seed: u64,
    /// Tries only mutants of lines that changed since your branch left this revision of git, such as `main`
    #[arg(long, value_name = "REVISION")]
    in_diff: Option<String>,
    /// Fails if the score is below this percentage [default: 100]
    #[arg(long, value_name = "PERCENT", value_parser = super::percent)]
    fail_under: Option<f64>,
    /// Runs the tests on this path
    #[arg(long, value_name = "PATH", default_value = "cpu")]
    paths: String,
    /// Shows all mutants, including mutants that are killed, equal, accepted, invalid, or used by no test
    #[arg(long)]
    all: bool,
    /// Suggests tests in this language
    #[arg(long, value_name = "LANGUAGE", value_enum, default_value = "toml")]
    suggest: Suggest,
    /// Lists the mutants, and tries no mutant
    #[arg(long, conflicts_with_all = ["json", "stryker", "all", "fail_under"])]
    list: bool,
    /// Writes a report in the format of Stryker's `mutation.json` to this file
    #[arg(long, value_name = "FILE")]
    stryker: Option<PathBuf>,
    /// Annotates the lines of surviving mutants for GitHub
    #[arg(long)]
    github: bool,
    /// Prints JSON
    #[arg(long, conflicts_with = "github")]
    json: bool,
    /// Tries the mutants in this process, and keeps the files of the tests in this folder
    #[arg(long, hide = true)]
    scratch: Option<PathBuf>,
    #[command(flatten)]
    place: PlaceArgs,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Suggest {
    Toml,
    Wgsl,
    Rust,
}

impl From<Suggest> for Form {
    fn from(suggest: Suggest) -> Self {
        match suggest {
            Suggest::Toml => Self::Toml,
            Suggest::Wgsl => Self::Wgsl,
            Suggest::Rust => Self::Rust,
        }
    }
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let paths = karat::unstable::path::named("--paths", &args.paths)?;
    ensure!(paths.len() == 1, "`karat mutate` needs exactly one path, not --paths {}", args.paths);
    ensure!(
        std::env::var_os("KARAT_OVERLAY").is_none(),
        "KARAT_OVERLAY replaces modules, so mutants of the replaced modules would have no effect: unset KARAT_OVERLAY"
    );
    let project = Project::find()?;
    let packages = project.packages(&args.place.package())?;
    let requests: Vec<(String, Request)> = packages
        .iter()
        .map(|package| Ok((project::title(package, &packages), request(args, package, &paths)?)))
        .collect::<anyhow::Result<_>>()?;
    if args.list {
        return list(&requests, out);
    }
    let Some(scratch) = &args.scratch else { return apart(&args.paths) };
    let folder = packages.first().map_or_else(PathBuf::new, Package::root);
    karat::unstable::run::host(Host {
        folder: scratch.clone(),
        output: scratch.join("output"),
        ..super::suite::host_of(&folder, &args.place.package().features)
    });
    let began = Instant::now();
    let mut all: Vec<(String, Hunted)> = Vec::new();
    // Some of the packages may have no tests, and an edit may change no shader.
    let mut passed_over: Vec<String> = Vec::new();
    // Building the Rust tests takes long, so Karat builds them only if there is a mutant.
    let mut any = false;
    for (_, request) in &requests {
        any |= !request.mutants()?.0.is_empty();
    }
    let rust = match any && project.is_cargo() && args.place.package().package.is_none() {
        true => Some(RustTests::of(project.root(), &args.cargo_packages, args.tests.as_deref())?),
        false => None,
    };
    for ((title, request), package) in requests.iter().zip(&packages) {
        let others = rust.as_ref().map(|tests| OfPackage { tests, package });
        match hunt(request, others.as_ref(), title) {
            Ok(hunted) => all.push((title.clone(), hunted)),
            Err(error @ MutateError::NoMutant { .. }) if args.in_diff.is_some() => {
                passed_over.push(format!("{title}: {error}"));
            }
            Err(error @ (MutateError::NoTest(_) | MutateError::NoMutant { .. }))
                if requests.len() > 1 =>
            {
                passed_over.push(format!("{title}: {error}"));
            }
            Err(error) => return Err(error.into()),
        }
    }
    passed_over.iter().for_each(|line| tell(line));
    if all.is_empty() {
        // A pull request without changes to shaders isn't a failure.
        ensure!(args.in_diff.is_some(), "no mutant was tried, so the tests have no score");
        writeln!(out, "{DIM}the changed lines have no mutants, so no mutant was tried{DIM:#}")?;
        return Ok(Ending::Good);
    }
    let tried = || all.iter().flat_map(|(_, hunted)| &hunted.tried);
    if let Some(file) = &args.stryker {
        stryker::write(tried(), file)?;
    }
    let score = Score::of(tried());
    let least = args.fail_under.unwrap_or(100.0);
    let complaints: Vec<&String> = all.iter().flat_map(|(_, hunted)| &hunted.complaints).collect();
    let good = complaints.is_empty() && score.percent().is_some_and(|percent| percent >= least);
    let is_github = args.github || (report::runs_on_github() && !args.json);
    if is_github {
        write_annotations(&all, &project, out)?;
    }
    if args.json {
        write_json(&tried().map(as_json).collect::<Vec<_>>(), out)?;
        complaints.iter().for_each(|complaint| tell(&format!("error: {complaint}")));
        return Ok(if good { Ending::Good } else { Ending::Bad });
    }
    let mut text = Vec::new();
    for (title, hunted) in &all {
        if all.len() > 1 {
            writeln!(text, "{HEAD}{title}{HEAD:#}")?;
        }
        write_one(hunted, args, &mut text)?;
    }
    write_modules(&all, &mut text)?;
    for complaint in complaints {
        writeln!(text, "{BAD}error{BAD:#}: {complaint}")?;
    }
    out.write_all(&text)?;
    let mut parts = parts(&all, &score, (rust.as_ref(), project.is_cargo()), args);
    parts.extend(tests_beside(&packages));
    let parts = parts.join("; ");
    let style = if good { GOOD } else { BAD };
    let seconds = began.elapsed().as_secs_f64();
    writeln!(out, "{style}{parts}{style:#}; {seconds:.0} s")?;
    if is_github {
        report::summarise("karat mutate", &parts, &text)?;
    }
    Ok(if good { Ending::Good } else { Ending::Bad })
}

fn request(args: &Args, package: &Package, paths: &[karat::Path]) -> anyhow::Result<Request> {
    let mut request = Request::new(package.clone()).only(args.only.iter().map(String::as_str));
    if let Some(filter) = &args.tests {
        request = request.tests(filter);
    }
    if let Some(count) = args.sample {
        request = request.sample(count as usize, args.seed);
    }
    if let Some(revision) = &args.in_diff {
        request = request.lines(lines_since(revision, &package.root())?);
    }
    let is_engine = |path: &karat::Path| path.api() == karat::unstable::path::Api::Cpu;
    Ok(if paths.iter().any(is_engine) { request } else { request.frames() })
}

fn list(requests: &[(String, Request)], out: &mut dyn Write) -> Outcome {
    let mut any = false;
    for (_, request) in requests {
        for one in &request.mutants()?.0 {
            writeln!(out, "{} {}", one.id, headline(one))?;
            any = true;
        }
    }
    ensure!(any, "there is no mutant");
    Ok(Ending::Good)
}

/// Runs this command in a separate process with special settings. Tests that fail because of a mutant store pending
/// frames and failing inputs. The settings keep these files away from the shaders.
fn apart(path: &str) -> Outcome {
    let scratch = tempfile::tempdir().context("can't make a temporary folder")?;
    let program = std::env::current_exe().context("can't find karat's executable file")?;
    let mut command = Command::new(program);
    let mut words = std::env::args_os().skip(1);
    command.args(words.next()).arg("--scratch").arg(scratch.path()).args(words);
    command.env("KARAT_PATHS", path).env("TMPDIR", scratch.path());
    // With `CI` set, pending frames go into the output folder.
    command.env("CI", "true");
    for setting in ["KARAT_REQUIRE", "KARAT_RECORD", "KARAT_FRAMES", "KARAT_CASE"] {
        command.env_remove(setting);
    }
    // With `KARAT_FRAMES=off`, Rust tests skip their frames, too.
    command.envs((path == "cpu").then_some(("KARAT_FRAMES", "off")));
    let (status, scratch) =
        child::status_over(&mut command, scratch).context("can't try the mutants")?;
    drop(scratch);
    match status.code() {
        Some(0) => Ok(Ending::Good),
        Some(1) => Ok(Ending::Bad),
        Some(2) => Err(super::Reported.into()),
        Some(3) => Ok(Ending::Missing),
        _ => anyhow::bail!(
            "the process that tries the mutants ended ({status}): try fewer mutants with --only, or another path"
        ),
    }
}

/// Tries the mutants, and shows a progress bar on a terminal.
fn hunt(
    request: &Request,
    others: Option<&OfPackage<'_>>,
    title: &str,
) -> Result<Hunted, MutateError> {
    // The hook prints nothing, because the verdict contains the panic message.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let bar = ProgressBar::new(0).with_message(title.to_owned());
    let style = ProgressStyle::with_template("{msg}: {pos} of {len} mutants {wide_bar} {eta} left");
    bar.set_style(style.expect("the template is valid"));
    let (sender, seen) = mpsc::channel();
    let hunted = std::thread::scope(|scope| {
        let hunting = scope.spawn(move || {
            // The receiver lives until the last message is sent.
            let others = others.map(|others| others as &dyn Others);
            request.run_with(others, &move |_, done, of| {
                let _ = sender.send((done, of));
            })
        });
        for (done, of) in seen {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
        bar.finish_and_clear();
        hunting.join()
    });
    std::panic::set_hook(hook);
    hunted.unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<String>().cloned();
        panic!("{}", said.unwrap_or_else(|| "Karat panicked while it tried the mutants".to_owned()))
    })
}

/// Formats a mutant: `shaders/brdf.wgsl:31:12 `a` -> `b` in `brdf::schlick` (operator)`.
fn headline(one: &Candidate) -> String {
    let Candidate { file, mutant, .. } = one;
    let short = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let to = match short(&mutant.replacement) {
        none if none.is_empty() => "nothing".to_owned(),
        some => format!("`{some}`"),
    };
    format!(
        "{}:{}:{} `{}` -> {to} in `{}` ({})",
        shown(file),
        mutant.line,
        mutant.column,
        short(&mutant.original),
        one.path(),
        mutant.rule
    )
}

/// Prints the surviving mutants with the reasons. If no test uses a function, prints only the function's first mutant.
fn write_one(hunted: &Hunted, args: &Args, out: &mut dyn Write) -> std::io::Result<()> {
    let all = args.all;
    let mut suggested: BTreeSet<String> = BTreeSet::new();
    let mut untested: BTreeMap<String, usize> = BTreeMap::new();
    for one in hunted.tried.iter().filter(|one| is_untested(one)) {
        *untested.entry(one.candidate.path()).or_default() += 1;
    }
    for one in &hunted.tried {
        let more = match is_untested(one) && !all {
            true => match untested.remove(&one.candidate.path()) {
                Some(count) => count - 1,
                None => continue,
            },
            false => 0,
        };
        let (style, word, why) = match &one.fate {
            Fate::Lived { tests, hidden, seen, why } => {
                let tests = passing(*tests, hidden.is_none() && *seen);
                let word = if hidden.is_some() { "hidden" } else { "lived" };
                let by = hidden.iter().map(|Hidden { test, ratios: [before, after] }| {
                    let percent = |ratio: &f64| format!("{:.3}%", 100.0 * ratio);
                    match *after > 0.0 {
                        true => format!(
                            "the tolerance of `{test}` hides the mutant: with the mutant, the largest error of this test is {} of the bound, and without the mutant {}",
                            percent(after),
                            percent(before)
                        ),
                        false => format!("the assertion of `{test}` hides the mutant: this test sees different values, and accepts these values"),
                    }
                });
                (BAD, word, lines(&tests, why).into_iter().chain(by).collect())
            }
            Fate::Untested { why } => (BAD, "no test", lines("no test uses this code", why)),
            Fate::Stopped { test, reason } => {
                (KNOWN, "no verdict", vec![format!("`{test}`: {reason}")])
            }
            Fate::Unknown { reason } => (KNOWN, "no verdict", vec![reason.clone()]),
            Fate::Accepted { reason } if all => (KNOWN, "accepted", vec![reason.clone()]),
            Fate::Killed { test } if all => (GOOD, "killed", vec![format!("by `{test}`")]),
            Fate::Invalid { reason } if all => (DIM, "invalid", vec![reason.clone()]),
            Fate::Equal { by } if all => (DIM, "equal", vec![by.to_string()]),
            Fate::Idle if all => (DIM, "idle", vec!["the linked text doesn't change".to_owned()]),
            Fate::Accepted { .. }
            | Fate::Killed { .. }
            | Fate::Equal { .. }
            | Fate::Invalid { .. }
            | Fate::Idle => continue,
        };
        writeln!(
            out,
            "{style}{word}{style:#} {} {DIM}{}{DIM:#}",
            headline(&one.candidate),
            one.candidate.id
        )?;
        for line in why {
            writeln!(out, "    {line}")?;
        }
        if more > 0 {
            let more = counted(more, "more mutant");
            writeln!(out, "    --all also shows {more} of `{}`", one.candidate.path())?;
        }
        if let Fate::Lived { why: Lived::Differs(found), .. }
        | Fate::Untested { why: Lived::Differs(found) } = &one.fate
            && let Some(test) = found.test_as(args.suggest.into(), &one.candidate.id)
            && found.test().is_some_and(|test| suggested.insert(test))
        {
            for line in test.lines() {
                writeln!(out, "    {DIM}|{DIM:#} {line}")?;
            }
        }
    }
    Ok(())
}

/// Formats the number of tests that pass with a mutant. `unseen` is `true` if no value that the tests compare depends
/// on the mutant.
fn passing(tests: usize, unseen: bool) -> String {
    let tests = match tests {
        1 => "1 test passes with the mutant".to_owned(),
        many => format!("{many} tests pass with the mutant"),
    };
    match unseen {
        true => format!("{tests}: the mutant changes no value that a test compares"),
        false => tests,
    }
}

/// Prints one GitHub warning for each line with surviving mutants.
fn write_annotations(
    all: &[(String, Hunted)],
    project: &Project,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    let mut lines: BTreeMap<(String, usize), (usize, Vec<String>)> = BTreeMap::new();
    for one in all.iter().flat_map(|(_, hunted)| &hunted.tried) {
        if matches!(&one.fate, Fate::Lived { .. } | Fate::Untested { .. }) {
            let Candidate { file, mutant, .. } = &one.candidate;
            let text = format!("`{}` -> `{}`", mutant.original, mutant.replacement);
            let line = lines.entry((file.display().to_string(), mutant.line));
            let (first, texts) = line.or_insert((mutant.column, Vec::new()));
            *first = mutant.column.min(*first);
            texts.push(text);
        }
    }
    let lines = lines.into_iter().map(|((file, line), (column, mutants))| {
        let mutants_of = counted(mutants.len(), "mutant");
        let message = format!("no test kills {mutants_of} of this line: {}", mutants.join(", "));
        (format!("{file}:{line}:{column}"), message)
    });
    report::write_warnings("karat mutate", lines, project, out)
}

fn is_untested(one: &Tried) -> bool {
    matches!(&one.fate, Fate::Untested { .. })
}

/// Returns the reason why a mutant survived, as lines.
fn lines(tests: &str, why: &Lived) -> Vec<String> {
    match why {
        Lived::Differs(found) => {
            let arguments = found.arguments.iter().map(|(name, value)| format!("{name} = {value}"));
            let arguments = arguments.collect::<Vec<_>>().join(", ");
            let at = if arguments.is_empty() { String::new() } else { format!(" for {arguments}") };
            let does = if found.leaves { "writes" } else { "returns" };
            vec![format!(
                "{tests}; the function `{}` {does} {} in place of {}{at}",
                found.function, found.mutant, found.original
            )]
        }
        Lived::Unseen { cases } => {
            vec![format!(
                "{tests}; the mutant has the same results as the original for {}",
                counted(*cases, "input")
            )]
        }
        Lived::Sampler => vec![format!(
            "{tests}; to test the filter, sample between texels; to test the address mode, sample beyond the edge"
        )],
        Lived::Unknown { reason } => vec![format!("{tests}; {reason}")],
    }
}

fn write_modules(all: &[(String, Hunted)], out: &mut dyn Write) -> std::io::Result<()> {
    let mut modules: BTreeMap<String, Vec<&Tried>> = BTreeMap::new();
    for (title, hunted) in all {
        for one in &hunted.tried {
            let name = match (one.candidate.module.as_str(), all.len()) {
                ("", _) => title.clone(),
                (module, 1) => module.to_owned(),
                (module, _) => format!("{title} {module}"),
            };
            modules.entry(name).or_default().push(one);
        }
    }
    let head = ["module", "score", "killed", "lived", "no test", "equal", "invalid", "no verdict"];
    let mut table = Table::new(&head, &[1, 2, 3, 4, 5, 6, 7]);
    for (module, tried) in &modules {
        let own = Score::of(tried.iter().copied());
        let style = if own.lived + own.untested == 0 { GOOD } else { BAD };
        let percent = own.percent().map_or_else(|| "-".to_owned(), |percent| format!("{percent}%"));
        let counts =
            [own.killed, own.lived, own.untested, own.equal, own.invalid + own.idle, own.stopped];
        let cells =
            [module.clone(), percent].into_iter().chain(counts.map(|count| count.to_string()));
        table.row(style, cells.collect());
    }
    writeln!(out)?;
    table.write(out)
}

/// Returns the parts of the last line: the score, and the numbers of mutants that don't count in the score.
fn parts(
    all: &[(String, Hunted)],
    score: &Score,
    (rust, is_cargo): (Option<&RustTests>, bool),
    args: &Args,
) -> Vec<String> {
    let sum =
        |of: &dyn Fn(&Hunted) -> usize| all.iter().map(|(_, hunted)| of(hunted)).sum::<usize>();
    let in_rust = rust.map_or(0, |rust| rust.count);
    let tests = counted(in_rust + sum(&|hunted| hunted.tests), "test");
    let mut parts = vec![match score.percent() {
        Some(percent) => format!(
            "score {percent}%: {} of {} mutants killed by {tests} on {}",
            score.killed,
            score.judged(),
            args.paths
        ),
        None => "no mutant was judged".to_owned(),
    }];
    let (tried, of) = (sum(&|hunted| hunted.tried.len()), sum(&|hunted| hunted.of));
    if tried < of {
        parts.push(format!("a sample of {tried} of {of} mutants, chosen by seed {}", args.seed));
    }
    for (count, what) in [
        (score.equal, "equal to the original"),
        (score.accepted, "accepted in karat.toml"),
        (score.invalid, "invalid WGSL"),
        (score.idle, "in code that no linked text contains"),
        (score.stopped, "without a verdict"),
    ] {
        if count > 0 {
            parts.push(format!("{count} {what}"));
        }
    }
    let frames = sum(&|hunted| hunted.left_out);
    if frames > 0 {
        parts.push(format!(
            "{} left out, because frames need a driver: add --paths vulkan",
            counted(frames, "frame")
        ));
    }
    let invalid: Vec<&str> =
        all.iter().flat_map(|(_, hunted)| &hunted.invalid).map(String::as_str).collect();
    if !invalid.is_empty() {
        let are = if invalid.len() == 1 { "isn't" } else { "aren't" };
        let modules = counted(invalid.len(), "module");
        parts.push(format!("{modules} {are} valid: {}", some(&invalid)));
    }
    match rust {
        Some(rust) if !rust.unfit.is_empty() => {
            let unfit: Vec<&str> = rust.unfit.iter().map(String::as_str).collect();
            let tests = counted(unfit.len(), "test");
            let fail = if unfit.len() == 1 { "fails" } else { "fail" };
            let named = some(&unfit);
            parts.push(format!(
                "{tests} in Rust {fail} outside of Karat's checks, even without a mutant: {named}"
            ));
        }
        None if is_cargo => {
            parts.push("tests in Rust weren't run: run this command without a folder".to_owned())
        }
        _ => {}
    }
    parts
}

fn as_json(one: &Tried) -> serde_json::Value {
    let Candidate { id, module, file, mutant, .. } = &one.candidate;
    serde_json::json!({
        "id": id, "module": module, "function": mutant.item, "file": shown(file), "line": mutant.line, "column": mutant.column,
        "rule": mutant.rule.to_string(), "original": mutant.original, "replacement": mutant.replacement,
        "result": one.fate,
    })
}
