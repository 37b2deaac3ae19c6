//! Tests that dependencies between modules go in one direction, and that only some modules name the large crates.
//!
//! The tests parse the sources, so they find each path in code, and ignore comments and strings.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};

/// A row of the table of modules in ARCHITECTURE.md.
struct Row {
    module: String,
    /// The large crates that this module may name: see [`LARGE`].
    crates: Vec<String>,
}

/// The rows of the table of modules in ARCHITECTURE.md. A module uses only the modules above it in the table.
fn order() -> Vec<Row> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../ARCHITECTURE.md");
    let page = std::fs::read_to_string(page).expect("it is beside the library");
    let table = page.split_once("## Modules of the library").expect("it has that chapter").1;
    let table = table.split_once("\n## ").expect("another one follows").0;
    let row = |line: &str| {
        let mut cells = line.strip_prefix("| `")?.split('|').map(str::trim);
        let module = cells.next()?.trim_end_matches('`').to_owned();
        let crates = cells.nth(1)?.split(", ").filter(|name| !name.is_empty());
        let crates = crates.map(|name| name.replace('-', "_")).collect();
        Some(Row { module, crates })
    };
    let rows: Vec<Row> = table.lines().filter_map(row).collect();
    assert!(rows.len() > 20, "the table has a row for each module");
    rows
}

/// The large crates. Only the modules that ARCHITECTURE.md lists for such a crate may name the crate.
const LARGE: [&str; 11] = [
    "wgpu",
    "naga",
    "karat_engine",
    "karat_foreign",
    "karat_translate",
    "exr",
    "png",
    "flip_rs",
    "codespan_reporting",
    "statrs",
    "anstream",
];

/// The number of modules of the crate `karat-core`, which come first in the table of ARCHITECTURE.md.
const CORE: usize = 13;

/// The number of modules of the crate `karat-inspect`, which come last in the table of ARCHITECTURE.md.
const INSPECT: usize = 8;

/// The largest number of direct dependencies that the library may have. A user's tests compile all of them.
const MOST_DEPENDENCIES: usize = 26;

/// The largest number of names at the library's root, without modules and macros. A new user reads these names first.
const MOST_NAMES: usize = 36;

/// The names in a module's code: modules of the library, and crates.
#[derive(Debug, Default)]
struct Names {
    modules: BTreeSet<String>,
    /// The first word of each path, such as `naga` in `naga::Module`, except `crate`, `self` and `super`.
    crates: BTreeSet<String>,
    /// The number of `super`s that lead from the code to the root of the library, as in `super::super::golden`.
    depth: usize,
}

impl Names {
    /// Records a path in the code.
    fn path(&mut self, parts: &[String]) {
        let supers = parts.iter().take_while(|part| *part == "super").count();
        let rest = &parts[supers..];
        match (parts.first().map(String::as_str), rest.first()) {
            (Some("crate"), _) => self.modules.extend(parts.get(1).cloned()),
            (Some("super"), Some(module)) if supers >= self.depth => {
                self.modules.insert(module.clone());
            }
            (Some("super" | "self") | None, _) => {}
            (Some(first), _) => {
                self.crates.insert(first.to_owned());
            }
        }
    }

    fn tree(&mut self, before: &[String], tree: &syn::UseTree) {
        let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
        match tree {
            syn::UseTree::Path(path) => self.tree(&with(&path.ident), &path.tree),
            syn::UseTree::Name(name) => self.path(&with(&name.ident)),
            syn::UseTree::Rename(rename) => self.path(&with(&rename.ident)),
            syn::UseTree::Glob(_) => self.path(before),
            syn::UseTree::Group(group) => {
                group.items.iter().for_each(|item| self.tree(before, item));
            }
        }
    }

    /// Records the paths in a macro's arguments, such as `golden :: place`. `syn` returns the arguments as tokens.
    fn tokens(&mut self, text: &str) {
        let text = text.replace(" :: ", "::");
        let words = text.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
        for word in words.filter(|word| word.contains("::")) {
            let parts: Vec<String> = word.split("::").map(str::to_owned).collect();
            self.path(&parts);
        }
    }
}

