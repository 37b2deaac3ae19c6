//! `karat pending`, `accept`, `reject` and `preview`

use std::io::Write;
use std::path::PathBuf;

use anyhow::ensure;
use karat::{Acceptance, ExposureArguments, Goldens, Image, Pending};

use super::project::Project;
use super::table::{DIM, Table};
use super::{Outcome, Verdict};

#[derive(clap::Args)]
struct FolderArgs {
    /// Folder of goldens [default: as in `metadata.karat` of Cargo.toml, else `golden`]
    #[arg(long, value_name = "DIR")]
    golden: Option<PathBuf>,
}

impl FolderArgs {
    fn open(&self) -> anyhow::Result<Goldens> {
        let folder = match &self.golden {
            Some(folder) => folder.clone(),
            None => Project::find()?.golden(),
        };
        ensure!(
            folder.is_dir(),
            "there is no folder `{}`; name the folder of goldens with --golden DIR",
            folder.display()
        );
        Ok(Goldens::open(&folder))
    }
}

#[derive(clap::Args)]
pub(super) struct PendingArgs {
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    folder: FolderArgs,
}

#[derive(clap::Args)]
pub(super) struct AcceptArgs {
    /// Names or globs of pending frames
    #[arg(required = true)]
    frames: Vec<String>,
    /// Why the new image is right; kept with the golden
    #[arg(long, value_name = "REASON")]
    because: String,
    /// Who accepts [default: Git's user.name, else the login name]
    #[arg(long, value_name = "NAME")]
    by: Option<String>,
    /// Accept a frame that wasn't rendered on lavapipe
    #[arg(long)]
    any_adapter: bool,
    /// Make it the golden of one profile, where the golden for all fails: `gl-llvmpipe`
    #[arg(long, value_name = "PROFILE")]
    profile: Option<String>,
    #[command(flatten)]
    folder: FolderArgs,
}

#[derive(clap::Args)]
pub(super) struct RejectArgs {
    /// Names or globs of pending frames
    #[arg(required = true)]
    frames: Vec<String>,
    #[command(flatten)]
    folder: FolderArgs,
}

#[derive(clap::Args)]
pub(super) struct PreviewArgs {
    /// The EXR image
    image: PathBuf,
    /// The PNG to write [default: beside the image]
    #[arg(long, value_name = "OUT.PNG")]
    out: Option<PathBuf>,
    #[command(flatten)]
    exposure: ExposureArguments,
}

pub(super) fn pending(args: &PendingArgs, out: &mut dyn Write) -> Outcome {
    let pending = args.folder.open()?.pending()?;
    if args.json {
        let all: Vec<_> = pending.iter().map(|pending| &pending.provenance).collect();
        serde_json::to_writer_pretty(&mut *out, &all)?;
        writeln!(out)?;
        return Ok(Verdict::Good);
    }
    if pending.is_empty() {
        writeln!(out, "no frame is pending")?;
        return Ok(Verdict::Good);
    }
    let mut table = Table::new(&["frame", "golden", "size", "rendered on"], &[]);
    for Pending { case, provenance, .. } in &pending {
        let golden = if provenance.compared_with.is_empty() { "none" } else { "differs" };
        let size = format!("{} x {}", provenance.width, provenance.height);
        let cells = vec![case.clone(), golden.to_owned(), size, provenance.adapter.to_string()];
        table.row(DIM, cells);
    }
    table.write(out)?;
    Ok(Verdict::Good)
}

fn select(goldens: &Goldens, frames: &[String]) -> anyhow::Result<Vec<Pending>> {
    let mut selected = Vec::new();
    for frame in frames {
        selected.extend(goldens.select(frame)?);
    }
    selected.sort_by(|a, b| a.case.cmp(&b.case));
    selected.dedup_by(|a, b| a.case == b.case);
    Ok(selected)
}

pub(super) fn accept(args: &AcceptArgs, out: &mut dyn Write) -> Outcome {
    let goldens = args.folder.open()?;
    let acceptance = Acceptance {
        because: args.because.clone(),
        by: args.by.clone(),
        any_adapter: args.any_adapter,
        profile: args.profile.clone(),
    };
    for pending in select(&goldens, &args.frames)? {
        let accepted = goldens.accept(&pending, &acceptance)?;
        writeln!(out, "accepted {}", pending.case)?;
        for warning in accepted.warnings {
            writeln!(out, "  note: {warning}")?;
        }
    }
    Ok(Verdict::Good)
}

pub(super) fn reject(args: &RejectArgs, out: &mut dyn Write) -> Outcome {
    let goldens = args.folder.open()?;
    for pending in select(&goldens, &args.frames)? {
        goldens.reject(&pending)?;
        writeln!(out, "rejected {}", pending.case)?;
    }
    Ok(Verdict::Good)
}

pub(super) fn preview(args: &PreviewArgs, out: &mut dyn Write) -> Outcome {
    let path = args.out.clone().unwrap_or_else(|| args.image.with_extension("png"));
    let (image, _) = Image::read_exr(&args.image)?;
    image.write_png_exposed(&path, args.exposure.stops)?;
    writeln!(out, "{}", path.display())?;
    Ok(Verdict::Good)
}
