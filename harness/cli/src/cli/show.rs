//! `karat show`

use std::io::Write;

use karat::Package;
use karat::unstable::probe::Probed;
use karat::unstable::reflect::Program;

use super::project::Project;
use super::{Ending, Outcome, PackageArgs};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The function, `module::name`; with --plain, a module
    #[arg(required_unless_present = "plain")]
    function: Option<String>,
    /// Prints a module as one text of plain WGSL, which a game engine can load: imports and conditions are resolved,
    /// tests are left out
    #[arg(long)]
    plain: bool,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let named = args.function.as_deref().unwrap_or_default();
    if args.plain {
        return plain(args, named, out);
    }
    let package = Project::find()?.package_of(&args.package, named)?;
    let probed = Probed::new(&package, named)?;
    let function = probed.function();
    writeln!(out, "// {function}\n// {}", function.span)?;
    for binding in &function.bindings {
        writeln!(out, "// reads `{}`, {}", binding.path, binding.kind)?;
    }
    writeln!(out, "\n{}", probed.kernel().trim_end())?;
    Ok(Ending::Good)
}

fn plain(args: &Args, module: &str, out: &mut dyn Write) -> Outcome {
    let packages = Project::find()?.packages(&args.package)?;
    let holds = |package: &&Package| {
        package.modules().is_ok_and(|modules| modules.iter().any(|known| known == module))
    };
    let package = packages.iter().find(holds).unwrap_or(&packages[0]);
    let program = Program::of_module(package, module)?;
    writeln!(out, "{}", program.text().trim())?;
    Ok(Ending::Good)
}
