//! Tests `fails_on`, which declares a failure on a path, and `tolerance_on`, which gives a path its own tolerance.

use karat::Goldens;
use karat::Path;
use karat::check::Failure;
use karat::image::Precision;
use karat::prelude::*;
use karat::unstable::run::WrongDeclaration;

use crate::disagreement;
use crate::processes::planted;

/// The paths on which this run checks functions. To find them, it checks a wrong function, whose failure lists all
/// paths.
pub(crate) fn selected() -> Vec<Path> {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x + 1.0; }");
    let found = disagreement(
        package.function("f").over(0.0..=1.0).unrecorded().try_agrees_with(|x: f64| x, Abs(0.5)),
    );
    let paths = found.paths.iter().map(|path| path.adapter.path.parse());
    paths.collect::<Result<_, _>>().expect("a path has its own name")
}

/// Checks if a declaration for one path covers another path: `vulkan` covers Vulkan with any driver.
fn covers(declared: Path, path: Path) -> bool {
    declared.api() == path.api() && declared.driver().is_none_or(|own| path.driver() == Some(own))
}

/// A check with `fails_on` passes if the function is wrong on the declared path. Karat lists this path as a known
/// issue, not as a path that agrees.
// Lesson 8: a declared failure must fail
// Lesson 45
#[test]
fn a_known_issue_is_no_agreement() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x + 1.0; }");
    let over = || package.function("f").over(0.0..=1.0);
    let paths = selected();
    let everywhere = paths.iter().fold(over(), |check, path| check.fails_on(*path, "bug 1"));
    let agreement = everywhere
        .unrecorded()
        .try_agrees_with(|x: f64| x, Abs(0.5))
        .expect("it fails as declared");
    assert!(agreement.paths.is_empty(), "{agreement}");
    assert_eq!(agreement.known_issues.len(), paths.len());
    for issue in &agreement.known_issues {
        assert_eq!((&*issue.reason, issue.cases, issue.failures), ("bug 1", 65_536, 65_536));
    }
    assert!(agreement.to_string().contains("fails 65536 cases as declared: bug 1"), "{agreement}");
    // Karat judges other paths as usual.
    for path in &paths {
        let found =
            over().fails_on(*path, "bug 1").unrecorded().try_agrees_with(|x: f64| x, Abs(0.5));
        let others: Vec<_> = paths.iter().filter(|other| !covers(*path, **other)).collect();
        if others.is_empty() {
            assert!(found.is_ok(), "{found:?}");
            continue;
        }
        let found = disagreement(found);
        assert_eq!(found.paths.len(), others.len());
        let is_other = |name: &str| others.iter().any(|other| other.name() == name);
        assert!(found.paths.iter().all(|path| is_other(&path.adapter.path)), "{found}");
    }
}

// Lesson 8: a declared failure must fail
// Lesson 45
#[test]
fn an_issue_that_is_gone_or_has_no_reason() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let path = selected()[0];
    let over = || package.function("f").over(0.0..=1.0);
    let found = over().fails_on(path, "bug 1").unrecorded().try_agrees_with(|x: f64| x, Ulp(0.0));
    let text = found.expect_err("it passes").to_string();
    let expected = format!(
        "`f` passes on {path}, where it is declared to fail: bug 1\n\
         the bug is fixed, or hidden: remove the `fails_on`"
    );
    assert_eq!(text, expected);
    for reason in ["", " "] {
        let found =
            over().fails_on(path, reason).unrecorded().try_satisfies("is not", |_, _: f32| false);
        let text = found.expect_err("no reason").to_string();
        let expected = format!("the `fails_on` of `f` on {path} has no reason: name the bug");
        assert_eq!(text, expected);
    }
    let integral = package.function("f").integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)]);
    let found = integral.fails_on(path, "bug 1").unrecorded().try_is_at_most(|_| 1.0, 0.0);
    assert!(
        matches!(found, Err(Failure::Declaration(WrongDeclaration::UnexpectedPass { .. }))),
        "{found:?}"
    );
}

