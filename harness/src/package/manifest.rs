//! Reads `karat.toml`, the file beside the modules of a folder: features, the program that expands modules, known
//! failures in the translation matrix, inputs and overrides, accepted hazards and mutants, compilers and limits.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::{Command, Output};

use serde::Deserialize;

use super::accepted::{AcceptedHazard, AcceptedMutants, Hazards, KnownRows};
use super::asserts;
use super::compilers::{self, Compilers};
use super::feature::{Feature, Features};
use super::function_item::functions_of;
use super::inputs::{self, scope};
use super::limits::Limits;
use super::values::{self, Values};
use super::workspace::{self, Kind};
use super::{Origin, Package, PackageError};
use crate::diagnostic::{FileRead, SourceFile, nearest, read_file, shown};
use crate::lines::{self, Broken};
use crate::settings;

pub(super) const NAME: &str = "karat.toml";

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Manifest {
    /// The file; `None` if the folder has no `karat.toml`.
    pub(super) read: Option<FileRead>,
    dependencies: BTreeMap<String, Dependency>,
    /// Values of features. A test or the command line may override these values.
    pub(super) features: Features,
    /// Features that the game engine sets. Karat accepts such a feature even if no condition uses it.
    pub(super) set_by_engine: BTreeSet<String>,
    /// Texts that replace placeholders.
    values: Values,
    /// A program and its arguments. The program prints a module as WGSL. The path of the module's file is the last
    /// argument. The program runs in the folder of the modules.
    preprocess: Vec<String>,
    /// For each module, the other modules that the author's program concatenates with this module.
    join: BTreeMap<String, Vec<String>>,
    matrix: Vec<KnownRows>,
    /// Declarations of inputs, values of overrides, and accepted hazards.
    hazards: Hazards,
    mutants: Vec<AcceptedMutants>,
    pub(super) compilers: Compilers,
}

/// An entry with another package: `{ path = "../noise" }` or `{ crate = "lygia@1.4.0" }`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Dependency {
    /// The package's folder, relative to the folder of `karat.toml`.
    path: Option<PathBuf>,
    /// The crate with the shaders, and its version.
    #[serde(rename = "crate")]
    krate: Option<String>,
    /// The folder of modules in the crate. An author needs this key if Karat doesn't find the folder.
    root: Option<String>,
}

const TAKEN: [&str; 6] = ["karat", "wgsl_test", "package", "self", "super", "constants"];

impl KnownRows {
    /// Keeps only the functions of one module, and removes the module's path from their names. Returns `None` if the
    /// entry has no function of this module.
    fn of_module(self, module: &str) -> Option<Self> {
        let own = |row: String| match row.contains("::") {
            true => Some(row.strip_prefix(module)?.strip_prefix("::")?.to_owned()),
            false => Some(row),
        };
        let rows: Vec<String> = self.rows.into_iter().filter_map(own).collect();
        (!rows.is_empty()).then_some(Self { rows, ..self })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    /// Other packages that modules import, by name: `{ path = "../noise" }` or `{ crate = "lygia@1.4.0" }`.
    #[serde(default)]
    dependencies: BTreeMap<String, Dependency>,
    /// Features: `{ SHADOWS = true }`.
    #[serde(default)]
    features: BTreeMap<String, toml::Value>,
    /// Values that replace placeholders or names in the shaders, as the host does before it compiles the shaders.
    #[serde(default)]
    values: BTreeMap<String, toml::Value>,
    /// A program and its arguments. Karat adds the path of a module's file, and the program prints the module as WGSL.
    preprocess: Option<Vec<String>>,
    /// For each module, the modules that the host joins to this module.
    #[serde(default)]
    join: BTreeMap<String, Vec<String>>,
    /// Known failures in the table of `karat matrix`, as `[[matrix]]`.
    #[serde(default)]
    matrix: Vec<KnownRows>,
    /// Ranges of arguments and variables, by name: `{ roughness = "0..1" }`.
    #[serde(default)]
    inputs: BTreeMap<toml::Spanned<String>, toml::Value>,
    /// Values of `override`s for every test.
    #[serde(default)]
    overrides: BTreeMap<String, toml::Value>,
    /// Accepted hazards, as `[[hazard]]`.
    #[serde(default, rename = "hazard")]
    hazards: Vec<AcceptedHazard>,
    /// Mutants that no test can kill, as `[[mutant]]`.
    #[serde(default, rename = "mutant")]
    mutants: Vec<AcceptedMutants>,
    /// Compilers in addition to naga, as `[compilers]`.
    #[serde(default)]
    compilers: compilers::Written,
    /// The limits of the GPU devices that must run the shaders, by WebGPU's names.
    limits: Option<BTreeMap<String, toml::Value>>,
}

/// A path relative to a folder, without `name/..` pairs. Without such pairs, each package has only one path. If two
/// packages import from each other, paths would otherwise grow without end: `../b/../a/../b`.
fn joined(folder: &Path, path: &Path) -> PathBuf {
    let mut joined = folder.to_owned();
    for part in path.components() {
        let leaves = part == Component::ParentDir
            && matches!(joined.components().next_back(), Some(Component::Normal(_)));
        match part {
            Component::CurDir => {}
            _ if leaves => drop(joined.pop()),
            part => joined.push(part),
        }
    }
    if joined.as_os_str().is_empty() { PathBuf::from(".") } else { joined }
}

struct Printed;

impl Kind for Printed {
    type Key = (PathBuf, blake3::Hash, Vec<String>);
    type Value = String;
    const MOST: usize = 10_000;
    /// A `preprocess` program can read more files than the module's. So the output may depend on more than the key.
    const VOLATILE: bool = true;
}

impl Package {
    pub(crate) fn compilers(&self) -> Result<Compilers, PackageError> {
        let manifest = Manifest::of(self)?;
        let file = manifest.read.as_ref().map(|read| shown(&read.file)).unwrap_or_default();
        let require_tint = manifest.compilers.require_tint || self.requires_tint;
        Ok(Compilers { file, require_tint, ..manifest.compilers })
    }

