//! From modules with imports to one WGSL text.
//!
//! Linking decides which declarations there are, and which names must be others. Their text is
//! copied from the author's files by [`Spliced`].

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::sync::Arc;

use super::imports::{self, Import, Target};
use super::library::{Library, ModulePath, Sources};
use super::splice::{Edit, Spliced};
use super::syntax::{DeclarationKind, Module, asks_for_nothing, deepest};
use super::{Package, PackageError};
use crate::diagnostic::{SourceFile, Span, nearest};

/// WGSL's names that generated kernels use. A shader under test may declare them, too, and gets
/// other names for its own then.
pub(crate) const KERNEL_WORDS: &[&str] = &[
    "array",
    "bitcast",
    "bool",
    "f16",
    "f32",
    "global_invocation_id",
    "i32",
    "mat2x2",
    "mat2x3",
    "mat2x4",
    "mat3x2",
    "mat3x3",
    "mat3x4",
    "mat4x2",
    "mat4x3",
    "mat4x4",
    "private",
    "read",
    "read_write",
    "select",
    "storage",
    "u32",
    "uniform",
    "vec2",
    "vec3",
    "vec4",
];

/// How the names of generated kernels begin.
pub(crate) const KERNEL_PREFIX: &str = "karat_";

/// WGSL without imports, and the way back to the author's files.
#[derive(Clone, Debug)]
pub(crate) struct Linked {
    /// Plain WGSL.
    pub(crate) spliced: Spliced,
    /// Author's path of each declaration, `fresnel::schlick`, by its name in the text.
    pub(crate) names: BTreeMap<String, String>,
    /// The file that holds what was linked.
    pub(crate) file: Arc<SourceFile>,
    /// What it was made of.
    pub(crate) sources: Sources,
}

impl Linked {
    pub(crate) fn text(&self) -> &str {
        self.spliced.text()
    }

    /// Where the text nests so deep, or has so long an expression, that compilers, which recurse over
    /// both, would need more stack than they are given.
    pub(crate) fn too_deep(&self) -> Option<Span> {
        let place = deepest(self.text())?;
        let none = || Span { file: Arc::clone(&self.file), range: 0..0 };
        Some(self.spliced.resolve(place).unwrap_or_else(none))
    }

    /// The name in the text of a declaration with this author's path.
    pub(crate) fn name_of(&self, path: &str) -> Option<&str> {
        self.names.iter().find(|(_, known)| *known == path).map(|(name, _)| name.as_str())
    }
}

/// A declaration: its module, and its index in there.
type Item = (ModulePath, usize);

impl Package {
    /// Links the closure of one declaration: what it needs from any module, and nothing else.
    pub(crate) fn link(&self, path: &str) -> Result<Linked, PackageError> {
        let (module, item) = path.rsplit_once("::").unwrap_or(("", path));
        self.link_items(module, &[item])
    }

    /// Links the closure of several declarations of one module.
    pub(crate) fn link_items(&self, module: &str, items: &[&str]) -> Result<Linked, PackageError> {
        let root = ModulePath::root(module);
        let library = Library::open(self)?;
        let file = library.read(&root).map_err(|error| match error {
            PackageError::UnknownModule { .. } if items.len() == 1 => {
                self.unknown_function(module, items[0])
            }
            other => other,
        })?;
        let parsed = match library.module(&root) {
            Ok(parsed) => parsed,
            Err(_) if asks_for_nothing(&file.text) => return Ok(verbatim(&library, &root, &file)),
            Err(error) => return Err(error),
        };
        let mut wanted = Vec::new();
        for item in items {
            let before = wanted.len();
            wanted.extend(parsed.declared(item).map(|index| (root.clone(), index)));
            // An entry point that isn't there is reported with its stage.
            if wanted.len() == before && items.len() == 1 {
                return Err(self.unknown_function(module, item));
            }
        }
        imports::check(&library, &root)?;
        Linker::new(&library, &root)?.link(wanted, false)
    }

    /// Links a whole module with what it needs of others. A module that imports nothing and has no
    /// conditions is its file, byte for byte, well formed or not.
    pub(crate) fn link_module(&self, module: &str) -> Result<Linked, PackageError> {
        let root = ModulePath::root(module);
        let library = Library::open(self)?;
        let file = library.read(&root)?;
        if asks_for_nothing(&file.text) {
            return Ok(verbatim(&library, &root, &file));
        }
        let parsed = library.module(&root)?;
        imports::check(&library, &root)?;
        let all = (0..parsed.declarations.len()).map(|index| (root.clone(), index)).collect();
        Linker::new(&library, &root)?.link(all, true)
    }

