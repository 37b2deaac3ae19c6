//! Programs and arguments that try to break the engine.

use std::fmt::Write as _;

use crate::common::{call, module, program, words};
use karat_engine::{F32, Intervals, Lane, Options, Program, Refusal, Resources, Settings, Stop};

fn refused(source: &str) -> Refusal {
    let (module, info) = module(source);
    Program::function(&module, &info, "f", &Settings::default()).expect_err("it is refused")
}

fn line(source: &str, span: naga::Span) -> u32 {
    span.location(source).line_number
}

#[test]
fn a_loop_without_end_spends_its_fuel() {
    let source = "fn f(x: u32) -> u32 {
        var n = 0u;
        loop {
            if x != 300u && n > x { break; }
            n += 1u;
        }
        return n;
    }";
    let program = program(source, "f");
    let rows: Vec<u32> = (0..1000).collect();
    let options = Options { fuel: 5000, ..Options::default() };
    let stop = program.call::<F32>(1000, &rows, &Resources::new(), &options, &()).unwrap_err();
    let Stop::Fuel { span, case, rounds, own } = stop else { panic!("{stop:?}") };
    assert_eq!((line(source, span), case, rounds), (3, 300, 5000));
    assert!(own > rounds, "one loop went round {own} times");
    // Nested loops use up iterations, too, although each of them ends.
    let nested = "fn f(x: u32) -> u32 {
        var n = 0u;
        for (var i = 0u; i < x; i++) { for (var k = 0u; k < x; k++) { n += 1u; } }
        return n;
    }";
    let nested = crate::common::program(nested, "f");
    let stop = nested.call::<F32>(1, &[100], &Resources::new(), &options, &()).unwrap_err();
    assert!(matches!(stop, Stop::Fuel { own: 40..=101, .. }), "{stop:?}");
    // The other cases need fewer iterations.
    let rows: Vec<u32> = (0..300).collect();
    let found = program.call::<F32>(300, &rows, &Resources::new(), &options, &()).unwrap();
    assert_eq!(found.words()[299], 300);
}

#[test]
fn rows_must_be_whole() {
    let program = program("fn f(x: u32, y: u32) -> u32 { return x + y; }", "f");
    let call = |cases: usize, rows: &[u32]| {
        program.call::<F32>(cases, rows, &Resources::new(), &Options::default(), &())
    };
    let stop = Stop::Rows { found: 3, width: 2, cases: 2 };
    assert_eq!(call(2, &[1, 2, 3]).unwrap_err(), stop);
    assert!(matches!(call(usize::MAX, &[]).unwrap_err(), Stop::Rows { .. }));
    assert_eq!(call(0, &[]).unwrap().words(), []);
    for cases in [1, 15, 16, 17, 255, 256, 257, 513] {
        let rows: Vec<u32> = (0..2 * cases as u32).collect();
        let expected: Vec<u32> = (0..cases as u32).map(|k| 4 * k + 1).collect();
        assert_eq!(call(cases, &rows).unwrap().words(), expected);
    }
}

#[test]
fn functions_of_nothing_and_to_nothing() {
    assert_eq!(call::<F32>(&program("fn f() -> u32 { return 7u; }", "f"), 3, &[]).words(), [7; 3]);
    let nothing = program("fn f(x: u32) { }", "f");
    assert_eq!(call::<F32>(&nothing, 2, &[1, 2]).words(), []);
}

