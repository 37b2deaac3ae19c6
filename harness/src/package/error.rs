//! The errors of reading or linking a package.

use crate::diagnostic::Diagnostic;
use crate::output::one_line;

/// The reason why a package can't be read or linked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PackageError {
    /// The folder or file doesn't exist.
    #[error("there is no folder or file `{0}`")]
    NoFolder(String),
    /// A test names a folder that doesn't exist.
    #[error(
        "the shader folder `{0}` doesn't exist: write a path relative to Cargo.toml in `karat::package!`"
    )]
    Missing(String),
    /// The folder has no modules.
    #[error(
        "the shader folder `{0}` has no .wgsl or .wesl file: name the folder that has your shaders"
    )]
    Empty(String),
    /// A module can't be read.
    #[error("can't read `{file}`: {cause}")]
    Unreadable {
        /// The file.
        file: String,
        /// The reason.
        cause: std::io::Error,
    },
    /// A module isn't UTF-8.
    #[error("`{file}` isn't UTF-8 text: line {line} has an invalid byte; save the file as UTF-8")]
    NotUtf8 {
        /// The file.
        file: String,
        /// The first line that can't be decoded, counted from 1.
        line: usize,
    },
    /// A `karat.toml` can't be used.
    #[error("`{file}` can't be used: {reason}")]
    Manifest {
        /// The file.
        file: String,
        /// The reason.
        reason: String,
    },
    /// The program that expands modules (`preprocess` in `karat.toml`) failed.
    #[error("`{program}`, the `preprocess` program of karat.toml, fails for `{file}`: {reason}")]
    Preprocess {
        /// The module's file.
        file: String,
        /// The program.
        program: String,
        /// The program's message.
        reason: String,
    },
    /// A `//karat:` line with an assertion or a print has an error.
    #[error("{place}: {reason}. Write `//karat: print x` or `//karat: assert x >= 0.0`")]
    Asserts {
        /// The line's position.
        place: String,
        /// The reason.
        reason: String,
    },
    /// Karat can't find the shaders of a crate.
    #[error("Karat can't open the shaders of crate `{name}`: {reason}")]
    Crate {
        /// The name of the crate.
        name: String,
        /// The reason.
        reason: String,
    },
    /// A module begins with a byte order mark.
    #[error("`{file}` begins with a byte order mark (U+FEFF): save the file as UTF-8 without one")]
    ByteOrderMark {
        /// The file.
        file: String,
    },
    /// An import names a package that isn't a dependency.
    #[error(
        "package `{package}` has no dependency `{name}`{}; declare the dependency with `depends_on`, or under \
         `[dependencies]` in the package's `karat.toml`",
        did_you_mean(nearest)
    )]
    UnknownPackage {
        /// The name in the import.
        name: String,
        /// The package with the import.
        package: String,
        /// The existing name that is most similar.
        nearest: Option<String>,
    },
    /// A path names a module that the package doesn't have.
    #[error(
        "package `{}` has no module `{}`{}",
        one_line(package), one_line(module), one_line(&did_you_mean(nearest))
    )]
    UnknownModule {
        /// The name in the path.
        module: String,
        /// The package.
        package: String,
        /// The existing name that is most similar.
        nearest: Option<String>,
    },
    /// An import names a path that no module declares for itself.
    #[error("no module declares `#define_import_path {path}`{}", did_you_mean(nearest))]
    NotComposed {
        /// The path in the import.
        path: String,
        /// The existing path that is most similar.
        nearest: Option<String>,
    },
    /// Two modules of one package declare the same path for themselves.
    #[error(
        "modules `{first}` and `{second}` both declare `#define_import_path {path}`: give one module another path"
    )]
    ComposedTwice {
        /// The path.
        path: String,
        /// One module.
        first: String,
        /// The other module.
        second: String,
    },
    /// A path names a function that the package doesn't have.
    #[error(
        "package `{package}` has no function `{path}` (functions in the package: {count}){}",
        did_you_mean(nearest)
    )]
    UnknownFunction {
        /// The path in the test.
        path: String,
        /// The package.
        package: String,
        /// The existing name that is most similar.
        nearest: Option<String>,
        /// The number of functions in the package.
        count: usize,
    },
    /// A function is under a condition that is false.
    #[error(
        "`{path}` of package `{package}` is declared under `{condition}`, which is false: set \
         the feature, with `.feature(..)` in Rust or `--feature` in a command"
    )]
    Inactive {
        /// The path in the test.
        path: String,
        /// The package.
        package: String,
        /// The condition in the author's text.
        condition: String,
    },
    /// No condition uses a feature.
    #[error(
        "no condition in package `{package}` or in its imports uses the feature{} {}{}{}{}",
        if unknown.len() == 1 { "" } else { "s" }, listed(unknown),
        if known.is_empty() { String::new() } else { format!("; the package's conditions use {known}") },
        misspelt.as_ref().map_or_else(String::new, |text| format!("\n`{text}` isn't a condition: write `@if` or `@elif`")),
        bare.as_ref().map_or_else(String::new, |name| format!(
            "\na feature can't replace the name `{name}` in the shader: write the value into karat.toml \
             beside the modules\n\n[values]\n{name} = 64"
        ))
    )]
    UnknownFeature {
        /// The names of the features, each with the most similar existing name.
        unknown: Vec<(String, Option<String>)>,
        /// The package.
        package: String,
        /// An attribute that looks like a misspelt condition with one of the unknown features: `@iff(fast)`.
        misspelt: Option<Box<str>>,
        /// One of the unknown features, if a module uses the feature's name as an ordinary identifier.
        bare: Option<Box<str>>,
        /// The features that the package's conditions use.
        known: Box<str>,
    },
    /// A path goes above the root of its package.
    #[error("`super` goes above the root of package `{package}`")]
    AboveRoot {
        /// The package.
        package: String,
    },
    /// Two modules, or two dependencies, have the same name.
    #[error("package `{package}` has two {what}: give one of them another name")]
    Twice {
        /// The package.
        package: String,
        /// The kind and the shared name, as text for the message: ``modules named `brdf` ``.
        what: String,
    },
    /// A `.wgsl` or `.wesl` file can't be a module.
    #[error("`{file}` can't be a module: {reason}")]
    NoModule {
        /// The file.
        file: String,
        /// The reason.
        reason: &'static str,
    },
    /// The folder in `KARAT_OVERLAY` can't replace modules of the package.
    #[error("the overlay `{folder}` (KARAT_OVERLAY) {reason}")]
    Overlay {
        /// The folder.
        folder: String,
        /// The reason.
        reason: String,
    },
    /// A syntax error, a failed import or an import cycle, shown in the author's file.
    #[error("{0}")]
    Shader(Box<Diagnostic>),
}

fn listed(unknown: &[(String, Option<String>)]) -> String {
    match unknown {
        [(name, near)] => format!("`{name}`{}", did_you_mean(near)),
        all => {
            let one = |(name, near): &(String, Option<String>)| match near {
                Some(near) => format!("`{name}` (did you mean `{near}`?)"),
                None => format!("`{name}`"),
            };
            all.iter().map(one).collect::<Vec<_>>().join(", ")
        }
    }
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}
