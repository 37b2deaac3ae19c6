//! `karat pending`, `accept` and `reject`

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use karat::{AcceptError, Acceptance, Goldens, Pending, Profile, Provenance};
use serde::Serialize;

use super::artefact::Artefact;
use super::project::Project;
use super::table::{DIM, Table};
use super::{Outcome, Verdict, complain, write_json};

#[derive(clap::Args)]
pub(super) struct FolderArgs {
    /// Folder of goldens [default: as in `metadata.karat` of Cargo.toml, else `golden`]
    #[arg(long, value_name = "DIR")]
    golden: Option<PathBuf>,
}

impl FolderArgs {
    /// The folder that was named.
    pub(super) fn named(&self) -> Option<&Path> {
        self.golden.as_deref()
    }

    pub(super) fn path(&self) -> anyhow::Result<PathBuf> {
        let folder = match &self.golden {
            Some(folder) => folder.clone(),
            None => Project::find()?.golden(),
        };
        ensure!(
            folder.is_dir(),
            "there is no folder `{}`; name the folder of goldens with --golden DIR",
            folder.display()
        );
        Ok(folder)
    }

    pub(super) fn open(&self) -> anyhow::Result<Goldens> {
        Ok(Goldens::open(&self.path()?))
    }
}

/// Where the pending frames are.
#[derive(clap::Args)]
pub(super) struct FromArgs {
    /// Take the pending frames of a CI run: its downloaded artefact, a folder or a zip
    #[arg(long, value_name = "DIR|ZIP")]
    from: Option<PathBuf>,
}

impl FromArgs {
    /// `None`: those of the project.
    pub(super) fn open(&self) -> anyhow::Result<Option<Artefact>> {
        self.from.as_deref().map(Artefact::open).transpose()
    }
}

#[derive(clap::Args)]
pub(super) struct PendingArgs {
    /// Print JSON: of each frame status (differs or new), file, profile, and its provenance (case,
    /// width, height, adapter, compared_with, ...)
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    from: FromArgs,
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
    /// Print JSON: of each frame case, accepted, golden, written, warnings, error
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    from: FromArgs,
    #[command(flatten)]
    folder: FolderArgs,
}

#[derive(clap::Args)]
pub(super) struct RejectArgs {
    /// Names or globs of pending frames
    #[arg(required = true)]
    frames: Vec<String>,
    /// Print JSON: of each frame case and file
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    from: FromArgs,
    #[command(flatten)]
    folder: FolderArgs,
}

/// What JSON says of a pending frame. Fields are added, not changed.
#[derive(Serialize)]
struct PendingEntry<'a> {
    status: Status,
    file: &'a Path,
    profile: String,
    #[serde(flatten)]
    provenance: &'a Provenance,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Status {
    /// From its golden.
    Differs,
    /// There is no golden.
    New,
}

impl Status {
    fn of(pending: &Pending) -> Self {
        if pending.provenance.compared_with.is_empty() { Self::New } else { Self::Differs }
    }
}

pub(super) fn pending(args: &PendingArgs, out: &mut dyn Write) -> Outcome {
    let artefact = args.from.open()?;
    let pending = match &artefact {
        Some(artefact) => artefact.pending()?,
        None => args.folder.open()?.pending()?,
    };
    if args.json {
        let entry = |pending| PendingEntry {
            status: Status::of(pending),
            file: &pending.path,
            profile: Profile::of(&pending.provenance.adapter).to_string(),
            provenance: &pending.provenance,
        };
        write_json(&pending.iter().map(entry).collect::<Vec<_>>(), out)?;
    } else if pending.is_empty() {
        writeln!(out, "no frame is pending")?;
    } else {
        write_table(&pending, out)?;
    }
    Ok(if pending.iter().any(|pending| Status::of(pending) == Status::Differs) {
        Verdict::Bad
    } else if pending.is_empty() {
        Verdict::Good
    } else {
        Verdict::Missing
    })
}

