//! Finds the declarations that a linked text needs, and chooses their names.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::sync::Arc;

use blake3::{Hash, Hasher};

use super::PackageError;
use super::conditions::feature_of;
use super::discard::{Discards, discards, wrapper};
use super::imports::{self, Import, Target};
use super::library::{Library, ModulePath};
use super::linked::{EntryPoint, Item, KERNEL_PREFIX, KERNEL_WORDS, Linked, Unmet, author_path};
use super::plain::plain;
use super::splice::{Edit, Spliced};
use super::stage::Stage;
use super::syntax::{DeclarationKind, Module};
use crate::diagnostic::{Diagnostic, Span};

struct Part {
    module: Arc<Module>,
    imports: Vec<Import>,
}

/// The references in a module. The key is the range of the reference's tokens. The value is the declaration to which
/// the reference refers: its module and its name.
type Uses = BTreeMap<(usize, usize), (ModulePath, String)>;

pub(super) struct Linker<'a> {
    library: &'a Library,
    root: ModulePath,
    parts: BTreeMap<ModulePath, Part>,
    uses: BTreeMap<ModulePath, Uses>,
    /// The declarations to which each declaration refers. The keys are only the declarations that the linker has
    /// resolved so far.
    resolved: BTreeMap<Item, Vec<Item>>,
    /// WGSL's own names, such as `max`, that linked declarations and kernels use. No linked declaration may have such
    /// a name.
    pub(super) free: BTreeSet<String>,
    /// The modules that `root` includes. These modules share a namespace with `root`.
    included: Vec<ModulePath>,
    /// For each module other than `root`, the modules that share a namespace with this module.
    spaces: BTreeMap<ModulePath, Vec<ModulePath>>,
}

impl<'a> Linker<'a> {
    pub(super) fn new(library: &'a Library, root: &ModulePath) -> Result<Self, PackageError> {
        let free = KERNEL_WORDS.iter().map(|word| (*word).to_owned()).collect();
        let (parts, uses, resolved, spaces) = Default::default();
        let included = library.included(root)?;
        let root = root.clone();
        let mut linker = Self { library, root, parts, uses, resolved, free, included, spaces };
        linker.add(&linker.root.clone())?;
        for path in linker.included.clone() {
            linker.add(&path)?;
        }
        let root = Some(&linker.root).filter(|_| !linker.included.is_empty());
        linker.expect_one_of_each_name(linker.included.iter().chain(root))?;
        Ok(linker)
    }

