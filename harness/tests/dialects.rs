//! Modules as game engines write them: conditions, directives of `naga_oil`, files that include other files, and
//! directives of preprocessors that Karat doesn't support.

use insta::assert_snapshot;
use karat::package::Feature;
use karat::prelude::*;
use karat::unstable::probe::Probed;

fn linked(package: &Package, function: &str) -> String {
    match Probed::new(package, function) {
        Ok(probed) => probed.kernel().to_owned(),
        Err(error) => panic!("{error}"),
    }
}

fn error(package: &Package, function: &str) -> String {
    match Probed::new(package, function) {
        Ok(probed) => panic!("`{function}` was linked:\n{}", probed.kernel()),
        Err(error) => error.to_string(),
    }
}

/// The text of the function `f`, without blank lines and trailing blanks.
fn f(package: &Package) -> String {
    let kernel = linked(package, "f");
    let lines = kernel.lines().map(str::trim_end).filter(|line| !line.trim().is_empty());
    lines.take_while(|line| !line.starts_with("@group(0)")).collect::<Vec<_>>().join("\n")
}

fn one(text: &str) -> Package {
    Package::from_source("s", text)
}

const OIL: [(&str, &str); 6] = [
    (
        "math",
        "#define_import_path engine::math\n\nconst PI: f32 = 3.14159265;\n\
         #ifdef TWICE\nfn scaled(x: f32) -> f32 { return 2.0 * x; }\n\
         #else\nfn scaled(x: f32) -> f32 { return x; }\n#endif\n",
    ),
    (
        "render/lights",
        "#define_import_path engine::lights\n\n#import engine::{\n    math::{PI, scaled as s}, // both\n    \
         math,\n}\n\nstruct Light { intensity: f32 }\n\n\
         fn flux(light: Light) -> f32 { return 4.0 * PI * s(light.intensity); }\n\
         fn half(x: f32) -> f32 { return math::scaled(x) / 2.0; }\n\
         fn whole(x: f32) -> f32 { return engine::math::scaled(x); }\n",
    ),
    (
        "bound",
        "#import engine::math::PI\n#import engine::lights as l\n\
         @group(#{GROUP}) @binding(1) var<uniform> gain: f32;\n\
         fn amplified(x: f32) -> f32 { return gain * l::half(x) * f32(#{GROUP}) * PI; }\n",
    ),
    ("tool", "#define_import_path tool\nfn third(x: f32) -> f32 { return x / 3.0; }\n"),
    (
        "user",
        "#import tool as t\nfn g(x: f32) -> f32 { return t::third(x); }\n#import tool\nfn f(x: f32) -> f32 { return tool::third(x); }\n",
    ),
    ("slip", "#import engine::maths::PI\nfn f(x: f32) -> f32 { return PI * x; }\n"),
];

fn oil() -> Package {
    let name = |name: &str| name.replace('/', "::");
    Package::from_modules("engine", OIL.map(|(module, text)| (name(module), text)))
}

// Lesson 34
#[test]
fn modules_of_naga_oil_import_by_the_paths_that_they_give_themselves() {
    let reference = |x: f64| std::f64::consts::PI * 4.0 * x;
    let domain = || (0.0..=10.0).map(|intensity: f32| Light { intensity });
    let flux = |package: &Package, factor: f64| {
        let of = |light: LightMirror| factor * reference(light.intensity);
        package.function("render::lights::flux").over(domain()).agrees_with(of, Ulp(4.0));
    };
    flux(&oil(), 1.0);
    flux(&oil().feature("TWICE", true), 2.0);
    let half = oil();
    half.function("render::lights::half").over(0.0..=1.0).agrees_with(|x: f64| x / 2.0, Ulp(1.0));
    half.function("user::g").over(0.0..=1.0).agrees_with(|x: f64| x / 3.0, Ulp(2.5));
    half.function("user::f").over(0.0..=1.0).agrees_with(|x: f64| x / 3.0, Ulp(2.5));
    half.function("render::lights::whole").over(0.0..=1.0).agrees_with(|x: f64| x, Ulp(0.0));
}

karat::shareable! {
    struct Light mirrors LightMirror { intensity: f32 }
}

