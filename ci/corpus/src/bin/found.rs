//! Finds faults in released shaders with ordinary checks. Each check fails on the released shader, and passes after one
//! change of the shader.
//!
//! `cargo run --bin found -- docs/found` runs all checks over crates that cargo fetches, and writes a page for each
//! fault. If a check passes on the released shader, or fails on the repaired shader, the program fails.
//! `cargo ci found` runs the program.

use std::f32::consts::{PI, TAU};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode};

use glam::{DVec2, DVec3, Mat3, UVec4, Vec3, Vec4};
use karat::check::{Agreement, Failure};
use karat::compute::{ComputeAgreement, ComputeError};
use karat::domain::UnitRgb;
use karat::fixture::{Buffer, Texture};
use karat::prelude::*;

karat::shareable! {
    /// The tiles that vello allocates for one vector path.
    pub struct TilePath mirrors TilePathMirror {
        /// The rectangle of tiles: column and row of the first tile, then column and row one beyond the last tile.
        bbox: UVec4,
        /// The index of the path's first tile.
        tiles: u32,
    }
}

type Check = fn(&Package) -> Verdict;

enum Verdict {
    Passes(String),
    Fails(String),
    /// The check stopped with an error that isn't a fault of the shader.
    Errs(String),
}

impl From<Result<Agreement, Failure>> for Verdict {
    fn from(result: Result<Agreement, Failure>) -> Self {
        match result {
            Ok(agreement) => Self::Passes(agreement.to_string()),
            Err(failure) if is_found(&failure) => Self::Fails(failure.to_string()),
            Err(failure) => Self::Errs(failure.to_string()),
        }
    }
}

impl From<Result<ComputeAgreement, ComputeError>> for Verdict {
    fn from(result: Result<ComputeAgreement, ComputeError>) -> Self {
        match result {
            Ok(agreement) => Self::Passes(agreement.to_string()),
            Err(error @ (ComputeError::Differs(_) | ComputeError::Violations(_))) => {
                Self::Fails(error.to_string())
            }
            Err(error) => Self::Errs(error.to_string()),
        }
    }
}

