//! `karat compare`

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::sync::mpsc;

use anyhow::{Context, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use karat::Package;
use karat::unstable::output::{counted, tell};
use karat_inspect::compare::{
    Change, Compared, Missed, PathChange, Request, Uncovered, WordChange,
};

use super::git::shaders_at;
use super::project::Project;
use super::search;
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN};
use super::{Ending, Outcome, PlaceArgs, call, write_json};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The old shaders: a revision of git (`HEAD`, `main`, `v1.2`), or a folder or file
    before: String,
    /// Compares only functions whose name contains this text; may be repeated
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Runs the functions on these paths
    #[arg(long, value_name = "PATHS", default_value = "cpu", env = "KARAT_PATHS")]
    paths: String,
    /// Calls each function with this number of generated inputs
    #[arg(long, value_name = "COUNT", default_value_t = 4096,
        value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    cases: u32,
    /// Sets an `override` in both versions, by its name or its `@id`, in each function that uses it; may be repeated
    #[arg(long = "override", value_name = "NAME=VALUE")]
    overrides: Vec<String>,
    /// Also lists functions that weren't edited
    #[arg(long)]
    all: bool,
    /// Prints JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    place: PlaceArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let packages = project.packages(&args.place.package())?;
    let paths = karat::unstable::path::named("--paths", &args.paths)?;
    ensure!(!paths.is_empty(), "--paths names no path");
    let overrides = call::bind::overrides_in(&packages, &args.overrides)?;
    let mut all: Vec<Compared> = Vec::new();
    for after in &packages {
        // The folder must exist while Karat reads its package.
        let folder = tempfile::tempdir().context("can't make a temporary folder")?;
        let before = match Path::new(&args.before) {
            path if path.exists() => Package::open(path)?,
            _ => Package::open(&shaders_at(&args.before, &after.root(), folder.path())?)?,
        };
        let before = args.place.package.featured(before);
        let request = Request::new(before, after.clone());
        let request =
            overrides.iter().fold(request, |all, (name, value)| all.set_override(name, *value));
        let request = request.only(args.only.iter().map(String::as_str));
        let request = request.cases(args.cases as usize).paths(paths.clone());
        // The files of a revision lie in a temporary folder, so messages name the revision.
        let written = format!("{}{}", folder.path().display(), std::path::MAIN_SEPARATOR);
        // Only terminals show the bar.
        let bar = ProgressBar::new(0).with_message(after.name());
        bar.set_style(ProgressStyle::with_template("{msg}: {pos} of {len} functions {wide_bar}")?);
        let (sender, verdicts) = mpsc::channel();
        let (first, mut wrote) = (all.len(), Ok(()));
        let compared = std::thread::scope(|scope| {
            let tell = move |one: &Compared, done, of| {
                // The receiver lives until the last verdict is sent.
                drop(sender.send((one.clone(), done, of)));
            };
            let comparing = scope.spawn(move || request.run_with(&tell));
            for (mut one, done, of) in verdicts {
                bar.set_length(of as u64);
                bar.set_position(done as u64);
                for line in &mut one.uncovered {
                    if let Some(own) = line.place.strip_prefix(&written) {
                        line.place = format!("{}:{own}", args.before);
                    }
                }
                if !args.json && wrote.is_ok() {
                    wrote = bar.suspend(|| write_one(&one, args.all, (done, of), out));
                }
                all.push(one);
            }
            comparing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        bar.finish_and_clear();
        compared?;
        wrote?;
        all[first..].sort_by(|a, b| a.function.cmp(&b.function));
    }
    let wanted: Vec<String> = args.only.iter().map(|name| format!("`{name}`")).collect();
    ensure!(
        !all.is_empty() || wanted.is_empty(),
        "neither version of the shaders has a function with {} in its name; `karat list` shows the names",
        wanted.join(" or ")
    );
    ensure!(!all.is_empty(), "neither version of the shaders has a function");
    match args.json {
        true => write_json(&all, out)?,
        false => write_sum(&all, out)?,
    }
    let broken = search::broken_files(&packages)?;
    match args.json {
        // The JSON has no field for invalid files.
        true => broken.iter().for_each(|broken| tell(&broken.wrong.message)),
        false => search::write_broken(&broken, out)?,
    }
    let good = |one: &Compared| {
        one.interface.is_empty()
            && one.violations.is_empty()
            && one.uncovered.is_empty()
            && one.mended.is_empty()
            && matches!(one.change, Change::Untouched | Change::Same { .. } | Change::Added)
    };
    let good = all.iter().all(good) && broken.is_empty();
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// Prints the verdict on one function, with its position in the list of functions, such as `(3 of 40)`.
fn write_one(
    one: &Compared,
    untouched: bool,
    (done, of): (usize, usize),
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let Compared { function, location, change, interface, drawn, violations, .. } = one;
    let under = match &*one.under {
        [] => String::new(),
        names => format!("  under {}", names.join(" and ")),
    };
    let count = format!("{under}  {DIM}({done} of {of}){DIM:#}");
    match change {
        Change::Untouched if untouched => {
            writeln!(out, "{DIM}untouched  {function}{DIM:#}{count}")?;
        }
        Change::Untouched if !interface.is_empty() => {
            writeln!(out, "{BAD}interface{BAD:#}  {HEAD}{function}{HEAD:#}{count}")?;
        }
        Change::Untouched => {}
        Change::Same { cases } => {
            writeln!(out, "{GOOD}same{GOOD:#}       {function}  {DIM}{location}{DIM:#}{count}")?;
            match one.dispatched {
                Some([x, y, z]) => {
                    let of = "invocations";
                    writeln!(
                        out,
                        "    {DIM}compared {cases} 32-bit words after {x} x {y} x {z} {of}{DIM:#}"
                    )?;
                }
                None => writeln!(out, "    {DIM}{cases} inputs{DIM:#}")?,
            }
        }
        Change::Changed { paths } => {
            writeln!(out, "{BAD}changed{BAD:#}    {HEAD}{function}{HEAD:#}  {location}{count}")?;
            for path in paths {
                write_path(path, one.dispatched.is_some(), out)?;
            }
        }
        Change::Signature { before, after } => {
            writeln!(out, "{BAD}signature{BAD:#}  {HEAD}{function}{HEAD:#}  {location}{count}")?;
            writeln!(out, "    {before}\n    {after}")?;
        }
        Change::Added => writeln!(out, "{DIM}added{DIM:#}      {function}{count}")?,
        Change::Removed => writeln!(out, "{BAD}removed{BAD:#}    {function}{count}")?,
        Change::Unjudged { reason } => {
            writeln!(out, "{KNOWN}unjudged{KNOWN:#}   {function}  {DIM}{reason}{DIM:#}{count}")?;
        }
        other => writeln!(out, "{function}: {other:?}")?,
    }
    for line in drawn.lines(usize::MAX) {
        writeln!(out, "    {DIM}generated {line}{DIM:#}")?;
    }
    if one.cut > 0 {
        let left = counted(one.cut, "input");
        writeln!(out, "    {DIM}Karat left out {left}, because loops ran too long{DIM:#}")?;
    }
    for Uncovered { place, text, missed } in &one.uncovered {
        let what = match missed {
            Missed::Line => "no input reaches",
            Missed::True => "no input makes the condition true:",
            Missed::False => "every input makes the condition true:",
            Missed::Unmeasured => "Karat doesn't know if an input reaches this line:",
        };
        writeln!(out, "    {KNOWN}{what}{KNOWN:#} {place}: {text}")?;
    }
    let brought = violations.iter().map(|one| ("new", one));
    for (word, violation) in brought.chain(one.mended.iter().map(|one| ("gone", one))) {
        writeln!(out, "    {BAD}{word}{BAD:#}: {}", violation.headline)?;
        for access in &violation.accesses {
            writeln!(out, "      {}  {} {}", access.place, access.invocation, access.does)?;
        }
    }
    for sentence in interface {
        writeln!(out, "    {BAD}interface{BAD:#}: {sentence}")?;
    }
    Ok(())
}

fn write_sum(all: &[Compared], out: &mut dyn Write) -> anyhow::Result<()> {
    let (mut changed, mut added, mut removed, mut unjudged, mut same, mut quiet) =
        (0, 0, 0, 0, 0, 0);
    let (mut cut, mut moved, mut brought, mut mended, mut uncovered) =
        (0, 0, 0, 0, BTreeSet::new());
    for one in all {
        match one.change {
            Change::Untouched => quiet += 1,
            Change::Same { .. } => same += 1,
            Change::Changed { .. } | Change::Signature { .. } => changed += 1,
            Change::Added => added += 1,
            Change::Removed => removed += 1,
            Change::Unjudged { .. } => unjudged += 1,
            _ => {}
        }
        cut += one.cut;
        brought += one.violations.len();
        mended += one.mended.len();
        moved += usize::from(!one.interface.is_empty());
        uncovered.extend(one.uncovered.iter().map(|line| &line.place));
    }
    let style = match changed + removed + unjudged + moved + brought + mended + uncovered.len() {
        0 => GOOD,
        _ => BAD,
    };
    write!(out, "functions: {style}{changed} changed{style:#}, ")?;
    for (count, what) in [(added, "added"), (removed, "removed")] {
        if count > 0 {
            write!(out, "{count} {what}, ")?;
        }
    }
    if moved > 0 {
        write!(out, "{moved} with a changed interface, ")?;
    }
    if brought > 0 {
        write!(out, "{}, ", counted(brought, "new violation"))?;
    }
    if mended > 0 {
        write!(out, "{} gone, ", counted(mended, "violation"))?;
    }
    if unjudged > 0 {
        write!(out, "{unjudged} edited but not compared, ")?;
    }
    write!(out, "{same} edited with the same results, {quiet} untouched")?;
    if !uncovered.is_empty() {
        let lines = counted(uncovered.len(), "line");
        write!(out, "; no input reaches {lines} that the edit changed")?;
    }
    if cut > 0 {
        write!(out, "; {} left out, because loops ran too long", counted(cut, "input"))?;
    }
    writeln!(out)?;
    Ok(())
}

/// The largest number of arguments and buffer members that Karat prints for a change. For example, a buffer with a
/// camera may have forty members.
const INPUTS: usize = 12;

fn write_path(change: &PathChange, dispatched: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    let PathChange { path, cases, ulp, relative, arguments, before, after, words, .. } = change;
    /// The smallest distance in ULP that Karat doesn't print. A distance of 2^20 ULP is about an eighth of the value,
    /// so the relative difference is easier to understand.
    const NEAR: u64 = 1 << 20;
    let by = match (ulp, relative) {
        (Some(0), _) => ", only in the sign of a zero".to_owned(),
        (Some(ulp @ ..NEAR), Some(share)) => format!(", by up to {ulp} ulp (rel {share:.2e})"),
        (Some(ulp @ ..NEAR), None) => format!(", by up to {ulp} ulp"),
        (Some(_), Some(share)) => format!(", by a relative difference of up to {share:.2e}"),
        // If integers, signs or NaN differ, Karat prints only the values.
        _ => String::new(),
    };
    let shown = arguments.iter().take(INPUTS).map(|(name, value)| format!("{name} = {value}"));
    let more = arguments.len().saturating_sub(INPUTS);
    let more = (more > 0).then(|| format!("{more} more values, which --json shows"));
    let arguments: Vec<String> = shown.chain(more).collect();
    let at =
        if arguments.is_empty() { String::new() } else { format!("at {}: ", arguments.join("; ")) };
    let what = if dispatched { "32-bit words" } else { "results" };
    writeln!(out, "    {path}: {} of {} {what} changed{by}", cases.0, cases.1)?;
    writeln!(out, "    {at}{before} -> {after}")?;
    for WordChange { before, after, .. } in words.iter().skip(1) {
        writeln!(out, "    {before} -> {after}")?;
    }
    Ok(())
}
