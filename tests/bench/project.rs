//! Times a user's project, made as in the guide: its first `cargo test` without compiled files, and the time from an
//! edit of its Rust test to the verdict.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use super::Spread;

/// The number of edits. The benchmark prints the median of their times.
const EDITS: usize = 7;

pub(super) fn run() {
    println!("\na project with one check, on vulkan: `cargo test` to its verdict [s]");
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_project(folder.path());
    let first = test(folder.path(), 0);
    println!("  from nothing, with its libraries downloaded   {first:>8.3}");
    let times = (1..=EDITS).map(|edit| test(folder.path(), edit)).collect();
    println!("  its Rust test edited                          {}", Spread::of(times));
    write(folder.path(), "shaders/brdf.wgsl", &SHADER.replace("1.0 - x", "1.0 - 1.0 * x"));
    println!("  its shader edited                             {:>8.3}", cargo_test(folder.path()));
}

const SHADER: &str = "fn pow5(x: f32) -> f32 { let y = x * x; return y * y * x; }\n\
    fn schlick(f0: f32, x: f32) -> f32 { return f0 + (1.0 - f0) * pow5(1.0 - x); }\n";

/// Writes the project of the guide's first page.
fn write_project(folder: &Path) {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("it is in one");
    let karat = repository.join("harness");
    let guide = repository.join("docs/guide/first-test.md");
    let guide = std::fs::read_to_string(guide).expect("it is there");
    let profiles = guide.split("```toml\n# Cargo.toml\n").nth(1).expect("the page has profiles");
    let profiles = profiles.split("```").next().expect("a block ends");
    let manifest = format!(
        "[package]\nname = \"own\"\nedition = \"2024\"\n\n[workspace]\n\n\
         [dev-dependencies]\nkarat = {{ path = {karat:?} }}\n\n{profiles}"
    );
    write(folder, "Cargo.toml", &manifest);
    // Uses the versions of libraries that this machine already has.
    let lock = std::fs::read_to_string(repository.join("Cargo.lock")).expect("it is there");
    write(folder, "Cargo.lock", &lock);
    write(folder, "src/lib.rs", "//! An application.\n");
    write(folder, "shaders/brdf.wgsl", SHADER);
}

/// Writes edit number `edit` of the Rust test, runs the test, and returns the time in seconds.
fn test(folder: &Path, edit: usize) -> f64 {
    let text = format!(
        "use karat::prelude::*;\n\nstatic SHADERS: Package = karat::package!(\"shaders\");\n\n\
         #[test]\nfn schlick() {{\n    \
         SHADERS.function(\"brdf::schlick\").over((0.0..=1.0, 0.0..=1.0)).agrees_with(\n        \
         |f0: f64, x: f64| f0 + (1.0 - f0) * (1.0 - x).powi(5),\n        Ulp({}.0),\n    );\n}}\n",
        11 + edit
    );
    write(folder, "tests/brdf.rs", &text);
    cargo_test(folder)
}

/// The time of a `cargo test` run that passes.
fn cargo_test(folder: &Path) -> f64 {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    for (name, _) in std::env::vars_os() {
        let text = name.to_string_lossy();
        if ["CARGO_", "KARAT_", "RUST"].iter().any(|prefix| text.starts_with(prefix))
            && !["CARGO_HOME", "RUSTUP_HOME", "RUSTUP_TOOLCHAIN"].contains(&&*text)
        {
            command.env_remove(name);
        }
    }
    command.args(["test", "--offline", "--test", "brdf"]).current_dir(folder);
    command.env("KARAT_PATHS", "vulkan").env("NODEVICE_SELECT", "1");
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let start = Instant::now();
    let ran = command.output().expect("cargo runs");
    let time = start.elapsed().as_secs_f64();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    time
}

fn write(folder: &Path, file: &str, text: &str) {
    let path = folder.join(file);
    std::fs::create_dir_all(path.parent().expect("in the folder")).expect("a folder");
    std::fs::write(path, text).expect("written");
}
