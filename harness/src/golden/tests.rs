//! Frames that nothing rendered, against goldens in a folder of their own.

use tempfile::TempDir;

use super::*;
use crate::image::ExrFile;
use crate::metric::{ExposureRange, Gate, Measured, Metric, Pair, Rect};

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

static NO_FACTS: BTreeMap<String, String> = BTreeMap::new();

fn no_aovs() -> Vec<Part> {
    Vec::new()
}

/// A frame of which nothing is declared.
fn rendered<'a>(image: &'a Image, adapter: &'a Adapter) -> Rendered<'a> {
    Rendered {
        image,
        adapter,
        shader: "shader".to_owned(),
        tolerance: None,
        mask: None,
        variance: None,
        facts: &NO_FACTS,
        aovs: &no_aovs,
        known_issue: false,
    }
}

/// Eight by eight pixels that are off.
fn spot(factor: f32) -> Image {
    let pixels: Vec<_> = (8..16).flat_map(|y| (24..32).map(move |x| (x, y))).collect();
    with(&pixels, factor)
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
        let frame = Rendered { tolerance, mask, ..rendered(image, adapter) };
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
        let pending = pending_at(Path::new(pending));
        let acceptance = Acceptance {
            because: because.to_owned(),
            by: Some("A. Reviewer".to_owned()),
            profile: profile.map(str::to_owned),
            ..Acceptance::default()
        };
        self.goldens.accept(&pending, &acceptance)
    }

    /// Names of the golden's parts.
    fn parts(&self) -> Vec<String> {
        let file = ExrFile::read(&self.folder.path().join("room/ramp.exr")).expect("readable");
        file.parts.into_iter().map(|part| part.name).collect()
    }

    /// A message without the names of temporary files.
    fn text(&self, error: &GoldenError) -> String {
        let folder = shown(self.folder.path());
        let text = error.to_string().replace(&folder, "golden");
        let build = shown(&build_output().join("karat/pending"));
        text.replace(&build, "golden")
    }
}

fn pending_at(path: &Path) -> Pending {
    let (_, metadata) = Image::read_exr(path).expect("it was written");
    let provenance = Provenance::parse(&metadata.expect("it has facts")).expect("they are ours");
    Pending { case: provenance.case.clone(), path: path.to_owned(), provenance }
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
      fails  largest FLIP tile 0.256 of 0.01, in (24, 0) to (39, 15)
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
    insta::assert_snapshot!(margin, @"passes by FLIP: the gate is exceeded by 1 pixels, largest FLIP tile 0.00101 of 0.01, mean FLIP 8.61e-5 of 0.005");
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
    let image = &ramp();
    let against = Against {
        hash: image.hash(),
        tolerance: FrameTolerance::default().to_string(),
        ..Against::default()
    };
    let case = "room/ramp".to_owned();
    let frame = rendered(image, adapter);
    let pending = project.goldens.write_pending(&case, &frame, &against).expect("written");
    let (golden, advice, pending) = (String::new(), String::new(), shown(&pending.path));
    let difference = Box::new(FrameDifference::Size { golden: (0, 0), actual: (0, 0) });
    let same = GoldenError::Differs { case, golden, difference, pending, advice };
    let accepted = project.accept(&same, "again", None).expect("nothing speaks against it");
    assert!(!accepted.written && accepted.warnings[0].contains("has these pixels and facts"));
    assert_eq!(std::fs::read(&golden_file).expect("there"), before);
    // Facts that somebody has edited are those of the image again.
    let sidecar = golden_file.with_extension("toml");
    let facts = std::fs::read_to_string(&sidecar).expect("there");
    std::fs::write(&sidecar, facts.replace("first", "edited")).expect("written");
    let image = &ramp();
    let pending = project.goldens.write_pending("room/ramp", &rendered(image, adapter), &against);
    let acceptance = Acceptance { because: "why".to_owned(), ..Acceptance::default() };
    let accepted = project.goldens.accept(&pending.expect("written"), &acceptance);
    assert!(accepted.expect("nothing speaks against it").written);
    let facts = std::fs::read_to_string(&sidecar).expect("there");
    assert!(facts.contains("because = \"why\""), "{facts}");

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
        let adapter = &adapter("vulkan");
        let frame = Rendered { variance: Some(variance), ..rendered(image, adapter) };
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
    assert_eq!(project.parts(), ["color", "color.variance"]);

    let margin = check(&noisy(-0.1, 0.0), 0.01).expect("nothing but noise");
    assert_eq!((margin.decided_by, margin.beyond_gate), (Criterion::Noise, 64 * 48));
    assert!(margin.to_string().starts_with("passes by noise: the gate is exceeded by 3072 pixels"));
    let failed = check(&noisy(-0.1, 0.05), 0.01).expect_err("it is brighter");
    assert!(failed.to_string().contains("noise alone has"), "{failed}");
    check(&noisy(-0.1, 0.0), f32::NAN).expect_err("no variance");
    // A frame that is no longer noisy leaves no variance.
    let still = project.check("vulkan", &ramp(), None, None).expect_err("the golden was noisy");
    project.accept(&still, "without noise", None).expect("accepted");
    assert_eq!(project.parts(), ["color"]);
}

