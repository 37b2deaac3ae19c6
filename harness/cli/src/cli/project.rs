//! Where a project keeps its shaders, goldens and records.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::Context;
use karat::Package;
use karat::record::{Record, Recorded, Subject};
use serde::Deserialize;

use super::PackageArgs;

/// The `metadata.karat` table of a Cargo.toml.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    /// Shader folders, relative to the manifest.
    packages: Option<Vec<PathBuf>>,
    /// Features with which modules are validated, by the modules' names.
    #[serde(default)]
    features: BTreeMap<String, Vec<String>>,
    /// Folder of goldens, relative to the manifest.
    golden: Option<PathBuf>,
    /// Name of the cargo binary that is the project's gallery.
    gallery: Option<String>,
}

/// How far below the working directory a folder without Cargo is looked for that was tested.
const DEPTH: usize = 3;

/// Folders without Cargo that were tested, and when.
fn tested_below(folder: &Path, depth: usize, found: &mut Vec<(SystemTime, PathBuf)>) {
    let record = folder.join(".karat").join("run").join("record");
    if let Ok(ran) = record.metadata().and_then(|record| record.modified()) {
        found.push((ran, folder.to_owned()));
    }
    if depth == 0 {
        return;
    }
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        // What tools keep, and what they build.
        let is_kept =
            name.to_string_lossy().starts_with('.') || name == "target" || name == "node_modules";
        // Links aren't followed: they may lead in a circle.
        if !is_kept && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            tested_below(&entry.path(), depth - 1, found);
        }
    }
}

/// What the manifest of a workspace's member says for itself.
fn settings_of_member(folder: &Path) -> anyhow::Result<Settings> {
    let text = std::fs::read_to_string(folder.join("Cargo.toml"))?;
    let table: toml::Table = text.parse()?;
    let metadata = || table.get("package")?.get("metadata")?.get("karat").cloned();
    Ok(metadata().map_or_else(|| Ok(Settings::default()), toml::Value::try_into)?)
}

/// The project around the working directory.
#[derive(Debug)]
pub(super) struct Project {
    root: PathBuf,
    settings: Settings,
    /// Whether it is a package or workspace of Cargo's.
    cargo: bool,
}

impl Project {
    /// The Cargo workspace of the working directory, or else the nearest package, or else the
    /// working directory itself or its folder `shaders`.
    pub(super) fn find() -> anyhow::Result<Self> {
        let here = std::env::current_dir().context("the working directory is gone")?;
        Self::opened_at(&here)
    }

    /// The project around a folder. Without Cargo it is the folder that was tested last, of this one and those
    /// below it; where none was, it is the folder `shaders`, as for `karat test` and `karat init`.
    pub(super) fn opened_at(folder: &Path) -> anyhow::Result<Self> {
        let own = Self::around(folder)?;
        if own.cargo {
            return Ok(own);
        }
        let plain = |root| Self { root, settings: Settings::default(), cargo: false };
        let mut tested = Vec::new();
        // What lies below a person's folder, or the whole disk, is no project of its own.
        let is_home = std::env::home_dir().is_some_and(|home| home == folder);
        let depth = if is_home || folder.parent().is_none() { 0 } else { DEPTH };
        tested_below(folder, depth, &mut tested);
        let shaders = folder.join("shaders");
        let last = tested.into_iter().max_by_key(|(ran, _)| *ran).map(|(_, root)| plain(root));
        Ok(last.unwrap_or_else(|| if shaders.is_dir() { plain(shaders) } else { own }))
    }

    /// The project around a folder.
    pub(super) fn around(here: &Path) -> anyhow::Result<Self> {
        let mut nearest = None;
        for folder in here.ancestors() {
            let manifest = folder.join("Cargo.toml");
            let Ok(text) = std::fs::read_to_string(&manifest) else { continue };
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
            return Ok(Self { root: here.to_owned(), settings: Settings::default(), cargo: false });
        };
        let settings = ["workspace", "package"]
            .iter()
            .find_map(|section| table.get(*section)?.get("metadata")?.get("karat").cloned());
        let settings = match settings {
            Some(settings) => settings
                .try_into()
                .with_context(|| format!("`metadata.karat` in `{}`", root.display()))?,
            None => Settings::default(),
        };
        Ok(Self { root, settings, cargo: true })
    }

