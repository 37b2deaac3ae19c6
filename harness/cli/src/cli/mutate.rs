//! `karat mutate`

use std::collections::BTreeMap;
use std::io::Write;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc;
use std::time::Instant;

use anyhow::{Context, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::output::counted;
use karat::unstable::run::Host;
use karat_mutate::{Fate, Hunted, Lived, MutateError, Request, Score, Tried};

use super::project::{self, Project};
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN, Table};
use super::{Ending, Outcome, PlaceArgs, write_json};

mod stryker;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Only mutants of functions and constants whose names contain this; may be repeated
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Only tests whose names contain this
    #[arg(long, value_name = "FILTER")]
    tests: Option<String>,
    /// Try so many mutants, by the seed
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..))]
    sample: Option<u32>,
    /// The seed of a sample
    #[arg(long, value_name = "SEED", default_value_t = 1, requires = "sample")]
    seed: u64,
    /// Only lines that differ from this revision of git
    #[arg(long, value_name = "REVISION")]
    in_diff: Option<String>,
    /// Fail below this score, in per cent [default: 100]
    #[arg(long, value_name = "PERCENT", value_parser = percent)]
    fail_under: Option<f64>,
    /// The path that tests run on
    #[arg(long, value_name = "PATH", default_value = "cpu", env = "KARAT_PATHS")]
    paths: String,
    /// Show killed mutants and those that aren't valid, too
    #[arg(long)]
    all: bool,
    /// List the mutants, and try none
    #[arg(long)]
    list: bool,
    /// Write Stryker's report, `mutation.json`, into this file
    #[arg(long, value_name = "FILE")]
    stryker: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// It is the process that tries them
    #[arg(long, hide = true)]
    inner: bool,
    #[command(flatten)]
    place: PlaceArgs,
}

