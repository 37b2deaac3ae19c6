//! Execution paths: the ways in which a shader reaches results.
//!
//! A path is a translation route with the API and the adapter that run the result: WGSL through SPIR-V on Vulkan,
//! through GLSL on OpenGL, and so on. A process opens each path once. The environment decides on which paths a check
//! runs:
//!
//! - `KARAT_PATHS`: `vulkan`, `vulkan,gl`, ..., or `all` drivers that open. If it isn't set: the first driver that
//!   opens, or else Karat's own engine, `cpu`. A path that is listed by name must open, and can be listed only once.
//!   `vulkan@llvmpipe` also names the driver, so several drivers of one API can run in one process.
//! - `KARAT_REQUIRE`: paths that must also run; a path that doesn't open is an error.
//! - `KARAT_EXECUTORS`: programs that run jobs, `mine=target/debug/mine`; each is a path, `process@mine`. See
//!   [`job`](crate::unstable::job).
//! - `KARAT_ADAPTER`: part of an adapter's name, to choose among several.
//! - `KARAT_TIMEOUT`: seconds that a shader may take before the process gives up (default 60).
//! - `KARAT_FUEL`: rounds of loops that a case may make on `cpu`, unless the loops have a bound (default 1048576). For
//!   drivers that would hang in an endless loop, the engine runs the loop first.

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

/// The reason why a path can't be used.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// No path has this name.
    #[error("there is no execution path `{name}`; a path is vulkan, metal, dx12, gl, cpu, dawn, chromium or process@NAME{}",
        guess(nearest.as_deref()))]
    Unknown {
        /// The name that was asked for.
        name: String,
        /// The closest path.
        nearest: Option<String>,
    },
    /// No route has this name.
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
        /// The name that was asked for.
        name: String,
        /// The part that should be a route.
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
        /// The name that was asked for.
        name: String,
        /// The part that should be a family.
        driver: String,
        /// The closest family.
        nearest: Option<String>,
    },
    /// A path is named twice.
    #[error("{variable}={names} names `{path}` twice")]
    Repeated {
        /// The variable.
        variable: &'static str,
        /// Its value.
        names: String,
        /// The path, or `all`.
        path: String,
    },
    /// A custom executor has the path of another executor, or of one of wgpu's drivers.
    #[error(
        "another executor is called `{path}` already: choose another name after the `@`, such as \
         `{}@mine`", path.api().name()
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
        /// The reason.
        reason: String,
    },
    /// The path doesn't open.
    #[error("execution path `{path}` is unavailable: {reason}")]
    Unavailable {
        /// The path.
        path: Path,
        /// The reason.
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
    /// The path's route can't translate the shader.
    #[error("path `{path}` doesn't take this shader: {message}")]
    Route {
        /// The path.
        path: Path,
        /// The message of naga, or of the compiler after it.
        message: String,
    },
    /// The driver doesn't compile the shader, or can't make a pipeline of it.
    #[error("the driver of path `{path}` reports: {message}")]
    Refused {
        /// The path.
        path: Path,
        /// Its message.
        message: String,
    },
    /// The path's translation, its driver or Karat's engine panicked.
    #[error("path `{path}` panics at {subject}: {panicked}")]
    Panicked {
        /// The path.
        path: Path,
        /// Its input: a function or entry points, with their place.
        subject: String,
        /// The panic.
        panicked: Panicked,
    },
    /// The driver reports another error, such as a lack of memory or a lost device.
    #[error("the driver of path `{path}` reports: {message}")]
    Driver {
        /// The path.
        path: Path,
        /// Its message.
        message: String,
    },
}

impl PathError {
    /// Returns `true` if the path refuses a shader before any of it runs: `.refused_on(...)` declares that. Errors
    /// after the driver accepted the shader don't count.
    pub(crate) fn is_refusal(&self) -> bool {
        match self {
            Self::Route { .. } | Self::Refused { .. } | Self::NoJobs { .. } => true,
            // naga panicked while it wrote a language. In a route, the error is `Route`.
            Self::Panicked { panicked, .. } => panicked.language().is_some(),
            _ => false,
        }
    }
}

/// Runs a path's work, which may panic. A panic becomes the path's error, so other paths still have their verdicts.
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
