//! The ways in which a file includes other files.

use crate::package::EXTENSIONS;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::package) enum Include {
    /// A path relative to the including file: `./plane.wgsl`.
    File(String),
    /// A name: `bbox`.
    Name(String),
    /// The path of a module whose text the author's program concatenates (`[join]` in `karat.toml`).
    Joined(String),
}

impl Include {
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

pub(in crate::package) fn without_extension(file: &str) -> &str {
    let stem = EXTENSIONS.iter().find_map(|known| file.strip_suffix(known)?.strip_suffix('.'));
    stem.unwrap_or(file)
}
