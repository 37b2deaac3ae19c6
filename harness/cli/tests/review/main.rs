//! The review page in a browser, and its server without one.

mod browser;
mod comparing;
mod deciding;
mod finding;
mod listing;
mod looking;
mod project;
mod refusing;
mod reporting;
mod shots;
mod sourcing;
mod touching;
mod waiting;
