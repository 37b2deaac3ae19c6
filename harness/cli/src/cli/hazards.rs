//! `karat hazards`

use std::collections::BTreeMap;
use std::io::Write;
use std::ops::RangeInclusive;
use std::time::Instant;

use anyhow::bail;
use indicatif::{ProgressBar, ProgressStyle};
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::output::{counted, tell};
use karat_inspect::hazards::{Class, Hazard, HazardError, Hazards, Kind, Unseen};
use karat_inspect::made_up::Drawn;

use super::patience::PATIENCE;
use super::project::{self, Project};
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN};
use super::{Ending, Outcome, PlaceArgs, call, terminal, write_json};

/// The largest number of reasons that Karat prints for unchecked functions, unless you pass `--all`.
const REASONS: usize = 4;

/// The number of lines that Karat prints for an average finding. Karat computes from this number how many findings fit
/// on the screen.
const LINES: usize = 4;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Checks only functions whose name contains this text; may be repeated
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Reports only hazards of this kind: `nan`, `infinite`, `out_of_range`, `by_zero`, `lost_digits`, `unbounded`,
    /// ...; may be repeated
    #[arg(long = "kind", value_name = "KIND", value_parser = kind)]
    kinds: Vec<Kind>,
    /// Declares the range of arguments with this name: `roughness=0.05..1`; may be repeated
    #[arg(long = "input", value_name = "NAME=LEAST..MOST", value_parser = input)]
    inputs: Vec<(String, RangeInclusive<f64>)>,
    /// Sets an `override`, by its name or its `@id`; may be repeated
    #[arg(long = "override", value_name = "NAME=VALUE")]
    overrides: Vec<String>,
    /// Runs each function on this number of generated inputs
    #[arg(long, value_name = "COUNT", default_value_t = 1024,
        value_parser = clap::value_parser!(u32).range(1..=65_536))]
    cases: u32,
    /// Besides faults, also fails for findings of this class
    #[arg(long, value_name = "CLASS", value_parser = ["requirements"])]
    deny: Vec<String>,
    /// Shows every finding, also findings that no caller triggers and findings that change no result, and lists the
    /// functions that weren't checked
    #[arg(long)]
    all: bool,
    /// Also shows the hazards that karat.toml accepts
    #[arg(long)]
    accepted: bool,
    /// Prints JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    place: PlaceArgs,
}

type Input = (String, RangeInclusive<f64>);

/// Parses the name of a kind of hazard: `by_zero`, or `by-zero`. JSON and `no_hazards` in a `*.test.toml` use the same
/// names.
fn kind(text: &str) -> Result<Kind, String> {
    let name = serde_json::Value::String(text.replace('-', "_"));
    serde_json::from_value(name).map_err(|error| error.to_string())
}

/// Parses `roughness=0.05..1`.
fn input(text: &str) -> Result<Input, String> {
    let wrong = || "write NAME=LEAST..MOST, such as roughness=0.05..1".to_owned();
    let (name, range) = text.split_once('=').ok_or_else(wrong)?;
    let (least, most) = range.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
    let (least, most) = (number(least)?, number(most.trim_start_matches('='))?);
    if !(least <= most && least.is_finite() && most.is_finite()) {
        return Err(format!("{least} to {most} isn't a range: write the smaller number first"));
    }
    Ok((name.trim().to_owned(), least..=most))
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let packages = project.packages(&args.place.package())?;
    let twice = |at: usize| args.inputs[..at].iter().any(|(name, _)| *name == args.inputs[at].0);
    if let Some(at) = (0..args.inputs.len()).find(|at| twice(*at)) {
        bail!("two --input options name the same input, `{}`", args.inputs[at].0);
    }
    let overrides = call::bind::overrides_in(&packages, &args.overrides)?;
    let mut all = Vec::new();
    // Each package has its own inputs. An input that no package has is an error.
    let mut unknown: BTreeMap<String, Vec<HazardError>> = BTreeMap::new();
    for package in &packages {
        tell_beside(package);
        let mut inputs: Vec<&Input> = args.inputs.iter().collect();
        let mut found = loop {
            match look(args, package, (&inputs, &overrides))? {
                // An unknown input in a package's `karat.toml` is an error of that package.
                Err(HazardError::UnknownInput { name, nearest, place })
                    if packages.len() > 1 && place.is_empty() =>
                {
                    inputs.retain(|(own, _)| *own != name);
                    let error = HazardError::UnknownInput { name: name.clone(), nearest, place };
                    unknown.entry(name).or_default().push(error);
                }
                found => break found?,
            }
        };
        found.package = project::title(package, &packages);
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
                    "{DIM}--only leaves out the callers of the selected functions, so a finding may need arguments that no caller passes{DIM:#}"
                )?;
            }
            all.iter()
                .try_for_each(|(hazards, others)| write_text(hazards, *others, args.all, out))?;
        }
    }
    let is_read = all.iter().all(|(hazards, _)| hazards.unread + hazards.invalid == 0);
    let are_requirements_denied = !args.deny.is_empty();
    let is_good = |hazards: &Hazards| {
        let is_met = !are_requirements_denied || hazards.requirements().next().is_none();
        hazards.faults().next().is_none() && is_met
    };
    let good = is_read && all.iter().all(|(hazards, _)| is_good(hazards));
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// Prints a note if there is a `karat.toml` beside the package's folder and none inside it, because Karat reads only a
/// file inside.
fn tell_beside(package: &Package) {
    let root = package.root();
    let beside = root.parent().map(|around| around.join(project::MANIFEST));
    let (Some(beside), true) = (beside, root.is_dir()) else { return };
    if beside.is_file() && !root.join(project::MANIFEST).is_file() {
        let (beside, root) = (shown(&beside), shown(&root));
        tell(&format!(
            "Karat doesn't read `{beside}`: move this file into the folder of the package, `{root}`"
        ));
    }
}

