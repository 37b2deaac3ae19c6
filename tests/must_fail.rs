//! Proof that each kind of check can fail: a fault is planted, and must be seen.

use std::f64::consts::{PI, TAU};
use std::path::Path as FilePath;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};
use karat::prelude::*;
use karat::{Acceptance, Disagreement, Failure, Goldens, Image, Precision, ProbeError};
use shaders::{PBR, fresnel, geometry};

/// The shader library with one text replaced in one module.
fn mutant(module: &str, original: &str, fault: &str) -> Package {
    let mut modules = Vec::new();
    for name in PBR.modules().expect("the library is readable") {
        let path = PBR.root().join(format!("{}.wgsl", name.replace("::", "/")));
        let mut text = std::fs::read_to_string(path).expect("the library is readable");
        if name == module {
            assert!(text.contains(original), "`{original}` isn't in {module}.wgsl any more");
            text = text.replacen(original, fault, 1);
        }
        modules.push((name, text));
    }
    Package::from_modules("mutant", modules)
}

#[track_caller]
fn disagreement<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the fault was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

fn schlick(package: &Package) -> Result<karat::Agreement, Failure> {
    package
        .function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .try_agrees_with(fresnel::schlick, Ulp(11.0))
}

#[test]
fn the_unchanged_library_agrees() {
    let agreement = schlick(&mutant("fresnel", "abs(1.0 - v_dot_h)", "abs(1.0 - v_dot_h)"));
    assert_eq!(agreement.expect("no fault is planted").cases, 65_536);
}

#[test]
fn a_wrong_constant_in_schlick() {
    let faults = [
        ("f0 + (1.0 - f0)", "f0 + (0.999 - f0)"),
        ("abs(1.0 - v_dot_h)", "abs(1.0001 - v_dot_h)"),
        ("f0 + (1.0 - f0)", "f0 - (1.0 - f0)"),
        ("pow5(abs(1.0 - v_dot_h))", "abs(1.0 - v_dot_h)"),
    ];
    for (original, fault) in faults {
        let found = disagreement(schlick(&mutant("fresnel", original, fault)));
        assert!(found.paths.iter().all(|path| path.census.failures > 0), "{fault}");
    }
    let found = disagreement(schlick(&mutant("math", "x2 * x2 * x", "x2 * x2")));
    assert_eq!(found.function.path, "fresnel::schlick", "a fault in what it calls is seen too");
}

#[test]
fn swapped_arguments() {
    let package = mutant(
        "geometry",
        "fn smith_g1(alpha: f32, n_dot_x: f32)",
        "fn smith_g1(n_dot_x: f32, alpha: f32)",
    );
    let swapped = package
        .function("geometry::smith_g1")
        .over((1e-4..=1.0, 0.0..=1.0))
        .try_agrees_with(geometry::smith_g1, Ulp(10.0));
    disagreement(swapped);
    let package = mutant("layering", "(environment - base)", "(base - environment)");
    let coat = package
        .function("layering::thin_coat")
        .over((Just(Vec3::ONE), Just(Vec3::ZERO), 0.0..=1.0))
        .try_agrees_with(shaders::layering::thin_coat, Ulp(14.0).or(Abs(3e-5)));
    disagreement(coat);
}

/// 65,536 inputs, one of which gives NaN (or an infinity): found under the loosest tolerance.
#[test]
fn one_bad_result_of_65536() {
    for (bits, nan, infinite) in [("0x7fc00000u", 1, 0), ("0x7f800000u", 0, 1)] {
        let wgsl = format!(
            "fn f(i: u32) -> f32 {{ return select(1.0, bitcast<f32>(i - 54321u + {bits}), \
             i == 54321u); }}"
        );
        let package = Package::from_source("planted", wgsl);
        let over = || package.function("f").over(Integers(0..=65_535_u32));
        let loose = Abs(1e300).or(Rel(1e300));
        let found = disagreement(over().try_agrees_with(|_: u32| 1.0, loose));
        for path in &found.paths {
            assert_eq!((path.census.cases, path.census.failures), (65_536, 1));
            assert_eq!((path.census.nan, path.census.infinite), (nan, infinite));
            assert_eq!(path.worst.arguments, [("i".to_owned(), "54321".to_owned())]);
        }
        disagreement(over().try_satisfies("is anything", |_, _: f32| true));
        disagreement(over().try_invariant_under(|i| i ^ 1, Abs(1e300)));
    }
}

#[test]
fn a_statement_that_does_not_hold() {
    let found = PBR
        .function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .try_satisfies("is below 0.999", |_, f: Vec3| f.max_element() < 0.999);
    assert_eq!(disagreement(found).check, "satisfies");
}

