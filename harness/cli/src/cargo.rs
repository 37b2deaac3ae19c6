//! `cargo karat`: runs the program `karat` that is in the same folder as this program.
//!
//! For `cargo karat test`, Cargo calls `cargo-karat karat test`. This program only passes the arguments on to `karat`,
//! so that it needn't contain Karat's code a second time.

use std::ffi::OsString;
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    let mut arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    if arguments.first().is_some_and(|first| first == "karat") {
        arguments.remove(0);
    }
    let name = format!("karat{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok().map(|this| this.with_file_name(&name));
    let program = beside.filter(|file| file.is_file()).unwrap_or_else(|| name.into());
    match Command::new(&program).args(arguments).status() {
        Ok(status) => match status.code().and_then(|code| u8::try_from(code).ok()) {
            Some(code) => ExitCode::from(code),
            None => ExitCode::from(2), // a signal ended the program
        },
        Err(error) => {
            eprintln!("error: `cargo karat` can't run `{}`: {error}", program.display());
            eprintln!("  to install `cargo-karat` and `karat`, run `cargo install karat-cli`");
            ExitCode::from(2)
        }
    }
}
