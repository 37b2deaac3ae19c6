//! `karat show`

use std::io::Write;

use karat::probe::Probed;

use super::project::Project;
use super::{Ending, Outcome, PackageArgs};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The function: `module::name`
    function: String,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let package = Project::find()?.package_of(&args.package, &args.function)?;
    let probed = Probed::new(&package, &args.function)?;
    let function = probed.function();
    writeln!(out, "// {function}\n// {}", function.span)?;
    for binding in &function.bindings {
        writeln!(out, "// reads `{}`, {}", binding.path, binding.kind)?;
    }
    writeln!(out, "\n{}", probed.kernel().trim_end())?;
    Ok(Ending::Good)
}
