//! Tests reads outside of arrays. WGSL allows several values for such a read. Karat reports the read only if another
//! allowed value changes what the pass writes.

use karat::check::HazardKind;
use karat::prelude::*;

/// Runs `body` in one workgroup of four invocations, with an array `d` that contains `words`. Returns the lines for
/// which Karat reports a read or write outside of an array.
fn lines(body: &str, words: &[u32]) -> Vec<usize> {
    let text = format!(
        "@group(0) @binding(0) var<storage, read_write> d: array<u32>;
@group(0) @binding(1) var<storage, read_write> out: array<u32, 4>;
struct Pair {{ a: u32, b: u32 }}
const table = array<u32, 3>(5u, 6u, 7u);
@compute @workgroup_size(4) fn main(@builtin(local_invocation_index) i: u32) {{
{body}
    out[i] += 0u * d[0];
}}"
    );
    let package = Package::from_source("m", text);
    let passes = package.compute().with("d", Storage::new(words.iter().copied()));
    let passes = passes.with("out", Storage::new([9_u32; 4])).dispatch("main", [1, 1, 1]);
    let (found, watched) = karat::unstable::compute::violations(&passes).expect("it is valid");
    assert_eq!(watched.reason, "", "{body}");
    let line = |place: &str| place.split(':').nth(1).expect("a line").parse::<usize>();
    let lines = found.iter().map(|(one, _)| {
        assert_eq!(one.kind, HazardKind::OutOfRange, "{body}: {one:?}");
        line(&one.accesses[0].place).expect("a number") - 5
    });
    lines.collect()
}

// Lesson 219
#[test]
fn reads_outside_that_matter() {
    let all: &[(&str, &[u32], &[usize])] = &[
        // The write in the other line restores the word that the read has lost.
        (
            "for (var k = 0u; k < 8u; k++) {
    let a = 2u * i + (k & 1u);
    let x = d[a];
    let y = d[a + 1u];
    if x > y { d[a] = y; d[a + 1u] = x; }
    storageBarrier();
}",
            &[7, 2, 3, 4, 6, 5, 1, 8],
            &[4],
        ),
        // The two reads matter only together. The second read runs if the first gives 0.
        ("if d[i + 1u] == 0u && d[i + 2u] == 0u { out[i] = 1u; }", &[1, 1, 1, 1], &[1]),
        // The two reads matter only together, and both run.
        (
            "let x = d[i + 1u];\nlet y = d[i + 2u];\nif x + y == 0u { out[i] = 1u; }",
            &[1, 1, 1, 1],
            &[1],
        ),
        // Three reads matter only together.
        (
            "let x = d[i + 1u];\nlet y = d[i + 2u];\nlet z = d[i + 3u];\nif x + y + z == 0u { out[i] = 1u; }",
            &[2, 2, 2, 2],
            &[1],
        ),
        // The branch isn't taken if the read is clamped.
        ("if i < 3u && d[i ^ 1u] < d[i] { out[i] = 1u; }", &[2, 3, 4], &[1]),
        // Only some indices reach the element.
        ("if d[i + 4u] == 7u { out[i] = 1u; }", &[1, 1, 7, 1], &[1]),
        ("if d[i + 4u] == 8u { out[i] = 1u; }", &[1, 8, 1, 1], &[1]),
        // The result of the read is part of a sum, of a minimum, or an index.
        ("out[i] = d[i] + d[i + 1u];", &[1, 2, 3, 4], &[1]),
        ("out[i] = min(d[i], d[i + 1u]);", &[1, 2, 3, 4], &[1]),
        (
            "var own = array<u32, 4>(4u, 5u, 6u, 7u);\nout[i] = own[d[i + 1u] & 3u];",
            &[0, 1, 2, 3],
            &[2],
        ),
        // The array is in workgroup memory, a variable or a constant.
        ("var own = array<u32, 3>(1u, 2u, 3u);\nout[i] = own[i];", &[0; 4], &[2]),
        ("out[i] = table[i];", &[0; 4], &[1]),
        // A write outside an array always matters, even if it writes the same word.
        ("if i == 3u { d[i + 1u] = 4u; }", &[1, 2, 3, 4], &[1]),
    ];
    for (body, words, expected) in all {
        assert_eq!(lines(body, words), *expected, "{body}");
    }
}

// Lesson 219
#[test]
fn reads_outside_that_do_not_matter() {
    let all: &[(&str, &[u32])] = &[
        // The shader drops the word, or the word has no weight.
        ("out[i] = select(0u, d[i + 1u], i < 3u);", &[1, 2, 3, 4]),
        ("out[i] = d[i] + 0u * d[i + 1u];", &[1, 2, 3, 4]),
        ("let x = d[i + 1u];\nif i < 3u { out[i] = x; }", &[1, 2, 3, 4]),
        // The read doesn't affect the condition: no element is above 9, and neither is zero.
        ("if d[i + 1u] > 9u { out[i] = 1u; }", &[1, 2, 3, 4]),
        // The shader compares with a number that no element has, and that isn't zero.
        ("if d[i + 1u] == 47u { out[i] = 1u; }", &[1, 2, 3, 4]),
        // Of two reads, the shader drops one.
        ("out[i] = select(0u, d[i + 1u] + d[i + 2u], i < 2u);", &[1, 2, 3, 4]),
        // All elements are zero.
        ("out[i] = d[i + 1u];", &[0, 0, 0, 0]),
        ("out[i] = max(d[i + 1u], 4u);", &[1, 2, 3, 4]),
        ("out[i] = table[min(i, 2u)];", &[0; 4]),
        ("out[i] = d[i + 1u] / 5u;", &[1, 2, 3, 4]),
    ];
    for (body, words) in all {
        assert_eq!(lines(body, words), [0; 0], "{body}");
    }
}

/// Karat runs the pass again for each line that reads outside of an array, up to a limit. The report has the number of
/// lines that Karat didn't test.
// Lesson 219
#[test]
fn lines_that_are_not_tried_are_counted() {
    let many: String =
        (1..30).map(|k| format!("    x += select(0u, d[i + {k}u], i + {k}u < 2u);\n")).collect();
    let text = format!(
        "@group(0) @binding(0) var<storage, read> d: array<u32>;
@group(0) @binding(1) var<storage, read_write> out: array<u32, 4>;
@compute @workgroup_size(4) fn main(@builtin(local_invocation_index) i: u32) {{
    var x = 0u;
{many}    out[i] = x;
}}"
    );
    let package = Package::from_source("m", text);
    let passes = package.compute().with("d", Storage::new([1_u32, 2]));
    let passes = passes.with("out", Storage::new([9_u32; 4])).dispatch("main", [1, 1, 1]);
    let (found, watched) = karat::unstable::compute::violations(&passes).expect("it is valid");
    assert!(found.is_empty(), "{found:?}");
    let expected =
        "in `main`, 11 lines read outside of an array, and Karat didn't test the effects";
    assert_eq!(watched.reason, expected);
}
