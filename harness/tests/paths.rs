//! Every verb has a verdict for every path. The tests use two executors, and plant a fault in one of them or in both:
//! the executor returns wrong values, for example, or returns nothing.

use glam::{DQuat, Vec2, Vec3};
use karat::Path;
use karat::check::{Agreement, Calls, Failure};
use karat::compute::ComputeError;
use karat::domain::Sphere;
use karat::draw::DrawError;
use karat::frame::FrameError;
use karat::image::Precision;
use karat::metric::Rect;
use karat::prelude::*;
use karat::unstable::dispatch::{Afterwards, DispatchError, Passes};
use karat::unstable::domain::{Dynamic, Part};
use karat::unstable::draw::Drawing;
use karat::unstable::executor::Executor;
use karat::unstable::path::Adapter;
use karat::unstable::probe::{Call, Prepared, ProbeError, Started};
use karat::unstable::value::{Scalar, Shape};
use karat::{Goldens, Image};

const SHADER: &str = "\
fn twice(x: f32) -> f32 { return 2.0 * x; }
fn square(x: f32) -> f32 { return x * x; }
fn one(x: f32) -> f32 { return 1.0; }
fn same(v: vec3f) -> vec3f { return v; }
fn across(v: vec2f) -> vec2f { return vec2f(-v.y, v.x); }
fn frame(x: f32) -> mat3x3f { return mat3x3f(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0); }
fn near(x: f32) -> f32 { return 1.0 + x; }
fn uniform(x: f32) -> f32 { return 1.0; }
fn sampled(u: f32) -> f32 { return u; }
@group(0) @binding(0) var<storage, read_write> data: array<u32>;
@compute @workgroup_size(1) fn fill() { data[0] = 7u; }
@fragment fn gray() -> @location(0) vec4f { return vec4f(0.5, 0.5, 0.5, 1.0); }
";

/// A fault that a test plants in an executor.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    /// The executor returns wrong values.
    Values,
    /// The executor returns NaN.
    Nan,
    /// The executor returns no values.
    Stops,
    /// The compiler refuses the program.
    Refuses,
    /// The driver loses the device.
    Lost,
    /// The compiler panics.
    Panics,
    /// The executor panics while it runs a compiled program.
    PanicsLate,
}

/// An executor that computes the functions of `SHADER` on the host.
#[derive(Debug)]
struct Fake {
    name: &'static str,
    fault: Fault,
}

/// A compiled function of the executor [`Fake`].
struct Ready {
    name: String,
    /// The number of `u32`s in the arguments of a case.
    width: usize,
    /// The number of `u32`s in the result of a case.
    words: usize,
    fault: Fault,
    path: Path,
}

impl Fake {
    fn lost(&self) -> karat::path::PathError {
        karat::path::PathError::Driver { path: Executor::path(self), message: "lost".to_owned() }
    }

    fn refusal(&self) -> karat::path::PathError {
        karat::path::PathError::Route { path: Executor::path(self), message: "planted".to_owned() }
    }
}

impl Executor for Fake {
    fn path(&self) -> Path {
        self.name.parse().expect("a name")
    }

    fn adapter(&self) -> Adapter {
        let own = self.name.rsplit('@').next().unwrap_or_default();
        let (path, name) = (self.name.to_owned(), format!("{own} of two"));
        Adapter { path, name, driver: String::new(), software: true }
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        match self.fault {
            Fault::Refuses => return Err(self.refusal().into()),
            Fault::Lost => return Err(self.lost().into()),
            Fault::Panics => panic!("planted"),
            _ => {}
        }
        let function = call.probed.function();
        let width = function.parameters.iter().map(|(_, shape)| shape.lanes().len()).sum();
        let (name, fault, path) = (function.name.clone(), self.fault, Executor::path(self));
        let words = function.result.lanes().len();
        Ok(Box::new(Ready { name, width, words, fault, path }))
    }

    fn draw(&self, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
        let (width, height) = drawing.size();
        let gray = match self.fault {
            Fault::None => 0.5,
            Fault::Values => 0.75,
            Fault::Nan => f32::NAN,
            Fault::Stops => return Ok(Image::new(1, 1, vec![[1.0; 4]])),
            Fault::Refuses => return Err(self.refusal().into()),
            Fault::Lost => return Err(self.lost().into()),
            Fault::Panics | Fault::PanicsLate => panic!("planted"),
        };
        let pixels = vec![[gray, gray, gray, 1.0]; (width * height) as usize];
        Ok(Image::new(width, height, pixels))
    }

