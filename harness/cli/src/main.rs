//! The command line of Karat.

mod cli;
mod review;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
