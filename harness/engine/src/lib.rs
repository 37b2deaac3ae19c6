//! Runs WGSL on the CPU, for many cases at the same time, in `f32`, in `f64` or in intervals.
//!
//! A [`Program`] is a function, a compute entry point or a fragment entry point of a valid [`naga::Module`]. It is
//! lowered once, and can then run many times without a driver or an adapter. In [`F32`], the program computes as a
//! conforming GPU does. In [`F64`], the program computes in double precision, which shows how large the rounding errors
//! of [`F32`] are. [`Intervals`] contain all results that the WGSL specification allows.
//!
//! ```
//! use karat_engine::{F32, Options, Program, Resources, Settings};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let module = naga::front::wgsl::parse_str("fn double(x: f32) -> f32 { return x + x; }")?;
//! let info = naga::valid::Validator::new(
//!     naga::valid::ValidationFlags::all(),
//!     naga::valid::Capabilities::default(),
//! )
//! .validate(&module)?;
//! let program = Program::function(&module, &info, "double", &Settings::default())?;
//! let rows = [1.5f32, -4.0].map(f32::to_bits); // one word for each scalar, one row for each case
//! let results = program.call::<F32>(2, &rows, &Resources::new(), &Options::default(), &())?;
//! assert_eq!(results.words(), [3f32, -8.0].map(f32::to_bits));
//! # Ok(())
//! # }
//! ```
//!
//! # Parts of the engine
//!
//! **Lowering** (`lower`) turns expressions into operations on scalar registers. A `vec3f` has three registers. A
//! matrix, a struct or an array has one register for each of its scalars. Calls are inlined, so pointers, textures and
//! samplers are known during lowering and don't exist at run time. Swizzles, composites and constant indices cost
//! nothing. Lowering finds constructs that the engine can't execute, and returns a [`Refusal`] with the construct's
//! position. So a run never finds a construct that the engine can't execute. Each operation keeps its [`Site`].
//!
//! **Allocation** (`allocate`) propagates copies, removes unused operations, and lets values that aren't needed at the
//! same time share a register.
//!
//! **Arithmetics** (`arithmetic`). An [`Arithmetic`] defines floats, integers and booleans. In [`Intervals`], an
//! integer is a [`Range`], and a boolean is a [`Truth`], which may be undecided.
//!
//! **The machine** (`machine`) runs a chunk of 256 cases. A register is a column with one value for each lane
//! (`columns`), and an operation is a loop over the lanes. So the machine decodes an operation once for 256 cases.
//! Chunks run on all cores.
//!
//! **Control flow.** A mask marks the active lanes (`machine/masks`). Operations without effects run in all lanes,
//! stores change only active lanes, and a loop runs until no lane is active. If a condition is undecided
//! (`machine/worlds`), a lane takes both branches, each with its own copy of the variables. Where the branches meet,
//! the two values of each variable are joined to one interval. If the exit of a loop stays undecided too long, the
//! lane's results become unbounded.
//!
//! **Memory** (`machine/memory`). Variables are registers, and variables that are indexed at run time are ranges of
//! registers. Buffers are bytes in naga's layout. A buffer that the program writes also keeps the written floats,
//! because a word can't hold an `f64`. An index outside of its array is clamped, and reported to the [`Observer`].
//!
//! **Textures** (`texture`) are lists of texels, and the engine filters them. The specification doesn't limit the
//! errors of filters. So the interval of a sample goes from slightly below the least texel to slightly above the
//! greatest texel, and contains each weighted mean.
//!
//! **Accuracy** (`accuracy`). For some built-in functions, the specification allows large errors, or any error. For
//! these functions, [`Options::accuracy`] narrows the bounds to twice the error that was measured on an adapter.
//!
//! # Adding a builtin
//!
//! A builtin has one definition, in a file of the folder `rules`. The definition has a name, the number of arguments
//! and results, naga's name of the builtin, and the computation in `f32`, in `f64` and in intervals. A builtin that
//! works component by component needs nothing else. Each other builtin also needs a line in `lower/math.rs` that says
//! which registers the builtin takes.
//!
//! # Properties of the numbers
//!
//! - naga rounds literals to `f32` and folds constants before the engine sees them. So [`F64`] computes with rounded
//!   literals: `0.1` is the nearest `f32` in each arithmetic.
//! - In [`F64`], a bitcast of a float first rounds the float to `f32`. [`F64`] doesn't round values of type `f16`.
//! - `pow(x, y)` is NaN for each x below zero, like `exp2(y * log2(x))`.
//! - Integers wrap around. A division by zero returns the dividend, and the remainder is 0. A shift by `n` bits shifts
//!   by `n % 32`. Conversions from floats to integers saturate. The code that naga generates follows the same rules.
//! - In [`Intervals`], a subnormal may be flushed to zero, so the interval also contains zero. A result that overflows
//!   is unbounded, and everything that is computed from it is unbounded, too. [`Program::cause`] returns the operation
//!   that made it unbounded.
//! - The invocations of a workgroup are the lanes of one chunk, so they reach a barrier together. A [`Schedule`] may
//!   also run the invocations one by one, or in groups. Then each invocation or group has its own machine, which stops
//!   before atomics and at barriers. Workgroups run one after another, unless one waits for another.
//! - A subgroup has 32 successive lanes, unless a [`Schedule`] sets another number.

mod accuracy;
mod allocate;
mod arithmetic;
mod code;
mod columns;
mod coverage;
mod dispatch;
mod explore;
mod interval;
mod lower;
mod machine;
mod observer;
mod options;
mod parallel;
mod program;
mod races;
mod refusal;
mod resources;
mod results;
mod rules;
mod runs;
mod scalar;
mod schedule;
mod texture;

pub use accuracy::Accuracy;
pub use arithmetic::{Arithmetic, F32, F64, Intervals};
pub use code::Site;
pub use coverage::{Count, Counts, Statement, StatementKind, statements};
pub use dispatch::{Turn, pixel_of};
pub use explore::Explorer;
pub use interval::{Interval, Range, Truth};
pub use lower::{Overrides, Settings};
pub use observer::{Here, Lanes, Missing, Observer, Reach, Wrong};
pub use options::{Choice, Elsewhere, Options};
pub use program::Program;
pub use races::{
    Access, Atomics, Bounds, Divergence, Observed, Outside, Place, Race, Touched, Unwritten,
};
pub use refusal::{Refusal, Stop};
pub use resources::Resources;
pub use results::{Lane, LaneOf, Results};
pub use runs::Runs;
pub use scalar::Scalar;
pub use schedule::{Actor, Priorities, Schedule, Stores};
pub use texture::{Address, Comparison, Dimension, Filter, Sampler, Texels, Texture, TextureError};