    /// [`link_module`](Self::link_module) with another name for everything that the module declares:
    /// the hardest test of which names mean what.
    #[cfg(test)]
    pub(crate) fn link_renamed(&self, module: &str) -> Result<Linked, PackageError> {
        let root = ModulePath::root(module);
        let library = Library::open(self)?;
        let parsed = library.module(&root)?;
        let all = (0..parsed.declarations.len()).map(|index| (root.clone(), index)).collect();
        let mut linker = Linker::new(&library, &root)?;
        linker.free.extend(parsed.names().map(str::to_owned));
        linker.link(all, true)
    }

    /// Says that there is no such function, and what may be meant. Modules that can't be read hide
    /// no others.
    fn unknown_function(&self, module: &str, item: &str) -> PackageError {
        let path = author_path("", &ModulePath::root(module), item);
        let mut known = Vec::new();
        let mut condition = None;
        if let (Ok(modules), Ok(library)) = (self.modules(), Library::open(self)) {
            for name in modules {
                let Ok(parsed) = library.module(&ModulePath::root(&name)) else { continue };
                known.extend(self.functions_of(&name, &parsed).into_iter().map(|item| item.name));
                if name == module {
                    let inactive = parsed.inactive.iter().find(|inactive| inactive.name == item);
                    condition = inactive.map(|inactive| inactive.condition.clone());
                }
            }
        }
        if let Some(condition) = condition {
            return PackageError::Inactive { path, package: self.name(), condition };
        }
        PackageError::UnknownFunction {
            nearest: nearest(&path, known.iter().map(String::as_str)).map(str::to_owned),
            path,
            package: self.name(),
            count: known.len(),
        }
    }
}

/// A file as it is. Its functions are known by the names that they have.
fn verbatim(library: &Library<'_>, root: &ModulePath, file: &Arc<SourceFile>) -> Linked {
    let mut spliced = Spliced::default();
    spliced.copy(file, 0..file.text.len(), Vec::new());
    let mut names = BTreeMap::new();
    if let Ok(parsed) = Module::parse(file, &BTreeMap::new()) {
        names.extend(parsed.names().map(|name| (name.to_owned(), author_path("", root, name))));
    }
    Linked { spliced, names, file: Arc::clone(file), sources: library.sources(root, file) }
}

/// `fresnel::schlick` for an item of this package, `noise::value::perlin` for a dependency's.
fn author_path(route: &str, module: &ModulePath, item: &str) -> String {
    let route = (!route.is_empty()).then(|| route.to_owned());
    let parts: Vec<String> = route
        .into_iter()
        .chain(module.components.iter().cloned())
        .chain([item.to_owned()])
        .collect();
    parts.join("::")
}

/// A module of one link.
struct Part {
    module: Arc<Module>,
    imports: Vec<Import>,
}

/// What the tokens of a reference mean: a declaration of a module.
type Uses = BTreeMap<(usize, usize), (ModulePath, String)>;

struct Linker<'a> {
    library: &'a Library<'a>,
    root: ModulePath,
    parts: BTreeMap<ModulePath, Part>,
    /// References that lead to declarations, by module and tokens.
    uses: BTreeMap<ModulePath, Uses>,
    /// Names of WGSL itself that linked declarations use, but for those of the root.
    free: BTreeSet<String>,
}

impl<'a> Linker<'a> {
    fn new(library: &'a Library<'a>, root: &ModulePath) -> Result<Self, PackageError> {
        let free = KERNEL_WORDS.iter().map(|word| (*word).to_owned()).collect();
        let (parts, uses) = (BTreeMap::new(), BTreeMap::new());
        let mut linker = Self { library, root: root.clone(), parts, uses, free };
        linker.add(root)?;
        Ok(linker)
    }

    fn add(&mut self, path: &ModulePath) -> Result<(), PackageError> {
        if !self.parts.contains_key(path) {
            let module = self.library.module(path)?;
            let imports = imports::imports(&module)?;
            self.parts.insert(path.clone(), Part { module, imports });
        }
        Ok(())
    }

