//! Tests of each kind of resource, function and draw that the shaders of other projects use. A test fails if Karat
//! ignores this kind.

mod compute;
mod frames;
mod functions;
mod guide;
mod resources;
mod values;