    /// Checks if a program prints the modules (`preprocess` in `karat.toml`). Such a program may read any file, so a
    /// change of any file may change a module.
    ///
    /// ```
    /// assert!(!karat::Package::from_source("m", "fn f() {}").is_printed());
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn is_printed(&self) -> bool {
        Manifest::of(self).is_ok_and(|manifest| !manifest.preprocess.is_empty())
    }
}

/// The names of functions and arguments in a `karat.toml` for which Karat has found no declaration yet.
#[derive(Debug)]
pub(crate) struct Declared {
    file: String,
    text: String,
    inputs: Vec<String>,
    /// The names in `[values]` that Karat has found in no module yet.
    values: Vec<String>,
    /// Functions with accepted hazards: `module::name`, `module::*`.
    functions: Vec<String>,
    rows: Vec<String>,
    /// The names that the modules declare, including names under false conditions. Suggestions for a typo come from
    /// these names.
    names: Vec<String>,
}

impl Package {
    pub(crate) fn declared(&self) -> Result<Option<Declared>, PackageError> {
        let manifest = Manifest::of(self)?;
        let Origin::Folder { .. } = self.origin else { return Ok(None) };
        let root = self.root();
        let Some(read) = manifest.read else {
            // A case-sensitive file system doesn't read `Karat.toml`.
            let entries = std::fs::read_dir(&root).into_iter().flatten().flatten();
            let mut names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
            return match names.find(|name| name.eq_ignore_ascii_case(NAME)) {
                Some(name) => Err(PackageError::Manifest {
                    file: shown(&root.join(name)),
                    reason: format!("the file's name must be `{NAME}`, in lower case"),
                }),
                None => Ok(None),
            };
        };
        let accepted = manifest.hazards.accepted.into_iter();
        Ok(Some(Declared {
            text: text_of(self, &read.file),
            file: shown(&read.file),
            inputs: manifest.hazards.inputs.into_keys().collect(),
            values: manifest.values.into_keys().collect(),
            functions: accepted.flat_map(|one| one.functions).collect(),
            rows: manifest.matrix.into_iter().flat_map(|known| known.rows).collect(),
            names: Vec::new(),
        }))
    }
}

impl Declared {
    /// Removes the names that occur in a module or in the module's linked text. Call this method for each module.
    pub(crate) fn see(
        &mut self,
        package: &Package,
        name: &str,
        linked: &str,
    ) -> Result<(), PackageError> {
        let module = package.parsed(name)?;
        if !self.values.is_empty() {
            let all = self.values.iter().map(|name| (name.clone(), String::new())).collect();
            let text = package.before_values(name)?;
            let seen: Vec<String> =
                values::used(&text, &all).into_iter().map(str::to_owned).collect();
            self.values.retain(|name| !seen.contains(name));
        }
        let inactive = module.inactive.iter().map(|one| one.name.as_str());
        let path = |item: &str| match name {
            "" => item.to_owned(),
            module => format!("{module}::{item}"),
        };
        self.names.extend(functions_of(name, &module).into_iter().map(|item| item.name));
        self.names.extend(inactive.map(path));
        let texts = [linked, &module.file.text];
        let words = texts.map(|text| text.split(|c: char| c != '_' && !c.is_alphanumeric()));
        let words: BTreeSet<&str> = words.into_iter().flatten().collect();
        let has = |path: &String| {
            let (_, own) = scope(path);
            let mut parts = own.split(['.', '(', ')', ':']).filter(|part| !part.is_empty());
            parts.all(|part| matches!(part, "length" | "workgroups") || words.contains(part))
        };
        self.inputs.retain(|path| !has(path));
        Ok(())
    }

