//! The ways in which a file includes others.

use crate::package::EXTENSIONS;

/// A file that another one includes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::package) enum Include {
    /// By a path relative to the file: `./plane.wgsl`.
    File(String),
    /// By a name: `bbox`.
    Name(String),
    /// By a module's path, in `[join]` of `karat.toml`: the host concatenates both texts.
    Joined(String),
}

impl Include {
    /// The name of the module, without folders.
    pub(in crate::package) fn name(&self) -> &str {
        match self {
            Self::Name(name) | Self::Joined(name) => name,
            Self::File(path) => {
                let file = path.rsplit('/').next().unwrap_or_default();
                without_extension(file)
            }
        }
    }
}

/// A file's name without its module extension.
pub(in crate::package) fn without_extension(file: &str) -> &str {
    let stem = EXTENSIONS.iter().find_map(|known| file.strip_suffix(known)?.strip_suffix('.'));
    stem.unwrap_or(file)
}