#[test]
fn what_the_test_found_waits_with_the_frame() {
    let project = Project::with_golden();
    let tolerance = FrameTolerance::All(vec![
        FrameTolerance::gate(2e-3),
        FrameTolerance::metric(Red(f64::INFINITY), 0.5),
    ]);
    let mask = Mask::except(&[Rect::new(0, 0, 32, 12)]);
    let changed = with(&[(3, 30)], 1.5);
    project.check("vulkan", &changed, Some(&tolerance), Some(&mask)).expect_err("it differs");
    let file = project.folder.path().join("room/ramp.new.exr");
    let Provenance { finding, tolerance, compared_with, .. } = pending_at(&file).provenance;
    let FrameFinding { verdict, margins, base_passes } = finding.expect("it was compared");
    assert_eq!(
        verdict,
        "1 of 2688 pixels are off by more than rel 2e-3, within (3, 30) to (3, 30)"
    );
    assert_eq!(tolerance, "rel 2e-3 and red 0.5");
    assert_eq!(compared_with, ramp().hash());
    let [gate, red] = &*margins else { panic!("{margins:?}") };
    assert_eq!((gate.place, gate.passes()), (Some(Rect::new(3, 30, 1, 1)), false));
    assert_eq!((red.name.as_str(), red.value, red.passes()), ("red", f64::INFINITY, false));
    assert!(!base_passes);
    let ExrFile { parts, .. } = ExrFile::read(&file).expect("readable");
    assert_eq!((parts[1].name.as_str(), parts.len()), ("mask", 2));
    let flag = |x: usize, y: usize| parts[1].image.pixels()[64 * y + x][0];
    assert_eq!([flag(0, 0), flag(31, 11), flag(32, 11), flag(31, 12)], [0.0, 0.0, 1.0, 1.0]);

    let mut broken = ramp();
    broken.pixels_mut()[70][1] = f32::NAN;
    project.check("vulkan", &broken, None, None).expect_err("NaN");
    let finding = pending_at(&file).provenance.finding.expect("it was looked at");
    assert_eq!((finding.margins[0].value, finding.margins[0].passes()), (1.0, false));
    assert_eq!(finding.margins[0].place, Some(Rect::new(6, 1, 1, 1)));
}

/// What half floats can't hold is stored in floats, and compared as it is.
#[test]
fn frames_are_stored_as_precisely_as_they_are_compared() {
    for (light, precision) in
        [(1.0, Precision::Half), (1e5, Precision::Float), (1e-8, Precision::Float)]
    {
        let project = Project::new();
        let mut image = ramp();
        for value in image.pixels_mut().iter_mut().flat_map(|pixel| &mut pixel[..3]) {
            *value = (*value + 0.1) * light;
        }
        let failed = project.check("vulkan", &image, None, None).expect_err("no golden");
        project.accept(&failed, "first", None).expect("accepted");
        let golden = pending_at(&project.folder.path().join("room/ramp.exr")).provenance;
        assert_eq!(golden.precision, precision, "{light}");
        let margin = project.check("vulkan", &image, None, None).expect("equal");
        assert!(margin.is_identical(), "{light}: {margin}");
        image.pixels_mut()[64 * 8..][..64 * 8].iter_mut().for_each(|pixel| pixel[0] *= 2.0);
        project.check("vulkan", &image, None, None).expect_err("rows are off");
    }
    // A golden in half floats, and a frame that they can't hold.
    let project = Project::with_golden();
    let mut bright = ramp();
    bright.pixels_mut()[70][0] = 7e4;
    let failed = project.check("vulkan", &bright, None, None).expect_err("it differs").to_string();
    assert!(failed.contains("70000 instead of"), "{failed}");
}

