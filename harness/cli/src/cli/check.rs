//! `karat check`: validates whole packages, and runs nothing.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use karat::Package;
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
                writeln!(out, "\n{HEAD}{}{HEAD:#}: {invalid}", package.name())?;
            }
        }
    }
    Ok(valid)
}

/// Validates packages that nobody declares and that tests used, as [`validate`]. A module is valid if it
/// is as its folder says, or as a test that ran uses the package, with features and dependencies.
pub(super) fn validate_used(
    packages: &[Package],
    run: &Path,
    out: &mut dyn Write,
) -> anyhow::Result<bool> {
    let uses: Vec<Package> = Dependence::all(run)
        .with_context(|| format!("can't read what tests used in `{}`", run.display()))?
        .iter()
        .filter_map(Dependence::package)
        .collect();
    let place = |package: &Package| package.root().canonicalize().ok();
    let mut valid = true;
    for package in packages {
        let Err(mut invalid) = package.try_is_valid() else { continue };
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
        if !matches!(&invalid, Invalid::Modules { errors, .. } if errors.is_empty()) {
            valid = false;
            writeln!(out, "\n{HEAD}{}{HEAD:#}: {invalid}", package.name())?;
        }
    }
    Ok(valid)
}
