//! `karat check`: validates whole packages, and runs nothing.

use std::io::Write;

use karat::Package;
use karat::reflect::Invalid;

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