#[test]
fn placeholders_are_replaced_by_their_values() {
    let package = oil().feature("GROUP", 3);
    let text = linked(&package, "bound::amplified");
    assert!(text.contains("@group(3) @binding(1) var<uniform> gain: f32;"), "{text}");
    assert!(text.contains("f32(3) * "), "{text}");
    assert_snapshot!(error(&oil(), "bound::amplified"), @r#"
    error: feature `GROUP` has no value
      --> <bound>:3:8
      |
    3 | @group(#{GROUP}) @binding(1) var<uniform> gain: f32;
      |        ^^^^^^^^
      |
      = set the value: `.feature("GROUP", 3)` in Rust, or `--feature GROUP=3`
    "#);
}

/// The error about a feature without a value names all such features, so that the author can set all values at once.
#[test]
fn all_missing_values_are_named_at_once() {
    let package = |features: &str| {
        Package::from_modules(
            "m",
            [
                (
                    "a",
                    format!(
                        "#define_import_path a\n{features}#if LIGHTS > 2\n#endif\nfn f() -> f32 {{ return #{{COUNT}}.0; }}\n"
                    ),
                ),
                ("b", "#define_import_path b\n#if FAST == true\n#endif\nfn g() {}\n".to_owned()),
            ],
        )
    };
    let told = error(&package(""), "a::f");
    assert!(told.contains("`LIGHTS` has no value"), "{told}");
    assert!(told.contains("features = { COUNT = 4, FAST = true, LIGHTS = 2 }"), "{told}");
    let set = |all: &Package| all.feature("LIGHTS", 2).feature("FAST", true);
    let told = error(&set(&package("")), "a::f");
    assert!(told.contains("`COUNT` has no value") && !told.contains("features = "), "{told}");
    assert!(!error(&package("#define COUNT 3\n#define LIGHTS 1\n"), "b::g").contains("COUNT"));
}

/// Messages have the lines of the author's file, although Karat removes the directives above these lines.
#[test]
fn places_are_those_of_the_authors_file() {
    let package = oil().feature("GROUP", 12_345_678);
    let place = |function: &str| {
        let probed = Probed::new(&package, function).expect("linked");
        probed.function().span.to_string()
    };
    assert_eq!(place("math::scaled"), "<math>:7:1");
    assert_eq!(place("render::lights::half"), "<render::lights>:11:1");
    assert_eq!(place("bound::amplified"), "<bound>:4:1");
    let wrong =
        "#ifdef A\n#endif\n#if B == 2\n#endif\nfn f(x: f32) -> f32 { return f32(#{B}) + y; }\n";
    assert_snapshot!(error(&one(wrong).feature("B", 7), "f"), @r#"
    error: no definition in scope for identifier: `y`
      --> <s>:5:42
      |
    5 | fn f(x: f32) -> f32 { return f32(#{B}) + y; }
      |                                          ^ unknown identifier
    "#);
}

#[test]
fn conditions_choose_lines() {
    let text = "#ifdef A\nfn f() -> i32 { return 1; }\n#else ifdef B\nfn f() -> i32 { return 2; }\n\
                #else if C >= 3\nfn f() -> i32 { return 3; }\n#else\nfn f() -> i32 {\n#ifndef D\n    \
                return 4;\n#else\n    return 5;\n#endif\n}\n#endif\n";
    let value = |features: &[(&str, Feature)]| {
        let package = features.iter().fold(one(text), |p, (name, value)| p.feature(name, *value));
        let text = f(&package);
        let at = text.find("return ").expect("it returns") + 7;
        text[at..at + 1].parse::<u32>().expect("a digit")
    };
    let (on, off) = (Feature::Flag(true), Feature::Flag(false));
    let unset = error(&one(text), "f");
    assert!(unset.contains("`C` has no value"), "{unset}");
    let four = Feature::Number(2);
    assert_eq!(value(&[("C", four)]), 4);
    assert_eq!(value(&[("A", on)]), 1);
    assert_eq!(value(&[("A", on), ("B", on)]), 1);
    assert_eq!(value(&[("A", off), ("B", on)]), 2);
    assert_eq!(value(&[("C", Feature::Number(3))]), 3);
    assert_eq!(value(&[("C", four), ("D", on)]), 5);
    let operators = "fn f() -> i32 {\n#if N == 2\nreturn 1;\n#endif\n#if N != 3\nreturn 2;\n#endif\n\
                     #if N < 3\nreturn 3;\n#endif\n#if N <= 3\nreturn 4;\n#endif\n#if N > 4\n\
                     return 5;\n#endif\nreturn 6;\n}\n";
    for (n, expected) in [(1, 2), (2, 1), (3, 4), (4, 2), (5, 2)] {
        let text = f(&one(operators).feature("N", n));
        let at = text.find("return ").expect("it returns") + 7;
        assert_eq!(text[at..at + 1], expected.to_string(), "{n}: {text}");
    }
    // The order of the definitions doesn't matter.
    for text in [
        "#define N 3\n#ifdef N\nfn f() -> i32 { return #{N}; }\n#endif\n",
        "# ifdef N\nfn f() -> i32 { return #{N}; }\n#endif\n#define N 3\n",
        "#ifdef NO\n#define N 3u\n#endif\n#ifdef N\nfn f() -> i32 { return #{N}; }\n#endif\n",
    ] {
        assert!(f(&one(text)).contains("return 3;"), "{text}");
    }
    // A definition replaces a feature, as in naga_oil.
    assert!(f(&one("#define N 3\nfn f() -> i32 { return #{N}; }").feature("N", 4)).contains("3;"));
    // Conditions in comments are ignored.
    assert!(f(&one("/*\n#ifdef A\n*/\nfn f() -> i32 { return 1; }\n// #endif\n")).contains("1;"));
}

#[test]
fn conditions_that_cannot_be_read_are_errors() {
    for (text, message) in [
        ("#ifdef A\nfn f() {}\n", "this condition has no `#endif`"),
        ("#endif\nfn f() {}\n", "there is no `#if` before this `#endif`"),
        ("#else\nfn f() {}\n", "there is no `#if` before this `#else`"),
        ("#ifdef\n#endif\nfn f() {}\n", "`#ifdef` needs exactly one feature"),
        ("#ifdef A B\n#endif\nfn f() {}\n", "`#ifdef` needs exactly one feature"),
        ("#if A\n#endif\nfn f() {}\n", "must compare a feature with a value"),
        ("#if A == x\n#endif\nfn f() {}\n", "a value must be a whole number"),
        ("#if A == 1\n#endif\nfn f() {}\n", "`A` has no value"),
        (
            "#define A\n#if A >= 1\n#endif\nfn f() {}\n",
            "`A` is true, which doesn't allow the comparison `>= 1`",
        ),
        (
            "#define A 1\n#if A == true\n#endif\nfn f() {}\n",
            "`A` is 1, which doesn't allow the comparison `== true`",
        ),
        (
            "#define A\n#if A < true\n#endif\nfn f() {}\n",
            "`A` is true, which doesn't allow the comparison `< true`",
        ),
        ("#define A x\nfn f() {}\n", "a value must be a whole number"),
        (
            "#define_import_path a\n#define A\nfn f() {}\n",
            "a module with `#define_import_path` can't",
        ),
        (
            "#define_import_path a\n#define_import_path b\nfn f() {}\n",
            "a second `#define_import_path`",
        ),
        ("#define_import_path a b\nfn f() {}\n", "`#define_import_path` needs a path"),
        ("#define_import_path\nfn f() {}\n", "`#define_import_path` needs a path"),
        ("#ifdef A\n#else\n#else\n#endif\nfn f() {}\n", "a second `#else`"),
        ("#ifdef A\n#else\n#else ifdef B\n#endif\nfn f() {}\n", "a second `#else`"),
        ("/* a */ #ifdef A\n#endif\nfn f() {}\n", "a directive must be the first text on its line"),
        ("#if A =< 3\n#endif\nfn f() {}\n", "must compare a feature with a value"),
        ("#ifdef A\n#else maybe\n#endif\nfn f() {}\n", "can follow an `#else`"),
        ("fn f() -> i32 { return #{N; }\n", "has no value"),
    ] {
        let said = error(&one(text), "f");
        assert!(said.contains(message), "{text}: {said}");
    }
}

/// Imports may contain comments, conditions and line ends wherever `naga_oil` allows them.
#[test]
fn imports_end_where_their_lines_or_braces_do() {
    let text = "#import engine::math::PI// both\r\n#import engine::math::{ // several\r\n    scaled,\r\n\
                #ifdef NEVER\r\n    nothing,\r\n#endif\r\n    } // so\r\n#ifdef NEVER\r\n\
                #import engine::nothing::{\r\n    at_all,\r\n}\r\n#endif\r\n#import engine::lights as l;\r\n\
                // #import engine::none\r\n/*\r\n#import engine::none\r\n*/\r\n\
                fn f(x: f32) -> f32 { return PI * scaled(l::half(x)); }";
    let modules = OIL.into_iter().take(2).chain([("user", text)]);
    let modules = modules.map(|(name, text)| (name.replace('/', "::"), text));
    let package = Package::from_modules("engine", modules);
    let probed = Probed::new(&package, "user::f").expect("linked");
    assert_eq!(probed.function().span.to_string(), "<user>:18:1");
    let check = package.function("user::f").over(0.0..=1.0);
    check.agrees_with(|x: f64| std::f64::consts::PI * x / 2.0, Ulp(3.0));
}

/// A `#define` in the linked module also applies to the modules that this module imports or includes.
#[test]
fn definitions_reach_what_is_imported() {
    let lib = "#define_import_path lib\n#ifdef FULL\nfn v(x: f32) -> f32 { return x; }\n#else\n\
               fn v(x: f32) -> f32 { return -x; }\n#endif\n";
    let part = lib.replace("#define_import_path lib\n", "");
    let f = |first: &str| format!("{first}\nfn f(x: f32) -> f32 {{ return v(x); }}\n");
    let package = Package::from_modules(
        "m",
        [
            ("lib", lib.to_owned()),
            ("part.inc", part),
            ("full", f("#define FULL\n#import lib::v")),
            ("plain", f("#import lib::v")),
            ("pasted", f("#define FULL\n#include \"part.inc.wgsl\"")),
            ("defines", "#define FULL\nfn v(x: f32) -> f32 { return x; }".to_owned()),
            ("wrong", f("#include \"defines.wgsl\"")),
            ("outside", f("#include \"../../part.inc.wgsl\"")),
        ],
    );
    let sign = |module: &str, sign: f64| {
        let check = package.function(&format!("{module}::f")).over(0.5..=1.0);
        check.agrees_with(|x: f64| sign * x, Ulp(0.0));
    };
    sign("full", 1.0);
    sign("pasted", 1.0);
    sign("plain", -1.0);
    let wrong = error(&package, "wrong::f");
    assert!(wrong.contains("this file has a `#define`"), "{wrong}");
    let outside = error(&package, "outside::f");
    assert!(outside.contains("the path of this file leads out of package `m`"), "{outside}");
}

#[test]
fn names_that_two_files_give_are_errors() {
    let two = |second: &'static str| {
        let text = "#define_import_path a::b\nfn g(x: f32) -> f32 { return x; }\n";
        let user = "#import a::b::g\nfn f(x: f32) -> f32 { return g(x); }\n";
        Package::from_modules("m", [("one", text), ("two", second), ("user", user)])
    };
    let twice = two("#define_import_path a::b\nfn g(x: f32) -> f32 { return 2.0 * x; }\n");
    assert_snapshot!(error(&twice, "user::f"), @r#"
    error: unresolved import of `a::b::g`
      --> <user>:1:15
      |
    1 | #import a::b::g
      |               ^ imported here
      |
      = modules `package::one` and `package::two` both declare `#define_import_path a::b`: give one module another path
    "#);
    linked(&two("#define_import_path a::c\n"), "user::f");
    let shared = |first: &'static str| {
        let user = "#import one\n#import two\nfn f(x: f32) -> f32 { return g(x); }\n";
        let two = "fn g(x: f32) -> f32 { return 2.0 * x; }\n";
        Package::from_modules("m", [("one", first), ("two", two), ("user", user)])
    };
    assert_snapshot!(error(&shared("const A = 1.0; const g = 2.0;"), "user::f"), @r#"
    error: `g` is declared in two files that are included or joined together
      --> <two>:1:4
      |
    1 | fn g(x: f32) -> f32 { return 2.0 * x; }
      |    ^
      |
      --> <one>:1:22
      |
    1 | const A = 1.0; const g = 2.0;
      |                      - declared first
    "#);
    linked(&shared("#import two\nconst A = 1.0;"), "user::f");
    let user = "#import x\nfn f(x: f32) -> f32 { return x; }\n";
    let several =
        Package::from_modules("m", [("a::x", "const A = 1;"), ("b::x", ""), ("user", user)]);
    assert_snapshot!(error(&several, "user::f"), @r#"
    error: two modules match `x`: `a::x` and `b::x`
      --> <user>:1:1
      |
    1 | #import x
      | ^^^^^^^^^ included here
    "#);
}

#[test]
fn a_value_stands_for_a_number_with_its_suffix_and_for_no_part_of_a_name() {
    let text = "const u = 7u;\nfn f() -> u32 { return #{N}u + u; }\n";
    let text = f(&one(text).feature("N", 3));
    assert!(text.contains("return 3u + u;"), "{text}");
    let negative = f(&one("fn f() -> i32 { return 1 - #{N}; }").feature("N", -3));
    assert!(negative.contains("return 1 - -3;"), "{negative}");
    for text in [
        "fn f#{N}() -> u32 { return 1u; }\nfn f() -> u32 { return 1u; }",
        "fn f() -> u32 { return #{N}xy; }",
    ] {
        let said = error(&one(text).feature("N", 3), "f");
        assert!(said.contains("a feature's value can't be a part of a name"), "{said}");
    }
}

/// In Vello, `re_renderer` and blade, an included file shares the names of the file that includes it.
#[test]
fn included_files_share_one_name_space() {
    let package = Package::from_modules(
        "vello",
        [
            (
                "shader::fine",
                "#import shared\n#ifdef full\n#import more\n#endif\n\
              @group(0) @binding(0) var<uniform> config: u32;\n\
              fn area(h: u32) -> u32 { return scaled(h) * TWO; }\n",
            ),
            (
                "shader::shared::shared",
                "#import consts\nfn scaled(x: u32) -> u32 { return x * config; }\n",
            ),
            ("shader::shared::consts", "const TWO = 2u;\n"),
            ("shader::shared::more", "const MORE = 1u;\n"),
            (
                "shader::plane",
                "#import <./utils/quad.wgsl>\n#include \"../shader/utils/line.inc.wgsl\"\n\
              fn both(x: f32) -> f32 { return quad() + line() + x; }\n",
            ),
            ("shader::utils::quad", "fn quad() -> f32 { return 4.0; }\n"),
            ("shader::utils::line.inc", "fn line() -> f32 { return 2.0; }\n"),
        ],
    );
    let uniform = Uniform::new(3_u32);
    let check = package.function("shader::fine::area").with("config", uniform);
    check.over(Integers(0..=9_u32)).agrees_with(|h: u32| 6 * h, Ulp(0.0));
    package.function("shader::plane::both").over(0.0..=1.0).agrees_with(|x: f64| 6.0 + x, Ulp(1.0));
    let slip = Package::from_modules(
        "m",
        [("a", "#import shard\nfn f() -> f32 { return 1.0; }"), ("shared", "const A = 1;")],
    );
    assert_snapshot!(error(&slip, "a::f"), @r#"
    error: there is no module `shard` to include
      --> <a>:1:1
      |
    1 | #import shard
      | ^^^^^^^^^^^^^
      |
      = did you mean `shared`?
    "#);
}

/// Bevy's WESL imports the values of features as constants from the module `constants`, which has no file.
// Lesson 34
#[test]
fn values_of_features_are_constants() {
    let text = "import constants::COUNT;\n@group(constants::GROUP) @binding(0) var<uniform> x: f32;\n\
                fn f(y: f32) -> f32 { return y + x * f32(COUNT); }\n";
    let package = one(text).feature("COUNT", 4).feature("GROUP", 2);
    let check = package.function("f").with("x", Uniform::new(1.5_f32));
    check.over(0.0..=1.0).agrees_with(|x: f64| 6.0 + x, Ulp(1.0));
    assert_snapshot!(error(&one(text).feature("COUNT", 4), "f"), @r#"
    error: module `constants` has no declaration `GROUP`
      --> <s>:2:19
      |
    2 | @group(constants::GROUP) @binding(0) var<uniform> x: f32;
      |                   ^^^^^
      |
      = to set the feature `GROUP`, write `.feature("GROUP", 3)` in Rust, or `--feature GROUP=3`
    "#);
}

/// Each name in a condition counts as a feature: inside brackets, and on both sides of an operator.
#[test]
fn each_name_in_a_condition_is_a_feature() {
    let texts = [
        "@if((A || !(B)) && C) fn g() {}\n@elif(D) fn g() {}\nfn f() -> f32 { return 1.0; }",
        "#ifdef A\n# ifndef B\n#else if C >= 3\n#else ifdef D\n#endif\n#endif\nfn f() -> f32 { return 1.0; }",
    ];
    for text in texts {
        for name in ["A", "B", "C", "D"] {
            linked(&one(text).feature("C", 3).feature(name, if name == "C" { 3 } else { 1 }), "f");
        }
        error(&one(text).feature("g", true), "f");
        error(&one(text).feature("endif", true), "f");
    }
}

/// An include guard tests a name before the guard defines it. The text inside the guard is the module.
// Lesson 189
#[test]
fn an_include_guard_is_read() {
    let guard = |text: &str| format!("#ifndef G\n#define G\n{text}#endif\n");
    let twice = "fn twice(x: f32) -> f32 { return 2.0 * x; }\n";
    let package =
        Package::from_modules("m", [("a", guard(twice)), ("b", "fn ok() {}\n".to_owned())]);
    package.function("a::twice").over(0.0..=1.0).agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    let wrong = Package::from_modules("m", [("a", guard(&twice.replace("2.0", "nonsense")))]);
    let invalid = wrong.try_is_valid().expect_err("an unknown name").to_string();
    assert!(invalid.contains("<a>:3:34"), "{invalid}");
    // If the author sets the guard's name, the module's text is left out, and a message says so.
    let left_out = error(&package.feature("G", true), "a::twice");
    assert!(left_out.contains("is declared under `#ifndef G`"), "{left_out}");
    // Tests inside the guard run, too.
    let test = "import karat::expect_near;\n@test fn t() { expect_near(twice(1.0), 2.0, 0.0); }\n";
    let test = Package::from_source("m", guard(&format!("{test}{twice}")));
    assert_eq!(test.try_is_valid().expect("valid").tests, 1);
    // A default value, which an author or an importing module may replace.
    let default = "#ifndef N\n#define N 3\n#endif\nfn f() -> i32 { return #{N}; }\n";
    assert!(f(&one(default)).contains("return 3;"));
    assert!(f(&one(default).feature("N", 4)).contains("return 4;"));
    let part = "#define_import_path part\n#ifdef N\nfn g() -> i32 { return #{N}; }\n#endif\n";
    let user = default.replace("return #{N}", "return part::g()");
    let both =
        Package::from_modules("m", [("part", part), ("user", &format!("#import part\n{user}"))]);
    assert!(linked(&both, "user::f").contains("return 3;"));
    // Two files may use the same name in their guards, also if one includes the other.
    let files = [
        ("part", guard(twice)),
        ("user", guard("#include \"part.wgsl\"\nfn f(x: f32) -> f32 { return twice(x); }\n")),
    ];
    linked(&Package::from_modules("m", files), "user::f");
}

/// A misspelt feature would change nothing in the shader, so it is an error.
// Lesson 35
#[test]
fn a_feature_that_nothing_asks_about_is_an_error() {
    let wesl = "@if(MULTISAMPLED && !FAST) fn g() {}\nfn f() -> f32 { return 1.0; }";
    assert_snapshot!(error(&one(wesl).feature("MULTISAMPLD", true), "f"), @"no condition in package `s` or in its imports uses the feature `MULTISAMPLD`; did you mean `MULTISAMPLED`?; the package's conditions use FAST, MULTISAMPLED");
    let oil =
        "#ifdef MULTISAMPLED\n#else if SAMPLES > 2\n#endif\nfn f() -> i32 { return #{COUNT}; }";
    // `A` occurs only outside conditions.
    assert_snapshot!(error(&one(oil).feature("SAMPLE", 2), "f"), @"no condition in package `s` or in its imports uses the feature `SAMPLE`; did you mean `SAMPLES`?; the package's conditions use COUNT, MULTISAMPLED, SAMPLES");
    let commented = "// of A\n@if(B) fn A() {}\nfn f() -> f32 { return 1.0; }";
    for word in ["A", "of", "return", "1"] {
        let said = error(&one(commented).feature(word, true), "f");
        assert!(said.contains("conditions use B"), "{said}");
    }
    assert_snapshot!(error(&one("fn f() -> f32 { return 1.0; }").feature("A", true), "f"), @"no condition in package `s` or in its imports uses the feature `A`");
}

/// If Karat doesn't support a directive's preprocessor, the error shows the directive and says what to do.
// Lesson 36
#[test]
fn other_preprocessors_are_named() {
    let said = error(&one("fn f() -> f32 { return f32(#RADIUS); }"), "f");
    assert!(
        said.contains(
            "= write a line `RADIUS = 3` below `[features]` in karat.toml to set the value"
        ),
        "{said}"
    );
    assert_snapshot!(error(&one("#use Mode::Fast\nfn f() -> f32 { return 1.0; }"), "f"), @r#"
    error: `#use` isn't WGSL: a preprocessor must expand it
      --> <s>:1:1
      |
    1 | #use Mode::Fast
      | ^^^^^^^^^^^^^^^
      |
      = to expand the text, write a `preprocess` command into karat.toml beside the modules, or use `Package::from_modules` in Rust
    "#);
    assert_snapshot!(error(&one("#ifdeff A\nfn f() -> f32 { return 1.0; }"), "f"), @r#"
    error: `#ifdeff` isn't WGSL: a preprocessor must expand it
      --> <s>:1:1
      |
    1 | #ifdeff A
      | ^^^^^^^^^
      |
      = did you mean `#ifdef`?
      = to expand the text, write a `preprocess` command into karat.toml beside the modules, or use `Package::from_modules` in Rust
    "#);
    assert_snapshot!(error(&one("#import \"shaders/a.wgsl\" as a\nfn f() -> f32 { return 1.0; }"), "f"), @r#"
    error: an import by an asset's path isn't WGSL: the asset server of a game engine must expand it
      --> <s>:1:1
      |
    1 | #import "shaders/a.wgsl" as a
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      |
      = to expand the text, write a `preprocess` command into karat.toml beside the modules, or use `Package::from_modules` in Rust
    "#);
    assert_snapshot!(error(&one("fn f() -> f32 {\n    return {{ value }};\n}"), "f"), @r#"
    error: a template's placeholder isn't WGSL: a template engine must expand it
      --> <s>:2:12
      |
    2 |     return {{ value }};
      |            ^^
      |
      = to expand the text, write `[values]` with a line `value = 64`, or a `preprocess` command into karat.toml beside the modules, or use `Package::from_modules` in Rust
    "#);
    assert_snapshot!(error(&one("{% if fast %}\nfn f() -> f32 { return 1.0; }\n{% endif %}"), "f"), @r#"
    error: a template's placeholder isn't WGSL: a template engine must expand it
      --> <s>:1:1
      |
    1 | {% if fast %}
      | ^^
      |
      = to expand the text, write a `preprocess` command into karat.toml beside the modules, or use `Package::from_modules` in Rust
    "#);
    // `{{` also occurs in WGSL: a block inside a block.
    assert!(f(&one("fn f() -> f32 {{ return 1.0; }}")).contains("{{ return 1.0; }}"));
}

#[test]
fn a_name_that_no_module_gives_itself_is_an_error() {
    assert_snapshot!(error(&oil(), "slip::f"), @r#"
    error: unresolved import of `engine::maths::PI`
      --> <slip>:1:24
      |
    1 | #import engine::maths::PI
      |                        ^^ imported here
      |
      = no module declares `#define_import_path engine::maths`; did you mean `engine::math`?
    "#);
}

/// A condition between an `if` and its `else` is an error, because it would cut a statement in two.
#[test]
fn a_condition_before_an_else_is_an_error() {
    let text = "fn f(x: f32) -> f32 {\n    var y = 0.0;\n    if x > 1.0 { y = 1.0; } @if(q) else { y = 2.0; }\n    \
                y += 10.0;\n    return y;\n}\n";
    let said = error(&one(text), "f");
    assert!(said.contains("a condition can't be between an `if` and its `else`"), "{said}");
}

#[test]
fn a_byte_order_mark_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("a.wgsl"), "\u{feff}fn f() -> f32 { return 1.0; }")
        .expect("written");
    let said = error(&Package::open(folder.path()).expect("a folder"), "a::f");
    assert!(said.contains("begins with a byte order mark"), "{said}");
}

/// A `karat.toml` in a subfolder of a package is an error, because Karat would read it only if the subfolder itself was
/// the package.
#[test]
fn karat_toml_below_the_package_is_an_error() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(folder.path().join("sub")).expect("a folder");
    std::fs::write(folder.path().join("sub/a.wgsl"), "fn f() -> f32 { return 1.0; }")
        .expect("written");
    std::fs::write(folder.path().join("sub/karat.toml"), "").expect("written");
    let error =
        Package::open(folder.path()).expect("a folder").modules().expect_err("it isn't read");
    assert!(
        error.to_string().contains("Karat reads only the karat.toml in the package's own folder"),
        "{error}"
    );
}

/// `karat.toml` names a program that preprocesses the folder's modules, and sets the folder's features.
// Lesson 36
#[test]
#[cfg(unix)]
fn karat_toml_says_what_expands_modules() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("written");
    };
    let package = || Package::open(folder.path()).expect("a folder");
    let said = |function: &str| {
        let path = folder.path().display().to_string();
        let canonical = folder.path().canonicalize().expect("it is there").display().to_string();
        let error = error(&package(), function);
        error.replace(&canonical, "shaders").replace(&path, "shaders")
    };
    write(
        "a.wgsl",
        "fn f(x: f32) -> f32 { return $(VALUE) + x; }\n@if(fast) fn g(x: f32) -> f32 { return 1.0 + x; }\n",
    );
    assert!(said("a::f").contains("no token `$`"), "{}", said("a::f"));
    write("karat.toml", "preprocess = [\"sed\", \"s/$(VALUE)/2.5/\"]\n[features]\nfast = true\n");
    package().function("a::f").over(0.0..=1.0).agrees_with(|x: f64| 2.5 + x, Ulp(1.0));
    package().function("a::g").over(0.0..=1.0).agrees_with(|x: f64| 1.0 + x, Ulp(1.0));
    write("karat.toml", "preprocess = [\"sed\", \"nonsense\"]\n");
    write("a.wgsl", "fn f() -> f32 { return $(OTHER); }\n");
    let failed = said("a::f");
    assert!(
        failed.starts_with("`sed`, the `preprocess` program of karat.toml, fails for"),
        "{failed}"
    );
    for (text, message) in [
        ("preprocess = []\n", "`shaders/karat.toml` can't be used: `preprocess` is an empty list"),
        ("preproces = [\"a\"]\n", "unknown field `preproces`"),
        (
            "[features]\nfast = \"yes\"\n",
            "feature `fast` must be a whole number, `true` or `false`",
        ),
        ("preprocess = [\"yes\"]\n", "the program prints more than 16 MiB"),
        ("preprocess = [\"sh\", \"-c\", \"echo 'fn f() {}'; exit 3\"]\n", "exit status: 3: cd "),
        ("preprocess = [\"false\"]\n", "exit status: 1: cd "),
        ("preprocess = [\"true\"]\n", "the program prints nothing"),
        ("preprocess = [\"no-such-program-here\"]\n", "the program can't be started"),
        ("[features]\nfst = true\n", "uses the feature `fst`"),
    ] {
        write("karat.toml", text);
        write("a.wgsl", &format!("fn f() -> f32 {{ return 1.0; }} // {}\n", text.len()));
        let error = said("a::f");
        assert!(error.contains(message), "{text}: {error}");
    }
}

/// Texts that a host program joins see each other's names. If a name is missing, the error says which module declares
/// the name. Values in `karat.toml` don't replace a name that a module declares.
#[test]
fn files_that_the_host_concatenates_share_their_names() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("written");
    };
    write(
        "light.wgsl",
        "struct Light { gain: f32 }\nfn lit(x: f32, l: Light) -> f32 { return x * l.gain; }\n",
    );
    write("tone.wgsl", "const WHITE = 4.0;\nfn tone(x: f32) -> f32 { return x / WHITE; }\n");
    write("material.wgsl", "fn shade(x: f32) -> f32 { return tone(lit(x, Light(2.0))); }\n");
    let package = || Package::open(folder.path()).expect("a folder");
    let said = error(&package(), "material::shade");
    assert!(said.contains("material.wgsl:1:34"), "{said}");
    let note = "module `tone` declares `tone`: write `import package::tone::tone;`. Or, if your program concatenates \
                the two modules, write into karat.toml beside the modules:";
    assert!(said.contains(note) && said.contains("[join]\n"), "{said}");
    assert!(said.contains("material = [\"tone\"]"), "{said}");
    // The suggestion keeps the modules that are in the list already.
    write("karat.toml", "[join]\nmaterial = [\"tone\"]\n");
    let said = error(&package(), "material::shade");
    assert!(said.contains("material = [\"tone\", \"light\"]"), "{said}");
    write("karat.toml", "[join]\nmaterial = [\"light\", \"tone\"]\n");
    package().function("material::shade").over(0.0..=1.0).agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
    package().function("tone::tone").over(0.0..=1.0).agrees_with(|x: f64| 0.25 * x, Ulp(1.0));
    // The joined names are also known in modules that import the module, and in its tests.
    write(
        "other.wgsl",
        "import package::material::shade;\nfn twice(x: f32) -> f32 { return 2.0 * shade(x); }\n",
    );
    package().function("other::twice").over(0.0..=1.0).agrees_with(|x: f64| x, Ulp(1.0));
    let invalid = || package().try_is_valid().expect_err("it is declared wrong").to_string();
    write("karat.toml", "[join]\nmaterial = [\"light\", \"tones\"]\n");
    let told = invalid();
    assert!(
        told.contains("`[join]` names `tones`") && told.contains("did you mean `tone`?"),
        "{told}"
    );
    write("karat.toml", "[join]\nmaterials = [\"light\"]\nmaterial = [\"light\", \"tone\"]\n");
    assert!(invalid().contains("`[join]` names `materials`"), "{}", invalid());
    assert!(invalid().contains("karat.toml:2:1)"), "{}", invalid());
    write("karat.toml", "[join]\nmaterial = [\"light\", \"tone\"]\n[values]\nWHITE = 8.0\n");
    package().function("tone::tone").over(0.0..=1.0).agrees_with(|x: f64| 0.25 * x, Ulp(1.0));
    write(
        "light.wgsl",
        "struct Light { gain: f32 }\nfn lit(x: f32, l: Light) -> f32 { return x; }\nfn tone() {}\n",
    );
    write("karat.toml", "[join]\nmaterial = [\"light\", \"tone\"]\n");
    for function in ["material::shade", "other::twice"] {
        let twice = error(&package(), function);
        assert!(
            twice.contains("`tone` is declared in two files that are included or joined together"),
            "{twice}"
        );
    }
}

/// Bevy's modules before 0.20 use this syntax of `naga_oil`: values without braces, a brace after a condition's name,
/// no comma after a group, and unused imports of missing names.
#[test]
fn the_syntax_of_naga_oil_is_accepted() {
    let util = "#define_import_path demo::util\nfn half(x: f32) -> f32 { return 0.5 * x; }\n\
                #ifdef POINT\nfn only_point(x: f32) -> f32 { return x; }\n#endif\n";
    let other = "#define_import_path demo::other\nfn twice(x: f32) -> f32 { return 2.0 * x; }\n";
    let user = "#import demo::{\n    util::{half, only_point}\n    other::{twice}\n}\n\
                #ifdef FAST {\nfn f(x: f32) -> f32 { return half(x); }\n#else {\n\
                fn f(x: f32) -> f32 { return twice(x) * f32(#SLICES); }\n#endif\n";
    let of =
        |user: &str| Package::from_modules("m", [("util", util), ("other", other), ("user", user)]);
    let package = of(user);
    let sliced = || package.feature("SLICES", 4);
    sliced().function("user::f").over(0.0..=1.0).agrees_with(|x: f64| 8.0 * x, Ulp(0.0));
    let fast = sliced().feature("FAST", true);
    fast.function("user::f").over(0.0..=1.0).agrees_with(|x: f64| 0.5 * x, Ulp(0.0));
    let said = error(&package, "user::f");
    assert!(said.contains("`SLICES` has no value") && said.contains("user>:8:"), "{said}");
    let used = of(&user.replace("twice(x) *", "only_point(x) *")).feature("SLICES", 4);
    let said = error(&used, "user::f");
    assert!(
        said.contains("`only_point` is declared under `#ifdef POINT`, which is false here"),
        "{said}"
    );
    // An unused import may be wrong, but a used one may not.
    let slip = user.replace("half, only_point", "half, only_pint");
    let unused = of(&slip).feature("SLICES", 4);
    unused.function("user::f").over(0.0..=1.0).agrees_with(|x: f64| 8.0 * x, Ulp(0.0));
    let slip = slip.replace("twice(x) *", "only_pint(x) *");
    let said = error(&of(&slip).feature("SLICES", 4), "user::f");
    assert!(said.contains("declares no `only_pint`"), "{said}");
}

/// Old shaders of Bevy use this syntax of the first `naga_oil`: imported names after a blank, imports of a name that
/// the module declares itself, and unused imports of missing modules. Two files may also have the same
/// `#define_import_path`, if only one of them declares the imported name.
// Lesson 36
#[test]
fn the_first_import_syntax_of_naga_oil_is_accepted() {
    let util = "#define_import_path demo::util\nfn half(x: f32) -> f32 { return 0.5 * x; }\n\
                fn twice(x: f32) -> f32 { return 2.0 * x; }\n";
    let user = "#import demo::util half, twice as double\n#import demo::gone::nothing\n\
                #import demo::{util::own, dummy::thrice}\nconst own = 7.0;\n\
                fn f(x: f32) -> f32 { return half(x) + double(x) + thrice(x) + own; }\n";
    let [real, empty] = ["fn thrice(x: f32) -> f32 { return 3.0 * x; }\n", ""]
        .map(|text| format!("#define_import_path demo::dummy\n{text}"));
    let of = |user: &str, other: &str| {
        let modules = [("util", util), ("user", user), ("real", &*real), ("other", other)];
        Package::from_modules("m", modules)
    };
    let package = of(user, &empty);
    package.function("user::f").over(0.0..=1.0).agrees_with(|x: f64| 5.5 * x + 7.0, Ulp(4.0));
    // If both files declare the name, or none, that is an error.
    for other in [&real, "#define_import_path demo::dummy\n"] {
        let said = match other == real {
            true => error(&of(user, other), "user::f"),
            false => error(&of(&user.replace("thrice", "frice"), other), "user::f"),
        };
        assert!(said.contains("both declare `#define_import_path demo::dummy`"), "{said}");
    }
    let said = error(&of(&user.replace("half, twice", "half, , twice"), &empty), "user::f");
    assert!(said.contains("this import is malformed"), "{said}");
    let said = error(&of(&user.replace("util half", "util hall"), &empty), "user::f");
    assert!(said.contains("half"), "{said}");
}

/// A module may import from its own package by the package's name, as in Bevy's WESL modules.
#[test]
fn a_package_imports_from_itself_by_its_name() {
    let modules = [
        ("a", "const K = 2.0;\n"),
        ("b", "import demo::a::K;\nfn f(x: f32) -> f32 { return K * x; }\n"),
    ];
    let package = Package::from_modules("demo", modules);
    package.function("b::f").over(0.0..=1.0).agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    let said = error(&Package::from_modules("other", modules), "b::f");
    assert!(said.contains("has no dependency `demo`"), "{said}");
}

/// An include finds a file by the file's path, even if another module has this path as its `#define_import_path`.
#[test]
fn a_file_is_included_beside_a_module_of_its_name() {
    let package = Package::from_modules(
        "m",
        [
            ("other", "#define_import_path part\nfn h(x: f32) -> f32 { return -x; }\n"),
            ("part", "fn g(x: f32) -> f32 { return 2.0 * x; }\n"),
            ("user", "#include \"part.wgsl\"\nfn f(x: f32) -> f32 { return g(x); }\n"),
        ],
    );
    package.function("user::f").over(0.0..=1.0).agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    let imported = Package::from_modules(
        "m",
        [
            ("lib/part", "fn g(x: f32) -> f32 { return 3.0 * x; }\n"),
            ("user", "#import \"lib/part.wgsl\"\nfn f(x: f32) -> f32 { return g(x); }\n"),
        ]
        .map(|(name, text)| (name.replace('/', "::"), text.to_owned())),
    );
    imported.function("user::f").over(0.0..=1.0).agrees_with(|x: f64| 3.0 * x, Ulp(1.0));
}

/// After an edit of `karat.toml`, the same process links the program again.
#[test]
fn karat_toml_is_read_again_when_it_changes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("written");
    };
    write(
        "a.wgsl",
        "@if(fast) fn f(x: f32) -> f32 { return x; }\n@if(!fast) fn f(x: f32) -> f32 { return -x; }\n",
    );
    let package = Package::open(folder.path()).expect("a folder");
    for (text, sign) in
        [("", -1.0), ("[features]\nfast = true\n", 1.0), ("[features]\nfast = false\n", -1.0)]
    {
        write("karat.toml", text);
        package.function("a::f").over(0.5..=1.0).agrees_with(|x: f64| sign * x, Ulp(0.0));
    }
}

/// Conditions may come before statements and before groups of statements. Declarations in a group are visible after the
/// group. A condition inside of an expression or a type is an error.
// Lesson 144
#[test]
fn wesl_conditions_are_allowed_only_where_wesl_allows_them() {
    let text = "@if(A) { const K = 2.0; @if(!A) const L = 1.0; } @else { const K = 3.0; }
struct S { @if(A) a: f32, @else b: f32, c: f32 }
fn h(@if(A) x: f32, @else y: f32, z: f32) -> f32 { @if(A) return x + z; @else return y - z; }
fn f(x: f32) -> f32 {
    @if(A) { let s = K * x; @if(B) { var t = s; t += 1.0; } @else let t = s; } @else { let s = 0.0; let t = K; }
    var sum = s + t;
    switch 1 { @if(A) case 1 { sum += 1.0; } @else default { sum += 2.0; } @if(A) default { } }
    @if(B) for (var i = 0; i < 2; i++) { @if(A) sum += 1.0; }
    loop { @if(A) break; @else { sum += 1.0; break; } @if(A) continuing { break if true; } }
    @if(A) if x > 0.5 { sum += h(1.0, 2.0); } else { @if(B) sum -= 1.0; }
    return sum;
}";
    let at = |features: &[&str], x: f64| {
        let package = features.iter().fold(one(text), |package, name| package.feature(name, true));
        let expected = match features {
            [] => 6.0,
            ["A"] => 4.0 * x + 1.0 + if x > 0.5 { 3.0 } else { 0.0 },
            _ => 4.0 * x + 1.0 + 1.0 + 2.0 + if x > 0.5 { 3.0 } else { -1.0 },
        };
        package.function("f").over(Just(x as f32)).agrees_with(move |_: f64| expected, Ulp(1.0))
    };
    at(&[], 0.0);
    // The arguments of an attribute may end with a comma.
    one("@if(A,) fn f(x: f32) -> f32 { return x; }")
        .feature("A", true)
        .function("f")
        .over(0.0..=1.0)
        .is_finite();
    for x in [0.25, 0.75] {
        at(&["A"], x);
        at(&["A", "B"], x);
    }
    for wrong in [
        "fn f(x: f32) -> f32 { return @if(A) x; }",
        "fn f(x: f32) -> f32 { return max(@if(A) x, 1.0); }",
        "fn f(x: f32) -> f32 { return max(x, @if(A) 1.0); }",
        "fn f(x: f32) -> f32 { var a: @if(A) f32 = x; return a; }",
        "fn f(x: f32) -> f32 { var a: array<f32, @if(A) 4>; return a[0]; }",
        "fn f(x: f32) -> f32 { for (@if(A) var i = 0; i < 2; i++) { } return x; }",
        "fn f(x: f32) -> @if(A) f32 { return x; }",
        "fn f(x: f32) -> f32 { @if(A) ; return x; }",
    ] {
        let said = error(&one(wrong).feature("A", true), "f");
        assert!(
            said.contains("move the condition to the beginning of the statement"),
            "{wrong}: {said}"
        );
    }
}

/// If the author misspells `@if`, the condition's feature seems unused. The error names the misspelt condition, and
/// doesn't call the feature unused.
#[test]
fn a_misspelt_condition_is_shown_beside_its_feature() {
    let text =
        "@iff(fast && !slow) fn g() {}\n@id(3) override fast2: f32;\nfn f() -> f32 { return 1.0; }";
    let said = error(&one(text).feature("fast", true), "f");
    assert!(said.contains("`@iff(fast && !slow)` isn't a condition: write `@if`"), "{said}");
    assert!(!said.contains("[values]"), "{said}");
    let other = error(&one(text).feature("fast2", true), "f");
    assert!(!other.contains("isn't a condition"), "{other}");
}

/// A condition is an error if it would remove half of an `if`, or the comma between two members.
// Lesson 144
#[test]
fn conditions_end_where_they_should() {
    for (wrong, message) in [
        ("fn f(@if(A) x: f32 @else y: f32) -> f32 { return 1.0; }", "a `,` is missing before this"),
        (
            "struct T { @if(A) a: f32 @else b: f32, c: f32 } fn f(t: T) -> f32 { return t.c; }",
            "a `,` is missing before",
        ),
        (
            "struct S { @if(A) { a: f32, } d: f32 } fn f(s: S) -> f32 { return s.d; }",
            "give each member or parameter",
        ),
        (
            "fn f(x: f32) -> f32 { var r = 1.0; @if(A) { if x > 1.0 { r = 2.0; } } else { r = 3.0; } return r; }",
            "an `else` can't follow a group in braces",
        ),
    ] {
        for on in [true, false] {
            let package = one(wrong).feature("A", on);
            let said = error(&package, "f");
            assert!(said.contains(message), "{wrong}: {said}");
        }
    }
    // The attributes of a group are dropped with its braces.
    let group = "fn f(x: f32) -> f32 { @if(A) @diagnostic(off, derivative_uniformity) { let y = 2.0 * x; } return y; }";
    one(group)
        .feature("A", true)
        .function("f")
        .over(0.0..=1.0)
        .agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
}

/// Some game engines replace placeholders such as `{N}` in shaders. Values in `karat.toml` replace the same
/// placeholders.
// Lesson 145
#[test]
fn values_stand_for_placeholders() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("written");
    };
    let package = || Package::open(folder.path()).expect("a folder");
    write(
        "a.wgsl",
        "// {N}\nconst B = BLOCK;\nfn f(x: f32) -> f32 { return {N} * x + {{ M }} + B; }\n",
    );
    let said = error(&package(), "a::f");
    assert!(
        said.contains("a template's placeholder isn't WGSL")
            && said.contains("`[values]` with a line `M = 64`"),
        "{said}"
    );
    write("karat.toml", "[values]\nN = 2.0\nM = \"0.5\"\nBLOCK = 64\n");
    package().function("a::f").over(0.0..=1.0).agrees_with(|x: f64| 2.0 * x + 64.5, Ulp(1.0));
    write("b.wgsl", "fn g(x: f32) -> f32 { return {N} + y; }\n");
    let said = error(&package(), "b::g");
    // The column of `y` in the author's line, which has a placeholder before it.
    assert!(said.contains("b.wgsl:1:36"), "{said}");
    for (text, message) in [
        ("[values]\nN = [1]\n", "the value of `N` must be a string, a number"),
        ("[values]\nN = \"a\\nb\"\n", "the value of `N` must be one line"),
        ("[values]\n\"N M\" = 1\n", "the key `N M` of `[values]` isn't a name"),
        ("[features]\nset_by_engine = \"A\"\n", "`set_by_engine` must list names of features"),
        (
            "[features]\nset_by_engin = [\"A\"]\n",
            "feature `set_by_engin` can't be a list; `set_by_engine`",
        ),
    ] {
        write("karat.toml", text);
        let said = error(&package(), "a::f");
        assert!(said.contains(message), "{text}: {said}");
    }
}

/// One message names all unused features, except those that `karat.toml` sets for the whole folder.
// Lesson 145
#[test]
fn features_that_nothing_asks_about() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("written");
    };
    write("a.wgsl", "@if(FAST) fn g() {}\nfn f(x: f32) -> f32 { return x * f32(BLOCK); }\n");
    let package = || Package::open(folder.path()).expect("a folder");
    let set = package().feature("FASTT", true).feature("BLOCK", 64).feature("ENGINE", true);
    let said = error(&set, "a::f");
    assert!(
        said.contains("uses the features `BLOCK`, `ENGINE`, `FASTT` (did you mean `FAST`?)"),
        "{said}"
    );
    assert!(said.ends_with("[values]\nBLOCK = 64"), "{said}");
    write(
        "karat.toml",
        "[features]\nENGINE = true\nset_by_engine = [\"ENGINE\"]\n[values]\nBLOCK = 64\n",
    );
    package().function("a::f").over(0.0..=1.0).agrees_with(|x: f64| 64.0 * x, Ulp(1.0));
}