/// Checks if an item is compiled only for tests.
fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let list = attribute.meta.require_list();
        attribute.path().is_ident("cfg") && list.is_ok_and(|l| l.tokens.to_string() == "test")
    })
}

impl<'ast> Visit<'ast> for Names {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_test(&module.attrs) {
            self.depth += 1;
            visit::visit_item_mod(self, module);
            self.depth -= 1;
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if !is_test(&item.attrs) {
            self.tree(&[], &item.tree);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.segments.len() > 1 {
            let parts: Vec<String> = path.segments.iter().map(|s| s.ident.to_string()).collect();
            self.path(&parts);
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.tokens(&call.tokens.to_string());
    }
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The names in a file of the library. `depth` is 1 for `golden.rs`, and 2 for `golden/place.rs`.
fn names(text: &str, depth: usize) -> Names {
    let mut names = Names { depth, ..Names::default() };
    names.visit_file(&syn::parse_file(text).expect("it compiles"));
    names
}

/// The sources of the library's two crates.
fn library() -> Vec<(PathBuf, PathBuf)> {
    files(&["core/src", "src"])
}

/// The source files in folders. Each has its path inside its folder, without the extension.
fn files(folders: &[&str]) -> Vec<(PathBuf, PathBuf)> {
    let mut all = Vec::new();
    for folder in folders {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        let mut files = Vec::new();
        sources(&root, &mut files);
        let below =
            |file: &PathBuf| file.strip_prefix(&root).expect("below src").with_extension("");
        all.extend(files.into_iter().map(|file| (file.clone(), below(&file))));
    }
    all.sort();
    all
}

/// The names in each module of the library and of `karat-inspect`.
fn modules() -> BTreeMap<String, Names> {
    let mut modules: BTreeMap<String, Names> = BTreeMap::new();
    for (file, relative) in files(&["core/src", "src", "inspect/src"]) {
        let parts: Vec<_> = relative.iter().map(|part| part.to_string_lossy()).collect();
        // `tests.rs` is a module behind `#[cfg(test)]`.
        if parts[0] == "lib" || parts.last().is_some_and(|last| last == "tests") {
            continue;
        }
        let found = names(&std::fs::read_to_string(&file).expect("UTF-8"), parts.len());
        let module = modules.entry(parts[0].clone().into_owned()).or_default();
        module.modules.extend(found.modules);
        module.crates.extend(found.crates);
    }
    modules
}

#[test]
fn every_module_has_its_place() {
    let known: Vec<String> = modules().into_keys().collect();
    let mut order: Vec<String> = order().into_iter().map(|row| row.module).collect();
    for (at, module) in order.iter().enumerate() {
        let file = format!("core/src/{module}.rs");
        let in_core = Path::new(env!("CARGO_MANIFEST_DIR")).join(file).exists();
        assert_eq!(in_core, at < CORE, "the first {CORE} rows are `karat-core`, not `{module}`");
        let file = format!("inspect/src/{module}.rs");
        let in_inspect = Path::new(env!("CARGO_MANIFEST_DIR")).join(file).exists();
        let last = at >= order.len() - INSPECT;
        assert_eq!(in_inspect, last, "the last {INSPECT} are `karat-inspect`, not `{module}`");
    }
    order.sort();
    assert_eq!(known, order);
}

#[test]
fn modules_use_only_what_is_below_them() {
    let order = order();
    for (module, names) in modules() {
        let place = order.iter().position(|row| row.module == module).expect("it has a place");
        for Row { module: above, .. } in &order[place + 1..] {
            assert!(!names.modules.contains(above), "`{module}` uses `{above}`, which is above it");
        }
    }
}

#[test]
fn only_their_owners_name_the_large_crates() {
    let order = order();
    let owned: BTreeSet<&String> = order.iter().flat_map(|row| &row.crates).collect();
    for large in LARGE {
        assert!(owned.iter().any(|name| *name == large), "the table has no owner of `{large}`");
    }
    for (module, names) in modules() {
        let own = order.iter().find(|row| row.module == module).expect("it has a place");
        for name in names.crates.iter().filter(|name| owned.contains(name)) {
            assert!(own.crates.contains(name), "`{module}` names `{name}`");
        }
    }
}

/// The parser finds paths in code, and ignores paths in comments and strings.
#[test]
fn paths_are_found_wherever_they_stand() {
    let text = r#"
        //! crate::comment::x
        use crate::{one::A, two as other, three::{self, B}};
        use super::sibling;
        use super::super::four;
        fn f(x: crate::five::T) -> wgpu::Buffer {
            let text = "crate::text::x";
            assert!(crate::six::good(&text));
            crate::seven::f::<crate::eight::T>(x)
        }
        #[cfg(test)]
        mod tests { use crate::hidden::T; }
        mod inner { fn g() { super::super::super::nine::h() } }
    "#;
    let found = names(text, 2);
    let modules: Vec<&str> = found.modules.iter().map(String::as_str).collect();
    assert_eq!(modules, ["eight", "five", "four", "nine", "one", "seven", "six", "three", "two"]);
    assert!(found.crates.contains("wgpu"), "{found:?}");
}

/// The library has few direct dependencies, and few names at its root.
#[test]
fn the_library_has_few_dependencies_and_root_names() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut dependencies = BTreeSet::new();
    for manifest in ["Cargo.toml", "core/Cargo.toml"] {
        let manifest = std::fs::read_to_string(root.join(manifest)).expect("it is there");
        let (_, below) = manifest.split_once("[dependencies]\n").expect("it has dependencies");
        let own = below.lines().take_while(|line| !line.is_empty());
        let others = own.filter(|line| {
            !line.starts_with("karat-")
                && !line.starts_with('#')
                && !line.contains("optional = true")
        });
        dependencies.extend(others.map(str::to_owned));
    }
    let count = dependencies.len();
    assert!((10..=MOST_DEPENDENCIES).contains(&count), "{count} direct dependencies");

    let text = std::fs::read_to_string(root.join("src/lib.rs")).expect("it is there");
    let parsed = syn::parse_file(&text).expect("it compiles");
    let exported = parsed.items.iter().filter_map(|item| match item {
        syn::Item::Use(item) => Some(leaves(&item.tree)),
        _ => None,
    });
    let count: usize = exported.sum();
    assert!((20..=MOST_NAMES).contains(&count), "{count} names at the root");
    // Karat's other crates can use only public items.
    for (file, _) in library().iter().filter(|(file, _)| !file.starts_with(root.join("core"))) {
        let text = std::fs::read_to_string(file).expect("UTF-8");
        assert!(!text.contains("doc(hidden)"), "what is public is documented: {}", file.display());
    }
}

/// The number of items that a `use` imports, except for modules and macros: their names begin with a small letter.
fn leaves(tree: &syn::UseTree) -> usize {
    match tree {
        syn::UseTree::Path(path) => leaves(&path.tree),
        syn::UseTree::Group(group) => group.items.iter().map(leaves).sum(),
        syn::UseTree::Name(name) => {
            usize::from(name.ident.to_string().starts_with(char::is_uppercase))
        }
        _ => 1,
    }
}

/// The name of a public item, such as `Package` or `Package::open`, and `true` if the item's documentation has an
/// example.
type Item = (String, bool);

/// The public items of a file: functions, methods, types, traits and exported macros. The lint `unreachable_pub` makes
/// sure that public items are reachable. Trait items, variants, fields and error types need no examples of their own.
#[derive(Debug, Default)]
struct PublicItems {
    owner: String,
    items: Vec<Item>,
}

/// The line in the documentation of a method that may change, although its type is stable.
const UNSTABLE: &str = "*Unstable*: this item may change in any release. It is for programs that run tests or report their results.";

impl PublicItems {
    fn of(text: &str) -> Vec<Item> {
        Self::of_items(&syn::parse_file(text).expect("it compiles").items)
    }