/// Pixels that aren't compared may be anything.
#[test]
fn a_frame_with_nan_under_its_mask_is_accepted() {
    let project = Project::new();
    let mut image = ramp();
    image.pixels_mut()[70] = [f32::NAN; 4];
    let (aside, beside) = (Rect::new(6, 1, 1, 1), Rect::new(7, 1, 1, 1));
    let mask = |rect| Mask::except(&[rect]);
    let failed = project.check("vulkan", &image, None, Some(&mask(aside))).expect_err("none");
    project.accept(&failed, "first", None).expect("nobody looks there");
    project.check("vulkan", &image, None, Some(&mask(aside))).expect("it agrees");
    project.check("vulkan", &ramp(), None, Some(&mask(aside))).expect("it agrees");
    let failed = project.check("vulkan", &image, None, Some(&mask(beside))).expect_err("NaN");
    let error = project.accept(&failed, "why", None).expect_err("NaN");
    assert!(matches!(error, AcceptError::NonFinite(_)), "{error}");
}

/// What waits is what somebody has to decide about.
#[test]
fn a_pending_frame_stays_until_its_own_profile_agrees() {
    let project = Project::with_golden();
    let file = project.folder.path().join("room/ramp.new.exr");
    let strict = &FrameTolerance::gate(1e-3);
    let changed = spot(1.5);
    project.check("gl", &changed, Some(strict), None).expect_err("it differs on GL");
    project.check("vulkan", &ramp(), Some(strict), None).expect("and not on Vulkan");
    assert!(file.is_file(), "GL's frame still waits");
    project.check("gl", &ramp(), Some(strict), None).expect("mended");
    assert!(!file.exists());

    let adapter = &adapter("gl");
    let known = Rendered { known_issue: true, ..rendered(&changed, adapter) };
    project.goldens.check("room/ramp", &known).expect_err("as is known");
    assert!(!file.exists(), "nobody decides about a known issue");
}

/// Where the golden for all would do, a profile's own is to go.
#[test]
fn a_golden_of_a_profile_that_is_not_needed_any_more_is_named() {
    let project = Project::with_golden();
    let strict = &FrameTolerance::gate(1e-3);
    let mask = &Mask::except(&[Rect::new(50, 3, 1, 1)]);
    let on_gl = with(&[(3, 30), (50, 3)], 1.5);
    let failed = project.check("gl", &on_gl, Some(strict), Some(mask)).expect_err("on GL");
    project.accept(&failed, "why", Some("gl-llvmpipe")).expect("it fails there");
    // By the mask of the test, which no other program knows.
    let mended = with(&[(50, 3)], 1.5);
    let failed = project.check("gl", &mended, Some(strict), Some(mask)).expect_err("another");
    let text = project.text(&failed);
    assert!(
        text.ends_with(
            "look at `golden/room/ramp.new.exr`, then delete `golden/@gl-llvmpipe/room/ramp.exr` \
             with its `.toml` and run the test again: the golden for all passes"
        ),
        "{text}"
    );
    let error = project.accept(&failed, "why", Some("gl-llvmpipe")).expect_err("not needed");
    assert!(matches!(error, AcceptError::Needless { missing: false, .. }), "{error}");
}

#[test]
fn one_of_two_acceptances_is_carried_out() {
    let project = Project::with_golden();
    for round in 0..20 {
        let changed = spot(1.5 + round as f32);
        project.check("vulkan", &changed, None, None).expect_err("it differs");
        let pending = pending_at(&project.folder.path().join("room/ramp.new.exr"));
        let because =
            |because: &str| Acceptance { because: because.into(), ..Acceptance::default() };
        let accept = |reason: &'static str| {
            let (goldens, pending) = (&project.goldens, &pending);
            move || goldens.accept(pending, &because(reason)).map(|_| reason)
        };
        let [one, other] = std::thread::scope(|scope| {
            [scope.spawn(accept("one")), scope.spawn(accept("other"))]
                .map(|thread| thread.join().expect("no panic"))
        });
        let (reason, error) = match (one, other) {
            (Ok(reason), Err(error)) | (Err(error), Ok(reason)) => (reason, error),
            both => panic!("one is carried out: {both:?}"),
        };
        assert!(matches!(error, AcceptError::NotPending { .. }), "{error}");
        let golden = pending_at(&project.folder.path().join("room/ramp.exr"));
        assert_eq!(golden.provenance.because, reason);
    }
}

