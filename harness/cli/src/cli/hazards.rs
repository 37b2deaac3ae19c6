//! `karat hazards`

use std::collections::BTreeMap;
use std::io::Write;
use std::ops::RangeInclusive;
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};
use karat::Package;
use karat::unstable::hazards::{Hazard, HazardError, Hazards, Kind, Lowered, Unseen};
use karat::unstable::made_up::Drawn;
use karat::unstable::output::{counted, tell};

use super::patience::PATIENCE;
use super::project::Project;
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN};
use super::{Ending, Outcome, PlaceArgs, terminal, write_json};

/// Reasons that are shown why functions weren't looked at.
const REASONS: usize = 4;

/// Lines of a screen that a hazard takes, on the average.
const LINES: usize = 4;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Only functions whose name contains this; may be repeated
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Only hazards of this kind: `nan`, `infinite`, `out_of_range`, `by_zero`, `lost_digits`, `unbounded`, ...;
    /// may be repeated
    #[arg(long = "kind", value_name = "KIND", value_parser = kind)]
    kinds: Vec<Kind>,
    /// What arguments of a name are: `roughness=0.05..1`; may be repeated
    #[arg(long = "input", value_name = "NAME=LEAST..MOST", value_parser = input)]
    inputs: Vec<(String, RangeInclusive<f64>)>,
    /// Inputs of each function
    #[arg(long, value_name = "COUNT", default_value_t = 1024,
        value_parser = clap::value_parser!(u32).range(1..=65_536))]
    cases: u32,
    /// Show all, and the functions that weren't looked at
    #[arg(long)]
    all: bool,
    /// Show those that karat.toml accepts, too
    #[arg(long)]
    accepted: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    place: PlaceArgs,
}

/// The range of an input by name.
type Input = (String, RangeInclusive<f64>);

/// A kind as JSON, and as `no_hazards` of a `*.test.toml` has it.
fn kind(text: &str) -> Result<Kind, String> {
    let name = serde_json::Value::String(text.replace('-', "_"));
    serde_json::from_value(name).map_err(|error| error.to_string())
}

