//! Modules for programs that run or report tests, such as Karat's own command line. Any release may change the names
//! and meanings of these modules, so use the other modules of the library in tests.
//!
//! ```
//! use karat::unstable::record::Verdict;
//!
//! let verdicts: Vec<Verdict> = karat::unstable::record::read("target/none".as_ref())
//!     .map_or(Vec::new(), |records| records.iter().map(|record| record.verdict).collect());
//! assert!(verdicts.is_empty());
//! ```

#[doc(inline)]
pub use karat_core::{diagnostic, output, settings, stats};

/// Checks of functions whose types are known only at run time, and tests in WGSL.
pub mod check {
    pub use crate::check::cause::cause_of;
    pub use crate::check::condition::Condition;
    pub use crate::check::disagreement::{
        CaseFailure, Disagreement, IntegralFailure, NodeFailure, PathDisagreement, Simplest,
    };
    pub use crate::check::dynamic::{ExpectWords, Words};
    pub use crate::check::flush::Flushed;
    pub use crate::check::mismatch::Mismatch;
    pub use crate::check::parameter::Parameter;
    pub use crate::check::sampling::Fit;
    pub use crate::check::sampling::rejection::{
        ConfigurationRejection, Finding, PathRejection, Rejection,
    };
    pub use crate::check::vacuous::Vacuous;
    pub use crate::check::wgsl_test::{TestGroup, WgslTest};
    pub use crate::judge::Census;
}

/// Dispatches of compute passes, as data.
pub mod dispatch {
    pub use crate::dispatch::*;
}

/// A function that runs another program and returns its output, and a time limit for such a run.
pub mod process {
    pub use karat_core::lines::{LOOK_UP, output};
}

/// Domains that a program builds at run time, and their values as `u32` words.
pub mod domain {
    pub use karat_core::domain::{
        Above, Composed, Dynamic, Emptiness, Filter, Held, Map, Numbering, Origin, Part, Parts,
        Shrinkable, Source, Stream, Typed, complexity,
    };
}

/// Drawings of frames, as data.
pub mod draw {
    pub use crate::draw::drawing::{Drawing, Source};
}

/// The trait `Executor` for everything that runs shaders, and a server for programs that run jobs.
pub mod executor {
    pub use crate::executor::*;
}

/// Fixtures that Karat generates from a declared size, and the mip levels of textures.
pub mod fixture {
    pub use crate::fixture::Fixtures;
    pub use crate::fixture::buffer::blank;
    pub use crate::fixture::given::{bytes, laid_out, levels, resolve, without_mips};
    pub use crate::fixture::level::Level;
}

/// Values of a frame's fragment functions, and the steps that compute one pixel.
pub mod frame {
    pub use crate::frame::pixel::TracedPixel;
    pub use crate::frame::tap::{Tap, TapError, Tapped};
}

/// The files of goldens: pending frames, acceptance, provenance.
pub mod golden {
    pub use crate::golden::acceptance::{AcceptError, Acceptance, Accepted};
    pub use crate::golden::changes::ChangedRow;
    pub use crate::golden::compare::{Deviation, FrameDifference, FrameMargin};
    pub use crate::golden::pending::{Pending, PendingFrames, Unusable};
    pub use crate::golden::place::{build_output, in_ci};
    pub use crate::golden::profile::Profile;
    pub use crate::golden::provenance::{FrameFinding, Provenance};
    pub use crate::golden::table::{Column, Table, TableFacts};
    pub use crate::golden::tolerance::{CriterionMargin, FrameCriterion};
}

/// Image files.
pub mod image {
    pub use karat_core::image::{
        ExrFile, ImageFormat, NonFinite, Part, Staged, encode_srgb, is_beside, is_leftover,
        luminance, remove_leftover, write_colours, write_whole,
    };
}

/// Runs of functions and passes in the engine: the hazards that occur, and the values that the engine computes.
pub mod interpret {
    pub use crate::interpret::*;
}

/// Jobs that executors run, as data.
pub mod job {
    pub use crate::job::*;
}

/// Metrics of the difference between two frames, and maps of the errors.
pub mod metric {
    pub use karat_core::metric::{
        DEFAULT_RELATIVE, ErrorMap, ExposureMap, ExposureRange, FlipFailure, Gate, MASK, Measured,
        Metric, Outliers, Pair, PairError, TILE, WorstPixel,
    };
}

/// The functions of a package, and the tests that conditions such as `@if(NAME)` remove from the package.
pub mod package {
    pub use crate::package::accepted::*;
    pub use crate::package::function_item::FunctionItem;
    pub use crate::package::functions::LeftOut;
    pub use crate::package::inputs::{Declaration, End, MOST_ELEMENTS, scope};
    pub use crate::package::inside::*;
    pub use crate::package::scan::is_of_tools;
    pub use crate::package::stage::Stage;
}

/// Compute passes over resources whose types aren't known when a program is compiled.
pub mod compute {
    pub use crate::compute::judge::Difference;
    pub use crate::compute::order::OrderDependence;
    pub use crate::compute::sanitizer::Violations;
    pub use crate::compute::untyped::*;
    pub use crate::dispatch::{Violation, ViolationAccess};
}

/// Paths: their names, drivers and abilities, and the first message (`Greeting`) of a program that runs jobs.
pub mod path {
    pub use crate::path::deadline::{Moment, watched};
    pub use crate::path::device::Device;
    pub use crate::path::driver::Adapter;
    pub use crate::path::name::{Api, Via};
    pub use crate::path::opened::device;
    pub use crate::path::process::Greeting;
    pub use crate::path::selection::{
        adapter, expect_sound, named, programs, required, selected, selects,
    };
    pub use crate::path::swiftshader;
    pub use crate::path::web::{BROWSER_SCRIPTS, has_chosen_drivers};
    pub use crate::reflect::Ability;
}

/// Functions, each with the kernel that calls it.
pub mod probe {
    pub use crate::probe::*;
}

/// Verdicts as JSON lines.
pub mod record {
    pub use crate::record::*;
}

/// Programs: the linked text, naga's IR and the source map of a module, with its signatures, bindings and limits.
pub mod reflect {
    pub use crate::reflect::*;
}

/// The running test: its name, its replay command, its known issues.
pub mod run {
    pub use crate::run::*;
}

/// Tint, Chrome's compiler of WGSL.
pub mod tint {
    pub use crate::tint::*;
}

/// The caches of a process, and a function that forgets the entries that may be stale.
pub mod workspace {
    pub use crate::package::workspace::refresh;
}

/// Tolerances, and texts that describe the difference between numbers.
pub mod tolerance {
    pub use karat_core::tolerance::{
        Criterion, LaneError, SpecTolerance, Unit, beyond, power, significant, times_allowed,
        ulp_distance,
    };
}

/// Each intermediate value of one call.
pub mod trace {
    pub use crate::interpret::trace::{Step, Value, trace};
}

/// Types of values, and functions that write values as text.
pub mod value {
    pub use karat_core::value::{
        Arguments, Differing, Mirror, Quad, Reference, Scalar, Shape, format_f32, format_lane,
        hexfloat,
    };
}