    fn of_items(items: &[syn::Item]) -> Vec<Item> {
        let mut found = Self::default();
        items.iter().for_each(|item| found.visit_item(item));
        found.items
    }

    fn item(&mut self, public: bool, name: &syn::Ident, attributes: &[syn::Attribute]) {
        let is = |attribute: &syn::Attribute, name: &str, word: &str| {
            attribute.path().is_ident(name) && quoted(attribute).contains(word)
        };
        let has = |name, word| attributes.iter().any(|attribute| is(attribute, name, word));
        let is_unstable = attributes.iter().any(|one| quoted(one).trim().starts_with(UNSTABLE));
        if public && !has("derive", "thiserror") && !is_hidden(attributes) && !is_unstable {
            self.items.push((format!("{}{name}", self.owner), has("doc", "```")));
        }
    }
}

/// Checks if an item has the attribute `doc(hidden)`.
fn is_hidden(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|one| one.path().is_ident("doc") && quoted(one) == "hidden")
}

/// The string in an attribute.
fn quoted(attribute: &syn::Attribute) -> String {
    match &attribute.meta {
        syn::Meta::NameValue(syn::MetaNameValue { value: syn::Expr::Lit(value), .. }) => {
            match &value.lit {
                syn::Lit::Str(text) => text.value(),
                _ => String::new(),
            }
        }
        syn::Meta::List(list) => list.tokens.to_string(),
        _ => String::new(),
    }
}

fn is_public(visibility: &syn::Visibility) -> bool {
    matches!(visibility, syn::Visibility::Public(_))
}

impl<'ast> Visit<'ast> for PublicItems {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_test(&module.attrs) {
            visit::visit_item_mod(self, module);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.item(is_public(&item.vis), &item.sig.ident, &item.attrs);
    }

