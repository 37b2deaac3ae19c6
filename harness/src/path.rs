//! Execution paths: the ways to run a shader.
//!
//! A path consists of an API, an adapter, and the route by which naga translates WGSL for that API: SPIR-V for
//! Vulkan, GLSL for OpenGL, and so on. A process opens each path once. These environment variables select the paths
//! for a check, and limit the time of a run:
//!
//! - `KARAT_PATHS`: names such as `vulkan` or `vulkan,gl`, or `all` for all drivers that open. The default is the
//!   first driver that opens, or else Karat's own engine, `cpu`. A path that you list by name must open, and you can
//!   list it only once. `vulkan@llvmpipe` also names the driver, so several drivers of one API can run in one process.
//! - `KARAT_REQUIRE`: more paths that must run. If one of these paths doesn't open, the check fails with an error.
//! - `KARAT_EXECUTORS`: programs that run jobs, such as `mine=target/debug/mine`. Each program is a path, here
//!   `process@mine`. See [`job`](crate::unstable::job).
//! - `KARAT_ADAPTER`: a part of an adapter's name, to choose one of several adapters.
//! - `KARAT_TIMEOUT`: the number of seconds that a shader may take before the process ends (default 60).
//! - `KARAT_FUEL`: the number of loop iterations that a case may take on `cpu`, for loops without a bound (default
//!   1048576). If a loop might hang a driver, Karat first runs the loop on its engine.

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

/// The reason why Karat can't use a path.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// No path has this name.
    #[error("there is no execution path `{name}`; a path is vulkan, metal, dx12, gl, cpu, dawn, chromium or process@NAME{}",
        guess(nearest.as_deref()))]
    Unknown {
        /// The name that the user wrote.
        name: String,
        /// The existing path with the most similar name.
        nearest: Option<String>,
    },
    /// No route has this name.
    #[error(
        "execution path `{name}` has no route `{via}`: {}{}",
        if name.starts_with("cpu") {
            "use `cpu:fma` or `cpu:ftz`"
        } else {
            "use wgsl, spirv, glsl, hlsl or hlsl-dxc"
        },
        guess(nearest.as_deref())
    )]
    UnknownVia {
        /// The name that the user wrote.
        name: String,
        /// The part of the path's name that should be a route.
        via: String,
        /// The existing route with the most similar name.
        nearest: Option<String>,
    },
    /// The name of the path has an unknown driver family.
    #[error(
        "execution path `{name}` has the unknown driver family `{driver}`{}",
        guess(nearest.as_deref())
    )]
    UnknownDriver {
        /// The name that the user wrote.
        name: String,
        /// The part of the path's name that should be a driver family.
        driver: String,
        /// The existing driver family with the most similar name.
        nearest: Option<String>,
    },
    /// An environment variable lists a path twice.
    #[error("{variable}={names} names `{path}` twice")]
    Repeated {
        /// The environment variable with the list.
        variable: &'static str,
        /// The value of the variable.
        names: String,
        /// The path that is listed twice, or `all`.
        path: String,
    },
    /// The path of a custom executor isn't unique: another executor or one of wgpu's drivers has the same path.
    #[error(
        "another executor already has the path `{path}`: choose another name after the `@`, such as \
         `{}@mine`", path.api().name()
    )]
    Taken {
        /// The path.
        path: Path,
    },
    /// An environment variable has an unusable value.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The user requires the path, but it doesn't open.
    #[error(
        "execution path `{path}` is required, but unavailable: {reason}. `karat doctor` explains how to get this path"
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
        "no execution path opens on this machine ({}): install a GPU driver or Mesa's software \
         rasterisers. `karat doctor` explains how",
        reasons.join("; ")
    )]
    None {
        /// Each path, with the reason why it doesn't open.
        reasons: Vec<String>,
    },
    /// The executor can't run jobs, for example because it doesn't implement `run`.
    #[error("the executor of path `{path}` can't run jobs")]
    NoJobs {
        /// The path.
        path: Path,
    },
    /// Karat can't translate the shader along the path's route, or the engine can't execute it.
    #[error("path `{path}` can't run this shader: {message}")]
    Route {
        /// The path.
        path: Path,
        /// The message of naga, of a compiler that reads naga's output, or of the engine.
        message: String,
    },
    /// The driver doesn't compile the shader, or can't make a pipeline from it.
    #[error("the driver of path `{path}` reports: {message}")]
    Refused {
        /// The path.
        path: Path,
        /// The driver's message.
        message: String,
    },
    /// The translation, the driver or Karat's engine panicked.
    #[error("path `{path}` panics on {subject}: {panicked}")]
    Panicked {
        /// The path.
        path: Path,
        /// The function or entry points that the path ran, with their position.
        subject: String,
        /// The panic.
        panicked: Panicked,
    },
    /// The driver reports another error, such as a lack of memory or a lost device.
    #[error("the driver of path `{path}` reports: {message}")]
    Driver {
        /// The path.
        path: Path,
        /// The driver's message.
        message: String,
    },
}

impl PathError {
    /// Checks if this error is a refusal: the path refused a shader before any part of the shader ran.
    /// `.refused_on(...)` declares such errors. An error that occurs after the driver accepted the shader isn't a
    /// refusal.
    pub(crate) fn is_refusal(&self) -> bool {
        match self {
            Self::Route { .. } | Self::Refused { .. } | Self::NoJobs { .. } => true,
            // naga panicked while it wrote a shader language. Karat's own routes return `Route` instead.
            Self::Panicked { panicked, .. } => panicked.language().is_some(),
            _ => false,
        }
    }
}

/// Runs work that may panic. A panic becomes an error of the path, so other paths still get their verdicts.
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
