//! `karat review`

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use karat::review::Review;

use super::goldens::FolderArgs;
use super::{Outcome, Verdict};

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
    #[command(flatten)]
    folder: FolderArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let mut review = Review::new(args.folder.open()?);
    if let Some(folder) = args.folder.named() {
        review = review.with_arguments(&format!("--golden {}", quoted(&folder.to_string_lossy())));
    }
    if let Some(folder) = &args.files {
        let frames = review.write(folder)?;
        let page = folder.join("index.html");
        writeln!(out, "{}: {frames} pending {}", page.display(), plural(frames))?;
        return Ok(Verdict::Good);
    }
    if review.pending()? == 0 {
        writeln!(out, "no frame is pending")?;
        return Ok(Verdict::Good);
    }
    let server = review.serve(args.port)?;
    let stop = server.stop();
    ctrlc::set_handler(move || stop.stop()).context("can't wait for Ctrl-C")?;
    let pending = server.pending()?;
    writeln!(out, "{pending} pending {}; stop with Ctrl-C", plural(pending))?;
    writeln!(out, "{}", server.url())?;
    out.flush()?;
    if args.open
        && let Err(error) = open::that_detached(server.url())
    {
        writeln!(anstream::stderr(), "no browser opens ({error}); open the URL yourself")?;
    }
    server.run();
    match server.pending()? {
        0 => {
            writeln!(out, "nothing is left pending")?;
            Ok(Verdict::Good)
        }
        left => {
            writeln!(out, "{left} {} left pending", plural(left))?;
            Ok(Verdict::Bad)
        }
    }
}

fn plural(frames: usize) -> &'static str {
    if frames == 1 { "frame" } else { "frames" }
}

/// A word of a POSIX shell.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}