#[test]
fn a_function_that_is_not_symmetric() {
    let package = mutant("geometry", "masking + shadowing", "masking + 1.001 * shadowing");
    let found = package
        .function("geometry::smith_correlated")
        .over((1e-4..=1.0, 0.0..=1.0, 0.0..=1.0))
        .try_invariant_under(|(alpha, v, l)| (alpha, l, v), Ulp(2.0));
    assert_eq!(disagreement(found).check, "invariant_under");
}

/// The tolerance of the last component counts: only `z` is wrong, and only `z` is strict.
#[test]
fn a_fault_in_the_last_component() {
    let wgsl = "fn f(x: f32) -> vec3f { return vec3f(x, x, x * 1.001); }";
    let package = Package::from_source("planted", wgsl);
    let tolerance = Tolerance::per_lane([Rel(0.1).into(), Rel(0.1).into(), Ulp(1.0).into()]);
    let found = package.function("f").over(1.0..=2.0).try_agrees_with(DVec3::splat, tolerance);
    assert!(disagreement(found).paths.iter().all(|path| path.worst.component == ".z"));
}

#[test]
fn a_reference_that_is_not_a_number() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let found = package.function("f").over(-1.0..=1.0).try_agrees_with(f64::sqrt, Abs(10.0));
    assert!(matches!(found, Err(Failure::Reference { .. })), "{found:?}");
}

#[test]
fn nothing_to_compare() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let identity = |x: f64| x;
    let found = [
        package.function("f").over(0.0..=1.0).cases(0).try_agrees_with(identity, Ulp(0.0)),
        package.function("f").over(OneOf::<f32>(vec![])).try_agrees_with(identity, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0).filter(|_: &f32| false))
            .try_agrees_with(identity, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0).filter(|x: &f32| x.to_bits() % 1_000_003 == 1))
            .try_agrees_with(identity, Ulp(0.0)),
        package.function("f").over(1.0..=0.0).try_agrees_with(identity, Ulp(0.0)),
    ];
    for (index, found) in found.iter().enumerate() {
        assert!(matches!(found, Err(Failure::Domain { .. })), "{index}: {found:?}");
    }
}

/// A transformation that changes nothing, and bounds that bound nothing.
#[test]
fn a_check_that_could_not_fail() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let over = || package.function("f").over(0.0..=1.0);
    let found = over().try_invariant_under(|x| x, Ulp(0.0));
    assert!(matches!(found, Err(Failure::Domain { .. })), "{found:?}");
    for bound in [f64::INFINITY, f64::NAN, -1.0] {
        let tolerances = [Tolerance::from(Ulp(bound)), Rel(1.0).or(Abs(bound))];
        for tolerance in tolerances {
            let found = over().try_agrees_with(|_: f64| 5.0, tolerance);
            assert!(matches!(found, Err(Failure::Signature { .. })), "{bound}: {found:?}");
        }
    }
    let pictures = Package::from_source("gradient", include_str!("planted/gradient.wgsl"));
    let goldens = Goldens::open("no such folder".as_ref());
    for relative in [f32::NAN, f32::INFINITY, -1.0] {
        let frame = pictures.frame("", 8, 8).fullscreen("corners", "gradient").tolerance(relative);
        let error = frame.try_matches(&goldens, "gradient").expect_err("a useless tolerance");
        assert!(error.to_string().contains("the tolerance of the frame is"), "{error}");
    }
}

/// Names that the kernel or WGSL itself uses would change what is computed.
#[test]
fn shaders_that_redefine_what_the_kernel_uses() {
    let shadows = [
        "fn select(a: u32, b: u32, c: bool) -> u32 { return b; }\n\
         fn f(x: f32) -> bool { return select(0u, 1u, x > 0.0) == 7u; }",
        "fn clamp(x: f32, a: f32, b: f32) -> f32 { return x; }\n\
         fn f(x: f32) -> bool { return clamp(x, 0.0, 1.0) > 0.0; }",
        "fn karat_case(x: f32) -> f32 { return x; }\nfn f(x: f32) -> bool { return karat_case(x) > 0.0; }",
    ];
    for wgsl in shadows {
        let package = Package::from_source("planted", wgsl);
        let found = package.function("f").over(0.0..=1.0).try_agrees_with(|_: f64| true, Ulp(0.0));
        let error = found.expect_err("a name is redefined").to_string();
        assert!(error.contains("can't be declared in a shader under test"), "{error}");
    }
}

