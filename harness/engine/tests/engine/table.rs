//! Compares the engine's bounds with bounds that `table.py` computed with a precision of 200 bits. `table.py` shares no
//! code with the engine.

use std::collections::BTreeMap;

use crate::common::intervals;

const TABLE: &str = include_str!("table.txt");

fn word(text: &str) -> f32 {
    f32::from_bits(u32::from_str_radix(text, 16).expect("a word"))
}

/// The inputs of a case, with the smallest and the largest result that WGSL allows. `None` if WGSL allows any result.
type Case = (Vec<f32>, Option<(f32, f32)>);

/// The engine's bounds contain the table's bounds. Each end may be one float further out, because the engine computes
/// bounds in `f64`.
// Lesson 91
#[test]
fn bounds_are_those_of_exact_arithmetic() {
    let mut builtins: BTreeMap<&str, Vec<Case>> = BTreeMap::new();
    for line in TABLE.lines() {
        let parts: Vec<&str> = line.split(" | ").collect();
        let inputs = parts[1].split(' ').map(word).collect();
        let ends = parts[2].split_once(' ').map(|(lo, hi)| (word(lo), word(hi)));
        builtins.entry(parts[0]).or_default().push((inputs, ends));
    }
    assert_eq!(builtins.len(), 17);
    for (text, cases) in builtins {
        assert_eq!(cases.len(), 100, "{text}");
        let names = ["a: f32", "b: f32", "c: f32"][..cases[0].0.len()].join(", ");
        let source = format!("fn f({names}) -> f32 {{ return {text}; }}");
        let rows: Vec<f32> = cases.iter().flat_map(|(inputs, _)| inputs.clone()).collect();
        for ((inputs, ends), found) in cases.iter().zip(intervals(&source, &rows)) {
            let Some((lo, hi)) = *ends else {
                assert!(
                    !found.is_bounded(),
                    "{text} of {inputs:?}: {found:?}, but by exact arithmetic it is unbounded"
                );
                continue;
            };
            let around = |near: f32, far: f32, found: f32| found == near || found == far;
            assert!(
                around(lo, lo.next_down(), found.lo()) && around(hi, hi.next_up(), found.hi()),
                "{text} of {inputs:?}: {found:?}, but by exact arithmetic it is {lo:e} to {hi:e}"
            );
        }
    }
}