    /// Links what is wanted and what that needs; `whole` is the root with all that it holds.
    fn link(mut self, wanted: Vec<Item>, whole: bool) -> Result<Linked, PackageError> {
        let mut items: BTreeSet<Item> = wanted.iter().cloned().collect();
        let mut queue: VecDeque<Item> = wanted.into();
        // Modules of which something is linked: what they assert must hold.
        let mut used = BTreeSet::new();
        while let Some((path, index)) = queue.pop_front() {
            let mut reached = self.resolve(&path, index)?;
            if used.insert(path.clone()) {
                let declarations = self.parts[&path].module.declarations.iter().enumerate();
                let assertions = declarations.filter(|(_, d)| d.kind == DeclarationKind::Assertion);
                reached.extend(assertions.map(|(index, _)| (path.clone(), index)));
            }
            for found in reached {
                if items.insert(found.clone()) {
                    queue.push_back(found);
                }
            }
        }
        let names = self.names(&items);
        let file = &self.parts[&self.root].module.file;
        let mut linked = Linked {
            spliced: Spliced::default(),
            names: BTreeMap::new(),
            file: Arc::clone(file),
            sources: self.library.sources(&self.root, file),
        };
        self.copy_directives(&items, whole, &mut linked.spliced);
        let spliced = &mut linked.spliced;
        if whole {
            let part = &self.parts[&self.root];
            let all = 0..part.module.tokens.len();
            let mut edits = self.edits(&self.root, all, &names);
            for import in &part.module.imports {
                edits.push(Edit { from: part.module.bytes(import), name: None });
            }
            edits.extend(
                part.module.removed.iter().map(|from| Edit { from: from.clone(), name: None }),
            );
            spliced.copy(&linked.file, 0..linked.file.text.len(), in_order(edits));
        }
        let (own, others): (Vec<&Item>, Vec<&Item>) =
            items.iter().partition(|(path, _)| *path == self.root);
        let own = own.into_iter().filter(|_| !whole);
        for (path, index) in own.chain(others) {
            let module = &self.parts[path].module;
            let tokens = module.declarations[*index].tokens.clone();
            let from = module.bytes(&tokens);
            let mut edits = self.edits(path, tokens, &names);
            let removed = module.removed.iter();
            let removed =
                removed.filter(|range| from.start <= range.start && range.end <= from.end);
            edits.extend(removed.map(|from| Edit { from: from.clone(), name: None }));
            spliced.copy(&module.file, from, in_order(edits));
        }
        for (path, index) in &items {
            let Some(item) = &self.parts[path].module.declarations[*index].name else { continue };
            let author = author_path(&self.library.route(path.package), path, item);
            let name = names.get(&(path.clone(), item.clone())).unwrap_or(item);
            linked.names.insert(name.clone(), author);
        }
        linked.spliced.check().map_err(PackageError::Shader)?;
        Ok(linked)
    }

    /// The declarations that one refers to.
    fn resolve(&mut self, path: &ModulePath, index: usize) -> Result<Vec<Item>, PackageError> {
        let module = Arc::clone(&self.parts[path].module);
        let mut found = Vec::new();
        for reference in &module.references[index] {
            let words = reference.words(&module);
            let imports = &self.parts[path].imports;
            let target = if words.len() > 1 {
                imports::resolve_path(
                    self.library,
                    path,
                    &module,
                    imports,
                    &words,
                    &reference.tokens,
                )?
            } else if module.declared(words[0]).next().is_some() {
                Target::Item(path.clone(), words[0].to_owned())
            } else if let Some(import) = imports.iter().find(|i| i.alias == words[0]) {
                imports::follow(self.library, path, &module, import)?
            } else {
                if *path != self.root {
                    self.free.insert(words[0].to_owned());
                }
                continue;
            };
            // A module's name alone means nothing: naga says so where it stands.
            let Target::Item(owner, name) = target else { continue };
            self.add(&owner)?;
            let declared = self.parts[&owner].module.declared(&name);
            found.extend(declared.map(|index| (owner.clone(), index)));
            let tokens = (reference.tokens.start, reference.tokens.end);
            self.uses.entry(path.clone()).or_default().insert(tokens, (owner, name));
        }
        Ok(found)
    }

