//! Pending frames and values, which you haven't accepted or rejected yet.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use super::content::{Content, PENDING_FRAME, PENDING_TABLE, is_table};
use super::place::{OVERLAID, root};
use super::{AcceptError, FrameFinding, Goldens, Profile, Provenance, Rendered, parts};
use crate::diagnostic::{nearest, shown};
use crate::image::{ExrFile, ImageError, Part};

/// Facts about the golden with which Karat compared a frame, and the difference that Karat found.
#[derive(Clone, Debug, Default)]
pub(super) struct Against {
    pub(super) hash: String,
    /// The profile that owns the golden; empty for the golden for all profiles.
    pub(super) profile: String,
    pub(super) tolerance: String,
    /// The difference that the comparison found; `None` if there was no golden.
    pub(super) finding: Option<FrameFinding>,
}

/// A frame or values that differ from their golden, or have no golden.
#[derive(Clone, Debug)]
pub struct Pending {
    /// Name of the golden.
    pub case: String,
    /// The pending file.
    pub path: PathBuf,
    /// The origin of the frame or values, and the difference from the golden.
    pub provenance: Provenance,
}

impl Pending {
    /// Checks if the pending file belongs to this folder of goldens. A pending file without a recorded folder
    /// belongs to every folder.
    #[must_use]
    pub fn is_of(&self, goldens: &Goldens) -> bool {
        let (own, folder) = (goldens.key(), &self.provenance.folder);
        own.is_empty() || folder.is_empty() || own == *folder
    }

    /// The folder of the golden with which Karat compared this frame or these values. `here` is a folder in the
    /// project. The folder needn't exist yet: Karat makes it for a package's first golden. Returns `None` if the
    /// pending file doesn't name the folder: an older Karat wrote the file, or the folder was in no project.
    ///
    /// # Errors
    /// Returns an error if `here` is in no project, if the folder isn't inside of the project, or if a part of the
    /// folder's path begins with a dot, such as `.git`. Pending files may come from other machines, so Karat doesn't
    /// trust their folders.
    pub fn goldens(&self, here: &Path) -> Result<Option<Goldens>, AcceptError> {
        let folder = &self.provenance.folder;
        if folder.is_empty() {
            return Ok(None);
        }
        let project = here.canonicalize().ok().and_then(|here| Some(root(&here)?.to_owned()));
        let is_sound = |part: Component<'_>| matches!(part, Component::Normal(name) if !name.to_string_lossy().starts_with('.'));
        match project.filter(|_| Path::new(folder).components().all(is_sound)) {
            Some(project) => Ok(Some(Goldens::open(&project.join(folder)))),
            None => Err(AcceptError::Nowhere { case: self.case.clone(), folder: folder.clone() }),
        }
    }

    /// The profile of the adapter that produced the frame or values.
    #[must_use]
    pub fn profile(&self) -> Profile {
        Profile::of(&self.provenance.adapter)
    }

    /// Checks if there was no golden to compare with.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.provenance.compared_with.is_empty()
    }

    /// Checks if the pending file is a table of values, and not a frame.
    #[must_use]
    pub fn is_table(&self) -> bool {
        is_table(&self.path)
    }

    /// Checks if the pending file may become a golden for all profiles without `--any-adapter`. A frame must come from
    /// lavapipe, and a table from lavapipe or Karat's engine. Lavapipe and the engine run on any machine.
    #[must_use]
    pub fn is_canonical(&self) -> bool {
        let adapter = &self.provenance.adapter;
        adapter.is_lavapipe() || (self.is_table() && adapter.path == "cpu")
    }

    /// The arguments that `karat accept` needs in addition to the name and the reason: ` --profile gl-llvmpipe`.
    #[must_use]
    pub fn accept_arguments(&self) -> String {
        if self.is_table() {
            return if self.is_canonical() { "" } else { " --any-adapter" }.to_owned();
        }
        if !self.provenance.compared_profile.is_empty() || !(self.is_canonical() || self.is_new()) {
            format!(" --profile {}", self.profile())
        } else if self.is_canonical() {
            String::new()
        } else {
            " --any-adapter".to_owned()
        }
    }
}

/// The pending frames of a folder.
#[derive(Debug, Default)]
pub struct PendingFrames {
    /// The frames, by name.
    pub frames: Vec<Pending>,
    /// Files that have the name of a pending frame, but can't be used.
    pub unusable: Vec<Unusable>,
}

/// A file or folder that Karat couldn't use while it searched for pending frames.
#[derive(Debug)]
pub struct Unusable {
    /// The file or folder.
    pub path: PathBuf,
    /// The reason.
    pub reason: AcceptError,
}

