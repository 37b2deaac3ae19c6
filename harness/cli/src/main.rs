//! The command line of Karat.

mod cli;
mod quiet;
mod review;

use std::process::ExitCode;

fn main() -> ExitCode {
    quiet::begin();
    cli::run()
}
