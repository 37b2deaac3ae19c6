//! Lines of `karat.toml` that mend a package.

/// A line of a package's `karat.toml` that may mend what a [`Diagnostic`](super::Diagnostic) tells.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Mend {
    /// `[features]`: this one needs a value, which an engine gives.
    Feature(String),
    /// `[features]`: a name is declared under a condition with this feature alone.
    Condition(String),
    /// `[values]`: a placeholder.
    Value(String),
    /// An import: another module declares the name. A sentence says which.
    Elsewhere(String),
    /// `[values]`: a name in capitals that nothing declares, which may be a macro.
    Undeclared(String),
    /// `[values]`: a text that may be empty, as a placeholder on a line of its own, or a macro before brackets.
    Text(String),
    /// `[dependencies]`: a package that modules import from.
    Dependency(String),
    /// `preprocess`: a program that expands the modules.
    Preprocess,
}
