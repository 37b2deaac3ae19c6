//! Comparisons and their messages.

use super::*;
use crate::golden::tolerance::FrameCriterion;

/// The message names the wrong pixels and the next steps.
#[test]
fn a_frame_that_differs_says_what_and_where() {
    let project = Project::with_golden();
    let hole: Vec<(u32, u32)> = (8..16).flat_map(|y| (24..32).map(move |x| (x, y))).collect();
    let failed = project.check("vulkan", &with(&hole, 0.25), None, None).expect_err("a hole");
    insta::assert_snapshot!(project.text(&failed), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: 64 of 3072 pixels differ by more than rel 1e-3, within (24, 8) to (31, 15)
      worst: pixel (24, 8) red: 0.09375 instead of 0.375, 750 times what is allowed
      fails  gate rel 1e-3: 750 times what is allowed, at (24, 8)
      fails  largest FLIP tile 0.256 of 0.01, in (24, 0) to (39, 15)
      fails  mean FLIP 0.0272 of 0.005
      FLIP used exposures of -0.44 to -0.31 stops, pinned in the golden
      pixels that exceed a tolerance of 0.001: 2.083%, 0.01: 2.083%, 0.1: 2.083%, 1: 0.000%
      would pass: a gate of rel 0.76, largest FLIP tile of 0.26, mean FLIP of 0.028
      look at `golden/room/ramp.new.exr`, then `karat accept room/ramp --because "..."` or `karat reject room/ramp`
    "#);
    let strict = FrameTolerance::gate(1e-3);
    let mask = Mask::except(&[Rect::new(0, 0, 32, 12)]);
    let failed = project.check("vulkan", &with(&hole, 1.02), Some(&strict), Some(&mask));
    insta::assert_snapshot!(project.text(&failed.expect_err("the gate alone")), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: 32 of 2688 pixels differ by more than rel 1e-3, within (24, 12) to (31, 15)
      compared: 87.5% of the frame, and the mask excludes the rest
      worst: pixel (24, 15) blue: 0.6376953 instead of 0.625, 20.3 times what is allowed
      fails  gate rel 1e-3: 20.3 times what is allowed, at (24, 15)
      pixels that exceed a tolerance of 0.001: 1.190%, 0.01: 1.190%, 0.1: 0.000%, 1: 0.000%
      would pass: a gate of rel 0.021
      look at `golden/room/ramp.new.exr`, then `karat accept room/ramp --because "..."` or `karat reject room/ramp`
    "#);
    let mut broken = ramp();
    broken.pixels_mut()[70][1] = f32::NAN;
    broken.pixels_mut()[90][1] = f32::INFINITY;
    let failed = project.check("vulkan", &broken, None, None).expect_err("NaN");
    insta::assert_snapshot!(project.text(&failed), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: it has 1 pixel with NaN and 1 with infinities, first at (6, 1)
      look at `golden/room/ramp.new.exr`, and fix the shader: a frame with NaN or infinity never agrees with a golden
    "#);
    let mut alpha = ramp();
    alpha.pixels_mut()[70][3] = 0.5;
    let failed = project.check("gl", &alpha, None, None).expect_err("alpha");
    insta::assert_snapshot!(project.text(&failed), @r#"
    frame `room/ramp` differs from its golden `golden/room/ramp.exr`: 1 of 3072 pixels differ by more than rel 1e-3, within (6, 1) to (6, 1)
      worst: pixel (6, 1) alpha: 0.5 instead of 1, 500 times what is allowed
      fails  gate rel 1e-3: 500 times what is allowed, at (6, 1)
      fails  largest FLIP tile inf of 0.03 (alpha differs at (6, 1), and FLIP ignores alpha)
      fails  mean FLIP inf of 0.005 (alpha differs at (6, 1), and FLIP ignores alpha)
      FLIP used exposures of -0.44 to -0.31 stops, pinned in the golden
      pixels that exceed a tolerance of 0.001: 0.033%, 0.01: 0.033%, 0.1: 0.033%, 1: 0.000%
      would pass: a gate of rel 0.5
      look at `golden/room/ramp.new.exr`, then `karat accept room/ramp --profile gl-llvmpipe --because "..."` or `karat reject room/ramp`
    "#);
}

#[test]
fn with_a_tolerance_of_zero_errors_are_absolute() {
    let project = Project::with_golden();
    let exact = FrameTolerance::gate(0.0);
    let failed = project.check("vulkan", &spot(1.5), Some(&exact), None).expect_err("it differs");
    let text = project.text(&failed);
    assert!(
        text.contains(", and nothing is allowed\n  fails  gate rel 0: nothing is allowed, at ("),
        "{text}"
    );
    assert!(text.contains(" instead of ") && text.contains(", abs 0."), "{text}");
    let worst = |relative| {
        let tolerance = FrameTolerance::gate(relative);
        let failed = project.check("vulkan", &spot(1.5), Some(&tolerance), None);
        let Err(GoldenError::Differs { difference, .. }) = failed else { panic!("it differs") };
        let FrameDifference::Values(deviation) = *difference else { panic!("its values differ") };
        deviation.worst_margin()
    };
    let (exact, ratio) = worst(0.0);
    assert!(exact.starts_with("abs 0.") && ratio.is_none(), "{exact} {ratio:?}");
    assert!(worst(1e-3).0.starts_with("rel 0."));
}

#[test]
fn a_passing_frame_names_the_criterion() {
    let project = Project::with_golden();
    let margin = project.check("vulkan", &ramp(), None, None).expect("equal");
    assert_eq!((margin.decided_by, margin.to_string().as_str()), (FrameCriterion::Bits, "equal"));
    let drift = with(&[(3, 30)], 1.0 + 1.0 / 1024.0);
    let margin = project.check("vulkan", &drift, None, None).expect("within the gate");
    assert_eq!(margin.decided_by, FrameCriterion::Gate);
    assert!(margin.ratio > 0.9 && margin.ratio <= 1.0, "{margin:?}");

    // A pixel of an edge that differs by a twentieth.
    let edge = with(&[(3, 30)], 1.05);
    let margin = project.check("vulkan", &edge, None, None).expect("FLIP sees next to nothing");
    assert_eq!((margin.decided_by, margin.beyond_gate), (FrameCriterion::Flip, 1));
    insta::assert_snapshot!(margin, @"passes by FLIP: the gate is exceeded at 1 pixel, largest FLIP tile 0.00101 of 0.01, mean FLIP 8.61e-5 of 0.005");
    let mask = Mask::only(&[Rect::new(0, 24, 64, 24)]);
    let margin = project.check("vulkan", &edge, None, Some(&mask)).expect("it passes");
    assert!(margin.to_string().ends_with("(compared: 50% of the frame)"), "{margin}");
    assert!(margin.golden.ends_with("room/ramp.exr") && margin.profile.is_none());
    let strict = FrameTolerance::gate(1e-3);
    project.check("vulkan", &edge, Some(&strict), None).expect_err("the gate alone");
}

// Lesson 199
#[test]
fn frame_tolerances_can_be_nested() {
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
    assert_eq!((decided.decided_by, decided.ratio), (FrameCriterion::Metric, 0.98));
    assert_eq!(decided.tolerance, "rel 1e-3 or (FLIP tile 0.01 and red 0.5)");
    for (useless, reason) in [
        (
            FrameTolerance::gate(f32::NAN),
            "NaN; a relative difference must be at least 0 and below 1",
        ),
        (FrameTolerance::gate(-1.0), "-1; a relative difference must be at least 0 and below 1"),
        (FrameTolerance::gate(1.0), "1; a relative difference must be at least 0 and below 1"),
        (
            Any(vec![gate(), FlipTile(f64::INFINITY)]),
            "inf; FLIP errors are from 0 to 1, so a bound must be below 1",
        ),
        (
            All(vec![gate(), FlipMean(1.0)]),
            "1; FLIP errors are from 0 to 1, so a bound must be below 1",
        ),
        (
            FrameTolerance::metric(crate::metric::Flip::MEAN, 1.0),
            "1; the mean FLIP is 1 at most, so a bound must be smaller",
        ),
        (FrameTolerance::metric(Red(0.0), -1.0), "-1; a bound must be a number of at least 0"),
        (All(vec![]), "an empty list of bounds; add at least one bound"),
        (red(1.0), ""),
    ] {
        assert_eq!(useless.unusable().unwrap_or_default(), reason);
    }
    let error = project.check("vulkan", &edge, None, Some(&Mask::only(&[])));
    let error = error.expect_err("nothing is compared").to_string();
    assert_eq!(error, "frame `room/ramp` can't be compared: the mask excludes all pixels");
}

/// The golden of the profile `gl-llvmpipe` applies to this profile only. Karat accepts a profile's own golden only if
/// the frame fails with the golden for all profiles.
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

    // A frame that passes with the golden for all profiles needs no golden for its profile.
    let failed = project.check("gl", &ramp(), Some(strict), None).expect_err("GL has its own");
    assert!(project.text(&failed).contains("from its golden `golden/@gl-llvmpipe/room/ramp.exr`"));
    let error = project.accept(&failed, "why", None).expect_err("it is GL's");
    assert!(matches!(error, AcceptError::Own { .. }), "{error}");
    let error = project.accept(&failed, "why", Some("gl-llvmpipe")).expect_err("not needed");
    insta::assert_snapshot!(error, @"`room/ramp` needs no golden for profile gl-llvmpipe: the frame passes with the golden that applies to all profiles");
    let new = Project::new();
    let failed = new.check("gl", &on_gl, None, None).expect_err("no golden");
    let error = new.accept(&failed, "why", Some("gl-llvmpipe")).expect_err("none for all");
    insta::assert_snapshot!(error, @"`room/ramp` needs no golden for profile gl-llvmpipe: no golden applies to all profiles yet; first accept the frame without --profile");
}

/// The FLIP bound of tiles is wider if another profile made the golden.
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

/// Karat doesn't round a frame to half floats if the tolerance is smaller than this rounding.
// Lesson 20
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

/// Transparent pixels may have rounding errors in alpha, for example if alpha is 1 minus the transmittance.
#[test]
fn a_rounding_error_in_transparent_alpha_passes() {
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

/// The message says that a frame with NaN can't become a golden.
#[test]
fn a_frame_with_nan_and_no_golden_says_so() {
    let project = Project::new();
    let mut broken = ramp();
    broken.pixels_mut()[70][1] = f32::NAN;
    let failed = project.check("vulkan", &broken, None, None).expect_err("NaN");
    insta::assert_snapshot!(project.text(&failed), @r"
    frame `room/ramp` has no golden and can't become one: it has 1 pixel with NaN and 0 with infinities, first at (6, 1)
      look at `golden/room/ramp.new.exr`, and fix the shader
    ");
    assert!(matches!(failed, GoldenError::Unacceptable { .. }));
}

/// A known issue only covers values that differ from the golden. A test with any other error still fails.
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
    assert!(!check(&broken), "NaN is a value");
    assert!(check(&Image::new(1, 1, vec![[1.0; 4]])), "another size has none");
}
