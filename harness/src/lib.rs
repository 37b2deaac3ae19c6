//! x
mod diagnostic;
mod domain;
mod package;
mod reflect;
mod tolerance;
mod value;
pub use diagnostic::*;
pub use domain::*;
pub use package::*;
pub use reflect::*;
pub use tolerance::*;
pub use value::*;
