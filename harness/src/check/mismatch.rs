//! What doesn't fit together: a function, and what a check gives or expects of it.

use super::Failure;
use crate::reflect::Function;

/// The failure of a function's signature, with its place.
pub(super) fn signature(function: &Function, mismatch: String) -> Failure {
    Failure::Signature {
        function: function.path.clone(),
        mismatch,
        signature: function.to_string(),
        location: function.span.to_string(),
    }
}
