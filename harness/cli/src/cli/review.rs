//! `karat review`

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use anyhow::Context;
use karat::unstable::golden::PendingFrames;
use karat::unstable::output::counted;
use karat::unstable::record::{Recorded, Subject};
use karat::{Goldens, Image};
use karat_review::{LastRun, Map, Pixels, Review};
use serde_json::Value;

use super::artefact::Artefact;
use super::goldens::{CiArgs, FolderArgs, FromArgs, report};
use super::project::Project;
use super::report::review_of;
use super::{Ending, Outcome, PackageArgs};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Writes the page into this folder, and starts no server. To accept or reject a frame, type the command
    /// that the page shows
    #[arg(long = "static", value_name = "DIR", conflicts_with_all = ["port", "open"])]
    files: Option<PathBuf>,
    /// Serves the page on this port of 127.0.0.1 [default: any free port]
    #[arg(long, value_name = "PORT", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Opens the page in your default browser
    #[arg(long)]
    open: bool,
    /// Lets VS Code show the page in a panel
    #[arg(long, conflicts_with = "files")]
    in_editor: bool,
    /// Also shows all goldens, with their history
    #[arg(long)]
    all_goldens: bool,
    #[command(flatten)]
    ci: CiArgs,
    #[command(flatten)]
    from: FromArgs,
    #[command(flatten)]
    folder: FolderArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let artefact = args.from.open()?;
    if args.files.is_none() {
        args.ci.check("run `karat review --from` with this run's artefact")?;
    }
    let goldens = args.folder.open(artefact.as_ref())?;
    let mut review = Review::new(goldens.clone()).with_arguments(&arguments(args));
    review = review.may_write_in_ci(args.ci.ci_may_write).in_editor(args.in_editor);
    if let Some(artefact) = &artefact {
        review = review.pending_in(artefact.folder());
    }
    if args.all_goldens {
        review = review.with_goldens();
    }
    if let Some(run) = last_run(artefact.as_ref(), &goldens) {
        review = review.with_run(run);
    }
    // The page can't run shaders if it is static, or if the frames come from a CI run.
    if args.files.is_none() || artefact.is_none() {
        review = review.with_pixels(Arc::new(Told));
    }
    if let Some(folder) = &args.files {
        let PendingFrames { frames, unusable } = review.write(folder)?;
        let page = folder.join("index.html");
        writeln!(out, "{}: {}", page.display(), frames_pending(frames.len()))?;
        report(&unusable)?;
        return Ok(Ending::Good);
    }
    let pending = review.pending();
    if pending.is_empty() && !review.has_more() {
        writeln!(out, "nothing is pending")?;
        return Ok(Ending::Good);
    }
    let server = review.serve(args.port)?;
    let stop = server.stop();
    ctrlc::set_handler(move || stop.stop()).context("can't wait for Ctrl-C")?;
    writeln!(out, "{}; stop with Ctrl-C", frames_pending(pending.frames.len()))?;
    writeln!(out, "{}", server.url())?;
    out.flush()?;
    if args.open
        && let Err(error) = open::that_detached(server.url())
    {
        karat::unstable::output::tell(&format!(
            "can't open a browser ({error}); open the URL yourself"
        ));
    }
    // The page shows unusable files. The terminal shows them, too.
    let told = report(&pending.unusable);
    server.run();
    let PendingFrames { frames, unusable } = server.pending();
    match frames.len() {
        0 => writeln!(out, "nothing is left pending")?,
        left => writeln!(out, "{} left pending", counted(left, "frame"))?,
    }
    if !unusable.is_empty() {
        told?;
    }
    Ok(if frames.is_empty() { Ending::Good } else { Ending::Bad })
}

/// Starts Karat's commands `tap` and `trace` for the page.
#[derive(Debug)]
struct Told;

impl Told {
    /// Runs a command, such as `trace`, for a frame, and returns the output.
    fn ask(
        command: &str,
        before: &[String],
        frame: &str,
        after: &[String],
    ) -> Result<String, String> {
        let program = std::env::current_exe().map_err(|error| error.to_string())?;
        let mut process = Command::new(program);
        process.arg(command).args(before).args(["--", frame]).args(after);
        let output = process.output().map_err(|error| error.to_string())?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
        // With exit code 1, the steps differ, and the output is valid.
        match text(&output.stdout) {
            told if output.status.success() || told.starts_with('[') => Ok(told),
            _ => Err(text(&output.stderr)),
        }
    }

