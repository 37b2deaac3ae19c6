//! Lists the functions and tests of a package.

use std::sync::Arc;

use super::conditions::Inactive;
use super::function_item::{FunctionItem, functions_of};
use super::library::{Library, ModulePath};
use super::syntax::Module;
use super::{Package, PackageError};
use crate::diagnostic::Span;

impl Package {
    /// All functions of all modules, in the order of modules and lines.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::from_source("m", "fn f() {} @compute @workgroup_size(1) fn main() {}");
    /// let functions = package.functions()?;
    /// assert_eq!((functions[0].name.as_str(), functions[1].entry_point.is_some()), ("f", true));
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if a module can't be read or parsed.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn functions(&self) -> Result<Vec<FunctionItem>, PackageError> {
        let modules = self.modules()?;
        let functions = modules.iter().map(|module| self.functions_in(module));
        Ok(functions.collect::<Result<Vec<_>, _>>()?.concat())
    }

    /// The functions of one module, in the order of lines. For a package's only module, pass `""`.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::from_modules("m", [("tone", "fn map() {}"), ("noise", "fn value() {}")]);
    /// assert_eq!(package.functions_in("tone")?[0].name, "tone::map");
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the module can't be read or parsed.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn functions_in(&self, module: &str) -> Result<Vec<FunctionItem>, PackageError> {
        Ok(functions_of(module, &*self.parsed(module)?))
    }

    /// The tests that conditions remove from the given modules: functions with `@test` under an `@if` or `#ifdef` that
    /// is false. A module that can't be read has no tests.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::from_source("m", "@if(fast) @test fn is_fast() {}");
    /// let left_out = package.tests_left_out(&package.modules()?);
    /// assert_eq!((&*left_out[0].name, &*left_out[0].condition), ("is_fast", "@if(fast)"));
    /// assert!(package.feature("fast", true).tests_left_out(&package.modules()?).is_empty());
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn tests_left_out(&self, modules: &[String]) -> Vec<LeftOut> {
        let mut all = Vec::new();
        for name in modules {
            let Ok(module) = self.parsed(name) else { continue };
            let tests = module.inactive.iter().filter(|inactive| inactive.test);
            all.extend(tests.map(|Inactive { name: item, condition, range, .. }| LeftOut {
                name: if name.is_empty() { item.clone() } else { format!("{name}::{item}") },
                condition: condition.clone(),
                span: Span { file: Arc::clone(&module.file), range: range.clone() },
            }));
        }
        all
    }

    /// The number of functions with `@test` in a module; 0 if the module can't be parsed.
    pub(crate) fn tests_of(&self, module: &str) -> usize {
        let tests = |module: Arc<Module>| module.declarations.iter().filter(|one| one.test).count();
        self.parsed(module).map_or(0, tests)
    }

    /// The location of a module's first test, and the number of the module's tests.
    pub(crate) fn first_test(&self, module: &str) -> Option<(Span, usize)> {
        let parsed = self.parsed(module).ok()?;
        let mut tests = parsed.declarations.iter().filter(|one| one.test);
        let first = tests.next()?;
        Some((parsed.span(first.tokens.start), 1 + tests.count()))
    }

    pub(super) fn parsed(&self, module: &str) -> Result<Arc<Module>, PackageError> {
        let (library, root) = (Library::open(self)?, ModulePath::root(module));
        library.begin(&root)?;
        library.module(&root)
    }
}

/// A test that a condition removes.
///
/// ```
/// # use karat::Package;
/// let package = Package::from_source("m", "@if(fast) @test fn is_fast() {}");
/// let test = package.tests_left_out(&[String::new()]).remove(0);
/// assert_eq!(test.span.to_string(), "<m>:1:1");
/// ```
#[derive(Clone, Debug)]
pub struct LeftOut {
    /// The test's path: `brdf_test::is_fast`.
    pub name: String,
    /// The condition in the author's text: `@if(fast)`.
    pub condition: String,
    /// The location of the condition; for an `#ifdef`, the location of the test's `fn`.
    pub span: Span,
}
