//! `karat review`

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::Goldens;
use karat::unstable::golden::PendingFrames;
use karat::unstable::output::counted;
use karat::unstable::record::{Recorded, Subject};
use karat_review::{LastRun, Review};

use super::artefact::Artefact;
use super::goldens::{CiArgs, FolderArgs, FromArgs, report};
use super::project::Project;
use super::report::review_of;
use super::{Ending, Outcome};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Write the page into a folder instead: it opens from there without a server, and shows the
    /// commands to type
    #[arg(long = "static", value_name = "DIR", conflicts_with_all = ["port", "open"])]
    files: Option<PathBuf>,
    /// Port on 127.0.0.1 [default: any that is free]
    #[arg(long, value_name = "PORT", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Open the page in a browser
    #[arg(long)]
    open: bool,
    /// Let VS Code show the page in a panel
    #[arg(long, conflicts_with = "files")]
    in_editor: bool,
    /// Show all goldens, too, with their history
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
        args.ci.check("review, with --from and what this run leaves,")?;
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
            "no browser opens ({error}); open the URL yourself"
        ));
    }
    // The page shows what can't be used; whoever looks here is told, too.
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

/// What the last run of the project said, or the run that left an artefact. Without it the page has its
/// images all the same, so a record that can't be read is none.
fn last_run(artefact: Option<&Artefact>, goldens: &Goldens) -> Option<LastRun> {
    let folder = match artefact {
        Some(artefact) => artefact.folder().to_owned(),
        None => Project::last_tested().ok()?.record(),
    };
    let mut records = Recorded::read(&folder).ok().flatten()?.records;
    // Crates of a workspace may have frames of one name. Folders of another machine can't be told apart.
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

/// What the commands on the page need to find the same folders.
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

/// A word of a POSIX shell.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}
