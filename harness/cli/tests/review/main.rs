//! The review page in a browser, and its server without one.

mod browser;
mod deciding;
mod finding;
mod looking;
mod project;
mod refusing;
mod reporting;
mod shots;
mod waiting;