/// What a frame was compared with decides whether it may be accepted, and nothing else does.
#[test]
fn a_stale_acceptance_is_refused() {
    let golden = |project: &Project| project.folder.path().join("room/ramp.exr");
    let replace = |path: &Path, image: &Image| {
        image.write_exr(path, Precision::Half, None).expect("written");
    };
    let waiting = |project: &Project, path: &str| {
        project.check(path, &spot(2.0), None, None).expect_err("it differs")
    };
    // Another golden, none any more, and one where there was none.
    let project = Project::with_golden();
    let failed = waiting(&project, "vulkan");
    replace(&golden(&project), &spot(3.0));
    let stale = |result: Result<Accepted, AcceptError>| {
        assert!(matches!(result, Err(AcceptError::Stale(case)) if case == "room/ramp"));
    };
    stale(project.accept(&failed, "why", None));
    let (image, _) = Image::read_exr(&golden(&project)).expect("there");
    assert_eq!(image.hash(), spot(3.0).rounded_to(Precision::Half).hash(), "as it was");
    assert!(project.folder.path().join("room/ramp.new.exr").is_file(), "it still waits");
    std::fs::remove_file(golden(&project)).expect("removed");
    stale(project.accept(&failed, "why", None));
    let new = Project::new();
    let failed = waiting(&new, "vulkan");
    replace(&golden(&new), &spot(3.0));
    stale(new.accept(&failed, "why", None));
    // A profile that has got a golden of its own, and one whose own golden is another.
    let project = Project::with_golden();
    let failed = waiting(&project, "gl");
    let own = project.folder.path().join("@gl-llvmpipe/room/ramp.exr");
    std::fs::create_dir_all(own.parent().expect("a folder")).expect("made");
    replace(&own, &spot(3.0));
    stale(project.accept(&failed, "why", Some("gl-llvmpipe")));
    let failed = waiting(&project, "gl");
    replace(&own, &spot(4.0));
    stale(project.accept(&failed, "why", Some("gl-llvmpipe")));
}

/// An acceptance that was killed before it removed the frame: what it wrote stays, and the frame goes.
#[test]
fn an_acceptance_may_be_repeated() {
    let project = Project::with_golden();
    for (path, profile) in [("vulkan", None), ("gl", Some("gl-llvmpipe"))] {
        let failed = project.check(path, &spot(2.0 + path.len() as f32), None, None);
        let failed = failed.expect_err("it differs");
        let waiting = project.folder.path().join("room/ramp.new.exr");
        let frame = std::fs::read(&waiting).expect("it waits");
        let first = project.accept(&failed, "first", profile).expect("accepted");
        assert!(first.written && !waiting.exists(), "{path}");
        let files = [first.golden.clone(), first.golden.with_extension("toml")];
        let read = || files.each_ref().map(|file| std::fs::read(file).expect("there"));
        let before = read();
        std::fs::write(&waiting, &frame).expect("written");
        let again = project.accept(&failed, "again", profile).expect("accepted");
        assert!(!again.written && !waiting.exists(), "{path}: {again:?}");
        assert!(read() == before, "{path}: as it was accepted first");
        // Facts that were edited aren't what it wrote.
        std::fs::write(&waiting, &frame).expect("written");
        std::fs::write(&files[1], "edited").expect("written");
        let stale = project.accept(&failed, "again", profile);
        assert!(matches!(stale, Err(AcceptError::Stale(_))), "{path}: {stale:?}");
    }
}

#[test]
fn what_was_interrupted_is_tidied_up_by_the_next_decision() {
    let project = Project::with_golden();
    let left = ["room/ramp.exr.4194999-0.tmp", "@gl-llvmpipe/room/ramp.toml.4194999-1.tmp"];
    let left = left.map(|file| project.folder.path().join(file));
    let leave = || {
        for file in &left {
            std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
            std::fs::write(file, "half of i").expect("written");
        }
    };
    let gone = || left.iter().all(|file| !file.exists());
    leave();
    let failed = project.check("vulkan", &spot(2.0), None, None).expect_err("it differs");
    assert!(!gone(), "a test decides nothing");
    project.accept(&failed, "why", None).expect("accepted");
    assert!(gone());
    leave();
    project.check("vulkan", &ramp(), None, None).expect_err("it differs");
    let waiting = pending_at(&project.folder.path().join("room/ramp.new.exr"));
    project.goldens.reject(&waiting).expect("deleted");
    assert!(gone());
}

