//! Computes fingerprints of declarations without linking. A declaration keeps its fingerprint if an edit changes
//! only comments and blanks in the declaration and in everything that the declaration needs.
//!
//! After each edit, Karat compares the fingerprints of all tests, to find the tests that must run again.
//! Linking a hundred tests after each edit would take a hundred times as long as linking the changed test. So Karat
//! hashes each declaration once, and hashes the declaration again only after its module changed.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use blake3::{Hash, Hasher};

use super::directives;
use super::feature::Features;
use super::imports;
use super::library::{Library, ModulePath};
use super::linked::Item;
use super::linker::Linker;
use super::syntax::Module;
use super::test_items::TestItem;
use super::workspace::{self, Kind};
use super::{Package, PackageError};
use crate::diagnostic::Diagnostic;

type TestItems = Result<Vec<(TestItem, Option<String>)>, PackageError>;

impl Package {
    /// The fingerprints of the given functions, by the functions' paths, such as `brdf::schlick`. A function that can't
    /// be linked has no fingerprint.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let of = |text| Package::from_source("m", text).fingerprints(&["half".to_owned()].into());
    /// let half = of("fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// assert_eq!(half, of("fn half(x: f32) -> f32 { return 0.5 * x; } fn other() {}"));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn fingerprints(&self, functions: &BTreeSet<String>) -> BTreeMap<String, String> {
        let mut modules: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for function in functions {
            let (module, item) = function.rsplit_once("::").unwrap_or(("", function));
            modules.entry(module).or_default().push(item.to_owned());
        }
        let mut all = BTreeMap::new();
        let (Ok(library), Ok(there)) = (Library::open(self), self.modules()) else { return all };
        let mut described = Described::new(self, &library, &there);
        for (module, items) in modules {
            let prefix = if module.is_empty() { String::new() } else { format!("{module}::") };
            let found = described.fingerprints(module, &items).unwrap_or_default();
            let named = items.iter().zip(found).filter_map(|(item, found)| Some((item, found?)));
            all.extend(named.map(|(item, found)| (format!("{prefix}{item}"), found)));
        }
        described.keep(&there);
        all
    }

    /// The tests of each module with their fingerprints, in the order of lines. Also returns the package's
    /// features.
    pub(crate) fn test_items(
        &self,
        modules: &[String],
    ) -> Result<(Vec<TestItems>, Features), PackageError> {
        let library = Library::open(self)?;
        let mut described = Described::new(self, &library, modules);
        let found = modules.iter().map(|module| described.tests(module)).collect();
        described.keep(modules);
        Ok((found, library.features(0)))
    }
}

/// Checks if a text that can't be parsed contains `@test`.
fn may_have_tests(error: &Diagnostic) -> bool {
    let text = error.location().map_or("@test", |place| &place.file.text);
    text.split('@').skip(1).any(|mark| mark.trim_start().starts_with("test"))
}

#[derive(Default)]
struct Known {
    /// The modules whose imports Karat has checked. Karat has also checked all modules that these modules import,
    /// directly or through others.
    imports: BTreeSet<ModulePath>,
    modules: BTreeMap<ModulePath, Arc<Module>>,
    numbers: HashMap<Item, usize>,
    nodes: Vec<Node>,
    /// The number of times that Karat has computed the package's fingerprints.
    time: u64,
    wholes: HashMap<usize, Whole>,
}

struct Node {
    item: Item,
    /// The hash of the declaration's own tokens, and the declarations that it needs. `None` if Karat hasn't hashed the
    /// declaration yet, or if its module changed.
    made_of: Option<(Hash, Vec<usize>)>,
    /// The value of `made_of` before the declaration's module changed.
    before: Option<(Hash, Vec<usize>)>,
    since: u64,
}

/// The fingerprint of a declaration, with the indices of everything that the declaration needs.
struct Whole {
    found: String,
    nodes: Vec<usize>,
    time: u64,
}

struct Last {
    package: Package,
    there: Vec<String>,
    /// The packages from which modules of the package import, directly or through others, in the order of their indices
    /// in [`Library`].
    packages: Vec<(Package, String)>,
    known: Known,
}

impl Kind for Last {
    type Key = ();
    type Value = Self;
    const MOST: usize = 1;
}

/// Computes fingerprints of a package's declarations. Karat hashes each declaration once, even if several modules use
/// it.
struct Described<'a> {
    package: &'a Package,
    library: &'a Library,
    linker: Option<Linker<'a>>,
    known: Known,
}

impl<'a> Described<'a> {
    fn new(package: &'a Package, library: &'a Library, there: &[String]) -> Self {
        let last = workspace::with::<Last, _>(|last| last.remove(&()));
        let known = last.filter(|last| last.package == *package && last.there == there);
        let known = known.and_then(|mut last| {
            library.number_as(&last.packages);
            last.known.is_updated(library).then_some(last.known)
        });
        Self { package, library, linker: None, known: known.unwrap_or_default() }
    }

