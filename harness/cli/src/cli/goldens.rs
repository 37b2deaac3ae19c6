//! Runs `karat pending`, `karat accept` and `karat reject`.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use karat::Goldens;
use karat::unstable::diagnostic::{nearest, shown};
use karat::unstable::golden::{
    AcceptError, Acceptance, Pending, PendingFrames, Provenance, Unusable,
};
use karat::unstable::output::{counted, tell};
use serde::Serialize;

use super::artefact::Artefact;
use super::project::Project;
use super::report::names::{Home, below_project, told_apart};
use super::table::{DIM, Table};
use super::{Ending, Outcome, Reported, complain, write_json};

#[derive(clap::Args)]
pub(super) struct FolderArgs {
    /// Uses the goldens in this folder [default: the folder that `metadata.karat` of Cargo.toml names, else `golden`]
    #[arg(long, alias = "golden", value_name = "DIR")]
    goldens: Option<PathBuf>,
}

impl FolderArgs {
    pub(super) fn named(&self) -> Option<&Path> {
        self.goldens.as_deref()
    }

    /// Returns the folder that `--goldens` names, or otherwise the project's folder of goldens. Returns an error if
    /// this folder doesn't exist.
    pub(super) fn path(&self) -> anyhow::Result<PathBuf> {
        if let Some(folder) = &self.goldens {
            anyhow::ensure!(folder.is_dir(), "{}", absent(folder, &[]));
            return Ok(folder.clone());
        }
        let project = Project::last_tested()?;
        let (folder, all) = (project.golden(), project.goldens());
        let own = folder.canonicalize().ok();
        let others = all.iter().filter(|other| other.canonicalize().ok() != own);
        let others: Vec<String> = others.map(|other| shown(other)).collect();
        anyhow::ensure!(folder.is_dir(), "{}", absent(&folder, &others));
        for other in others.iter().filter(|other| has_pending(other)) {
            tell(&format!(
                "note: the folder `{other}` also has pending frames: name this folder with --goldens DIR"
            ));
        }
        Ok(folder)
    }

    /// Opens the folder of goldens that a review changes. If the frames come from a CI run, this is the folder of the
    /// goldens with which the run compared its frames. Then the folder needn't exist.
    pub(super) fn open(&self, from: Option<&Artefact>) -> anyhow::Result<Goldens> {
        let (None, Some(artefact)) = (&self.goldens, from) else {
            return Ok(Goldens::open(&self.path()?));
        };
        let project = Project::last_tested()?;
        let mut all: Vec<Goldens> = Vec::new();
        for pending in artefact.frames().pending().frames {
            let goldens = pending.goldens(project.root())?;
            let goldens = goldens.unwrap_or_else(|| Goldens::open(&project.golden()));
            if all.iter().all(|known| known.folder() != goldens.folder()) {
                all.push(goldens);
            }
        }
        for other in all.iter().skip(1) {
            let other = shown(&other.folder());
            tell(&format!(
                "note: the folder `{other}` also has pending frames: name this folder with --goldens DIR"
            ));
        }
        Ok(all.into_iter().next().unwrap_or_else(|| Goldens::open(&project.golden())))
    }
}

/// Formats the message that a folder of goldens is missing. The message names the existing folders of goldens.
fn absent(folder: &Path, others: &[String]) -> String {
    let others = match others.join("`, `") {
        none if none.is_empty() => String::new(),
        others => format!(" (there is `{others}`)"),
    };
    let folder = folder.display();
    format!(
        "there is no folder `{folder}`: Karat hasn't drawn a frame yet, or the goldens are in another folder, which you can name with \
         --goldens DIR{others}"
    )
}

fn has_pending(folder: &str) -> bool {
    let PendingFrames { frames, unusable } = Goldens::open(Path::new(folder)).pending();
    !frames.is_empty() || !unusable.is_empty()
}

