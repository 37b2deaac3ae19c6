//! `karat pending`, `accept` and `reject`

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use karat::Goldens;
use karat::diagnostic::shown;
use karat::golden::{AcceptError, Acceptance, Pending, PendingFrames, Provenance, Unusable};
use karat::output::{counted, tell};
use serde::Serialize;

use super::artefact::Artefact;
use super::project::Project;
use super::table::{DIM, Table};
use super::{Ending, Outcome, Reported, complain, write_json};

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
        let (folder, used) = match &self.golden {
            Some(folder) => (folder.clone(), Vec::new()),
            None => {
                let project = Project::find()?;
                (project.golden(), project.used_goldens())
            }
        };
        let others = others(&folder, used);
        if folder.is_dir() {
            for other in others.iter().filter(|other| has_pending(other)) {
                tell(&format!("note: frames of `{other}` wait, too: name it with --golden"));
            }
            return Ok(folder);
        }
        let used = match others.join("`, `") {
            none if none.is_empty() => String::new(),
            others => format!(" (the last run used `{others}`)"),
        };
        bail!(
            "there is no folder `{}`; name the folder of goldens with --golden DIR{used}",
            folder.display()
        )
    }

    /// The folder, which accepting makes if it isn't there: a project has none before its first golden.
    fn open_or_new(&self, from: Option<&Path>) -> anyhow::Result<Goldens> {
        match (&self.golden, from) {
            (Some(folder), _) => Ok(Goldens::open(folder)),
            (None, Some(_)) => Ok(Goldens::open(&Project::find()?.golden())),
            (None, None) => self.open(),
        }
    }

    pub(super) fn open(&self) -> anyhow::Result<Goldens> {
        Ok(Goldens::open(&self.path()?))
    }
}

/// Other folders of goldens than this one, as they are seen from here.
fn others(folder: &Path, used: Vec<PathBuf>) -> Vec<String> {
    let own = folder.canonicalize().ok();
    used.into_iter().filter(|used| own.as_ref() != Some(used)).map(|used| shown(&used)).collect()
}

fn has_pending(folder: &str) -> bool {
    let PendingFrames { frames, unusable } = Goldens::open(Path::new(folder)).pending();
    !frames.is_empty() || !unusable.is_empty()
}

/// Where the pending frames are.
#[derive(clap::Args)]
pub(super) struct FromArgs {
    /// Take the pending frames of a CI run: its downloaded artefact, a folder or a zip
    #[arg(long, value_name = "DIR|ZIP")]
    from: Option<PathBuf>,
}

impl FromArgs {
    /// What was named.
    pub(super) fn named(&self) -> Option<&Path> {
        self.from.as_deref()
    }

    /// `None`: those of the project.
    pub(super) fn open(&self) -> anyhow::Result<Option<Artefact>> {
        self.from.as_deref().map(Artefact::open).transpose()
    }
}

#[derive(clap::Args)]
pub(super) struct PendingArgs {
    /// Print JSON: of each frame status (differs or new), file, profile, and its provenance (case,
    /// width, height, adapter, compared_with, finding, ...); of a file that can't be used status
    /// (unusable), file and error
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
    /// Why the file can't be used.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    profile: Option<String>,
    #[serde(flatten)]
    provenance: Option<&'a Provenance>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Status {
    /// From its golden.
    Differs,
    /// There is no golden.
    New,
    /// The file can't be used.
    Unusable,
}

impl Status {
    fn of(pending: &Pending) -> Self {
        if pending.is_new() { Self::New } else { Self::Differs }
    }
}

impl<'a> From<&'a Pending> for PendingEntry<'a> {
    fn from(pending: &'a Pending) -> Self {
        Self {
            status: Status::of(pending),
            file: &pending.path,
            error: None,
            profile: Some(pending.profile().to_string()),
            provenance: Some(&pending.provenance),
        }
    }
}

impl<'a> From<&'a Unusable> for PendingEntry<'a> {
    fn from(Unusable { path, reason }: &'a Unusable) -> Self {
        let error = Some(reason.to_string());
        Self { status: Status::Unusable, file: path, error, profile: None, provenance: None }
    }
}

pub(super) fn pending(args: &PendingArgs, out: &mut dyn Write) -> Outcome {
    let artefact = args.from.open()?;
    let PendingFrames { frames, unusable } = match &artefact {
        Some(artefact) => artefact.frames().pending(),
        None => {
            let goldens = args.folder.open()?;
            // There, nothing may change the sources unasked.
            if !karat::golden::in_ci() {
                goldens.tidy();
            }
            goldens.pending()
        }
    };
    if args.json {
        let entries = frames.iter().map(PendingEntry::from);
        write_json(&entries.chain(unusable.iter().map(Into::into)).collect::<Vec<_>>(), out)?;
    } else if !frames.is_empty() {
        write_table(&frames, out)?;
    } else if unusable.is_empty() {
        writeln!(out, "nothing is pending")?;
    }
    report(&unusable)?;
    Ok(if frames.iter().any(|pending| Status::of(pending) == Status::Differs) {
        Ending::Bad
    } else if frames.is_empty() {
        Ending::Good
    } else {
        Ending::Missing
    })
}