    /// Stores the known hashes for the next computation of fingerprints. Stores nothing if the package imports from a
    /// package that isn't text in memory, because the files of that package may change.
    fn keep(self, there: &[String]) {
        let Some(packages) = self.library.in_memory() else { return };
        let (package, there) = (self.package.clone(), there.to_vec());
        let known = Known { modules: self.library.parsed(), ..self.known };
        let last = Last { package, there, packages, known };
        workspace::keep::<Last>((), last);
    }

    fn tests(&mut self, module: &str) -> TestItems {
        let root = ModulePath::root(module);
        let read = self.own_library(&root).and_then(|own| {
            let parsed = own.as_ref().unwrap_or(self.library).module(&root)?;
            Ok((own, parsed))
        });
        let (own, parsed) = match read {
            // Validation reports this error.
            Err(PackageError::Shader(found)) if !may_have_tests(&found) => return Ok(Vec::new()),
            read => read?,
        };
        let items = TestItem::all_of(module, &parsed)?;
        if items.is_empty() {
            return Ok(Vec::new());
        }
        let name = |item: &TestItem| item.name.rsplit("::").next().unwrap_or_default().to_owned();
        let names: Vec<String> = items.iter().map(name).collect();
        let found = self.found(&root, own.as_ref(), &names);
        let found = found.unwrap_or_else(|_| vec![None; names.len()]);
        Ok(items.into_iter().zip(found).collect())
    }

    /// The fingerprints of declarations. An element is `None` if the declaration, or a declaration that it needs,
    /// doesn't exist.
    fn fingerprints(
        &mut self,
        module: &str,
        items: &[String],
    ) -> Result<Vec<Option<String>>, PackageError> {
        let root = ModulePath::root(module);
        let own = self.own_library(&root)?;
        self.found(&root, own.as_ref(), items)
    }

    fn found(
        &mut self,
        root: &ModulePath,
        own: Option<&Library>,
        items: &[String],
    ) -> Result<Vec<Option<String>>, PackageError> {
        if let Some(library) = own {
            let mut linker = Linker::new(library, root)?;
            return Known::default().fingerprints(self.package, items, &mut linker);
        }
        let linker = match &mut self.linker {
            Some(linker) => linker,
            none => none.insert(Linker::new(self.library, root)?),
        };
        linker.turn_to(root)?;
        self.known.fingerprints(self.package, items, linker)
    }

    /// A separate [`Library`] for a module with a `#define`, which applies to all modules, or with included modules.
    /// Returns `None` for any other module, because such modules share one [`Library`].
    fn own_library(&self, root: &ModulePath) -> Result<Option<Library>, PackageError> {
        let file = self.library.read(root)?;
        let defines = !directives::defined(&file.text).is_empty()
            || !directives::guards(&file.text).is_empty();
        if !defines && self.library.module(root)?.includes.is_empty() {
            return Ok(None);
        }
        let own = Library::open(self.package)?;
        own.begin(root)?;
        Ok(Some(own))
    }
}

impl Known {
    /// Removes the hashes of the declarations in changed modules. Returns `false` if a changed module declares or
    /// imports other names than before. After such a change, names in other modules may refer to other declarations.
    fn is_updated(&mut self, library: &Library) -> bool {
        let mut changed = BTreeSet::new();
        for (path, known) in &self.modules {
            let Ok(now) = library.module(path) else { return false };
            if Arc::ptr_eq(known, &now) {
                continue;
            }
            if !has_same_names(known, &now) {
                return false;
            }
            changed.insert(path.clone());
        }
        for node in self.nodes.iter_mut().filter(|node| changed.contains(&node.item.0)) {
            node.before = node.made_of.take().or(node.before.take());
        }
        self.time += 1;
        true
    }

    fn number(&mut self, item: Item) -> usize {
        *self.numbers.entry(item).or_insert_with_key(|item| {
            let item = item.clone();
            self.nodes.push(Node { item, made_of: None, before: None, since: 0 });
            self.nodes.len() - 1
        })
    }