    fn visit_item_struct(&mut self, item: &'ast syn::ItemStruct) {
        self.item(is_public(&item.vis), &item.ident, &item.attrs);
    }

    fn visit_item_enum(&mut self, item: &'ast syn::ItemEnum) {
        self.item(is_public(&item.vis), &item.ident, &item.attrs);
    }

    fn visit_item_trait(&mut self, item: &'ast syn::ItemTrait) {
        self.item(is_public(&item.vis), &item.ident, &item.attrs);
    }

    fn visit_item_macro(&mut self, item: &'ast syn::ItemMacro) {
        let exported = item.attrs.iter().any(|one| one.path().is_ident("macro_export"));
        if let Some(name) = &item.ident {
            self.item(exported, name, &item.attrs);
        }
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        let syn::Type::Path(of) = &*item.self_ty else { return };
        if item.trait_.is_none() {
            let name = of.path.segments.last().expect("a path has a part").ident.to_string();
            self.owner = name + "::";
            visit::visit_item_impl(self, item);
            self.owner.clear();
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.item(is_public(&item.vis), &item.sig.ident, &item.attrs);
    }
}

/// Items without an example. A method `try_x` needs no example, because the example of `x` shows how to use it.
fn without_example(items: &[Item]) -> Vec<&str> {
    let shown = |name: &str| items.iter().any(|(other, example)| other == name && *example);
    let plain = |name: &str| name.replacen("::try_", "::", 1);
    let without = items.iter().filter(|(name, example)| !example && !shown(&plain(name)));
    without.map(|(name, _)| name.as_str()).collect()
}

/// The stable part of the library: `lib.rs` and its public modules.
struct Promise {
    /// The types, functions and traits that each public module defines or reexports in its root file.
    names: BTreeMap<String, BTreeSet<String>>,
}

impl Promise {
    fn read() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let parsed = |file: &str| {
            let text = std::fs::read_to_string(root.join(file)).expect("it is there");
            syn::parse_file(&text).expect("it compiles").items
        };
        let mut names = BTreeMap::new();
        for item in parsed("lib.rs") {
            let syn::Item::Mod(module) = item else { continue };
            let room = module.ident.to_string();
            if !is_public(&module.vis) || ["prelude", "unstable"].contains(&&*room) {
                continue;
            }
            // `lib.rs` lists the names that it reexports from a module of `karat-core`.
            let items = match module.content {
                Some((_, items)) => items,
                None => parsed(&format!("{room}.rs")),
            };
            let brought = public_uses(&items).into_iter().map(last);
            let own = PublicItems::of_items(&items).into_iter();
            let own = own.filter(|(name, _)| !name.contains("::")).map(|(name, _)| name);
            names.insert(room, brought.chain(own).collect());
        }
        Self { names }
    }

