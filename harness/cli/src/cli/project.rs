//! The folders of a project's shaders, goldens and records.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Once;
use std::time::SystemTime;

use anyhow::Context;
use karat::Package;
use karat::unstable::diagnostic::shown;
use karat::unstable::output::tell;
use karat::unstable::package::is_of_tools;
use karat::unstable::record::{Recorded, Subject};
use serde::Deserialize;

use super::search::SHADERS;

/// The file that turns a folder into a package.
pub(super) const MANIFEST: &str = "karat.toml";

mod members;

/// The `metadata.karat` table of a Cargo.toml.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    /// The folders of shaders, relative to the manifest.
    packages: Option<Vec<PathBuf>>,
    /// The features with which modules are validated, by the names of the modules.
    #[serde(default)]
    features: BTreeMap<String, Vec<String>>,
    /// The folder of goldens, relative to the manifest.
    golden: Option<PathBuf>,
    /// The Cargo binary that is the project's gallery of frames.
    gallery: Option<String>,
}

impl Settings {
    /// Reads the tables `workspace.metadata.karat` and `package.metadata.karat` of a manifest.
    fn of(folder: &Path, manifest: &toml::Table) -> anyhow::Result<Vec<(PathBuf, Self)>> {
        let said = ["workspace", "package"]
            .iter()
            .filter_map(|section| manifest.get(*section)?.get("metadata")?.get("karat").cloned());
        let settings = said.map(|said| {
            let settings = said.try_into().with_context(|| {
                format!("`metadata.karat` in `{}`", folder.join("Cargo.toml").display())
            })?;
            Ok((folder.to_owned(), settings))
        });
        settings.collect()
    }
}

/// Returns the text of a file, or `None` if the file doesn't exist. If the file is a pipe or a device file, returns an
/// error.
pub(super) fn text_of(file: &Path) -> anyhow::Result<Option<String>> {
    use std::io::ErrorKind::{NotADirectory, NotFound};
    match karat::unstable::diagnostic::read_file(file) {
        Ok(bytes) => Ok(Some(String::from_utf8_lossy(&bytes).into_owned())),
        Err(error) if matches!(error.kind(), NotFound | NotADirectory) => Ok(None),
        Err(error) => Err(error).with_context(|| format!("can't read `{}`", file.display())),
    }
}

/// The number of levels below the working directory in which Karat searches for folders that were tested without Cargo.
const DEPTH: usize = 3;

/// Adds the folders that were tested without Cargo, each with the time of its last run.
fn tested_below(folder: &Path, depth: usize, found: &mut Vec<(SystemTime, PathBuf)>) {
    let record = folder.join(".karat").join("run").join("record");
    if let Ok(ran) = record.metadata().and_then(|record| record.modified()) {
        found.push((ran, folder.to_owned()));
    }
    if depth == 0 {
        return;
    }
    // Karat doesn't follow links: they may form a circle.
    let own = |path: &PathBuf| path.is_dir() && !path.is_symlink() && !is_of_tools(path);
    visible(folder).filter(own).for_each(|path| tested_below(&path, depth - 1, found));
}

/// Checks if a folder is a home folder or the root of the disk. Such folders contain many projects.
fn is_no_project(folder: &Path) -> bool {
    std::env::home_dir().is_some_and(|home| home == folder) || folder.parent().is_none()
}

/// Returns the innermost folder that contains all modules and tests below `folder`. The search stops at a folder that
/// is called `shaders` or has a karat.toml.
fn narrowed(folder: &Path) -> PathBuf {
    let mut at = folder.to_owned();
    loop {
        if at.ends_with(SHADERS) || at.join(MANIFEST).is_file() {
            return at;
        }
        let own = |path: &PathBuf| holds(path, DEEPEST);
        match &visible(&at).filter(own).collect::<Vec<_>>()[..] {
            [one] if one.is_dir() && !one.is_symlink() => at = one.clone(),
            _ => return at,
        }
    }
}

/// The largest number of levels below a folder in which Karat searches for modules.
const DEEPEST: usize = 8;

/// Checks if a path is a file of a package, or a folder with such a file. Links aren't followed: they may form a
/// circle.
fn holds(path: &Path, depth: usize) -> bool {
    if !path.is_dir() {
        let ending = path.extension().unwrap_or_default();
        let is_module = ending == "wgsl" || ending == "wesl";
        return is_module || path.ends_with(MANIFEST) || karat_suite::is_meant(path);
    }
    let inside = |path: PathBuf| path.is_dir() && path.is_symlink() || holds(&path, depth - 1);
    depth > 0 && !is_of_tools(path) && visible(path).any(inside)
}

/// Returns the files and folders in a folder, except for those whose names start with `.`.
fn visible(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let shown = entries.filter(|entry| !entry.file_name().to_string_lossy().starts_with('.'));
    shown.map(|entry| entry.path())
}