    fn fingerprints(
        &mut self,
        package: &Package,
        items: &[String],
        linker: &mut Linker<'_>,
    ) -> Result<Vec<Option<String>>, PackageError> {
        let (library, root) = (linker.library(), linker.root().clone());
        let parsed = library.module(&root)?;
        if !package.is_crate() {
            imports::check_more(library, &root, &mut self.imports)?;
        }
        let own = linker.directives(&root);
        let mut one = |item: &str| -> Result<Option<String>, PackageError> {
            let wanted = parsed.declared(item).map(|index| (root.clone(), index));
            let wanted: Vec<usize> = wanted.map(|item| self.number(item)).collect();
            if wanted.is_empty() {
                return Ok(None);
            }
            let only = wanted.first().copied().filter(|_| wanted.len() == 1);
            if let Some(found) = only.map(|only| self.found(only, linker)).transpose()?.flatten() {
                return Ok(Some(found));
            }
            let (nodes, mut hashes) = self.reached(wanted, linker)?;
            hashes.extend(own);
            // The hash doesn't depend on the order of the declarations.
            hashes.sort_unstable_by_key(|hash| *hash.as_bytes());
            hashes.dedup();
            let mut all = Hasher::new();
            for hash in &hashes {
                all.update(hash.as_bytes());
            }
            let found = all.finalize().to_hex().to_string();
            if let Some(only) = only {
                let whole = Whole { found: found.clone(), nodes, time: self.time };
                self.wholes.insert(only, whole);
            }
            Ok(Some(found))
        };
        // A declaration that can't be read has no fingerprint, because the linker reports its error.
        Ok(items.iter().map(|item| one(item).ok().flatten()).collect())
    }

    /// The previous fingerprint of a declaration, if everything that it needs is unchanged.
    fn found(
        &mut self,
        only: usize,
        linker: &mut Linker<'_>,
    ) -> Result<Option<String>, PackageError> {
        let Some(Whole { nodes, time, .. }) = self.wholes.get(&only) else { return Ok(None) };
        let (nodes, time) = (nodes.clone(), *time);
        for node in nodes {
            self.describe(node, linker)?;
            if self.nodes[node].since > time {
                return Ok(None);
            }
        }
        Ok(self.wholes.get(&only).map(|whole| whole.found.clone()))
    }

    /// Describes a declaration: its own tokens, its module's directives, and the declarations that it needs.
    fn describe(&mut self, number: usize, linker: &mut Linker<'_>) -> Result<(), PackageError> {
        if self.nodes[number].made_of.is_some() {
            return Ok(());
        }
        let item = self.nodes[number].item.clone();
        let needs = linker.needs(&item)?;
        let needs = needs.into_iter().map(|item| self.number(item)).collect();
        let mut own = Hasher::new();
        linker.describe(&item, &mut own);
        if let Some(directives) = linker.directives(&item.0) {
            own.update(directives.as_bytes());
        }
        let (made_of, node) = (Some((own.finalize(), needs)), &mut self.nodes[number]);
        if node.before != made_of {
            node.since = self.time;
        }
        node.made_of = made_of;
        Ok(())
    }

    /// The given declarations and everything that they need, each with its hash.
    fn reached(
        &mut self,
        mut queue: Vec<usize>,
        linker: &mut Linker<'_>,
    ) -> Result<(Vec<usize>, Vec<Hash>), PackageError> {
        let mut seen: BTreeSet<usize> = queue.iter().copied().collect();
        let mut hashes = Vec::new();
        while let Some(number) = queue.pop() {
            self.describe(number, linker)?;
            let Some((own, needs)) = &self.nodes[number].made_of else { continue };
            hashes.push(*own);
            queue.extend(needs.iter().copied().filter(|needed| seen.insert(*needed)));
        }
        Ok((seen.into_iter().collect(), hashes))
    }
}

