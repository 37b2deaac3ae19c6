//! Each intermediate of one call: a debugger's view without a debugger.

use crate::fixture::Fixtures;
use crate::interpret::Interpreted;
pub use crate::interpret::trace::{Step, Value};
use crate::probe::{ProbeError, Probed};

/// The operations of a call with these lanes of arguments, in `f32`, in `f64`, and as WGSL bounds them.
///
/// # Errors
/// If the engine doesn't execute the function, or a variable has no fixture.
pub fn trace(
    probed: &Probed,
    fixtures: &Fixtures,
    arguments: &[u32],
) -> Result<Vec<Step>, ProbeError> {
    Interpreted::new(probed, fixtures)?.trace(arguments)
}
