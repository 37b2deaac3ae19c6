//! Lines of `karat.toml` that fix a package.

/// A line of a package's `karat.toml` that may fix the problem of a [`Diagnostic`](super::Diagnostic).
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Mend {
    /// `[features]`: this feature needs a value, which an engine supplies.
    Feature(String),
    /// `[features]`: a name is declared only under a condition with this feature.
    Condition(String),
    /// `[values]`: a placeholder.
    Value(String),
    /// An import: another module declares the name. The text is a sentence that names the module.
    Elsewhere(String),
    /// `[values]`: an undeclared name in capitals, which may be a macro.
    Undeclared(String),
    /// `[values]`: a text that may be empty, such as a placeholder on a line of its own, or a macro before brackets.
    Text(String),
    /// `[dependencies]`: a package that modules import from.
    Dependency(String),
    /// `preprocess`: a program that expands the modules.
    Preprocess,
}