#[test]
fn missing_features_are_refused_by_name_and_line() {
    let source = "fn g(x: f32) -> f32 {\n return dpdx(x);\n}\nfn f(x: f32) -> f32 { return g(x); }";
    let refusal = refused(source);
    assert_eq!(
        refusal.to_string(),
        "the engine doesn't support a derivative outside of a fragment shader"
    );
    assert_eq!(line(source, refusal.span), 2);
    let refusal = refused("fn f(x: f32) -> f32 { if x > 0.0 { discard; } return x; }");
    assert!(refusal.what.contains("discard"), "{refusal}");
    let refusal = refused(
        "@group(0) @binding(0) var<storage, read_write> b: array<f32>;
        fn f(x: f32) -> f32 { b[0] = x; return x; }",
    );
    assert!(refusal.what.contains("writes the buffer `b`"), "{refusal}");
    let refusal = refused("var<workgroup> w: f32; fn f(x: f32) -> f32 { return w; }");
    assert!(refusal.what.contains("workgroup variable `w`"), "{refusal}");
    let refusal = refused("fn f(x: u64) -> u64 { return x; }");
    assert!(refusal.what.contains("u64"), "{refusal}");
    let refusal = refused("fn f(p: ptr<function, f32>) -> f32 { return *p; }");
    assert!(refusal.what.contains("pointer"), "{refusal}");
    let (module, info) = module("fn f() {}");
    let refusal = Program::function(&module, &info, "g", &Settings::default()).unwrap_err();
    assert!(refusal.what.contains("`g`"), "{refusal}");
}

#[test]
fn huge_arrays_are_refused() {
    let source = "fn f(i: u32) -> f32 { var a: array<array<f32, 8192>, 8192>; return a[i][i]; }";
    let refusal = refused(source);
    assert!(refusal.what.contains("scalars"), "{refusal}");
}

#[test]
fn exponentially_many_calls_are_refused() {
    let mut source = "fn g0(x: f32) -> f32 { return x * x + 1.0; }\n".to_owned();
    for k in 1..64 {
        let before = k - 1;
        writeln!(source, "fn g{k}(x: f32) -> f32 {{ return g{before}(x) + g{before}(x + 1.0); }}")
            .unwrap();
    }
    source += "fn f(x: f32) -> f32 { return g63(x); }";
    let refusal = refused(&source);
    assert!(refusal.what.contains("operations"), "{refusal}");
}

#[test]
fn long_and_deep_programs() {
    let mut source = "fn f(x: u32) -> u32 { var y = x;\n".to_owned();
    for k in 0..5000 {
        writeln!(source, "y = y * 3u + {k}u;").unwrap();
    }
    source += "return y; }";
    let expected = (0..5000u32).fold(5u32, |y, k| y.wrapping_mul(3).wrapping_add(k));
    assert_eq!(words(&source, &[5]), [expected]);
    // A chain of 2,000 calls, each inside a deeper block.
    let mut source = "fn g0(x: u32) -> u32 { return x; }\n".to_owned();
    for k in 1..2000 {
        let before = k - 1;
        writeln!(
            source,
            "fn g{k}(x: u32) -> u32 {{ if x == 0u {{ return {k}u; }} return g{before}(x - 1u); }}"
        )
        .unwrap();
    }
    source += "fn f(x: u32) -> u32 { return g1999(x); }";
    assert_eq!(words(&source, &[0, 10, 5000]), [1999, 1989, 5000 - 1999]);
    // Blocks are nested as deep as the front end allows.
    let source = format!(
        "fn f(x: u32) -> u32 {{ var y = 0u; {} y = x; {} return y; }}",
        "if x > 1u { ".repeat(100),
        "}".repeat(100)
    );
    assert_eq!(words(&source, &[1, 2]), [0, 2]);
}

#[test]
fn an_undecided_loop_ends_and_is_unbounded() {
    let source = "fn f(x: f32) -> f32 {
        var y = 1.0;
        loop {
            if sin(x * 0.5) + y * 0.0 > 0.5 { break; }
            y += 1.0;
        }
        return y;
    }";
    let program = program(source, "f");
    // sin(pi / 6) is 0.5 within the error of the sine, so the exit stays undecided.
    let row = [std::f32::consts::FRAC_PI_3.to_bits()];
    let options = Options::default();
    let found = program.call::<Intervals>(1, &row, &Resources::new(), &options, &()).unwrap();
    let Lane::Float(y) = found.row(0)[0] else { panic!() };
    assert!(!y.is_bounded());
    let site = program.cause(y).unwrap();
    assert_eq!(line(source, site.span), 3);
}