    /// Returns an error if a name in `karat.toml` occurs in no module, because its entry would have no effect.
    pub(crate) fn conclude(self) -> Result<(), PackageError> {
        // All functions of a module, and of the modules below it.
        let is_of = |all: &str, own: &String| all.ends_with("::") && own.starts_with(all);
        let lacks = |name: &&String| match name.strip_suffix('*') {
            Some(all) => !self.names.iter().any(|own| is_of(all, own)),
            None => !self.names.contains(name),
        };
        let missing = self.rows.iter().filter(|row| !self.names.contains(row));
        let (keys, reason) = if let Some(name) = self.values.first() {
            let what = ", but no module uses this name as a placeholder or as an undeclared name";
            (["values", name], format!("`[values]` has a value for `{name}`{what}"))
        } else if let Some(name) = self.inputs.first() {
            let what = "is declared, but nothing in the package's shaders has this name";
            (["inputs", name], format!("the input `{name}` {what}"))
        } else if let Some(name) = self.functions.iter().filter(lacks).chain(missing).next() {
            let near = nearest(name, self.names.iter().map(String::as_str));
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            let of = if self.functions.contains(name) { "hazard" } else { "matrix" };
            let what = "but the package has no function of this name";
            ([of, name], format!("an entry of `[[{of}]]` names `{name}`, {what}{near}"))
        } else {
            return Ok(());
        };
        let place = placed(&self.file, &self.text, &keys);
        Err(PackageError::Manifest { file: self.file, reason: reason + &place })
    }
}

fn text_of(package: &Package, file: &Path) -> String {
    let unsaved = package.unsaved_text(file).map(|text| text.to_string());
    unsaved.or_else(|| std::fs::read_to_string(file).ok()).unwrap_or_default()
}

/// The position of a name in a section, as a suffix for a message. The text is empty if the section doesn't have
/// the name.
pub(super) fn place_of(section: &str, package: &Package, name: &str) -> String {
    let read = Manifest::of(package).ok().and_then(|manifest| manifest.read);
    read.map_or_else(String::new, |FileRead { file, .. }| {
        placed(&shown(&file), &text_of(package, &file), &[section, name])
    })
}

/// The position of a key in a section of `karat.toml`, or of a name in the section's text, as a suffix for a message: `
/// (karat.toml:5:1)`.
fn placed(file: &str, text: &str, keys: &[&str]) -> String {
    let Ok(table) = toml::de::DeTable::parse(text) else { return String::new() };
    let [section, names @ ..] = keys else { return String::new() };
    let Some((key, value)) = table.get_ref().get_key_value(*section) else { return String::new() };
    let below = names.first().and_then(|name| {
        let inner = value.get_ref().as_table();
        let inner = inner.and_then(|inner| inner.get_key_value(*name));
        // The name may be in a list of functions, or its members may be in a table: `params.x`.
        let below = &text[key.span().start..];
        let named = |name: &str| Some(key.span().start + below.find(name)?);
        let quoted = || named(&format!("\"{name}\""));
        let head = || name.split('.').next().and_then(named);
        let own = inner.map(|(key, _)| key.span().start);
        own.or_else(quoted).or_else(|| named(name)).or_else(head)
    });
    let at = below.unwrap_or(key.span().start);
    let before = &text[..at];
    let start = before.rfind('\n').map_or(0, |end| end + 1);
    let column = text[start..at].chars().count() + 1;
    format!(" ({file}:{}:{column})", before.matches('\n').count() + 1)
}

/// The largest number of bytes that a program may print for one module. Modules are far smaller.
const MOST_BYTES: u64 = 16 << 20;

/// The cache of manifests. The key is the text of a `karat.toml`. If several packages have the same text, the entry
/// belongs to the package that stored its manifest last.
impl Kind for Manifest {
    type Key = String;
    type Value = (Origin, Self);
    // Any test opens fewer packages than this.
    const MOST: usize = 64;
}

impl Manifest {
    /// The manifest of a package. The manifest is empty if there is no `karat.toml`.
    pub(super) fn of(package: &Package) -> Result<Self, PackageError> {
        let file = match &package.origin {
            Origin::Folder { .. } => package.root().join(NAME),
            Origin::File { path, .. } => path.with_file_name(NAME),
            _ => return Ok(Self::default()),
        };
        let error = |reason: String| PackageError::Manifest { file: shown(&file), reason };
        let unsaved = package.unsaved_text(&file);
        let read = unsaved.map_or_else(|| read_file(&file), |text| Ok(text.as_bytes().to_vec()));
        let text = match read {
            Ok(bytes) => String::from_utf8(bytes).map_err(|other| error(other.to_string()))?,
            Err(none) if none.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(other) => return Err(error(other.to_string())),
        };
        // Each check needs the manifest, and parsing it takes as long as a small check.
        if let Some((origin, manifest)) = workspace::get::<Self>(&text)
            && origin == package.origin
        {
            return Ok(manifest);
        }
        let manifest = Self::parsed(package, &file, &text)?;
        workspace::keep::<Self>(text, (package.origin.clone(), manifest.clone()));
        Ok(manifest)
    }