/// A result that depends on other cases of its dispatch is no function of its arguments.
#[test]
fn functions_that_share_state_between_cases() {
    let shared = [
        ("var<workgroup> w: array<f32, 1>;\nfn f(x: f32) -> f32 { w[0] = x; return w[0]; }", "w"),
        (
            "@group(0) @binding(0) var<storage, read_write> s: array<f32, 4>;\n\
          fn f(x: f32) -> f32 { s[0] += x; return s[0]; }",
            "s",
        ),
    ];
    for (wgsl, name) in shared {
        let package = Package::from_source("planted", wgsl);
        let found = package.function("f").over(0.0..=1.0).try_agrees_with(|x: f64| x, Ulp(0.0));
        let error = found.expect_err("state is shared").to_string();
        assert!(error.contains("which other cases of the same dispatch see"), "{error}");
        assert!(error.contains(&format!("`{name}`")), "{error}");
    }
}

karat::shareable! {
    struct Gains mirrors GainsMirror { gain: f32, bias: f32 }
}

karat::shareable! {
    struct Swapped mirrors SwappedMirror { bias: f32, gain: f32 }
}

/// Fixtures are compared with their variables by type and by the names of members.
#[test]
fn fixtures_of_another_type() {
    let wgsl = "struct Gains { gain: f32, bias: f32 }\n\
                @group(0) @binding(0) var<uniform> gains: Gains;\n\
                @group(0) @binding(1) var<storage, read> table: array<f32>;\n\
                fn f(x: f32) -> f32 { return gains.gain * x + gains.bias + table[0]; }";
    let package = Package::from_source("planted", wgsl);
    let check = |gains: Uniform, table: Storage| {
        let probe = package.function("f").with("gains", gains).with("table", table);
        probe.over(0.0..=1.0).try_agrees_with(|x: f64| 2.0 * x + 3.5, Abs(1e-6))
    };
    let right = || Uniform::new(Gains { gain: 2.0, bias: 3.0 });
    let table = || Storage::new([0.5_f32]);
    check(right(), table()).expect("the fixtures fit");
    let swapped = Uniform::new(Swapped { bias: 3.0, gain: 2.0 });
    let wrong = [
        (swapped, table(), "holds { gain: f32, bias: f32 }, the fixture { bias: f32, gain: f32 }"),
        (Uniform::new([1.0_f32; 2]), table(), "holds { gain: f32, bias: f32 }, the fixture array"),
        (right(), Storage::new([7_u32]), "holds f32, the fixture u32"),
        (right(), Storage::new(Vec::<f32>::new()), "is empty"),
    ];
    for (gains, table, message) in wrong {
        let error = check(gains, table).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// Many threads share a device: each gets its own results, every time.
#[test]
fn many_threads_on_one_device() {
    let package = Package::from_source("s", "fn f(x: f32, k: f32) -> f32 { return x + k; }");
    std::thread::scope(|scope| {
        for thread in 0..8_u8 {
            let package = &package;
            scope.spawn(move || {
                for round in 0..25_u8 {
                    let k = f32::from(thread) + f32::from(round);
                    package
                        .function("f")
                        .over((0.0..=1.0, Just(k)))
                        .cases(257)
                        .try_agrees_with(|x: f64, k: f64| x + k, Ulp(1.0))
                        .expect("each thread reads its own results");
                }
            });
        }
    });
}

#[test]
fn a_domain_or_reference_of_other_types() {
    let package = Package::from_source("planted", "fn f(x: f32, n: u32) -> f32 { return x; }");
    let mismatches = [
        package.function("f").over(0.0..=1.0).try_agrees_with(|x: f64| x, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0, Integers(0..=7_i32)))
            .try_agrees_with(|x: f64, _: i32| x, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0, Integers(0..=7_u32)))
            .try_agrees_with(|x: f64, _: u32| DVec3::splat(x), Ulp(0.0)),
        package.function("f").over((0.0..=1.0, Integers(0..=7_u32))).try_agrees_with(
            |x: f64, _: u32| x,
            Tolerance::per_lane([Ulp(0.0).into(), Ulp(0.0).into()]),
        ),
    ];
    let texts = mismatches.map(|found| match found {
        Err(failure @ Failure::Signature { .. }) => failure.to_string(),
        other => panic!("not a mismatch of signatures: {other:?}"),
    });
    assert_eq!(
        texts[0],
        "`f` takes (f32, u32), the domain draws (f32)\n  f(x: f32, n: u32) -> f32\n  at <planted>:1:1"
    );
    assert!(texts[1].contains("takes (f32, u32), the domain draws (f32, i32)"), "{}", texts[1]);
    assert!(texts[2].contains("returns f32, the reference returns vec3<f32>"), "{}", texts[2]);
    assert!(texts[3].contains("returns 1 components, the tolerance is declared for 2"));
}

