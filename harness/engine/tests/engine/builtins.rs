//! Compares WGSL's builtin functions with Rust's own functions, and with values that we computed by hand.

use crate::common::{doubles, floats, words};

/// Floats at which builtins often go wrong, such as halves, the smallest normal float and 2^32.
const EDGES: [f32; 22] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    1.5,
    2.5,
    -2.5,
    1e-45,
    -1e-45,
    f32::MIN_POSITIVE,
    f32::MAX,
    f32::MIN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
    8_388_609.0,
    2_147_483_648.0,
    4_294_967_296.0,
    -2_147_483_904.0,
    0.499_999_97,
];

fn same(a: f32, b: f32) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

fn unary(expression: &str, expected: impl Fn(f32) -> f32) {
    let source = format!("fn f(x: f32) -> f32 {{ return {expression}; }}");
    for (x, y) in EDGES.iter().zip(floats(&source, &EDGES)) {
        assert!(same(y, expected(*x)), "{expression} of {x:e}: {y:e}, not {:e}", expected(*x));
    }
}

#[test]
fn exact_functions_of_one_float() {
    unary("-x", |x| -x);
    unary("abs(x)", f32::abs);
    unary("floor(x)", f32::floor);
    unary("ceil(x)", f32::ceil);
    unary("round(x)", f32::round_ties_even);
    unary("trunc(x)", f32::trunc);
    unary("sqrt(x)", f32::sqrt);
    unary("fract(x)", |x| x - x.floor());
    unary("sign(x)", |x| {
        if x > 0.0 {
            1.0
        } else if x < 0.0 {
            -1.0
        } else {
            0.0
        }
    });
    unary("x * x", |x| x * x);
    unary("1.0 / x", |x| 1.0 / x);
    unary("x % 0.75", |x| x % 0.75);
    unary("x - 1e30", |x| x - 1e30);
    unary("f32(x > 0.5)", |x| f32::from(u8::from(x > 0.5)));
    unary("select(1.0, 2.0, x != x)", |x| if x.is_nan() { 2.0 } else { 1.0 });
    unary("quantizeToF16(x)", |x| half::f16::from_f32(x).to_f32());
    unary("bitcast<f32>(bitcast<u32>(x) ^ 0x80000000u)", |x| f32::from_bits(x.to_bits() ^ 1 << 31));
}

#[test]
fn functions_of_one_float_are_close_to_f64() {
    type Reference = fn(f64) -> f64;
    let table: [(&str, Reference, f64, f64); 21] = [
        ("sin(x)", f64::sin, -3.1, 3.1),
        ("cos(x)", f64::cos, -3.1, 3.1),
        ("tan(x)", f64::tan, -1.5, 1.5),
        ("asin(x)", f64::asin, -1.0, 1.0),
        ("acos(x)", f64::acos, -1.0, 1.0),
        ("atan(x)", f64::atan, -50.0, 50.0),
        ("sinh(x)", f64::sinh, -10.0, 10.0),
        ("cosh(x)", f64::cosh, -10.0, 10.0),
        ("tanh(x)", f64::tanh, -10.0, 10.0),
        ("asinh(x)", f64::asinh, -10.0, 10.0),
        ("acosh(x)", f64::acosh, 1.0, 10.0),
        ("atanh(x)", f64::atanh, -0.99, 0.99),
        ("exp(x)", f64::exp, -80.0, 80.0),
        ("exp2(x)", f64::exp2, -120.0, 120.0),
        ("log(x)", f64::ln, 1e-30, 1e30),
        ("log2(x)", f64::log2, 0.01, 100.0),
        ("inverseSqrt(x)", |x| 1.0 / x.sqrt(), 1e-6, 1e6),
        ("pow(abs(x), 2.5)", |x| x.abs().powf(2.5), 0.0, 100.0),
        ("degrees(x)", f64::to_degrees, -7.0, 7.0),
        ("radians(x)", f64::to_radians, -720.0, 720.0),
        ("atan2(x, -2.0)", |x| x.atan2(-2.0), -9.0, 9.0),
    ];
    for (expression, reference, low, high) in table {
        let source = format!("fn f(x: f32) -> f32 {{ return {expression}; }}");
        let rows: Vec<f32> =
            (0..=1000).map(|k| (low + (high - low) * f64::from(k) / 1000.0) as f32).collect();
        let rows: Vec<f32> =
            rows.into_iter().filter(|&x| f64::from(x) >= low && f64::from(x) <= high).collect();
        for ((x, y), z) in rows.iter().zip(floats(&source, &rows)).zip(doubles(&source, &rows)) {
            let exact = reference(f64::from(*x));
            // libm is exact to 1 ulp. `log` near 1 and `tan` near its zero lose a few more digits.
            let bound = 4.0 * f64::from(f32::EPSILON) * exact.abs() + 1e-37;
            assert!((f64::from(y) - exact).abs() <= bound, "{expression} of {x}: {y}, not {exact}");
            let fine = 1e-13 * exact.abs() + 1e-300;
            assert!((z - exact).abs() <= fine, "{expression} of {x} in f64: {z}, not {exact}");
        }
    }
}