/// Complains of files that can't be used. The others were taken care of, but not all is done.
pub(super) fn report(unusable: &[Unusable]) -> anyhow::Result<()> {
    for Unusable { reason, .. } in unusable {
        complain(&reason.to_string());
    }
    if unusable.is_empty() { Ok(()) } else { Err(Reported.into()) }
}

fn write_table(pending: &[Pending], out: &mut dyn Write) -> std::io::Result<()> {
    let folder = |pending: &Pending| pending.provenance.folder.clone();
    let several = pending.windows(2).any(|pair| folder(&pair[0]) != folder(&pair[1]));
    let head: &[&str] = &["frame or values", "golden", "size", "made on", "goldens"];
    let mut table = Table::new(&head[..if several { 5 } else { 4 }], &[]);
    for pending in pending {
        let Pending { case, provenance, .. } = pending;
        let golden = if pending.is_new() { "none" } else { "differs" };
        let size = match pending.is_table() {
            true => counted(provenance.height, "row"),
            false => format!("{} x {}", provenance.width, provenance.height),
        };
        let mut cells = vec![case.clone(), golden.to_owned(), size, provenance.adapter.to_string()];
        cells.extend(several.then(|| folder(pending)));
        table.row(DIM, cells);
    }
    table.write(out)
}

/// What is pending of these names and globs, each once.
fn select(goldens: &Goldens, names: &[String]) -> anyhow::Result<PendingFrames> {
    let mut selected = PendingFrames::default();
    for name in names {
        let glob = glob::Pattern::new(name).ok();
        let matches = |case: &str| glob.as_ref().is_some_and(|glob| glob.matches(case));
        let PendingFrames { frames, unusable } = goldens.select_by(name, matches)?;
        selected.frames.extend(frames);
        selected.unusable.extend(unusable);
    }
    selected.frames.sort_by(|a, b| (&a.case, &a.path).cmp(&(&b.case, &b.path)));
    selected.frames.dedup_by(|a, b| a.path == b.path);
    selected.unusable.sort_by(|a, b| a.path.cmp(&b.path));
    selected.unusable.dedup_by(|a, b| a.path == b.path);
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
    let goldens = args.folder.open_or_new(args.from.named())?;
    let artefact = args.from.open()?;
    let waiting = artefact.as_ref().map_or_else(|| goldens.clone(), Artefact::frames);
    let PendingFrames { frames, unusable } = select(&waiting, &args.frames)?;
    // What a CI run left may be of several folders of goldens.
    let (own, others): (Vec<_>, Vec<_>) =
        frames.into_iter().partition(|pending| pending.is_of(&goldens));
    if !own.is_empty() && !others.is_empty() {
        let folders: BTreeSet<&str> =
            others.iter().map(|pending| pending.provenance.folder.as_str()).collect();
        let folders = folders.into_iter().collect::<Vec<_>>().join("`, `");
        tell(&format!("note: frames of `{folders}` aren't looked at"));
    }
    let frames = if own.is_empty() { others } else { own };
    let acceptance = Acceptance {
        because: args.because.clone(),
        by: args.by.clone(),
        any_adapter: args.any_adapter,
        profile: args.profile.clone(),
    };
    let (mut entries, mut failed) = (Vec::new(), false);
    for pending in frames {
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
            Err(error @ AcceptError::NoReason(_)) => return Err(error.into()),
            // What happens to one frame says nothing of the others.
            Err(error) => {
                failed |= matches!(error, AcceptError::Image(_));
                AcceptEntry { case, error: Some(error.to_string()), ..AcceptEntry::default() }
            }
        };
        if !args.json {
            write_accepted(&entry, out)?;
        }
        entries.push(entry);
    }
    if args.json {
        write_json(&entries, out)?;
    }
    report(&unusable)?;
    if failed {
        return Err(Reported.into());
    }
    let refused = entries.iter().any(|entry| !entry.accepted);
    Ok(if refused { Ending::Bad } else { Ending::Good })
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
        Some(zip) if zip.is_zip() => {
            bail!("a frame in a zip can't be rejected: delete the zip instead")
        }
        Some(artefact) => artefact.frames(),
        None => args.folder.open()?,
    };
    let mut entries = Vec::new();
    let PendingFrames { frames, unusable } = select(&goldens, &args.frames)?;
    for pending in frames {
        goldens.reject(&pending)?;
        if !args.json {
            writeln!(out, "rejected {}", pending.case)?;
        }
        entries.push(RejectEntry { case: pending.case, file: pending.path });
    }
    if args.json {
        write_json(&entries, out)?;
    }
    report(&unusable)?;
    Ok(Ending::Good)
}
