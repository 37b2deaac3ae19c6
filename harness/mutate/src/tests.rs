//! Tests mutants of small shaders, and checks the mutants' fates.

use std::path::Path;

use karat::Package;
use tempfile::TempDir;

use crate::{Equality, Fate, Form, Hunted, Lived, MutateError, Request, Score, Tried};

const SHADER: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\
                      fn lonely(x: f32) -> f32 { return x + 3.0; }\n\
                      fn capped(x: f32) -> f32 { return max(x * x, -1.0); }\n";

const TESTS: &str = "[[test]]\nfunction = \"half\"\nover = { x = 2 }\nequals = 1\ntolerance = \"1 ulp\"\n\n\
                     [[test]]\nfunction = \"capped\"\nover = { x = \"-4..4\" }\nagrees_with = \"capped_once\"\n\
                     tolerance = \"1 ulp\"\n";

/// The module `other`: its function `square` is the reference for `capped`. The requests select no mutants of this
/// module.
const REFERENCE: &str = "fn square(x: f32) -> f32 { return x * x; }\n";

fn folder(shader: &str, tests: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |file: &str, text: &str| std::fs::write(folder.path().join(file), text);
    write("calc.wgsl", shader).expect("written");
    write("other.wgsl", REFERENCE).expect("written");
    let tests = tests.replace("capped_once", "other::square");
    write("calc.test.toml", &tests).expect("written");
    folder
}

fn request(folder: &Path) -> Request {
    // The tests write only into the folder of the shaders.
    Request::new(Package::open(folder).expect("the package opens")).only(["calc"])
}

fn hunted(folder: &Path) -> Hunted {
    request(folder).run(&|_, _, _| {}).expect("the tests pass without a mutant")
}

fn of<'h>(hunted: &'h Hunted, item: &str, original: &str, replacement: &str) -> &'h Tried {
    let mut all = hunted.tried.iter();
    let is_it = |one: &&Tried| {
        let mutant = &one.candidate.mutant;
        (&*mutant.item, &*mutant.original, &*mutant.replacement) == (item, original, replacement)
    };
    all.find(is_it).unwrap_or_else(|| panic!("no `{original}` -> `{replacement}` in {item}"))
}

// Lesson 29
#[test]
fn mutants_are_classified_as_killed_living_or_untested() {
    let folder = folder(SHADER, TESTS);
    let hunted = hunted(folder.path());
    let fate = |item, original, replacement| &of(&hunted, item, original, replacement).fate;
    let killed = fate("half", "0.5", "1.0");
    assert_eq!(*killed, Fate::Killed { test: "calc::half equals".to_owned() });
    let untested = fate("lonely", "+", "-");
    let Fate::Untested { why: Lived::Differs(found) } = untested else { panic!("{untested:?}") };
    assert_eq!((&*found.function, found.floats), ("calc::lonely", true));
    // The guard never acts, so no input shows a difference.
    let lived = fate("capped", "max(x * x, -1.0)", "(x * x)");
    let Fate::Lived { tests: 1, why: Lived::Unseen { cases }, .. } = lived else {
        panic!("{lived:?}")
    };
    assert!(*cases > 1000);
    let score = Score::of(&hunted.tried);
    assert!(score.killed > 0 && score.lived > 0 && score.untested > 0, "{score:?}");
    assert_eq!(
        score.judged() + score.equal + score.invalid + score.idle + score.stopped,
        hunted.tried.len()
    );
}