/// `roughness=0.05..1`
fn input(text: &str) -> Result<Input, String> {
    let wrong = || "write NAME=LEAST..MOST, such as roughness=0.05..1".to_owned();
    let (name, range) = text.split_once('=').ok_or_else(wrong)?;
    let (least, most) = range.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
    let (least, most) = (number(least)?, number(most.trim_start_matches('='))?);
    if !(least <= most && least.is_finite() && most.is_finite()) {
        return Err(format!("{least} to {most} is no range"));
    }
    Ok((name.trim().to_owned(), least..=most))
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let packages = project.packages(&args.place.package())?;
    let mut all = Vec::new();
    // Of several packages each has inputs of its own; one that none has is an error.
    let mut unknown: BTreeMap<String, Vec<HazardError>> = BTreeMap::new();
    for package in &packages {
        let mut inputs: Vec<&Input> = args.inputs.iter().collect();
        let mut found = loop {
            match look(args, package, &inputs)? {
                Err(HazardError::UnknownInput { name, nearest }) if packages.len() > 1 => {
                    inputs.retain(|(own, _)| *own != name);
                    let error = HazardError::UnknownInput { name: name.clone(), nearest };
                    unknown.entry(name).or_default().push(error);
                }
                found => break found?,
            }
        };
        let others = keep_kinds(&mut found, &args.kinds);
        all.push((found, others));
    }
    let of_none = unknown.into_values().find(|errors| errors.len() == packages.len());
    if let Some(error) = of_none.and_then(|errors| errors.into_iter().next()) {
        return Err(error.into());
    }
    match args.json {
        true => write_json(&all.iter().map(|(hazards, _)| hazards).collect::<Vec<_>>(), out)?,
        false => {
            if !args.only.is_empty() {
                writeln!(
                    out,
                    "{DIM}--only leaves their callers out: hazards that no caller causes aren't lowered{DIM:#}"
                )?;
            }
            all.iter()
                .try_for_each(|(hazards, others)| write_text(hazards, *others, args.all, out))?;
        }
    }
    // Lowered ones come last, and are hazards: what was drawn doesn't prove that they never show.
    let mut found =
        all.iter().flat_map(|(hazards, _)| hazards.found.iter().chain(&hazards.lowered));
    let is_read = all.iter().all(|(hazards, _)| hazards.unread == 0);
    let good = is_read && found.all(|hazard| hazard.accepted.is_some());
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// Keeps hazards of some kinds, or all if none is named. Returns how many of others there were.
fn keep_kinds(hazards: &mut Hazards, kinds: &[Kind]) -> usize {
    let Hazards { found, lowered, rare, .. } = hazards;
    let is_other = |hazard: &mut Hazard| !kinds.is_empty() && !kinds.contains(&hazard.kind);
    [found, lowered, rare].into_iter().map(|list| list.extract_if(.., is_other).count()).sum()
}

/// Looks for hazards in a package, with these inputs.
fn look(
    args: &Args,
    package: &Package,
    inputs: &[&Input],
) -> anyhow::Result<Result<Hazards, HazardError>> {
    // Drawn on a terminal alone.
    let bar = ProgressBar::new(0).with_message(package.name());
    bar.set_style(ProgressStyle::with_template("{msg}: {pos} of {len} functions {wide_bar}")?);
    let request = package.hazards().only(args.only.iter().map(String::as_str));
    let request = if args.accepted { request.with_accepted() } else { request };
    let declare = |request: karat::unstable::hazards::Request, (name, range): &&Input| {
        request.input(name, range.clone())
    };
    let request = inputs.iter().fold(request, declare).cases(args.cases as usize);
    let began = Instant::now();
    let found = request.run_with(&|at| {
        bar.set_length(at.of as u64);
        bar.set_position(at.done as u64);
        if at.found > 0 && began.elapsed() > PATIENCE {
            let found = counted(at.found, "hazard");
            let line = format!(
                "{} of {} functions: {found} in {}, unless those that call it tell otherwise",
                at.done, at.of, at.function
            );
            bar.suspend(|| tell(&line));
        }
    });
    bar.finish_and_clear();
    Ok(found)
}

fn write_text(
    hazards: &Hazards,
    others: usize,
    all: bool,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let Hazards {
        package,
        functions,
        skipped,
        unread,
        found,
        lowered,
        rare,
        accepted,
        drawn,
        unseen,
    } = hazards;
    let mut hidden = 0;
    if all {
        for hazard in found.iter().chain(lowered).chain(rare) {
            write_one(hazard, &[], out)?;
        }
        for (name, why) in skipped {
            writeln!(out, "{DIM}not looked at: {name}: {why}{DIM:#}")?;
        }
    } else {
        hidden = write_idioms(found, lowered, out)?;
        write_reasons(skipped, out)?;
    }
    write_drawn(drawn, all, out)?;
    if !rare.is_empty() {
        let shown = if all { "above" } else { "--all shows them" };
        writeln!(
            out,
            "{DIM}{}, of few inputs whose arguments were drawn by their types alone, or over \
             sizes and indices that a host may never give: {shown}; --input NAME=LEAST..MOST says what they are{DIM:#}",
            counted(rare.len(), "rarer hazard")
        )?;
    }
    if !lowered.is_empty() && !all {
        let mut reasons: BTreeMap<Lowered, usize> = BTreeMap::new();
        for why in lowered.iter().filter_map(|hazard| hazard.lowered) {
            *reasons.entry(why).or_default() += 1;
        }
        let reasons = reasons.into_iter().map(|(why, count)| format!("{count}: {}", why.about()));
        let (counted, reasons) =
            (counted(lowered.len(), "lowered hazard"), reasons.collect::<Vec<_>>().join("; "));
        let more = match hidden {
            0 => String::new(),
            _ if hidden == lowered.len() => ": --all shows them".to_owned(),
            _ => format!(": --all shows {hidden} more"),
        };
        writeln!(out, "{DIM}{counted}{more} ({reasons}){DIM:#}")?;
    }
    let open = found.iter().filter(|hazard| hazard.accepted.is_none()).count();
    let style = if open == 0 && lowered.is_empty() { GOOD } else { BAD };
    write!(out, "{style}{package}: {}{style:#}", counted(open, "hazard"))?;
    if !rare.is_empty() {
        write!(out, " and {}", counted(rare.len(), "rarer one"))?;
    }
    if !lowered.is_empty() {
        write!(out, " and {} lowered", lowered.len())?;
    }
    if others > 0 {
        write!(out, " and {others} of other kinds")?;
    }
    write!(out, " in {}", counted(*functions, "function"))?;
    if *accepted > 0 {
        write!(out, ", {accepted} accepted in karat.toml")?;
    }
    if skipped.len() > *unread {
        write!(out, ", {} not looked at", counted(skipped.len() - unread, "function"))?;
    }
    if *unread > 0 {
        write!(out, ", {} not read: `karat check` says why", counted(*unread, "module"))?;
    }
    let Unseen { inputs, functions, in_part } = *unseen;
    if inputs > 0 {
        let of = counted(functions, "function");
        write!(
            out,
            ", {} of {of} not looked at: they are too much work",
            counted(inputs, "input")
        )?;
    }
    if in_part > 0 {
        write!(out, ", the first operations alone of {}", counted(in_part, "function"))?;
    }
    writeln!(out)?;
    Ok(())
}

/// Names of a line that says what arguments were drawn from.
const NAMES: usize = 12;

/// Prints what arguments were drawn from.
fn write_drawn(drawn: &Drawn, all: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    for line in drawn.lines(if all { usize::MAX } else { NAMES }) {
        writeln!(out, "{DIM}drawn {line}{DIM:#}")?;
    }
    Ok(())
}

/// Why functions weren't looked at: each reason once.
fn write_reasons(skipped: &[(String, String)], out: &mut dyn Write) -> anyhow::Result<()> {
    let mut reasons: Vec<(&str, &str, usize)> = Vec::new();
    for (name, why) in skipped {
        match reasons.iter_mut().find(|(known, ..)| known == why) {
            Some((_, _, count)) => *count += 1,
            None => reasons.push((why, name, 1)),
        }
    }
    reasons.sort_by_key(|(.., count)| std::cmp::Reverse(*count));
    for (why, name, count) in reasons.iter().take(REASONS) {
        let more = if *count > 1 { format!(" and {} more", count - 1) } else { String::new() };
        writeln!(out, "{DIM}not looked at: {name}{more}: {why}{DIM:#}")?;
    }
    if reasons.len() > REASONS {
        let more = reasons.len() - REASONS;
        writeln!(out, "{DIM}not looked at for {more} other reasons: --all shows them{DIM:#}")?;
    }
    Ok(())
}

/// Hazards of each idiom together, in the order of the first of each.
fn idioms(hazards: &[Hazard]) -> Vec<Vec<&Hazard>> {
    let mut idioms: Vec<Vec<&Hazard>> = Vec::new();
    let mut known = BTreeMap::new();
    for hazard in hazards {
        // Two races of one form are of one fault if they are of one variable.
        let variable = hazard.violation.as_ref().map(|race| (&race.variable, &race.entry_point));
        let form = (hazard.kind, hazard.idiom(), variable.filter(|(name, _)| !name.is_empty()));
        let at = *known.entry(form).or_insert(idioms.len());
        if at == idioms.len() {
            idioms.push(Vec::new());
        }
        idioms[at].push(hazard);
    }
    idioms
}

/// Prints the first hazard of each idiom, with how many others are like it, as far as a screen goes, and those that are
/// lowered where there is room. Returns how many lowered ones aren't shown.
fn write_idioms(
    found: &[Hazard],
    lowered: &[Hazard],
    out: &mut dyn Write,
) -> anyhow::Result<usize> {
    let (found, lowered) = (idioms(found), idioms(lowered));
    let room = terminal::size().rows / LINES;
    let shown = found.len().min(room);
    let (lowered, hidden) = lowered.split_at(lowered.len().min(room - shown));
    for alike in found[..shown].iter().chain(lowered) {
        write_one(alike[0], &alike[1..], out)?;
    }
    let left: usize = found[shown..].iter().map(Vec::len).sum();
    if left > 0 {
        writeln!(out, "{left} more: --all shows them\n")?;
    }
    Ok(hidden.iter().map(Vec::len).sum())
}

fn write_one(hazard: &Hazard, alike: &[&Hazard], out: &mut dyn Write) -> anyhow::Result<()> {
    let style = match hazard.kind {
        Kind::Nan
        | Kind::OutOfRange
        | Kind::Wrapped
        | Kind::Race
        | Kind::Barrier
        | Kind::ByZero
        | Kind::Infinite
            if hazard.lowered.is_none() =>
        {
            BAD
        }
        _ => KNOWN,
    };
    let (kind, operation, place) = (hazard.kind.name(), &hazard.text, &hazard.location);
    let lowered = if hazard.lowered.is_some() { ", lowered" } else { "" };
    writeln!(out, "{style}{kind}{lowered}{style:#}  {HEAD}{operation}{HEAD:#}  {place}")?;
    writeln!(out, "{DIM}{}{DIM:#}", hazard.details())?;
    if let [next, ..] = alike {
        let (count, like) = (alike.len(), hazard.idiom());
        writeln!(
            out,
            "{DIM}    {count} more of the form {like}, the next at {}{DIM:#}",
            next.location
        )?;
    }
    writeln!(out)?;
    Ok(())
}
