use super::*;
use crate::package::Package;

fn rounds(body: &str) -> Option<u64> {
    let text = format!(
        "const N = 64u;\nfn g(n: u32) -> u32 {{ var s = 0u; for (var i = 0u; i < 3u; i++) \
             {{ s += n; }} return s; }}\nfn f(n: u32) -> u32 {{ var s = 0u; {body} return s; }}"
    );
    let package = Package::from_source("s", text);
    Program::of_function(&package, "f").expect("valid").most_rounds()
}

// Lesson 55: loops that need no counter
#[test]
fn constant_loops_are_bounded() {
    // `g` takes 3 iterations. Karat links `g` only if `body` calls it.
    let bound = |body, most: u64| assert_eq!(rounds(body), Some(most), "{body}");
    bound("", 0);
    bound("for (var i = 0u; i < 64u; i++) { s += i; }", 64);
    bound("for (var i = 0u; i < N; i += 2u) { s += i; }", 32);
    bound("for (var i = 10i; i >= 0i; i--) { s += 1u; }", 11);
    bound("for (var i = 0u; 9u > i; i++) { if s > n { continue; } s += 1u; }", 9);
    bound("for (var i = 0u; i < 8u; i++) { for (var j = 0u; j < 8u; j++) { s += g(j); } }", 264);
    bound("s += g(n); s += g(s);", 6);
}

// Lesson 55: loops that need no counter
#[test]
fn loops_without_a_constant_count_are_not_bounded() {
    for body in [
        "for (var i = 0u; i < n; i++) { s += i; }",
        "for (var i = n; i < 64u; i++) { s += i; }",
        "loop { s += 1u; if s > n { break; } }",
        "for (var i = 0u; i < 64u; i++) { if s < n { i -= 1u; } s += 1u; }",
        "for (var i = 0u; i < 64u; i += n) { s += i; }",
        "for (var i = 0u; i <= 4294967295u; i++) { s += i; }",
        "for (var i = 0u; i >= 0u; i++) { s += i; }",
        "var i = 5u; for (; i < 64u; i++) { s += i; } for (; i > 2u; i--) { s += i; }",
        "while true { s += 1u; if s > n { break; } }",
    ] {
        assert_eq!(rounds(body), None, "{body}");
    }
}
