//! Tests of each kind of resource, function and draw that the shaders of other projects use. If Karat ignores one kind,
//! a test of this kind fails.

mod compute;
mod frames;
mod functions;
mod guide;
mod resources;
mod values;
