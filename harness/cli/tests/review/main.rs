//! Tests the review page in a browser, and the review's server without a browser.

mod browser;
mod comparing;
mod deciding;
#[path = "../given/faults.rs"]
mod faults;
#[path = "../given/files.rs"]
mod files;
mod finding;
mod listing;
mod looking;
mod pixels;
#[path = "../given/program.rs"]
mod program;
mod project;
mod refusing;
mod reporting;
#[path = "../given/repository.rs"]
mod repository;
mod shots;
mod sourcing;
mod touching;
mod waiting;