#[test]
fn an_unknown_function_and_a_missing_fixture() {
    let error =
        PBR.function("fresnel::schlik").over(0.0..=1.0).try_agrees_with(|x: f64| x, Ulp(0.0));
    assert!(error.expect_err("unknown").to_string().contains("did you mean `fresnel::schlick`?"));

    let radiance = || PBR.function("environment::radiance");
    let constant = |_: DVec3| DVec3::ONE;
    let message = |result: Result<karat::Agreement, Failure>| match result {
        Err(Failure::Probe(ProbeError::Fixture(error))) => error.to_string(),
        other => panic!("not an error of fixtures: {other:?}"),
    };
    let cube = || CubeMap::constant(Vec3::ONE);
    assert_eq!(
        message(radiance().over(UnitVector).try_agrees_with(constant, Ulp(0.0))),
        "`environment::environment` (texture_cube<f32>) has no fixture; add \
         `.with(\"environment::environment\", ...)`"
    );
    let misspelt =
        radiance().with("enviroment", cube()).with("environment_sampler", Sampler::Linear);
    assert!(
        message(misspelt.over(UnitVector).try_agrees_with(constant, Ulp(0.0)))
            .contains("did you mean `environment`?")
    );
    let wrong = radiance()
        .with("environment", Texture::constant(glam::Vec4::ONE))
        .with("environment_sampler", Sampler::Linear);
    assert!(
        message(wrong.over(UnitVector).try_agrees_with(constant, Ulp(0.0)))
            .contains("is a texture_cube<f32>, the fixture is a Texture")
    );
}

/// What a failure says, with what differs between machines taken out.
#[test]
fn the_message_shows_line_inputs_values_error_census_and_replay() {
    let fault = "abs(1.0 - v_dot_h) * 1.01";
    let found = disagreement(schlick(&mutant("fresnel", "abs(1.0 - v_dot_h)", fault)));
    let text = found.to_string();
    let at = found.function.span.to_string();
    for part in [
        "error: `fresnel::schlick` fails agrees_with: 11 ulp",
        &at,
        "fn schlick(f0: vec3f, v_dot_h: f32) -> vec3f {",
        "of 65536 cases fail (",
        "too high",
        "worst (case ",
        "     f0 = (",
        "v_dot_h = ",
        " (0x1.",
        "error = ",
        " ulp (11 allowed)",
        "first (case ",
        "replay: KARAT_PATHS=",
        "KARAT_SEED=0x",
        "KARAT_CASE=",
        "cargo test -p tests --test must_fail -- --exact \
         the_message_shows_line_inputs_values_error_census_and_replay",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
}

/// Runs a planted fault in a process of its own.
fn planted(fault: &[&str], environment: &[(&str, &str)]) -> (Output, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_planted"));
    for name in ["CI", "KARAT_PATHS", "KARAT_REQUIRE", "KARAT_RECORD"] {
        command.env_remove(name);
    }
    let output = command
        .args(fault)
        .envs(environment.iter().copied())
        .output()
        .expect("the planted program was built with this test");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, text)
}

#[test]
fn no_fault_succeeds() {
    let (output, text) = planted(&["none"], &[]);
    assert!(output.status.success(), "{text}");
}

/// The replay command runs the failing case alone, with the same inputs.
#[test]
fn replay() {
    let (_, text) = planted(&["too_large"], &[]);
    let line = text.lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words = line.expect("a failure says how to replay it").split(' ');
    let environment: Vec<(&str, &str)> = words.map_while(|word| word.split_once('=')).collect();
    assert_eq!(environment.len(), 3, "path, seed and case: {environment:?}");
    let (output, again) = planted(&["too_large"], &environment);
    assert!(!output.status.success(), "{again}");
    assert!(again.contains("1 of 1 cases fail"), "{again}");
    let worst = |text: &str| {
        let from = text.find("  worst (case").expect("a failure shows the worst case");
        text[from..].lines().take(6).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(worst(&text), worst(&again));
    let (output, text) = planted(&["too_large"], &[("KARAT_CASE", "99999999")]);
    assert!(!output.status.success() && text.contains("none with index 99999999"), "{text}");
}

/// Mesa and the loader find no driver: what is required must run, and something must run at all.
#[test]
fn no_adapter() {
    let hidden = [
        ("VK_DRIVER_FILES", "/dev/null"),
        ("VK_ICD_FILENAMES", "/dev/null"),
        ("KARAT_REQUIRE", "vulkan"),
    ];
    let (output, text) = planted(&["none"], &hidden);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("execution path `vulkan` is required, but unavailable"), "{text}");
    let (output, text) = planted(&["none"], &[("KARAT_ADAPTER", "no such adapter")]);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("no execution path opens on this machine"), "{text}");
    let (output, text) = planted(&["none"], &[("KARAT_PATHS", "vulcan")]);
    assert!(!output.status.success() && text.contains("did you mean `vulkan`?"), "{text}");
}

