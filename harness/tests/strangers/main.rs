//! Tests of each kind of resource, function and draw that the shaders of other projects use. If Karat ignores one kind
//! of resource, for example, a test that uses this resource fails.

mod compute;
mod frames;
mod functions;
mod guide;
mod resources;
mod values;