#[test]
fn minimum_maximum_and_clamp() {
    let source = "fn f(x: f32, y: f32) -> vec4f {
        return vec4f(min(x, y), max(x, y), clamp(x, -1.0, y), saturate(x));
    }";
    let rows = [3.0, 2.0, -5.0, 2.0, f32::NAN, 2.0, 2.0, f32::NAN];
    let found = floats(source, &rows);
    assert_eq!(found[..4], [2.0, 3.0, 2.0, 1.0]);
    assert_eq!(found[4..8], [-5.0, 2.0, -1.0, 0.0]);
    // If one argument is NaN, the result is the other argument.
    assert_eq!(found[8..12], [2.0, 2.0, -1.0, 0.0]);
    assert_eq!(found[12..14], [2.0, 2.0]);
}

const INTS: [i32; 14] =
    [0, 1, -1, 2, -2, 7, -7, 31, 32, i32::MAX, i32::MIN, i32::MIN + 1, 0x1234_5678, -0x1234_5678];

fn int_pairs(expression: &str, expected: impl Fn(i32, i32) -> i32) {
    let source = format!("fn f(x: i32, y: i32) -> i32 {{ return {expression}; }}");
    let pairs: Vec<(i32, i32)> = INTS.iter().flat_map(|&x| INTS.map(|y| (x, y))).collect();
    let rows: Vec<u32> =
        pairs.iter().flat_map(|&(x, y)| [x.cast_unsigned(), y.cast_unsigned()]).collect();
    for (&(x, y), found) in pairs.iter().zip(words(&source, &rows)) {
        assert_eq!(found.cast_signed(), expected(x, y), "{expression} of {x} and {y}");
    }
}

fn uint_pairs(expression: &str, expected: impl Fn(u32, u32) -> u32) {
    let source = format!("fn f(x: u32, y: u32) -> u32 {{ return {expression}; }}");
    let ints = INTS.map(i32::cast_unsigned);
    let pairs: Vec<(u32, u32)> = ints.iter().flat_map(|&x| ints.map(|y| (x, y))).collect();
    let rows: Vec<u32> = pairs.iter().flat_map(|&(x, y)| [x, y]).collect();
    for (&(x, y), found) in pairs.iter().zip(words(&source, &rows)) {
        assert_eq!(found, expected(x, y), "{expression} of {x} and {y}");
    }
}

