//! The command line of Karat.

mod cli;
mod quiet;

use std::process::ExitCode;

fn main() -> ExitCode {
    quiet::begin();
    cli::run()
}