/// A test hides a mutant if the test sees other values and tolerates them. A test that sees the same values doesn't
/// hide the mutant. If several tests hide the mutant, Karat names the test that came closest to failing.
// Lesson 29
#[test]
fn tolerances_hide_what_they_allow() {
    let shader = "fn scaled(x: f32) -> f32 { return 100.0 * x; }\n\
                  fn part(x: f32) -> f32 { if (x > 3.0) { return x + 7.0; } return x; }\n";
    let tests = "[[test]]\nfunction = \"scaled\"\nover = { x = 1 }\nequals = 100\ntolerance = \"abs 4\"\n\n\
                 [[test]]\nname = \"loose\"\nfunction = \"scaled\"\nover = { x = 1 }\nequals = 100\ntolerance = \"abs 200\"\n\n\
                 [[test]]\nfunction = \"part\"\nover = { x = 2 }\nequals = 2\ntolerance = \"exact\"\n";
    let hunted = hunted(folder(shader, tests).path());
    let hidden = |item, original, replacement| {
        let fate = &of(&hunted, item, original, replacement).fate;
        let Fate::Lived { hidden, .. } = fate else { panic!("{fate:?}") };
        hidden.clone()
    };
    // A deviation of 1 % is a quarter of the tolerance.
    let found = hidden("scaled", "100.0", "101.0").expect("the test sees 101");
    assert_eq!((&*found.test, found.ratios), ("calc::scaled equals", [0.0, 0.25]));
    assert_eq!(hidden("part", "7.0", "14.0"), None, "no test runs this code");
    // Only the test `loose` tolerates the doubled result.
    assert!(matches!(of(&hunted, "scaled", "100.0", "200.0").fate, Fate::Killed { .. }));
}

/// A mutant is equivalent to the original if it changes an unused value, or if later arithmetic undoes the change.
// Lesson 29
#[test]
fn equal_mutants_are_no_gaps() {
    let shader = "fn f(x: f32) -> f32 { let unused = x * 3.0; return x * 1.0; }\n\
                  fn g(x: f32) -> f32 { if (x == 0.125) { return 1.0; } return 5.0; }\n";
    let tests = "[[test]]\nfunction = \"f\"\nover = { x = 2 }\nfinite = true\n\n\
                 [[test]]\nfunction = \"g\"\nover = { x = 2 }\nfinite = true\n";
    let hunted = hunted(folder(shader, tests).path());
    let fate = |item, original, replacement| of(&hunted, item, original, replacement).fate.clone();
    let same = Fate::Equal { by: Equality::Operations };
    assert_eq!(fate("f", "3.0", "6.0"), same, "no code uses the value");
    assert_eq!(fate("f", "x * 1.0", "x"), same);
    let differs = fate("f", "1.0", "2.0");
    assert!(matches!(differs, Fate::Lived { why: Lived::Differs(_), .. }), "{differs:?}");
    // The results of the mutant and of the original differ for only one of 2^32 numbers.
    assert!(matches!(fate("g", "1.0", "2.0"), Fate::Lived { .. }));
}

/// Removing a guard that never acts gives an equivalent function. If a guard acts for some argument, the function
/// without the guard isn't equivalent.
#[test]
fn guards_that_never_act_are_equal() {
    let shader = "fn f(n: i32) -> f32 { let x = f32(n); return max(abs(x), 0.0); }\n\
                  fn g(n: i32) -> f32 { let x = f32(n); return max(abs(x), 0.001); }\n\
                  fn h(n: u32) -> f32 { let x = f32(n); return min(saturate(x), 1.0) + clamp(fract(x), -2.0, 2.0) + clamp(sin(x), -2.0, 2.0); }\n\
                  fn i(n: i32) -> f32 { let x = f32(n); if (x > 0.5) { return max(x, 0.5); } return max(x, 0.25); }\n\
                  fn j(x: f32) -> f32 { return max(abs(x), 0.0); }\n\
                  fn k(x: f32) -> f32 {\n    let u = x * 3.0;\n    //karat: assert u <= 9.0\n    let v = x * 5.0;\n    return x;\n}\n";
    let test = |name: &str, over: &str| {
        format!("[[test]]\nfunction = \"{name}\"\nover = {over}\nin_range = [-1e9, 1e10]\n\n")
    };
    let tests = [
        test("f", "{ n = 2 }"),
        test("g", "{ n = 2 }"),
        test("h", "{ n = 1 }"),
        test("i", "{ n = 2 }"),
        test("j", "{ x = 2 }"),
        test("k", "{ x = 2 }"),
    ];
    let hunted = hunted(folder(shader, &tests.concat()).path());
    let fate = |item, original, replacement| of(&hunted, item, original, replacement).fate.clone();
    let equal = Fate::Equal { by: Equality::Intervals };
    assert_eq!(fate("f", "max(abs(x), 0.0)", "(abs(x))"), equal);
    assert_eq!(fate("h", "min(saturate(x), 1.0)", "(saturate(x))"), equal);
    assert_eq!(fate("h", "clamp(fract(x), -2.0, 2.0)", "(fract(x))"), equal);
    for acts in [
        fate("f", "max(abs(x), 0.0)", "(0.0)"),
        fate("f", "abs(x)", "(x)"),
        fate("g", "max(abs(x), 0.001)", "(abs(x))"),
        fate("h", "saturate(x)", "(x)"),
        fate("i", "max(x, 0.25)", "(x)"),
        // A float may be NaN, and `max` removes NaN.
        fate("j", "max(abs(x), 0.0)", "(abs(x))"),
        // An assertion reads the value.
        fate("k", "3.0", "6.0"),
        // Outside of half a turn, WGSL doesn't bound the error of `sin`.
        fate("h", "clamp(sin(x), -2.0, 2.0)", "(sin(x))"),
    ] {
        assert!(!matches!(acts, Fate::Equal { .. }), "{acts:?}");
    }
    // Neither the result nor the assertion depends on the value.
    assert_eq!(fate("k", "5.0", "10.0"), Fate::Equal { by: Equality::Operations });
}

