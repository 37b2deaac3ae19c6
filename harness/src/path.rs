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
//! - `KARAT_EXECUTORS`: programs that run jobs, `mine=target/debug/mine`; each is a path, `process@mine`. See
//!   [`job`](crate::unstable::job).
//! - `KARAT_ADAPTER`: part of an adapter's name, to choose among several.
//! - `KARAT_TIMEOUT`: seconds that a shader may take before the process gives up (default 60).
//! - `KARAT_FUEL`: rounds of loops that a case may make on `cpu`, unless they have a bound (default
//!   1048576). On drivers that would stay in an endless loop the engine goes round it first.

pub(crate) mod cpu;
pub(crate) mod deadline;
pub(crate) mod device;
pub(crate) mod driver;
pub(crate) mod name;
pub(crate) mod opened;
pub(crate) mod process;
#[cfg(feature = "routes")]
mod route;
#[cfg(not(feature = "routes"))]
#[path = "path/no_route.rs"]
mod route;
pub(crate) mod selection;
mod selector;
pub mod swiftshader;
pub(crate) mod web;

pub(crate) use crate::reflect::Ability;
pub(crate) use deadline::{Guard, guard, guard_opening};
pub(crate) use device::{Device, MOST_ROUNDS, Pipeline, Turn};
pub(crate) use driver::Adapter;
pub use name::Path;
pub(crate) use name::{Api, Via};
pub(crate) use opened::{Opened, open};
pub(crate) use process::Greeting;
pub(crate) use process::{JOBS, Process};
pub(crate) use selection::{chosen, expect_own};
pub(crate) use selector::Selected;
pub use selector::Selector;

use crate::diagnostic::Span;
use crate::panics::{self, Panicked};
use crate::settings::SettingsError;

/// Why a path can't be used.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// No path of this name.
    #[error("there is no execution path `{name}`; a path is vulkan, metal, dx12, gl, cpu, dawn, chromium or process@NAME{}",
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