    fn dispatch(&self, _: &Passes) -> Result<Afterwards, DispatchError> {
        match self.fault {
            Fault::None => Ok(vec![(0, vec![7])]),
            Fault::Values | Fault::Nan => Ok(vec![(0, vec![8])]),
            Fault::Stops => Err(DispatchError::Empty),
            Fault::Refuses => Err(self.refusal().into()),
            Fault::Lost => Err(self.lost().into()),
            Fault::Panics | Fault::PanicsLate => panic!("{}", "planted"),
        }
    }
}

impl Prepared for Ready {
    fn capacity(&self) -> usize {
        4096
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        if self.fault == Fault::Stops {
            let (path, expected, found) = (self.path, cases, 0);
            return Err(ProbeError::Length { path, expected, found });
        }
        if self.fault == Fault::PanicsLate {
            return Ok(Box::new(|_| panic!("planted")));
        }
        let (wrong, nan) = (self.fault == Fault::Values, self.fault == Fault::Nan);
        let off = |good: f32, bad: f32| match () {
            () if nan => f32::NAN,
            () if wrong => bad,
            () => good,
        };
        let result = |row: &[u32]| -> Vec<u32> {
            let x = row.first().map_or(0.0, |word| f32::from_bits(*word));
            let floats = match &*self.name {
                "twice" => vec![off(2.0 * x, -3.0 - 2.0 * x)],
                "square" => vec![off(x * x, if x > 0.0 { x * x + 1.0 } else { x * x })],
                "one" => vec![off(1.0, 2.0)],
                "near" => vec![off(1.0 + x, 2.0 + x)],
                // The density is right in each case, but the samples aren't.
                "uniform" => vec![1.0],
                "sampled" => vec![off(x, x * x)],
                "same" => {
                    let v = [0, 1, 2].map(|lane| f32::from_bits(row[lane]));
                    vec![off(v[0], v[0] + 1.0), v[1], v[2]]
                }
                "across" => {
                    let v = [0, 1].map(|lane| f32::from_bits(row[lane]));
                    vec![off(-v[1], v[0] + 1.0), v[0]]
                }
                // A wrong basis is left-handed.
                "frame" => vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, off(1.0, -1.0)],
                // A test in WGSL with one expectation.
                _ => {
                    let mut report = vec![0; self.words];
                    (report[0], report[1]) = (1, if wrong || nan { 99 } else { 0 });
                    return report;
                }
            };
            floats.into_iter().map(f32::to_bits).collect()
        };
        let rows = arguments.chunks_exact(self.width.max(1));
        let results: Vec<Vec<u32>> = match self.width {
            0 => (0..cases).map(|_| result(&[])).collect(),
            _ => rows.map(result).collect(),
        };
        let stride = results.first().map_or(1, Vec::len);
        let words = results.concat();
        Ok(Box::new(move |read| {
            read(&words, stride);
            Ok(())
        }))
    }
}

/// Two executors with these faults, each on its own path.
fn two(first: Fault, second: Fault) -> [Fake; 2] {
    [Fake { name: "vulkan@one", fault: first }, Fake { name: "vulkan@two", fault: second }]
}

fn package() -> Package {
    Package::from_source("paths", SHADER)
}

