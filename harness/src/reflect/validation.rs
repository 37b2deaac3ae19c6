//! Validates a whole package, including functions that no test uses.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use super::opinion::{self, Judged, Opinion};
use super::{Program, ReflectError, dependence};
use crate::diagnostic::Diagnostic;
use crate::output::counted;
use crate::package::{self, Package, PackageError};

/// The numbers of modules, functions, entry points and tests in a valid package.
#[derive(Clone, Debug, PartialEq)]
pub struct Validated {
    /// The number of modules.
    pub modules: usize,
    /// The number of functions that aren't entry points.
    pub functions: usize,
    /// The number of entry points.
    pub entry_points: usize,
    /// The number of functions with `@test`. Validation doesn't check these functions, but only counts them. Karat
    /// validates a test when the test runs.
    pub tests: usize,
    /// Tint's verdict, and the verdict that follows from WebGPU's limits. If `karat.toml` doesn't require these
    /// verdicts, a package is valid even if they reject one of its modules.
    pub opinion: Opinion,
}

impl fmt::Display for Validated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { modules, functions, entry_points, tests, opinion: _ } = self;
        let (modules, functions) = (counted(*modules, "module"), counted(*functions, "function"));
        write!(f, "{modules}, {functions}, {}", counted(*entry_points, "entry point"))?;
        match tests {
            0 => Ok(()),
            tests => write!(f, ", {}", counted(*tests, "test")),
        }
    }
}

/// The reason why a package isn't valid.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Invalid {
    /// The package can't be read, or has no modules.
    #[error(transparent)]
    Package(#[from] PackageError),
    /// Some modules can't be linked, or naga rejects them. The error lists all of them.
    #[error("{} of {} of package `{package}` {} valid:\n\n{}",
        distinct(errors), counted(*modules, "module"), if distinct(errors) == 1 { "isn't" } else { "aren't" },
        list(errors))]
    Modules {
        /// The package.
        package: String,
        /// The number of the package's modules.
        modules: usize,
        /// Each module that isn't valid, with the reason.
        errors: Vec<(String, ReflectError)>,
        /// Tint's verdicts on the modules, and the verdicts that follow from WebGPU's limits.
        opinion: Box<Opinion>,
    },
    /// `karat.toml` requires Tint's verdict, but Tint has no verdict.
    #[error(
        "package `{package}` requires Tint's verdict, but Tint has no verdict: {reason}\n{remedy}"
    )]
    NoVerdict {
        /// The package.
        package: String,
        /// The reason why Tint has no verdict.
        reason: String,
        /// The remedy.
        remedy: String,
        /// Tint's verdicts on the modules, and the verdicts that follow from WebGPU's limits.
        opinion: Box<Opinion>,
    },
    /// The package has no code to run.
    #[error("package `{package}` declares no function, no entry point and no test")]
    Nothing {
        /// The package.
        package: String,
    },
}

impl Invalid {
    /// Tint's verdicts on the modules, and the verdicts that follow from WebGPU's limits, if there are any.
    #[must_use]
    pub fn opinion(&self) -> Option<&Opinion> {
        match self {
            Self::Modules { opinion, .. } | Self::NoVerdict { opinion, .. } => Some(opinion),
            _ => None,
        }
    }
}

/// The number of modules with errors. One module may have several errors.
fn distinct(errors: &[(String, ReflectError)]) -> usize {
    errors.iter().map(|(module, _)| module).collect::<BTreeSet<_>>().len()
}

fn list(errors: &[(String, ReflectError)]) -> String {
    let mut texts: Vec<String> = Vec::new();
    // An error of the package, or of an imported module, occurs once for each module that it affects.
    for (_, error) in errors {
        let text = error.to_string();
        if !texts.contains(&text) {
            texts.push(text);
        }
    }
    texts.join("\n\n")
}

impl Package {
    /// Validates every module with all its functions and entry points. Unlike [`is_valid`](Self::is_valid), this method
    /// returns the verdict instead of panicking, and doesn't write a record.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let wrong = Package::from_source("m", "fn half(x: f32) -> f32 { return x * vec2u(); }");
    /// assert!(wrong.try_is_valid().is_err());
    /// ```
    ///
    /// # Errors
    /// Returns an error if a module isn't valid: the error has each such module, with the reason. The call also fails
    /// if the package requires Tint's verdict but Tint has no verdict, or if the package has no code.
    pub fn try_is_valid(&self) -> Result<Validated, Invalid> {
        let modules = self.modules()?;
        self.knows_its_validated(&modules)?;
        let compilers = self.compilers().map_err(Invalid::Package)?;
        let count = modules.len();
        let each = modules.into_iter().map(|module| {
            let linked = Program::of_module(&self.for_validating(&module), &module);
            (module, linked)
        });
        let mut each: Vec<_> = each.collect();
        let judged = each.iter_mut().map(|(module, linked)| {
            let judged = match linked {
                Ok(program) => Judged::Valid(program),
                Err(error) => Judged::Rejected(error),
            };
            (module.clone(), judged)
        });
        let opinion = opinion::of(self, &compilers, &mut judged.collect::<Vec<_>>())?;
        let mut found =
            Validated { modules: count, functions: 0, entry_points: 0, tests: 0, opinion };
        let mut errors = Vec::new();
        let mut declared = self.declared().map_err(Invalid::Package)?;
        for (module, linked) in each {
            let program = match linked {
                Ok(program) => program,
                Err(error) => {
                    errors.push((module, error));
                    continue;
                }
            };
            let linked = program.module();
            let own = |name: &str| program.declares(&module, name);
            let functions = linked.functions.iter().filter_map(|(_, f)| f.name.as_deref());
            found.functions += functions.filter(|name| own(name)).count();
            found.entry_points += linked.entry_points.len();
            found.tests += self.for_validating(&module).tests_of(&module);
            if let Some(declared) = &mut declared {
                let linked = program.linked.spliced.text();
                declared.see(self, &module, linked).map_err(Invalid::Package)?;
            }
        }
        let package = self.name();
        errors.extend(found.opinion.faults(&compilers));
        let missing = found.opinion.no_verdict().filter(|_| compilers.require_tint);
        if let (false, Some((reason, remedy))) = (errors.is_empty(), &missing) {
            // If modules have errors, Tint's missing verdict becomes one more error of the first module with errors.
            let message =
                format!("the package requires Tint's verdict, but Tint has no verdict: {reason}");
            let diagnostic = Box::new(Diagnostic::new(message).note(remedy.as_str()));
            errors.push((errors[0].0.clone(), ReflectError::Refused(diagnostic)));
        }
        if !errors.is_empty() {
            let opinion = Box::new(found.opinion);
            return Err(Invalid::Modules { package, modules: count, errors, opinion });
        }
        if let Some((reason, remedy)) = missing {
            let opinion = Box::new(found.opinion);
            return Err(Invalid::NoVerdict { package, reason, remedy, opinion });
        }
        if found.functions + found.entry_points + found.tests == 0 {
            return Err(Invalid::Nothing { package });
        }
        declared.map_or(Ok(()), package::Declared::conclude).map_err(Invalid::Package)?;
        Ok(found)
    }
}

impl Program {
    fn declares(&self, module: &str, name: &str) -> bool {
        let path = self.linked.names.get(name).map_or(name, String::as_str);
        path.rsplit_once("::").map_or("", |(module, _)| module) == module
    }
}

/// Validates a whole module. If `linked` contains only a part of the module, Karat links the whole module again.
pub(crate) fn validate(
    package: &Package,
    module: &str,
    linked: &Arc<Program>,
) -> Result<(), ReflectError> {
    dependence::validity(package, module, linked)
}