/// A mutant is untested if the only test runs a pass that doesn't import the mutated module.
// Lesson 209
#[test]
fn a_test_of_a_pass_covers_only_the_code_that_the_pass_links() {
    let folder = folder("fn apart(x: f32) -> f32 { return x + 1.0; }\n", "");
    let write = |file: &str, text: &str| {
        std::fs::write(folder.path().join(file), text).expect("written");
    };
    write(
        "sums.wgsl",
        "@group(0) @binding(0) var<storage, read_write> total: array<f32>;\n\
         @compute @workgroup_size(1) fn sum() { total[0] = 2.0; }\n",
    );
    let test = "[[compute]]\nentry = \"sum\"\nworkgroups = 1\nwith = { total = { size = 1, range = \"0..1\" } }\n\
                after = { total = { equals = [2], tolerance = \"exact\" } }\n";
    write("sums.test.toml", test);
    std::fs::remove_file(folder.path().join("calc.test.toml")).expect("the file exists");
    let hunted = hunted(folder.path());
    assert!(matches!(of(&hunted, "apart", "+", "-").fate, Fate::Untested { .. }));
}

/// A test that sets an override fails if the mutant doesn't use the override.
#[test]
fn a_declaration_that_no_longer_fits_kills() {
    let shader = "override GAIN: f32 = 1.0;\n\
                  fn capped(x: f32) -> f32 { return max(GAIN, x); }\n";
    let test = "[[test]]\nfunction = \"capped\"\noverride = { GAIN = 0 }\nover = { x = \"1..2\" }\nfinite = true\n";
    let hunted = hunted(folder(shader, test).path());
    let killed = Fate::Killed { test: "calc::capped finite".to_owned() };
    assert_eq!(of(&hunted, "capped", "max(GAIN, x)", "(x)").fate, killed);
}

/// Samplers in declared tests have mutants, too. A test that samples beyond a texture's edge kills a mutant with
/// another address mode.
#[test]
fn samplers_of_tests_are_mutants() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |file: &str, text: &str| {
        std::fs::write(folder.path().join(file), text).expect("written");
    };
    write(
        "calc.wgsl",
        "@group(0) @binding(0) var image: texture_2d<f32>;\n@group(0) @binding(1) var how: sampler;\n\
         fn at(u: f32) -> f32 { return textureSampleLevel(image, how, vec2f(u, 0.5), 0.0).x; }\n",
    );
    let image = karat::Image::new(2, 1, vec![[0.0, 0.0, 0.0, 1.0], [1.0; 4]]);
    let file = folder.path().join("image.exr");
    image.write_exr(&file, karat::image::Precision::Float, None).expect("written");
    let image = "image = \"image.exr\", how = \"nearest repeat\"";
    write(
        "calc.test.toml",
        &format!(
            "[[test]]\nfunction = \"at\"\nwith = {{ {image} }}\nover = {{ u = 1.25 }}\nequals = 0\ntolerance = \"exact\"\n"
        ),
    );
    let hunted = hunted(folder.path());
    let killed = Fate::Killed { test: "calc::at equals".to_owned() };
    assert_eq!(of(&hunted, "how", "nearest repeat", "nearest").fate, killed);
    let lived = &of(&hunted, "how", "nearest repeat", "linear repeat").fate;
    assert!(matches!(lived, Fate::Lived { why: Lived::Sampler, .. }), "{lived:?}");
}