/// If a test declares by `fails_on` that a frame differs from its golden, the frame must differ. A missing golden is an
/// error even with the declaration.
// Lesson 8: a declared failure must fail
// Lesson 71
// Lesson 173
#[test]
fn a_frame_that_is_declared_to_fail() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let goldens = Goldens::open(folder.path());
    let pictures = Package::from_source("gradient", include_str!("../planted/gradient.wgsl"));
    let frame = || pictures.frame("", 32, 16).fullscreen("corners", "gradient").tolerance(1e-3);
    let paths = selected();
    let declared = || paths.iter().fold(frame(), |frame, path| frame.fails_on(*path, "bug 1"));
    let error = declared().unrecorded().try_matches(&goldens, "gradient").expect_err("no golden");
    assert!(error.to_string().contains("has no golden"), "{error}");
    let golden = folder.path().join("gradient.exr");
    let mut image = frame().render(paths[0]).expect("rendered");
    image.write_exr(&golden, Precision::Half, None).expect("written");
    let error = declared().unrecorded().try_matches(&goldens, "gradient").expect_err("it matches");
    assert!(error.to_string().contains("where it is declared to fail: bug 1"), "{error}");
    let error = frame().fails_on(paths[0], "").unrecorded().try_matches(&goldens, "gradient");
    assert!(error.expect_err("no reason").to_string().contains("has no reason"));

    // A frame of another size has no values to compare.
    let mut small = pictures.frame("", 16, 16).fullscreen("corners", "gradient");
    small = paths.iter().fold(small, |frame, path| frame.fails_on(*path, "bug 1"));
    let error = small.unrecorded().try_matches(&goldens, "gradient").expect_err("another size");
    assert!(error.to_string().contains("16 x 16"), "{error}");
    // The expression isn't constant, because WGSL refuses a constant NaN.
    let nan = include_str!("../planted/gradient.wgsl").replace("0.5, 1.0)", "sqrt(-at.x), 1.0)");
    let nan = Package::from_source("gradient", nan);
    let nan = nan.frame("", 32, 16).fullscreen("corners", "gradient").tolerance(1e-3);
    let nan = paths.iter().fold(nan, |frame, path| frame.fails_on(*path, "bug 1"));
    // NaN is a value, in frames as in functions and passes.
    let agreement =
        nan.unrecorded().try_matches(&goldens, "gradient").expect("it fails as declared");
    assert_eq!((agreement.paths.len(), agreement.known_issues.len()), (0, paths.len()));

    image.pixels_mut()[300][2] *= 1.01;
    image.write_exr(&golden, Precision::Half, None).expect("written");
    let agreement =
        declared().unrecorded().try_matches(&goldens, "gradient").expect("it fails as declared");
    assert!(agreement.paths.is_empty());
    assert!(agreement.known_issues.iter().all(|issue| (issue.cases, issue.failures) == (512, 1)));
}

/// A pass with an endless loop, or with a workgroup that no device accepts, gives no values. So the check fails, even
/// if a test declares the failure by `fails_on` or `refused_on`.
// Lesson 173
#[test]
fn a_pass_that_stops_is_no_known_issue() {
    let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
         @compute @workgroup_size(1) fn endless() {
             loop { if data[0] > 9u { break; } data[1] += 1u; }
         }
         @compute @workgroup_size(2048) fn large() { data[0] = 1u; }
         @compute @workgroup_size(1) fn wrong() { data[0] = 1u; }";
    let package = Package::from_source("planted", text);
    let declared = |entry_point: &str, refuses: bool| {
        let passes = package.compute().with("data", Storage::new([0_u32, 0]));
        let passes = passes.dispatch(entry_point, [1, 1, 1]);
        let all = selected().into_iter();
        let passes = all.fold(passes, |passes, path| match refuses {
            true => passes.refused_on(path, "off by one"),
            false => passes.fails_on(path, "off by one"),
        });
        passes.after("data").unrecorded().try_agrees_with([2_u32, 0], Abs(0.0))
    };
    let known = declared("wrong", false).expect("its values are wrong, as declared").known_issues;
    assert_eq!(known.len(), selected().len());
    let error = declared("wrong", true).expect_err("it runs").to_string();
    assert!(error.contains("remove the `refused_on`"), "{error}");
    // Lavapipe ends an endless loop. Another driver hangs, and the deadline ends the process.
    let ends = selected().iter().all(|path| {
        karat::unstable::path::adapter(*path).is_ok_and(|adapter| adapter.family() == "llvmpipe")
    });
    let stop: &[&str] = if ends { &["endless", "large"] } else { &["large"] };
    for &entry_point in stop {
        for refuses in [false, true] {
            let error = declared(entry_point, refuses).expect_err("it gives no values").to_string();
            assert!(!error.contains("off by one"), "{entry_point}: {error}");
        }
    }
}

