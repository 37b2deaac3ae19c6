//! Frames that nothing rendered, against goldens in a folder of their own.

use tempfile::TempDir;

use super::*;
use crate::metric::{Gate, Measured, Metric, Pair, Rect};

const LAVAPIPE: [&str; 2] = ["llvmpipe (LLVM 15.0.6, 256 bits)", "llvmpipe Mesa 22.3.6"];

fn adapter(path: &str) -> Adapter {
    let [name, driver] = LAVAPIPE.map(str::to_owned);
    Adapter { path: path.to_owned(), name, driver, software: true }
}

/// A ramp with a bright half: 64 x 48 pixels.
fn ramp() -> Image {
    let pixel = |index: u32| {
        let (x, y) = ((index % 64) as f32, (index / 64) as f32);
        if y < 24.0 { [x / 64.0, 0.5, y / 24.0, 1.0] } else { [4.0, 2.0 + y / 64.0, 1.0, 1.0] }
    };
    Image::new(64, 48, (0..64 * 48).map(pixel).collect()).rounded_to(Precision::Half)
}

fn with(changes: &[(u32, u32)], factor: f32) -> Image {
    let mut image = ramp();
    for (x, y) in changes {
        for value in &mut image.pixels_mut()[(y * 64 + x) as usize][..3] {
            *value *= factor;
        }
    }
    image
}

struct Project {
    folder: TempDir,
    goldens: Goldens,
}

impl Project {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let goldens = Goldens { beside: true, ..Goldens::open(folder.path()) };
        Self { folder, goldens }
    }

    /// With a golden made on lavapipe.
    fn with_golden() -> Self {
        let project = Self::new();
        let failed = project.check("vulkan", &ramp(), None, None).expect_err("no golden");
        project.accept(&failed, "first", None).expect("accepted");
        project
    }

    fn check(
        &self,
        path: &str,
        image: &Image,
        tolerance: Option<&FrameTolerance>,
        mask: Option<&Mask>,
    ) -> Result<FrameMargin, GoldenError> {
        let adapter = &adapter(path);
        let frame = Rendered {
            image,
            adapter,
            shader: "shader".to_owned(),
            tolerance,
            mask,
            variance: None,
        };
        self.goldens.check("room/ramp", &frame)
    }

    /// Accepts what a failed frame has left, wherever that is.
    fn accept(
        &self,
        failed: &GoldenError,
        because: &str,
        profile: Option<&str>,
    ) -> Result<Accepted, AcceptError> {
        let (GoldenError::Missing { pending, .. } | GoldenError::Differs { pending, .. }) = failed
        else {
            panic!("nothing is pending: {failed}");
        };
        let path = PathBuf::from(pending);
        let (_, metadata) = Image::read_exr(&path).expect("it was written");
        let provenance: Provenance =
            serde_json::from_str(&metadata.expect("it has facts")).expect("they are ours");
        let case = provenance.case.clone();
        let acceptance = Acceptance {
            because: because.to_owned(),
            by: Some("A. Reviewer".to_owned()),
            profile: profile.map(str::to_owned),
            ..Acceptance::default()
        };
        self.goldens.accept(&Pending { case, path, provenance }, &acceptance)
    }

    /// A message without the names of temporary files.
    fn text(&self, error: &GoldenError) -> String {
        let folder = shown(self.folder.path());
        let text = error.to_string().replace(&folder, "golden");
        let build = shown(&build_output().join("karat/pending"));
        text.replace(&build, "golden")
    }
}