/// A shader that never ends is reported within the deadline, and nothing stays behind.
#[test]
fn an_endless_loop() {
    let open = Path::ALL.into_iter().filter(|path| karat::adapter(*path).is_ok());
    let open: Vec<Path> = open.collect();
    assert!(!open.is_empty(), "no execution path opens, so nothing would be checked");
    for path in open {
        let start = Instant::now();
        let environment = [("KARAT_DEADLINE", "1.5"), ("KARAT_PATHS", path.name())];
        let (output, text) = planted(&["endless_loop"], &environment);
        assert!(!output.status.success(), "{text}");
        assert!(text.contains(&format!("`endless` on path {path}")), "{text}");
        assert!(text.contains("did not finish within 1.5 s"), "{text}");
        // Collecting its output has waited for the process: it is gone, not a zombie.
        assert!(start.elapsed() < Duration::from_secs(30), "on {path}: {:?}", start.elapsed());
    }
}

fn golden_fault(folder: &FilePath, environment: &[(&str, &str)]) -> (bool, String) {
    let folder = folder.display().to_string();
    let (output, text) = planted(&["golden", &folder], environment);
    (output.status.success(), text)
}

/// Renders, accepts, agrees; then the golden is damaged in each way there is.
#[test]
fn goldens_that_are_missing_shifted_resized_or_corrupt() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let golden = folder.path().join("gradient.exr");
    let pending = folder.path().join("gradient.new.exr");

    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(!agrees && text.contains("has no golden"), "{text}");
    assert!(pending.is_file() && !golden.exists(), "only accepting writes a golden");

    let goldens = Goldens::open(folder.path());
    let accept = |because: &str| {
        let pending = goldens.select("gradient").expect("it is pending");
        let because = because.to_owned();
        goldens.accept(&pending[0], &Acceptance { because, by: None, any_adapter: true })
    };
    assert!(accept(" ").is_err(), "a reason is needed");
    accept("the first one").expect("accepted");
    assert!(golden.is_file() && folder.path().join("gradient.toml").is_file() && !pending.exists());
    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(agrees, "{text}");

    let (original, metadata) = Image::read_exr(&golden).expect("just written");
    let bytes = std::fs::read(&golden).expect("just written");
    let plant = |image: &Image| {
        image.write_exr(&golden, Precision::Half, metadata.as_deref()).expect("written");
        let planted = std::fs::read(&golden).expect("just written");
        let (agrees, text) = golden_fault(folder.path(), &[]);
        assert!(!agrees, "the fault was not seen: {text}");
        assert_eq!(std::fs::read(&golden).expect("there"), planted, "goldens aren't overwritten");
        text
    };

    let mut shifted = original.clone();
    shifted.pixels_mut().rotate_right(1);
    assert!(plant(&shifted).contains("pixels are off"));
    let mut one = original.clone();
    one.pixels_mut()[300][2] *= 1.01;
    assert!(plant(&one).contains("1 of 512 pixels are off by more than rel 1e-3"));
    let mut broken = original.clone();
    broken.pixels_mut()[0][0] = f32::NAN;
    assert!(plant(&broken).contains("the golden itself has 1 pixels with NaN"));
    let resized = Image::new(16, 32, original.pixels().to_vec());
    assert!(plant(&resized).contains("it is 32 x 16, the golden 16 x 32"));

    std::fs::write(&golden, &bytes[..bytes.len() / 2]).expect("written");
    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(!agrees && text.contains("isn't a readable OpenEXR image"), "{text}");
    assert_eq!(std::fs::metadata(&golden).expect("there").len(), bytes.len() as u64 / 2);

    // The frame that was pending was compared with another golden than this one.
    plant(&shifted);
    original.write_exr(&golden, Precision::Half, metadata.as_deref()).expect("written");
    assert!(accept("stale").is_err_and(|error| error.to_string().contains("has changed since")));
}