/// A verb's name, and a function that runs the verb on two executors and returns the message of the failure.
type Verb = (&'static str, fn(&[Fake; 2]) -> Result<(), String>);

fn told<T, E: std::fmt::Display>(result: Result<T, E>) -> Result<(), String> {
    result.map(drop).map_err(|error| error.to_string())
}

fn check<D: Domain>(
    fakes: &[Fake; 2],
    function: &str,
    domain: D,
    verb: impl FnOnce(karat::Check<'_, Calls<D::Value>>) -> Result<Agreement, Failure>,
) -> Result<(), String>
where
    D::Value: karat::unstable::value::Arguments,
{
    let package = package();
    let probe = package.function(function).on(&fakes[0]).on(&fakes[1]);
    told(verb(probe.over(domain).cases(256)))
}

/// Every verb of functions, frames and passes.
const VERBS: [Verb; 22] = [
    ("agrees_with", |fakes| {
        check(fakes, "twice", 0.0..=1.0, |c| {
            c.unrecorded().try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0))
        })
    }),
    ("agrees_with spec", |fakes| {
        check(fakes, "twice", 0.0..=1.0, |c| c.unrecorded().try_agrees_with(|x: f64| 2.0 * x, Spec))
    }),
    ("agrees_with_function", |fakes| {
        check(fakes, "twice", 0.0..=1.0, |c| c.unrecorded().try_agrees_with_function("twice", Spec))
    }),
    ("satisfies", |fakes| {
        check(fakes, "twice", 0.0..=1.0, |c| {
            c.unrecorded().try_satisfies("is positive", |_, y: f32| y >= 0.0)
        })
    }),
    ("is_finite, or stays_within", |fakes| {
        check(fakes, "twice", 0.0..=1.0, |c| {
            c.clone().unrecorded().try_is_finite().and(c.unrecorded().try_stays_within(0.0..=2.0))
        })
    }),
    ("is_unit", |fakes| check(fakes, "same", UnitVector, |c| c.unrecorded().try_is_unit())),
    ("is_perpendicular_to", |fakes| {
        check(fakes, "across", Sphere::<Vec2>::unit(), |c| {
            c.unrecorded().try_is_perpendicular_to("v")
        })
    }),
    ("is_right_handed_frame", |fakes| {
        check(fakes, "frame", 0.0..=1.0, |c| c.unrecorded().try_is_right_handed_frame())
    }),
    ("invariant_under", |fakes| {
        check(fakes, "square", -1.0..=1.0, |c| c.unrecorded().try_invariant_under(|x| -x, Ulp(0.0)))
    }),
    ("scales_under", |fakes| {
        check(fakes, "square", -1.0..=1.0, |c| {
            c.unrecorded().try_scales_under(|x| -x, |_| 1.0, Ulp(0.0))
        })
    }),
    ("equivariant_under", |fakes| {
        check(fakes, "same", UnitVector, |c| {
            let turned = |v: Vec3, q: DQuat| (q * v.as_dvec3()).as_vec3();
            c.unrecorded().try_equivariant_under(turned, |v: Vec3, q| q * v.as_dvec3(), Abs(1e-5))
        })
    }),
    ("is_monotone_in", |fakes| {
        check(fakes, "twice", 0.0..=1.0, |c| {
            c.unrecorded().try_is_monotone_in("x", Trend::Increasing, Ulp(0.0))
        })
    }),
    ("at_limit", |fakes| {
        let limit = Limit::toward(0.0, [0.1, 0.01, 0.001]);
        check(fakes, "near", 0.0..=1.0, |c| {
            c.unrecorded().try_at_limit("x", limit, |_: f64| 1.0, Abs(2e-3))
        })
    }),
    ("integral", |fakes| {
        let package = package();
        let probe = package.function("one").on(&fakes[0]).on(&fakes[1]);
        let integral = probe.integral(0.5..=1.0_f32, |x| vec![(*x, f64::from(*x))]).cases(16);
        told(integral.unrecorded().try_agrees_with(|x: &f32| f64::from(*x), Rel(1e-6)))
    }),
    ("integral is_at_most", |fakes| {
        let package = package();
        let probe = package.function("one").on(&fakes[0]).on(&fakes[1]);
        let integral = probe.integral(0.5..=1.0_f32, |x| vec![(*x, f64::from(*x))]).cases(16);
        told(integral.unrecorded().try_is_at_most(|x: &f32| f64::from(*x), 1e-6))
    }),
    ("follows", |fakes| {
        let package = package();
        let probe = package.function("sampled").on(&fakes[0]).on(&fakes[1]);
        let sampled = probe.sampled_over(Just(()), |(), u: f32| u).samples(16_384);
        let sampled = sampled.support(Support::Interval(0.0, 1.0));
        told(sampled.unrecorded().try_follows(package.function("uniform"), |(), x: f32| x))
    }),
    ("has_mean", |fakes| {
        let package = package();
        let probe = package.function("sampled").on(&fakes[0]).on(&fakes[1]);
        let sampled = probe.sampled_over(Just(()), |(), u: f32| u).samples(16_384);
        told(sampled.unrecorded().try_has_mean("x", |x: f32| f64::from(x), |()| 0.5, 1e-6))
    }),
    ("expects", |fakes| {
        let text = "import karat::expect_true;\n@test fn holds() { expect_true(true); }";
        let package = Package::from_modules("m", [("m_test", text)]);
        let mut tests = package.tests_in(&["m_test".to_owned()]).expect("it reads");
        let test = tests.remove(0).expect("it reads").remove(0);
        let probe = test.probe().expect("valid").on(&fakes[0]).on(&fakes[1]);
        told(probe.over_dynamic(Dynamic::new(&[], vec![])).unrecorded().try_expects())
    }),
    ("golden of values", |fakes| {
        // The folder lies inside the project, because in CI each such folder has its own folder of pending files.
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
        let text = "x,result\n0.25,0.5\n0.5,1.0\n";
        let golden = folder.path().join("twice.csv");
        let goldens = Goldens::open(folder.path());
        let right = two(Fault::None, Fault::None);
        let matches = |fakes: &[Fake; 2]| {
            let package = package();
            let part = Part::listed(
                vec![Scalar::F32],
                [0.25_f32, 0.5].map(|x| vec![x.to_bits()]).to_vec(),
            );
            let x = Dynamic::new(&[("x".to_owned(), Shape::Scalar(Scalar::F32))], vec![vec![part]]);
            let probe = package.function("twice").on(&fakes[0]).on(&fakes[1]);
            told(probe.over_dynamic(x).unrecorded().try_matches(&goldens, "twice", Ulp(0.0)))
        };
        let missing = matches(&right).expect_err("no golden");
        assert!(missing.contains("no golden"), "{text}: {missing}");
        let pending = missing.split('`').find(|word| word.ends_with(".new.csv"));
        std::fs::copy(pending.expect("where it waits"), &golden).expect("accepted");
        matches(fakes)
    }),
    ("frame", |fakes| {
        let folder = tempfile::tempdir().expect("a folder");
        let golden = Image::new(8, 8, vec![[0.5, 0.5, 0.5, 1.0]; 64]);
        golden.write_exr(&folder.path().join("gray.exr"), Precision::Float, None).expect("written");
        let package = package();
        let frame = package.frame("", 8, 8).fragment("gray").on(&fakes[0]).on(&fakes[1]);
        told(frame.unrecorded().try_matches(&Goldens::open(folder.path()), "gray"))
    }),
    ("mean of a frame", |fakes| {
        let package = package();
        let frame = package.frame("", 8, 8).fragment("gray").on(&fakes[0]).on(&fakes[1]);
        told(frame.unrecorded().try_has_mean(Rect::new(0, 0, 8, 8), [0.5; 3], Abs(1e-3)))
    }),
    ("passes", |fakes| {
        let package = package();
        let passes = package.compute().with("data", Storage::new([0_u32]));
        let passes = passes.dispatch("fill", [1, 1, 1]).on(&fakes[0]).on(&fakes[1]);
        let after = passes.after("data");
        told(after.clone().unrecorded().try_agrees_with([7_u32], Abs(0.0)))?;
        told(after.unrecorded().try_satisfies("is odd", |data: &[u32]| data[0] % 2 == 1))
    }),
];

