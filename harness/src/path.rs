//! Execution paths: the ways in which a shader reaches results.
//!
//! A path is a translation route with the API and adapter that runs it: WGSL through SPIR-V on
//! Vulkan, through GLSL on OpenGL, and so on. Each path is opened once per process. The environment
//! says which paths a check runs on:
//!
//! - `KARAT_PATHS`: `vulkan`, `vulkan,gl`, ..., or `all` drivers that open. Unset: the first driver
//!   that opens; where none does, Karat's own engine, `cpu`. A path listed by name must open, and may be listed once only. `vulkan@llvmpipe` also
//!   names the driver, so several drivers of one API can run in one process.
//! - `KARAT_REQUIRE`: paths that must run, too; one that doesn't open is an error.
//! - `KARAT_EXECUTORS`: programs that run jobs, `dawn=node dawn.mjs`; each is a path, `process@dawn`. See
//!   [`job`](crate::unstable::job).
//! - `KARAT_ADAPTER`: part of an adapter's name, to choose among several.
//! - `KARAT_TIMEOUT`: seconds that a shader may take before the process gives up (default 60).
//! - `KARAT_FUEL`: rounds of loops that a case may make on `cpu`, unless they have a bound (default
//!   1048576). On drivers that would stay in an endless loop the engine goes round it first.

pub(crate) mod cpu;
pub(crate) mod deadline;
pub(crate) mod device;
mod driver;
mod name;
pub(crate) mod opened;
pub(crate) mod process;
#[cfg(feature = "routes")]
mod route;
#[cfg(not(feature = "routes"))]
#[path = "path/no_route.rs"]
mod route;
pub(crate) mod selection;
mod selector;

pub(crate) use crate::reflect::Ability;
pub(crate) use deadline::{Guard, guard, guard_opening};
pub(crate) use device::{Device, MOST_ROUNDS, Pipeline, Turn};
pub use driver::Adapter;
pub use name::{Api, Path, Via};
pub(crate) use opened::{Opened, open};
pub(crate) use process::Greeting;
pub(crate) use process::{JOBS, Process};
pub(crate) use selector::Selected;
pub use selector::Selector;

use crate::diagnostic::Span;
use crate::panics::{self, Panicked};
use crate::settings::{self, Settings, SettingsError};

/// Why a path can't be used.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// No path of this name.
    #[error("there is no execution path `{name}`; a path is vulkan, metal, dx12, gl, cpu or process@NAME{}",
        guess(nearest.as_deref()))]
    Unknown {
        /// What was asked for.
        name: String,
        /// The closest path.
        nearest: Option<String>,
    },
    /// No route of this name.
    #[error(
        "execution path `{name}` has no route `{via}`; {}{}",
        if name.starts_with("cpu") {
            "behind `cpu:` is fma or ftz"
        } else {
            "the routes are wgsl, spirv, glsl, hlsl and hlsl-dxc"
        },
        guess(nearest.as_deref())
    )]
    UnknownVia {
        /// What was asked for.
        name: String,
        /// What should be a route.
        via: String,
        /// The closest route.
        nearest: Option<String>,
    },
    /// No family of drivers has this name.
    #[error(
        "execution path `{name}` names no family of drivers: `{driver}` isn't one{}",
        guess(nearest.as_deref())
    )]
    UnknownDriver {
        /// What was asked for.
        name: String,
        /// What should be a family.
        driver: String,
        /// The closest family.
        nearest: Option<String>,
    },
    /// A path is named twice.
    #[error("{variable}={names} names `{path}` twice")]
    Repeated {
        /// The variable.
        variable: &'static str,
        /// What it is set to.
        names: String,
        /// The path, or `all`.
        path: String,
    },
    /// A custom executor has the path of another executor, or of one of wgpu's drivers.
    #[error(
        "another executor is called `{path}` already: name this one by its maker, such as \
         `{}@mine`, or `cpu`", path.api().name()
    )]
    Taken {
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
    /// The executor runs no jobs.
    #[error("path `{path}` runs no jobs")]
    NoJobs {
        /// The path.
        path: Path,
    },
    /// The path's route doesn't take the shader.
    #[error("path `{path}` doesn't take this shader: {message}")]
    Route {
        /// The path.
        path: Path,
        /// What naga, or the compiler behind it, says.
        message: String,
    },
    /// The driver doesn't compile the shader, or makes no pipeline of it.
    #[error("the driver of path `{path}` reports: {message}")]
    Refused {
        /// The path.
        path: Path,
        /// Its message.
        message: String,
    },
    /// Its translation, its driver or Karat's engine panics.
    #[error("path `{path}` panics at {subject}: {panicked}")]
    Panicked {
        /// The path.
        path: Path,
        /// What it was given: a function or entry points, with their place.
        subject: String,
        /// The panic.
        panicked: Panicked,
    },
    /// The driver reports an error of anything else, such as memory or a lost device.
    #[error("the driver of path `{path}` reports: {message}")]
    Driver {
        /// The path.
        path: Path,
        /// Its message.
        message: String,
    },
}

