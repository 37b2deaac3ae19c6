//! The running test: its name, the inputs on which it failed before, its declared failures, and the records of its
//! verdicts. Checks of functions and checks of frames both use this code.

mod host;
mod identity;
mod known_issue;
mod memory;
pub(crate) mod replay;
mod reporter;

pub use host::{Host, host};
pub use identity::NotBegun;
pub(crate) use identity::{Identity, Replayed, leave_frame_out, with_inputs};
pub(crate) use known_issue::{Conclusion, Judged, KnownIssues, Stop, sound_paths};
pub use known_issue::{KnownIssue, PathFailures, WrongDeclaration};
pub(crate) use memory::{Descent, Entry, Memory};
pub use replay::{NotReplayed, not_replayed};
pub use reporter::{Fails, record_unbegun};
pub(crate) use reporter::{Passed, Report, or_panic, reported};
