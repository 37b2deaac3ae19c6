//! What engines bind, call and dispatch, each kind with a test that fails if it is ignored.

mod compute;
mod functions;
mod resources;