/// A frame with NaN is never right: not as a frame, and not as a golden.
#[test]
fn a_frame_with_nan_is_not_accepted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder_name = folder.path().display().to_string();
    let (output, text) = planted(&["nan_frame", &folder_name], &[]);
    assert!(!output.status.success() && text.contains("512 pixels with NaN"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("gradient").expect("it is pending");
    let acceptance = Acceptance { because: "why".to_owned(), by: None, any_adapter: true };
    let error = goldens.accept(&pending[0], &acceptance).expect_err("it has NaN");
    assert!(error.to_string().contains("nothing could ever agree with it"), "{error}");
}

/// In CI nothing is written beside the goldens.
#[test]
fn ci_leaves_the_folder_of_goldens_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (agrees, text) = golden_fault(folder.path(), &[("CI", "true")]);
    assert!(!agrees && text.contains("has no golden"), "{text}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
    assert!(text.contains("gradient.new.exr"), "the pending file is named: {text}");
}

/// A golden that wasn't rendered on lavapipe would fail on every other machine.
#[test]
fn accepting_off_the_canonical_rasteriser_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, text) = golden_fault(folder.path(), &[("KARAT_PATHS", "gl")]);
    assert!(text.contains("has no golden"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("*").expect("it is pending");
    let acceptance = Acceptance { because: "why".to_owned(), by: None, any_adapter: false };
    let error = goldens.accept(&pending[0], &acceptance).expect_err("rendered on GL");
    assert!(error.to_string().contains("goldens are made on lavapipe"), "{error}");
}

/// The midpoint rule in the squared sine and the azimuth, where the cosine is in the measure: the
/// directions of a hemisphere about +Z and the weights of an integral of `f cos`.
fn hemisphere(size: u16) -> Vec<(Vec3, f64)> {
    let at = |index: u16| (f64::from(index) + 0.5) / f64::from(size);
    let node = |row: u16, column: u16| {
        let (sine_squared, azimuth) = (at(row), TAU * at(column));
        let (sine, cosine) = (sine_squared.sqrt(), (1.0 - sine_squared).sqrt());
        let l = DVec3::new(sine * azimuth.cos(), sine * azimuth.sin(), cosine);
        (l.as_vec3(), PI / (f64::from(size) * f64::from(size)))
    };
    (0..size).flat_map(|row| (0..size).map(move |column| node(row, column))).collect()
}

/// A diffuse BRDF whose factor is planted.
fn diffuse(factor: &str) -> Package {
    let wgsl = format!(
        "fn eval(albedo: vec3f, l: vec3f) -> vec3f {{ return albedo * select(0.0, {factor}, l.z > 0.0); }}"
    );
    Package::from_modules("planted", [("brdf", wgsl)])
}

fn albedo_rule(albedo: &Vec3) -> Vec<((Vec3, Vec3), f64)> {
    hemisphere(16).into_iter().map(|(l, weight)| ((*albedo, l), weight)).collect()
}

/// Rounding of `albedo / pi` and of the planted constant: two steps of `f32`.
const ALBEDO: Rel = Rel(1.2e-7);

#[test]
fn an_integral_that_is_right() {
    let package = diffuse("0.318309886");
    let integral = || package.function("brdf::eval").integral(UnitRgb, albedo_rule);
    let agreement = integral().agrees_with(|albedo| albedo.as_dvec3(), ALBEDO);
    assert_eq!(agreement.cases, 256);
    let agreement = integral().cases(1000).try_is_at_most(|_| 1.0, 1.2e-7);
    assert_eq!(agreement.expect("no albedo is above 1").cases, 1000);
    let cases = OneOf(vec![Vec3::ZERO, Vec3::splat(0.5), Vec3::ONE]);
    let finite = package.function("brdf::eval").integral(cases, albedo_rule);
    let agreement = finite.try_is_at_most(|albedo| albedo.as_dvec3(), 1.2e-7);
    assert_eq!(agreement.expect("each value of a finite domain").cases, 3);
}

/// A third in place of 1/pi makes every albedo pi/3 times as large.
#[test]
fn a_wrong_constant_in_an_integral() {
    let package = diffuse("0.33333334");
    let over = |cases| package.function("brdf::eval").integral(OneOf(cases), albedo_rule);
    let found = over([0.0, 0.25, 0.5, 0.75, 1.0].map(Vec3::splat).to_vec());
    let found = disagreement(found.try_agrees_with(|albedo| albedo.as_dvec3(), ALBEDO));
    assert_eq!((found.check, &*found.assertion), ("integral.agrees_with", "rel 1.2e-7"));
    for path in &found.paths {
        assert_eq!((path.census.cases, path.census.failures, path.census.too_high), (5, 4, 4));
        assert!(path.replay.contains("KARAT_CASE=brdf::eval/integral.agrees_with/"), "{found}");
    }
    let found = over(vec![Vec3::new(0.0, 0.0, 0.75)]);
    let found = disagreement(found.try_agrees_with(|albedo| albedo.as_dvec3(), ALBEDO));
    for path in &found.paths {
        let integral = path.worst.integral.as_ref().expect("the check is one of integrals");
        assert_eq!((&*path.worst.component, integral.nodes), (".z", 256));
        assert!((integral.value - 0.25 * PI).abs() < 1e-7, "{found}");
    }
    let text = found.to_string();
    for part in [
        "error: `brdf::eval` fails integral.agrees_with: rel 1.2e-7",
        "  1 of 1 cases fail (100.000%), 1 too high\n  worst (case 0)\n        \
         case = Vec3(0.0, 0.0, 0.75)\n    integral = (0, 0, 0.785398",
        ")  over 256 nodes\n      actual = 0.785398",
        "  at .z\n    expected = 0.75\n       error = rel 0.0472 (1.20e-7 allowed)\n  replay: KARAT",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
}

#[test]
fn an_integral_above_its_bound() {
    let package = diffuse("0.33333334");
    let integral = || package.function("brdf::eval").integral(Just(Vec3::splat(0.75)), albedo_rule);
    let found = disagreement(integral().try_is_at_most(|_| 0.75, 0.03));
    assert_eq!(
        (found.check, &*found.assertion),
        ("integral.is_at_most", "its bound, slack abs 3e-2")
    );
    let text = found.to_string();
    let part = "at most = 0.75\n       error = abs 0.0354 (0.03 allowed)";
    assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    integral().try_is_at_most(|_| 0.75, 0.036).expect("the excess is 0.0354");
    integral().try_is_at_most(|_| 0.786, 0.0).expect("the bound is larger");
    // A bound for each component: only that of the last one is exceeded.
    let found = disagreement(integral().try_is_at_most(|_| DVec3::new(1.0, 1.0, 0.7), 0.0));
    assert!(found.paths.iter().all(|path| path.worst.component == ".z"), "{found}");
    // Exactly the bound: each term and their sum are powers of two.
    let package = diffuse("0.5");
    let four = |albedo: &Vec3| vec![((*albedo, Vec3::Z), 0.5); 4];
    let integral = || package.function("brdf::eval").integral(Just(Vec3::splat(0.25)), four);
    integral().try_is_at_most(|_| 0.25, 0.0).expect("the integral is the bound");
    disagreement(integral().try_is_at_most(|_| 0.25_f64.next_down(), 0.0));
}

/// 100,000 nodes in two dispatches, one of which gives NaN or an infinity, at any weight.
#[test]
fn one_bad_node_of_an_integral() {
    for (bits, nan, infinite) in [("0x7fc00000u", 3, 0), ("0xff800000u", 0, 3)] {
        let wgsl = format!(
            "fn f(i: u32, bad: u32) -> f32 {{ return select(1.0, bitcast<f32>(i - bad + {bits}), \
             i == bad); }}"
        );
        let package = Package::from_source("planted", wgsl);
        for weight in [1e-5, 0.0, -1e-5] {
            let bad = OneOf(vec![0_u32, 99_999, 70_000, 100_000]);
            let rule = move |bad: &u32| (0..100_000_u32).map(|i| ((i, *bad), weight)).collect();
            let integral = || package.function("f").integral(bad.clone(), rule);
            let loosest = Abs(1e300).or(Rel(1e300));
            let found = [
                disagreement(integral().try_agrees_with(|_| 1.0, loosest)),
                disagreement(integral().try_is_at_most(|_| 1e300, 1e300)),
            ];
            for path in found.iter().flat_map(|found| &found.paths) {
                assert_eq!((path.census.cases, path.census.failures), (4, 3));
                assert_eq!((path.census.nan, path.census.infinite), (nan, infinite));
                assert_eq!((path.worst.case, path.first.is_none()), (0, true));
            }
        }
        let one = package.function("f").integral(Just(70_000_u32), |bad| {
            (0..100_000_u32).map(|i| ((i, *bad), 0.25)).collect()
        });
        let text = disagreement(one.try_is_at_most(|_| 1e300, 0.0)).to_string();
        let value = if nan > 0 { "NaN" } else { "-inf" };
        let part = format!(
            "        case = 70000\n    integral = {value}  over 100000 nodes\n        node = 70000: \
             i = 70000, bad = 70000 (weight 0.25)\n    returned = {value}\n     at most = 1e300\n"
        );
        assert!(text.contains(&part), "`{part}` is missing in:\n{text}");
    }
}

/// A rule without nodes, with weights that aren't numbers, and expectations that aren't.
#[test]
fn an_integral_of_nothing() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let rule = |bad: Option<f64>| {
        move |case: &f32| -> Vec<(f32, f64)> {
            match bad {
                None if *case > 0.5 => Vec::new(),
                Some(weight) if *case > 0.5 => vec![(*case, 0.5), (*case, weight)],
                _ => vec![(*case, 1.0)],
            }
        }
    };
    let integral = |bad| package.function("f").integral(Grid::linear(0.0..=1.0, 5), rule(bad));
    let refused = |found: Result<karat::Agreement, Failure>| match found {
        Err(failure @ Failure::Rule { .. }) => failure.to_string(),
        other => panic!("the rule was not refused: {other:?}"),
    };
    let empty = "the quadrature rule of `f` has no nodes, so nothing would be integrated, for case \
                 3: 0.75";
    assert_eq!(refused(integral(None).try_agrees_with(|x| f64::from(*x), Abs(1e300))), empty);
    assert_eq!(refused(integral(None).try_is_at_most(|_| 1e300, 1e300)), empty);
    for weight in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let text = refused(integral(Some(weight)).try_is_at_most(|_| 1e300, 1e300));
        let expected = format!(
            "the quadrature rule of `f` has the weight {weight} at node 1 for case 3: 0.75"
        );
        assert_eq!(text, expected);
    }

    let whole = || package.function("f").integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)]);
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let found =
            [whole().try_agrees_with(|_| value, Abs(1.0)), whole().try_is_at_most(|_| value, 1.0)];
        assert!(found.iter().all(|f| matches!(f, Err(Failure::Reference { .. }))), "{found:?}");
    }
    for bound in [f64::NAN, f64::INFINITY, -1.0] {
        let found =
            [whole().try_agrees_with(|_| 0.5, Abs(bound)), whole().try_is_at_most(|_| 0.5, bound)];
        assert!(found.iter().all(|f| matches!(f, Err(Failure::Signature { .. }))), "{found:?}");
    }
    let none = [
        whole().cases(0).try_is_at_most(|_| 1.0, 0.0),
        package
            .function("f")
            .integral(OneOf::<f32>(vec![]), |x| vec![(*x, 1.0)])
            .try_is_at_most(|_| 1.0, 0.0),
        package
            .function("f")
            .integral((0.0..=1.0).filter(|_: &f32| false), |x| vec![(*x, 1.0)])
            .try_is_at_most(|_| 1.0, 0.0),
    ];
    assert!(none.iter().all(|found| matches!(found, Err(Failure::Domain { .. }))), "{none:?}");
}