// Lesson 172
#[test]
fn a_fault_of_the_second_path_alone_is_seen_by_every_verb() {
    for (verb, run) in VERBS {
        run(&two(Fault::None, Fault::None)).unwrap_or_else(|error| panic!("{verb}: {error}"));
        for (first, second) in [(Fault::None, Fault::Values), (Fault::Values, Fault::None)] {
            let error = run(&two(first, second)).expect_err(verb);
            let guilty = if first == Fault::Values { "vulkan@one" } else { "vulkan@two" };
            assert!(error.contains(&format!("on {guilty}: ")), "{verb}: {error}");
        }
        let error = run(&two(Fault::None, Fault::Nan)).expect_err(verb);
        assert!(error.contains("vulkan@two"), "{verb}, NaN: {error}");
    }
}

/// If one path returns nothing, the other path still has its verdict.
// Lesson 172
#[test]
fn a_path_that_stops_leaves_the_others_their_verdict() {
    for (verb, run) in VERBS {
        for (first, second) in [(Fault::Stops, Fault::Values), (Fault::Values, Fault::Stops)] {
            let error = run(&two(first, second)).expect_err(verb);
            let [stops, differs] = match first {
                Fault::Stops => ["vulkan@one", "vulkan@two"],
                _ => ["vulkan@two", "vulkan@one"],
            };
            let no_verdict = " of two there is no verdict\n";
            assert!(
                error.contains(&format!("on {stops}: ")) && error.contains(no_verdict),
                "{verb}: {error}"
            );
            assert!(error.contains(&format!("on {differs}: ")), "{verb}: {error}");
        }
        let error = run(&two(Fault::Stops, Fault::None)).expect_err(verb);
        assert!(
            error.contains("on vulkan@two: two of two\n  all results agree"),
            "{verb}: {error}"
        );
    }
}