/// A mutant is equivalent to the original if Karat can try all inputs and the results agree.
#[test]
fn all_inputs_are_tried_where_they_are_few() {
    let shader = "fn h(a: bool, b: bool) -> bool { return (a && b) || (a && !b) || b; }\n\
                  fn c() -> f32 { return max(sqrt(2.0), 1.0); }\n";
    let tests = "[[test]]\nfunction = \"h\"\nover = { a = true, b = true }\nequals = true\n\n\
                 [[test]]\nfunction = \"c\"\nin_range = [-100, 100]\n";
    let hunted = hunted(folder(shader, tests).path());
    let fate = |item, original, replacement| of(&hunted, item, original, replacement).fate.clone();
    // `a || b` has the same value without `a && b`.
    let all = Fate::Equal { by: Equality::Inputs(4) };
    assert_eq!(fate("h", "(a && b) || (a && !b)", "(a && !b)"), all);
    let parted = fate("h", "!", "");
    assert!(!matches!(parted, Fate::Equal { .. }), "{parted:?}");
    let same = Fate::Equal { by: Equality::Operations };
    assert_eq!(fate("c", "max(sqrt(2.0), 1.0)", "(sqrt(2.0))"), same);
}

/// A suggested test passes on the original, and kills its mutant.
// Lesson 29
#[test]
fn suggested_tests_kill() {
    let folder = folder(SHADER, TESTS);
    let first = hunted(folder.path());
    let suggested = first.tried.iter().filter_map(|one| match &one.fate {
        Fate::Lived { why: Lived::Differs(found), .. }
        | Fate::Untested { why: Lived::Differs(found) } => {
            Some((one.candidate.id.clone(), found.test().expect("the values are numbers")))
        }
        _ => None,
    });
    let suggested: Vec<(String, String)> = suggested.collect();
    assert!(suggested.len() > 3, "{suggested:?}");
    let all: String = suggested.iter().map(|(_, test)| format!("\n{test}")).collect();
    let own = std::fs::read_to_string(folder.path().join("calc.test.toml")).expect("written");
    std::fs::write(folder.path().join("calc.test.toml"), own + &all).expect("written");
    let second = hunted(folder.path());
    for (id, test) in &suggested {
        let one = second.tried.iter().find(|one| one.candidate.id == *id).expect("the id stays");
        assert!(matches!(one.fate, Fate::Killed { .. }), "{one:?} lives with\n{test}");
    }
}

/// The suggested tests in WGSL kill the mutants, like the tests in TOML. The suggested tests in Rust don't run here:
/// this test only searches their text for expected lines.
#[test]
fn tests_are_suggested_in_three_languages() {
    let shader = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\
                  fn turned(v: vec3f, n: u32) -> vec3f { return v.zxy * f32(n); }\n\
                  fn next(n: i32) -> i32 { return n + 7; }\n\
                  fn is_low(x: f32) -> bool { return x < 3.0; }\n";
    let tests = "[[test]]\nfunction = \"half\"\nover = { x = 2 }\nin_range = [-1e9, 1e9]\n";
    let folder = folder(shader, tests);
    let first = hunted(folder.path());
    let differ = first.tried.iter().filter_map(|one| match &one.fate {
        Fate::Lived { why: Lived::Differs(found), .. }
        | Fate::Untested { why: Lived::Differs(found) } => Some((one, found)),
        _ => None,
    });
    let (mut wgsl, mut killed, mut rust) = (String::new(), Vec::new(), String::new());
    for (one, found) in differ {
        let id = &one.candidate.id;
        let Some(test) = found.test_as(Form::Wgsl, id) else { panic!("{found:?}") };
        // A module may contain each import only once.
        let news = test.lines().filter(|line| !wgsl.contains(line)).collect::<Vec<_>>().join("\n");
        wgsl = format!("{news}\n{wgsl}");
        killed.push((id.clone(), test));
        rust += &found.test_as(Form::Rust, id).expect("scalars and vectors");
    }
    assert!(killed.len() > 6 && wgsl.contains("expect_near_vec3(turned(vec3<f32>("), "{wgsl}");
    assert!(
        wgsl.contains("expect_equal_i32(next(") && wgsl.contains("expect_true(is_low("),
        "{wgsl}"
    );
    std::fs::write(folder.path().join("calc_test.wgsl"), &wgsl).expect("written");
    let second = hunted(folder.path());
    for (id, test) in killed {
        let one = second.tried.iter().find(|one| one.candidate.id == id).expect("the id stays");
        assert!(matches!(one.fate, Fate::Killed { .. }), "{one:?} lives with\n{test}");
    }
    for part in [
        "    SHADERS.function(\"calc::half\").over(Just(1.0_f32)).agrees_with(|_: f64| 0.5, Abs(",
        "    SHADERS.function(\"calc::turned\").over((Just(Vec3::new(",
        "|_: DVec3, _: u32| DVec3::new(",
        ".agrees_with(|_: i32| ",
    ] {
        assert!(rust.contains(part), "no `{part}` in {rust}");
    }
}

