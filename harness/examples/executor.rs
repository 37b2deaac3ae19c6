//! Runs jobs that come on stdin, on the path that is named, and writes the replies to stdout: a program for
//! KARAT_EXECUTORS.
//!
//! `KARAT_EXECUTORS='mine=target/debug/examples/executor cpu' KARAT_PATHS=process@mine cargo test`

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name a path: cpu, vulkan")?.parse()?;
    let executor = karat::executor::of(path)?;
    Ok(karat::executor::serve(executor, std::io::stdin().lock(), std::io::stdout().lock())?)
}