fn has_same_names(one: &Module, other: &Module) -> bool {
    let declared = |module: &Module| {
        let all = module.declarations.iter();
        all.map(|declaration| (declaration.name.clone(), declaration.kind)).collect::<Vec<_>>()
    };
    let imported = |module: &Module| {
        let tokens = module.imports.iter().flat_map(Clone::clone);
        tokens.map(|token| module.text(token).to_owned()).collect::<Vec<_>>()
    };
    let shares = !one.includes.is_empty() || !other.includes.is_empty();
    !shares
        && one.composes == other.composes
        && declared(one) == declared(other)
        && imported(one) == imported(other)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(a: &str, b: &str) -> Vec<String> {
        let package = Package::from_modules("m", [("a", a), ("b", b)]);
        let names = ["a::f", "a::other"].map(str::to_owned);
        let mut found = package.fingerprints(&BTreeSet::from(names.clone()));
        names.iter().map(|name| found.remove(name).expect("it is linked")).collect()
    }

    const A: &str = "import package::b::{g, h};\nconst K = 2.0;\n\
                     fn f(x: f32) -> f32 { return K * g(x); }\n\
                     fn other(x: f32) -> f32 { return h(x); }\n";
    const B: &str = "fn g(x: f32) -> f32 { return x; }\nfn h(x: f32) -> f32 { return -x; }\n";

    /// The fingerprint of `f` changes if, and only if, the program of `f` changes.
    // Lesson 103
    #[test]
    fn a_fingerprint_changes_with_the_program_alone() {
        let first = of(A, B);
        let (yes, no) = (true, false);
        for (a, b, changes) in [
            (A.replace("K * g", "K  *  /* times */ g"), B.to_owned(), [no, no]),
            (format!("// above\n{A}"), format!("{B}fn more() {{}}\n"), [no, no]),
            (A.replace("K = 2.0", "K = 3.0"), B.to_owned(), [yes, no]),
            (A.replace("K * g", "K / g"), B.to_owned(), [yes, no]),
            (A.to_owned(), B.replace("return x", "return 2.0 * x"), [yes, no]),
            (A.to_owned(), B.replace("return -x", "return x"), [no, yes]),
            (A.replace("{g, h}", "{g as h, h as g}"), B.to_owned(), [yes, yes]),
            (format!("{A}const_assert K > 1.0;\n"), B.to_owned(), [yes, yes]),
            (
                format!("enable f16;\n{}", A.replace("import package::b::{g, h};\n", "")) + B,
                B.to_owned(),
                [yes, yes],
            ),
        ] {
            let now = of(&a, &b);
            let changed = [0, 1].map(|at| now[at] != first[at]);
            assert_eq!(changed, changes, "{a}{b}");
        }
    }

    /// After edits in a folder, Karat computes the same fingerprints with stored hashes as without stored hashes.
    #[test]
    fn cached_facts_do_not_change_fingerprints() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("written");
        };
        let package = Package::open(folder.path()).expect("a folder");
        let names = BTreeSet::from(["a::f", "a::other"].map(str::to_owned));
        let found = || {
            let again = package.fingerprints(&names);
            let last = workspace::with::<Last, _>(|last| last.remove(&()));
            let anew = package.fingerprints(&names);
            workspace::with::<Last, _>(|kept| kept.extend(last.map(|last| ((), last))));
            assert_eq!(again, anew);
            ["a::f", "a::other"].map(|name| again.get(name).cloned())
        };
        write("a.wgsl", A);
        write("b.wgsl", B);
        let mut before = found();
        let (yes, no) = (true, false);
        let through = "import package::c::{g, h};\n";
        for (what, name, text, changes) in [
            ("a body", "b.wgsl", B.replace("return x", "return 2.0 * x"), [yes, no]),
            (
                "a comment",
                "b.wgsl",
                format!("// b\n{}", B.replace("return x", "return 2.0 * x")),
                [no, no],
            ),
            ("a name more", "b.wgsl", format!("fn first() {{}}\n{B}"), [yes, no]),
            ("another module", "c.wgsl", B.replace("-x", "+x"), [no, no]),
            ("imports of what is imported", "b.wgsl", through.to_owned(), [yes, yes]),
            ("what these lead to", "c.wgsl", B.to_owned(), [no, yes]),
            ("a name that is gone", "c.wgsl", B.replace("fn h", "fn i"), [yes, yes]),
            ("a name that is back", "c.wgsl", B.to_owned(), [yes, yes]),
            ("what isn't WGSL", "b.wgsl", "fn g( {".to_owned(), [yes, yes]),
            ("a directive", "b.wgsl", format!("enable f16;\n{B}"), [yes, yes]),
        ] {
            write(name, &text);
            let now = found();
            assert_eq!([0, 1].map(|at| now[at] != before[at]), changes, "{what}: {now:?}");
            before = now;
        }
    }

    /// A checkout, or a rename across files, changes several modules at once. Karat hashes the declarations of each
    /// changed module again.
    // Lesson 193
    #[test]
    fn modules_that_change_together_all_have_new_fingerprints() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("written");
        };
        let package = Package::open(folder.path()).expect("a folder");
        let names = BTreeSet::from(["a::f", "a::other"].map(str::to_owned));
        let mut before = BTreeMap::new();
        // Another test may replace the stored facts at any time, but hardly in each of these 16 rounds.
        for round in 0..16 {
            write("a.wgsl", &A.replace("K = 2.0", &format!("K = {round}.5")));
            write("b.wgsl", &B.replace("return -x", &format!("return -{round}.5 * x")));
            let now = package.fingerprints(&names);
            for name in &names {
                assert!(now.contains_key(name) && before.get(name) != now.get(name), "{name}");
            }
            before = now;
        }
    }

    // Lesson 103
    #[test]
    fn functions_that_cannot_be_linked_have_no_fingerprint() {
        let package = Package::from_modules("m", [("a", "fn f() { g(); }\n")]);
        let found = package.fingerprints(&["a::f", "a::nothing"].map(str::to_owned).into());
        assert_eq!(Vec::from_iter(found.keys()), ["a::f"], "naga says what `g` is");
        let broken =
            Package::from_modules("m", [("a", "import package::b::g;\nfn f() { g(); }\n")]);
        assert!(broken.fingerprints(&BTreeSet::from(["a::f".to_owned()])).is_empty());
    }
}
