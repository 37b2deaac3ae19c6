//! Finds the shaders of crates through cargo.
//!
//! Cargo's metadata has the folders of a project's crates, so Karat needs no table of folders. An update of a crate
//! could make such a table wrong. A crate at an exact version needs no project: cargo fetches the crate and compiles
//! nothing. Karat stores cargo's answer in cargo's home folder, under a hash of the files on which the answer
//! depends. So a test program runs cargo only once for each lock file.

mod metadata;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::PackageError;
use super::workspace::{self, Kind};
use crate::diagnostic::{nearest, shown};
use crate::settings;
use metadata::Metadata;

/// The version of the data that Karat stores. Increase the version if the form or the meaning of the data changes.
const SCHEMA: u32 = 3;

/// The deepest level of nested folders in which Karat searches for shaders. In real crates, folders nest less deeply.
const DEEPEST: usize = 16;

/// The name of the temporary project for which cargo resolves the version of a crate.
const ASKING: &str = "shaders-of-a-version";

/// The largest number of times that Karat asks cargo for a crate's dependency graph. If shaders import from a crate
/// that is missing in this graph, Karat adds the missing crate to the temporary project, and then asks cargo again. If
/// shaders of the crate's examples import from other crates, Karat asks once more.
const ROUNDS: usize = 4;

#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Graph {
    crates: Vec<Crate>,
    others: BTreeSet<String>,
    /// The manifests of the crates in local folders, each with its hash. Unlike the manifests of published crates,
    /// these manifests may change.
    local: BTreeMap<PathBuf, String>,
}

#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Crate {
    name: String,
    version: String,
    /// The crate's name in code: `bevy_pbr`.
    library: String,
    folder: PathBuf,
    /// The folder whose files are the modules.
    root: PathBuf,
    /// The dependencies of this crate that have shaders, by the names under which this crate imports them. Each value
    /// is an index in the graph's list of crates.
    dependencies: BTreeMap<String, usize>,
    /// The packages that the crate's shaders import. The crate's metadata for wgsl-analyzer declares these packages.
    imports: BTreeSet<String>,
}

#[derive(Clone, Debug)]
pub(super) struct Found {
    graph: Arc<Graph>,
    index: usize,
    /// Folders that Karat uses instead of crates' `root`s. Each key is a crate's index in the graph.
    roots: Arc<BTreeMap<usize, PathBuf>>,
}

/// Two values are equal if they name the same crate of the same graph, with the same module folders.
impl PartialEq for Found {
    fn eq(&self, other: &Self) -> bool {
        let is_same = (self.index, &self.roots) == (other.index, &other.roots);
        Arc::ptr_eq(&self.graph, &other.graph) && is_same
    }
}

impl Eq for Found {}

impl Found {
    fn krate(&self) -> &Crate {
        &self.graph.crates[self.index]
    }

    pub(super) fn library(&self) -> &str {
        &self.krate().library
    }

    pub(super) fn root(&self) -> &Path {
        self.roots.get(&self.index).unwrap_or(&self.krate().root)
    }

    /// A copy that reads the modules of the crate `name` from the folder `root`. `name` is this crate, or a crate
    /// from which this crate may import.
    pub(super) fn with_root(&self, name: &str, root: &str) -> Result<Self, PackageError> {
        let error = |reason: String| PackageError::Crate { name: name.to_owned(), reason };
        let plain = name.replace('-', "_");
        let Some(index) = self.reach(&plain).map(|found| found.index) else {
            let near = nearest(&plain, self.known());
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            return Err(error(format!(
                "`{}` depends on no crate of this name that has shaders{near}",
                self.krate().name
            )));
        };
        self.placed(index, root).map_err(error)
    }

    fn placed(&self, index: usize, root: &str) -> Result<Self, String> {
        let folder = self.graph.crates[index].folder.join(root);
        if !folder.is_dir() {
            return Err(format!("the crate has no folder `{}`", shown(&folder)));
        }
        let mut roots = BTreeMap::clone(&self.roots);
        roots.insert(index, folder);
        Ok(Self { roots: Arc::new(roots), ..self.clone() })
    }