    fn parsed(package: &Package, file: &Path, text: &str) -> Result<Self, PackageError> {
        let error = |reason: String| PackageError::Manifest { file: shown(file), reason };
        let told =
            |keys: &[&str], reason: String| error(reason + &placed(&shown(file), text, keys));
        let written = toml::from_str(text);
        let Written {
            dependencies,
            mut features,
            values,
            preprocess,
            join,
            matrix,
            inputs: written_inputs,
            overrides,
            hazards,
            mutants,
            compilers,
            limits,
        } = written.map_err(|reason| error(reason.to_string().trim_end().to_owned()))?;
        let limits = limits.map_or_else(|| Ok(Limits::default()), Limits::of).map_err(error)?;
        let compilers = Compilers::of(compilers, limits, String::new()).map_err(error)?;
        for (name, dependency) in &dependencies {
            if TAKEN.contains(&&**name) {
                let reason =
                    format!("a dependency can't have the name `{name}`, which is reserved");
                return Err(told(&["dependencies", name], reason));
            }
            let has_root = dependency.path.is_some() && dependency.root.is_some();
            if dependency.path.is_some() == dependency.krate.is_some() || has_root {
                let reason = format!(
                    "the dependency `{name}` must be {{ path = \"..\" }}, or {{ crate = \"name@version\" }}. With \
                     `crate`, you can also set `root`, the folder of the shaders"
                );
                return Err(told(&["dependencies", name], reason));
            }
        }
        let set_by_engine = match features.remove("set_by_engine") {
            None => BTreeSet::new(),
            Some(names) => names.try_into().map_err(|_| {
                let reason = "`set_by_engine` must list names of features: [\"FAST\"]".to_owned();
                told(&["features", "set_by_engine"], reason)
            })?,
        };
        let value = |(name, own): (String, toml::Value)| {
            let value = values::value(&name, &own);
            let value = value.map_err(|reason| told(&["values", &name], reason))?;
            Ok((name, value))
        };
        let values = values.into_iter().map(value).collect::<Result<_, _>>()?;
        let feature = |(name, value): (String, toml::Value)| match value {
            toml::Value::Boolean(on) => Ok((name, Feature::Flag(on))),
            toml::Value::Integer(value) => Ok((name, Feature::Number(value))),
            toml::Value::Array(_) => {
                let what =
                    "can't be a list; `set_by_engine` lists the features that a game engine sets";
                Err(told(&["features", &name], format!("feature `{name}` {what}")))
            }
            _ => {
                let what = "must be a whole number, `true` or `false`";
                Err(told(&["features", &name], format!("feature `{name}` {what}")))
            }
        };
        let features = features.into_iter().map(feature).collect::<Result<_, _>>()?;
        for known in &matrix {
            let list = [("rows", &known.rows), ("columns", &known.columns)];
            if let Some((name, _)) = list.into_iter().find(|(_, list)| list.is_empty()) {
                let reason =
                    format!("a `[[matrix]]` entry names no {name}, so the entry has no effect");
                return Err(told(&["matrix"], reason));
            }
        }
        for accepted in &hazards {
            if accepted.functions.is_empty() || accepted.reason.trim().is_empty() {
                let reason = "a `[[hazard]]` entry needs functions, and a reason for accepting it";
                return Err(told(&["hazard"], reason.to_owned()));
            }
        }
        let is_folder = matches!(package.origin, Origin::Folder { .. });
        let modules = if is_folder && !join.is_empty() { package.modules()? } else { Vec::new() };
        let is_unknown = |name: &&String| is_folder && !modules.contains(name);
        let named = join.iter().flat_map(|(module, others)| [module].into_iter().chain(others));
        let unknown = { named }.find(is_unknown);
        if let Some(name) = unknown {
            let near = nearest(name, modules.iter().map(String::as_str));
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            let reason = format!(
                "`[join]` names `{name}`, but the package has no module of this name{near}"
            );
            return Err(told(&["join", name], reason));
        }
        let mut declared = BTreeMap::new();
        for (name, value) in &written_inputs {
            let told = |why: String| told(&["inputs", name.get_ref()], why);
            declared.extend(inputs::flat(name.get_ref(), value).map_err(told)?);
        }
        let value = |(name, value): (String, toml::Value)| match &value {
            toml::Value::Boolean(on) => Ok((name, f64::from(u8::from(*on)))),
            toml::Value::Integer(_) | toml::Value::Float(_) => {
                #[expect(clippy::cast_precision_loss, reason = "no override has 54 bits")]
                let whole = || value.as_integer().map(|one| one as f64);
                let number = value.as_float().or_else(whole).filter(|x| x.is_finite());
                let wrong = || {
                    told(
                        &["overrides", &name],
                        "the value of an override must be finite".to_owned(),
                    )
                };
                Ok((name.clone(), number.ok_or_else(wrong)?))
            }
            _ => {
                let reason =
                    format!("the override `{name}` must be a number or a bool, but is {value}");
                Err(told(&["overrides", &name], reason))
            }
        };
        let overrides = overrides.into_iter().map(value).collect::<Result<_, _>>()?;
        let hazards = Hazards { inputs: declared, overrides, accepted: hazards };
        // In a package of one file, the names of rows have no module.
        let own = match &package.origin {
            Origin::File { path, .. } => path.file_stem().map(|stem| stem.to_string_lossy()),
            _ => None,
        };
        let matrix = match own {
            Some(stem) => matrix.into_iter().filter_map(|known| known.of_module(&stem)).collect(),
            None => matrix,
        };
        match preprocess {
            Some(command) if command.is_empty() => Err(told(
                &["preprocess"],
                "`preprocess` is an empty list: name a program".to_owned(),
            )),
            command => {
                let read = Some(FileRead::of(file, text.as_bytes()));
                Ok(Self {
                    read,
                    dependencies,
                    features,
                    set_by_engine,
                    values,
                    preprocess: command.unwrap_or_default(),
                    join,
                    matrix,
                    hazards,
                    mutants,
                    compilers,
                })
            }
        }
    }

