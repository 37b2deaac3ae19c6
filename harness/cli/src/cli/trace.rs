//! `karat trace`: shows each step that computes one pixel of a frame.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, anyhow, ensure};
use karat::Image;
use karat::unstable::output::trusted;
use karat::unstable::value::format_f32;
use karat_gallery::{DrawArguments, RenderArguments, Row, Traced};
use serde::Serialize;

use super::git::shaders_at;
use super::project::Project;
use super::table::{BAD, DIM, GOOD, HEAD};
use super::tap;
use super::{Ending, Outcome, PackageArgs, call, child, render, write_json};

pub(super) const EXAMPLES: &str = "\
Examples:
  karat trace scene 120,64                 traces column 120, row 64; 0,0 is at the upper left
  karat trace scene 120,64 --against HEAD  shows the first step that differs from a revision of git
  karat trace scene 120,64 --layer 2       traces the draw behind the visible one
FRAME is a name: of a `[[frame]]` in a `*.test.toml`, or of a frame in the gallery (`karat render --list`).
The driver computes the inputs of the pixel's fragment function. Then Karat's engine computes each step of the function
in f32, in f64, and with the error bounds of WGSL.
Exit codes: 0 the pixel is traced, and with --against no step differs; 1 the pixel can't be traced, or a step differs
from the revision; 2 the frame doesn't exist, or no driver opens.";

#[derive(clap::Args)]
pub(super) struct Args {
    /// The name of the frame
    frame: String,
    /// The column and the row of the pixel, from 0,0 at the upper left
    #[arg(value_name = "X,Y", value_parser = karat_gallery::pixel)]
    pixel: (u32, u32),
    /// Traces the Nth draw from the front that covers the pixel: 1 is the visible draw, 2 the draw behind it
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    layer: u32,
    /// Compares the steps with the steps of the shaders at this revision of git
    #[arg(long, value_name = "REVISION")]
    against: Option<String>,
    /// Prints JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    drawn: DrawArguments,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    let Some(traced) = traced(args, &project)? else { return Ok(Ending::Bad) };
    let Some(revision) = &args.against else {
        match args.json {
            true => write_json(&told(args, &traced, &project), out)?,
            false => write(args, &traced, &project, out)?,
        }
        return Ok(Ending::Good);
    };
    let Some(before) = at_revision(args, &project, revision)? else {
        if args.json {
            let today = told(args, &traced, &project);
            write_json(&[&today, &today], out)?;
            return Ok(Ending::Good);
        }
        writeln!(out, "{DIM}the shaders are the same as at {revision}: no step differs{DIM:#}")?;
        return Ok(Ending::Good);
    };
    match args.json {
        // The page of `karat review` reads this format.
        true => write_json(&[&before, &traced].map(|one| told(args, one, &project)), out)?,
        false => write_parting(&before, &traced, revision, out)?,
    }
    let as_long = before.steps.len() == traced.steps.len();
    let same = as_long && first_difference(&before, &traced) == traced.steps.len();
    Ok(if same && before.engine == traced.engine { Ending::Good } else { Ending::Bad })
}

/// A pixel in JSON. Numbers are strings, because JSON has no NaN.
#[derive(Serialize)]
struct Told<'t> {
    frame: &'t str,
    pixel: (u32, u32),
    /// The pixel of the golden, if a golden has the frame's name and size.
    golden: Option<String>,
    #[serde(flatten)]
    traced: &'t Traced,
}

fn told<'t>(args: &'t Args, traced: &'t Traced, project: &Project) -> Told<'t> {
    Told { frame: &args.frame, pixel: args.pixel, golden: golden(args, project), traced }
}

/// Traces the pixel. If that isn't possible, prints the reason to standard error and returns `None`.
fn traced(args: &Args, project: &Project) -> anyhow::Result<Option<Traced>> {
    if let Some(suite) = tap::find(&args.frame, project, &args.package)? {
        let path = tap::expect_own(&args.drawn)?;
        let frame = suite.frame(&args.frame).expect("it was there");
        let frame = frame.map_err(|wrong| anyhow!("{}", wrong.message))?;
        return match frame.trace_layer(karat_gallery::open(path)?, args.pixel, args.layer) {
            Ok(pixel) => Ok(Some(pixel.into())),
            Err(error) => {
                tap::refuse(&error);
                Ok(None)
            }
        };
    }
    let drawn = args.drawn.clone();
    let arguments = RenderArguments::tracing(&args.frame, args.pixel, args.layer, drawn);
    let mut printed = Vec::new();
    if render::run(arguments, &mut printed)? != Ending::Good {
        return Ok(None);
    }
    let json = String::from_utf8(printed).context("the gallery printed bytes that aren't UTF-8")?;
    let traced = serde_json::from_str(trusted(&json).trim())
        .context("the gallery printed no trace: does it use another version of `karat-gallery`?")?;
    Ok(Some(traced))
}

