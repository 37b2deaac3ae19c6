//! Compares two compute passes of vello 0.11 with a reference in Rust. The passes compute prefix sums over the path
//! tags of a scene with 4,096 `u32`s.
//!
//! `cargo run --bin passes` fetches the crate through cargo, and compares the passes. Then the program plants two
//! faults in the shader, and checks that Karat finds them. `cargo ci found` runs the program.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode};

use karat::compute::{ComputeAgreement, ComputeError};
use karat::fixture::Buffer;
use karat::prelude::*;

karat::shareable! {
    /// The sums that vello computes for a `u32` of the scene, over all tags before it. Each `u32` contains four tags.
    pub struct TagMonoid mirrors TagMonoidMirror {
        /// The number of transforms.
        trans_ix: u32,
        /// The number of segments.
        pathseg_ix: u32,
        /// The number of `u32`s that contain the coordinates of the segments.
        pathseg_offset: u32,
        /// The number of `u32`s that contain the styles.
        style_ix: u32,
        /// The number of paths.
        path_ix: u32,
    }
}

/// The number of `u32`s in the scene. A workgroup reads 256 `u32`s, so there are 16 workgroups.
const WORDS: u32 = 4096;

/// Returns tags with random bits, from the generator of Park and Miller.
fn scene() -> Vec<u32> {
    let mut state = 1_u64;
    let mut byte = || {
        state = state * 48_271 % 0x7fff_ffff;
        u32::from((state >> 8) as u8 & 0x7f)
    };
    (0..WORDS).map(|_| (0..4).fold(0, |word, _| word << 8 | byte())).collect()
}

/// Returns the counts that one tag adds to the sums, in the order of [`TagMonoid`]'s members. `vello_encoding::PathTag`
/// documents the bits of a tag.
fn of_tag(tag: u32) -> [u32; 5] {
    let segment = tag & 3;
    let points = segment + (tag >> 2 & 1);
    let words = if tag & 8 == 0 { points } else { 2 * points };
    [tag >> 5 & 1, u32::from(segment != 0), words, 2 * (tag >> 6 & 1), tag >> 4 & 1]
}

/// Returns, for each `u32` of the scene, the sums over all tags before it.
fn sums(scene: &[u32]) -> Vec<TagMonoidMirror> {
    let mut sum = [0; 5];
    let mut before = Vec::new();
    for word in scene {
        let [trans_ix, pathseg_ix, pathseg_offset, style_ix, path_ix] = sum;
        before.push(TagMonoidMirror { trans_ix, pathseg_ix, pathseg_offset, style_ix, path_ix });
        for byte in word.to_le_bytes() {
            let own = of_tag(byte.into());
            sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
    }
    before
}

fn check(package: &Package) -> Result<ComputeAgreement, ComputeError> {
    let scene = scene();
    let expected = sums(&scene);
    package
        .compute()
        // The tags begin at the first `u32`: `pathtag_base` is 0, like all other numbers of the configuration.
        .with("config", Buffer::zeros(96))
        .with("scene", Storage::new(scene))
        .with("reduced", Buffer::zeros(16 * 20))
        .with("tag_monoids", Buffer::zeros(20 * WORDS as usize))
        .dispatch("pathtag_reduce::main", [WORDS / 256, 1, 1])
        .dispatch("pathtag_scan::main", [WORDS / 256, 1, 1])
        .after("tag_monoids")
        .unrecorded()
        .try_agrees_with(expected, Abs(0.0))
}

fn open() -> Result<Package, String> {
    let package = Package::open_crate(Path::new("."), CRATE, None);
    // There are few workgroups, so the second pass adds the sums of all workgroups.
    package.map(|package| package.feature("small", true)).map_err(|error| error.to_string())
}

const CRATE: &str = "vello_shaders@0.11.0";

/// The faults that the program plants: the module, the text to replace, and the new text.
const FAULTS: [[&str; 3]; 2] = [
    ["pathtag_scan", "if local_id.x >= 1u << i {", "if local_id.x > 1u << i {"],
    ["shared/pathtag", "n_points & (((tag_word >> 3u)", "n_points & (((tag_word >> 2u)"],
];

/// Runs the comparison in another process, and returns the exit code and the output. Modules in the folder `overlay`
/// replace modules of the crate.
fn run(overlay: Option<&Path>) -> Result<(Option<i32>, String), String> {
    let mut command = Command::new(std::env::current_exe().map_err(|error| error.to_string())?);
    command.arg("--check").env_remove("KARAT_OVERLAY").env_remove("KARAT_REQUIRE");
    // Mesa's GL needs a minute to compile arrays of structures in workgroup memory.
    command.env("KARAT_PATHS", "vulkan,cpu");
    if let Some(overlay) = overlay {
        command.env("KARAT_OVERLAY", overlay);
    }
    let output = command.output().map_err(|error| error.to_string())?;
    Ok((output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned()))
}

fn all() -> Result<(), String> {
    let (code, text) = run(None)?;
    if code != Some(0) {
        return Err(format!("as released it ends with {code:?}:\n{text}"));
    }
    eprint!("{CRATE}, pathtag_reduce and pathtag_scan: {text}");
    let package = open()?;
    for [module, from, to] in FAULTS {
        let items = package.functions().map_err(|error| error.to_string())?;
        let own = format!("{}::", module.replace('/', "::"));
        let item = items.into_iter().find(|item| item.name.starts_with(&own));
        let text = item.ok_or("the module isn't there")?.span.file.text.clone();
        if text.matches(from).count() != 1 {
            return Err(format!("`{from}` isn't in {module} once"));
        }
        let overlay = tempfile::tempdir().map_err(|error| error.to_string())?;
        let mutant = overlay.path().join(module).with_extension("wgsl");
        std::fs::create_dir_all(mutant.parent().unwrap_or(overlay.path()))
            .and_then(|()| std::fs::write(&mutant, text.replacen(from, to, 1)))
            .map_err(|error| error.to_string())?;
        match run(Some(overlay.path()))? {
            (Some(1), text) => {
                eprintln!("{module} with `{to}`: {}", text.lines().next().unwrap_or_default())
            }
            (code, text) => {
                return Err(format!("{module} with `{to}` ends with {code:?}:\n{text}"));
            }
        }
    }
    Ok(())
}

/// Checks if the comparison found a wrong element on some path.
fn differs(failure: &ComputeError) -> bool {
    match failure {
        ComputeError::Differs(_) => true,
        ComputeError::Paths(paths) => paths.failures.iter().any(differs),
        _ => false,
    }
}

fn main() -> ExitCode {
    if std::env::args().nth(1).is_none() {
        return match all() {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("error: {error}");
                ExitCode::FAILURE
            }
        };
    }
    let mut out = std::io::stdout();
    let (said, code) = match open().map(|package| check(&package)) {
        Ok(Ok(agreement)) => (writeln!(out, "{agreement}"), 0),
        Ok(Err(failure)) if differs(&failure) => (writeln!(out, "{failure}"), 1),
        Ok(Err(error)) => (writeln!(out, "{error}"), 2),
        Err(error) => (writeln!(out, "{error}"), 2),
    };
    // The parent process reads this text.
    drop(said);
    ExitCode::from(code)
}
