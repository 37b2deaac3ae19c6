//! `karat check`: validates whole packages, and runs no test.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::Package;
use karat::unstable::diagnostic::Diagnostic;
use karat::unstable::output::{counted, name};
use karat::unstable::record::Recorded;
use karat::unstable::reflect::{Dependence, Invalid, Opinion};

use super::project::{self, Project};
use super::search::{self, Found};
use super::table::{BAD, GOOD, HEAD};
use super::{Ending, Outcome, PlaceArgs};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Fails unless this compiler also accepts each module, even if karat.toml doesn't require that compiler
    #[arg(long, value_name = "COMPILER")]
    require: Option<Compiler>,
    #[command(flatten)]
    place: PlaceArgs,
}

/// A WGSL compiler, besides naga, that can check modules.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Compiler {
    Tint,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let mut found = project.found(&args.place.package())?;
    if args.require.is_some() {
        found.iter_mut().for_each(|one| one.package = one.package.require_tint());
    }
    let uses = match found.iter().all(|one| one.stated) {
        true => Vec::new(),
        false => recorded_uses(&project)?,
    };
    let (valid, opinion) = validate_found(&found, &uses, true, out)?;
    let broken = search::broken_files(found.iter().map(|one| &one.package))?;
    search::write_broken(&broken, out)?;
    args.place.write_outside(out)?;
    let good = valid && broken.is_empty();
    let style = if good { GOOD } else { BAD };
    let packages = counted(found.len(), "package");
    let are = match (valid, broken.len()) {
        (false, _) => "checked: some modules aren't valid".to_owned(),
        (true, 0) => "valid".to_owned(),
        (true, errors) => format!("valid, but the test files have {}", counted(errors, "error")),
    };
    let opinion_of = match opinion.to_string() {
        text if text.is_empty() => text,
        text => format!("; {text}"),
    };
    writeln!(out, "{style}{packages} {are}{style:#}{opinion_of}")?;
    Ok(if good { Ending::Good } else { Ending::Bad })
}

/// Returns the packages that the tests of the last run used, with the features that these tests set. Returns no
/// packages if there was no run.
pub(super) fn recorded_uses(project: &Project) -> anyhow::Result<Vec<Package>> {
    match Recorded::read(&project.record())? {
        Some(last) => uses(&last.folder),
        None => Ok(Vec::new()),
    }
}

/// Validates packages, prints each invalid module, and checks if all modules are valid. With `all`, also lists the
/// valid packages.
pub(super) fn validate(
    packages: &[Package],
    all: bool,
    out: &mut dyn Write,
) -> anyhow::Result<bool> {
    let found: Vec<Found> = packages.iter().cloned().map(Found::stated).collect();
    Ok(validate_found(&found, &[], all, out)?.0)
}

/// Does the work of [`validate`], and also returns the verdicts of compilers other than naga. In an undeclared package
/// (see `Found::stated`), Karat also accepts modules that are valid in a package of `uses`, which has the features that
/// a test set.
fn validate_found(
    found: &[Found],
    uses: &[Package],
    all: bool,
    out: &mut dyn Write,
) -> anyhow::Result<(bool, Opinion)> {
    let (mut valid, mut opinion) = (true, Opinion::default());
    for Found { package, stated } in found {
        let title = project::title(package, found.iter().map(|found| &found.package));
        match package.try_is_valid() {
            Ok(found) => {
                if all {
                    writeln!(out, "{GOOD}{title}: valid{GOOD:#} ({found})")?;
                    write_remarks(&found.opinion, out)?;
                }
                opinion.add(&found.opinion);
            }
            Err(Invalid::Package(error)) => return Err(error.into()),
            Err(invalid) => {
                let own = invalid.opinion().cloned().unwrap_or_default();
                let uses = if *stated { &[] } else { uses };
                let mut remarks = own.remarks();
                match as_used(invalid, package, uses) {
                    Some(invalid) => {
                        valid = false;
                        remarks = own.remarks_beside(&invalid);
                        write(&[(title, invalid)], out)?;
                    }
                    None if all => {
                        writeln!(
                            out,
                            "{GOOD}{title}: valid{GOOD:#} with the features that the tests set"
                        )?;
                    }
                    None => {}
                }
                if all {
                    write_each(&remarks, out)?;
                    write_broke(&own, out)?;
                }
                opinion.add(&own);
            }
        }
    }
    Ok((valid, opinion))
}

/// Formats the remarks that other compilers make on modules that naga accepts: first a summary line, then each remark.
/// Returns `None` if there are no remarks.
pub(super) fn remarks(opinion: &Opinion) -> Option<String> {
    let mut text = opinion.remark()?;
    for remark in opinion.remarks() {
        text = format!("{text}\n{}", remark.to_warning());
    }
    Some(text)
}

