//! Reads `cargo metadata`, and finds the folders of crates' shaders.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

use super::{ASKING, Crate, DEEPEST, Graph, hash_of};
use crate::lines;
use crate::package::EXTENSIONS;

#[derive(Deserialize)]
pub(super) struct Metadata {
    packages: Vec<CargoPackage>,
    resolve: Option<Resolve>,
}

#[derive(Deserialize)]
struct CargoPackage {
    name: String,
    version: String,
    id: String,
    manifest_path: PathBuf,
    /// The registry or repository from which cargo fetched the crate; `None` for a local crate, such as a crate of
    /// the project.
    source: Option<String>,
    targets: Vec<Target>,
    #[serde(default)]
    metadata: serde_json::Value,
}

#[derive(Deserialize)]
struct Target {
    kind: Vec<String>,
    name: String,
}

#[derive(Deserialize)]
struct Resolve {
    nodes: Vec<Node>,
}

#[derive(Deserialize)]
struct Node {
    id: String,
    deps: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    pkg: String,
}

fn host() -> Option<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut rustc = Command::new(rustc);
    let output = lines::output(rustc.arg("-vV"), lines::LOOK_UP, u64::MAX).ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    text.lines().find_map(|line| Some(line.strip_prefix("host: ")?.to_owned()))
}

impl Metadata {
    pub(super) fn of(base: &Path, manifest: &Path, fetches: bool) -> Result<Self, String> {
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut command = Command::new(&cargo);
        command.args(["metadata", "--format-version", "1", "--manifest-path"]).arg(manifest);
        if base.is_dir() {
            command.current_dir(base); // where its registries are configured
        }
        // Karat doesn't need the crates of other platforms.
        if let Some(host) = host() {
            command.args(["--filter-platform", &host]);
        }
        if fetches {
            // A crate may declare a newer Rust, because Karat doesn't compile the crate.
            command.env("CARGO_RESOLVER_INCOMPATIBLE_RUST_VERSIONS", "allow");
        }
        let output = command.output();
        let output = output.map_err(|error| {
            format!("the program `{}` can't be started: {error}", cargo.display())
        })?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            // Lines about the temporary project would only confuse a reader.
            let lines = said.lines().filter(|line| !line.contains(ASKING));
            return Err(format!("cargo says:\n{}", lines.collect::<Vec<_>>().join("\n")));
        }
        serde_json::from_slice(&output.stdout)
            .map_err(|error| format!("cargo's metadata can't be read: {error}"))
    }

    pub(super) fn graph(self) -> Result<Graph, String> {
        let nodes = self.resolve.ok_or("cargo's metadata has no resolved dependencies")?.nodes;
        let (mut crates, mut others) = (Vec::new(), BTreeSet::new());
        let mut indices: HashMap<&str, usize> = HashMap::new();
        let local = self.packages.iter().filter(|package| package.source.is_none());
        let local = local.map(|package| &package.manifest_path);
        let local = local.filter_map(|file| Some((file.clone(), hash_of(file)?))).collect();
        for package in &self.packages {
            let Some(folder) = package.manifest_path.parent() else { continue };
            let Some(root) = package.root_of_modules(folder) else {
                others.insert(package.name.clone());
                continue;
            };
            indices.insert(&package.id, crates.len());
            crates.push(Crate {
                name: package.name.clone(),
                version: package.version.clone(),
                library: package.library(),
                folder: folder.to_owned(),
                root,
                dependencies: BTreeMap::new(),
                imports: package.imports(),
            });
        }
        for node in &nodes {
            let Some(index) = indices.get(&*node.id) else { continue };
            let known = node.deps.iter().filter_map(|dependency| {
                Some((dependency.name.clone(), *indices.get(&*dependency.pkg)?))
            });
            crates[*index].dependencies = known.collect();
        }
        Ok(Graph { crates, others, local })
    }
}

impl CargoPackage {
    fn library(&self) -> String {
        let is_library = |kind: &String| kind.contains("lib") || kind == "proc-macro";
        let library = self.targets.iter().find(|target| target.kind.iter().any(is_library));
        library.map_or(&self.name, |target| &target.name).replace('-', "_")
    }

    fn imports(&self) -> BTreeSet<String> {
        let declared = self.metadata["wgsl-analyzer"]["dependencies"].as_object();
        let path = |value: &serde_json::Value| Some(value.get("path")?.as_str()?.to_owned());
        // In an engine's repository, the crates are beside each other: `../bevy_render`.
        let beside = |(name, value): &(&String, &serde_json::Value)| {
            path(value).is_some_and(|path| path == format!("../{name}"))
        };
        let named = declared.into_iter().flatten().filter(beside);
        named.map(|(name, _)| name.clone()).collect()
    }

    /// The folder of the crate's modules: the declared folder, or `src`, or the innermost folder with all
    /// shaders.
    fn root_of_modules(&self, folder: &Path) -> Option<PathBuf> {
        let declared = ["karat", "wgsl-analyzer"].map(|tool| self.metadata[tool]["root"].as_str());
        let wesl = std::fs::read_to_string(folder.join("wesl.toml")).ok();
        let wesl = wesl.and_then(|text| toml::from_str::<toml::Table>(&text).ok());
        let wesl = wesl.as_ref().and_then(|table| table.get("root")?.as_str());
        let declared = declared.into_iter().chain([wesl]).flatten().map(|root| folder.join(root));
        let src = std::iter::once(folder.join("src"));
        let has = |root: &PathBuf| common(root).is_some();
        declared.chain(src).find(has).or_else(|| common(folder))
    }
}

pub(super) fn common(folder: &Path) -> Option<PathBuf> {
    let files = shaders(folder, 0);
    let mut folders = files.iter().filter_map(|file| file.parent());
    let first = folders.next()?;
    let of_both = |one: &'_ Path, other: &Path| {
        one.ancestors().find(|folder| other.starts_with(folder)).unwrap_or(folder).to_owned()
    };
    Some(folders.fold(first.to_owned(), |one, other| of_both(&one, other)))
}

pub(super) fn shaders(folder: &Path, depth: usize) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        let name = name.to_string_lossy();
        let is_shader = |known: &&str| path.extension().is_some_and(|own| own == *known);
        if path.is_dir() {
            if depth + 1 < DEEPEST && !name.starts_with('.') && (depth > 0 || name != "target") {
                found.extend(shaders(&path, depth + 1));
            }
        } else if EXTENSIONS.iter().any(is_shader) {
            found.push(path);
        }
    }
    found
}
