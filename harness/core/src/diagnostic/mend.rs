//! Lines of `karat.toml` that may fix an invalid package.

/// A line in a package's `karat.toml` that may fix the problem of a [`Diagnostic`](super::Diagnostic).
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Mend {
    /// A feature in `[features]` that needs a value. The game engine that uses the shaders, such as Bevy, supplies
    /// this value.
    Feature(String),
    /// A feature in `[features]` that must be on, because a name is declared only under a condition with this feature.
    Condition(String),
    /// A placeholder that needs a value in `[values]`.
    Value(String),
    /// A missing import of a name that another module declares. The text is a sentence that names this module.
    Elsewhere(String),
    /// A name in capitals that no module declares. This name may be a macro, which needs a value in `[values]`.
    Undeclared(String),
    /// The name of a placeholder that stands alone on its line, or of an undeclared macro that is called: `NAME(...)`.
    /// The name needs a value in `[values]`, which may be an empty text.
    Text(String),
    /// A package from which modules import, and which `[dependencies]` must name.
    Dependency(String),
    /// The modules need a program in `preprocess` that expands them.
    Preprocess,
}
