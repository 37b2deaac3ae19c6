//! Each intermediate of one call: a debugger's view without a debugger.

use crate::interpret::Interpreted;
pub use crate::interpret::trace::{Step, Value};
use crate::probe::{ProbeError, Probed, made_up};

/// The operations of a call with these lanes of arguments, in `f32`, in `f64`, and as WGSL bounds them. What the function reads (textures, buffers) is made up.
///
/// # Errors
/// If the engine doesn't execute the function, or nothing can be made up for what it reads.
pub fn trace(probed: &Probed, arguments: &[u32]) -> Result<Vec<Step>, ProbeError> {
    let fixtures = made_up::fixtures(probed).unwrap_or_default();
    Interpreted::new(probed, &fixtures)?.trace(arguments)
}