/// Checks of samplers and of a frame's mean also support `fails_on`. With the declaration, they must fail.
// Lesson 79
#[test]
fn samples_and_means_that_are_declared_to_fail() {
    let wgsl = "fn same(u: f32) -> f32 { return u; }\nfn squared(u: f32) -> f32 { return u * u; }\n\
                fn one(x: f32) -> f32 { return 1.0; }";
    let package = Package::from_source("planted", wgsl);
    let paths = selected();
    let declared = |sampler: &str, reason: &str| {
        let samples = package.function(sampler).sampled_over(Just(()), |(), u: f32| u);
        let samples = samples.support(Support::Interval(0.0, 1.0)).samples(16_384);
        let samples = paths.iter().fold(samples, |samples, path| samples.fails_on(*path, reason));
        samples.unrecorded().try_follows(package.function("one"), |(), x: f32| x)
    };
    let fit = declared("squared", "bug 1").expect("it fails as declared");
    assert_eq!((fit.paths.len(), fit.known_issues.len()), (0, paths.len()));
    let failure = declared("same", "bug 1").expect_err("it passes").to_string();
    assert!(failure.contains("where it is declared to fail: bug 1"), "{failure}");
    let failure = declared("squared", " ").expect_err("no reason").to_string();
    assert!(failure.contains("has no reason"), "{failure}");

    let pictures = Package::from_source("gradient", include_str!("../planted/gradient.wgsl"));
    let frame = || pictures.frame("", 32, 16).fullscreen("corners", "gradient");
    let frame =
        paths.iter().fold(frame(), |frame, path| frame.fails_on(*path, "bug 1")).unrecorded();
    let whole = karat::metric::Rect { left: 0, top: 0, width: 32, height: 16 };
    let mean = frame.try_has_mean(whole, [9.0; 3], Abs(0.1)).expect("it fails as declared");
    assert_eq!((mean.paths.len(), mean.known_issues.len()), (0, paths.len()));
    let error = frame.try_has_mean(whole, [0.0; 3], Abs(9.0)).expect_err("it is right");
    assert!(error.to_string().contains("where it is declared to fail: bug 1"), "{error}");
}

/// If a check fails as declared by `fails_on`, its record has the verdict known issue, not pass.
// Lesson 8: a declared failure must fail
#[test]
fn known_issues_are_recorded() {
    for (fault, verdict) in [
        ("known_issue", karat::unstable::record::Verdict::KnownIssue),
        ("unexpected_pass", karat::unstable::record::Verdict::Fail),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let folder_name = folder.path().display().to_string();
        let (output, text) = planted(&[fault], &[("KARAT_RECORD", &folder_name)]);
        assert_eq!(
            output.status.success(),
            verdict == karat::unstable::record::Verdict::KnownIssue,
            "{text}"
        );
        let records =
            karat::unstable::record::read(folder.path()).expect("the verdict was recorded");
        let [record] = &*records else { panic!("one check, {} records", records.len()) };
        assert_eq!(record.verdict, verdict);
        for path in &record.paths {
            assert_eq!(path.known_issue.as_deref(), Some("bug 1234"));
            assert_eq!(path.failures > 0, fault == "known_issue");
            // Reports show errors above the bound, with their positions.
            let errors = path.errors.as_ref().expect("it is judged case by case");
            let above: u64 = errors.powers.range(1..).map(|(_, count)| count).sum();
            assert_eq!(above + errors.not_finite > 0, path.failures > 0, "{errors:?}");
            let plot = path.plot.as_ref().map(|plot| (plot.arguments.len(), plot.rows.len()));
            assert_eq!(plot.is_some(), path.failures > 0);
            let rows = usize::try_from(errors.cases()).expect("a sample");
            assert!(
                plot.is_none_or(|(_, points)| points > rows),
                "the worst is among them: {plot:?}"
            );
        }
    }
}