#[test]
fn integer_operators_wrap_and_never_trap() {
    int_pairs("x + y", i32::wrapping_add);
    int_pairs("x - y", i32::wrapping_sub);
    int_pairs("x * y", i32::wrapping_mul);
    int_pairs("x / y", |x, y| if y == 0 { x } else { x.wrapping_div(y) });
    int_pairs("x % y", |x, y| if y == 0 { 0 } else { x.wrapping_rem(y) });
    int_pairs("x << (u32(y) & 31u)", |x, y| x.wrapping_shl(y.cast_unsigned()));
    int_pairs("x >> (u32(y) & 31u)", |x, y| x.wrapping_shr(y.cast_unsigned()));
    int_pairs("x >> u32(y)", |x, y| x.wrapping_shr(y.cast_unsigned()));
    int_pairs("(x & y) | (x ^ ~y)", |x, y| (x & y) | (x ^ !y));
    int_pairs("min(x, y) - max(x, y)", |x, y| x.min(y).wrapping_sub(x.max(y)));
    int_pairs("clamp(x, -5, y)", |x, y| x.max(-5).min(y));
    int_pairs("abs(x) + sign(y)", |x, y| x.wrapping_abs().wrapping_add(y.signum()));
    int_pairs("-x", |x, _| x.wrapping_neg());
    int_pairs("select(x, y, x < y)", |x, y| if x < y { y } else { x });
    int_pairs("i32(x <= y) + 2 * i32(x == y) + 4 * i32(x > y)", |x, y| {
        i32::from(x <= y) + 2 * i32::from(x == y) + 4 * i32::from(x > y)
    });
    uint_pairs("x / y", |x, y| x.checked_div(y).unwrap_or(x));
    uint_pairs("x % y", |x, y| x.checked_rem(y).unwrap_or(0));
    uint_pairs("u32(x < y) + 2u * u32(x >= y)", |x, y| u32::from(x < y) + 2 * u32::from(x >= y));
    uint_pairs("x >> y", u32::wrapping_shr);
    uint_pairs("min(x, y) + 3u * max(x, y)", |x, y| {
        x.min(y).wrapping_add(x.max(y).wrapping_mul(3))
    });
}

#[test]
fn bits_of_integers() {
    uint_pairs(
        "countOneBits(x) + 64u * countLeadingZeros(x) + 4096u * countTrailingZeros(x)",
        |x, _| x.count_ones() + 64 * x.leading_zeros() + 4096 * x.trailing_zeros(),
    );
    uint_pairs("reverseBits(x)", |x, _| x.reverse_bits());
    uint_pairs("firstLeadingBit(x)", |x, _| x.checked_ilog2().unwrap_or(u32::MAX));
    uint_pairs("firstTrailingBit(x)", |x, _| if x == 0 { u32::MAX } else { x.trailing_zeros() });
    int_pairs("firstLeadingBit(x)", |x, _| {
        let bits = if x < 0 { !x } else { x };
        bits.checked_ilog2().map_or(-1, u32::cast_signed)
    });
    // Takes one bit after another, as the specification describes it.
    let extracted = |x: u32, offset: u32, count: u32| {
        let o = offset.min(32);
        let c = count.min(32 - o);
        (0..c).map(|k| (x >> (o + k) & 1) << k).sum::<u32>()
    };
    uint_pairs("extractBits(x, y & 63u, y >> 28u)", |x, y| extracted(x, y & 63, y >> 28));
    uint_pairs("extractBits(x, y, 32u)", |x, y| extracted(x, y, 32));
    int_pairs("extractBits(x, u32(y) & 31u, 5u)", |x, y| {
        let offset = y.cast_unsigned() & 31;
        let count = 5.min(32 - offset);
        let bits = extracted(x.cast_unsigned(), offset, count);
        (bits << (32 - count)).cast_signed() >> (32 - count)
    });
    uint_pairs("insertBits(x, y, 4u, 9u)", |x, y| (x & !(0x1ff << 4)) | ((y & 0x1ff) << 4));
    uint_pairs("insertBits(x, y, 30u, 9u)", |x, y| (x & 0x3fff_ffff) | (y << 30));
    uint_pairs("insertBits(x, y, 0u, 32u)", |_, y| y);
    uint_pairs("insertBits(x, y, 5u, 0u)", |x, _| x);
}

