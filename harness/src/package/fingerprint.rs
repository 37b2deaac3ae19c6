//! What a declaration and all that it needs are made of, without linking them: while that is the same, so is
//! the program, but for comments, blanks and the names that the linker gives.
//!
//! A library of a hundred tests is looked through at each edit, where linking all of them would take a
//! hundred times as long as linking the one that the edit concerns. The references of each declaration are
//! resolved once for all tests of a module.

use std::collections::{BTreeMap, BTreeSet};

use blake3::{Hash, Hasher};

use super::directives;
use super::expectations::TestItem;
use super::imports;
use super::library::{Library, ModulePath};
use super::linked::Item;
use super::linker::Linker;
use super::{Package, PackageError};

/// The tests of a module with their fingerprints.
type TestItems = Result<Vec<(TestItem, Option<String>)>, PackageError>;

impl Package {
    /// A fingerprint of each of some functions: `brdf::schlick`. Of one that can't be linked there is none.
    #[must_use]
    pub fn fingerprints(&self, functions: &BTreeSet<String>) -> BTreeMap<String, String> {
        let mut modules: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for function in functions {
            let (module, item) = function.rsplit_once("::").unwrap_or(("", function));
            modules.entry(module).or_default().push(item.to_owned());
        }
        let mut all = BTreeMap::new();
        let Ok(library) = Library::open(self) else { return all };
        let mut described = Described::new(self, &library);
        for (module, items) in modules {
            let prefix = if module.is_empty() { String::new() } else { format!("{module}::") };
            let found = described.fingerprints(module, &items).unwrap_or_default();
            let named = items.iter().zip(found).filter_map(|(item, found)| Some((item, found?)));
            all.extend(named.map(|(item, found)| (format!("{prefix}{item}"), found)));
        }
        all
    }

    /// The tests of each of some modules, in the order of lines, with their fingerprints.
    pub(crate) fn test_items(&self, modules: &[String]) -> Result<Vec<TestItems>, PackageError> {
        let library = Library::open(self)?;
        let mut described = Described::new(self, &library);
        Ok(modules.iter().map(|module| described.tests(module)).collect())
    }
}

/// The declarations of a package, each described once for all of its modules.
struct Described<'a> {
    package: &'a Package,
    library: &'a Library,
    linker: Option<Linker<'a>>,
    known: Known,
}

/// What is known of some modules and declarations.
#[derive(Default)]
struct Known {
    /// Modules whose imports, and those of all that they lead to, are there.
    imports: BTreeSet<ModulePath>,
    items: BTreeMap<Item, Hash>,
}

impl<'a> Described<'a> {
    fn new(package: &'a Package, library: &'a Library) -> Self {
        Self { package, library, linker: None, known: Known::default() }
    }

    fn tests(&mut self, module: &str) -> TestItems {
        let parsed = match self.is_alone(module)? {
            true => self.package.parsed(module)?,
            false => self.library.module(&ModulePath::root(module))?,
        };
        let items = TestItem::all_of(module, &parsed)?;
        if items.is_empty() {
            return Ok(Vec::new());
        }
        let own = |item: &TestItem| item.name.rsplit("::").next().unwrap_or_default().to_owned();
        let names: Vec<String> = items.iter().map(own).collect();
        let found = self.fingerprints(module, &names).unwrap_or_else(|_| vec![None; names.len()]);
        Ok(items.into_iter().zip(found).collect())
    }

    /// `None` for a declaration that isn't there, or needs what isn't.
    fn fingerprints(
        &mut self,
        module: &str,
        items: &[String],
    ) -> Result<Vec<Option<String>>, PackageError> {
        let root = ModulePath::root(module);
        if self.is_alone(module)? {
            let library = Library::open(self.package)?;
            library.begin(&root)?;
            let mut linker = Linker::new(&library, &root)?;
            return fingerprints_of(self.package, items, &mut linker, &mut Known::default());
        }
        let linker = match &mut self.linker {
            Some(linker) => linker,
            none => none.insert(Linker::new(self.library, &root)?),
        };
        linker.turn_to(&root)?;
        fingerprints_of(self.package, items, linker, &mut self.known)
    }

    /// Whether a module says what others read, or shares its name space with them.
    fn is_alone(&self, module: &str) -> Result<bool, PackageError> {
        let root = ModulePath::root(module);
        let defines = !directives::defined(&self.library.read(&root)?.text).is_empty();
        Ok(defines || !self.library.module(&root)?.includes.is_empty())
    }
}

fn fingerprints_of(
    package: &Package,
    items: &[String],
    linker: &mut Linker<'_>,
    known: &mut Known,
) -> Result<Vec<Option<String>>, PackageError> {
    let (library, root) = (linker.library(), linker.root().clone());
    let parsed = library.module(&root)?;
    if !package.is_crate() {
        imports::check_more(library, &root, &mut known.imports)?;
    }
    let mut one = |item: &str| -> Result<Option<String>, PackageError> {
        let wanted: Vec<Item> = parsed.declared(item).map(|index| (root.clone(), index)).collect();
        if wanted.is_empty() {
            return Ok(None);
        }
        let reached = linker.reach(wanted)?;
        let mut all = Hasher::new();
        for item in &reached {
            let own = known.items.entry(item.clone()).or_insert_with(|| {
                let mut own = Hasher::new();
                linker.describe(item, &mut own);
                own.finalize()
            });
            all.update(own.as_bytes());
        }
        linker.describe_directives(&reached, &mut all);
        Ok(Some(all.finalize().to_hex().to_string()))
    };
    // What one needs and isn't there is told when that one is linked.
    Ok(items.iter().map(|item| one(item).ok().flatten()).collect())
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

    /// What the program of `f` is made of changes its fingerprint, and nothing else does.
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

    #[test]
    fn what_cannot_be_linked_has_none() {
        let package = Package::from_modules("m", [("a", "fn f() { g(); }\n")]);
        let found = package.fingerprints(&["a::f", "a::nothing"].map(str::to_owned).into());
        assert_eq!(Vec::from_iter(found.keys()), ["a::f"], "naga says what `g` is");
        let broken =
            Package::from_modules("m", [("a", "import package::b::g;\nfn f() { g(); }\n")]);
        assert!(broken.fingerprints(&BTreeSet::from(["a::f".to_owned()])).is_empty());
    }
}