/// Each of these cases has its own message: failing tests, no tests, nothing to mutate, and tests that can't fail on
/// the mutation.
// Lesson 29
#[test]
fn nothing_is_judged_without_evidence() {
    let wrong = |shader: &str, tests: &str| {
        let folder = folder(shader, tests);
        request(folder.path()).run(&|_, _, _| {}).expect_err("there is no result")
    };
    let red = wrong(SHADER, &TESTS.replace("equals = 1", "equals = 3"));
    assert!(
        matches!(&red, MutateError::Red { wrong } if wrong[0].0 == "calc::half equals"),
        "{red}"
    );
    let unreadable = wrong(SHADER, "[[test]]\nfunction = \"gone\"\nfinite = true\n");
    assert!(matches!(unreadable, MutateError::Red { .. }), "{unreadable}");
    let none = folder(SHADER, TESTS);
    std::fs::remove_file(none.path().join("calc.test.toml")).expect("removed");
    let error = request(none.path()).run(&|_, _, _| {}).expect_err("there is no test");
    assert!(matches!(error, MutateError::NoTest(_)), "{error}");
    let empty = wrong(
        "fn same(x: f32) -> f32 { return x; }\n",
        "[[test]]\nfunction = \"same\"\nfinite = true\n",
    );
    assert!(matches!(empty, MutateError::NoMutant { .. }), "{empty}");
    // Tests with very weak assertions kill no mutant.
    let folder = folder(
        SHADER,
        "[[test]]\nfunction = \"half\"\nover = { x = \"1..2\" }\nin_range = [-100, 100]\n",
    );
    let score = Score::of(&hunted(folder.path()).tried);
    assert_eq!((score.killed, score.percent()), (0, Some(0.0)), "{score:?}");
}

/// A function with `@test` kills mutants, as a declared test does. The test can be in the tested function's module or
/// in another module.
#[test]
fn tests_in_wgsl_kill() {
    let own = "fn sign_of(x: f32) -> i32 { if (x < 0.0) { return -1; } return 1; }\n";
    let test = "@test fn signs() { expect_equal_i32(sign_of(2.0), 1); expect_equal_i32(sign_of(-2.0), -1); }\n";
    let import = "import karat::expect_equal_i32;\n";
    for (shader, other) in [
        (format!("{import}{own}{test}"), String::new()),
        (own.to_owned(), format!("import package::calc::sign_of;\n{import}{test}")),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("calc.wgsl"), shader).expect("written");
        std::fs::write(folder.path().join("calc_test.wgsl"), other).expect("written");
        let hunted = hunted(folder.path());
        let always = &of(&hunted, "sign_of", "(x < 0.0)", "(true)").fate;
        assert!(matches!(always, Fate::Killed { .. }), "{always:?}");
        // The code of a test isn't mutated.
        assert!(hunted.tried.iter().all(|one| one.candidate.mutant.item == "sign_of"));
    }
}

