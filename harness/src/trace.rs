//! Each intermediate of one call: a debugger's view without a debugger.

use crate::fixture::Fixtures;
use crate::interpret::Interpreted;
pub use crate::interpret::trace::{Step, Value};
use crate::probe::{ProbeError, Probed};

/// The operations of a call with these lanes of arguments, in `f32`, in `f64`, and as WGSL bounds them.
///
/// ```
/// use karat::Package;
/// use karat::probe::Probed;
///
/// let text = "fn hidden(x: f32) -> f32 { let square = x * x; return 1.0 - square; }";
/// let probed = Probed::new(&Package::from_source("m", text), "hidden")?;
/// let steps = karat::trace::trace(&probed, &Vec::new(), &[0.5_f32.to_bits()])?;
/// assert_eq!(steps[0].name.as_deref(), Some("square"));
/// # Ok::<(), karat::probe::ProbeError>(())
/// ```
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