    /// The modules that the author's program concatenates with this module (`[join]`).
    pub(super) fn joined(&self, module: &str) -> &[String] {
        self.join.get(module).map_or(&[], |joined| joined)
    }

    pub(super) fn known_rows(self) -> Vec<KnownRows> {
        self.matrix
    }

    pub(super) fn mutants(self) -> Vec<AcceptedMutants> {
        self.mutants
    }

    pub(super) fn hazards(self) -> Hazards {
        self.hazards
    }

    pub(super) fn depended(self, mut package: Package) -> Result<Package, PackageError> {
        let Some(read) = &self.read else { return Ok(package) };
        let folder = read.file.parent().unwrap_or(Path::new(""));
        for (name, Dependency { path, krate, root }) in self.dependencies {
            if package.dependencies.iter().any(|(known, _)| *known == name) {
                continue;
            }
            let found = match (path, krate) {
                (Some(path), _) => {
                    let path = joined(folder, &path);
                    let missing = || PackageError::Manifest {
                        file: shown(&read.file),
                        reason: format!(
                            "there is no folder `{}` (dependency `{name}`)",
                            shown(&path)
                        ),
                    };
                    Package::open(&path).map_err(|_| missing())?
                }
                (None, krate) => Package::of_origin(Origin::Crate {
                    base: folder.to_string_lossy().into_owned().into(),
                    name: krate.unwrap_or_default().into(),
                    root: root.map(Into::into),
                }),
            };
            package.dependencies.push((name, found));
        }
        Ok(package)
    }