/// Karat sees the values that a test in TOML compares. A test in WGSL compares its values in the shader, where Karat
/// can't see them.
#[test]
fn values_that_no_run_shows_are_not_judged() {
    let shader = "fn f(x: f32) -> f32 { if (x > 3.0) { return x + 7.0; } return x; }\n";
    let declared =
        "[[test]]\nfunction = \"f\"\nover = { x = 2 }\nequals = 2\ntolerance = \"exact\"\n";
    let wgsl = "import package::calc::f;\nimport karat::expect_true;\n@test fn t() { expect_true(f(4.0) > 0.0); }\n";
    for (tests, other, shown) in [(declared, "", true), ("", wgsl, false)] {
        let folder = folder(shader, tests);
        if tests.is_empty() {
            std::fs::remove_file(folder.path().join("calc.test.toml")).expect("the file exists");
            std::fs::write(folder.path().join("calc_test.wgsl"), other).expect("written");
        }
        let hunted = hunted(folder.path());
        let fate = &of(&hunted, "f", "7.0", "14.0").fate;
        assert!(matches!(fate, Fate::Lived { seen, .. } if *seen == shown), "{fate:?}");
    }
}

/// A mutant of a constant also changes the modules that use the constant: a mutant of `N` makes `user` invalid, and a
/// mutant of `FREE` changes `user::free`, which no test uses.
#[test]
fn constants_reach_other_modules() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |file: &str, text: &str| {
        std::fs::write(folder.path().join(file), text).expect("written");
    };
    write(
        "calc.wgsl",
        "const N: u32 = 3u;\nconst FREE = 2.0;\nfn f(x: f32) -> f32 { return x; }\n",
    );
    write(
        "user.wgsl",
        "import package::calc::{N, FREE};\nfn count() -> u32 { var all: array<u32, N>; return arrayLength3(all); }\n\
         fn arrayLength3(all: array<u32, 3>) -> u32 { return all[0] + 3u; }\n\
         fn free(x: f32) -> f32 { return FREE * x; }\n",
    );
    write("user.test.toml", "[[test]]\nfunction = \"count\"\nequals = 3\ntolerance = \"exact\"\n");
    let hunted = hunted(folder.path());
    let invalid = &of(&hunted, "N", "3u", "4u").fate;
    assert!(matches!(invalid, Fate::Invalid { .. }), "{invalid:?}");
    let untested = &of(&hunted, "FREE", "2.0", "4.0").fate;
    let Fate::Untested { why: Lived::Differs(found) } = untested else { panic!("{untested:?}") };
    assert_eq!(found.function, "user::free");
}

/// Lines and columns count characters of the author's text, not bytes. Karat refuses to mutate modules that the program
/// `preprocess` in `karat.toml` prints.
#[test]
fn places_of_mutants_count_characters_of_the_source() {
    let shader = "// \u{e9}\u{1f600}\r\nfn half(x: f32) -> f32 { /* \u{e9} */ return 0.5 * x; }\r\n\
                  fn next(x: f32) -> f32 { loop { continuing { break if x > 1.0; } } return x; }\r\n\
                  fn last(x: f32) -> f32 { return x + 1.0; }\r\n";
    let folder = folder(
        shader,
        "[[test]]\nfunction = \"half\"\nover = { x = 2 }\nequals = 1\ntolerance = \"1 ulp\"\n",
    );
    let hunted = hunted(folder.path());
    let half = of(&hunted, "half", "0.5", "1.0");
    assert_eq!((half.candidate.mutant.line, half.candidate.mutant.column), (2, 41));
    assert!(matches!(half.fate, Fate::Killed { .. }));
    of(&hunted, "next", "x > 1.0", "(true)");
    of(&hunted, "last", "+", "-");
    std::fs::write(folder.path().join("karat.toml"), "preprocess = [\"cat\"]\n").expect("written");
    let error =
        request(folder.path()).run(&|_, _, _| {}).expect_err("a program prints the modules");
    assert!(matches!(error, MutateError::Printed), "{error}");
}