#[test]
fn packed_bytes_and_halves() {
    uint_pairs("dot4U8Packed(x, y)", |x, y| {
        (0..4).map(|k| (x >> (8 * k) & 255) * (y >> (8 * k) & 255)).sum()
    });
    uint_pairs("u32(dot4I8Packed(x, y))", |x, y| {
        let byte = |x: u32, k: u32| i32::from((x >> (8 * k)) as u8 as i8);
        (0..4).map(|k| byte(x, k) * byte(y, k)).sum::<i32>().cast_unsigned()
    });
    uint_pairs("pack4xU8(unpack4xU8(x))", |x, _| x);
    uint_pairs("pack4xI8(unpack4xI8(x))", |x, _| x);
    uint_pairs("pack4xU8Clamp(vec4u(x, y, 255u, 256u))", |x, y| {
        x.min(255) | y.min(255) << 8 | 0xffff_0000
    });
    let source = "fn f(x: f32, y: f32) -> vec4u { return vec4u(
        pack4x8snorm(vec4f(x, y, 0.0, 1.0)), pack4x8unorm(vec4f(x, y, 0.0, 1.0)),
        pack2x16snorm(vec2f(x, y)), pack2x16float(vec2f(x, y))); }";
    let rows = [0.5f32, -2.0].map(f32::to_bits);
    // The expected integers are floor(0.5 + 127 * 0.5) = 64, floor(0.5 + 255 * 0.5) = 128 and floor(0.5 + 32767 * 0.5)
    // = 16384.
    assert_eq!(words(source, &rows), [0x7f00_8140, 0xff00_0080, 0x8001_4000, 0xc000_3800]);
    let source =
        "fn f(x: u32) -> vec4f { return unpack4x8snorm(x) + vec4f(unpack2x16float(x), 0.0, 0.0); }";
    let found: Vec<f32> = words(source, &[0x7f80_3c00]).into_iter().map(f32::from_bits).collect();
    // The bytes are 00, 3c, 80, 7f. The halves are 3c00 (1) and 7f80 (NaN).
    assert_eq!((found[0], found[2], found[3]), (1.0, -1.0, 1.0));
    assert!(found[1].is_nan());
}

#[test]
fn conversions_saturate() {
    let source = "fn f(x: f32) -> vec2u { return vec2u(u32(x), bitcast<u32>(i32(x))); }";
    let rows: Vec<u32> = EDGES.iter().map(|x| x.to_bits()).collect();
    for (x, found) in EDGES.iter().zip(words(source, &rows).chunks(2)) {
        // A float above the range becomes the greatest float in it. All of naga's back ends clamp in this way.
        let unsigned = if *x >= 4_294_967_296.0 { 4_294_967_040 } else { *x as u32 };
        let signed = if *x >= 2_147_483_648.0 { 2_147_483_520 } else { *x as i32 };
        assert_eq!((found[0], found[1].cast_signed()), (unsigned, signed), "{x}");
    }
    let source = "fn f(x: i32) -> vec3f { return vec3f(f32(x), f32(u32(x)), f32(bool(x))); }";
    let rows = [-1i32, 16_777_217, 0].map(i32::cast_unsigned);
    let found: Vec<f32> = words(source, &rows).into_iter().map(f32::from_bits).collect();
    assert_eq!(found[..3], [-1.0, 4_294_967_296.0, 1.0]);
    assert_eq!(found[3..6], [16_777_216.0, 16_777_216.0, 1.0]);
    assert_eq!(found[6..], [0.0, 0.0, 0.0]);
}

#[test]
fn parts_of_floats() {
    let source = "fn f(x: f32) -> vec4f {
        let m = modf(x); let e = frexp(x);
        return vec4f(m.fract, m.whole, e.fract, f32(e.exp));
    }";
    assert_eq!(floats(source, &[-3.75]), [-0.75, -3.0, -0.9375, 2.0]);
    assert_eq!(floats(source, &[0.0]), [0.0, 0.0, 0.0, 0.0]);
    assert_eq!(floats(source, &[1e-45])[2..], [0.5, -148.0]);
    let source = "fn f(x: f32, y: f32) -> f32 { return ldexp(x, i32(y)); }";
    assert_eq!(floats(source, &[3.0, 4.0, 1.0, -149.0, 1.0, 200.0]), [48.0, 1e-45, f32::INFINITY]);
}

