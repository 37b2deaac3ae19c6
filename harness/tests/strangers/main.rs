//! What engines bind, call and dispatch, each kind with a test that fails if it is ignored.

mod compute;
mod frames;
mod functions;
mod guide;
mod resources;
mod values;