impl PathError {
    /// True if the path refuses a shader before any of it runs: `.refused_on(...)` declares that. Errors of a
    /// driver that has taken the shader don't count.
    pub(crate) fn is_refusal(&self) -> bool {
        match self {
            Self::Route { .. } | Self::Refused { .. } | Self::NoJobs { .. } => true,
            // Of a route's translation it is `Route`.
            Self::Panicked { panicked, .. } => panicked.language().is_some(),
            _ => false,
        }
    }
}

/// Has a path do its part, which may panic: then that is the path's error, and other paths have their verdicts.
pub(crate) fn caught<T, E: From<PathError>>(
    path: Path,
    names: &[&str],
    span: Option<&Span>,
    work: impl FnOnce() -> Result<T, E>,
) -> Result<T, E> {
    panics::caught(work).unwrap_or_else(|panicked| {
        let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
        let place = span.map_or_else(String::new, |span| format!(" ({span})"));
        let subject = format!("{}{place}", names.join(", "));
        Err(PathError::Panicked { path, subject, panicked }.into())
    })
}

fn guess(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

/// The adapter of a path.
///
/// ```no_run
/// use karat::Path;
///
/// let adapter = karat::path::adapter(Path::VULKAN)?;
/// println!("{adapter}"); // vulkan: NVIDIA GeForce ..., 580.95
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// If the path doesn't open.
pub fn adapter(path: Path) -> Result<Adapter, PathError> {
    open(path).map(Opened::adapter)
}

/// A path that was asked for by name.
///
/// ```no_run
/// use karat::Path;
///
/// let adapter = karat::path::required("vulkan@nvidia".parse::<Path>()?)?;
/// println!("{adapter}");
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// If it doesn't open; the message says that it is required.
pub fn required(path: Path) -> Result<Adapter, PathError> {
    must_open(path).map(Opened::adapter)
}

fn must_open(path: Path) -> Result<Opened, PathError> {
    open(path).map_err(|error| match error {
        PathError::Unavailable { path, reason } => PathError::Required { path, reason },
        other => other,
    })
}

/// The paths that a check runs on, as the environment says. Never empty.
///
/// ```no_run
/// for path in karat::path::selected()? {
///     println!("checks run on {path}");
/// }
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// If a setting is wrong, a required path doesn't open, or none does.
pub fn selected() -> Result<Vec<Path>, PathError> {
    Ok(chosen()?.into_iter().map(Opened::path).collect())
}

/// What the [`selected`] paths are run by.
pub(crate) fn chosen() -> Result<Vec<Opened>, PathError> {
    let Settings { paths, require, adapter, .. } = settings::current()?;
    let unasked = [paths, require, adapter].iter().all(|setting| setting.is_none());
    match select(paths.as_deref(), require.as_deref()) {
        // No driver was asked for, and there is none.
        Err(PathError::None { .. }) if unasked => open(Path::CPU).map(|engine| vec![engine]),
        chosen => chosen,
    }
}

fn select(paths: Option<&str>, required: Option<&str>) -> Result<Vec<Opened>, PathError> {
    let required = required.map_or_else(|| Ok(Vec::new()), |names| list("KARAT_REQUIRE", names))?;
    let named = paths.map_or_else(|| Ok(Vec::new()), |names| list("KARAT_PATHS", names))?;
    let drivers = || Path::ALL.into_iter().filter_map(|path| open(path).ok());
    let mut chosen: Vec<Opened> =
        required.into_iter().chain(named).map(must_open).collect::<Result<_, _>>()?;
    let is_all = paths.is_some_and(|names| names.split(',').any(|name| name.trim() == ALL));
    let usual: Vec<Opened> = match paths {
        _ if is_all => drivers().collect(),
        None if chosen.is_empty() => drivers().take(1).collect(),
        _ => Vec::new(),
    };
    // `all` drivers are some, even beside other paths.
    let none = usual.is_empty() && !chosen.iter().any(|opened| opened.device().is_some());
    if none && (is_all || chosen.is_empty()) {
        let reasons = Path::ALL
            .iter()
            .filter(|path| device::exists(**path))
            .filter_map(|path| open(*path).err().map(|error| error.to_string()))
            .collect();
        return Err(PathError::None { reasons });
    }
    chosen.extend(usual);
    chosen.sort_by_key(|opened| opened.path());
    chosen.dedup_by_key(|opened| opened.path());
    Ok(distinct(&chosen))
}

/// Each adapter of an API once: `vulkan` is dropped beside `vulkan@llvmpipe`, if that is what it
/// is.
fn distinct(all: &[Opened]) -> Vec<Opened> {
    let what = |opened: &Opened| {
        let (path, adapter) = (opened.path(), opened.adapter());
        (path.api(), path.via(), adapter.name, adapter.driver)
    };
    let named: Vec<_> =
        all.iter().filter(|opened| opened.path().driver().is_some()).map(what).collect();
    let stays =
        |opened: &Opened| opened.path().driver().is_some() || !named.contains(&what(opened));
    all.iter().copied().filter(stays).collect()
}

/// Wants names for executors that aren't wgpu's: none that a driver has, and each once. What the
/// environment says of drivers is read for slips.
pub(crate) fn expect_own(paths: impl Iterator<Item = Path>) -> Result<(), PathError> {
    let settings = settings::current()?;
    for (variable, names) in
        [("KARAT_PATHS", &settings.paths), ("KARAT_REQUIRE", &settings.require)]
    {
        names.as_deref().map_or(Ok(Vec::new()), |names| list(variable, names))?;
    }
    let mut known = Vec::new();
    for path in paths {
        if Path::ALL.contains(&path) || known.contains(&path) {
            return Err(PathError::Taken { path });
        }
        known.push(path);
    }
    Ok(())
}

/// The paths that a list names, in the format of `KARAT_PATHS`: `all` means all that open.
///
/// ```no_run
/// use karat::Path;
///
/// assert_eq!(karat::path::named("KARAT_PATHS", "vulkan,gl")?, [Path::VULKAN, Path::GL]);
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// If a name isn't a path, or is listed twice.
pub fn named(variable: &'static str, names: &str) -> Result<Vec<Path>, PathError> {
    let mut paths = list(variable, names)?;
    if names.split(',').any(|name| name.trim() == ALL) {
        let open = Path::ALL.into_iter().filter(|path| open(*path).is_ok());
        paths.extend(open.filter(|path| !paths.contains(path)).collect::<Vec<_>>());
    }
    Ok(paths)
}

/// The paths of the programs that `KARAT_EXECUTORS` names.
///
/// ```
/// for path in karat::path::programs()? {
///     println!("{path}"); // process@dawn
/// }
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// If a setting is wrong.
pub fn programs() -> Result<Vec<Path>, PathError> {
    let names = settings::current()?.executors.iter();
    names.map(|(name, _)| format!("{}@{name}", Api::Process.name()).parse()).collect()
}

/// What stands for every path that opens.
const ALL: &str = "all";

/// The paths that a list names, each of them once.
fn list(variable: &'static str, names: &str) -> Result<Vec<Path>, PathError> {
    let repeated = |path: String| PathError::Repeated { variable, names: names.to_owned(), path };
    let (mut paths, mut all) = (Vec::new(), false);
    for name in names.split(',').map(str::trim) {
        if name == ALL {
            if std::mem::replace(&mut all, true) {
                return Err(repeated(ALL.to_owned()));
            }
            continue;
        }
        let path: Path = name.parse()?;
        if paths.contains(&path) {
            return Err(repeated(path.to_string()));
        }
        paths.push(path);
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_read_whole() {
        let names = |names: &str| list("KARAT_PATHS", names);
        assert_eq!(names("gl, vulkan").ok(), Some(vec![Path::GL, Path::VULKAN]));
        assert_eq!(names("all").ok(), Some(Vec::new()));
        for (wrong, message) in [
            ("gl,gl", "KARAT_PATHS=gl,gl names `gl` twice"),
            ("all,gl,all", "KARAT_PATHS=all,gl,all names `all` twice"),
            ("all,vulcan", "there is no execution path `vulcan`"),
            ("vulkan,", "there is no execution path ``"),
        ] {
            let error = names(wrong).expect_err(wrong).to_string();
            assert!(error.starts_with(message), "{error}");
        }
        for (paths, required) in
            [(Some("cpu"), None), (None, Some("cpu")), (Some(" cpu"), Some("cpu"))]
        {
            let chosen = select(paths, required).expect("it is always there");
            assert!(matches!(&*chosen, [Opened::Cpu(Path::CPU)]), "{chosen:?}");
        }
        for names in ["all,vulcan", "vulkan,opengl"] {
            assert!(matches!(select(Some(names), None), Err(PathError::Unknown { .. })));
        }
    }

    /// A list is every path that it names, in one order, however they are listed.
    #[test]
    fn each_path_of_a_list_is_run() {
        let here: Vec<Path> = Path::ALL.into_iter().filter(|path| open(*path).is_ok()).collect();
        let named = |paths: &[Path]| -> Vec<Path> {
            let names: Vec<&str> = paths.iter().map(|path| path.name()).collect();
            let opened = select(Some(&names.join(",")), None).expect("they open");
            opened.into_iter().map(Opened::path).collect()
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

    /// A path by its driver is an adapter of that family, beside the others of its API; a route or
    /// a driver that isn't there is an error, and never another one.
    #[test]
    fn a_path_is_of_the_driver_that_it_names() {
        let here = Path::ALL.into_iter().filter_map(|path| open(path).ok());
        for device in here {
            let family = device.adapter().family();
            let named: Path = format!("{}@{family}", device.path()).parse().expect("a family");
            let same = open(named).expect("it is here");
            assert_eq!(same.adapter().name, device.adapter().name);
            assert_eq!(same.adapter().path, named.to_string());
            // It runs once, whether it is required, one of all, or listed.
            for (paths, required) in
                [(format!("all,{named}"), None), (named.to_string(), Some(device.path()))]
            {
                let required = required.map(Path::name);
                let selected = select(Some(&paths), required).expect("they open");
                let paths: Vec<Path> = selected.iter().map(|device| device.path()).collect();
                assert!(paths.contains(&named) && !paths.contains(&device.path()), "{paths:?}");
            }
            let nobody: Path = format!("{}@nobody", device.path()).parse().expect("a name");
            let error = open(nobody).expect_err("no such driver").to_string();
            assert!(error.contains("no adapter of the family `nobody`"), "{error}");
        }
        let engine: Path = "cpu:hlsl".parse().expect("a name");
        let error = open(engine).expect_err("there is no such engine").to_string();
        assert!(error.contains("`cpu:hlsl` is unavailable"), "{error}");
    }
}