#[test]
fn an_integral_of_other_types() {
    let wgsl =
        "fn f(x: f32, n: u32) -> vec2f { return vec2f(x); } fn g(n: u32) -> u32 { return n; }";
    let package = Package::from_source("planted", wgsl);
    let right = |x: &f32| vec![((*x, 7_u32), 1.0)];
    let whole = || package.function("f").integral(0.0..=1.0_f32, right);
    let found = [
        package
            .function("f")
            .integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)])
            .try_is_at_most(|_| 1.0, 0.0),
        whole().try_agrees_with(|_| 1.0, Abs(1.0)),
        whole().try_is_at_most(|_| DVec3::ONE, 0.0),
        whole().try_agrees_with(
            |x| glam::DVec2::splat(f64::from(*x)),
            Tolerance::per_lane([Abs(1.0).into()]),
        ),
        package
            .function("g")
            .integral(Just(7_u32), |n| vec![(*n, 1.0)])
            .try_agrees_with(|n| *n, Abs(1.0)),
    ];
    let expected = [
        "takes (f32, u32), the quadrature rule supplies (f32)\n",
        "returns vec2<f32>, the expected integral is f32\n",
        "returns vec2<f32>, the bound is vec3<f32>\n",
        "returns 2 components, the tolerance is declared for 1\n",
        "returns u32, and an integral is a sum of floats\n",
    ];
    for (found, expected) in found.into_iter().zip(expected) {
        match found {
            Err(failure @ Failure::Signature { .. }) => {
                assert!(failure.to_string().contains(expected), "{failure}");
            }
            other => panic!("not a mismatch of signatures: {other:?}"),
        }
    }
    whole().try_is_at_most(|_| 1.0, 0.0).expect("a bound for both components");
}

/// The replay command takes the failing integral alone; the record counts integrals and nodes.
#[test]
fn an_integral_is_replayed_and_recorded() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder_name = folder.path().display().to_string();
    let (output, text) = planted(&["integral"], &[("KARAT_RECORD", &folder_name)]);
    assert!(!output.status.success(), "{text}");
    let records = karat::record::read(folder.path()).expect("the verdict was recorded");
    let [record] = &*records else { panic!("one check, {} records", records.len()) };
    assert_eq!(record.verdict, karat::record::Verdict::Fail);
    for path in &record.paths {
        assert_eq!((path.cases, &*path.asserted), (256, "rel 1e-6 (2560 nodes)"));
        assert!(0 < path.failures && path.failures < 256, "{path:?}");
    }
    let line = text.lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words = line.expect("a failure says how to replay it").split(' ');
    let environment: Vec<(&str, &str)> = words.map_while(|word| word.split_once('=')).collect();
    let (output, again) = planted(&["integral"], &environment);
    assert!(!output.status.success() && again.contains("1 of 1 cases fail"), "{again}");
    let worst = |text: &str| {
        let from = text.find("  worst (case").expect("a failure shows the worst case");
        text[from..].lines().take(6).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(worst(&text), worst(&again));
}