fn here() -> anyhow::Result<PathBuf> {
    std::env::current_dir().context("the working directory doesn't exist any more")
}

/// A project: a Cargo workspace, a Cargo package, or a folder of shaders without Cargo.
#[derive(Debug)]
pub(super) struct Project {
    root: PathBuf,
    /// The folders of the workspace's members.
    members: Vec<PathBuf>,
    /// The settings of all manifests, each with its folder. The project's own settings are first.
    settings: Vec<(PathBuf, Settings)>,
    /// `true` for a Cargo package or workspace.
    cargo: bool,
}

/// Returns the displayed name of a package. If another package has the same name, returns the path of the package's
/// folder. For example, many crates have a package called `shaders`.
pub(super) fn title<'p>(package: &Package, all: impl IntoIterator<Item = &'p Package>) -> String {
    let name = package.name();
    match all.into_iter().filter(|other| other.name() == name).count() {
        0 | 1 => name,
        _ => shown(&package.root()),
    }
}

/// Returns a note if the user named a shader, such as `tone.wgsl`, and not the folder: then the tests in
/// `tone_test.wgsl` didn't run. Otherwise returns `None`.
pub(super) fn tests_beside(packages: &[Package]) -> Option<String> {
    let beside = |file: PathBuf| {
        let stem = file.file_stem()?.to_str()?;
        let tests = file.with_file_name(format!("{stem}_test.wgsl"));
        (file.is_file() && tests.is_file()).then_some(tests)
    };
    let tests = packages.iter().map(Package::root).find_map(beside)?;
    Some(format!("the tests in `{}` didn't run: name the folder, not the file", shown(&tests)))
}

impl Project {
    /// Does the work of [`at`](Self::at) for the working directory.
    pub(super) fn find() -> anyhow::Result<Self> {
        Self::at(&here()?)
    }

    /// Finds the Cargo workspace around a folder, or otherwise the nearest Cargo package. Without Cargo, the project is
    /// the folder `shaders` in `folder`, or otherwise the innermost folder with all modules and tests below `folder`.
    pub(super) fn at(folder: &Path) -> anyhow::Result<Self> {
        let own = Self::around(folder)?;
        let shaders = folder.join(SHADERS);
        Ok(match () {
            () if own.cargo => own,
            () if shaders.is_dir() => Self::plain(shaders),
            () if is_no_project(folder) => own,
            () => Self::plain(narrowed(folder)),
        })
    }

    /// Finds the project for commands that use the last run, such as `karat report`. Without Cargo, this is the
    /// folder that was tested last: the working directory or a folder below it.
    pub(super) fn last_tested() -> anyhow::Result<Self> {
        Self::last_tested_at(&here()?)
    }

    /// Does the work of [`last_tested`](Self::last_tested) for a given folder.
    pub(super) fn last_tested_at(folder: &Path) -> anyhow::Result<Self> {
        let own = Self::at(folder)?;
        if own.cargo {
            return Ok(own);
        }
        let mut tested = Vec::new();
        let depth = if is_no_project(folder) { 0 } else { DEPTH };
        tested_below(folder, depth, &mut tested);
        let last = tested.into_iter().max_by_key(|(ran, _)| *ran);
        Ok(last.map_or(own, |(_, root)| Self::plain(root)))
    }

    /// Finds the project around a folder.
    pub(super) fn around(here: &Path) -> anyhow::Result<Self> {
        let mut nearest = None;
        for folder in here.ancestors() {
            let manifest = folder.join("Cargo.toml");
            let Some(text) = text_of(&manifest)? else { continue };
            let table: toml::Table =
                text.parse().with_context(|| format!("in `{}`", manifest.display()))?;
            let workspace = table.contains_key("workspace");
            if workspace || nearest.is_none() {
                nearest = Some((folder.to_owned(), table));
            }
            if workspace {
                break;
            }
        }
        let Some((root, table)) = nearest else {
            return Ok(Self::plain(here.to_owned()));
        };
        let mut settings = Settings::of(&root, &table)?;
        let mut members = Vec::new();
        for (folder, table) in members::of(&root, &table)? {
            settings.extend(Settings::of(&folder, &table)?);
            members.push(folder);
        }
        Ok(Self { root, members, settings, cargo: true })
    }

    fn plain(root: PathBuf) -> Self {
        Self { root, members: Vec::new(), settings: Vec::new(), cargo: false }
    }

