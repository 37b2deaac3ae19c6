//! WGSL on the CPU.

mod allocate;
mod arithmetic;
mod code;
mod columns;
mod dispatch;
mod interval;
mod lower;
mod machine;
mod observer;
mod options;
mod program;
mod refusal;
mod resources;
mod results;
mod rules;
mod scalar;
mod texture;

pub use arithmetic::{Arithmetic, F32, F64, Intervals};
pub use code::Site;
pub use interval::{Interval, Range, Truth};
pub use lower::{Overrides, Settings};
pub use observer::{Lanes, Observer, OutOfRange};
pub use options::Options;
pub use program::Program;
pub use refusal::{Refusal, Stop};
pub use resources::Resources;
pub use results::{Lane, LaneOf, Results};
pub use scalar::Scalar;
pub use texture::{Address, Comparison, Dimension, Filter, Sampler, Texels, Texture, TextureError};