impl PendingFrames {
    /// Checks if the folder has no pending frames and no unusable files.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty() && self.unusable.is_empty()
    }

    /// If several pending files are for the same golden, moves these files from `frames` to `unusable`.
    fn without_doubles(mut self, folder: &Path) -> Self {
        fn name(pending: &Pending) -> (&str, &str, bool) {
            (&pending.case, &pending.provenance.folder, pending.is_table())
        }
        let below = |path: &Path| shown(path.strip_prefix(folder).unwrap_or(path));
        self.frames.sort_by(|a, b| (name(a), &a.path).cmp(&(name(b), &b.path)));
        let (mut single, mut doubles): (Vec<Pending>, Vec<Pending>) = Default::default();
        for group in self.frames.chunk_by(|a, b| name(a) == name(b)) {
            if group.len() == 1 { &mut single } else { &mut doubles }.extend_from_slice(group);
        }
        for group in doubles.chunk_by(|a, b| name(a) == name(b)) {
            let [first, second, ..] = group else { continue };
            let reason = AcceptError::Twice {
                case: first.case.clone(),
                first: below(&first.path),
                second: below(&second.path),
            };
            self.unusable.push(Unusable { path: first.path.clone(), reason });
        }
        self.unusable.sort_by(|a, b| a.path.cmp(&b.path));
        Self { frames: single, ..self }
    }
}

impl Goldens {
    /// Writes a pending frame. If the check already wrote another path's frame, writes nothing.
    pub(super) fn write_pending(
        &self,
        case: &str,
        frame: &Rendered<'_>,
        against: &Against,
    ) -> Result<Pending, ImageError> {
        let path = self.pending_file(case);
        let (mut provenance, parts) = frame.stored(case, against);
        provenance.folder = self.key();
        provenance.cargo_package = self.cargo_package();
        provenance.modules = self.module_hashes(&frame.modules);
        if !frame.other_waits {
            let metadata = Some(provenance.metadata());
            ExrFile { parts, metadata }.write(&path)?;
        }
        Ok(Pending { case: case.to_owned(), path, provenance })
    }

    fn pending_file(&self, case: &str) -> PathBuf {
        self.pending_folder().join(format!("{case}{PENDING_FRAME}"))
    }

    /// Removes a profile's pending frame, once the profile's frame agrees with the golden again. A missing file is no
    /// error.
    pub(super) fn remove_pending(&self, case: &str, profile: &Profile) {
        let file = self.pending_file(case);
        if named(&file).is_ok_and(|pending| pending.profile() == *profile) {
            remove_preview(&file);
            drop(std::fs::remove_file(file));
        }
    }

    /// All pending frames in the folder and the folders below it.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn pending(&self) -> PendingFrames {
        let mut found = PendingFrames::default();
        let mut files = Vec::new();
        find(&self.folder(), &mut BTreeSet::new(), &mut files, &mut found.unusable);
        for path in files {
            match named(&path) {
                Ok(pending) => found.frames.push(pending),
                Err(reason) => found.unusable.push(Unusable { path, reason }),
            }
        }
        found.without_doubles(&self.folder())
    }

    /// The pending frames of this name, and the unusable files at the paths of such frames.
    ///
    /// # Errors
    /// Returns an error if no pending frame or unusable file has this name.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn select(&self, name: &str) -> Result<PendingFrames, AcceptError> {
        self.select_by(name, |_| false)
    }

    /// The pending frames of this name, and of the names for which `matches` returns `true`.
    ///
    /// # Errors
    /// Returns an error if no pending frame or unusable file has a selected name.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn select_by(
        &self,
        pattern: &str,
        matches: impl Fn(&str) -> bool,
    ) -> Result<PendingFrames, AcceptError> {
        let PendingFrames { mut frames, mut unusable } = self.pending();
        let selects = |case: &str| case == pattern || matches(case);
        let near = nearest(pattern, frames.iter().map(|pending| pending.case.as_str()));
        let near = near.map(str::to_owned);
        frames.retain(|pending| selects(&pending.case));
        unusable.retain(|Unusable { path, reason }| match reason {
            AcceptError::Twice { case, .. } => selects(case),
            _ => selects(&self.name_of(path)),
        });
        let selected = PendingFrames { frames, unusable };
        if selected.is_empty() {
            return Err(AcceptError::NotPending { case: pattern.to_owned(), nearest: near });
        }
        Ok(selected)
    }

    /// The name of a pending frame according to the file's path in this folder. The file's metadata may contradict this
    /// name.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn name_of(&self, path: &Path) -> String {
        let path = path.strip_prefix(self.folder()).unwrap_or(path);
        let name = path.to_string_lossy().replace('\\', "/");
        ending(&name).and_then(|ending| name.strip_suffix(ending)).unwrap_or(&name).to_owned()
    }

    /// Deletes a pending frame and its preview.
    ///
    /// # Errors
    /// Returns an error if the file can't be deleted.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn reject(&self, pending: &Pending) -> Result<(), AcceptError> {
        self.tidy();
        self.remove(pending)
    }

    pub(super) fn remove(&self, pending: &Pending) -> Result<(), AcceptError> {
        remove_preview(&pending.path);
        std::fs::remove_file(&pending.path).map_err(|cause| {
            AcceptError::Image(ImageError::Write { path: shown(&pending.path), cause })
        })
    }
}