/// Traces the same pixel with the shaders of a revision. Returns `None` if the shaders haven't changed.
fn at_revision(args: &Args, project: &Project, revision: &str) -> anyhow::Result<Option<Traced>> {
    let folder = tempfile::tempdir().context("can't make a temporary folder")?;
    let overlay = folder.path().join("overlay");
    let mut any = false;
    for package in project.packages(&args.package)? {
        let before = folder.path().join("before");
        shaders_at(revision, &package.root(), &before)?;
        any |= keep_changed(&before, &package.root(), &overlay.join(package.name()))?;
        std::fs::remove_dir_all(&before).context("can't make a temporary folder")?;
    }
    if !any {
        return Ok(None);
    }
    let program = std::env::current_exe().context("can't find karat's executable file")?;
    let mut command = Command::new(program);
    // The arguments are the same, but without the revision: the overlay contains its shaders.
    let mut words = std::env::args_os().skip(1);
    while let Some(word) = words.next() {
        match word.to_str() {
            Some("--against") => drop(words.next()),
            Some(text) if text.starts_with("--against=") => {}
            _ => drop(command.arg(word)),
        }
    }
    if !args.json {
        command.arg("--json");
    }
    command.env("KARAT_OVERLAY", &overlay);
    let (mut said, mut lines) = (String::new(), Vec::new());
    let status = child::run_heard(
        &mut command,
        |line| {
            said += line;
            said.push('\n');
            Ok(())
        },
        |line| {
            lines.push(line.to_owned());
            Ok(())
        },
    )?;
    ensure!(status.success(), "can't trace the pixel with the shaders of {revision}:\n{said}");
    let parsed = serde_json::from_str(&lines.join("\n"));
    let mut before: Traced = parsed.context("`karat trace` didn't print the traced pixel")?;
    // The files of a revision lie in a temporary folder, so messages name the revision.
    let written = format!("{}{}", overlay.display(), std::path::MAIN_SEPARATOR);
    for row in &mut before.steps {
        let own = row.file.strip_prefix(&written).unwrap_or(&row.file);
        row.file = format!("{revision}:{own}");
    }
    Ok(Some(before))
}

/// Copies the modules in `before` that differ from today's modules into an overlay. Returns `true` if a module differs.
fn keep_changed(before: &Path, today: &Path, overlay: &Path) -> anyhow::Result<bool> {
    let mut any = false;
    let mut open = vec![before.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder)? {
            let path = entry?.path();
            if path.is_dir() {
                open.push(path);
                continue;
            }
            let own = path
                .strip_prefix(before)
                .context("the module isn't in the folder of its package")?;
            let is_module = path.extension().is_some_and(|end| end == "wgsl" || end == "wesl");
            // No module imports a module that doesn't exist today.
            let Ok(now) = std::fs::read(today.join(own)) else { continue };
            if is_module && now != std::fs::read(&path)? {
                let to = overlay.join(own);
                std::fs::create_dir_all(to.parent().unwrap_or(overlay))?;
                std::fs::copy(&path, &to)?;
                any = true;
            }
        }
    }
    Ok(any)
}

fn write_head(args: &Args, traced: &Traced, out: &mut dyn Write) -> anyhow::Result<()> {
    let (x, y) = args.pixel;
    writeln!(out, "{HEAD}{}{HEAD:#} at ({x}, {y}) of `{}`", traced.function, args.frame)?;
    for (name, value) in &traced.arguments {
        writeln!(out, "  {name} = {value}")?;
    }
    Ok(())
}

fn write(
    args: &Args,
    traced: &Traced,
    project: &Project,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    write_head(args, traced, out)?;
    call::write_rows(&traced.steps, out)?;
    writeln!(out, "\nthe engine returns {}", traced.engine)?;
    writeln!(out, "the driver drew    {}", traced.driver)?;
    if let Some(golden) = golden(args, project) {
        writeln!(out, "the golden has     {golden}")?;
    }
    for note in &traced.notes {
        writeln!(out, "{DIM}{note}{DIM:#}")?;
    }
    Ok(())
}

/// Returns the pixel of the golden with the frame's name.
fn golden(args: &Args, project: &Project) -> Option<String> {
    let (x, y) = args.pixel;
    let own = |folder: std::path::PathBuf| {
        let (image, _) = Image::read_exr(&folder.join(format!("{}.exr", args.frame))).ok()?;
        let is_as_large =
            args.drawn.size.is_none_or(|size| size == (image.width(), image.height()));
        let inside = x < image.width() && y < image.height();
        let pixel =
            (is_as_large && inside).then(|| image.pixels()[(y * image.width() + x) as usize])?;
        Some(format!("({})", pixel.map(format_f32).join(", ")))
    };
    project.goldens().into_iter().find_map(own)
}

/// Returns the number of equal steps before the first different step.
fn first_difference(before: &Traced, after: &Traced) -> usize {
    let pairs = before.steps.iter().zip(&after.steps);
    let alike = |(a, b): &(&Row, &Row)| a.operation == b.operation && a.single == b.single;
    pairs.take_while(alike).count()
}

/// Prints the first step that differs between two revisions.
fn write_parting(
    before: &Traced,
    after: &Traced,
    revision: &str,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let at = first_difference(before, after);
    let given = before.arguments.iter().zip(&after.arguments).filter(|(a, b)| a != b);
    for ((name, was), (_, is)) in given {
        writeln!(out, "{BAD}{name}{BAD:#} is {is}, and was {was} at {revision}")?;
    }
    match (before.steps.get(at), after.steps.get(at)) {
        (None, None) if before.engine == after.engine => {
            writeln!(out, "{GOOD}no step differs from {revision}{GOOD:#}")?;
        }
        (None, None) => writeln!(
            out,
            "the shown steps are the same as at {revision}: only a step that isn't shown differs"
        )?,
        (was, is) => {
            let shown = |row: Option<&Row>| {
                row.map_or_else(
                    || "nothing more".to_owned(),
                    |row| format!("{}  {}  is {}", row.place(), row.operation, row.single),
                )
            };
            let count = at + 1;
            writeln!(out, "step {count} is the first step that differs from {revision}:")?;
            writeln!(out, "  {revision}:  {}", shown(was))?;
            writeln!(out, "  {HEAD}today{HEAD:#}:  {}", shown(is))?;
        }
    }
    writeln!(
        out,
        "the engine returns {}, and returned {} at {revision}",
        after.engine, before.engine
    )?;
    Ok(())
}