/// The option that permits a command to write into your sources in CI.
#[derive(clap::Args)]
pub(super) struct CiArgs {
    /// Allows writing into your sources even if `CI` is set
    #[arg(long)]
    pub(super) ci_may_write: bool,
}

impl CiArgs {
    /// Returns an error in CI, because the command writes into your sources. With `--ci-may-write` there is no error.
    pub(super) fn check(&self, what: &str) -> anyhow::Result<()> {
        anyhow::ensure!(
            self.ci_may_write || !karat::unstable::golden::in_ci(),
            "`CI` is set, and Karat doesn't change your sources in CI: {what} on your own machine, or add \
             --ci-may-write"
        );
        Ok(())
    }
}

#[derive(clap::Args)]
pub(super) struct FromArgs {
    /// Takes the pending frames of a CI run from its downloaded artefact, a folder or a zip
    #[arg(long, value_name = "DIR|ZIP")]
    from: Option<PathBuf>,
}

impl FromArgs {
    pub(super) fn named(&self) -> Option<&Path> {
        self.from.as_deref()
    }

    /// Opens the artefact that `--from` names. Returns `None` without `--from`, and then the command uses the project's
    /// own pending frames.
    pub(super) fn open(&self) -> anyhow::Result<Option<Artefact>> {
        self.from.as_deref().map(Artefact::open).transpose()
    }
}

#[derive(clap::Args)]
pub(super) struct PendingArgs {
    /// Prints JSON. Each frame has status (differs or new), file, profile, and its provenance (case, width, height,
    /// adapter, compared_with, finding, ...). Each file that Karat can't use has status (unusable), file and error
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    from: FromArgs,
    #[command(flatten)]
    folder: FolderArgs,
}

#[derive(clap::Args)]
pub(super) struct AcceptArgs {
    /// Names or globs of pending frames; `crate::name` selects frames of one crate
    #[arg(required = true)]
    frames: Vec<String>,
    /// Stores this reason with the golden: why the new image is right
    #[arg(long, value_name = "REASON", alias = "reason")]
    because: String,
    /// Stores this name with the golden: who accepted it [default: Git's user.name, else the login name]
    #[arg(long, value_name = "NAME")]
    by: Option<String>,
    /// Accepts a frame even if a driver other than lavapipe rendered it
    #[arg(long)]
    any_adapter: bool,
    /// Makes the frame the golden for this profile only, such as `gl-llvmpipe`; the other profiles keep their golden
    #[arg(long, value_name = "PROFILE")]
    profile: Option<String>,
    /// Prints JSON: case, accepted, golden, written, warnings and error for each frame
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    ci: CiArgs,
    #[command(flatten)]
    from: FromArgs,
    #[command(flatten)]
    folder: FolderArgs,
}

#[derive(clap::Args)]
pub(super) struct RejectArgs {
    /// Names or globs of pending frames; `crate::name` selects frames of one crate
    #[arg(required = true)]
    frames: Vec<String>,
    /// Prints JSON: case and file for each frame
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    ci: CiArgs,
    #[command(flatten)]
    from: FromArgs,
    #[command(flatten)]
    folder: FolderArgs,
}

/// A pending frame or an unusable file in the output of `karat pending --json`. Add new fields, but don't change
/// existing fields.
#[derive(Serialize)]
struct PendingEntry<'a> {
    status: Status,
    file: &'a Path,
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
    Differs,
    /// The frame has no golden.
    New,
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
    let waiting = Waiting::of(&args.folder, artefact.as_ref())?;
    // In CI, the sources don't change without permission.
    if artefact.is_none() && !karat::unstable::golden::in_ci() {
        waiting.places.iter().for_each(Goldens::tidy);
    }
    let (frames, unusable) = waiting.all()?;
    if args.json {
        let entries = frames.iter().map(|frame| PendingEntry::from(&frame.pending));
        write_json(&entries.chain(unusable.iter().map(Into::into)).collect::<Vec<_>>(), out)?;
    } else if !frames.is_empty() {
        write_table(&frames, out)?;
    } else if unusable.is_empty() {
        writeln!(out, "nothing is pending")?;
    }
    report(&unusable)?;
    Ok(if frames.iter().any(|frame| Status::of(&frame.pending) == Status::Differs) {
        Ending::Bad
    } else if frames.is_empty() {
        Ending::Good
    } else {
        Ending::Missing
    })
}