/// Verbs that return their failure, such as `try_agrees_with`, also record the failure by default. A test turns this
/// off by `unrecorded`.
#[test]
fn returned_failures_are_recorded_by_default() {
    // On a path without frames, Karat draws no recorded frame.
    let runs = [("recorded", "on", 5, 5), ("unrecorded", "on", 5, 0)];
    let without = [("recorded", "off", 4, 4), ("unrecorded", "off", 5, 0)];
    for (fault, frames, failures, expected) in runs.into_iter().chain(without) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let folder_name = folder.path().display().to_string();
        let environment = [("KARAT_RECORD", &*folder_name), ("KARAT_FRAMES", frames)];
        let (output, text) = planted(&[fault], &environment);
        assert!(output.status.success(), "{text}");
        assert!(text.contains(&format!("{failures} failures")), "{fault}: {text}");
        let records = karat::unstable::record::read(folder.path()).unwrap_or_default();
        let failed = records.iter().filter(|record| {
            record.verdict == karat::unstable::record::Verdict::Fail && record.details.is_some()
        });
        assert_eq!((records.len(), failed.count()), (expected, expected), "{records:?}");
    }
}

/// If `KARAT_OVERLAY` is set, the records of checks of values, samples and frames have the path of the overlay's
/// folder.
// Lesson 74
#[test]
fn records_name_the_overlay() {
    let (folder, overlay) = (tempfile::tempdir(), tempfile::tempdir());
    let [folder, overlay] = [folder, overlay].map(|folder| folder.expect("a temporary folder"));
    let names = [&folder, &overlay].map(|folder| folder.path().display().to_string());
    for named in [None, Some(&*names[1])] {
        let mut environment = vec![("KARAT_RECORD", &*names[0])];
        environment.extend(named.map(|overlay| ("KARAT_OVERLAY", overlay)));
        let (output, text) = planted(&["records"], &environment);
        assert!(output.status.success(), "{text}");
        let records =
            karat::unstable::record::read(folder.path()).expect("the verdicts were recorded");
        let own: Vec<_> = records.iter().filter(|r| r.overlay.as_deref() == named).collect();
        assert_eq!(own.len(), 3, "{records:?}");
    }
}

/// A tolerance from `tolerance_on` applies only to its path, where the check fails if an error is above the tolerance.
// Lesson 13
// Lesson 22: a tolerance of one path
// Lesson 26
#[test]
fn a_tolerance_of_one_path() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x + 0.25; }");
    let over = || package.function("f").over(0.0..=1.0);
    let paths = selected();
    let loose = paths.iter().fold(over(), |check, path| check.tolerance_on(*path, Abs(0.26)));
    loose
        .clone()
        .unrecorded()
        .try_agrees_with(|x: f64| x, Ulp(1.0))
        .expect("each path has its own");
    let sampler = package.function("f").sampled_over(Just(()), |(), u: f32| u);
    let sampler = sampler.tolerance_on(paths[0], Abs(0.26)).unrecorded();
    let error = sampler.try_has_mean("u", |u: f32| f64::from(u), |()| 0.75, 1e-6);
    let error = error.expect_err("a mean has no tolerance").to_string();
    assert!(error.contains("has_mean, which takes no tolerance"), "{error}");
    let halves = loose.unrecorded().try_invariant_under(|x| 0.5 * x, Ulp(1.0));
    assert!(halves.is_err(), "the difference is up to 0.5");
    for path in &paths {
        let strict = over()
            .tolerance_on(*path, Abs(0.24))
            .unrecorded()
            .try_agrees_with(|x: f64| x, Abs(0.26));
        let found = disagreement(strict);
        let covered =
            |name: &str| paths.iter().any(|other| other.name() == name && covers(*path, *other));
        assert!(found.paths.iter().all(|other| covered(&other.adapter.path)), "{found}");
        let refused = [
            over()
                .tolerance_on(*path, Abs(f64::NAN))
                .unrecorded()
                .try_agrees_with(|x: f64| x, Abs(1.0)),
            over()
                .tolerance_on(*path, Abs(1.0))
                .unrecorded()
                .try_satisfies("is anything", |_, _: f32| true),
        ];
        for found in refused {
            assert!(matches!(found, Err(Failure::Signature { .. })), "{found:?}");
        }
    }
}
