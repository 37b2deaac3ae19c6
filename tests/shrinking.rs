//! Tests that Karat simplifies failing cases, remembers them and replays them.

use std::path::{Path as FilePath, PathBuf};
use std::process::Command;
use std::time::Instant;

use glam::{DVec3, Vec3};
use karat::check::{Agreement, Failure};
use karat::prelude::*;
use karat::unstable::check::Disagreement;

#[track_caller]
fn disagreement(result: Result<Agreement, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the fault was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

/// The arguments of the simplest case, which must be the same case on every path.
#[track_caller]
fn simplest(found: &Disagreement) -> Vec<String> {
    let mut all = found.paths.iter().map(|path| {
        let simplest = path.simplest.as_ref().expect("the worst case can be reduced");
        simplest.failure.arguments.iter().map(|(_, value)| value.clone()).collect::<Vec<_>>()
    });
    let first = all.next().expect("a path fails");
    assert!(all.all(|other| other == first), "{found}");
    first
}

/// A function that should return `n.z`, but returns 2 if `x` is between 0.3 and 0.9 and `i` is above 4.
const THREE: &str = "fn f(n: vec3f, x: f32, i: u32) -> f32 {\n    \
                     return select(n.z, 2.0, x > 0.3 && x < 0.9 && i > 4u);\n}";

// Lesson 41: shrinking and remembered inputs
#[test]
fn each_verb_reduces_its_worst_case() {
    let package = Package::from_source("planted", THREE);
    let over = || package.function("f").over((UnitVector, 0.0..=1.0, Integers(0..=1000_u32)));
    let found = over().unrecorded().try_agrees_with(|n: DVec3, _: f64, _: u32| n.z, Ulp(1.0));
    assert_eq!(simplest(&disagreement(found)), ["(0, 0, 1)", "0.5", "5"]);
    let found = over().unrecorded().try_satisfies("is at most 1", |_, z: f32| z <= 1.0);
    assert_eq!(simplest(&disagreement(found)), ["(0, 0, 1)", "0.5", "5"]);
    let found = over().unrecorded().try_invariant_under(|(n, x, i)| (n, x, i.max(4)), Ulp(0.0));
    assert!(found.is_ok(), "i is made no smaller than 4");
    let found = over().unrecorded().try_invariant_under(|(n, x, i)| (n, x, i.max(5)), Ulp(0.0));
    // The worst case of the vector points down, the simplest case up. The last value is `i'`.
    assert_eq!(simplest(&disagreement(found)), ["(0, 0, 1)", "0.5", "0", "5"]);
    let sign = Package::from_source("planted", "fn f(x: f32) -> f32 { return abs(x); }");
    let found = sign.function("f").over(Just(-1.0_f32)).unrecorded();
    let found = disagreement(found.try_agrees_with(|x: f64| x, Ulp(0.0)));
    assert!(found.paths.iter().all(|path| path.simplest.is_none()), "an edge is simple: {found}");
    let over = package.function("f").over((UnitVector, 0.4..=0.51, Integers(1..=3_u32)));
    let found = over.unrecorded().try_invariant_under(|(n, x, i)| (n, x, i + 4), Ulp(0.0));
    // The last value is `i'`.
    assert_eq!(simplest(&disagreement(found)), ["(0, 0, 1)", "0.5", "1", "5"]);
}

/// Karat simplifies values before `map` changes them. So all values that Karat tries are in the domain and pass
/// `filter`.
// Lesson 41: shrinking and remembered inputs
#[test]
fn mapped_and_filtered_domains_are_reduced_within() {
    let wgsl = "fn f(l: vec3f, v: vec3f) -> f32 { return select(dot(l, v), 9.0, l.z < 0.7); }";
    let package = Package::from_source("planted", wgsl);
    let cosine = |l: Vec3| l.z >= 0.1 && l.z <= 0.9;
    let domain = (Hemisphere, Hemisphere).filter(move |(l, _)| cosine(*l)).map(|(l, v)| (v, l));
    let found = package.function("f").over(domain.map(|(v, l)| (l, v))).unrecorded().try_satisfies(
        "is at most 1, of cosines in the domain",
        move |(l, _), x: f32| {
            assert!(cosine(l), "{l} was never drawn");
            x <= 1.01
        },
    );
    assert_eq!(simplest(&disagreement(found)), ["(0.8, 0, 0.6)", "(0, 0, 1)"]);
}

/// A domain with samples from 1/2 to 1. To simplify a sample, it offers 0, 1/4 and 3/4, even though 0 and 1/4 aren't
/// samples.
#[derive(Debug)]
struct Upper;

impl Domain for Upper {
    type Value = f32;
    fn draw(&self, source: &mut karat::unstable::domain::Source) -> Option<f32> {
        (0.5..=1.0).draw(source)
    }
    fn shrink(&self, value: &f32) -> Vec<f32> {
        [0.0, 0.25, 0.75].into_iter().filter(|simpler| simpler < value).collect()
    }
}

/// If the reference isn't finite for a simpler value, Karat skips this value and continues to simplify.
#[test]
fn a_reference_that_fails_on_the_way_is_passed_over() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return 1.01 / x; }");
    let found =
        package.function("f").over(Upper).unrecorded().try_agrees_with(|x: f64| 1.0 / x, Rel(1e-5));
    assert_eq!(simplest(&disagreement(found)), ["0.25"]);
}