    pub(super) fn is_cargo(&self) -> bool {
        self.cargo
    }

    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the packages with the features that the manifests set for their modules.
    pub(super) fn with_features(&self, mut packages: Vec<Package>) -> Vec<Package> {
        for (above, settings) in &self.settings {
            let is_below = |package: &Package| package.root().starts_with(above);
            for (module, features) in &settings.features {
                let features: Vec<&str> = features.iter().map(String::as_str).collect();
                let has = |package: &Package| {
                    package.modules().is_ok_and(|modules| modules.contains(module))
                };
                // If no package has a module, Karat reports that when it validates the first package.
                let own = packages.iter().position(|package| is_below(package) && has(package));
                let other = || packages.iter().position(has);
                let index = own.or_else(other).unwrap_or(0);
                if let Some(package) = packages.get_mut(index) {
                    *package = package.clone().module_features(module, &features);
                }
            }
        }
        packages
    }

    /// Returns the folders with a manifest: the folder of the project, and the folders of its members.
    pub(super) fn manifests(&self) -> impl Iterator<Item = &Path> {
        std::iter::once(&*self.root).chain(self.members.iter().map(PathBuf::as_path))
    }

    pub(super) fn declared(&self) -> impl Iterator<Item = PathBuf> {
        self.settings.iter().flat_map(|(folder, settings)| {
            settings.packages.iter().flatten().map(|package| folder.join(package))
        })
    }

    /// Checks if a manifest in this folder, or in a folder above it, has a list of packages.
    pub(super) fn says(&self, folder: &Path) -> bool {
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        let is_above =
            |above: &Path| above.canonicalize().is_ok_and(|above| folder.starts_with(above));
        self.settings.iter().any(|(above, said)| said.packages.is_some() && is_above(above))
    }

    /// Checks if a manifest has a list of packages. The list may be empty.
    pub(super) fn lists_packages(&self) -> bool {
        self.settings.iter().any(|(_, said)| said.packages.is_some())
    }

    /// Returns the folder of goldens that the project or a member declares. Without a declaration, returns `golden`.
    /// If no such folder exists, and the last run used exactly one folder of goldens, returns the used folder.
    pub(super) fn golden(&self) -> PathBuf {
        let declared =
            |(above, said): &(PathBuf, Settings)| Some(above.join(said.golden.as_ref()?));
        if let Some(folder) = self.settings.iter().find_map(declared) {
            return folder;
        }
        let folder = self.root.join("golden");
        if folder.is_dir() {
            return folder;
        }
        match &mut self.used_goldens()[..] {
            [only] => std::mem::take(only),
            _ => folder,
        }
    }

    /// Returns the record of the last run. Karat reports an unreadable record once.
    pub(super) fn last_run(&self) -> Option<Recorded> {
        static TOLD: Once = Once::new();
        Recorded::read(&self.record()).unwrap_or_else(|error| {
            TOLD.call_once(|| tell(&format!("warning: can't read the last run's record: {error}")));
            None
        })
    }

    /// Returns the folders of goldens that the last run used, if they are in the project.
    pub(super) fn used_goldens(&self) -> Vec<PathBuf> {
        let Some(recorded) = self.last_run() else { return Vec::new() };
        let root = self.root.canonicalize().ok();
        let mut folders = BTreeSet::new();
        for record in &recorded.records {
            if let Subject::Frame { folder, .. } = &record.subject
                && let Ok(place) = Path::new(folder).canonicalize()
                && root.as_ref().is_some_and(|root| place.starts_with(root))
            {
                folders.insert(place);
            }
        }
        folders.into_iter().collect()
    }

    /// Returns the existing folders of goldens, each folder once: the folders of the project, of its members, and of
    /// the last run.
    pub(super) fn goldens(&self) -> Vec<PathBuf> {
        // The project's own folder is added, too, because `golden()` may be the folder of a member.
        let of_manifests = self.manifests().map(|manifest| {
            let mut own = self.settings.iter().filter(|(folder, _)| folder == manifest);
            let golden = own.find_map(|(_, settings)| settings.golden.as_deref());
            manifest.join(golden.unwrap_or(Path::new("golden")))
        });
        let (mut all, mut places) = (Vec::new(), BTreeSet::new());
        for folder in [self.golden()].into_iter().chain(of_manifests).chain(self.used_goldens()) {
            if folder.is_dir() && folder.canonicalize().is_ok_and(|place| places.insert(place)) {
                all.push(folder);
            }
        }
        all
    }

    /// Returns the Cargo binary that is the project's gallery, if the project declares one.
    pub(super) fn gallery(&self) -> Option<&str> {
        self.settings.iter().find_map(|(_, said)| said.gallery.as_deref())
    }

    /// Returns the folder of the project's records.
    pub(super) fn record(&self) -> PathBuf {
        self.output().join("record")
    }

    pub(super) fn output(&self) -> PathBuf {
        if !self.cargo {
            return self.root.join(".karat").join("run");
        }
        let target = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
        self.root.join(target.unwrap_or_else(|| PathBuf::from("target"))).join("karat")
    }
}