    /// Returns the option `--size` for a frame of the gallery. Returns no option for a frame in a `*.test.toml`,
    /// because that file sets the size.
    fn size(frame: &str, (width, height): (u32, u32)) -> Result<Vec<String>, String> {
        let failed = |error: anyhow::Error| format!("{error:#}");
        let project = Project::find().map_err(failed)?;
        let found = super::tap::find(frame, &project, &PackageArgs::default()).map_err(failed)?;
        Ok(match found {
            Some(_) => Vec::new(),
            None => vec![format!("--size={width}x{height}")],
        })
    }
}

impl Pixels for Told {
    fn values(&self, frame: &str) -> Result<Vec<String>, String> {
        Ok(Self::ask("tap", &[], frame, &[])?.lines().map(str::to_owned).collect())
    }

    fn tap(&self, frame: &str, size: (u32, u32), value: &str) -> Result<Map, String> {
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let mut words = Self::size(frame, size)?;
        words.push(format!("--out={}", folder.path().display()));
        let about = Self::ask("tap", &words, frame, &[value.to_owned()])?;
        let is_image = |path: &PathBuf| path.extension().is_some_and(|end| end == "exr");
        let image = files_below(folder.path()).into_iter().find(is_image);
        // If there is no image, the numbers give the reason.
        let image = image.ok_or_else(|| about.clone())?;
        let (image, _) = Image::read_exr(&image).map_err(|error| error.to_string())?;
        let told = image.pixels().iter().filter(|pixel| pixel[3] > 0.0);
        let finite = told.map(|pixel| pixel[0]).filter(|value| value.is_finite());
        let [least, most] = finite
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[least, most], value| {
                [least.min(value), most.max(value)]
            });
        let range = if least < most { [least, most] } else { [least.min(0.0), most.max(1.0)] };
        let range = if least <= most { range } else { [0.0, 1.0] };
        let lines = about.lines().filter(|line| !line.contains(".exr"));
        let about = lines.map(str::trim).collect::<Vec<_>>().join("; ");
        Ok(Map { name: value.to_owned(), about, image, range })
    }

    fn trace(
        &self,
        frame: &str,
        size: (u32, u32),
        (x, y): (u32, u32),
        commit: Option<&str>,
    ) -> Result<Value, String> {
        let mut words = Self::size(frame, size)?;
        words.push("--json".to_owned());
        words.extend(commit.map(|commit| format!("--against={commit}")));
        let printed = Self::ask("trace", &words, frame, &[format!("{x},{y}")])?;
        serde_json::from_str(&printed).map_err(|error| error.to_string())
    }
}

/// Returns all files in a folder and its subfolders: the name of a frame may contain a folder, as `lamps/dusk` does.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let of = |path: PathBuf| if path.is_dir() { files_below(&path) } else { vec![path] };
    entries.flat_map(|entry| of(entry.path())).collect()
}

/// Returns the verdicts of the project's last run, or of the run that made the artefact. The page also works without
/// verdicts, so an unreadable record is ignored.
fn last_run(artefact: Option<&Artefact>, goldens: &Goldens) -> Option<LastRun> {
    let folder = match artefact {
        Some(artefact) => artefact.folder().to_owned(),
        None => Project::last_tested().ok()?.record(),
    };
    let mut records = Recorded::read(&folder).ok().flatten()?.records;
    // Several crates may have frames of the same name. The folders of another machine can't be compared with those of
    // this machine.
    let own = goldens.folder().canonicalize().ok();
    records.retain(|record| match &record.subject {
        Subject::Frame { folder, .. } => {
            let other = Path::new(folder).canonicalize().ok();
            own.is_none() || other.is_none() || own == other
        }
        Subject::Function { .. } => true,
    });
    Some(review_of(&records))
}

/// Returns the arguments `--from` and `--goldens`, so that the commands on the page use the page's folders.
fn arguments(args: &Args) -> String {
    let named = [("--from", args.from.named()), ("--goldens", args.folder.named())];
    let given = named.into_iter().filter_map(|(name, path)| Some((name, path?)));
    let words: Vec<String> =
        given.map(|(name, path)| format!("{name} {}", quoted(&path.to_string_lossy()))).collect();
    words.join(" ")
}

fn frames_pending(frames: usize) -> String {
    format!("{frames} pending {}", if frames == 1 { "frame" } else { "frames" })
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}
