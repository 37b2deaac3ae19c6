//! Execution paths: the ways in which a shader reaches results.
//!
//! A path is a translation route with the API and adapter that runs it: WGSL through SPIR-V on
//! Vulkan, through GLSL on OpenGL, and so on. Each path is opened once a process. Which paths a
//! check runs on is read from the environment:
//!
//! - `KARAT_PATHS`: `vulkan`, `vulkan,gl`, ..., or `all` available ones. Unset: the first that
//!   opens. A path listed by name must open, and is named once.
//! - `KARAT_REQUIRE`: paths that must have run; one that doesn't open is an error.
//! - `KARAT_ADAPTER`: part of an adapter's name, to choose among several.
//! - `KARAT_DEADLINE`: seconds that a shader may take before the process gives up (default 60).

mod deadline;
mod device;

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

pub(crate) use deadline::{Guard, guard};
pub(crate) use device::{Device, MOST_ROUNDS, Turn};

use crate::diagnostic::nearest;
use crate::settings::{self, SettingsError};

/// An execution path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Path {
    /// WGSL to SPIR-V, on Vulkan.
    Vulkan,
    /// WGSL to MSL, on Metal.
    Metal,
    /// WGSL to HLSL, on Direct3D 12.
    Dx12,
    /// WGSL to GLSL, on OpenGL or OpenGL ES.
    Gl,
}

impl Path {
    /// All paths, in the order in which a default is looked for.
    pub const ALL: [Self; 4] = [Self::Vulkan, Self::Metal, Self::Dx12, Self::Gl];

    /// The name used on the command line and in the environment.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Vulkan => "vulkan",
            Self::Metal => "metal",
            Self::Dx12 => "dx12",
            Self::Gl => "gl",
        }
    }

    /// Whether this platform can have the path at all.
    #[must_use]
    pub fn exists(self) -> bool {
        wgpu::Instance::enabled_backend_features().contains(self.backends())
    }

    fn backends(self) -> wgpu::Backends {
        match self {
            Self::Vulkan => wgpu::Backends::VULKAN,
            Self::Metal => wgpu::Backends::METAL,
            Self::Dx12 => wgpu::Backends::DX12,
            Self::Gl => wgpu::Backends::GL,
        }
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Path {
    type Err = PathError;

    fn from_str(name: &str) -> Result<Self, PathError> {
        Self::ALL.into_iter().find(|path| path.name() == name).ok_or_else(|| PathError::Unknown {
            name: name.to_owned(),
            nearest: nearest(name, Self::ALL.map(Self::name)).map(str::to_owned),
        })
    }
}

/// Why a path can't be used.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// No path of this name.
    #[error("there is no execution path `{name}`; the paths are vulkan, metal, dx12 and gl{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    Unknown {
        /// What was asked for.
        name: String,
        /// The closest path.
        nearest: Option<String>,
    },
    /// A path is named twice.
    #[error("{variable}={names} names `{path}` twice")]
    Repeated {
        /// The variable.
        variable: &'static str,
        /// What it is set to.
        names: String,
        /// The path.
        path: Path,
    },
    /// The environment has a setting that can't be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The path was asked for by name, but doesn't open.
    #[error(
        "execution path `{path}` is required, but unavailable: {reason}; `karat doctor` tells how to get it"
    )]
    Required {
        /// The path.
        path: Path,
        /// Why it doesn't open.
        reason: String,
    },
    /// The path doesn't open.
    #[error("execution path `{path}` is unavailable: {reason}")]
    Unavailable {
        /// The path.
        path: Path,
        /// Why it doesn't open.
        reason: String,
    },
    /// No path opens.
    #[error(
        "no execution path opens on this machine ({}); install a GPU driver or Mesa's software \
         rasterisers: `karat doctor` tells how",
        reasons.join("; ")
    )]
    None {
        /// Each path with its reason.
        reasons: Vec<String>,
    },
    /// The driver refused something.
    #[error("the driver of path `{path}` reports: {message}")]
    Driver {
        /// The path.
        path: Path,
        /// Its message.
        message: String,
    },
}

/// An opened path, as reported with each verdict.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Adapter {
    /// Name of the path.
    pub path: String,
    /// Name of the adapter: `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// Driver and version: `llvmpipe Mesa 22.3.6`.
    pub driver: String,
    /// Whether it is a software rasteriser.
    pub software: bool,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path, self.name)?;
        if self.driver.is_empty() { Ok(()) } else { write!(f, ", {}", self.driver) }
    }
}

/// Opens a path, once a process.
pub(crate) fn open(path: Path) -> Result<&'static Device, PathError> {
    settings::current()?;
    static DEVICES: [OnceLock<Result<Device, PathError>>; Path::ALL.len()] =
        [const { OnceLock::new() }; Path::ALL.len()];
    let index = Path::ALL.iter().position(|known| *known == path).expect("ALL holds each path");
    DEVICES[index].get_or_init(|| Device::open(path)).as_ref().map_err(Clone::clone)
}

/// The adapter of a path.
///
/// # Errors
/// If the path doesn't open.
pub fn adapter(path: Path) -> Result<Adapter, PathError> {
    open(path).map(|device| device.adapter().clone())
}