    /// New names: of all that isn't the root's, and of what the root declares where others mean
    /// WGSL's own.
    fn names(&self, items: &BTreeSet<Item>) -> BTreeMap<(ModulePath, String), String> {
        // A new name is no word of any file, so that it can't be taken for another.
        let mut taken: BTreeSet<&str> = self.free.iter().map(String::as_str).collect();
        for part in self.parts.values() {
            let words = (0..part.module.tokens.len()).filter(|token| part.module.is_word(*token));
            taken.extend(words.map(|token| part.module.text(token)));
        }
        let mut given: BTreeSet<String> = BTreeSet::new();
        let mut names = BTreeMap::new();
        for (path, index) in items {
            let Some(item) = &self.parts[path].module.declarations[*index].name else { continue };
            let keeps =
                *path == self.root && !self.free.contains(item) && !item.starts_with(KERNEL_PREFIX);
            let key = (path.clone(), item.clone());
            if keeps || names.contains_key(&key) {
                continue;
            }
            let route = self.library.route(path.package).replace('/', "_");
            let first = if route.is_empty() { "package" } else { &route };
            let parts: Vec<&str> = [first]
                .into_iter()
                .chain(path.components.iter().map(String::as_str))
                .chain([item.as_str()])
                .collect();
            let base = parts.join("_");
            let mut name = base.clone();
            let mut count = 2;
            while taken.contains(name.as_str()) || given.contains(&name) {
                name = format!("{base}_{count}");
                count += 1;
            }
            given.insert(name.clone());
            names.insert(key, name);
        }
        names
    }

    /// The edits of names among some tokens of a module.
    fn edits(
        &self,
        path: &ModulePath,
        tokens: Range<usize>,
        names: &BTreeMap<(ModulePath, String), String>,
    ) -> Vec<Edit> {
        let module = &self.parts[path].module;
        let place = |token: usize| module.tokens[token].range();
        let mut edits = Vec::new();
        let declarations = &module.declarations;
        let first = declarations.partition_point(|d| d.tokens.end <= tokens.start);
        let inside = declarations[first..].iter().take_while(|d| d.tokens.start < tokens.end);
        for declaration in inside {
            let Some(name) = &declaration.name else { continue };
            if let Some(new) = names.get(&(path.clone(), name.clone())) {
                let from = place(declaration.name_token);
                edits.push(Edit { from, name: Some(new.clone()) });
            }
        }
        let Some(uses) = self.uses.get(path) else { return edits };
        for ((start, end), target) in uses.range((tokens.start, 0)..(tokens.end, 0)) {
            let new = names.get(target);
            let name = new.unwrap_or(&target.1);
            if end - start > 1 || new.is_some() || module.text(*start) != name {
                edits.push(Edit { from: place(*start), name: Some(name.clone()) });
                edits.extend((start + 1..*end).map(|t| Edit { from: place(t), name: None }));
            }
        }
        edits
    }

    /// Copies directives to where they must stand, before all declarations: of all modules that
    /// something is linked of, the same ones once. Those of a whole root are where they belong.
    fn copy_directives(&self, items: &BTreeSet<Item>, whole: bool, spliced: &mut Spliced) {
        let mut linked: BTreeSet<&ModulePath> = items.iter().map(|(path, _)| path).collect();
        linked.insert(&self.root);
        let mut seen = BTreeSet::new();
        for path in linked {
            let module = &self.parts[path].module;
            for directive in &module.directives {
                let words: Vec<_> = directive.clone().map(|token| module.text(token)).collect();
                let new = seen.insert(words.join(" "));
                if new && !(whole && *path == self.root) {
                    let from = module.bytes(directive);
                    let removed = module.removed.iter();
                    let removed = removed.filter(|r| from.start <= r.start && r.end <= from.end);
                    let edits = removed.map(|from| Edit { from: from.clone(), name: None });
                    spliced.copy(&module.file, from.clone(), edits.collect());
                }
            }
        }
    }
}

/// Edits by their places. What is blanked with what is around it needs no edit of its own.
fn in_order(mut edits: Vec<Edit>) -> Vec<Edit> {
    edits.sort_by_key(|edit| (edit.from.start, std::cmp::Reverse(edit.from.end)));
    let mut kept: Vec<Edit> = Vec::with_capacity(edits.len());
    for edit in edits {
        let inside = |last: &Edit| last.name.is_none() && edit.from.end <= last.from.end;
        if !kept.last().is_some_and(inside) {
            kept.push(edit);
        }
    }
    kept
}
