//! Compares expressions of constants, which naga evaluates, with the same expressions of run-time arguments.

use crate::common::words;

/// Checks that each expression has the same result in two functions: one function has literals, and the other has
/// parameters.
fn agree(scalar: &str, expressions: &[&str], values: &[&str]) {
    for expression in expressions {
        let mut constants = String::new();
        for (k, x) in values.iter().enumerate() {
            for (l, y) in values.iter().enumerate() {
                let constant = expression.replace("$x", x).replace("$y", y);
                constants += &format!("case {}u: {{ return {constant}; }}\n", k * values.len() + l);
            }
        }
        let fixed = format!(
            "fn f(i: u32) -> {scalar} {{ switch i {{ {constants} default: {{ }} }} return {scalar}(); }}"
        );
        let variable = expression.replace("$x", "x").replace("$y", "y");
        let table = values.join(", ");
        let n = values.len();
        let running = format!(
            "fn g(x: {scalar}, y: {scalar}) -> {scalar} {{ return {variable}; }}
            fn f(i: u32) -> {scalar} {{ var t = array<{scalar}, {n}>({table}); return g(t[i / {n}u], t[i % {n}u]); }}"
        );
        let rows: Vec<u32> = (0..(n * n) as u32).collect();
        let (fixed, running) = (words(&fixed, &rows), words(&running, &rows));
        for (k, (a, b)) in fixed.iter().zip(&running).enumerate() {
            let (x, y) = (values[k / n], values[k % n]);
            let close = scalar == "f32" && {
                let (a, b) = (f32::from_bits(*a), f32::from_bits(*b));
                (a - b).abs() <= 4.0 * f32::EPSILON * a.abs()
            };
            assert!(a == b || close, "{expression} of {x} and {y}: naga {a:x}, engine {b:x}");
        }
    }
}

#[test]
fn integers_agree_with_the_constant_evaluator() {
    let signed = ["0i", "1i", "-1i", "5i", "-7i", "300i", "2147483647i", "i32(-2147483648)"];
    agree(
        "i32",
        &[
            "$x & $y",
            "$x | $y",
            "$x ^ $y",
            "~$x",
            "min($x, $y)",
            "max($x, $y)",
            "sign($x)",
            "clamp($x, -10i, 10i)",
            "countOneBits($x)",
            "countLeadingZeros($x)",
            "countTrailingZeros($x)",
            "firstLeadingBit($x)",
            "firstTrailingBit($x)",
            "reverseBits($x)",
            "i32($x < $y)",
            "select($x, $y, $x >= $y)",
            "i32(u32($x))",
            "bitcast<i32>(f32($x))",
            "i32(f32($x) * 0.5f)",
            "dot4I8Packed(u32($x), u32($y))",
            "$x >> 3u",
            "dot(vec2i($x % 9i, 2i), vec2i(3i, $y % 11i))",
        ],
        &signed,
    );
    let unsigned = ["0u", "1u", "5u", "31u", "32u", "65536u", "2147483648u", "4294967295u"];
    agree(
        "u32",
        &[
            "min($x, $y)",
            "$x ^ ~$y",
            "countLeadingZeros($x)",
            "firstLeadingBit($x)",
            "reverseBits($x)",
            "dot4U8Packed($x, $y)",
            "u32(f32($x))",
            "$x >> 7u",
            "u32($x > $y)",
        ],
        &unsigned,
    );
}

#[test]
fn floats_agree_with_the_constant_evaluator() {
    let values = ["0.0f", "1.0f", "-1.0f", "0.3f", "-2.5f", "1.5f", "100.25f", "-0.0f", "1e-18f"];
    agree(
        "f32",
        &[
            "$x + $y",
            "$x - $y",
            "$x * $y",
            "floor($x)",
            "ceil($x)",
            "round($x)",
            "trunc($x)",
            "fract($x)",
            "abs($x)",
            "sign($x)",
            "min($x, $y)",
            "max($x, $y)",
            "saturate($x)",
            "clamp($x, -1.0f, 1.0f)",
            "step($x, $y)",
            "fma($x, $y, 2.0f)",
            "sin($x)",
            "cos($x)",
            "atan($x)",
            "atan2($x, $y + 3.0f)",
            "exp($x * 0.1f)",
            "exp2($x * 0.1f)",
            "log(abs($x) + 1.0f)",
            "log2(abs($x) + 1.0f)",
            "sqrt(abs($x))",
            "tanh($x)",
            "inverseSqrt(abs($x) + 1.0f)",
            "pow(abs($x), 2.0f)",
            "degrees($x)",
            "radians($x)",
            "length(vec3f($x, $y, 1.0f))",
            "distance(vec2f($x), vec2f($y))",
            "select($x, $y, $x < $y)",
            "dot(vec3f($x, $y, 1.0f), vec3f($y, 2.0f, $x))",
            "$x / ($y + 7.0f)",
            "$x % 0.7f",
            "cross(vec3f($x, $y, 1.0f), vec3f(1.0f, $x, $y)).y",
            "f32(i32($x))",
            "f32(u32($x))",
            "normalize(vec3f($x, $y, 1.0f)).x",
            "(mat2x2f($x, $y, 1.0f, 2.0f) * vec2f($x, $y)).x",
        ],
        &values,
    );
}