/// A mutant isn't killed if its loop never ends, or if an `@if` removes its code. A mutation of `0u`
/// keeps the suffix `u`, so the mutant is valid WGSL.
// Lesson 29
// Lesson 30
#[test]
fn invalid_idle_and_endless_mutants_are_not_killed() {
    let shader = "fn sum(n: u32) -> f32 {\n    var s = 0.0;\n    for (var i = 0u; i < n; i += 1u) { s += 0.5; }\n    return s;\n}\n\
                  @if(OFF) fn sleeping(x: f32) -> f32 { return x + 1.0; }\n";
    let tests =
        "[[test]]\nfunction = \"sum\"\nover = { n = 4 }\nequals = 2\ntolerance = \"1 ulp\"\n";
    let folder = folder(shader, tests);
    let hunted = hunted(folder.path());
    let fate = |item, original, replacement| &of(&hunted, item, original, replacement).fate;
    assert!(matches!(fate("sum", "0.5", "1.0"), Fate::Killed { .. }));
    let endless = fate("sum", "+=", "=");
    assert!(matches!(endless, Fate::Stopped { .. }), "{endless:?}");
    assert_eq!(*fate("sleeping", "+", "-"), Fate::Idle);
    let invalid = fate("sum", "0u", "1u");
    assert!(!matches!(invalid, Fate::Invalid { .. }), "{invalid:?}");
}

/// An acceptance needs a reason and an existing mutant. Karat complains if a test kills an accepted mutant.
// Lesson 30
#[test]
fn an_accepted_mutant_must_exist_and_have_a_reason() {
    let folder = folder(SHADER, TESTS);
    let first = hunted(folder.path());
    let lived = &of(&first, "capped", "max(x * x, -1.0)", "(x * x)").candidate.id;
    let killed = &of(&first, "half", "0.5", "1.0").candidate.id;
    let accept = |ids: &str, reason: &str| {
        let text = format!("[[mutant]]\nids = [{ids}]\nreason = \"{reason}\"\n");
        std::fs::write(folder.path().join("karat.toml"), text).expect("written");
    };
    accept(&format!("\"{lived}\""), "a square is never negative");
    let second = hunted(folder.path());
    let fate = &of(&second, "capped", "max(x * x, -1.0)", "(x * x)").fate;
    assert_eq!(*fate, Fate::Accepted { reason: "a square is never negative".to_owned() });
    assert!(second.complaints.is_empty());
    let [before, after] = [&first, &second].map(|hunted| Score::of(&hunted.tried));
    assert_eq!((after.accepted, after.lived), (1, before.lived - 1));
    accept(&format!("\"{lived}\", \"{killed}\""), "both");
    let complaints = hunted(folder.path()).complaints;
    assert!(
        complaints.len() == 1 && complaints[0].contains("`calc::half equals` kills the mutant"),
        "{complaints:?}"
    );
    let wrong = |ids: String, reason: &str| {
        accept(&ids, reason);
        request(folder.path()).run(&|_, _, _| {}).expect_err("the acceptance is wrong").to_string()
    };
    assert!(
        wrong("\"00000000\"".to_owned(), "why").contains("the package has no mutant with this id")
    );
    assert!(wrong(String::new(), "why").contains("needs the key `ids`"));
    assert!(wrong(format!("\"{lived}\""), " ").contains("without a reason"));
    assert!(wrong(format!("\"{lived}\", \"{lived}\""), "why").contains("twice"));
}

/// The sample depends on the seed, not on the position of the lines. Edits of other lines change no id.
#[test]
fn unrelated_edits_keep_ids_and_samples_of_mutants() {
    let ids = |shader: &str, seed: Option<u64>| -> Vec<String> {
        let folder = folder(shader, TESTS);
        let request = request(folder.path());
        let request = match seed {
            Some(seed) => request.sample(4, seed),
            None => request,
        };
        let (all, of) = request.mutants().expect("the package opens");
        assert!(of > all.len() || seed.is_none());
        all.into_iter().map(|one| one.id).collect()
    };
    let moved = format!("// A line more.\n\n{SHADER}");
    assert_eq!(ids(SHADER, None), ids(&moved, None));
    assert_eq!(ids(SHADER, Some(7)), ids(&moved, Some(7)));
    assert_ne!(ids(SHADER, Some(7)), ids(SHADER, Some(8)));
    assert_eq!(ids(SHADER, Some(7)).len(), 4);
    let mut all = ids(SHADER, None);
    all.sort();
    all.dedup();
    assert_eq!(all.len(), ids(SHADER, None).len(), "all ids differ");
}
