//! `karat tap`: values of a frame's fragment functions as pictures.

use std::io::Write;

use anyhow::{anyhow, bail, ensure};
use karat::unstable::diagnostic::nearest;
use karat::unstable::output::tell;
use karat_gallery::{DrawArguments, RenderArguments};
use karat_suite::Suite;

use super::project::Project;
use super::{Ending, Outcome, PackageArgs, render};

pub(super) const EXAMPLES: &str = "\
Examples:
  karat tap scene                          the values that the frame `scene` has
  karat tap scene n_dot_v half             two of them, by the names of their `let`
  karat tap scene shaders/brdf.wgsl:42:13  the largest expression that begins there
  karat tap scene term --round 3           what each pixel computed for the third time
FRAME is the name of a `[[frame]]` in a `*.test.toml`, or a frame of the gallery that `karat render` draws.
The driver computes each value in the frame's own draws. Pixels that don't come to it are transparent, and counted.
Exit codes: 0 each value was told; 1 one can't be; 2 there is no such frame, or no driver.";

#[derive(clap::Args)]
pub(super) struct Args {
    /// The frame
    frame: String,
    /// A `let` or a parameter by its name, an expression that stands once, or a place: FILE:LINE[:COLUMN]
    #[arg(value_name = "VALUE")]
    values: Vec<String>,
    /// What a pixel computed for this time, from 1 [default: the last]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    round: Option<u32>,
    #[command(flatten)]
    drawn: DrawArguments,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let mut names: Vec<String> = Vec::new();
    // A project may have a gallery and no folder of shaders.
    for package in project.packages(&args.package).unwrap_or_default() {
        let Ok(suite) = Suite::of(package) else { continue };
        if suite.frame(&args.frame).is_some() {
            return declared(args, &suite, &project, out);
        }
        let own = suite.tests.iter().filter(|test| test.is_frame());
        names.extend(own.filter_map(|test| Some(test.name.strip_prefix("frame ")?.to_owned())));
    }
    if project.gallery().is_some() {
        let (values, drawn) = (args.values.clone(), args.drawn.clone());
        return render::run(RenderArguments::tapping(&args.frame, values, args.round, drawn), out);
    }
    let frame = &args.frame;
    match nearest(frame, names.iter().map(String::as_str)) {
        Some(near) => bail!("there is no frame `{frame}`; did you mean `{near}`?"),
        None if names.is_empty() => bail!(
            "there is no frame: no `*.test.toml` has a `[[frame]]`, and Cargo.toml names no gallery, which `karat render` tells more of"
        ),
        None => bail!("there is no frame `{frame}`; there are {}", names.join(", ")),
    }
}

/// Of a `[[frame]]`.
fn declared(args: &Args, suite: &Suite, project: &Project, out: &mut dyn Write) -> Outcome {
    let DrawArguments { out: folder, size, samples, environment, path, .. } = args.drawn.clone();
    ensure!(
        size.is_none() && samples.is_none() && environment.is_none(),
        "a `[[frame]]` says its size and its samples itself, and its light: leave `--size`, `--samples` and \
         `--environment` out"
    );
    let frame = suite.frame(&args.frame).expect("it was there");
    let frame = frame.map_err(|wrong| anyhow!("{}", wrong.message))?;
    let path = karat_gallery::open(path)?;
    let folder = folder.unwrap_or_else(|| project.output().join("frames"));
    std::fs::create_dir_all(&folder)?;
    let told =
        karat_gallery::tap(&frame, &args.frame, &folder, path, (&args.values, args.round), out);
    match told {
        Ok(()) => Ok(Ending::Good),
        Err(error) => {
            // What was written before stays, and the reason is the command's.
            tell(&format!("error: {error}"));
            Ok(Ending::Bad)
        }
    }
}
