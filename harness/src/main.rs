//! The command line of Karat.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