/// The two kinds of known issues: wrong values, and a compiler that refuses the program.
#[derive(Clone, Copy)]
enum Declared {
    Fails,
    Refused,
}

/// The verdicts of functions, frames and passes with a known issue on both paths.
fn declared(fakes: &[Fake; 2], declared: Declared) -> [Result<usize, String>; 3] {
    let package = package();
    let names = fakes.each_ref().map(|fake| fake.name);
    let function = package.function("twice").on(&fakes[0]).on(&fakes[1]).over(0.0..=1.0).cases(64);
    let function = names.iter().fold(function, |check, on| match declared {
        Declared::Fails => check.fails_on(*on, "bug 1"),
        Declared::Refused => check.refused_on(*on, "bug 1"),
    });
    let function = function.unrecorded().try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    let frame = package.frame("", 8, 8).fragment("gray").on(&fakes[0]).on(&fakes[1]);
    let frame = names.iter().fold(frame, |frame, on| match declared {
        Declared::Fails => frame.fails_on(*on, "bug 1"),
        Declared::Refused => frame.refused_on(*on, "bug 1"),
    });
    let frame = frame.unrecorded().try_has_mean(Rect::new(0, 0, 8, 8), [0.5; 3], Abs(1e-3));
    let passes = package.compute().with("data", Storage::new([0_u32]));
    let passes = passes.dispatch("fill", [1, 1, 1]).on(&fakes[0]).on(&fakes[1]);
    let passes = names.iter().fold(passes, |passes, on| match declared {
        Declared::Fails => passes.fails_on(*on, "bug 1"),
        Declared::Refused => passes.refused_on(*on, "bug 1"),
    });
    let passes = passes.after("data").unrecorded().try_agrees_with([7_u32], Abs(0.0));
    [
        function.map(|found| found.known_issues.len()).map_err(|error| error.to_string()),
        frame.map(|found| found.known_issues.len()).map_err(|error| error.to_string()),
        passes.map(|found| found.known_issues.len()).map_err(|error| error.to_string()),
    ]
}

/// If the author declares a known issue of a function, a frame or a pass, the declaration covers only wrong values. NaN
/// counts as a wrong value, but an error that stops the path doesn't.
// Lesson 173
#[test]
fn a_known_issue_is_about_values() {
    for fault in [Fault::Values, Fault::Nan] {
        for found in declared(&two(fault, fault), Declared::Fails) {
            assert_eq!(found, Ok(2), "{fault:?}");
        }
    }
    for fault in [Fault::Stops, Fault::Refuses] {
        for found in declared(&two(fault, fault), Declared::Fails) {
            let error = found.expect_err("it has no values");
            assert!(!error.contains("bug 1"), "{fault:?}: {error}");
        }
        for found in declared(&two(Fault::Values, fault), Declared::Fails) {
            let error = found.expect_err("the second path has no values");
            assert!(error.contains("on vulkan@two: two of two there is no verdict"), "{error}");
        }
    }
}

/// If a known issue no longer occurs on the second of two paths, the test fails.
// Lesson 173
#[test]
fn a_known_issue_that_is_gone_on_the_second_path() {
    for found in declared(&two(Fault::Values, Fault::None), Declared::Fails) {
        let error = found.expect_err("it is gone on the second path");
        assert!(error.contains("vulkan@two, where it is declared to fail: bug 1"), "{error}");
    }
}

/// If the author declares that a compiler refuses the program, the declaration covers neither wrong values nor other
/// errors.
// Lesson 173
#[test]
fn a_path_that_refuses_is_declared_by_itself() {
    for found in declared(&two(Fault::Refuses, Fault::Refuses), Declared::Refused) {
        assert_eq!(found, Ok(2));
    }
    for fault in [Fault::None, Fault::Values, Fault::Nan] {
        for found in declared(&two(Fault::Refuses, fault), Declared::Refused) {
            let error = found.expect_err("the second path runs it");
            assert!(error.contains("remove the `refused_on`"), "{fault:?}: {error}");
        }
    }
    for found in declared(&two(Fault::Refuses, Fault::Stops), Declared::Refused) {
        let error = found.expect_err("it doesn't refuse it");
        assert!(error.contains("on vulkan@two: two of two there is no verdict"), "{error}");
    }
    // A lost device isn't a refusal.
    for found in declared(&two(Fault::Lost, Fault::Lost), Declared::Refused) {
        let error = found.expect_err("the device is lost");
        assert!(error.contains("reports: lost") && !error.contains("bug 1"), "{error}");
    }
}

