//! The columns of a matrix.

use std::fmt;
use std::str::FromStr;

use karat::path::Path;
use karat::unstable::path::{Api, Via};
use karat_translate::Target;

/// A language that naga writes, and the path that runs it, if there is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Column {
    pub(super) target: Target,
    pub(super) path: Option<Path>,
    /// `true` if Tint checks the author's own text in this column.
    by_tint: bool,
}

/// The name of the column with Tint's verdict on the author's own text.
const TINT: &str = "tint";

/// The text that a column runs or checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Written {
    /// naga's translation.
    ByNaga(Target),
    /// The author's own text, which the engine executes.
    ByAuthor,
    /// The author's own text for Tint, without the kernel that calls a function.
    ForTint,
}

impl Column {
    /// The default columns: each graphics API with its language, the routes on Vulkan, GLSL ES and HLSL 6 (which only
    /// validators check), Tint's verdict on the author's text, and the engine.
    #[must_use]
    pub fn usual() -> Vec<Self> {
        let names = [
            "vulkan",
            "gl",
            "vulkan:wgsl",
            "vulkan:spirv",
            "vulkan:glsl",
            "vulkan:hlsl",
            "dx12",
            "metal",
            "glsl-es",
            "hlsl6",
            TINT,
            "cpu",
        ];
        names.iter().map(|name| name.parse().expect("a path or a language")).collect()
    }

    /// The column of a path; `None` if naga writes no translation for this path.
    fn of_path(path: Path) -> Option<Self> {
        let target = match (path.via(), path.api()) {
            (Via::Direct, Api::Vulkan) | (Via::Spirv, _) => Target::Spirv,
            (Via::Direct, Api::Gl) | (Via::Glsl, _) => Target::Glsl,
            (Via::Direct, Api::Dx12) | (Via::Hlsl, _) => Target::Hlsl,
            (Via::HlslDxc, _) => Target::Hlsl6,
            (Via::Direct, Api::Metal) => Target::Msl,
            (Via::Wgsl, _) => Target::Wgsl,
            // The engine executes naga's module of the author's own text.
            (Via::Direct | Via::Fma | Via::Ftz, Api::Cpu) => Target::Wgsl,
            (Via::Direct, Api::Process) => Target::Wgsl,
            _ => return None,
        };
        Some(Self { target, path: Some(path), by_tint: false })
    }

    /// The name of the language of the column's translations.
    #[must_use]
    pub fn language(self) -> &'static str {
        self.target.name()
    }

    pub(super) fn written(self) -> Written {
        match self.path.map(Path::api) {
            Some(Api::Cpu | Api::Process) => Written::ByAuthor,
            None if self.by_tint => Written::ForTint,
            _ => Written::ByNaga(self.target),
        }
    }

    /// The reason why no path runs this column.
    pub(super) fn without_path(self) -> String {
        match self.by_tint {
            true => "Tint only checks WGSL, and doesn't run shaders".to_owned(),
            false => format!("no path on this machine runs {}", self.target),
        }
    }

    /// The path that runs the column, if there is one.
    #[must_use]
    pub fn path(self) -> Option<Path> {
        self.path
    }
}

impl fmt::Display for Column {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.path {
            Some(path) => path.fmt(f),
            None if self.by_tint => f.pad(TINT),
            None => self.target.fmt(f),
        }
    }
}

/// Parses a path (`vulkan:hlsl`), a language (`msl`) or `tint`.
impl FromStr for Column {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        if name == TINT {
            return Ok(Self { target: Target::Wgsl, path: None, by_tint: true });
        }
        if let Ok(target) = name.parse() {
            return Ok(Self { target, path: None, by_tint: false });
        }
        let path: Path = name.parse().map_err(|error| {
            format!(
                "{error}; a column is a path, `{TINT}`, or one of the languages {}",
                languages()
            )
        })?;
        Self::of_path(path).ok_or_else(|| format!("naga writes no translation for path `{path}`"))
    }
}

fn languages() -> String {
    Target::ALL.map(Target::name).join(", ")
}