fn write_table(pending: &[Pending], out: &mut dyn Write) -> std::io::Result<()> {
    let mut table = Table::new(&["frame", "golden", "size", "rendered on"], &[]);
    for pending in pending {
        let Pending { case, provenance, .. } = pending;
        let golden = match Status::of(pending) {
            Status::New => "none",
            Status::Differs => "differs",
        };
        let size = format!("{} x {}", provenance.width, provenance.height);
        let cells = vec![case.clone(), golden.to_owned(), size, provenance.adapter.to_string()];
        table.row(DIM, cells);
    }
    table.write(out)
}

/// The pending frames of these names and globs, each once.
fn select(goldens: &Goldens, frames: &[String]) -> anyhow::Result<Vec<Pending>> {
    let mut selected = Vec::new();
    for frame in frames {
        selected.extend(goldens.select(frame)?);
    }
    selected.sort_by(|a, b| a.path.cmp(&b.path));
    selected.dedup_by(|a, b| a.path == b.path);
    selected.sort_by(|a, b| a.case.cmp(&b.case));
    Ok(selected)
}

/// What JSON says of a frame that was to be accepted. Fields are added, not changed.
#[derive(Default, Serialize)]
struct AcceptEntry {
    case: String,
    accepted: bool,
    golden: Option<PathBuf>,
    written: bool,
    warnings: Vec<String>,
    /// Why it is refused.
    error: Option<String>,
}

pub(super) fn accept(args: &AcceptArgs, out: &mut dyn Write) -> Outcome {
    let goldens = args.folder.open()?;
    let artefact = args.from.open()?;
    let selected = match &artefact {
        Some(artefact) => {
            artefact.pending()?; // of two frames of one name neither is taken
            select(&artefact.goldens(), &args.frames)?
        }
        None => select(&goldens, &args.frames)?,
    };
    let acceptance = Acceptance {
        because: args.because.clone(),
        by: args.by.clone(),
        any_adapter: args.any_adapter,
        profile: args.profile.clone(),
    };
    let mut entries = Vec::new();
    for pending in selected {
        let case = pending.case.clone();
        let entry = match goldens.accept(&pending, &acceptance) {
            Ok(done) => AcceptEntry {
                case,
                accepted: true,
                golden: Some(done.golden),
                written: done.written,
                warnings: done.warnings,
                error: None,
            },
            // What is refused here says nothing of the other frames.
            Err(error) if is_refusal(&error) => {
                AcceptEntry { case, error: Some(error.to_string()), ..AcceptEntry::default() }
            }
            Err(error) => return Err(error.into()),
        };
        if !args.json {
            write_accepted(&entry, out)?;
        }
        entries.push(entry);
    }
    if args.json {
        write_json(&entries, out)?;
    }
    let refused = entries.iter().any(|entry| !entry.accepted);
    Ok(if refused { Verdict::Bad } else { Verdict::Good })
}

/// Whether a guard holds a frame back, where other errors hold up all.
fn is_refusal(error: &AcceptError) -> bool {
    !matches!(
        error,
        AcceptError::NoReason(_) | AcceptError::Image(_) | AcceptError::NotPending { .. }
    )
}

fn write_accepted(entry: &AcceptEntry, out: &mut dyn Write) -> std::io::Result<()> {
    if let Some(error) = &entry.error {
        complain(error);
        return Ok(());
    }
    writeln!(out, "accepted {}", entry.case)?;
    for warning in &entry.warnings {
        writeln!(out, "  note: {warning}")?;
    }
    Ok(())
}

#[derive(Serialize)]
struct RejectEntry {
    case: String,
    file: PathBuf,
}

pub(super) fn reject(args: &RejectArgs, out: &mut dyn Write) -> Outcome {
    let artefact = args.from.open()?;
    let goldens = match &artefact {
        Some(zip) if zip.is_zip() => bail!(
            "a frame in a zip can't be rejected: nothing waits there, and deleting the zip forgets \
             its frames"
        ),
        Some(artefact) => artefact.goldens(),
        None => args.folder.open()?,
    };
    let mut entries = Vec::new();
    for pending in select(&goldens, &args.frames)? {
        goldens.reject(&pending)?;
        if !args.json {
            writeln!(out, "rejected {}", pending.case)?;
        }
        entries.push(RejectEntry { case: pending.case, file: pending.path });
    }
    if args.json {
        write_json(&entries, out)?;
    }
    Ok(Verdict::Good)
}