    /// The file's public items that belong to the stable part. These include methods in the file if another file
    /// defines their type.
    fn items(&self, file: &Path, below: &Path) -> Vec<Item> {
        let room = below.iter().next().expect("it is in a room").to_string_lossy();
        let room = room.strip_suffix(".rs").unwrap_or(&room);
        let is_of = |name: &str| self.names.get(room).is_some_and(|own| own.contains(name));
        let is_known = |name: &str| self.names.values().any(|own| own.contains(name));
        let is_promised = |(name, _): &Item| match name.split_once("::") {
            // No two types of public modules have the same name, so the name identifies the type of an `impl` block.
            Some((of, _)) => is_of(of) || (self.names.contains_key(room) && is_known(of)),
            None => is_of(name),
        };
        let mut items = PublicItems::of(&std::fs::read_to_string(file).expect("UTF-8"));
        items.retain(is_promised);
        items
    }
}

fn last(path: Vec<String>) -> String {
    path.into_iter().next_back().expect("a path has a part")
}

/// The paths of public `use`s.
fn public_uses(items: &[syn::Item]) -> Vec<Vec<String>> {
    let mut paths = Vec::new();
    for item in items {
        if let syn::Item::Use(item) = item
            && is_public(&item.vis)
        {
            paths_of(&[], &item.tree, &mut paths);
        }
    }
    paths
}

fn paths_of(before: &[String], tree: &syn::UseTree, paths: &mut Vec<Vec<String>>) {
    let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
    match tree {
        syn::UseTree::Path(path) => paths_of(&with(&path.ident), &path.tree, paths),
        syn::UseTree::Group(group) => {
            group.items.iter().for_each(|item| paths_of(before, item, paths));
        }
        syn::UseTree::Name(name) => paths.push(with(&name.ident)),
        syn::UseTree::Rename(rename) => paths.push(with(&rename.ident)),
        syn::UseTree::Glob(_) => paths.push(before.to_vec()),
    }
}

/// The largest number of stable names in the library: types, functions, methods, traits and macros. Users rely on each
/// name, so avoid a new one.
const MOST_PROMISED: usize = 312;

/// The documentation of each stable item shows how to use the item.
// Lesson 138
#[test]
fn promised_items_have_an_example() {
    let promise = Promise::read();
    for (room, name) in [("domain", "UnitVector"), ("path", "Path"), ("check", "Check")] {
        assert!(promise.names[room].contains(name), "`{room}::{name}` is promised");
    }
    for (room, name) in [("domain", "Source"), ("path", "Adapter"), ("check", "Words")] {
        assert!(!promise.names[room].contains(name), "`{room}::{name}` is for tools");
    }
    assert!(promise.names.len() > 4 && !promise.names.contains_key("record"));
    let files = library();
    let all: Vec<Item> =
        files.iter().flat_map(|(file, below)| promise.items(file, below)).collect();
    let count = all.len();
    assert!((200..=MOST_PROMISED).contains(&count), "{count} items are promised");
    let missing = without_example(&all).join(", ");
    assert!(
        missing.is_empty(),
        "these public items have no example in their documentation: {missing}"
    );
}

// Lesson 138
#[test]
fn public_items_are_recognised() {
    let text = r#"
        /// ```
        /// shown();
        /// ```
        pub fn shown() {}
        pub(crate) fn inner() {}
        /// Nothing.
        pub struct Bare { pub member: u32 }
        #[derive(Debug, thiserror::Error)]
        pub enum Wrong {}
        impl Bare {
            /// ```
            /// Bare::new();
            /// ```
            pub fn new() -> Self { Self { member: 0 } }
            pub fn try_new() -> Option<Self> { None }
            pub fn try_other() -> Option<Self> { None }
        }
        impl Clone for Bare { fn clone(&self) -> Self { Self::new() } }
        #[macro_export]
        macro_rules! made { () => {} }
        #[cfg(test)]
        mod tests { pub fn hidden() {} }
    "#;
    let items = PublicItems::of(text);
    assert_eq!(without_example(&items), ["Bare", "Bare::try_other", "made"]);
    assert_eq!(items.len(), 6);
}