    /// The crate with this name: a dependency, or else the only crate of the graph with this name. A shader may
    /// import from any crate of its game engine, because all crates of the game engine share one namespace.
    pub(super) fn reach(&self, name: &str) -> Option<Self> {
        let of = |index| Self { index, ..self.clone() };
        if let Some(index) = self.krate().dependencies.get(name) {
            return Some(of(*index));
        }
        let named = |krate: &Crate| krate.library == name;
        let mut found = (0..).zip(&self.graph.crates).filter(|(_, krate)| named(krate));
        match (found.next(), found.next()) {
            (Some((index, _)), None) => Some(of(index)),
            _ => None,
        }
    }

    /// The names of all crates from which this crate may import.
    pub(super) fn known(&self) -> impl Iterator<Item = &str> {
        self.graph.crates.iter().map(|krate| &*krate.library)
    }
}

/// A crate as the author names it: `bevy_pbr`, `bevy_pbr@0.20.1`.
#[derive(Clone, Copy)]
struct Wanted<'w> {
    name: &'w str,
    version: Option<&'w str>,
}

/// The cache of cargo's dependency graphs: of projects, and of crates at an exact version. If `Cargo.toml` changes,
/// only the next process notices the change.
struct Graphs;

impl Kind for Graphs {
    type Key = (PathBuf, String);
    type Value = Result<Arc<Graph>, String>;
    // One process opens fewer projects than this.
    const MOST: usize = 1000;
}

/// Finds a crate for the project in this folder. `root` is the folder of the crate's modules, if it differs from
/// the folder that Karat would choose.
pub(super) fn find(base: &Path, wanted: &str, root: Option<&str>) -> Result<Found, PackageError> {
    let error = |reason: String| PackageError::Crate { name: wanted.to_owned(), reason };
    let (name, version) = match wanted.split_once('@') {
        Some((name, version)) => (name, Some(version)),
        None => (wanted, None),
    };
    let sound = |text: &str, more: &str| {
        let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_' || more.contains(c);
        !text.is_empty() && text.chars().all(fits)
    };
    if !sound(name, "") || version.is_some_and(|version| !sound(version, ".+")) {
        return Err(error("write a name, or a name and a version: `bevy_pbr@0.20.1`".to_owned()));
    }
    if version.is_some_and(|version| version.split('.').count() < 3) {
        return Err(error(format!("write the whole version, such as `{name}@1.2.3`")));
    }
    let wanted = Wanted { name, version };
    // A crate at a version needs no project, but a project may configure its registries.
    let key = (base.to_owned(), version.map_or_else(String::new, |v| format!("{name}@{v}")));
    let ask = || match version {
        Some(version) => fetched(base, name, version),
        None => of_project(base),
    };
    // A second thread waits while the first thread runs cargo.
    let graph = workspace::with_room::<Graphs, _>(|known| {
        known.entry(key).or_insert_with(|| ask().map(Arc::new)).clone()
    });
    let graph = graph.map_err(error)?;
    let index = graph.index_of(wanted).map_err(error)?;
    let found = Found { graph, index, roots: Arc::default() };
    match root {
        Some(root) => found.placed(index, root).map_err(error),
        None => Ok(found),
    }
}

impl Graph {
    fn index_of(&self, Wanted { name, version }: Wanted<'_>) -> Result<usize, String> {
        let is_it = |krate: &Crate| {
            (krate.name == name || krate.library == name)
                && version.is_none_or(|version| krate.version == version)
        };
        let found: Vec<usize> =
            (0..).zip(&self.crates).filter(|(_, krate)| is_it(krate)).map(|(i, _)| i).collect();
        match *found {
            [index] => Ok(index),
            [] if self.others.contains(name) => {
                Err("the crate ships no .wgsl or .wesl file".to_owned())
            }
            [] => {
                let near = nearest(name, self.crates.iter().map(|krate| &*krate.name));
                let near =
                    near.map_or_else(|| ".".to_owned(), |near| format!("; did you mean `{near}`?"));
                Err(format!(
                    "the project doesn't depend on the crate{near} If you add a version, such as `{name}@1.2.3`, \
                     cargo fetches the crate"
                ))
            }
            ref several => {
                let versions: Vec<&str> =
                    several.iter().map(|index| &*self.crates[*index].version).collect();
                Err(format!(
                    "the project depends on several versions of the crate: choose one, such as `{name}@{}`",
                    versions.join("` or `@")
                ))
            }
        }
    }
}