/// Prints the reason why each file is unusable. Returns an error if there is an unusable file, because the command
/// couldn't handle this file.
pub(super) fn report(unusable: &[Unusable]) -> anyhow::Result<()> {
    for Unusable { reason, .. } in unusable {
        complain(&reason.to_string());
    }
    if unusable.is_empty() { Ok(()) } else { Err(Reported.into()) }
}

fn write_table(frames: &[Frame], out: &mut dyn Write) -> std::io::Result<()> {
    let folder = |frame: &Frame| shown(&frame.goldens.folder());
    let several = frames.windows(2).any(|pair| folder(&pair[0]) != folder(&pair[1]));
    let head: &[&str] = &["frame or values", "golden", "size", "made on", "goldens"];
    let mut table = Table::new(&head[..if several { 5 } else { 4 }], &[]);
    for frame in frames {
        let Pending { provenance, .. } = &frame.pending;
        let golden = if frame.pending.is_new() { "none" } else { "differs" };
        let size = match frame.pending.is_table() {
            true => counted(provenance.height, "row"),
            false => format!("{} x {}", provenance.width, provenance.height),
        };
        let adapter = provenance.adapter.to_string();
        let mut cells = vec![frame.name.clone(), golden.to_owned(), size, adapter];
        cells.extend(several.then(|| folder(frame)));
        table.row(DIM, cells);
    }
    table.write(out)
}

/// The pending frames and values of one folder of goldens, or of all crates of a project.
struct Waiting {
    places: Vec<Goldens>,
    /// The folder that `--goldens` names. Without this option, each frame belongs to the folder of the golden with
    /// which the frame was compared.
    named: Option<Goldens>,
    /// The project whose goldens the command replaces, if `--from` is given and `--goldens` isn't given.
    project: Option<Project>,
}

struct Frame {
    pending: Pending,
    /// The folder of goldens that the frame belongs to.
    goldens: Goldens,
    /// The frame's name. If several crates have a frame of this name, the name begins with the crate: `lamp::dusk`.
    name: String,
}

impl Waiting {
    fn of(folder: &FolderArgs, artefact: Option<&Artefact>) -> anyhow::Result<Self> {
        let named = folder.named().map(Goldens::open);
        if let Some(artefact) = artefact {
            let project = if named.is_none() { Some(Project::last_tested()?) } else { None };
            return Ok(Self { places: vec![artefact.frames()], named, project });
        }
        if named.is_some() {
            let places = vec![Goldens::open(&folder.path()?)];
            return Ok(Self { places, named, project: None });
        }
        let all = Project::last_tested()?.goldens();
        let places = match all.is_empty() {
            true => vec![Goldens::open(&folder.path()?)],
            false => all.iter().map(|folder| Goldens::open(folder)).collect(),
        };
        Ok(Self { places, named, project: None })
    }

    /// Returns the folder of goldens that a pending frame in `place` belongs to.
    fn goldens(&self, place: &Goldens, pending: &Pending) -> Result<Goldens, AcceptError> {
        match (&self.named, &self.project) {
            (Some(named), _) => Ok(named.clone()),
            (None, None) => Ok(place.clone()),
            (None, Some(project)) => {
                let own = pending.goldens(project.root())?;
                Ok(own.unwrap_or_else(|| Goldens::open(&project.golden())))
            }
        }
    }

