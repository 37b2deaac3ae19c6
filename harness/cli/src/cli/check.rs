//! `karat check`: validates whole packages, and runs nothing.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use karat::Package;
use karat::output::name;
use karat::reflect::{Dependence, Invalid};

use super::project::Project;
use super::table::{GOOD, HEAD};
use super::{Ending, Outcome, PackageArgs};

#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let packages = Project::find()?.packages(&args.package)?;
    anyhow::ensure!(!packages.is_empty(), "`metadata.karat` lists no shader package");
    Ok(if validate(&packages, true, out)? { Ending::Good } else { Ending::Bad })
}

/// Validates packages and prints each module that isn't valid; whether all are. With `all` valid
/// packages are told, too.
pub(super) fn validate(
    packages: &[Package],
    all: bool,
    out: &mut dyn Write,
) -> anyhow::Result<bool> {
    let mut valid = true;
    for package in packages {
        match package.try_is_valid() {
            Ok(found) if all => {
                writeln!(out, "{GOOD}{}: valid{GOOD:#} ({found})", package.name())?;
            }
            Ok(_) => {}
            Err(Invalid::Package(error)) => return Err(error.into()),
            Err(invalid) => {
                valid = false;
                write(&[(package.name(), invalid)], out)?;
            }
        }
    }
    Ok(valid)
}

/// Packages that aren't valid, by their names, as people read it.
pub(super) fn write(invalid: &[(String, Invalid)], out: &mut dyn Write) -> std::io::Result<()> {
    let mut each = invalid.iter();
    each.try_for_each(|(name, invalid)| writeln!(out, "\n{HEAD}{name}{HEAD:#}: {invalid}"))
}

/// The modules of packages that aren't valid; a package that has none goes by its own name.
pub(super) fn names(invalid: &[(String, Invalid)]) -> Vec<String> {
    let mut names = Vec::new();
    for (package, invalid) in invalid {
        match invalid {
            Invalid::Modules { errors, .. } => {
                names.extend(errors.iter().map(|(module, _)| name(module).into_owned()));
            }
            _ => names.push(name(package).into_owned()),
        }
    }
    names
}

/// The packages that aren't valid.
pub(super) fn invalid(packages: &[Package]) -> anyhow::Result<Vec<(String, Invalid)>> {
    let mut all = Vec::new();
    for package in packages {
        match package.try_is_valid() {
            Ok(_) => {}
            Err(Invalid::Package(error)) => return Err(error.into()),
            Err(invalid) => all.push((package.name(), invalid)),
        }
    }
    Ok(all)
}

/// Those that aren't valid of packages that nobody declares and that tests used.
pub(super) fn invalid_as_used(
    packages: &[Package],
    run: &Path,
) -> anyhow::Result<Vec<(String, Invalid)>> {
    let uses = uses(run)?;
    let found =
        packages.iter().filter_map(|package| Some((package.name(), as_used(package, &uses)?)));
    Ok(found.collect())
}

/// The packages as the tests of a run used them.
pub(super) fn uses(run: &Path) -> anyhow::Result<Vec<Package>> {
    let all = Dependence::all(run)
        .with_context(|| format!("can't read what tests used in `{}`", run.display()))?;
    Ok(all.iter().filter_map(Dependence::package).collect())
}

/// What isn't valid of a package. A module is valid if it is as its folder says, or as a test uses the
/// package, with features and dependencies.
pub(super) fn as_used(package: &Package, uses: &[Package]) -> Option<Invalid> {
    let place = |package: &Package| package.root().canonicalize().ok();
    let mut invalid = package.try_is_valid().err()?;
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