/// Karat finds the same simplest case in each run, although its threads run in another order each time.
#[test]
fn reducing_is_deterministic() {
    let package = Package::from_source("planted", THREE);
    let run = || {
        let over = package.function("f").over((UnitVector, 0.0..=1.0, Integers(0..=1000_u32)));
        let found =
            over.seed(7).unrecorded().try_agrees_with(|n: DVec3, _: f64, _: u32| n.z, Ulp(1.0));
        disagreement(found).to_string().replace("agrees_with#2", "agrees_with")
    };
    assert_eq!(run(), run());
}

/// If a check passes, Karat calls the statement once for each case, and tries no simpler values.
#[test]
fn a_check_that_passes_tries_nothing_more() {
    use std::sync::atomic::{AtomicU64, Ordering};
    let package = Package::from_source("s", "fn f(x: f32) -> f32 { return x; }");
    let calls = AtomicU64::new(0);
    let count = |_: f32, _: f32| calls.fetch_add(1, Ordering::Relaxed) < u64::MAX;
    let start = Instant::now();
    let agreement = package.function("f").over(0.0..=1.0).satisfies("is counted", count);
    let paths = agreement.paths.len() as u64;
    assert_eq!(calls.into_inner(), 65_536 * paths, "{:?}", start.elapsed());
}

/// Runs `planted kept` with `change` in its own process, which keeps failing inputs in `folder`.
fn kept(folder: &FilePath, change: &str, environment: &[(&str, &str)]) -> (bool, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_planted"));
    for name in ["CI", "KARAT_PATHS", "KARAT_REQUIRE", "KARAT_RECORD", "KARAT_FAILURES"] {
        command.env_remove(name);
    }
    command.args(["kept", change]).env("CARGO_MANIFEST_DIR", folder);
    let output = command.envs(environment.iter().copied()).output();
    let output = output.expect("the planted program was built with this test");
    (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn file(folder: &FilePath) -> PathBuf {
    folder.join(".karat/failures/planted/main.txt")
}

fn lines(folder: &FilePath) -> Vec<String> {
    let text = std::fs::read_to_string(file(folder)).unwrap_or_default();
    text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
}

/// The lines of a report below `title` that show one case.
#[track_caller]
fn block<'a>(text: &'a str, title: &str) -> Vec<&'a str> {
    let from = text.find(title).unwrap_or_else(|| panic!("`{title}` is missing in:\n{text}"));
    text[from..].lines().skip(1).take_while(|line| line.starts_with("   ")).collect()
}

/// The names and values of the environment variables in the replay command that follows `title`.
#[track_caller]
fn replay<'a>(text: &'a str, title: &str) -> Vec<(&'a str, &'a str)> {
    let from = text.find(title).unwrap_or_else(|| panic!("`{title}` is missing in:\n{text}"));
    let line = text[from..].lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words = line.expect("a failure says how to replay it").split(' ');
    words.map_while(|word| word.split_once('=')).collect()
}

/// The replay command of the simplest case runs only this case, and fails in the same way.
#[test]
fn the_simplest_case_is_replayed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (passed, text) = kept(folder.path(), "", &[("KARAT_FAILURES", "off")]);
    assert!(!passed && !file(folder.path()).exists(), "{text}");
    let title = "simplest (reduced from case ";
    let environment = replay(&text, title);
    assert_eq!(
        environment.last(),
        Some(&("KARAT_INPUT", "00000000,00000000,3f800000,3f000000,00000005"))
    );
    let (passed, again) = kept(folder.path(), "", &environment);
    assert!(!passed && again.contains("1 of 1 case fails"), "{again}");
    assert_eq!(block(&text, title), block(&again, "worst (case "), "{again}");
    assert!(!again.contains(title) && !file(folder.path()).exists(), "{again}");
    assert_eq!(environment, replay(&again, "worst (case "), "a replay says how to repeat itself");
    let (passed, text) = kept(folder.path(), "mended", &environment);
    assert!(passed && text.contains("f: 1 case agrees"), "{text}");
    for (input, message) in
        [("3f800000", "needs 5 words in each case, but KARAT_INPUT has 1"), ("x", "isn't a list")]
    {
        let case = ("KARAT_CASE", "f/agrees_with/7");
        let (passed, text) = kept(folder.path(), "", &[case, ("KARAT_INPUT", input)]);
        assert!(!passed && text.contains(message), "{text}");
    }
    let (passed, text) = kept(folder.path(), "", &[("KARAT_INPUT", "3f800000")]);
    assert!(!passed && text.contains("KARAT_INPUT needs KARAT_CASE"), "{text}");
}