/// A path that was asked for by name.
///
/// # Errors
/// If it doesn't open, which says that it is required.
pub fn required(path: Path) -> Result<Adapter, PathError> {
    must_open(path).map(|device| device.adapter().clone())
}

fn must_open(path: Path) -> Result<&'static Device, PathError> {
    open(path).map_err(|error| match error {
        PathError::Unavailable { path, reason } => PathError::Required { path, reason },
        other => other,
    })
}

/// The paths that a check runs on, as the environment says. Never empty.
///
/// # Errors
/// If a setting is wrong, a required path doesn't open, or none does.
pub fn selected() -> Result<Vec<Path>, PathError> {
    Ok(devices()?.into_iter().map(Device::path).collect())
}

/// The devices of the [`selected`] paths.
pub(crate) fn devices() -> Result<Vec<&'static Device>, PathError> {
    let settings = settings::current()?;
    select(settings.paths.as_deref(), settings.require.as_deref())
}

fn select(paths: Option<&str>, required: Option<&str>) -> Result<Vec<&'static Device>, PathError> {
    let required = required.map_or_else(|| Ok(Vec::new()), |names| list("KARAT_REQUIRE", names))?;
    let mut devices =
        required.iter().map(|path| must_open(*path)).collect::<Result<Vec<_>, _>>()?;
    match paths {
        Some(names) => {
            if names.split(',').any(|name| name.trim() == ALL) {
                devices.extend(Path::ALL.iter().filter_map(|path| open(*path).ok()));
            }
            for path in list("KARAT_PATHS", names)? {
                devices.push(must_open(path)?);
            }
        }
        None if devices.is_empty() => {
            devices.extend(Path::ALL.iter().find_map(|path| open(*path).ok()));
        }
        None => {}
    }
    devices.sort_by_key(|device| device.path());
    devices.dedup_by_key(|device| device.path());
    if devices.is_empty() {
        let reasons = Path::ALL
            .iter()
            .filter(|path| path.exists())
            .filter_map(|path| open(*path).err().map(|error| error.to_string()))
            .collect();
        return Err(PathError::None { reasons });
    }
    Ok(devices)
}

/// What stands for every path that opens.
const ALL: &str = "all";

/// The paths that a list names, each of them once.
fn list(variable: &'static str, names: &str) -> Result<Vec<Path>, PathError> {
    let mut paths = Vec::new();
    for name in names.split(',').map(str::trim).filter(|name| *name != ALL) {
        let path = name.parse()?;
        if paths.contains(&path) {
            return Err(PathError::Repeated { variable, names: names.to_owned(), path });
        }
        paths.push(path);
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_paths_are_named_with_the_nearest() {
        let error = "vulcan".parse::<Path>().expect_err("no such path");
        assert_eq!(
            error.to_string(),
            "there is no execution path `vulcan`; the paths are vulkan, metal, dx12 and gl; did \
             you mean `vulkan`?"
        );
        assert!(matches!(select(Some("vulkan,opengl"), None), Err(PathError::Unknown { .. })));
    }

    #[test]
    fn lists_are_read_whole() {
        let names = |names: &str| list("KARAT_PATHS", names);
        assert_eq!(names("gl, vulkan").ok(), Some(vec![Path::Gl, Path::Vulkan]));
        assert_eq!(names("all").ok(), Some(Vec::new()));
        for (wrong, message) in [
            ("gl,gl", "KARAT_PATHS=gl,gl names `gl` twice"),
            ("all,vulcan", "there is no execution path `vulcan`"),
            ("vulkan,", "there is no execution path ``"),
        ] {
            let error = names(wrong).expect_err(wrong).to_string();
            assert!(error.starts_with(message), "{error}");
        }
        assert!(matches!(select(Some("all,vulcan"), None), Err(PathError::Unknown { .. })));
    }

    /// A list is every path that it names, in one order, however they are listed.
    #[test]
    fn each_path_of_a_list_is_run() {
        let here: Vec<Path> = Path::ALL.into_iter().filter(|path| open(*path).is_ok()).collect();
        let named = |paths: &[Path]| -> Vec<Path> {
            let names: Vec<&str> = paths.iter().map(|path| path.name()).collect();
            let devices = select(Some(&names.join(",")), None).expect("they open");
            devices.into_iter().map(|device| device.path()).collect()
        };
        let backwards: Vec<Path> = here.iter().rev().copied().collect();
        assert_eq!((named(&here), named(&backwards)), (here.clone(), here.clone()));
        let required = select(None, Some("vulkan,gl").filter(|_| here.len() > 1));
        assert!(here.len() < 2 || required.is_ok_and(|devices| devices.len() == 2));
    }

    #[test]
    fn a_required_path_that_cannot_exist_is_an_error() {
        let foreign = if cfg!(target_os = "macos") { "dx12" } else { "metal" };
        let error = select(Some("all"), Some(foreign)).expect_err("not on this platform");
        assert!(matches!(error, PathError::Required { .. }), "{error}");
        assert!(select(Some(foreign), None).is_err(), "a path listed by name must open");
    }
}