/// Some pixels of an edge, a hole, and what to do about them.
#[test]
fn a_frame_that_differs_says_what_and_where() {
    let project = Project::with_golden();
    let hole: Vec<(u32, u32)> = (8..16).flat_map(|y| (24..32).map(move |x| (x, y))).collect();
    let failed = project.check("vulkan", &with(&hole, 0.25), None, None).expect_err("a hole");
    insta::assert_snapshot!(project.text(&failed), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: 64 of 3072 pixels are off by more than rel 1e-3, within (24, 8) to (31, 15)
      worst: pixel (24, 8) red: 0.09375 instead of 0.375, 750 times what is allowed
      fails  gate rel 1e-3: 750 times what is allowed, at (24, 8)
      fails  largest FLIP tile 0.253 of 0.01, in (16, 0) to (31, 15)
      fails  mean FLIP 0.0272 of 0.005
      FLIP looked at -0.44 to -0.31 stops, as the golden has it
      pixels off at a tolerance of 0.001: 2.083%, 0.01: 2.083%, 0.1: 2.083%, 1: 0.000%
      would pass: a gate of rel 0.76, largest FLIP tile of 0.26, mean FLIP of 0.028
      look at `golden/room/ramp.new.exr`, then `karat accept room/ramp --because "..."` or `karat reject room/ramp`
    "#);
    let strict = FrameTolerance::gate(1e-3);
    let mask = Mask::except(&[Rect::new(0, 0, 32, 12)]);
    let failed = project.check("vulkan", &with(&hole, 1.02), Some(&strict), Some(&mask));
    insta::assert_snapshot!(project.text(&failed.expect_err("the gate alone")), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: 32 of 2688 pixels are off by more than rel 1e-3, within (24, 12) to (31, 15)
      compared: 87.5% of the frame, the mask leaves out the rest
      worst: pixel (24, 15) blue: 0.6376953 instead of 0.625, 20.3 times what is allowed
      fails  gate rel 1e-3: 20.3 times what is allowed, at (24, 15)
      pixels off at a tolerance of 0.001: 1.190%, 0.01: 1.190%, 0.1: 0.000%, 1: 0.000%
      would pass: a gate of rel 0.021
      look at `golden/room/ramp.new.exr`, then `karat accept room/ramp --because "..."` or `karat reject room/ramp`
    "#);
    let mut broken = ramp();
    broken.pixels_mut()[70][1] = f32::NAN;
    broken.pixels_mut()[90][1] = f32::INFINITY;
    let failed = project.check("vulkan", &broken, None, None).expect_err("NaN");
    insta::assert_snapshot!(project.text(&failed), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: it has 1 pixels with NaN and 1 with infinities, first at (6, 1)
      look at `golden/room/ramp.new.exr`, and mend the shader: nothing could ever agree with such a frame
    "#);
    let mut alpha = ramp();
    alpha.pixels_mut()[70][3] = 0.5;
    let failed = project.check("gl", &alpha, None, None).expect_err("alpha");
    insta::assert_snapshot!(project.text(&failed), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: 1 of 3072 pixels are off by more than rel 1e-3, within (6, 1) to (6, 1)
      worst: pixel (6, 1) alpha: 0.5 instead of 1, 500 times what is allowed
      fails  gate rel 1e-3: 500 times what is allowed, at (6, 1)
      fails  largest FLIP tile inf of 0.03 (alpha is off at (6, 1), which FLIP doesn't see)
      fails  mean FLIP inf of 0.005 (alpha is off at (6, 1), which FLIP doesn't see)
      FLIP looked at -0.44 to -0.31 stops, as the golden has it
      pixels off at a tolerance of 0.001: 0.033%, 0.01: 0.033%, 0.1: 0.033%, 1: 0.000%
      would pass: a gate of rel 0.5
      look at `golden/room/ramp.new.exr`, then `karat accept room/ramp --profile gl-llvmpipe --because "..."` or `karat reject room/ramp`
    "#);
}

#[test]
fn what_passes_says_what_decided() {
    let project = Project::with_golden();
    let margin = project.check("vulkan", &ramp(), None, None).expect("equal");
    assert_eq!((margin.decided_by, margin.to_string().as_str()), (Criterion::Bits, "equal"));
    let drift = with(&[(3, 30)], 1.0 + 1.0 / 1024.0);
    let margin = project.check("vulkan", &drift, None, None).expect("within the gate");
    assert_eq!(margin.decided_by, Criterion::Gate);
    assert!(margin.ratio > 0.9 && margin.ratio <= 1.0, "{margin:?}");

    // A pixel of an edge, a twentieth off.
    let edge = with(&[(3, 30)], 1.05);
    let margin = project.check("vulkan", &edge, None, None).expect("FLIP sees next to nothing");
    assert_eq!((margin.decided_by, margin.beyond_gate), (Criterion::Flip, 1));
    insta::assert_snapshot!(margin, @"passes by FLIP: the gate is exceeded by 1 pixels, largest FLIP tile 8.00e-4 of 0.01, mean FLIP 8.61e-5 of 0.005");
    let mask = Mask::only(&[Rect::new(0, 24, 64, 24)]);
    let margin = project.check("vulkan", &edge, None, Some(&mask)).expect("it passes");
    assert!(margin.to_string().ends_with("(compared: 50% of the frame)"), "{margin}");
    assert!(margin.golden.ends_with("room/ramp.exr") && margin.profile.is_none());
    let strict = FrameTolerance::gate(1e-3);
    project.check("vulkan", &edge, Some(&strict), None).expect_err("the gate alone");
}

/// The red channel alone.
#[derive(Debug)]
struct Red(f64);

impl Metric for Red {
    fn name(&self) -> String {
        "red".to_owned()
    }
    fn measure(&self, _: &Pair<'_>) -> Measured {
        Measured::of(self.0)
    }
}

#[test]
fn tolerances_are_trees() {
    use FrameTolerance::{All, Any, FlipMean, FlipTile};
    let project = Project::with_golden();
    let edge = with(&[(3, 30)], 1.05);
    let check = |tolerance: &FrameTolerance| project.check("vulkan", &edge, Some(tolerance), None);
    let red = |value: f64| FrameTolerance::metric(Red(value), 0.5);
    let gate = || FrameTolerance::gate(1e-3);
    for (tolerance, passes) in [
        (FlipTile(0.01), true),
        (FlipTile(1e-6), false),
        (All(vec![gate(), FlipTile(0.01)]), false),
        (Any(vec![FlipTile(1e-6), FlipMean(0.005)]), true),
        (All(vec![FlipTile(0.01), red(0.4)]), true),
        (All(vec![FlipTile(0.01), red(0.6)]), false),
        (red(f64::NAN), false),
        (red(f64::INFINITY), false),
        (Any(vec![red(f64::NAN), All(vec![red(0.5), FlipMean(0.005)])]), true),
        (Gate { relative: 0.0, absolute: Some(1.0) }.into(), true),
        (Gate { relative: 0.0, absolute: Some(0.01) }.into(), false),
    ] {
        assert_eq!(check(&tolerance).is_ok(), passes, "{tolerance}");
    }
    let decided = check(&Any(vec![gate(), All(vec![FlipTile(0.01), red(0.49)])])).expect("passes");
    assert_eq!((decided.decided_by, decided.ratio), (Criterion::Metric, 0.98));
    assert_eq!(decided.tolerance, "rel 1e-3 or (FLIP tile 0.01 and red 0.5)");
    for (useless, reason) in [
        (FrameTolerance::gate(f32::NAN), "NaN; it is a relative difference of at least 0"),
        (FrameTolerance::gate(-1.0), "-1; it is a relative difference of at least 0"),
        (Any(vec![gate(), FlipTile(f64::INFINITY)]), "inf; a bound is a number of at least 0"),
        (All(vec![]), "a list of no bounds; name at least one"),
        (red(1.0), ""),
    ] {
        assert_eq!(useless.unusable().unwrap_or_default(), reason);
    }
    let error = project.check("vulkan", &edge, None, Some(&Mask::only(&[])));
    let error = error.expect_err("nothing is compared").to_string();
    assert_eq!(error, "frame `room/ramp` can't be compared: the mask leaves no pixel to compare");
}

/// A profile's own golden is used by that profile alone, and accepted only where it is needed.
#[test]
fn profiles_have_goldens_of_their_own() {
    let project = Project::with_golden();
    let strict = &FrameTolerance::gate(1e-3);
    let on_gl = with(&[(3, 30), (50, 3)], 1.5);
    let failed = project.check("gl", &on_gl, Some(strict), None).expect_err("it differs on GL");
    let error = project.accept(&failed, "why", Some("gl-nvidia")).expect_err("another profile");
    assert!(error.to_string().contains("was rendered on profile gl-llvmpipe"), "{error}");
    let error = project.accept(&failed, "why", None).expect_err("not lavapipe");
    assert!(matches!(error, AcceptError::Adapter { .. }), "{error}");
    let accepted = project.accept(&failed, "why", Some("gl-llvmpipe")).expect("it fails there");
    assert!(accepted.golden.ends_with("@gl-llvmpipe/room/ramp.exr"), "{accepted:?}");
    assert!(accepted.written && accepted.warnings.is_empty(), "{accepted:?}");

    let margin = project.check("gl", &on_gl, Some(strict), None).expect("its own golden");
    assert_eq!(margin.profile.map(|profile| profile.to_string()).as_deref(), Some("gl-llvmpipe"));
    project.check("vulkan", &ramp(), Some(strict), None).expect("the golden for all");
    project.check("vulkan", &on_gl, Some(strict), None).expect_err("the golden of GL isn't used");
    project.check("metal", &on_gl, Some(strict), None).expect_err("the golden of GL isn't used");

    // What the golden for all passes needs no golden of its own.
    let failed = project.check("gl", &ramp(), Some(strict), None).expect_err("GL has its own");
    assert!(project.text(&failed).contains("from its golden `golden/@gl-llvmpipe/room/ramp.exr`"));
    let error = project.accept(&failed, "why", None).expect_err("it is GL's");
    assert!(matches!(error, AcceptError::Own { .. }), "{error}");
    let error = project.accept(&failed, "why", Some("gl-llvmpipe")).expect_err("not needed");
    insta::assert_snapshot!(error, @"`room/ramp` needs no golden of profile gl-llvmpipe: the golden for all passes there");
    let new = Project::new();
    let failed = new.check("gl", &on_gl, None, None).expect_err("no golden");
    let error = new.accept(&failed, "why", Some("gl-llvmpipe")).expect_err("none for all");
    insta::assert_snapshot!(error, @"`room/ramp` needs no golden of profile gl-llvmpipe: there is no golden for all yet; accept one first");
}

/// The bounds of FLIP are wider on another profile than the golden's.
#[test]
fn another_profile_has_the_wider_bound() {
    let project = Project::with_golden();
    let edge: Vec<(u32, u32)> = (10..14).map(|x| (x, 30)).collect();
    let bound = |path: &str| {
        let margin = project.check(path, &with(&edge, 1.05), None, None).expect("passes");
        let tile = margin.margins.iter().find(|margin| margin.name.contains("tile"));
        tile.expect("FLIP decided").bound
    };
    assert_eq!((bound("vulkan"), bound("gl"), bound("metal")), (0.01, 0.03, 0.03));
}

#[test]
fn the_exposures_are_pinned_when_a_golden_is_accepted() {
    let project = Project::with_golden();
    let facts = std::fs::read_to_string(project.folder.path().join("room/ramp.toml"));
    let facts: Provenance = toml::from_str(&facts.expect("written")).expect("ours");
    let expected = ExposureRange::of(&ramp());
    assert_eq!(facts.exposures, Some(expected));
    let lit = with(&[(1, 1), (2, 1)], 400.0);
    let failed = project.check("vulkan", &lit, None, None).expect_err("two lights");
    assert!(failed.to_string().contains(&format!("FLIP looked at {expected}")), "{failed}");
}

#[test]
fn large_goldens_are_warned_of_and_refused() {
    let noise = |width: u32, height: u32| {
        let bits = |index: u32| {
            let h = index.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let h = ((h >> ((h >> 28) + 4)) ^ h).wrapping_mul(277_803_737);
            (h ^ (h >> 22)) as f32 / 131_072.0
        };
        let pixel = |index: u32| [bits(3 * index), bits(3 * index + 1), bits(3 * index + 2), 1.0];
        Image::new(width, height, (0..width * height).map(pixel).collect())
    };
    let accept = |image: &Image| {
        let project = Project::new();
        let failed = project.check("vulkan", image, None, None).expect_err("no golden");
        let accepted = project.accept(&failed, "first", None);
        let golden = project.folder.path().join("room/ramp.exr");
        assert_eq!(golden.exists(), accepted.is_ok());
        accepted.map(|accepted| accepted.warnings)
    };
    assert_eq!(accept(&noise(80, 60)).expect("small"), Vec::<String>::new());
    let warnings = accept(&noise(200, 200)).expect("large").join("\n");
    assert!(warnings.contains("above 128 KiB, a smaller frame is worth a thought"), "{warnings}");
    let warnings = accept(&Image::new(700, 20, vec![[0.5; 4]; 14_000])).expect("wide").join("\n");
    assert!(warnings.contains("is 700 x 20; 640 x 360 shows most faults"), "{warnings}");
    let error = accept(&noise(640, 360)).expect_err("too large");
    assert!(error.to_string().contains("and at most 1024 are accepted"), "{error}");
}

#[test]
fn a_golden_that_would_not_change_is_not_written() {
    let project = Project::with_golden();
    let golden_file = project.folder.path().join("room/ramp.exr");
    let before = std::fs::read(&golden_file).expect("there");
    let adapter = &adapter("vulkan");
    let (tolerance, mask, variance) = (None, None, None);
    let (image, shader) = (&ramp(), "shader".to_owned());
    let frame = Rendered { image, adapter, shader, tolerance, mask, variance };
    let (hash, precision) = (ramp().hash(), Precision::Half);
    let against = pending::Against { hash, profile: String::new(), precision };
    let case = "room/ramp".to_owned();
    let pending = project.goldens.write_pending(&case, &frame, &against).expect("written");
    let (golden, advice) = (String::new(), String::new());
    let difference = Box::new(FrameDifference::Size { golden: (0, 0), actual: (0, 0) });
    let same = GoldenError::Differs { case, golden, difference, pending, advice };
    let accepted = project.accept(&same, "again", None).expect("nothing speaks against it");
    assert!(!accepted.written && accepted.warnings[0].contains("has these pixels and facts"));
    assert_eq!(std::fs::read(&golden_file).expect("there"), before);

    let edge = with(&[(3, 30)], 1.05);
    let strict = FrameTolerance::gate(1e-3);
    let failed = project.check("vulkan", &edge, Some(&strict), None).expect_err("it differs");
    assert!(project.accept(&failed, "another", None).expect("other pixels").written);
    assert_ne!(std::fs::read(&golden_file).expect("there"), before);
}

/// Pixels that differ by their noise pass by it; a tile that differs by more does not.
#[test]
fn noise_is_kept_with_the_golden() {
    let project = Project::new();
    let check = |image: &Image, variance: f32| {
        let variance = &Image::new(64, 48, vec![[variance; 4]; 64 * 48]);
        let shader = "shader".to_owned();
        let (adapter, variance) = (&adapter("vulkan"), Some(variance));
        let (tolerance, mask) = (None, None);
        let frame = Rendered { image, adapter, shader, tolerance, mask, variance };
        project.goldens.check("room/ramp", &frame)
    };
    // Alternating signs: the mean of a tile stays.
    let noisy = |amplitude: f32, bias: f32| {
        let mut image = ramp();
        for (index, pixel) in (0_u32..).zip(image.pixels_mut()) {
            let sign = if (index + index / 64).is_multiple_of(2) { 1.0 } else { -1.0 };
            for value in &mut pixel[..3] {
                *value += amplitude * sign + bias;
            }
        }
        image
    };
    let without = project.check("vulkan", &ramp(), None, None).expect_err("no golden");
    project.accept(&without, "without variance", None).expect("accepted");
    let failed = check(&noisy(0.1, 0.0), 0.01).expect_err("the golden has no variance");
    assert!(failed.to_string().contains("the golden has no variance: accept the frame again"));
    project.accept(&failed, "with variance", None).expect("accepted");
    let file = project.folder.path().join("room/ramp.variance.exr");
    assert!(file.is_file() && !file.with_file_name("ramp.new.variance.exr").exists());

    let margin = check(&noisy(-0.1, 0.0), 0.01).expect("nothing but noise");
    assert_eq!((margin.decided_by, margin.beyond_gate), (Criterion::Noise, 64 * 48));
    assert!(margin.to_string().starts_with("passes by noise: the gate is exceeded by 3072 pixels"));
    let failed = check(&noisy(-0.1, 0.05), 0.01).expect_err("it is brighter");
    assert!(failed.to_string().contains("noise alone has"), "{failed}");
    check(&noisy(-0.1, 0.0), f32::NAN).expect_err("no variance");
}
