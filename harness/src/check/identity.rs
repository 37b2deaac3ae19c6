//! Which test is running: its name seeds its cases and leads the replay command.

use crate::path::Path;

/// The running test and the case selection of the environment.
#[derive(Clone, Debug)]
pub(crate) struct Identity {
    /// The test's name: its module path inside the test binary.
    pub(crate) test: String,
    /// `KARAT_SEED`, which replaces the seed of every check.
    seed: Option<u64>,
    /// `KARAT_CASE`, which selects one case.
    pub(crate) case: Option<u64>,
}

impl Identity {
    pub(crate) fn current() -> Self {
        let number = |name: &str| {
            let text = std::env::var(name).ok().filter(|text| !text.is_empty())?;
            let digits = text.trim().replace('_', "");
            let number = match digits.strip_prefix("0x") {
                Some(hexadecimal) => u64::from_str_radix(hexadecimal, 16),
                None => digits.parse(),
            };
            Some(number.unwrap_or_else(|error| panic!("{name}={text} isn't a number: {error}")))
        };
        // The test runner names each test's thread. A program that isn't a test runs on `main`.
        let test = std::thread::current().name().unwrap_or("main").to_owned();
        Self { test, seed: number("KARAT_SEED"), case: number("KARAT_CASE") }
    }

    /// The seed of a check: from the names of test and function, so that it stays the same
    /// wherever and in whatever order the tests run.
    pub(crate) fn seed(&self, function: &str, check: &str) -> u64 {
        self.seed.unwrap_or_else(|| {
            let hash = blake3::hash(format!("{}\n{function}\n{check}", self.test).as_bytes());
            hash.as_bytes().iter().take(8).fold(0, |seed, byte| seed << 8 | u64::from(*byte))
        })
    }

    /// The command that runs this check again, on one path and one case.
    pub(crate) fn replay(&self, path: Path, seed: u64, case: u64) -> String {
        // Cargo tells a test which package it belongs to; the binary's name tells which target.
        let package = std::env::var("CARGO_PKG_NAME").ok();
        let binary = std::env::current_exe().ok().and_then(|exe| {
            let stem = exe.file_stem()?.to_str()?.to_owned();
            Some(stem.rsplit_once('-').map_or(stem.clone(), |(name, _)| name.to_owned()))
        });
        let mut command =
            format!("KARAT_PATHS={path} KARAT_SEED={seed:#x} KARAT_CASE={case} cargo test");
        if let Some(package) = &package {
            command.push_str(&format!(" -p {package}"));
        }
        match binary {
            Some(binary) if package.as_ref().is_some_and(|p| p.replace('-', "_") == binary) => {
                command.push_str(" --lib");
            }
            Some(binary) => command.push_str(&format!(" --test {binary}")),
            None => {}
        }
        format!("{command} -- --exact {}", self.test)
    }
}