/// The dependency graph of the Cargo project in this folder, or in the nearest folder above it.
fn of_project(base: &Path) -> Result<Graph, String> {
    let base = if base.as_os_str().is_empty() { Path::new(".") } else { base };
    let base = base.canonicalize().map_err(|error| format!("`{}`: {error}", shown(base)))?;
    let Some(manifest) = base.ancestors().map(|f| f.join("Cargo.toml")).find(|f| f.is_file())
    else {
        let base = shown(&base);
        return Err(format!(
            "there is no Cargo.toml in or above `{base}`: add a version to the crate's name, and cargo fetches the crate"
        ));
    };
    let lock = base.ancestors().map(|folder| folder.join("Cargo.lock")).find(|file| file.is_file());
    let mut hasher = blake3::Hasher::new();
    hasher.update(&SCHEMA.to_le_bytes()).update(base.as_os_str().as_encoded_bytes());
    for file in [Some(&manifest), lock.as_ref()].into_iter().flatten() {
        hasher.update(&std::fs::read(file).map_err(|error| format!("`{}`: {error}", shown(file)))?);
    }
    let kept = settings::kept(&format!("graph-{}.json", hasher.finalize().to_hex()));
    let ask = || Metadata::of(&base, &manifest, false)?.graph();
    // Without a lock file, the answer may change, so Karat doesn't store it.
    lock.and(kept).map_or_else(ask, |kept| remembered(&kept, ask))
}

fn fetched(base: &Path, name: &str, version: &str) -> Result<Graph, String> {
    let ask = || {
        // The temporary project has a unique name.
        let now = std::time::UNIX_EPOCH.elapsed().unwrap_or_default().as_nanos();
        let own = format!("karat-{}-{now}-{name}-{version}", std::process::id());
        let folder = std::env::temp_dir().join(own);
        let graph = fetch(base, &folder, name, version);
        drop(std::fs::remove_dir_all(&folder));
        graph
    };
    match settings::kept(&format!("{name}-{version}.{SCHEMA}.json")) {
        Some(kept) => remembered(&kept, ask),
        None => ask(),
    }
}

fn fetch(base: &Path, folder: &Path, name: &str, version: &str) -> Result<Graph, String> {
    let failed = |error: std::io::Error| format!("can't write `{}`: {error}", shown(folder));
    // `create_dir` fails if another process has created the folder.
    std::fs::create_dir(folder).map_err(failed)?;
    std::fs::create_dir(folder.join("src")).map_err(failed)?;
    std::fs::write(folder.join("src/lib.rs"), "").map_err(failed)?;
    let manifest = folder.join("Cargo.toml");
    // Requires exactly this version, in the syntax of `Cargo.toml`.
    let exact = format!("{{ version = \"={version}\", default-features = false }}");
    let mut wanted = BTreeMap::from([(name.to_owned(), exact.clone())]);
    let ask = |wanted: &BTreeMap<String, String>| {
        let mut text = format!(
            "[package]\nname = \"{ASKING}\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
             [workspace]\n\n[dependencies]\n"
        );
        wanted.iter().for_each(|(name, how)| text += &format!("{name} = {how}\n"));
        std::fs::write(&manifest, text).map_err(failed)?;
        let graph = Metadata::of(base, &manifest, true)?.graph()?;
        // The manifests needn't be checked later: the project is temporary, and a published version doesn't change.
        Ok::<_, String>(Graph { local: BTreeMap::new(), ..graph })
    };
    let mut graph = ask(&wanted)?;
    for _ in 1..ROUNDS {
        // Crates of one engine with the same version may import from each other without depending on each other.
        let missing: Vec<String> = graph.missing(version).into_iter().collect();
        if missing.iter().all(|name| wanted.contains_key(name)) {
            break;
        }
        wanted.extend(missing.into_iter().map(|name| (name, exact.clone())));
        graph = ask(&wanted)?;
    }
    // Cargo's graph lacks the dependencies of a crate's examples. If cargo can't fetch such a dependency, an import
    // from it fails later.
    let of_examples = graph.of_examples(name, version);
    if of_examples.is_empty() {
        return Ok(graph);
    }
    wanted.extend(of_examples);
    Ok(ask(&wanted).unwrap_or(graph))
}