fn percent(text: &str) -> Result<f64, String> {
    let number = text.trim_end_matches('%').trim().parse::<f64>();
    let number = number.ok().filter(|number| (0.0..=100.0).contains(number));
    number.ok_or_else(|| "write a number from 0 to 100".to_owned())
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let paths = karat::unstable::path::named("--paths", &args.paths)?;
    ensure!(paths.len() == 1, "name one path: a mutant that one path kills is killed");
    if !args.inner && !args.list {
        return apart(&args.paths);
    }
    let project = Project::find()?;
    let packages = project.packages(&args.place.package())?;
    let mut all: Vec<(String, Package, Hunted)> = Vec::new();
    let began = Instant::now();
    for package in &packages {
        let title = project::title(package, &packages);
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
        if paths.iter().all(|path| path.api() != karat::unstable::path::Api::Cpu) {
            request = request.frames();
        }
        if args.list {
            let (mutants, _) = request.mutants()?;
            for one in &mutants {
                writeln!(out, "{} {}", one.id, headline(one))?;
            }
            ensure!(!mutants.is_empty(), "there is no mutant");
            continue;
        }
        let scratch = tempfile::tempdir().context("no temporary folder")?;
        karat::unstable::run::host(host(scratch.path()));
        match hunt(&request, &title) {
            Ok(hunted) => all.push((title, package.clone(), hunted)),
            // Of several packages some have no tests, or no line of the edit.
            Err(error @ (MutateError::NoTest | MutateError::NoMutant { .. }))
                if packages.len() > 1 =>
            {
                writeln!(out, "{DIM}{title}: {error}{DIM:#}")?;
            }
            Err(error @ MutateError::NoTest) if project.is_cargo() => {
                anyhow::bail!("{error}; tests in Rust aren't run by `karat mutate`")
            }
            Err(error) => return Err(error.into()),
        }
    }
    if args.list {
        return Ok(Ending::Good);
    }
    let rust = if project.is_cargo() { "; tests in Rust weren't run" } else { "" };
    ensure!(!all.is_empty(), "no mutant was tried: nothing is known of the tests{rust}");
    if let Some(file) = &args.stryker {
        let of = all.iter().map(|(_, package, hunted)| (package, hunted));
        stryker::write(of, file)?;
    }
    let tried = || all.iter().flat_map(|(.., hunted)| &hunted.tried);
    let score = Score::of(tried());
    if args.json {
        write_json(&tried().map(as_json).collect::<Vec<_>>(), out)?;
    } else {
        for (title, _, hunted) in &all {
            if all.len() > 1 {
                writeln!(out, "{HEAD}{title}{HEAD:#}")?;
            }
            write_one(hunted, args.all, out)?;
        }
        write_sum(&all, &score, args, (began, rust), out)?;
    }
    let least = args.fail_under.unwrap_or(100.0);
    let good = score.percent().is_some_and(|percent| percent >= least) && score.stopped == 0;
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// Runs this command in a process of its own, whose settings are those of the hunt: its tests fail on purpose, and what they
/// leave isn't to be found beside the shaders.
fn apart(path: &str) -> Outcome {
    let program = std::env::current_exe().context("this program isn't where it was")?;
    let mut command = Command::new(program);
    command.args(std::env::args_os().skip(1)).arg("--inner");
    command.env("KARAT_PATHS", path).env_remove("KARAT_REQUIRE").env_remove("KARAT_RECORD");
    // Goldens that differ wait in the folder of output then.
    command.env("CI", "true");
    if path == "cpu" {
        command.env("KARAT_FRAMES", "off");
    }
    let status = command.status().context("the mutants can't be tried")?;
    match status.code() {
        Some(0) => Ok(Ending::Good),
        Some(1) => Ok(Ending::Bad),
        Some(_) => Err(super::Reported.into()),
        None => anyhow::bail!(
            "the process that tries the mutants ended ({status}): try another path, or fewer by --only"
        ),
    }
}

/// Who runs the tests: what they remember and leave goes with the folder.
fn host(folder: &Path) -> Host {
    let (target, output) = ("mutate".to_owned(), folder.join("output"));
    Host { command: vec!["karat".to_owned()], folder: folder.to_owned(), target, output }
}

/// Tries the mutants, with a bar on a terminal.
fn hunt(request: &Request, title: &str) -> Result<Hunted, MutateError> {
    std::panic::set_hook(Box::new(|_| {}));
    let bar = ProgressBar::new(0).with_message(title.to_owned());
    let style = ProgressStyle::with_template("{msg}: {pos} of {len} mutants {wide_bar} {eta} left");
    bar.set_style(style.expect("the template is valid"));
    let (sender, seen) = mpsc::channel();
    std::thread::scope(|scope| {
        let hunting = scope.spawn(move || {
            // Its reader lives as long as there is something to tell.
            request.run(&move |_, done, of| {
                let _ = sender.send((done, of));
            })
        });
        for (done, of) in seen {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
        bar.finish_and_clear();
        hunting.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// `shaders/brdf.wgsl:31:12 `a` -> `b` in `brdf::schlick` (operator)`
fn headline(one: &Tried) -> String {
    let Tried { module, file, mutant, .. } = one;
    let item = match module.as_str() {
        "" => mutant.item.clone(),
        module => format!("{module}::{}", mutant.item),
    };
    let short = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let to = match short(&mutant.replacement) {
        none if none.is_empty() => "nothing".to_owned(),
        some => format!("`{some}`"),
    };
    format!(
        "{}:{}:{} `{}` -> {to} in `{item}` ({})",
        shown(file),
        mutant.line,
        mutant.column,
        short(&mutant.original),
        mutant.rule
    )
}

/// Survivors first, each with why it lived.
fn write_one(hunted: &Hunted, all: bool, out: &mut dyn Write) -> std::io::Result<()> {
    let mut suggested: BTreeMap<String, ()> = BTreeMap::new();
    for one in &hunted.tried {
        let (style, word, why) = match &one.fate {
            Fate::Lived { why: Lived::Equal, .. } | Fate::Untested { why: Lived::Equal } => {
                if !all {
                    continue;
                }
                (DIM, "equal", Vec::new())
            }
            Fate::Lived { tests, why } => {
                let tests = match tests {
                    1 => "1 test passes with it".to_owned(),
                    many => format!("{many} tests pass with it"),
                };
                (BAD, "lived", lines(&tests, why))
            }
            Fate::Untested { why } => (BAD, "no test", lines("no test is made of it", why)),
            Fate::Stopped { test, reason } => {
                (KNOWN, "stopped", vec![format!("`{test}`: {reason}")])
            }
            Fate::Killed { test } if all => (GOOD, "killed", vec![format!("by `{test}`")]),
            Fate::Invalid { reason } if all => (DIM, "invalid", vec![reason.clone()]),
            Fate::Idle if all => {
                (DIM, "idle", vec!["it changes nothing that is linked".to_owned()])
            }
            Fate::Killed { .. } | Fate::Invalid { .. } | Fate::Idle => continue,
        };
        writeln!(out, "{style}{word}{style:#} {} {DIM}{}{DIM:#}", headline(one), one.id)?;
        for line in why {
            writeln!(out, "    {line}")?;
        }
        if let Fate::Lived { why: Lived::Differs(found), .. }
        | Fate::Untested { why: Lived::Differs(found) } = &one.fate
            && let Some(test) = found.test()
            && suggested.insert(test.clone(), ()).is_none()
        {
            for line in test.lines() {
                writeln!(out, "    {DIM}|{DIM:#} {line}")?;
            }
        }
    }
    Ok(())
}

/// Why a mutant lived, in lines.
fn lines(tests: &str, why: &Lived) -> Vec<String> {
    match why {
        Lived::Equal => Vec::new(),
        Lived::Differs(found) => {
            let arguments = found.arguments.iter().map(|(name, value)| format!("{name} = {value}"));
            let arguments = arguments.collect::<Vec<_>>().join(", ");
            let at = if arguments.is_empty() { String::new() } else { format!(" for {arguments}") };
            vec![format!(
                "{tests}; `{}` returns {} in place of {}{at}",
                found.function, found.mutant, found.original
            )]
        }
        Lived::Unseen { cases } => {
            vec![format!("{tests}; no difference found in {}", counted(*cases, "input"))]
        }
        Lived::Unknown { reason } => vec![format!("{tests}; {reason}")],
    }
}

fn write_sum(
    all: &[(String, Package, Hunted)],
    score: &Score,
    args: &Args,
    (began, rust): (Instant, &str),
    out: &mut dyn Write,
) -> std::io::Result<()> {
    let mut modules: BTreeMap<String, Vec<&Tried>> = BTreeMap::new();
    for (title, _, hunted) in all {
        for one in &hunted.tried {
            let name = if one.module.is_empty() { title.clone() } else { one.module.clone() };
            modules.entry(name).or_default().push(one);
        }
    }
    let mut table = Table::new(
        &["module", "score", "killed", "lived", "no test", "equal", "invalid"],
        &[1, 2, 3, 4, 5, 6],
    );
    for (module, tried) in &modules {
        let own = Score::of(tried.iter().copied());
        let style = if own.lived + own.untested == 0 { GOOD } else { BAD };
        let percent =
            own.percent().map_or_else(|| "-".to_owned(), |percent| format!("{percent:.0}%"));
        let counts = [own.killed, own.lived, own.untested, own.equal, own.invalid + own.idle];
        let cells =
            [module.clone(), percent].into_iter().chain(counts.map(|count| count.to_string()));
        table.row(style, cells.collect());
    }
    writeln!(out)?;
    table.write(out)?;
    let least = args.fail_under.unwrap_or(100.0);
    let style = if score.percent().is_some_and(|percent| percent >= least) { GOOD } else { BAD };
    let tried: usize = all.iter().map(|(.., hunted)| hunted.tried.len()).sum();
    let of: usize = all.iter().map(|(.., hunted)| hunted.of).sum();
    let tests: usize = all.iter().map(|(.., hunted)| hunted.tests).sum();
    let frames: usize = all.iter().map(|(.., hunted)| hunted.left_out).sum();
    let mut parts = vec![match score.percent() {
        Some(percent) => format!(
            "score {percent:.1}%: {} of {} mutants killed by {} on {}",
            score.killed,
            score.judged(),
            counted(tests, "test"),
            args.paths
        ),
        None => "no mutant was judged".to_owned(),
    }];
    if tried < of {
        parts.push(format!("a sample of {tried} of {of}, by seed {}", args.seed));
    }
    for (count, what) in [
        (score.equal, "equal to the original"),
        (score.invalid, "no valid WGSL"),
        (score.idle, "in no function that is linked"),
        (score.stopped, "ended without a verdict"),
    ] {
        if count > 0 {
            parts.push(format!("{count} {what}"));
        }
    }
    if frames > 0 {
        parts.push(format!("{} not drawn: --paths vulkan draws them", counted(frames, "frame")));
    }
    let seconds = began.elapsed().as_secs_f64();
    writeln!(out, "{style}{}{style:#}{rust}; {seconds:.0} s", parts.join("; "))
}

fn as_json(one: &Tried) -> serde_json::Value {
    let Tried { id, module, file, mutant, fate } = one;
    serde_json::json!({
        "id": id, "module": module, "function": mutant.item, "file": shown(file), "line": mutant.line, "column": mutant.column,
        "rule": mutant.rule.to_string(), "original": mutant.original, "replacement": mutant.replacement,
        "result": fate,
    })
}

/// The lines of a folder's files that differ from a revision, and those of files that git doesn't know.
fn lines_since(
    revision: &str,
    folder: &Path,
) -> anyhow::Result<BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>> {
    let around = if folder.is_file() { folder.parent().unwrap_or(folder) } else { folder };
    let git = |arguments: &[&str]| -> anyhow::Result<String> {
        let ran = Command::new("git").arg("-C").arg(around).args(arguments).output();
        let ran = ran.context("can't run git")?;
        let said = String::from_utf8_lossy(&ran.stderr);
        ensure!(ran.status.success(), "git: {}", said.trim());
        Ok(String::from_utf8_lossy(&ran.stdout).into_owned())
    };
    ensure!(!revision.starts_with('-'), "`{revision}` is no revision");
    let root = PathBuf::from(git(&["rev-parse", "--show-toplevel"])?.trim());
    let mut all: BTreeMap<PathBuf, Vec<RangeInclusive<usize>>> = BTreeMap::new();
    let place = |name: &str| root.join(name).canonicalize().unwrap_or_else(|_| root.join(name));
    let diff = git(&[
        "diff",
        "--no-color",
        "--no-ext-diff",
        "--unified=0",
        "--src-prefix=a/",
        "--dst-prefix=b/",
        revision,
        "--",
        ".",
    ])?;
    let mut file = None;
    for line in diff.lines() {
        if let Some(name) = line.strip_prefix("+++ ") {
            file = name.strip_prefix("b/").map(place);
        } else if let (Some(file), Some(hunk)) = (&file, line.strip_prefix("@@ ")) {
            let after = hunk.split(' ').find_map(|part| part.strip_prefix('+')).unwrap_or_default();
            let (start, count) = after.split_once(',').unwrap_or((after, "1"));
            let (start, count): (usize, usize) = (start.parse()?, count.parse()?);
            if count > 0 {
                all.entry(file.clone()).or_default().push(start..=start + count - 1);
            }
        }
    }
    for name in git(&["ls-files", "--others", "--exclude-standard", "--full-name", "."])?.lines() {
        all.entry(place(name)).or_default().push(1..=usize::MAX);
    }
    Ok(all)
}