/// An error of several paths contains the error of each path, so a program can match on the kind of each error.
// Lesson 172
#[test]
fn failures_of_paths_are_data() {
    let fakes = two(Fault::Stops, Fault::Values);
    let package = package();
    let probe = package.function("twice").on(&fakes[0]).on(&fakes[1]).over(0.0..=1.0).cases(64);
    let Err(Failure::Paths(paths)) = probe.unrecorded().try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0))
    else {
        panic!("two paths fail in two ways")
    };
    assert!(matches!(&*paths.failures, [Failure::Disagreement(_)]));
    assert!(matches!(&*paths.stopped, [(_, Failure::Probe(ProbeError::Length { .. }))]));
    let frame = package.frame("", 8, 8).fragment("gray").on(&fakes[0]).on(&fakes[1]);
    let mean = frame.unrecorded().try_has_mean(Rect::new(0, 0, 8, 8), [0.5; 3], Abs(1e-3));
    let Err(FrameError::Paths(paths)) = mean else { panic!("two paths fail in two ways") };
    assert!(matches!(&*paths.failures, [FrameError::Mean { .. }]));
    let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("fill", [1, 1, 1]);
    let after = passes.on(&fakes[0]).on(&fakes[1]).after("data");
    let Err(ComputeError::Paths(paths)) = after.unrecorded().try_agrees_with([7_u32], Abs(0.0))
    else {
        panic!("two paths fail in two ways")
    };
    assert!(matches!(&*paths.failures, [ComputeError::Differs(_)]));
    assert_eq!(paths.agreeing.len(), 0);
}

/// If a compiler or a driver panics, each verb reports a failure of that path, and the other path has its verdict.
#[test]
fn a_path_that_panics_leaves_the_others_their_verdict() {
    for (verb, run) in VERBS {
        for fault in [Fault::Panics, Fault::PanicsLate] {
            for (first, second) in [(fault, Fault::None), (Fault::None, fault)] {
                let error = run(&two(first, second)).expect_err(verb);
                let panics = if first == fault { "one" } else { "two" };
                let told = format!("path `vulkan@{panics}` panics on `");
                assert!(error.contains(&told), "{verb} {fault:?}: {error}");
                assert!(error.contains("planted (panicked at "), "{verb} {fault:?}: {error}");
                assert!(error.contains("all results agree"), "{verb} {fault:?}: {error}");
            }
            let error = run(&two(fault, Fault::Values)).expect_err(verb);
            assert!(error.contains("path `vulkan@one` panics on `"), "{verb} {fault:?}: {error}");
        }
    }
    // A panic is neither a refusal nor a wrong value.
    for declaration in [Declared::Fails, Declared::Refused] {
        for found in declared(&two(Fault::Panics, Fault::Panics), declaration) {
            let error = found.expect_err("nobody declares a panic");
            assert!(error.contains("panics on") && !error.contains("bug 1"), "{error}");
        }
    }
}

/// A reference that panics fails its test with the message of the panic.
#[test]
fn a_reference_that_panics_is_no_path_s_failure() {
    let (fakes, package) = (two(Fault::None, Fault::None), package());
    for case in 0..3 {
        let ran = std::panic::catch_unwind(|| {
            let probe = package.function("twice").on(&fakes[0]).on(&fakes[1]);
            let check = probe.over(0.0..=1.0).cases(256).unrecorded();
            match case {
                0 => {
                    check.try_agrees_with(|_: f64| -> f64 { panic!("of the reference") }, Ulp(0.0))
                }
                1 => check.try_satisfies("holds", |_, _: f32| panic!("of the reference")),
                _ => check
                    .try_invariant_under(|_: f32| -> f32 { panic!("of the reference") }, Ulp(0.0)),
            }
        });
        let payload = ran.expect_err("it panics");
        assert_eq!(payload.downcast_ref::<&str>(), Some(&"of the reference"), "{case}");
    }
}
