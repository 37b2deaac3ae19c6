//! Tests that the engine recognises programs that compute the same results, and that similar programs with other
//! results count as different.

use karat_engine::{Program, Settings};

use crate::common;

fn is_same(a: &str, b: &str) -> bool {
    let [a, b] = [a, b].map(|body| {
        let (module, info) = common::module(&format!("fn f(x: f32, y: f32) -> f32 {{ {body} }}"));
        let settings = Settings { identities: true, ..Settings::default() };
        Program::function(&module, &info, "f", &settings).expect("it lowers")
    });
    assert!(a.is_same(&a) && b.is_same(&b) && a.is_same(&b) == b.is_same(&a));
    a.is_same(&b)
}

#[test]
fn equivalent_expressions_are_equal_for_each_number() {
    for (a, b) in [
        ("return x * 2.0;", "return x + x;"),
        ("return 2.0 * x;", "return x + x;"),
        ("return x * 1.0 + y;", "return x + y;"),
        ("return y + x;", "return x + y;"),
        ("return x / 1.0;", "return x;"),
        ("return x - 0.0;", "return x;"),
        ("return x / 4.0;", "return 0.25 * x;"),
        ("let unused = x * 3.0; return y;", "let unused = x * 5.0; return y;"),
        ("return x * (1.0 + 1.0);", "return x + x;"),
    ] {
        assert!(is_same(a, b), "{a} is {b}");
        // The machine computes the same numbers with both programs.
        let [a, b] = [a, b].map(|body| format!("fn f(x: f32, y: f32) -> f32 {{ {body} }}"));
        let special = [0.0, -0.0, 1.5, -3.0e38, f32::INFINITY, f32::NAN, 1.0e-45, 1.0e-38, 3.3];
        let rows: Vec<f32> =
            special.iter().flat_map(|x| special.map(|y| [*x, y])).flatten().collect();
        let bits = |text: &str| -> Vec<u32> {
            let all = common::floats(text, &rows).into_iter();
            all.map(|x| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() }).collect()
        };
        assert_eq!(bits(&a), bits(&b), "{a}\n{b}");
    }
}

/// A caller can read the `var<private>` variables that a function writes, so these variables count as results of the
/// function.
// Lesson 29
#[test]
fn private_variables_are_results() {
    let lowered = |value: &str| {
        let text = format!(
            "var<private> flag: bool;\nvar<private> unused: bool;\nfn f(x: f32) -> f32 {{ flag = x > {value}; return x; }}"
        );
        let (module, info) = common::module(&text);
        let settings = Settings { identities: true, ..Settings::default() };
        Program::function(&module, &info, "f", &settings).expect("it lowers")
    };
    assert!(lowered("0.3").is_same(&lowered("0.3")));
    assert!(!lowered("0.3").is_same(&lowered("0.6")));
}

/// Two programs count as different even if their results differ only for one number, for -0 or for NaN.
// Lesson 29
#[test]
fn expressions_with_one_different_result_are_not_equal() {
    for (a, b) in [
        ("return x + 0.0;", "return x;"),
        ("return x * 0.0;", "return 0.0;"),
        ("return x - x;", "return 0.0;"),
        ("return x / 3.0;", "return x * 0.33333334;"),
        ("return x / 3.0e38;", "return x * 3.3333333e-39;"),
        ("if (x == 0.125) { return 1.0; } return y;", "if (x == 0.125) { return 2.0; } return y;"),
        ("return select(y, x, x == x);", "return x;"),
        ("return x - y;", "return y - x;"),
        ("return max(x, y);", "return max(y, x);"),
    ] {
        assert!(!is_same(a, b), "{a} isn't {b}");
    }
}
