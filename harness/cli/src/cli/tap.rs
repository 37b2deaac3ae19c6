//! `karat tap`: shows values of a frame's fragment functions as images.

use std::io::Write;

use anyhow::{anyhow, bail, ensure};
use karat::unstable::diagnostic::nearest;
use karat::unstable::frame::Tap;
use karat::unstable::output::tell;
use karat_gallery::{DrawArguments, RenderArguments, Tappable};
use karat_suite::Suite;

use super::project::Project;
use super::{Ending, Outcome, PackageArgs, render};

pub(super) const EXAMPLES: &str = "\
Examples:
  karat tap scene                          lists the values of the frame `scene`
  karat tap scene n_dot_v half             shows two values, by the names of their `let`
  karat tap scene shaders/brdf.wgsl:42:13  shows the largest expression that begins there
  karat tap scene half --at 120,64         also shows the value that Karat's engine computes there
  karat tap scene term --round 3           shows the third value that each pixel computed
  karat tap scene karat:print              shows the values that the lines `//karat: print x` name
FRAME is a name: of a `[[frame]]` in a `*.test.toml`, of a frame in the gallery (`karat render --list`), or of the last
entry point of a `[[compute]]`. For a compute pass, Karat shows the value of each invocation.
The driver computes each value while it draws. Pixels that don't compute the value are transparent, and Karat counts
these pixels.
Exit codes: 0 every value is shown; 1 a value can't be shown; 2 the frame doesn't exist, or no driver opens.";

#[derive(clap::Args)]
pub(super) struct Args {
    /// The name of a frame or of a compute pass
    frame: String,
    /// The value to show: the name of a `let` or a parameter, an expression that occurs once, a place (FILE:LINE,
    /// FILE:LINE:COLUMN), or `karat:print`
    #[arg(value_name = "VALUE")]
    values: Vec<String>,
    /// If a pixel computes the value several times, shows the Nth result, counted from 1 [default: the last result]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    round: Option<u32>,
    /// Also prints the value that Karat's engine computes at this pixel or invocation; may be repeated
    #[arg(long, value_name = "X,Y", value_parser = karat_gallery::pixel, requires = "values")]
    at: Vec<(u32, u32)>,
    /// Draws the frame's colours and the value together, and compares these colours with the usual frame. The colours
    /// differ if the driver computes the frame in another way while it shows a value
    #[arg(long)]
    beside: bool,
    #[command(flatten)]
    drawn: DrawArguments,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    if let Some(passes) = passes(args, &project, out)? {
        return Ok(passes);
    }
    let Some(suite) = find(&args.frame, &project, &args.package)? else {
        let (values, drawn) = (args.values.clone(), args.drawn.clone());
        let how = (args.round, args.beside, args.at.clone());
        let arguments = RenderArguments::tapping(&args.frame, values, how, drawn);
        return render::run(arguments, out);
    };
    let frame = suite.frame(&args.frame).expect("it was there");
    tell_of(&frame.map_err(|wrong| anyhow!("{}", wrong.message))?, args, &project, out)
}

/// Taps the passes of the `[[compute]]` that the user named. Returns `None` if there is no such `[[compute]]`.
fn passes(args: &Args, project: &Project, out: &mut dyn Write) -> anyhow::Result<Option<Ending>> {
    // Without a folder of shaders, there may be a gallery. The search for frames is next, and reports the error.
    for package in project.packages(&args.package).unwrap_or_default() {
        let suite = Suite::of(package)?;
        if let Some(compute) = suite.compute(&args.frame) {
            let compute = compute.map_err(|wrong| anyhow!("{}", wrong.message))?;
            ensure!(!args.beside, "passes have no colours to compare: remove `--beside`");
            return tell_of(&compute, args, project, out).map(Some);
        }
    }
    Ok(None)
}

fn tell_of(subject: &dyn Tappable, args: &Args, project: &Project, out: &mut dyn Write) -> Outcome {
    let path = karat_gallery::open(expect_own(&args.drawn)?)?;
    let folder = args.drawn.out.clone().unwrap_or_else(|| project.output().join("frames"));
    std::fs::create_dir_all(&folder)?;
    let tap = |value: &String| Tap::new(value).round(args.round).beside(args.beside);
    let taps: Vec<Tap> = args.values.iter().map(tap).collect();
    // The file is named after the full name of the pass.
    let name = args.frame.replace("::", "-");
    match karat_gallery::tap(subject, &name, &folder, path, (&taps, &args.at), out) {
        Ok(()) => Ok(Ending::Good),
        Err(error) => {
            refuse(&*error);
            Ok(Ending::Bad)
        }
    }
}

/// Returns the suite that has the `[[frame]]`, or `None` if only the gallery can have the frame.
pub(super) fn find(
    frame: &str,
    project: &Project,
    place: &PackageArgs,
) -> anyhow::Result<Option<Suite>> {
    let mut names: Vec<String> = Vec::new();
    let is_usual = place.package.is_none() && place.krate.is_none();
    let packages = match (project.packages(place), project.gallery()) {
        // A project may have a gallery without a folder of shaders.
        (Err(_), Some(_)) if is_usual => Vec::new(),
        (packages, _) => packages?,
    };
    for package in packages {
        let suite = Suite::of(package)?;
        if suite.frame(frame).is_some() {
            return Ok(Some(suite));
        }
        let own = suite.tests.iter().filter(|test| test.is_frame());
        names.extend(own.filter_map(|test| Some(test.name.strip_prefix("frame ")?.to_owned())));
    }
    if project.gallery().is_some() {
        return Ok(None);
    }
    match nearest(frame, names.iter().map(String::as_str)) {
        Some(near) => bail!("there is no frame `{frame}`; did you mean `{near}`?"),
        None if names.is_empty() => bail!(
            "the project has no frame: no `*.test.toml` has a `[[frame]]`, and Cargo.toml names no gallery (`karat render` explains galleries)"
        ),
        None => bail!("there is no frame `{frame}`; the frames are {}", names.join(", ")),
    }
}

/// Returns the path on which a `[[frame]]` is drawn. Returns an error if an option sets a property that the `[[frame]]`
/// sets itself.
pub(super) fn expect_own(drawn: &DrawArguments) -> anyhow::Result<Option<karat::Path>> {
    ensure!(
        drawn.size.is_none() && drawn.samples.is_none() && drawn.environment.is_none(),
        "a `[[frame]]` in a `*.test.toml` sets its own size, samples and light: remove `--size`, `--samples` and \
         `--environment`"
    );
    Ok(drawn.path)
}

/// Prints the reason why a value can't be shown.
pub(super) fn refuse(error: &dyn std::error::Error) {
    let text = error.to_string();
    tell(&if text.starts_with("error") { text } else { format!("error: {text}") });
}