/// Removes the preview of a frame that isn't pending any more: `<case>.new.png`, which `karat preview` writes. A
/// missing preview is no error.
fn remove_preview(pending: &Path) {
    if ending(&pending.to_string_lossy()) == Some(PENDING_FRAME) {
        drop(std::fs::remove_file(pending.with_extension("png")));
    }
}

/// The extension of a pending file: `.new.exr` or `.new.csv`. Returns `None` for other files.
fn ending(name: &str) -> Option<&'static str> {
    [PENDING_FRAME, PENDING_TABLE].into_iter().find(|ending| name.ends_with(ending))
}

/// Finds `*.new.exr` and `*.new.csv` in a folder and its subfolders, sorted. Karat enters each folder once, even if
/// several links lead to the folder. Skips frames that were rendered under an overlay (see [`OVERLAID`]), because you
/// can't accept these frames.
fn find(
    folder: &Path,
    entered: &mut BTreeSet<PathBuf>,
    files: &mut Vec<PathBuf>,
    unusable: &mut Vec<Unusable>,
) {
    let entries = folder.canonicalize().and_then(|place| {
        let first = entered.insert(place);
        first.then(|| std::fs::read_dir(folder)).transpose()
    });
    let entries = match entries {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return,
        Err(cause) => {
            let reason = ImageError::Read { path: shown(folder), cause }.into();
            return unusable.push(Unusable { path: folder.to_owned(), reason });
        }
    };
    let mut unread = |cause| {
        let reason = ImageError::Read { path: shown(folder), cause }.into();
        unusable.push(Unusable { path: folder.to_owned(), reason });
    };
    let entries = entries.into_iter().flatten();
    let mut entries: Vec<_> = entries.filter_map(|one| one.map_err(&mut unread).ok()).collect();
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        // The caller reports a folder with such a name as unusable.
        if ending(&entry.file_name().to_string_lossy()).is_some() {
            files.push(path);
        } else if entry.file_name() != OVERLAID && path.is_dir() {
            find(&path, entered, files, unusable);
        }
    }
}

/// Reads a pending frame. The name in the file's metadata must agree with the file's path, because the name becomes the
/// path of a golden, and the file may come from another machine.
fn named(path: &Path) -> Result<Pending, AcceptError> {
    let (_, provenance) = Content::read(path)?;
    let provenance = provenance.ok_or_else(|| AcceptError::Foreign(shown(path)))?;
    let case = provenance.case.clone();
    let own = path.to_string_lossy().replace('\\', "/");
    let ending = ending(&own).unwrap_or_default();
    if !super::is_name(&case) || !own.ends_with(&format!("/{case}{ending}")) {
        return Err(AcceptError::Misplaced { path: shown(path), case });
    }
    Ok(Pending { case, path: path.to_owned(), provenance })
}

impl Rendered<'_> {
    fn stored(&self, case: &str, against: &Against) -> (Provenance, Vec<Part>) {
        let (width, height) = (self.image.width(), self.image.height());
        let precision = self.precision();
        let stored = self.image.rounded_to(precision);
        let provenance = Provenance {
            schema: Provenance::SCHEMA,
            case: case.to_owned(),
            shader: self.shader.clone(),
            modules: BTreeMap::new(),
            pixels: stored.hash(),
            width,
            height,
            color_space: "linear sRGB (BT.709 primaries, D65)".to_owned(),
            precision,
            tolerance: against.tolerance.clone(),
            adapter: self.adapter.clone(),
            processor: processor(),
            facts: self.facts.clone(),
            folder: String::new(),
            cargo_package: String::new(),
            compared_with: against.hash.clone(),
            compared_profile: against.profile.clone(),
            finding: against.finding.clone(),
            exposures: None,
            table: None,
            accepted_by: String::new(),
            accepted_at: String::new(),
            because: String::new(),
        };
        let mut all = vec![Part::new(parts::COLOR, precision, stored)];
        all.extend(self.variance.map(parts::variance));
        all.extend(self.mask.and_then(|mask| parts::mask(mask, width, height)));
        all.extend((self.aovs)());
        (provenance, all)
    }
}

/// Vendor and model of the processor, or only the architecture if the system doesn't report them.
pub(super) fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = info.lines().find(|line| line.starts_with(name))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    match (field("vendor_id"), field("model name")) {
        (Some(vendor), Some(model)) => format!("{vendor}, {model}"),
        _ => std::env::consts::ARCH.to_owned(),
    }
}