/// Some verbs add samples to the arguments, such as `x'` or a rotation, and cases of integrals may be any Rust value.
/// Karat also simplifies, replays and remembers such cases.
#[test]
fn properties_and_integrals_are_reduced_replayed_and_remembered() {
    for (fault, simplest, kept_line) in [
        (
            "monotone",
            &["           x = 1", "           a = 1", "          x' = 0"][..],
            " 3f800000,3f800000,00000000 0x",
        ),
        (
            "turned",
            &[
                "           d = (0.6, 0, 0.8)",
                "           a = 1",
                "    rotation = 180 degrees about (1, 0, 0)",
            ],
            " 3f19999a,00000000,3f4ccccd,3f800000,3f800000,00000000,00000000,00000000 0x",
        ),
        ("integral", &["        case = \"1.0\""], " - 0x"),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (passed, text) = kept(folder.path(), fault, &[]);
        assert!(!passed, "{text}");
        let title = "simplest (reduced from case ";
        let reduced = block(&text, title);
        assert_eq!(&reduced[..simplest.len()], simplest, "{text}");
        let kept_lines = lines(folder.path());
        let [line] = &*kept_lines else { panic!("one line a failing input: {kept_lines:?}") };
        assert!(line.contains(kept_line), "{line}");

        // The replay runs only the same case, and prints the command that repeats it.
        let environment = replay(&text, title);
        let (passed, again) = kept(folder.path(), fault, &environment);
        assert!(!passed && again.contains("1 of 1 case fails"), "{again}");
        assert_eq!(block(&text, title), block(&again, "worst (case "), "{again}");
        assert_eq!(environment, replay(&again, "worst (case "));
        let environment = replay(&text, title);
        let (passed, text) = kept(folder.path(), &format!("{fault}_mended"), &environment);
        assert!(passed, "{text}");

        // Karat tries the remembered case again, also with a seed that wouldn't find the fault.
        let (passed, text) = kept(folder.path(), &format!("{fault}_mended"), &[]);
        assert!(passed && lines(folder.path()).len() == 1, "what passes stays: {text}");
        let (passed, text) = kept(folder.path(), fault, &[("KARAT_SEED", "7")]);
        assert!(!passed && lines(folder.path()).len() <= 2, "{text}");
    }
}

/// Only the case 0.36 fails, and the check doesn't sample this case. The check fails because Karat remembers the case
/// from a previous failure.
#[test]
fn a_remembered_integral_fails_again() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (passed, text) = kept(folder.path(), "integral_rare", &[]);
    assert!(passed, "no case is 0.36: {text}");
    let (passed, text) = kept(folder.path(), "integral_window", &[]);
    assert!(!passed, "{text}");
    let (passed, text) = kept(folder.path(), "integral_rare", &[]);
    assert!(!passed && text.contains("1 of 257 cases fail"), "{text}");
    assert_eq!(block(&text, "worst (remembered case 256)")[0], "        case = \"0.36\"");
    let environment = replay(&text, "worst (remembered");
    let (passed, again) = kept(folder.path(), "integral_rare", &environment);
    assert!(!passed && again.contains("1 of 1 case fails"), "{again}");
    let (passed, text) = kept(folder.path(), "integral_elsewhere", &[]);
    assert!(passed && text.contains("(case = \"0.36\") is ignored"), "{text}");
}

/// Karat keeps a failing input once, even if it fails again. The input stays in the file after the function is mended
/// and the check passes.
// Lesson 41: shrinking and remembered inputs
#[test]
fn failing_inputs_are_remembered() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for _ in 0..2 {
        let (passed, text) = kept(folder.path(), "", &[]);
        assert!(!passed, "{text}");
        let lines = lines(folder.path());
        let [line] = &*lines else { panic!("one line a failing input: {lines:?}") };
        assert!(line.starts_with("f agrees_with "), "{line}");
        assert!(line.contains(" 00000000,00000000,3f800000,3f000000,00000005 0x"), "{line}");
        assert!(line.ends_with(" # n = (0, 0, 1), x = 0.5, i = 5"), "{line}");
    }
    let (passed, text) = kept(folder.path(), "mended", &[]);
    assert!(passed && text.contains("f: 65536 cases agree"), "{text}");
    assert_eq!(lines(folder.path()).len(), 1, "what passes stays");
}