    /// Returns all pending frames and values, in the order of their names, and the unusable files.
    fn all(&self) -> anyhow::Result<(Vec<Frame>, Vec<Unusable>)> {
        let (mut frames, mut unusable) = (Vec::new(), Vec::new());
        for place in &self.places {
            let found = place.pending();
            unusable.extend(found.unusable);
            for pending in found.frames {
                let name = pending.case.clone();
                match self.goldens(place, &pending) {
                    Ok(goldens) => frames.push(Frame { pending, goldens, name }),
                    Err(reason) => unusable.push(Unusable { path: pending.path, reason }),
                }
            }
        }
        name_crates(&mut frames);
        frames.sort_by(|a, b| (&a.name, &a.pending.path).cmp(&(&b.name, &b.pending.path)));
        Ok((frames, unusable))
    }

    /// Returns the pending frames and values, and the unusable files, whose names match one of the names or globs in
    /// `names`. A frame that matches several of them is returned once.
    fn select(&self, names: &[String]) -> anyhow::Result<(Vec<Frame>, Vec<Unusable>)> {
        let (all, broken) = self.all()?;
        let (mut chosen, mut told) = (vec![false; all.len()], vec![false; broken.len()]);
        for name in names {
            let wanted = Wanted::of(name);
            let found = all.iter().enumerate().filter(|(_, frame)| wanted.is(frame));
            let found: Vec<usize> = found.map(|(at, _)| at).collect();
            let exact: Vec<&Frame> = found
                .iter()
                .map(|at| &all[*at])
                .filter(|frame| frame.pending.case == *name)
                .collect();
            if let [first, rest @ ..] = &*exact
                && rest.iter().any(|other| other.goldens.folder() != first.goldens.folder())
            {
                let names: Vec<&str> = exact.iter().map(|frame| &*frame.name).collect();
                bail!(
                    "several crates have a pending frame `{name}`: choose `{}`",
                    names.join("` or `")
                );
            }
            let of_files = broken.iter().enumerate().filter(|(_, broken)| {
                self.places.iter().any(|place| wanted.names(&file_case(place, broken)))
            });
            let of_files: Vec<usize> = of_files.map(|(at, _)| at).collect();
            if found.is_empty() && of_files.is_empty() {
                let known = all.iter().map(|frame| &*frame.name);
                let nearest = nearest(name, known).map(str::to_owned);
                return Err(AcceptError::NotPending { case: name.clone(), nearest }.into());
            }
            found.into_iter().for_each(|at| chosen[at] = true);
            of_files.into_iter().for_each(|at| told[at] = true);
        }
        let chosen = all.into_iter().zip(chosen).filter_map(|(frame, is)| is.then_some(frame));
        let told = broken.into_iter().zip(told).filter_map(|(broken, is)| is.then_some(broken));
        Ok((chosen.collect(), told.collect()))
    }
}

/// A name or glob of frames from the command line: `dusk*`, or with the name of a crate: `lamp::dusk`.
struct Wanted {
    krate: Option<Option<glob::Pattern>>,
    name: String,
    glob: Option<glob::Pattern>,
}

impl Wanted {
    fn of(typed: &str) -> Self {
        let (krate, name) = match typed.rsplit_once("::") {
            Some((krate, name)) => (Some(glob::Pattern::new(krate).ok()), name),
            None => (None, typed),
        };
        Self { krate, name: name.to_owned(), glob: glob::Pattern::new(name).ok() }
    }

    fn names(&self, case: &str) -> bool {
        case == self.name || self.glob.as_ref().is_some_and(|glob| glob.matches(case))
    }

    fn is(&self, frame: &Frame) -> bool {
        let from_crate = match &self.krate {
            None => true,
            Some(None) => false,
            Some(Some(krate)) => {
                [frame.krate(), folder_of(frame)].iter().any(|known| krate.matches(known))
            }
        };
        from_crate && self.names(&frame.pending.case)
    }
}

impl Frame {
    /// Returns the name of the Cargo package that contains the frame's goldens.
    fn krate(&self) -> String {
        match &*self.pending.provenance.cargo_package {
            "" => self.goldens.cargo_package(),
            known => known.to_owned(),
        }
    }
}