impl Graph {
    /// The names of crates that shaders import, but on which no crate depends. Karat looks only at crates with this
    /// version, because crates of one game engine have the same version.
    fn missing(&self, version: &str) -> BTreeSet<String> {
        let of_version = self.crates.iter().filter(|krate| krate.version == version);
        let imports = of_version.flat_map(|krate| &krate.imports);
        let known = |name: &str| {
            self.crates.iter().any(|krate| krate.name == name) || self.others.contains(name)
        };
        imports.filter(|name| !known(name)).cloned().collect()
    }

    /// The development dependencies from which a crate's shaders import, each with its name and its entry in the
    /// crate's manifest.
    fn of_examples(&self, name: &str, version: &str) -> BTreeMap<String, String> {
        let is_it = |krate: &&Crate| krate.name == name && krate.version == version;
        let Some(krate) = self.crates.iter().find(is_it) else { return BTreeMap::new() };
        let manifest = std::fs::read_to_string(krate.folder.join("Cargo.toml")).ok();
        let manifest = manifest.and_then(|text| toml::from_str::<toml::Table>(&text).ok());
        let Some(developed) = manifest.as_ref().and_then(|table| table.get("dev-dependencies"))
        else {
            return BTreeMap::new();
        };
        let files = metadata::shaders(&krate.folder, 0);
        let texts: Vec<String> =
            files.iter().filter_map(|file| std::fs::read_to_string(file).ok()).collect();
        let all = developed.as_table().into_iter().flatten().filter_map(|(name, how)| {
            let version = how.as_str().or_else(|| how.get("version")?.as_str())?;
            let package = how.get("package").and_then(toml::Value::as_str);
            let package = package.map_or_else(String::new, |name| format!(", package = {name:?}"));
            let how = format!("{{ version = {version:?}, default-features = false{package} }}");
            Some((name, how))
        });
        let is_imported = |name: &str| {
            let library = name.replace('-', "_");
            let path = format!("{library}::");
            !self.crates.iter().any(|known| known.library == library)
                && texts.iter().any(|text| text.contains(&path))
        };
        let imported = all.filter(|(name, _)| is_imported(name));
        imported.map(|(name, how)| (name.clone(), how)).collect()
    }
}

/// One hash of a manifest's text, and of the path of the folder with the crate's shaders.
fn hash_of(manifest: &Path) -> Option<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&std::fs::read(manifest).ok()?);
    let shaders = manifest.parent().and_then(metadata::common);
    hasher.update(shaders.unwrap_or_default().as_os_str().as_encoded_bytes());
    Some(hasher.finalize().to_hex().to_string())
}

/// Returns the graph in the file `kept`, if the graph's folders still exist and its manifests are unchanged. Otherwise
/// calls `ask`, stores the graph that `ask` returns, and returns this graph.
fn remembered(kept: &Path, ask: impl FnOnce() -> Result<Graph, String>) -> Result<Graph, String> {
    let known = std::fs::read(kept).ok();
    let known = known.and_then(|bytes| serde_json::from_slice::<Graph>(&bytes).ok());
    let is_there = |krate: &Crate| krate.root.is_dir();
    let is_as_it_was = |(file, hash): (&PathBuf, &String)| hash_of(file).as_ref() == Some(hash);
    let holds =
        |graph: &Graph| graph.crates.iter().all(is_there) && graph.local.iter().all(is_as_it_was);
    if let Some(graph) = known.filter(holds) {
        return Ok(graph);
    }
    let graph = ask()?;
    // If Karat can't store the graph, the next process runs cargo again.
    let text = serde_json::to_vec(&graph).expect("a graph has names and paths of UTF-8");
    let new = kept.with_extension(format!("{}.new", std::process::id()));
    let folder = kept.parent().map_or(Ok(()), std::fs::create_dir_all);
    if folder.and_then(|()| std::fs::write(&new, text)).is_ok() {
        drop(std::fs::rename(&new, kept));
    }
    Ok(graph)
}