/// Removes the hazards of kinds that aren't in `kinds`. If `kinds` is empty, removes nothing. Returns the number of
/// removed findings.
fn keep_kinds(hazards: &mut Hazards, kinds: &[Kind]) -> usize {
    let Hazards { found, others, .. } = hazards;
    let is_asked = |hazard: &Hazard| {
        let mut own = std::iter::once(&hazard.kind).chain(&hazard.kinds);
        kinds.is_empty() || own.any(|kind| kinds.contains(kind))
    };
    others.retain(is_asked);
    found.extract_if(.., |hazard| !is_asked(hazard)).count()
}

fn look(
    args: &Args,
    package: &Package,
    (inputs, overrides): (&[&Input], &BTreeMap<String, f64>),
) -> anyhow::Result<Result<Hazards, HazardError>> {
    // The bar shows on a terminal only.
    let bar = ProgressBar::new(0).with_message(package.name());
    bar.set_style(ProgressStyle::with_template("{msg}: {pos} of {len} functions {wide_bar}")?);
    let request = karat_inspect::hazards(package).only(args.only.iter().map(String::as_str));
    let request = if args.accepted { request.with_accepted() } else { request };
    let own = call::bind::overrides_of(package, overrides);
    let request = own.iter().fold(request, |all, (name, x)| all.with_override(name, *x));
    let declare = |request: karat_inspect::hazards::Request, (name, range): &&Input| {
        request.input(name, range.clone())
    };
    let request = inputs.iter().fold(request, declare).cases(args.cases as usize);
    let began = Instant::now();
    let found = request.run_with(&|at| {
        bar.set_length(at.of as u64);
        bar.set_position(at.done as u64);
        if at.found > 0 && began.elapsed() > PATIENCE {
            let found = counted(at.found, "finding");
            let line = format!(
                "checked {} of {} functions: {found} in `{}`; Karat checks the callers of this function later",
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
    let Hazards { package, skipped, unread, invalid, found, accepted, drawn, unseen, .. } = hazards;
    if all {
        for hazard in found.iter().chain(&hazards.others) {
            write_one(hazard, &[], out)?;
        }
        for (name, why) in skipped {
            writeln!(out, "{DIM}not checked: {name}: {why}{DIM:#}")?;
        }
        for line in &hazards.unreached {
            writeln!(out, "{DIM}no input reaches {line}{DIM:#}")?;
        }
    } else {
        write_groups(found, out)?;
        write_reasons(skipped, out)?;
    }
    for functions in &hazards.needless {
        let why = "only a fault needs an entry, and this hazard isn't a fault: remove the entry";
        writeln!(out, "{DIM}karat.toml accepts a hazard of {functions}: {why}{DIM:#}")?;
    }
    write_drawn(drawn, all, out)?;
    let style = if hazards.faults().next().is_none() { GOOD } else { BAD };
    write!(out, "{style}{package}: {}{style:#}", hazards.counts())?;
    if others > 0 {
        write!(out, ", {others} of kinds that --kind excludes")?;
    }
    if *accepted > 0 {
        write!(out, ", {accepted} accepted in karat.toml")?;
    }
    let others = skipped.len() - unread - invalid;
    if others > 0 {
        write!(out, ", {} not checked", counted(others, "function"))?;
    }
    if *invalid > 0 {
        let why = "not checked, because naga rejects the code: `karat check` says why";
        write!(out, ", {} {why}", counted(*invalid, "function"))?;
    }
    if *unread > 0 {
        write!(out, ", {} not read: `karat check` says why", counted(*unread, "module"))?;
    }
    let Unseen { inputs, functions, in_part, of_state } = *unseen;
    if inputs > 0 {
        let of = counted(functions, "function");
        write!(out, ", {} of {of} left out, because loops ran too long", counted(inputs, "input"))?;
    }
    if !hazards.unreached.is_empty() {
        write!(out, ", no input reaches {}", counted(hazards.unreached.len(), "line"))?;
    }
    if of_state > 0 {
        let of = counted(of_state, "function");
        write!(out, ", {of} checked only with the initial values of large private variables")?;
    }
    if in_part > 0 {
        write!(
            out,
            ", {} checked only in part, because of too many operations",
            counted(in_part, "function")
        )?;
    }
    writeln!(out)?;
    Ok(())
}

/// The largest number of arguments in a printed line about the ranges of arguments, unless you pass `--all`.
const NAMES: usize = 12;

/// Prints the ranges from which Karat generated the arguments.
fn write_drawn(drawn: &Drawn, all: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    for line in drawn.lines(if all { usize::MAX } else { NAMES }) {
        writeln!(out, "{DIM}generated {line}{DIM:#}")?;
    }
    Ok(())
}

/// Prints the most frequent reasons why functions weren't checked, each with one of the functions and the number of the
/// other functions.
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
        writeln!(out, "{DIM}not checked: {name}{more}: {why}{DIM:#}")?;
    }
    if reasons.len() > REASONS {
        let more = reasons.len() - REASONS;
        writeln!(out, "{DIM}--all shows {more} more reasons for not checking functions{DIM:#}")?;
    }
    Ok(())
}

/// Groups similar findings. A group has the requirements of one function that concern the same inputs. If Karat doesn't
/// know the inputs, a group has the requirements of one function and one kind. Each fault is a separate group. The
/// groups are in the order of their first findings.
fn groups(found: &[Hazard]) -> Vec<Vec<&Hazard>> {
    let mut groups: Vec<Vec<&Hazard>> = Vec::new();
    let mut known = BTreeMap::new();
    for (number, hazard) in found.iter().enumerate() {
        let own = (hazard.class == Class::Fault).then_some(number);
        let kind = hazard.needs.is_empty().then_some(hazard.kind);
        let at = *known.entry((&hazard.function, &hazard.needs, kind, own)).or_insert(groups.len());
        if at == groups.len() {
            groups.push(Vec::new());
        }
        groups[at].push(hazard);
    }
    groups
}

/// Prints the first finding of each group, and the number of other findings in the group. Prints only as many groups as
/// fit on the screen.
fn write_groups(found: &[Hazard], out: &mut dyn Write) -> anyhow::Result<()> {
    let groups = groups(found);
    let shown = groups.len().min(terminal::size().rows / LINES);
    for alike in &groups[..shown] {
        write_one(alike[0], &alike[1..], out)?;
    }
    let left: usize = groups[shown..].iter().map(Vec::len).sum();
    if left > 0 {
        writeln!(out, "--all also shows the other findings ({left})\n")?;
    }
    Ok(())
}

fn write_one(hazard: &Hazard, alike: &[&Hazard], out: &mut dyn Write) -> anyhow::Result<()> {
    let style = if hazard.class == Class::Fault { BAD } else { KNOWN };
    let (class, kind) = (hazard.class.name(), hazard.kind.name());
    let (operation, place) = (&hazard.text, &hazard.location);
    writeln!(out, "{style}{class}: {kind}{style:#}  {HEAD}{operation}{HEAD:#}  {place}")?;
    writeln!(out, "{DIM}{}{DIM:#}", hazard.details())?;
    if let [next, ..] = alike {
        let (count, place) = (alike.len(), &next.location);
        let like = if hazard.needs.is_empty() {
            "similar findings"
        } else {
            "other findings that depend on the same inputs"
        };
        writeln!(out, "{DIM}    {like}: {count}; the next finding is at {place}{DIM:#}")?;
    }
    writeln!(out)?;
    Ok(())
}
