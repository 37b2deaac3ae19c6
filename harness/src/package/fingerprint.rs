//! What a declaration and all that it needs are made of, without linking them: while that is the same, so is
//! the program, but for comments, blanks and the names that the linker gives.
//!
//! A library of a hundred tests is looked through at each edit, where linking all of them would take a
//! hundred times as long as linking the one that the edit concerns. The references of each declaration are
//! resolved once for all tests of a module.

use std::collections::{BTreeMap, BTreeSet};

use blake3::Hasher;

use super::imports;
use super::library::{Library, ModulePath};
use super::linked::Item;
use super::linker::Linker;
use super::{Package, PackageError};

impl Package {
    /// A fingerprint of each of some functions: `brdf::schlick`. Of one that can't be linked there is none.
    #[must_use]
    pub fn fingerprints(&self, functions: &BTreeSet<String>) -> BTreeMap<String, String> {
        let mut modules: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for function in functions {
            let (module, item) = function.rsplit_once("::").unwrap_or(("", function));
            modules.entry(module).or_default().push(item);
        }
        let mut all = BTreeMap::new();
        for (module, items) in modules {
            let prefix = if module.is_empty() { String::new() } else { format!("{module}::") };
            let found = self.fingerprints_in(module, &items).unwrap_or_default();
            let named = items.iter().zip(found).filter_map(|(item, found)| Some((item, found?)));
            all.extend(named.map(|(item, found)| (format!("{prefix}{item}"), found)));
        }
        all
    }

    /// The same of declarations of one module; `None` for one that isn't there, or needs what isn't.
    pub(crate) fn fingerprints_in(
        &self,
        module: &str,
        items: &[&str],
    ) -> Result<Vec<Option<String>>, PackageError> {
        let root = ModulePath::root(module);
        let library = Library::open(self)?;
        library.begin(&root)?;
        let parsed = library.module(&root)?;
        if !self.is_crate() {
            imports::check(&library, &root)?;
        }
        let mut linker = Linker::new(&library, &root)?;
        let mut known = BTreeMap::new();
        let mut one = |item: &str| -> Result<Option<String>, PackageError> {
            let wanted: Vec<Item> =
                parsed.declared(item).map(|index| (root.clone(), index)).collect();
            if wanted.is_empty() {
                return Ok(None);
            }
            let reached = linker.reach(wanted)?;
            let mut all = Hasher::new();
            for item in &reached {
                let own = known.entry(item.clone()).or_insert_with(|| {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(a: &str, b: &str) -> Vec<String> {
        let package = Package::from_modules("m", [("a", a), ("b", b)]);
        let found = package.fingerprints_in("a", &["f", "other"]).expect("it reads");
        found.into_iter().map(|found| found.expect("it is linked")).collect()
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
        let found = package.fingerprints_in("a", &["f", "nothing"]).expect("it reads");
        assert!(found[0].is_some() && found[1].is_none(), "naga says what `g` is");
        let broken =
            Package::from_modules("m", [("a", "import package::b::g;\nfn f() { g(); }\n")]);
        assert!(broken.fingerprints(&BTreeSet::from(["a::f".to_owned()])).is_empty());
    }
}