#[test]
fn vectors() {
    let source = "fn f(a: vec3f, b: vec3f) -> vec4f { return vec4f(cross(a, b), dot(a, b)); }";
    assert_eq!(floats(source, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), [-3.0, 6.0, -3.0, 32.0]);
    let source = "fn f(a: vec2f) -> vec4f {
        return vec4f(length(a), distance(a, vec2f(0.0)), normalize(a));
    }";
    assert_eq!(floats(source, &[3.0, 4.0]), [5.0, 5.0, 0.6, 0.8]);
    let source = "fn f(a: vec2f, n: vec2f) -> vec4f {
        return vec4f(reflect(a, n), faceForward(n, a, n));
    }";
    assert_eq!(floats(source, &[1.0, -2.0, 0.0, 1.0]), [1.0, 2.0, 0.0, 1.0]);
    // The first ray goes straight through. The second is totally reflected: 1 - 1.5^2 (1 - 0.6^2) < 0.
    let source = "fn f(a: vec2f, eta: f32) -> vec2f { return refract(a, vec2f(0.0, 1.0), eta); }";
    assert_eq!(floats(source, &[0.0, -1.0, 1.5, 0.8, -0.6, 1.5]), [0.0, -1.0, 0.0, 0.0]);
    let source = "fn f(a: f32, b: f32) -> vec4f {
        return vec4f(mix(a, b, 0.25), step(a, b), smoothstep(a, b, 3.0), fma(a, b, 1.0));
    }";
    assert_eq!(floats(source, &[2.0, 6.0]), [3.0, 1.0, 0.15625, 13.0]);
    let source = "fn f(x: i32) -> i32 {
        let v = vec3i(x, 2, -3);
        return dot(v, v.zyx) * 100 + i32(any(v < vec3i(0))) * 10 + i32(all(v == vec3i(x, 2, -3)));
    }";
    assert_eq!(words(source, &[5])[0].cast_signed(), -26 * 100 + 11);
}

#[test]
fn matrices_of_every_shape() {
    let shape = |columns: usize, rows: usize| {
        let source = format!(
            "fn f(m: mat{columns}x{rows}f, v: vec{columns}f, w: vec{rows}f) -> vec4f {{
                let a = m * v; let b = w * m; let c = (m * transpose(m)) * w;
                return vec4f(dot(a, w), dot(b, v), c.x, c.y);
            }}"
        );
        let m: Vec<f32> = (0..columns * rows).map(|k| (k * k % 7) as f32 - 2.0).collect();
        let v: Vec<f32> = (0..columns).map(|k| k as f32 + 1.0).collect();
        let w: Vec<f32> = (0..rows).map(|k| 3.0 - k as f32).collect();
        let at = |c: usize, r: usize| m[c * rows + r];
        let row: Vec<f32> = [m.clone(), v.clone(), w.clone()].concat();
        let form: f32 =
            (0..columns).map(|c| (0..rows).map(|r| at(c, r) * v[c] * w[r]).sum::<f32>()).sum();
        let square = |i: usize| -> f32 {
            (0..rows).map(|j| (0..columns).map(|c| at(c, i) * at(c, j)).sum::<f32>() * w[j]).sum()
        };
        assert_eq!(floats(&source, &row), [form, form, square(0), square(1)], "{columns} {rows}");
    };
    for columns in 2..=4 {
        for rows in 2..=4 {
            shape(columns, rows);
        }
    }
    let source = "fn f(m: mat3x3f) -> f32 { return determinant(m); }";
    assert_eq!(floats(source, &[2.0, 0.0, 1.0, 3.0, 0.0, 0.0, 5.0, 1.0, 1.0]), [3.0]);
    let source = "fn f(m: mat4x4f) -> f32 { return determinant(m); }";
    let m = [1.0, 0.0, 2.0, -1.0, 3.0, 0.0, 0.0, 5.0, 2.0, 1.0, 4.0, -3.0, 1.0, 0.0, 5.0, 0.0];
    assert_eq!(floats(source, &m), [30.0]);
}