/// A fault in a crate's shader.
struct Found {
    name: &'static str,
    /// The crate with its version: `bevy_render@0.20.1`.
    krate: &'static str,
    function: &'static str,
    /// A description of the fault, and of its effect on users of the crate.
    says: &'static str,
    check: Check,
    /// The text to replace in the function's module, and the new text.
    change: [&'static str; 2],
    /// A second check, which runs only on the repaired function.
    mended: Option<Check>,
}

const FOUND: [Found; 9] = [
    Found {
        name: "hue-of-grey",
        krate: "bevy_render@0.20.1",
        function: "color_operations::rgb_to_hsv",
        says: "For every grey the function returns the hue NaN: red, green and blue are equal, so the function divides \
               0 by 0. A later line avoids a division by 0 for the saturation, but no line avoids it for the hue. \
               Bevy's tone mapping changes hues with this function.",
        check: |package| hue_of_grey(package).into(),
        change: [
            "(swizzle.x - swizzle.y) / c + swizzle.z",
            "(swizzle.x - swizzle.y) / max(c, 1e-20) + swizzle.z",
        ],
        mended: None,
    },
    Found {
        name: "full-turn-of-hue",
        krate: "bevy_render@0.20.1",
        function: "color_operations::hsl_to_linear_rgb",
        says: "A hue of 1 is a full turn, so it means the same colour as a hue of 0: red. No branch of the function \
               handles a hue of 1, so the function returns black for pure red. `hsv_to_linear_rgb` has the same fault.",
        check: |package| full_turn_of_hue(package).into(),
        change: ["let hp = h * 6.0;", "let hp = fract(h) * 6.0;"],
        mended: None,
    },
    Found {
        name: "white-and-black",
        krate: "bevy_render@0.20.1",
        function: "color_operations::hwb_to_linear_rgb",
        says: "If whiteness and blackness add up to more than 1, CSS Color 4 (section 8) scales both numbers down, so \
               the colour is a grey. This function doesn't scale whiteness and blackness: the saturation becomes \
               negative, and the function returns cyan for a hue of red.",
        check: |package| white_and_black(package).into(),
        change: [
            "    let whiteness = hwb.y;\n    let blackness = hwb.z;\n",
            "    let whiteness = hwb.y / max(1.0, hwb.y + hwb.z);\n    \
             let blackness = hwb.z / max(1.0, hwb.y + hwb.z);\n",
        ],
        mended: None,
    },
    Found {
        name: "angle-of-nothing",
        krate: "bevy_render@0.20.1",
        function: "maths::fast_atan2",
        says: "The function returns NaN for (0, 0), where `atan2` returns 0. Bevy's atmosphere computes the azimuth \
               of each view ray with this function. For a ray straight up the arguments are (0, 0).",
        check: |package| angle_of_nothing(package).into(),
        change: ["var t3 = t1 / t0;", "var t3 = select(0.0, t1 / t0, t0 > 0.0);"],
        mended: None,
    },
    Found {
        name: "tone-of-black",
        krate: "bevy_core_pipeline@0.20.1",
        function: "tonemapping::tonemapping_reinhard_luminance",
        says: "A black pixel becomes NaN: the function divides the pixel's mapped luminance by the pixel's luminance, \
               and both luminances are 0. Bevy uses the function for `Tonemapping::ReinhardLuminance`.",
        check: |package| tone_of_black(package).into(),
        change: [
            "return c_in * (l_out / l_in);",
            "return c_in * select(0.0, l_out / l_in, l_in > 0.0);",
        ],
        mended: None,
    },
    Found {
        name: "round-ellipse",
        krate: "bevy_smud@0.15.0",
        function: "smud::sd_ellipse",
        says: "The distance to a circle, an ellipse with equal axes, is NaN: the formula divides by the difference of \
               the squared axes. If the axes are almost equal, the distance is NaN or wrong, too, as a comment in the \
               shader warns. So a special case for equal axes isn't enough. The change below handles axes that differ by \
               less than a tenth of the longer axis: four steps approach the point of the ellipse that is nearest to \
               `p_in`. Each step replaces the ellipse by its circle of curvature at the current point.",
        check: |package| round_ellipse(package).into(),
        change: [
            "    let l = ab.y * ab.y - ab.x * ab.x;\n",
            "    if abs(a - b) < 0.1 * max(a, b) {\n        \
             let axes = vec2<f32>(a, b);\n        \
             let point = abs(p_in);\n        \
             var t = vec2<f32>(0.7);\n        \
             for (var i = 0; i < 4; i++) {\n            \
             let centre = vec2<f32>(1., -1.) * (a * a - b * b) * t * t * t / axes;\n            \
             let radius = length(axes * t - centre);\n            \
             let nearest = centre + radius * (point - centre) / max(length(point - centre), 1e-20);\n            \
             t = normalize(max(nearest / axes, vec2<f32>(1e-6)));\n        \
             }\n        \
             return length(axes * t - point) * sign(length(point / axes) - 1.);\n    \
             }\n    \
             let l = ab.y * ab.y - ab.x * ab.x;\n",
        ],
        mended: Some(|package| nearly_round_ellipse(package).into()),
    },
    Found {
        name: "along-the-normal",
        krate: "bevy_pbr@0.20.1",
        function: "render::pbr_lighting::ltc_integrate_quad",
        says: "If the view direction equals the normal, a rectangular light gives no light: a floor under an \
               orthographic camera that looks straight down stays black. The function makes its first tangent from the \
               part of the view direction that is perpendicular to the normal. If the view direction equals the \
               normal, this part is 0, and `normalize` returns NaN. Later the function looks for corners of the light \
               that lie above the horizon. `NaN > 0.0` is false, so the function finds no corner. Any vector \
               perpendicular to the normal would be a correct tangent.",
        check: |package| along_the_normal(package).into(),
        change: [
            "    let T1 = normalize(V - N * dot(V, N));\n",
            "    let across = V - N * dot(V, N);\n    \
             let axis = select(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(0.0, 1.0, 0.0), abs(N.x) > 0.9);\n    \
             let T1 = normalize(select(cross(N, axis), across, dot(across, across) > 1e-12));\n",
        ],
        mended: None,
    },
    Found {
        name: "last-bin",
        krate: "bevy_post_process@0.20.1",
        function: "auto_exposure::auto_exposure::compute_histogram",
        says: "A workgroup has 256 invocations, and the histogram has 64 bins. Each invocation adds one bin of a \
               workgroup's histogram to the frame's histogram. The bin's index is the invocation's index, so 192 \
               invocations use an index outside of both arrays. WGSL lets a driver access any element instead (6.4.4). \
               Mesa drops writes outside of an array, which hides the fault. If a driver clamps the index, as WGSL \
               allows, the shader adds the last bin, which counts the brightest pixels, 193 times. Auto exposure then \
               darkens the frame too much.",
        check: |package| last_bin(package).into(),
        change: [
            "    var histogram_value = atomicLoad(&histogram_shared[local_invocation_index]);\n    \
             atomicAdd(&histogram[local_invocation_index], histogram_value);\n",
            "    if local_invocation_index < 64u {\n        \
             var histogram_value = atomicLoad(&histogram_shared[local_invocation_index]);\n        \
             atomicAdd(&histogram[local_invocation_index], histogram_value);\n    \
             }\n",
        ],
        mended: None,
    },
    Found {
        name: "storage-barrier",
        krate: "vello_shaders@0.11.0",
        function: "tile_alloc::main",
        says: "The shader keeps counts of tiles in workgroup memory. Each invocation writes its count, and later reads \
               the count of a neighbour. Between the write and the read there is only a `storageBarrier`, which \
               doesn't order accesses of workgroup memory (WGSL, 17.11.1). A comment in the shader says that this \
               barrier replaces a workgroup barrier that a driver compiled wrongly. If a driver's `storageBarrier` \
               also orders workgroup memory, the driver hides the fault.",
        check: |package| storage_barrier(package).into(),
        change: [
            "    if local_id.x == WG_SIZE - 1u {\n        let count",
            "    workgroupBarrier();\n    if local_id.x == WG_SIZE - 1u {\n        let count",
        ],
        mended: None,
    },
];

fn last_bin(package: &Package) -> Result<ComputeAgreement, ComputeError> {
    // found: last-bin
    // From the darkest pixels, 2^-8, 16 stops up.
    let settings = Buffer::from_pod(&[-8.0_f32, 1.0 / 16.0, 16.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    let bright = |x, _| Vec4::splat(if x < 8 { 0.5 } else { 1e3 });
    package
        .compute()
        .with("settings", settings)
        .with("tex_color", Texture::from_fn(16, 16, bright))
        .with("tex_mask", Texture::constant(Vec4::ONE))
        .with("histogram", Buffer::zeros(64 * 4))
        .dispatch("auto_exposure::auto_exposure::compute_histogram", [1, 1, 1])
        .after("histogram")
        .unrecorded()
        // A pixel of full weight counts 16 times.
        .try_satisfies("counts each pixel", |bins: &[u32]| bins.iter().sum::<u32>() == 16 * 16 * 16)
    // end
}

fn storage_barrier(package: &Package) -> Result<ComputeAgreement, ComputeError> {
    // found: storage-barrier
    let mut config = [0_u32; 24];
    config[5] = 256; // n_drawobj
    package
        .compute()
        .with("config", Buffer::from_pod(&config))
        .with("scene", Storage::new([0_u32; 256])) // nothing is drawn
        .with("draw_bboxes", Storage::new([Vec4::ZERO; 256]))
        .with("bump", Buffer::zeros(8 * 4))
        .with("paths", Buffer::from_pod(&[1_u32; 256 * 8]))
        .with("tiles", Buffer::zeros(8))
        .dispatch("tile_alloc::main", [1, 1, 1])
        .after("paths")
        .unrecorded()
        .try_satisfies("is empty", |paths: &[TilePath]| {
            paths.iter().all(|path| (path.bbox, path.tiles) == (UVec4::ZERO, 0))
        })
    // end
}

fn hue_of_grey(package: &Package) -> Result<Agreement, Failure> {
    // found: hue-of-grey
    package
        .function("color_operations::rgb_to_hsv")
        .over(UnitRgb)
        .unrecorded()
        .try_satisfies("has a hue from 0 to 2 pi", |_, hsv: Vec3| (0.0..=TAU).contains(&hsv.x))
    // end
}

fn full_turn_of_hue(package: &Package) -> Result<Agreement, Failure> {
    // found: full-turn-of-hue
    // CSS Color 4, section 7.1
    let rgb = |hsl: DVec3| {
        let channel = |n: f64| {
            let k = (n + 12.0 * hsl.x) % 12.0;
            hsl.z - hsl.y * hsl.z.min(1.0 - hsl.z) * (k - 3.0).min(9.0 - k).clamp(-1.0, 1.0)
        };
        DVec3::new(channel(0.0), channel(8.0), channel(4.0))
    };
    package
        .function("color_operations::hsl_to_linear_rgb")
        .over(UnitRgb)
        .unrecorded()
        .try_agrees_with(|hsl: DVec3| linear(rgb(hsl)), Abs(1e-4))
    // end
}

fn white_and_black(package: &Package) -> Result<Agreement, Failure> {
    // found: white-and-black
    package
        .function("color_operations::hwb_to_linear_rgb")
        .over(UnitRgb)
        .unrecorded()
        .try_satisfies("is grey where white and black fill it", |hwb: Vec3, rgb: Vec3| {
            hwb.y + hwb.z < 1.0 || (rgb.max_element() - rgb.min_element()) < 1e-3
        })
    // end
}

fn angle_of_nothing(package: &Package) -> Result<Agreement, Failure> {
    // found: angle-of-nothing
    package
        .function("maths::fast_atan2")
        .over((-1.0..=1.0_f32, -1.0..=1.0_f32))
        .unrecorded()
        .try_satisfies("is an angle", |_, angle: f32| angle.abs() <= 1.001 * PI)
    // end
}

fn tone_of_black(package: &Package) -> Result<Agreement, Failure> {
    // found: tone-of-black
    // Reinhard et al., Photographic Tone Reproduction, equation 3, of luminance
    let mapped = |c: DVec3| c / (1.0 + c.dot(DVec3::new(0.2126, 0.7152, 0.0722)));
    package
        .function("tonemapping::tonemapping_reinhard_luminance")
        .over(UnitRgb)
        .unrecorded()
        .try_agrees_with(mapped, Rel(1e-5).or(Abs(1e-6)))
    // end
}

fn round_ellipse(package: &Package) -> Result<Agreement, Failure> {
    // found: round-ellipse
    let points = (-2.0..=2.0_f32, -2.0..=2.0_f32).map(|(x, y)| glam::Vec2::new(x, y));
    let circles = (points, 0.25..=1.0_f32).map(|(point, radius)| (point, radius, radius));
    package
        .function("smud::sd_ellipse")
        .over(circles)
        .unrecorded()
        .try_agrees_with(|p: DVec2, a: f64, _b: f64| p.length() - a, Abs(1e-4))
    // end
}

fn along_the_normal(package: &Package) -> Result<Agreement, Failure> {
    // found: along-the-normal
    let above = UnitVector.map(|n: Vec3| {
        let (x, y) = n.any_orthonormal_pair();
        let light = [x + y, y - x, -x - y, x - y].map(|corner| 2.0 * n + corner);
        (n, n, Vec3::ZERO, Mat3::IDENTITY, light)
    });
    package
        .function("render::pbr_lighting::ltc_integrate_quad")
        .over(above)
        .unrecorded()
        .try_satisfies("is lit", |_, light: f32| light.abs() > 0.0)
    // end
}

fn nearly_round_ellipse(package: &Package) -> Result<Agreement, Failure> {
    // mended: round-ellipse
    // The angle of the nearest point: until there the distance falls. A quadrant has one.
    let distance = |p: DVec2, a: f64, b: f64| {
        let (p, axes) = (p.abs(), DVec2::new(a, b));
        let (mut low, mut high) = (0.0, FRAC_PI_2);
        for _ in 0..60 {
            let t = 0.5 * (low + high);
            let to = axes * DVec2::from_angle(t) - p;
            match to.dot(axes * DVec2::from_angle(t).perp()) < 0.0 {
                true => low = t,
                false => high = t,
            }
        }
        let nearest = axes * DVec2::from_angle(low);
        nearest.distance(p).copysign((p / axes).length() - 1.0)
    };
    let points = (-2.0..=2.0_f32, -2.0..=2.0_f32).map(|(x, y)| glam::Vec2::new(x, y));
    // Domains draw many values close to the ends of a range: ratios close to 1.
    let ratios = (1.0..=1.09_f32, OneOf(vec![false, true]));
    let nearly = (points, 0.25..=1.0_f32, ratios).map(|(point, radius, (ratio, upright))| {
        let (short, long) = (radius, radius * ratio);
        if upright { (point, short, long) } else { (point, long, short) }
    });
    package
        .function("smud::sd_ellipse")
        .over(nearly)
        .unrecorded()
        .try_agrees_with(distance, Abs(1e-4))
    // end
}

fn linear(rgb: DVec3) -> DVec3 {
    let channel = |x: f64| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    DVec3::from(rgb.to_array().map(channel))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match &*arguments {
        [check, name] if check == "--check" => return checked(name, |found| Some(found.check)),
        [check, name] if check == "--check-mended" => return checked(name, |found| found.mended),
        [folder] => all(Path::new(folder)),
        _ => Err("name a folder for the pages: `found docs/found`".to_owned()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn open(found: &Found) -> Result<Package, String> {
    Package::open_crate(Path::new("."), found.krate, None).map_err(|error| error.to_string())
}

/// Runs a check in this process. If `KARAT_OVERLAY` names a folder, the repaired shader in this folder replaces the
/// released shader. The exit code is 0 if the check passes, 1 if a case fails, and 2 if the check has an error.
fn checked(name: &str, which: fn(&Found) -> Option<Check>) -> ExitCode {
    let found = FOUND.iter().find(|found| found.name == name);
    let Some((found, check)) = found.and_then(|found| Some((found, which(found)?))) else {
        eprintln!("error: there is no finding `{name}` with such a check");
        return ExitCode::from(2);
    };
    let package = match open(found) {
        Ok(package) => package,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(2);
        }
    };
    let (code, text) = match check(&package) {
        Verdict::Passes(text) => (0, text),
        Verdict::Fails(text) => (1, text),
        Verdict::Errs(text) => (2, text),
    };
    // The parent process reads this text.
    let _ = writeln!(std::io::stdout(), "{text}");
    ExitCode::from(code)
}

/// Returns `true` if the failure is a wrong result on some path, and `false` for other errors.
fn is_found(failure: &Failure) -> bool {
    match failure {
        Failure::Disagreement(_) | Failure::Rejection(_) => true,
        Failure::Paths(paths) => paths.failures.iter().any(is_found),
        _ => false,
    }
}

fn all(folder: &Path) -> Result<(), String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("`{}`: {error}", folder.display()))?;
    let mut index = String::from(
        "# Found\n\nKarat's ordinary checks find these faults in released shaders. Each check fails on the released \
         crate, and passes after one change of the shader. `cargo ci found` fetches the crates with cargo, runs all \
         checks, and writes these pages. The pages quote only the few lines of each crate that they discuss.\n\n\
         | fault | crate | function |\n|---|---|---|\n",
    );
    for found in &FOUND {
        let page = page(found).map_err(|error| format!("{}: {error}", found.name))?;
        let file = folder.join(format!("{}.md", found.name));
        std::fs::write(&file, page).map_err(|error| format!("`{}`: {error}", file.display()))?;
        let Found { name, krate, function, .. } = found;
        index += &format!("| [{name}]({name}.md) | {krate} | `{function}` |\n");
        eprintln!("{name}: fails as released, passes when it is mended");
    }
    index += "\n`cargo ci found` also tests two compute passes of vello_shaders 0.11 that compute prefix sums over path \
              tags. The command compares the results with a reference in Rust, and requires that Karat finds two \
              planted faults (`ci/corpus/src/bin/passes.rs`).\n\n\
              ## Passes that `karat hazards` checked\n\n\
              `karat hazards` checked these passes without a test, with generated resources: vello_shaders 0.11, \
              bevy_pbr 0.20 (clusters, mesh preprocessing, allocation of uniforms, light probes, SSAO, atmosphere), \
              bevy_post_process 0.20 (auto exposure), the part of bevy_solari 0.20 that Karat can open, wgpu_sort 0.1 \
              with the constants from its Rust code, and the compute shaders in eight files of the WebGPU samples. \
              The command found:\n\n\
              - The only race is the fault storage-barrier in the table above.\n\
              - Three groups of passes use indices outside of arrays. The pass with the fault last-bin is in the table \
              above. Boids and particles of the WebGPU samples don't compare the index with the length. The histogram \
              passes of wgpu_sort need a host that rounds buffer sizes up.\n\
              - `allocate_global_scan` of bevy_pbr reads workgroup memory before the first write. If the host turns \
              off zero initialisation, the pass reads arbitrary values.\n";
    index += DISPATCHED;
    let file = folder.join("README.md");
    std::fs::write(&file, index).map_err(|error| format!("`{}`: {error}", file.display()))
}

/// The section of `docs/found/README.md` about other projects' compute passes, which Karat's authors checked by hand.
const DISPATCHED: &str = "
## Passes with the sizes of their host

`karat call --dispatch` checked each pass with the buffer sizes and workgroup counts of the project that contains the pass. Karat checked the 13 passes of blade (commit dd93e63) that naga accepts, four of them with a replacement for ray queries, and found no fault. Karat also checked the 21 shader templates of wonnx (commit c62f5d3), for 137 nodes of neural networks. The following nodes have a fault in wonnx's own code:

- Softmax of operator sets 11 and 12 has a race. Softmax has the attribute `axis`: all elements with the same indices before this axis form a chunk. For each chunk wonnx runs several invocations: one for each combination of the indices after the axis. Invocation `y` of a chunk writes as many elements as the chunk has, from the chunk's element `y` on, so several invocations write the same elements.
- If the matrix sizes of a MatMul have 5, 7 or 9 as their common divisor, the shader uses tiles of size 4, which don't divide the sizes. Then the invocations for two matrices of a batch write the same elements, and use indices outside of the buffers. If the common divisor of the sizes is 3, a vector has 16 bytes in the shader, but 12 bytes on the host.
- Conv with 3 x 3 weights and without a bias reads beyond its weights, because wonnx pads the weights only if there is a bias.
- For more than 65,535 elements, wonnx uses workgroups of two invocations. If the number of elements is odd, the last invocation of Relu, Add and other nodes uses an index outside of the array, because no template compares the index with the length.
- If a Resize node gets sizes instead of scales, wonnx rounds the scale to two digits: a resize from 300 to 400 texels reads beyond the row.
";

/// Runs the check of a fault on the released shader and on the repaired shader, and returns the text of the fault's
/// page.
fn page(found: &Found) -> Result<String, String> {
    let package = open(found)?;
    let items = package.functions().map_err(|error| error.to_string())?;
    let item = items.into_iter().find(|item| item.name == found.function);
    let file = item.ok_or("there is no such function")?.span.file;
    let [from, to] = found.change;
    let place = match file.text.match_indices(from).collect::<Vec<_>>()[..] {
        [(place, _)] => place,
        ref several => return Err(format!("the text is there {} times", several.len())),
    };
    let overlay = tempfile::tempdir().map_err(|error| error.to_string())?;
    let (module, _) = found.function.rsplit_once("::").unwrap_or_default();
    let extension = Path::new(&file.name).extension().unwrap_or_default();
    let mended = overlay.path().join(module.replace("::", "/")).with_extension(extension);
    std::fs::create_dir_all(mended.parent().unwrap_or(overlay.path()))
        .and_then(|()| std::fs::write(&mended, file.text.replacen(from, to, 1)))
        .map_err(|error| error.to_string())?;
    let run = |check: &str, overlay: Option<&Path>| -> Result<(Option<i32>, String), String> {
        let mut command = Command::new(std::env::current_exe().map_err(|e| e.to_string())?);
        command.args([check, found.name]).env_remove("KARAT_OVERLAY");
        command.env("KARAT_PATHS", "vulkan").env_remove("KARAT_REQUIRE");
        if let Some(overlay) = overlay {
            command.env("KARAT_OVERLAY", overlay);
        }
        let output = command.output().map_err(|error| error.to_string())?;
        Ok((output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned()))
    };
    let (released, message) = run("--check", None)?;
    if released != Some(1) {
        return Err(format!("as released it ends with {released:?}:\n{message}"));
    }
    for check in ["--check"].into_iter().chain(found.mended.map(|_| "--check-mended")) {
        let (passes, agreement) = run(check, Some(overlay.path()))?;
        if passes != Some(0) {
            return Err(format!("mended, {check} ends with {passes:?}:\n{agreement}"));
        }
    }
    let line = file.text[..place].matches('\n').count() + 1;
    let (crate_name, version) = found.krate.split_once('@').unwrap_or((found.krate, ""));
    let (test, more) = (own_text("found", found.name), own_text("mended", found.name));
    // The page shows neither the paths of this machine nor the replay command of this process.
    let message = shortened(&message, crate_name, version);
    let mut page = String::new();
    let indent = |text: &str| text.len() - text.trim_start().len();
    let lines = |text: &str, other: &str, sign: char| -> String {
        let line = |line: &str| {
            let own = line.get(indent(text)..).unwrap_or(line.trim_start());
            let kept = other.lines().any(|other| other == line);
            match (kept, sign) {
                (true, '-') => String::new(),
                (true, _) => format!("  {own}\n"),
                _ => format!("{sign} {own}\n"),
            }
        };
        text.trim_end().lines().map(line).collect()
    };
    let _ = write!(
        page,
        "# {}\n\nThe fault is in `{}` of {crate_name} {version}, at line {line} of the module.\n\n{}\n\nThe test:\n\n```rust\n{}```\n\n\
         Karat says:\n\n```text\n{}\n```\n\nAfter this change the test passes:\n\n```diff\n{}{}```\n",
        found.name.replace('-', " "),
        found.function,
        found.says,
        test,
        message.trim_end(),
        lines(from, to, '-'),
        lines(to, from, '+'),
    );
    if found.mended.is_some() {
        let _ =
            write!(page, "\nThe changed function also passes this check:\n\n```rust\n{more}```\n");
    }
    Ok(page)
}

/// Returns the lines of this file between the comment `// marker: name` and the next comment `// end`.
fn own_text(marker: &str, name: &str) -> String {
    let own = include_str!("found.rs");
    let text = own.split(&format!("// {marker}: {name}\n")).nth(1);
    let text = text.and_then(|rest| rest.split("    // end").next()).unwrap_or_default();
    text.lines().map(|line| format!("{}\n", line.strip_prefix("    ").unwrap_or(line))).collect()
}

/// Returns the message without replay commands, and with file paths relative to the crate.
fn shortened(message: &str, name: &str, version: &str) -> String {
    let folder = format!("{name}-{version}/");
    let short = |line: &str| match line.find(&folder) {
        Some(at) => {
            let start = line[..at].rfind([' ', '(', '`']).map_or(0, |space| space + 1);
            format!("{}{}", &line[..start], &line[at..])
        }
        None => line.to_owned(),
    };
    let lines = message.lines().filter(|line| !line.trim_start().starts_with("replay: "));
    lines.map(|line| short(line.trim_end()) + "\n").collect()
}