    pub(super) fn library(&self) -> &'a Library {
        self.library
    }

    pub(super) fn root(&self) -> &ModulePath {
        &self.root
    }

    /// Makes another module of the same package the `root`, to compute fingerprints of that module's declarations.
    /// The new `root` must not include other modules. Resolved references stay valid.
    pub(super) fn turn_to(&mut self, root: &ModulePath) -> Result<(), PackageError> {
        self.root = root.clone();
        self.add(root)
    }

    /// Fails if a file and the files that it includes declare a name twice. The program that loads the shader
    /// reports this error, too.
    fn expect_one_of_each_name<'p>(
        &self,
        space: impl Iterator<Item = &'p ModulePath>,
    ) -> Result<(), PackageError> {
        let mut known: BTreeMap<&str, Span> = BTreeMap::new();
        for path in space {
            let module = &self.parts[path].module;
            for declaration in &module.declarations {
                let Some(name) = &declaration.name else { continue };
                let span = module.span(declaration.name_token);
                if let Some(first) = known.insert(name, span.clone()).filter(|first| *first != span)
                {
                    let message = format!(
                        "`{name}` is declared in two files that are included or joined together"
                    );
                    let diagnostic =
                        Diagnostic::new(message).at(span, "").at(first, "declared first");
                    return Err(PackageError::Shader(Box::new(diagnostic)));
                }
            }
        }
        Ok(())
    }

    fn add(&mut self, path: &ModulePath) -> Result<(), PackageError> {
        if !self.parts.contains_key(path) {
            let module = self.library.module(path)?;
            let imports = imports::imports(&module)?;
            self.parts.insert(path.clone(), Part { module, imports });
        }
        Ok(())
    }

    pub(super) fn reach(&mut self, wanted: Vec<Item>) -> Result<BTreeSet<Item>, PackageError> {
        let mut items: BTreeSet<Item> = wanted.iter().cloned().collect();
        let mut queue: VecDeque<Item> = wanted.into();
        // Modules with at least one linked declaration.
        let mut used = BTreeSet::new();
        while let Some((path, index)) = queue.pop_front() {
            let mut reached = self.resolve(&path, index)?;
            if used.insert(path.clone()) {
                reached.extend(self.assertions(&path));
            }
            for found in reached {
                if items.insert(found.clone()) {
                    queue.push_back(found);
                }
            }
        }
        Ok(items)
    }

    /// Hashes a declaration's text, and the paths (but not the texts) of the declarations to which it refers.
    pub(super) fn describe(&self, (path, index): &Item, hasher: &mut Hasher) {
        let module = &self.parts[path].module;
        let declaration = &module.declarations[*index];
        let from = module.bytes(&declaration.tokens);
        let mut text = Spliced::default();
        text.copy(&module.file, from.clone(), in_order(module.changes(&from).collect()));
        // `const_assert` has no name.
        let name = declaration.name.as_deref().unwrap_or_default();
        let part = |hasher: &mut Hasher, part: &str| {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        };
        part(hasher, &author_path(&self.library.route(path.package), path, name));
        part(hasher, &plain(text.text()));
        // The targets of the declaration's names, in order.
        let tokens = (declaration.tokens.start, 0)..(declaration.tokens.end, 0);
        for (owner, name) in self
            .uses
            .get(path)
            .into_iter()
            .flat_map(|uses| uses.range(tokens.clone()))
            .map(|(_, to)| to)
        {
            part(hasher, &author_path(&self.library.route(owner.package), owner, name));
        }
    }

    /// A hash of the directives of a module; `None` if it has no directives.
    pub(super) fn directives(&self, path: &ModulePath) -> Option<Hash> {
        let module = &self.parts[path].module;
        let mut hasher = Hasher::new();
        for token in module.directives.iter().flat_map(Clone::clone) {
            hasher.update(module.text(token).as_bytes()).update(b" ");
        }
        (!module.directives.is_empty()).then(|| hasher.finalize())
    }

    /// The declarations to which a declaration refers, and the `const_assert`s of its module.
    pub(super) fn needs(&mut self, (path, index): &Item) -> Result<Vec<Item>, PackageError> {
        self.add(path)?;
        let mut needs = self.resolve(path, *index)?;
        needs.extend(self.assertions(path));
        Ok(needs)
    }

    /// A module's `const_assert`s. They must be true if Karat links any part of the module.
    fn assertions(&self, path: &ModulePath) -> impl Iterator<Item = Item> + use<'_, 'a> {
        let declarations = self.parts[path].module.declarations.iter().enumerate();
        let assertions = declarations.filter(|(_, d)| d.kind == DeclarationKind::Assertion);
        let path = path.clone();
        assertions.map(move |(index, _)| (path.clone(), index))
    }

    /// Links the wanted declarations of `root` and everything that they need. With `whole`, copies the whole text of
    /// `root`. The entry point `called` becomes an ordinary function. `discards` decides what an invocation does at
    /// a `discard`.
    pub(super) fn link(
        mut self,
        wanted: Vec<Item>,
        whole: bool,
        called: Option<(&str, Discards)>,
    ) -> Result<Linked, PackageError> {
        let (called, how) = called.unzip();
        let items = self.reach(wanted)?;
        let names = self.names(&items);
        let Module { file, declarations, directives, .. } = &*self.parts[&self.root].module;
        let mut own = declarations.iter().enumerate().filter(|(_, declaration)| !declaration.test);
        // Outside of declarations, only a misplaced directive or a null character can be invalid.
        let plain = directives.is_empty() && !file.text.contains('\0');
        let mut linked = Linked {
            spliced: Spliced::default(),
            names: BTreeMap::new(),
            file: Arc::clone(file),
            whole: plain && own.all(|(index, _)| items.contains(&(self.root.clone(), index))),
            called: None,
            discards: None,
            calls: self.parts.values().flat_map(|part| part.module.calls.iter().cloned()).collect(),
            inactive: self.parts.values().flat_map(|part| inactive(&part.module)).collect(),
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
            let from = 0..linked.file.text.len();
            edits.extend(part.module.changes(&from));
            // Test runners link tests themselves, so the linker removes tests from a whole module.
            for test in part.module.declarations.iter().filter(|declaration| declaration.test) {
                let bytes = part.module.bytes(&test.tokens);
                edits.retain(|edit| !bytes.contains(&edit.from.start));
                edits.push(Edit { from: bytes, name: None });
            }
            spliced.copy(&linked.file, from, in_order(edits));
        }
        let (own, others): (Vec<&Item>, Vec<&Item>) =
            items.iter().partition(|(path, _)| *path == self.root);
        let own = own.into_iter().filter(|_| !whole);
        // naga reports a `discard` in another stage.
        let root = &self.parts[&self.root].module;
        let stage = |called| root.declarations[root.declared(called).next()?].entry_point;
        let pixels =
            called.is_some_and(|called| stage(called).is_none_or(|stage| stage == Stage::Fragment));
        let mut may_discard = false;
        for (path, index) in own.chain(others) {
            let module = &self.parts[path].module;
            let declaration = &module.declarations[*index];
            let tokens = declaration.tokens.clone();
            let from = module.bytes(&tokens);
            let mut edits = self.edits(path, tokens.clone(), &names);
            edits.extend(module.changes(&from));
            if pixels {
                let own = discards(module, tokens);
                may_discard |= !own.is_empty();
                edits.extend(own.into_iter().filter(|_| how == Some(Discards::Assigned)));
            }
            if let Some(stage) = declaration.entry_point.filter(|stage| *stage != Stage::Other)
                && *path == self.root
                && called.is_some_and(|called| declaration.name.as_deref() == Some(called))
            {
                let (attributes, builtins) = module.as_function(declaration);
                edits.extend(attributes);
                linked.called = Some(EntryPoint { stage, builtins });
                linked.whole = false;
            }
            spliced.copy(&module.file, from, in_order(edits));
        }
        for (path, index) in &items {
            let Some(item) = &self.parts[path].module.declarations[*index].name else { continue };
            let author = author_path(&self.library.route(path.package), path, item);
            let name = names.get(&(path.clone(), item.clone())).unwrap_or(item);
            linked.names.insert(name.clone(), author);
        }
        linked.spliced.check().map_err(PackageError::Shader)?;
        if let Some((called, how)) = called.zip(how).filter(|_| may_discard) {
            let key = (self.root.clone(), called.to_owned());
            let function = names.get(&key).map_or(called, String::as_str).to_owned();
            linked.whole = false;
            let (wrapper, text) = wrapper(linked.text(), &function, how).expect("it is linked");
            linked.spliced.append(&text);
            linked.discards = Some((function, wrapper));
        }
        Ok(linked)
    }

    /// Finds the declarations to which a declaration refers.
    fn resolve(&mut self, path: &ModulePath, index: usize) -> Result<Vec<Item>, PackageError> {
        let item = (path.clone(), index);
        if let Some(known) = self.resolved.get(&item) {
            return Ok(known.clone());
        }
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
            } else if let Some(owner) = self.shared(path, words[0])? {
                Target::Item(owner, words[0].to_owned())
            } else {
                if *path != self.root {
                    self.free.insert(words[0].to_owned());
                }
                continue;
            };
            // naga reports a module's name without an item.
            let Target::Item(owner, name) = target else { continue };
            self.add(&owner)?;
            let declared = self.parts[&owner].module.declared(&name);
            found.extend(declared.map(|index| (owner.clone(), index)));
            let tokens = (reference.tokens.start, reference.tokens.end);
            self.uses.entry(path.clone()).or_default().insert(tokens, (owner, name));
        }
        self.resolved.insert(item, found.clone());
        Ok(found)
    }

    fn shared(
        &mut self,
        from: &ModulePath,
        name: &str,
    ) -> Result<Option<ModulePath>, PackageError> {
        let is_roots = *from == self.root || self.included.contains(from);
        let is_known = is_roots || self.spaces.contains_key(from);
        if !is_known && !self.parts[from].module.includes.is_empty() {
            // In other modules than the root, the error about a missing file appears at the first unknown name.
            let mut space = self.library.included(from).unwrap_or_default();
            space.push(from.clone());
            for path in &space {
                self.add(path)?;
                self.spaces.entry(path.clone()).or_insert_with(|| space.clone());
            }
            self.expect_one_of_each_name(space.iter())?;
        }
        let others: &[ModulePath] = match is_roots {
            true => &self.included,
            false => self.spaces.get(from).map_or(&[], |space| space),
        };
        let mut space = others.iter().chain(Some(&self.root).filter(|_| is_roots));
        let declares =
            |path: &&ModulePath| self.parts[*path].module.declared(name).next().is_some();
        Ok(space.find(declares).cloned())
    }

    /// Chooses new names for the declarations outside of the module `root`. A declaration of `root` also gets a new
    /// name if other linked text uses the old name with another meaning, for example as a builtin of WGSL.
    fn names(&self, items: &BTreeSet<Item>) -> BTreeMap<(ModulePath, String), String> {
        // A new name occurs in no file, so it can't clash with another name.
        let is_taken = |name: &str| {
            let mut parts = self.parts.values();
            self.free.contains(name) || parts.any(|part| part.module.words.contains(name))
        };
        let captured = self.captured(items);
        let mut given: BTreeSet<String> = BTreeSet::new();
        let mut names = BTreeMap::new();
        for one @ (path, index) in items {
            let Some(item) = &self.parts[path].module.declarations[*index].name else { continue };
            let key = (path.clone(), item.clone());
            let is_own = *path == self.root && !captured.contains(&key);
            let keeps = (is_own || self.is_of_host(one, item, items))
                && !self.free.contains(item)
                && !item.starts_with(KERNEL_PREFIX);
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
            let is_part = |c: char| c.is_alphanumeric() || c == '_';
            let base = parts.join("_").replace(|c| !is_part(c), "_"); // of `line.inc.wgsl`
            let mut name = base.clone();
            let mut count = 2;
            while is_taken(&name) || given.contains(&name) {
                name = format!("{base}_{count}");
                count += 1;
            }
            given.insert(name.clone());
            names.insert(key, name);
        }
        names
    }

    /// Checks if the declaration is an override that can keep its name, so that the author's program can set the
    /// override by name. Returns `false` if the name has another meaning anywhere in the linked text, for example as
    /// a local variable.
    fn is_of_host(&self, one: &Item, item: &str, items: &BTreeSet<Item>) -> bool {
        let (path, index) = one;
        let module = &self.parts[path].module;
        let before = module.declarations[*index].name_token.checked_sub(1);
        before.is_some_and(|at| module.text(at) == "override")
            && items.iter().all(|owner| !self.has_another(owner, one, item))
    }

    /// Checks if the first declaration's text uses the second declaration's name for another thing, such as a
    /// parameter.
    fn has_another(&self, (owner, index): &Item, (path, of): &Item, item: &str) -> bool {
        let name_token = self.parts[path].module.declarations[*of].name_token;
        let means_it = |token: usize| {
            let uses = self.uses.get(owner).and_then(|uses| uses.get(&(token, token + 1)));
            owner == path && token == name_token
                || uses.is_some_and(|(to, name)| to == path && name == item)
        };
        let module = &self.parts[owner].module;
        let mut tokens = module.declarations[*index].tokens.clone();
        tokens.any(|token| module.text(token) == item && !means_it(token))
    }

    /// The declarations that need a new name because of another declaration's names. For example, a function refers
    /// to `math::x`, and has a parameter `x`. If `math::x` became `x`, the reference would mean the parameter.
    fn captured(&self, items: &BTreeSet<Item>) -> BTreeSet<(ModulePath, String)> {
        let mut captured = BTreeSet::new();
        for owner @ (path, index) in items {
            let module = &self.parts[path].module;
            let Range { start, end } = module.declarations[*index].tokens;
            let uses = self.uses.get(path).into_iter();
            for ((from, to), target) in uses.flat_map(|uses| uses.range((start, 0)..(end, 0))) {
                if to - from == 1 && module.text(*from) == target.1 {
                    continue;
                }
                let mut declared = self.parts[&target.0].module.declared(&target.1);
                if declared
                    .any(|index| self.has_another(owner, &(target.0.clone(), index), &target.1))
                {
                    captured.insert(target.clone());
                }
            }
        }
        captured
    }

    /// The edits that replace names in a range of a module's tokens.
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

    /// Copies each directive of the linked modules once, before all declarations. With `whole`, the directives of
    /// `root` stay at their position.
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
                    let edits = module.changes(&from).collect();
                    spliced.copy(&module.file, from.clone(), edits);
                }
            }
        }
    }
}

/// Sorts edits by their positions, and drops edits inside of a blanked range.
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

fn inactive(module: &Module) -> impl Iterator<Item = (String, Unmet)> + '_ {
    module.inactive.iter().map(|one| {
        let (condition, feature) = (one.condition.clone(), feature_of(&one.condition));
        (one.name.clone(), Unmet { condition, feature })
    })
}