    /// Whether Cargo knows it.
    pub(super) fn is_cargo(&self) -> bool {
        self.cargo
    }

    /// The folder of the manifest.
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// The shader packages: the one given, or the project's.
    pub(super) fn packages(&self, args: &PackageArgs) -> anyhow::Result<Vec<Package>> {
        let packages = self.opened(args)?;
        Ok(packages.into_iter().map(|package| args.featured(package)).collect())
    }

    fn opened(&self, args: &PackageArgs) -> anyhow::Result<Vec<Package>> {
        if let Some(name) = &args.krate {
            return Ok(vec![Package::open_crate(&self.root, name, args.root.as_deref())?]);
        }
        let folders = match (&args.package, &self.settings.packages) {
            (Some(folder), _) => vec![folder.clone()],
            (None, Some(folders)) => folders.iter().map(|folder| self.root.join(folder)).collect(),
            (None, None) => {
                let shaders = self.root.join("shaders");
                // A folder of shaders in which there is no Cargo project.
                vec![if self.cargo || shaders.exists() { shaders } else { self.root.clone() }]
            }
        };
        let open = |folder: &PathBuf| {
            Package::open(folder).context("name the shader folder with --package DIR")
        };
        let packages: Vec<Package> = folders.iter().map(open).collect::<Result<_, _>>()?;
        Ok(self.with_features(packages))
    }

    /// The packages, whose modules are validated with the features that the project sets for them.
    fn with_features(&self, mut packages: Vec<Package>) -> Vec<Package> {
        for (module, features) in &self.settings.features {
            let features: Vec<&str> = features.iter().map(String::as_str).collect();
            let has =
                |package: &Package| package.modules().is_ok_and(|modules| modules.contains(module));
            // What no package has is reported when the first one is validated.
            let index = packages.iter().position(has).unwrap_or(0);
            if let Some(package) = packages.get_mut(index) {
                *package = package.clone().validated_with(module, &features);
            }
        }
        packages
    }

    /// Whether somebody says which the packages are: otherwise they are what a folder is called.
    pub(super) fn declares(&self, args: &PackageArgs) -> bool {
        args.package.is_some() || args.krate.is_some() || self.settings.packages.is_some()
    }

    /// [`packages`](Self::packages). Where nothing is declared a folder `shaders` is one if it can be,
    /// and there may be none, as in a project whose tests hold their shaders.
    pub(super) fn packages_if_any(&self, args: &PackageArgs) -> anyhow::Result<Vec<Package>> {
        if self.declares(args) {
            return self.packages(args);
        }
        match self.root.join("shaders").exists() {
            true => Ok(self.packages(args).unwrap_or_default()),
            false => Ok(Vec::new()),
        }
    }

    /// The packages that were tested: those that are declared, or else those that tests used and the
    /// folder `shaders`.
    pub(super) fn tested(&self, records: &[Record]) -> anyhow::Result<Vec<Package>> {
        let args = PackageArgs::default();
        let mut packages = self.packages_if_any(&args)?;
        if self.declares(&args) {
            return Ok(packages);
        }
        let place = |package: &Package| package.root().canonicalize().ok();
        let known: Vec<_> = packages.iter().map(place).collect();
        packages.extend(self.used(records)?.into_iter().filter(|new| !known.contains(&place(new))));
        Ok(packages)
    }

