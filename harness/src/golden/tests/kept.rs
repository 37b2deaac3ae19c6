//! Data that is stored with goldens and pending frames.

use super::*;
use crate::golden::tolerance::FrameCriterion;

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
    assert!(warnings.contains("consider a smaller frame, below 128 KiB"), "{warnings}");
    let warnings = accept(&Image::new(700, 20, vec![[0.5; 4]; 14_000])).expect("wide").join("\n");
    assert!(
        warnings.contains("has 700 x 20 pixels; a frame of 640 x 360 pixels shows most faults"),
        "{warnings}"
    );
    let error = accept(&noise(640, 360)).expect_err("too large");
    assert!(error.to_string().contains("and Karat accepts at most 1024 KiB"), "{error}");
}

/// A frame passes if it differs from its golden only by noise, and fails if a tile differs by more than its noise.
// Lesson 46
#[test]
fn noise_is_kept_with_the_golden() {
    let project = Project::new();
    let check = |image: &Image, variance: f32| {
        let variance = &Image::new(64, 48, vec![[variance; 4]; 64 * 48]);
        let adapter = &adapter("vulkan");
        let frame = Rendered { variance: Some(variance), ..rendered(image, adapter) };
        project.goldens.check("room/ramp", &frame)
    };
    // The signs alternate, so the mean of each tile stays the same.
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
    assert!(failed.to_string().contains("stores no pixel variance: accept the frame again"));
    project.accept(&failed, "with variance", None).expect("accepted");
    assert_eq!(project.parts(), ["color", "color.variance"]);

    let margin = check(&noisy(-0.1, 0.0), 0.01).expect("nothing but noise");
    assert_eq!((margin.decided_by, margin.beyond_gate), (FrameCriterion::Noise, 64 * 48));
    assert!(margin.to_string().starts_with("passes by noise: the gate is exceeded at 3072 pixels"));
    let failed = check(&noisy(-0.1, 0.05), 0.01).expect_err("it is brighter");
    assert!(failed.to_string().contains("noise alone exceeds"), "{failed}");
    check(&noisy(-0.1, 0.0), f32::NAN).expect_err("no variance");
    // If the frame isn't noisy any more, the new golden has no variance.
    let still = project.check("vulkan", &ramp(), None, None).expect_err("the golden was noisy");
    project.accept(&still, "without noise", None).expect("accepted");
    assert_eq!(project.parts(), ["color"]);
}

#[test]
fn a_pending_frame_keeps_its_verdict() {
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
    assert_eq!(verdict, "1 of 2688 pixels differ by more than rel 2e-3, within (3, 30) to (3, 30)");
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

/// A frame that doesn't fit into half floats is stored and compared in 32-bit floats.
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
    // The golden has half floats, and the frame has values that are too large for half floats.
    let project = Project::with_golden();
    let mut bright = ramp();
    bright.pixels_mut()[70][0] = 7e4;
    let failed = project.check("vulkan", &bright, None, None).expect_err("it differs").to_string();
    assert!(failed.contains("70000 instead of"), "{failed}");
}

/// A pending frame stays until a frame of the same profile agrees with the golden.
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

/// The message names a profile's own golden that you can delete because the frame passes with the golden for all
/// profiles.
#[test]
fn a_golden_of_a_profile_that_is_not_needed_any_more_is_named() {
    let project = Project::with_golden();
    let strict = &FrameTolerance::gate(1e-3);
    let mask = &Mask::except(&[Rect::new(50, 3, 1, 1)]);
    let on_gl = with(&[(3, 30), (50, 3)], 1.5);
    let failed = project.check("gl", &on_gl, Some(strict), Some(mask)).expect_err("on GL");
    project.accept(&failed, "why", Some("gl-llvmpipe")).expect("it fails there");
    // Only the test knows its mask.
    let mended = with(&[(50, 3)], 1.5);
    let failed = project.check("gl", &mended, Some(strict), Some(mask)).expect_err("another");
    let text = project.text(&failed);
    assert!(
        text.ends_with(
            "look at `golden/room/ramp.new.exr`, then delete the profile's own golden \
             `golden/@gl-llvmpipe/room/ramp.exr` and its `.toml`, and run the test again: the frame passes with the golden that applies to all profiles"
        ),
        "{text}"
    );
    let error = project.accept(&failed, "why", Some("gl-llvmpipe")).expect_err("not needed");
    assert!(matches!(error, AcceptError::Needless { missing: false, .. }), "{error}");
}

#[test]
fn facts_are_kept_and_aovs_are_drawn_only_if_needed() {
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

/// If a golden's facts can't be used, Karat reports an error instead of comparing the frame without the facts.
#[test]
fn facts_that_cannot_be_used_are_errors() {
    let project = Project::with_golden();
    let file = project.folder.path().join("room/ramp.exr");
    for (facts, expected) in [
        (r#"{"schema": 7}"#, "the metadata comes from a newer Karat (version 7 of the format"),
        ("{}", "the metadata can't be read (missing field `schema`"),
    ] {
        ramp().write_exr(&file, Precision::Half, Some(facts)).expect("written");
        let error = project.check("vulkan", &ramp(), None, None).expect_err("no facts");
        assert!(error.to_string().contains(expected), "{error}");
    }
    ramp().write_exr(&file, Precision::Half, None).expect("written");
    project.check("vulkan", &ramp(), None, None).expect("another tool's");
}

/// Karat enters a linked folder only once.
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

/// One unusable file doesn't hide the usable files.
// Lesson 42: acceptance under interruption
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
        "foreign.new.exr` has no provenance",
        "other.new.exr` says that the file is frame `room/ramp`",
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

#[cfg(unix)]
#[test]
fn a_golden_that_is_no_file_is_an_error_at_once() {
    let project = Project::with_golden();
    let golden = project.folder.path().join("room/ramp.exr");
    std::fs::remove_file(&golden).expect("removed");
    std::os::unix::fs::symlink("nowhere", &golden).expect("a link");
    let error = project.check("vulkan", &ramp(), None, None).expect_err("a link to nothing");
    let text = error.to_string();
    assert!(text.ends_with("it is a link to a file that doesn't exist; fetch that file"), "{text}");
    for name in ["room/ramp.exr", "pipe.new.exr"] {
        let path = project.folder.path().join(name);
        drop(std::fs::remove_file(&path));
        let made = std::process::Command::new("mkfifo").arg(&path).status().expect("it runs");
        assert!(made.success());
    }
    let error = project.check("vulkan", &ramp(), None, None).expect_err("a pipe").to_string();
    assert!(error.ends_with("it is neither a file nor a link to a file"), "{error}");
    let unusable = project.goldens.pending().unusable;
    assert!(
        unusable[0].reason.to_string().contains("it is neither a file nor a link"),
        "{unusable:?}"
    );
}