/// Both files of a golden are written, or neither.
#[test]
fn a_golden_without_its_facts_is_not_written() {
    let project = Project::with_golden();
    let folder = project.folder.path();
    let (image, facts) = (folder.join("room/ramp.exr"), folder.join("room/ramp.toml"));
    let before = std::fs::read(&image).expect("there");
    std::fs::remove_file(&facts).expect("removed");
    std::fs::create_dir_all(facts.join("in the way")).expect("a folder");
    let failed = project.check("vulkan", &spot(1.5), None, None).expect_err("another");
    let error = project.accept(&failed, "why", None).expect_err("a folder is in the way");
    assert!(error.to_string().contains("ramp.toml"), "{error}");
    assert_eq!(std::fs::read(&image).expect("there"), before);
    assert!(project.folder.path().join("room/ramp.new.exr").is_file(), "it still waits");
    std::fs::remove_dir_all(&facts).expect("removed");
    project.accept(&failed, "why", None).expect("nothing is in the way");

    std::fs::remove_file(&image).expect("removed");
    std::fs::create_dir_all(image.join("in the way")).expect("a folder");
    let known = std::fs::read(&facts).expect("there");
    let pending = project.goldens.write_pending(
        "room/ramp",
        &rendered(&ramp(), &adapter("vulkan")),
        &Against::default(),
    );
    let pending = pending.expect("written");
    let acceptance = Acceptance { because: "why".to_owned(), ..Acceptance::default() };
    project.goldens.accept(&pending, &acceptance).expect_err("a folder is in the way");
    assert_eq!(std::fs::read(&facts).expect("there"), known);
    let files = std::fs::read_dir(project.folder.path().join("room")).expect("a folder");
    assert_eq!(files.count(), 3, "no temporary file stays");
}

#[test]
fn what_an_author_says_is_kept_and_aovs_are_drawn_when_they_are_needed() {
    let project = Project::with_golden();
    let facts = BTreeMap::from([("seed".to_owned(), "7".to_owned())]);
    let drawn = std::cell::Cell::new(0);
    let aovs = || {
        drawn.set(drawn.get() + 1);
        vec![Part::new("normal", Precision::Half, ramp())]
    };
    let adapter = &adapter("vulkan");
    let check = |image: &Image| {
        let frame = Rendered { facts: &facts, aovs: &aovs, ..rendered(image, adapter) };
        project.goldens.check("room/ramp", &frame)
    };
    check(&ramp()).expect("equal");
    assert_eq!(drawn.get(), 0);
    let failed = check(&spot(1.5)).expect_err("it differs");
    assert_eq!(drawn.get(), 1);
    project.accept(&failed, "why", None).expect("accepted");
    assert_eq!(project.parts(), ["color", "normal"]);
    let golden = pending_at(&project.folder.path().join("room/ramp.exr"));
    assert_eq!(golden.provenance.facts, facts);
}

