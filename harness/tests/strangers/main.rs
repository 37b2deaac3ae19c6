//! Each kind of binding, call and dispatch that engines use, with a test that fails if Karat ignores it.

mod compute;
mod frames;
mod functions;
mod guide;
mod resources;
mod values;