/// The check doesn't sample the failing input. It fails only if Karat reads the input from the file of failing inputs.
#[test]
fn a_remembered_input_fails_again() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (passed, text) = kept(folder.path(), "rare", &[]);
    assert!(passed, "{text}");
    let line = "f agrees_with gl 00000000,00000000,3f800000,3f3b2fec,00000005 0x0:0: # by hand";
    std::fs::create_dir_all(file(folder.path()).parent().expect("a folder")).expect("made");
    std::fs::write(file(folder.path()), format!("{line}\nnonsense\n")).expect("written");
    let (passed, text) = kept(folder.path(), "rare", &[("KARAT_PATHS", "all"), ("CI", "true")]);
    assert!(!passed, "{text}");
    assert!(text.contains("  1 of 65537 cases fail"), "{text}");
    assert!(
        block(&text, "worst (remembered case 65536)").contains(&"           x = 0.7312"),
        "{text}"
    );
    assert!(text.contains("line 2 isn't a failing input, so Karat ignores the line"), "{text}");
    let environment = replay(&text, "worst (remembered");
    let (passed, again) = kept(folder.path(), "rare", &environment);
    assert!(!passed && again.contains("1 of 1 case fails"), "{again}");
    let (passed, text) = kept(folder.path(), "rare", &[("KARAT_FAILURES", "off")]);
    assert!(passed, "{text}");
}

/// Karat ignores a remembered input if the function now takes other arguments or the domain no longer contains the
/// input. It prints a note.
#[test]
fn remembered_inputs_that_no_longer_fit_are_ignored() {
    for (first, then, note) in [
        (
            "",
            "narrow",
            "(n = (0, 0, 1), x = 0.5, i = 5) is ignored: the domain doesn't contain this input now",
        ),
        ("", "signature", "is ignored: the function takes other arguments now"),
        ("mapped", "other_map", "is ignored: the domain doesn't contain this input now"),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (passed, text) = kept(folder.path(), first, &[]);
        assert!(!passed && lines(folder.path()).len() == 1, "{text}");
        let (passed, text) = kept(folder.path(), then, &[]);
        assert!(passed && text.contains(note), "{text}");
        let (_, text) = kept(folder.path(), first, &[]);
        assert!(!text.contains("is ignored"), "the domain has it again: {text}");
    }
}

/// In CI, and in unrecorded checks, Karat keeps no failing inputs. If Karat can't write a failing input to disk, Karat
/// prints a note.
#[test]
fn nothing_is_written_where_it_is_not_wanted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (change, environment) in [("", ("CI", "true")), ("caught", ("CI", ""))] {
        let (passed, text) = kept(folder.path(), change, &[environment]);
        assert!(!passed && text.contains("cases fail"), "{text}");
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
    }
    std::fs::write(folder.path().join(".karat"), "a file, not a folder").expect("written");
    let (passed, text) = kept(folder.path(), "", &[]);
    assert!(!passed && text.contains("cases fail"), "{text}");
    assert!(text.contains("can't keep the failing input: "), "{text}");
}

karat::shareable! {
    struct Mixed mirrors MixedMirror { a: f32, v: Vec3, n: i32, flags: [u32; 2], on: bool }
}

