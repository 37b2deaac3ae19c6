//! Karat tests WGSL shaders from Rust: functions against references, frames against goldens.
//!
//! ```no_run
//! use karat::prelude::*;
//!
//! static SHADERS: Package = karat::package!("shaders"); // a folder beside Cargo.toml
//!
//! // #[test]
//! fn lambert_is_what_the_textbook_says() {
//!     SHADERS
//!         .function("brdf::lambert")
//!         .over((0.0..=1.0, 0.0..=1.0)) // albedo, n_dot_l: seeded, edge-biased, one dispatch
//!         .agrees_with(|albedo: f64, n_dot_l: f64| albedo / std::f64::consts::PI * n_dot_l, Ulp(4.0));
//! }
//! ```
//!
//! A check is a plain `#[test]`. It links the function's closure from the shader folder, compares
//! its signature with the domain and the reference, generates a compute kernel, runs it on each
//! selected execution path ([`Path`]) and compares the results with the reference, which computes
//! in `f64` from the same `f32` arguments.
//!
//! What can be asserted is on [`Check`] and [`Integral`]; where arguments come from on [`Domain`];
//! how far results may differ on [`Tolerance`]; what else a function may read on [`Fixture`].
//! Frames that differ are looked at with [`review`].

mod check;
mod diagnostic;
mod domain;
mod fixture;
mod frame;
mod gallery;
mod golden;
mod image;
mod metric;
mod output;
mod package;
mod path;
mod probe;
pub mod record;
mod reflect;
pub mod review;
mod run;
mod settings;
pub mod stats;
mod tolerance;
mod value;

pub use check::{
    Agreement, Argument, CaseFailure, Census, Check, ConfigurationRejection, Direction, Directions,
    Disagreement, Failure, Finding, Fit, Integral, IntegralFailure, Limit, NodeFailure,
    PathDisagreement, PathRejection, Power, Probe, Reference, Rejection, Samples, Simplest,
};
pub use diagnostic::{Diagnostic, SourceFile, Span};
pub use domain::{
    AnyF32, Domain, Edges, Filter, Grid, Hemisphere, Integers, Just, LatinHypercube, Map, OneOf,
    Origin, Shrinkable, Source, UnitRgb, UnitVector,
};
pub use fixture::{
    CubeMap, CubeMapError, Fixture, FixtureError, Sampler, Storage, Texture, Uniform,
};
pub use frame::{Attribute, Blend, Frame, FrameAgreement, FrameError, FrameMean, Mesh};
#[doc(hidden)] // how the binary and galleries read the same arguments
pub use gallery::{ExposureArguments, RenderArguments};
pub use gallery::{Gallery, RenderOptions};
#[doc(hidden)] // how the binary knows it
pub use golden::in_ci;
pub use golden::{
    AcceptError, Acceptance, Accepted, Criterion, CriterionMargin, Deviation, FrameDifference,
    FrameFinding, FrameMargin, FrameTolerance, GoldenError, Goldens, Pending, PendingFrames,
    Profile, Provenance, ProvenanceError, Unusable,
};
pub use image::{ExrFile, Image, ImageError, ImageFormat, NonFinite, Part, Precision};
#[doc(hidden)] // how the binary writes files of its own
pub use image::{is_beside, is_leftover, write_whole};
pub use metric::{
    DEFAULT_RELATIVE, ErrorMap, ExposureMap, ExposureRange, Flip, FlipFailure, Gate, Mask,
    MaskError, Measured, Metric, Noise, Outlier, Outliers, Pair, PairError, Pool, Rect, TILE,
};
#[doc(hidden)] // how the binary writes for people
pub use output::{Output, Style, tell, trusted, visible, visible_json, with_colours};
pub use package::{FunctionItem, Package, PackageError};
pub use path::{Adapter, Path, PathError, adapter};
pub use probe::{Inputs, ProbeError, Probed, call};
pub use reflect::{
    Binding, BindingKind, Function, Invalid, LayoutError, Program, ReflectError, Stage, Validated,
};
pub use run::{KnownIssue, NotReplayed};
pub use settings::SettingsError;
#[doc(hidden)] // how the binary refuses the same settings
pub use settings::check as check_settings;
pub use stats::Support;
pub use tolerance::{Abs, Measure, Rel, Tolerance, Ulp, Unit, ulp_distance};
pub use value::{Arguments, Mirror, Scalar, Shape, Shareable, format_f32, format_lane, hexfloat};

/// What a test file needs: `use karat::prelude::*;`.
pub mod prelude {
    pub use crate::{
        Abs, AnyF32, CubeMap, Direction, Directions, Domain, Edges, Grid, Hemisphere, Inputs,
        Integers, Just, LatinHypercube, Limit, OneOf, Package, Path, Rel, Sampler, Storage,
        Support, Texture, Tolerance, Ulp, Uniform, UnitRgb, UnitVector,
    };
}