/// Prints each remark of Tint once, and the modules for which Tint has no verdict.
pub(super) fn write_remarks(opinion: &Opinion, out: &mut dyn Write) -> std::io::Result<()> {
    write_each(&opinion.remarks(), out)?;
    write_broke(opinion, out)
}

fn write_each(remarks: &[&Diagnostic], out: &mut dyn Write) -> std::io::Result<()> {
    for remark in remarks {
        writeln!(out, "\n{}", remark.to_warning())?;
    }
    if remarks.is_empty() { Ok(()) } else { writeln!(out) }
}

fn write_broke(opinion: &Opinion, out: &mut dyn Write) -> std::io::Result<()> {
    for (module, how) in &opinion.broke {
        let of = if module.is_empty() { String::new() } else { format!(" on `{module}`") };
        writeln!(out, "{BAD}Tint has no verdict{of}{BAD:#}: {how}")?;
    }
    Ok(())
}

/// Prints the name of each invalid package, and its errors.
pub(super) fn write(invalid: &[(String, Invalid)], out: &mut dyn Write) -> std::io::Result<()> {
    let mut each = invalid.iter();
    each.try_for_each(|(name, invalid)| writeln!(out, "\n{HEAD}{name}{HEAD:#}: {invalid}"))
}

/// Returns two lists of names: the invalid modules, and the packages that Karat refuses as a whole.
pub(super) fn names(invalid: &[(String, Invalid)]) -> (Vec<String>, Vec<String>) {
    let (mut modules, mut packages) = (Vec::new(), Vec::new());
    for (package, invalid) in invalid {
        match invalid {
            Invalid::Modules { errors, .. } => {
                modules.extend(errors.iter().map(|(module, _)| name(module).into_owned()));
            }
            _ => packages.push(name(package).into_owned()),
        }
    }
    modules.dedup();
    (modules, packages)
}

/// Returns the invalid packages, and the verdicts of compilers other than naga on all packages. Karat validates a
/// package with the settings in its `karat.toml`. In an undeclared package (see `Found::stated`), Karat also accepts
/// modules that are valid with the features and dependencies of a test in the record `run`.
pub(super) fn invalid(
    found: &[Found],
    run: &Path,
) -> anyhow::Result<(Vec<(String, Invalid)>, Opinion)> {
    let (mut all, mut opinion) = (Vec::new(), Opinion::default());
    let mut known: Option<Vec<Package>> = None;
    for Found { package, stated } in found {
        let invalid = match package.try_is_valid() {
            Ok(found) => {
                opinion.add(&found.opinion);
                continue;
            }
            Err(Invalid::Package(error)) if *stated => return Err(error.into()),
            Err(invalid) => invalid,
        };
        opinion.add(invalid.opinion().unwrap_or(&Opinion::default()));
        let invalid = match (stated, &mut known) {
            (true, _) => Some(invalid),
            (false, Some(uses)) => as_used(invalid, package, uses),
            (false, none) => as_used(invalid, package, none.insert(uses(run)?)),
        };
        all.extend(invalid.map(|invalid| (package.name(), invalid)));
    }
    Ok((all, opinion))
}

/// Returns the folders and files of the packages that the tests of a run used.
pub(super) fn linked(run: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let all = Dependence::all(run).with_context(|| unread(run))?;
    Ok(all.iter().filter_map(|one| Some(one.place()?.to_owned())).collect())
}

fn unread(run: &Path) -> String {
    format!("can't read the tests' packages from the record `{}`", run.display())
}

/// Returns the packages that the tests of a run used, with the features that these tests set.
pub(super) fn uses(run: &Path) -> anyhow::Result<Vec<Package>> {
    let all = Dependence::all(run).with_context(|| unread(run))?;
    Ok(all.iter().filter_map(Dependence::package).collect())
}

/// Removes from `invalid` the modules that are valid in a package of `uses`, which has the features and dependencies
/// that a test set. Returns `None` if no invalid module remains.
pub(super) fn as_used(
    mut invalid: Invalid,
    package: &Package,
    uses: &[Package],
) -> Option<Invalid> {
    let place = |package: &Package| package.root().canonicalize().ok();
    let mut tried: Vec<&Package> = vec![package];
    for used in uses.iter().filter(|used| place(used) == place(package)) {
        if tried.contains(&used) {
            continue;
        }
        tried.push(used);
        let Invalid::Modules { errors, .. } = &mut invalid else { break };
        match used.try_is_valid() {
            Ok(_) => errors.clear(),
            Err(Invalid::Modules { errors: others, .. }) => {
                errors.retain(|(module, _)| others.iter().any(|(other, _)| other == module));
            }
            Err(_) => {}
        }
    }
    let none = matches!(&invalid, Invalid::Modules { errors, .. } if errors.is_empty());
    (!none).then_some(invalid)
}
