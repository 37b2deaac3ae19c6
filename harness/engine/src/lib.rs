//! WGSL on the CPU, over many cases at once, in three arithmetics.
//!
//! A [`Program`] is a function, a compute or a fragment entry point of a valid [`naga::Module`]. It is lowered
//! once and then runs as often as wanted, with no driver and no adapter: in [`F32`], as a
//! conforming GPU computes; in [`F64`], the shadow, which shows what rounding costs; and in
//! [`Intervals`], which hold every result that the WGSL specification allows.
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
//! let rows = [1.5f32, -4.0].map(f32::to_bits); // one word a scalar, one row a case
//! let results = program.call::<F32>(2, &rows, &Resources::new(), &Options::default(), &())?;
//! assert_eq!(results.words(), [3f32, -8.0].map(f32::to_bits));
//! # Ok(())
//! # }
//! ```
//!
//! # How it is cut
//!
//! **Lowering** (`lower`) turns expressions into operations over scalar registers: a `vec3f` is three of them, a
//! matrix, a struct or an array as many as it has scalars. Calls are inlined, so that pointers, textures and samplers
//! are known while lowering and don't exist at run time. Swizzles, composites and constant indices cost nothing.
//! Lowering finds what the engine can't execute, and returns a [`Refusal`] with its place: run time has no such errors.
//! Each operation keeps its [`Site`].
//!
//! **Allocation** (`allocate`) forwards copies, removes unused operations, and lets values that aren't alive at the
//! same time share a register.
//!
//! **Domains** (`arithmetic`). An [`Arithmetic`] defines floats, integers and booleans. In intervals an integer is a
//! [`Range`] and a boolean a [`Truth`], which may be undecided.
//!
//! **The machine** (`machine`) runs a chunk of 256 cases: a register is a column of lanes (`columns`), and an operation
//! one loop over them. Chunks run on all cores. Finding the operation costs once a chunk; each value costs its
//! arithmetic.
//!
//! **Control flow.** A mask says which lanes are active (`machine/masks`). Operations without effects run in all lanes,
//! stores blend by the mask, and a loop goes round until no lane is active. Where a condition is undecided
//! (`machine/worlds`), a lane takes both ways, each with its own copy of the variables, and joins the values where the
//! ways meet. If the exit of a loop stays undecided for too long, the lane's results become unbounded.
//!
//! **Memory** (`machine/memory`). Variables are registers; those that are indexed at run time are ranges of registers.
//! Buffers are bytes in naga's layout; in a written buffer, a float that isn't an `f32` is kept beside its rounded
//! word. An index outside its array is clamped, and reported to the [`Observer`].
//!
//! **Textures** (`texture`) are data. The specification doesn't bound filters, so the interval of a sample goes from
//! the least texel to the greatest, and a little further: any weighted mean lies in it.
//!
//! **Accuracy** (`accuracy`). Where the specification is loose or silent, [`Options::accuracy`] narrows
//! the bounds of built-in functions to twice what was measured on an adapter.
//!
//! # Adding a builtin
//!
//! A rule stands in one place, in the file of its family in `rules`: its name, the number of its arguments and results,
//! naga's name of the builtin, and its computation in `f32`, in `f64` and in intervals. A builtin that works by
//! component needs nothing else. Others also need a line in `lower/math.rs` that says which registers they take.
//!
//! # What to know about the numbers
//!
//! - naga rounds literals to `f32` and folds constants before the engine sees them, so the shadow
//!   computes with the rounded ones: `0.1` is the nearest `f32` in each arithmetic.
//! - In the shadow a bitcast of a float rounds it to `f32` first, and half precision isn't rounded.
//! - `pow(x, y)` is NaN for each x below zero, as `exp2(y * log2(x))` is.
//! - Integers wrap, division by zero gives the dividend and remainder 0, shifts count modulo 32, and conversions from
//!   floats to integers saturate, as in naga's back ends.
//! - In intervals a subnormal may be flushed, and what overflows is unbounded, and so is all that is
//!   computed from it. [`Program::cause`] says which operation made it so.
//! - The invocations of a workgroup are the lanes of one chunk, so all of them are at a barrier at once, unless a
//!   [`Schedule`] has them run one by one, or some of them together: each such unit has a machine of its own, which stops
//!   before atomics and at barriers. Workgroups run one after the other, as far as none waits for another one.
//! - Subgroups are lanes in a row, 32 of them unless a [`Schedule`] says otherwise.

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
