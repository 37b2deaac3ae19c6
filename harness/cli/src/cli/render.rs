//! `karat render`: builds the project's gallery, and runs it.

use std::io::{IsTerminal, Write};
use std::process::Command;

use anyhow::{Context, bail};
use karat_gallery::RenderArguments;

use super::project::Project;
use super::{Ending, Outcome, Reported, child};

const HOW_TO_DECLARE: &str = "\
this project declares no gallery. A gallery is a Cargo binary that lists frames. To declare a gallery, write

  in the Cargo.toml of the workspace (or `package.metadata.karat` in the Cargo.toml of a package):

    [workspace.metadata.karat]
    gallery = \"gallery\"

  in the Cargo.toml of a package that depends on karat:

    [[bin]]
    name = \"gallery\"
    path = \"frames/main.rs\"

  in frames/main.rs:

    static SHADERS: karat::Package = karat::package!(\"shaders\");

    fn main() -> std::process::ExitCode {
        karat_gallery::Gallery::new()
            .frame(\"scene\", \"what it shows\", |options| {
                let (width, height) = options.size_or(640, 360);
                Ok(SHADERS.frame(\"scene\", width, height).fullscreen(\"vertex\", \"fragment\"))
            })
            .main()
    }";

pub(super) fn run(arguments: RenderArguments, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let gallery = project.gallery().context(HOW_TO_DECLARE)?;
    let arguments = arguments.out_or(project.output().join("frames"));

    // Building is a separate step. A failed build must not look like a failure of the gallery.
    let mut build = cargo(&project, "build", gallery);
    if !std::io::stderr().is_terminal() {
        build.arg("--quiet");
    }
    let built = child::pass_on(&mut build, out)?;
    if !built.success() {
        bail!("can't build the gallery `{gallery}`, see above");
    }

    let mut run = cargo(&project, "run", gallery);
    run.arg("--quiet").arg("--").args(arguments.words());
    let status = child::pass_on(&mut run, out)?;
    match status.code() {
        Some(0) => Ok(Ending::Good),
        Some(1) => Ok(Ending::Bad),
        Some(2) => Err(Reported.into()),
        _ => bail!("the gallery `{gallery}` ended early ({status}), see above"),
    }
}

/// Returns a Cargo command, such as `cargo run`, for a binary of the project. It runs in the working directory, because
/// the user's paths are relative to that directory.
fn cargo(project: &Project, verb: &str, binary: &str) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args([verb, "--bin", binary, "--manifest-path"]);
    command.arg(project.root().join("Cargo.toml"));
    command
}