/// Arguments of every type reach the function unchanged, whether Karat passes them in uniform buffers, in storage
/// buffers or as constants.
// Lesson 40: arguments from uniform buffers and as constants
#[test]
fn arguments_come_from_every_source() {
    let wgsl = "struct Mixed { a: f32, v: vec3f, n: i32, flags: array<u32, 2>, on: bool }\n\
                fn f(m: Mixed, k: mat2x2f) -> array<u32, 12> {\n    \
                    return array<u32, 12>(bitcast<u32>(m.a), bitcast<u32>(m.v.x), \
                        bitcast<u32>(m.v.y), bitcast<u32>(m.v.z), bitcast<u32>(m.n), m.flags[0], \
                        m.flags[1], select(0u, 1u, m.on), bitcast<u32>(k[0].x), \
                        bitcast<u32>(k[0].y), bitcast<u32>(k[1].x), bitcast<u32>(k[1].y));\n}";
    let package = Package::from_source("inputs", wgsl);
    let float = || AnyF32::finite().filter(|x| !x.is_subnormal());
    let integers =
        (Integers(i32::MIN..=i32::MAX), Integers(0..=u32::MAX), OneOf(vec![false, true]));
    let domain = (float(), float(), float(), integers).map(|(a, b, c, (n, flag, on))| {
        let m = Mixed { a, v: Vec3::new(b, c, -a), n, flags: [flag, !flag], on };
        (m, glam::Mat2::from_cols_array(&[c, b, a, 0.1]))
    });
    let bits = |x: f64| (x as f32).to_bits();
    let agreement = package.function("f").over(&domain).from_all_sources().agrees_with(
        |m: MixedMirror, k: glam::DMat2| {
            let (v, k) = (m.v.to_array().map(bits), k.to_cols_array().map(bits));
            let [x, y] = m.flags;
            let on = u32::from(m.on);
            [bits(m.a), v[0], v[1], v[2], m.n.cast_unsigned(), x, y, on, k[0], k[1], k[2], k[3]]
        },
        Ulp(0.0),
    );
    assert_eq!(agreement.cases, 65_536 + 65_536 + 64, "{agreement}");
    let names: Vec<_> = agreement.paths.iter().map(|(adapter, _)| &adapter.path).collect();
    assert_eq!(names.len() % 3, 0, "{names:?}");
}

/// Karat reports, simplifies and replays a fault with each of the three sources of arguments: storage buffers, uniform
/// buffers and constants.
// Lesson 40: arguments from uniform buffers and as constants
#[test]
fn a_fault_is_found_from_every_source() {
    let package = Package::from_source("planted", THREE);
    let over = || package.function("f").over((UnitVector, 0.0..=1.0, Integers(0..=1000_u32)));
    let reference = |n: DVec3, _: f64, _: u32| n.z;
    for (inputs, cases) in
        [(Inputs::Storage, 65_536), (Inputs::Uniform, 65_536), (Inputs::Constant, 64)]
    {
        let found =
            disagreement(over().inputs(inputs).unrecorded().try_agrees_with(reference, Ulp(1.0)));
        for path in &found.paths {
            assert_eq!((path.inputs, path.census.cases), (inputs, cases), "{found}");
            let check = match inputs {
                Inputs::Storage => "/".to_owned(),
                other => format!("@{other}/"),
            };
            let replay = path.replay.to_string();
            let case = replay.split_once("KARAT_CASE=f/agrees_with").expect("it is named").1;
            // The second check of a function is `agrees_with#2`.
            let case = case.trim_start_matches(|c: char| c == '#' || c.is_ascii_digit());
            assert!(case.starts_with(&check), "{found}");
        }
        assert_eq!(simplest(&found), ["(0, 0, 1)", "0.5", "5"]);
        let found = over()
            .inputs(inputs)
            .unrecorded()
            .try_invariant_under(|(n, x, i)| (n, x, i | 7), Ulp(0.0));
        disagreement(found);
    }
    let all =
        disagreement(over().from_all_sources().unrecorded().try_agrees_with(reference, Ulp(1.0)));
    let text = all.to_string();
    for part in [", arguments from a uniform buffer\n", ", arguments as constants\n"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn what_is_no_constant_is_refused() {
    let package =
        Package::from_source("planted", "fn f(x: f32) -> u32 { return bitcast<u32>(x); }");
    let over = |inputs| package.function("f").over(Edges::f32().with_non_finite()).inputs(inputs);
    let error = over(Inputs::Constant)
        .cases(1000)
        .unrecorded()
        .try_satisfies("is anything", |_, _: u32| true);
    let error = error.expect_err("NaN").to_string();
    assert!(
        error.starts_with("Karat can't pass the arguments of `f` as constant inputs: "),
        "{error}"
    );
    // The result holds for any seed, not only by chance.
    for seed in 0..10 {
        let over = package.function("f").over(AnyF32::with_non_finite()).inputs(Inputs::Constant);
        let found = over.seed(seed).unrecorded().try_satisfies("is anything", |_, _: u32| true);
        assert!(found.expect_err("infinity").to_string().contains("constant inputs: "), "{seed}");
    }
    let wide = "fn f(x: array<f32, 5000>) -> f32 { return x[0]; }";
    let package = Package::from_source("planted", wide);
    let over = package.function("f").over(Just([1.0_f32; 5000])).inputs(Inputs::Uniform);
    let error =
        over.unrecorded().try_satisfies("is anything", |_, _: f32| true).expect_err("too large");
    assert!(error.to_string().contains("larger than 16 KiB"), "{error}");
}