    /// The packages of the project whose functions tests called, as their folders are opened.
    pub(super) fn used(&self, records: &[Record]) -> anyhow::Result<Vec<Package>> {
        let place = |folder: &Path| folder.canonicalize().ok();
        let (root, output) = (place(&self.root), place(&self.output()));
        let mut folders = Vec::new();
        for record in records {
            let Subject::Function { package, .. } = &record.subject else { continue };
            // Relative to wherever a folder's tests were run from: that isn't known here.
            if matches!(&**package, "" | ".") {
                continue;
            }
            let Some(folder) = place(&self.root.join(package)) else { continue };
            let own = root.as_ref().is_some_and(|root| folder.starts_with(root))
                && output.as_ref().is_none_or(|output| !folder.starts_with(output));
            if own && !folders.contains(&folder) {
                folders.push(folder);
            }
        }
        let packages: Vec<_> =
            folders.iter().filter_map(|folder| Package::open(folder).ok()).collect();
        Ok(self.with_features(packages))
    }

    /// The package that holds a function; the first one if none does, for its error message.
    pub(super) fn package_of(&self, args: &PackageArgs, path: &str) -> anyhow::Result<Package> {
        let mut packages = self.packages(args)?;
        let holds = |package: &Package| {
            package.functions().is_ok_and(|known| known.iter().any(|item| item.name == path))
        };
        let index = packages.iter().position(holds).unwrap_or(0);
        anyhow::ensure!(!packages.is_empty(), "`metadata.karat` lists no shader package");
        Ok(packages.swap_remove(index))
    }

    /// The folder of goldens: the declared one, or `golden`, or else the only one that the last run used.
    pub(super) fn golden(&self) -> PathBuf {
        if let Some(folder) = &self.settings.golden {
            return self.root.join(folder);
        }
        let folder = self.root.join("golden");
        match &mut self.used_goldens()[..] {
            [only] if !folder.is_dir() => std::mem::take(only),
            _ => folder,
        }
    }

    /// Folders of the project with goldens that the last run used. Of a record that can't be read none are
    /// known.
    pub(super) fn used_goldens(&self) -> Vec<PathBuf> {
        let Some(recorded) = Recorded::read(&self.record()).ok().flatten() else {
            return Vec::new();
        };
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

    /// The folders of goldens that are there: the project's, those of its workspace's members, and those that
    /// the last run used. Each once.
    pub(super) fn goldens(&self) -> Vec<PathBuf> {
        let of_members = self.members().into_iter().map(|member| {
            let golden = settings_of_member(&member).ok().and_then(|settings| settings.golden);
            member.join(golden.unwrap_or_else(|| PathBuf::from("golden")))
        });
        let (mut all, mut places) = (Vec::new(), BTreeSet::new());
        for folder in [self.golden()].into_iter().chain(of_members).chain(self.used_goldens()) {
            if folder.is_dir() && folder.canonicalize().is_ok_and(|place| places.insert(place)) {
                all.push(folder);
            }
        }
        all
    }

    /// The folders of the workspace's members, as its manifest names them.
    fn members(&self) -> Vec<PathBuf> {
        let text = std::fs::read_to_string(self.root.join("Cargo.toml")).unwrap_or_default();
        let table: toml::Table = text.parse().unwrap_or_default();
        let members = || table.get("workspace")?.get("members")?.as_array();
        let patterns = members().into_iter().flatten().filter_map(|member| member.as_str());
        let root = glob::Pattern::escape(&self.root.to_string_lossy());
        let found = patterns.filter_map(|pattern| glob::glob(&format!("{root}/{pattern}")).ok());
        found.flatten().flatten().filter(|member| member.join("Cargo.toml").is_file()).collect()
    }

    /// The cargo binary that is the project's gallery, if one is declared.
    pub(super) fn gallery(&self) -> Option<&str> {
        self.settings.gallery.as_deref()
    }

    /// The folder of records, which has one of each run.
    pub(super) fn record(&self) -> PathBuf {
        self.output().join("record")
    }

    /// The folder of what runs leave behind.
    pub(super) fn output(&self) -> PathBuf {
        if !self.cargo {
            return self.root.join(".karat").join("run");
        }
        let target = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
        self.root.join(target.unwrap_or_else(|| PathBuf::from("target"))).join("karat")
    }
}