/// Facts that can't be relied on are no licence to compare without them.
#[test]
fn facts_that_cannot_be_used_are_errors() {
    let project = Project::with_golden();
    let file = project.folder.path().join("room/ramp.exr");
    for (facts, expected) in [
        (r#"{"schema": 7}"#, "was written by a newer Karat (facts of version 7"),
        ("{}", "what it says of itself can't be read (missing field `schema`"),
    ] {
        ramp().write_exr(&file, Precision::Half, Some(facts)).expect("written");
        let error = project.check("vulkan", &ramp(), None, None).expect_err("no facts");
        assert!(error.to_string().contains(expected), "{error}");
    }
    ramp().write_exr(&file, Precision::Half, None).expect("written");
    project.check("vulkan", &ramp(), None, None).expect("another tool's");
}

/// A folder that is reached by a link is looked into, once.
#[cfg(unix)]
#[test]
fn frames_behind_a_link_to_a_folder_are_found() {
    let project = Project::new();
    project.check("vulkan", &ramp(), None, None).expect_err("no golden");
    let folder = project.folder.path();
    let elsewhere = tempfile::tempdir().expect("a temporary folder");
    std::fs::rename(folder.join("room"), elsewhere.path().join("room")).expect("moved");
    std::os::unix::fs::symlink(elsewhere.path().join("room"), folder.join("room")).expect("a link");
    std::os::unix::fs::symlink(folder, folder.join("circle")).expect("a link");
    let PendingFrames { frames, unusable } = project.goldens.pending();
    assert_eq!(frames.iter().map(|frame| &*frame.case).collect::<Vec<_>>(), ["room/ramp"]);
    assert!(unusable.is_empty(), "{unusable:?}");
}

/// One bad file is in nobody's way.
#[test]
fn files_that_cannot_be_used_are_named_beside_the_others() {
    let project = Project::new();
    project.check("vulkan", &ramp(), None, None).expect_err("no golden");
    let folder = project.folder.path();
    let good = std::fs::read(folder.join("room/ramp.new.exr")).expect("there");
    for (name, bytes) in [("cut", &good[..good.len() / 2]), ("other", &good), ("empty", &[])] {
        std::fs::write(folder.join(format!("{name}.new.exr")), bytes).expect("written");
    }
    ramp().write_exr(&folder.join("foreign.new.exr"), Precision::Half, None).expect("written");
    std::fs::create_dir(folder.join("folder.new.exr")).expect("a folder");
    let PendingFrames { frames, unusable } = project.goldens.pending();
    assert_eq!(frames.iter().map(|frame| &*frame.case).collect::<Vec<_>>(), ["room/ramp"]);
    let reasons: Vec<String> =
        unusable.iter().map(|unusable| unusable.reason.to_string()).collect();
    for (reason, expected) in reasons.iter().zip([
        "cut.new.exr` isn't a readable OpenEXR image",
        "empty.new.exr` isn't a readable OpenEXR image: it is empty",
        "folder.new.exr`: it is a folder",
        "foreign.new.exr` wasn't written by Karat",
        "other.new.exr` says that it is frame `room/ramp`",
    ]) {
        assert!(reason.contains(expected), "{reason}");
    }
    assert_eq!(reasons.len(), 5);
    assert_eq!(
        project
            .goldens
            .select_by("room/*", |case| case.starts_with("room/"))
            .expect("one")
            .unusable
            .len(),
        0
    );
    assert_eq!(project.goldens.select("cut").expect("it is there").unusable.len(), 1);
    assert_eq!(project.goldens.select_by("*", |_| true).expect("all").frames.len(), 1);
    let error = project.goldens.select("room/rmp").expect_err("none").to_string();
    assert!(error.contains("did you mean `room/ramp`?"), "{error}");

    std::fs::create_dir_all(folder.join("copy/room")).expect("a folder");
    std::fs::write(folder.join("copy/room/ramp.new.exr"), &good).expect("written");
    let PendingFrames { frames, unusable } = project.goldens.pending();
    let double =
        unusable.iter().find(|unusable| matches!(unusable.reason, AcceptError::Twice { .. }));
    let double = double.expect("neither is the frame").reason.to_string();
    assert!(
        frames.is_empty() && double.contains("frame `room/ramp` is pending twice, as"),
        "{double}"
    );
}

/// A tolerance that half floats can't show is held against the frame as it is.
#[test]
fn a_tolerance_that_is_tightened_holds() {
    let project = Project::with_golden();
    let mut near = ramp();
    for value in near.pixels_mut().iter_mut().flat_map(|pixel| &mut pixel[..3]) {
        *value *= 1.0 + 2e-4; // less than half a step of a half float
    }
    let margin = project.check("vulkan", &near, None, None).expect("equal as it is stored");
    assert!(margin.is_identical());
    let fine = FrameTolerance::gate(1e-5);
    let failed = project.check("vulkan", &near, Some(&fine), None).expect_err("20 times as much");
    project.accept(&failed, "in floats", None).expect("accepted");
    let golden = pending_at(&project.folder.path().join("room/ramp.exr")).provenance;
    assert_eq!(golden.precision, Precision::Float);
    project.check("vulkan", &near, Some(&fine), None).expect("equal");
}

/// Transmittance leaves roundings where nothing is opaque.
#[test]
fn alpha_that_is_next_to_nothing_is_equal() {
    let with = |alpha: f32| {
        let mut image = ramp();
        image.pixels_mut()[70][3] = alpha;
        image
    };
    let project = Project::new();
    let failed = project.check("vulkan", &with(0.0), None, None).expect_err("no golden");
    project.accept(&failed, "first", None).expect("accepted");
    let strict = FrameTolerance::gate(1e-3);
    project.check("vulkan", &with(1.2e-7), Some(&strict), None).expect("rounding");
    project.check("vulkan", &with(1.2e-7), None, None).expect("rounding");
    project.check("vulkan", &with(0.01), None, None).expect_err("a hundredth opaque");
    let loose = FrameTolerance::from(Gate { relative: 1e-3, absolute: Some(0.02) });
    project.check("vulkan", &with(0.01), Some(&loose), None).expect("as somebody says");
}

/// What cannot become a golden isn't compared with one that isn't there.
#[test]
fn a_frame_with_nan_and_no_golden_says_so() {
    let project = Project::new();
    let mut broken = ramp();
    broken.pixels_mut()[70][1] = f32::NAN;
    let failed = project.check("vulkan", &broken, None, None).expect_err("NaN");
    insta::assert_snapshot!(project.text(&failed), @r"
    frame `room/ramp` has no golden and can't become one: it has 1 pixels with NaN and 0 with infinities, first at (6, 1)
      look at `golden/room/ramp.new.exr`, and mend the shader
    ");
    assert!(matches!(failed, GoldenError::Unacceptable { .. }));
}

/// A known issue is a difference of values; whatever else is wrong isn't known.
#[test]
fn a_known_issue_hides_no_other() {
    let project = Project::with_golden();
    let adapter = &adapter("vulkan");
    let check = |image: &Image| {
        let known = Rendered { known_issue: true, ..rendered(image, adapter) };
        drop(project.goldens.check("room/ramp", &known).expect_err("it differs"));
        std::fs::remove_file(project.folder.path().join("room/ramp.new.exr")).is_ok()
    };
    assert!(!check(&spot(1.5)), "as is known");
    let mut broken = ramp();
    broken.pixels_mut()[70][1] = f32::NAN;
    assert!(check(&broken) && check(&Image::new(1, 1, vec![[1.0; 4]])));
}

/// Frames are accepted where they were compared.
#[test]
fn a_frame_of_another_folder_is_refused() {
    let project = Project::with_golden();
    std::fs::write(project.folder.path().join("Cargo.lock"), "").expect("written");
    let goldens = |name: &str| {
        let folder = project.folder.path().join(name);
        std::fs::create_dir_all(&folder).expect("a folder");
        Goldens { beside: true, ..Goldens::open(&folder) }
    };
    let (one, other) = (goldens("a/golden"), goldens("b/golden"));
    let adapter = &adapter("vulkan");
    one.check("logo", &rendered(&ramp(), adapter)).expect_err("no golden");
    other.check("logo", &rendered(&spot(2.0), adapter)).expect_err("no golden");
    let all = project.goldens.pending();
    let found: Vec<_> = all.frames.iter().map(|frame| &*frame.provenance.folder).collect();
    assert_eq!((found, all.unusable.len()), (vec!["a/golden", "b/golden"], 0));
    let acceptance = Acceptance { because: "why".to_owned(), ..Acceptance::default() };
    let error = other.accept(&all.frames[0], &acceptance).expect_err("it is the other's");
    let text = "`logo` was compared with goldens of `a/golden`: name them with --golden a/golden";
    assert_eq!(error.to_string(), text);
    let accepted = one.accept(&all.frames[0], &acceptance).expect("it is its own");
    let golden = pending_at(&accepted.golden).provenance;
    assert!(golden.folder.is_empty() && golden.pixels == ramp().hash());
}

#[cfg(unix)]
#[test]
fn what_is_no_file_is_told_and_not_waited_for() {
    let project = Project::with_golden();
    let golden = project.folder.path().join("room/ramp.exr");
    std::fs::remove_file(&golden).expect("removed");
    std::os::unix::fs::symlink("nowhere", &golden).expect("a link");
    let error = project.check("vulkan", &ramp(), None, None).expect_err("a link to nothing");
    let text = error.to_string();
    assert!(text.ends_with("it is a link to what isn't here; fetch its content"), "{text}");
    for name in ["room/ramp.exr", "pipe.new.exr"] {
        let path = project.folder.path().join(name);
        drop(std::fs::remove_file(&path));
        let made = std::process::Command::new("mkfifo").arg(&path).status().expect("it runs");
        assert!(made.success());
    }
    let error = project.check("vulkan", &ramp(), None, None).expect_err("a pipe").to_string();
    assert!(error.ends_with("it is neither a file nor a link to one"), "{error}");
    let unusable = project.goldens.pending().unusable;
    assert!(unusable[0].reason.to_string().contains("it is neither a file"), "{unusable:?}");
}