/// Returns the folder of goldens that a frame belongs to, relative to the project's folder.
fn folder_of(frame: &Frame) -> String {
    match &*frame.pending.provenance.folder {
        "" => below_project(&frame.goldens),
        known => known.to_owned(),
    }
}

/// Adds the crate to the name of each frame whose name also occurs in another folder of goldens.
fn name_crates(frames: &mut [Frame]) {
    let mut homes: BTreeMap<String, BTreeMap<PathBuf, Home>> = BTreeMap::new();
    for frame in &*frames {
        let known = homes.entry(frame.pending.case.clone()).or_default();
        let home = || Home { krate: frame.krate(), folder: folder_of(frame) };
        known.entry(frame.goldens.folder()).or_insert_with(home);
    }
    for (case, homes) in homes {
        let names = told_apart(&case, &homes);
        for frame in frames.iter_mut().filter(|frame| frame.pending.case == case) {
            if let Some(name) = names.get(&frame.goldens.folder()) {
                frame.name.clone_from(name);
            }
        }
    }
}

/// Returns the name of the frame or values that an unusable file would contain.
fn file_case(place: &Goldens, Unusable { path, reason }: &Unusable) -> String {
    match reason {
        AcceptError::Twice { case, .. } | AcceptError::Nowhere { case, .. } => case.clone(),
        _ => place.name_of(path),
    }
}

/// The result of accepting a frame, in the output of `karat accept --json`. Add new fields, but don't change existing
/// fields.
#[derive(Default, Serialize)]
struct AcceptEntry {
    case: String,
    accepted: bool,
    golden: Option<PathBuf>,
    written: bool,
    warnings: Vec<String>,
    /// The reason why Karat refuses to accept the frame.
    error: Option<String>,
}

pub(super) fn accept(args: &AcceptArgs, out: &mut dyn Write) -> Outcome {
    args.ci.check("run `karat accept --from` with this run's artefact")?;
    let artefact = args.from.open()?;
    let waiting = Waiting::of(&args.folder, artefact.as_ref())?;
    let (frames, unusable) = waiting.select(&args.frames)?;
    // The frames of a CI run may belong to several folders of goldens, but the option names only one folder.
    let (own, others): (Vec<_>, Vec<_>) =
        frames.into_iter().partition(|frame| frame.pending.is_of(&frame.goldens));
    if !own.is_empty() && !others.is_empty() {
        let folders: BTreeSet<String> = others.iter().map(folder_of).collect();
        let folders = folders.into_iter().collect::<Vec<_>>().join("`, `");
        tell(&format!(
            "note: Karat accepts frames of only one folder at a time: the frames of `{folders}` are still pending"
        ));
    }
    let frames = if own.is_empty() { others } else { own };
    let acceptance = Acceptance {
        because: args.because.clone(),
        by: args.by.clone(),
        any_adapter: args.any_adapter,
        profile: args.profile.clone(),
        ci_may_write: args.ci.ci_may_write,
    };
    let (mut entries, mut failed) = (Vec::new(), false);
    for Frame { pending, goldens, name: case } in frames {
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
            // A frame that fails doesn't stop the other frames.
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
    args.ci.check("reject")?;
    let artefact = args.from.open()?;
    if artefact.as_ref().is_some_and(Artefact::is_zip) {
        bail!("frames in a zip can't be rejected: delete the zip");
    }
    let mut entries = Vec::new();
    let (frames, unusable) = Waiting::of(&args.folder, artefact.as_ref())?.select(&args.frames)?;
    for Frame { pending, goldens, name: case } in frames {
        goldens.reject(&pending)?;
        if !args.json {
            writeln!(out, "rejected {case}")?;
        }
        entries.push(RejectEntry { case, file: pending.path });
    }
    if args.json {
        write_json(&entries, out)?;
    }
    report(&unusable)?;
    Ok(Ending::Good)
}