    pub(super) fn without_values(self) -> Self {
        Self { values: Values::new(), ..self }
    }

    pub(super) fn stands_for(&self, name: &str) -> bool {
        self.values.contains_key(name)
    }

    /// Checks if modules differ from their files: a program prints them, or values replace names.
    pub(super) fn expands(&self) -> bool {
        !self.preprocess.is_empty() || !self.values.is_empty()
    }

    /// Reads a file's text or the output of `preprocess`, and replaces assertions by code, and placeholders by values.
    /// For the same text, a process runs `preprocess` once, until
    /// [`refresh`](workspace::refresh) forgets the output.
    pub(super) fn expanded(
        &self,
        root: &Path,
        path: &Path,
        source: SourceFile,
    ) -> Result<SourceFile, PackageError> {
        let SourceFile { name, text, values } = asserts::read(self.printed(root, path, source)?)?;
        // A value has no line breaks, so line numbers stay the same. Karat maps columns back.
        let (text, outer) = values::substituted(&text, &self.values);
        Ok(SourceFile { name, text, values: asserts::composed(values, outer) })
    }

    fn printed(
        &self,
        root: &Path,
        path: &Path,
        source: SourceFile,
    ) -> Result<SourceFile, PackageError> {
        let [program, arguments @ ..] = &*self.preprocess else { return Ok(source) };
        let hash = blake3::hash(source.text.as_bytes());
        let key = (path.to_owned(), hash, self.preprocess.clone());
        // The angle brackets mark a text that is in no file.
        let name = format!("<{}, as `{program}` prints it>", source.name);
        if let Some(text) = workspace::get::<Printed>(&key) {
            return Ok(SourceFile::new(name, text));
        }
        let error = |reason: String| {
            let (file, program) = (shown(path), program.clone());
            PackageError::Preprocess { file, program, reason }
        };
        let whole = |path: &Path| path.canonicalize().map_err(|reason| error(reason.to_string()));
        let (root, file) = (whole(root)?, whole(path)?);
        let mut command = Command::new(program);
        command.args(arguments).arg(&file).current_dir(root);
        let text = String::from_utf8(printed(command).map_err(error)?);
        let text = text.map_err(|_| error("the program's output isn't UTF-8".to_owned()))?;
        if text.trim().is_empty() {
            return Err(error("the program prints nothing".to_owned()));
        }
        workspace::keep::<Printed>(key, text.clone());
        Ok(SourceFile::new(name, text))
    }
}

/// The program's output, or the reason why the program failed, printed too much or didn't end.
fn printed(mut command: Command) -> Result<Vec<u8>, String> {
    let deadline = settings::current().map_err(|error| error.to_string())?.deadline;
    let shown = format!("{command:?}");
    let Output { status, stdout: out, stderr: err } =
        lines::output(&mut command, deadline, MOST_BYTES).map_err(|broken| match broken {
            Broken::Start(reason) => format!("the program can't be started: {reason} ({shown})"),
            _ => {
                let seconds = deadline.as_secs_f64();
                format!("the program didn't end within {seconds} s (KARAT_TIMEOUT): {shown}")
            }
        })?;
    if out.len() as u64 > MOST_BYTES {
        return Err(format!("the program prints more than {} MiB: {shown}", MOST_BYTES >> 20));
    }
    if !status.success() {
        let said = String::from_utf8_lossy(&err);
        return Err(format!("{status}: {shown}\n{}", said.trim_end()).trim_end().to_owned());
    }
    Ok(out)
}
