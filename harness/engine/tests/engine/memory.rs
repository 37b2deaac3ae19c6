//! Tests arrays, structs, buffers and compute entry points.

use std::sync::Mutex;

use crate::common::{doubles, floats, intervals, module, program, words};
use karat_core::hazard::Kind;
use karat_engine::{
    F32, F64, Intervals, Lane, Observer, Options, Program, Resources, Scalar, Settings, Stop, Wrong,
};

#[test]
fn dynamic_indices_into_everything() {
    let source = "
        struct S { w: vec3f, k: i32, m: mat2x2f, }
        const TABLE = array(10, 20, 30, 40);
        var<private> p: array<vec2f, 3>;
        fn f(i: i32, j: i32) -> vec4f {
            var a = array<S, 3>();
            a[i].w[j] = 5.0;
            a[i].k = i + 7;
            a[2].m[1] = vec2f(3.0, 4.0);
            let whole = a;
            p[i] = vec2f(1.0, 2.0);
            var v = vec4f(1.0, 2.0, 3.0, 4.0);
            let n = j;
            return vec4f(
                whole[i].w[j] + f32(a[i].k) * 100.0,
                a[2].m[1][j % 2],
                f32(TABLE[j]) + v[n],
                p[0].y + p[1].y * 10.0 + p[2].y * 100.0,
            );
        }";
    let pairs: Vec<(i32, i32)> = (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).collect();
    let rows: Vec<u32> =
        pairs.iter().flat_map(|&(i, j)| [i.cast_unsigned(), j.cast_unsigned()]).collect();
    for (&(i, j), found) in pairs.iter().zip(words(source, &rows).chunks(4)) {
        let found: Vec<f32> = found.iter().map(|x| f32::from_bits(*x)).collect();
        let power = [1.0, 10.0, 100.0][i as usize];
        let expected = [
            5.0 + (i + 7) as f32 * 100.0,
            if j % 2 == 0 { 3.0 } else { 4.0 },
            10.0 * (j + 1) as f32 + (j + 1) as f32,
            2.0 * power,
        ];
        assert_eq!(found, expected, "{i} {j}");
    }
}

#[derive(Default)]
struct Outside(Mutex<Vec<(usize, String)>>);

impl Observer<F32> for Outside {
    fn wrong(&self, one: &Wrong<'_>) {
        assert_eq!(one.kind, Kind::OutOfRange);
        self.0.lock().expect("no test panics here").push((one.case, one.site.function.clone()));
    }
}

// Lesson 140
#[test]
fn indices_are_clamped_and_reported() {
    let source = "
        fn look(i: i32) -> f32 { var a = array(1.0, 2.0, 3.0); return a[i]; }
        fn f(i: i32) -> f32 { if i < 100 { return look(i); } return 0.0; }";
    let program = program(source, "f");
    let rows = [1, -1, 3, i32::MAX, i32::MIN].map(i32::cast_unsigned);
    let observer = Outside::default();
    let (resources, options) = (Resources::new(), Options::default());
    let found = program.call::<F32>(5, &rows, &resources, &options, &observer).unwrap().words();
    let found: Vec<f32> = found.into_iter().map(f32::from_bits).collect();
    // No element at `i32::MAX` is read.
    assert_eq!(found, [2.0, 1.0, 3.0, 0.0, 1.0]);
    let each = [1, 2, 4].map(|case| (case, "look".to_owned()));
    assert_eq!(*observer.0.lock().unwrap(), each, "each lane is reported");
    assert_eq!(intervals_of(source), (1.0, 3.0));
}

/// Collects the cases whose index wraps around.
#[derive(Default)]
struct Wrapped(Mutex<Vec<usize>>);

impl Observer<F32> for Wrapped {
    fn wrong(&self, one: &Wrong<'_>) {
        if one.kind == Kind::Wrapped {
            self.0.lock().expect("no test panics here").push(one.case);
        }
    }
}

#[test]
fn a_wrapping_index_is_reported() {
    const QUARTER: u32 = 1 << 30;
    // Each row has an index into an array of 8 elements, and the arguments for which it wraps. The arguments are 0, 1,
    // 2, 2^30 and `u32::MAX`.
    for (index, expected) in [
        ("i * 4u + 1u", &[3][..]),
        ("i << 2u", &[3]),
        ("i + 1u", &[]),
        ("i + u32(-1 * i32(i > 1u))", &[]),
        ("i + 0xffffffffu", &[]),
        ("i * 2654435761u - i * 2654435761u / 8u * 8u", &[]),
        // An index may wrap twice if it comes back to the right number.
        ("i - 5u + 5u", &[]),
        ("u32(i32(i) - 1) + 1u", &[]),
        ("i32(i) + 1", &[]),
        // A hash may wrap. The mask `& 7u` keeps only some bits of the hash.
        ("(i * 1664525u + 1013904223u) & 7u", &[]),
        ("(i * 4u) % 8u", &[]),
        ("min(i * 4u, 7u)", &[]),
        // The index is outside of the array, so the access reports it.
        ("i + 8u", &[]),
        ("i * 4u + 8u", &[]),
        // Only even strides are checked if they are large. A shift by a variable moves bits.
        ("i * 131072u", &[3]),
        ("i << (i >> 28u)", &[]),
        // The index is computed through a call, or through a let-binding.
        ("beyond(4u * i)", &[3]),
        ("-i32(i * 4u)", &[3]),
        // Only the lowest five bits of a shift count.
        ("shifted(i)", &[]),
    ] {
        let source = format!(
            "fn beyond(k: u32) -> u32 {{ let n = k + 2u; return n; }}
             override distance = 33u;
             fn shifted(k: u32) -> u32 {{ return k << distance; }}
             fn f(i: u32) -> f32 {{ var a = array<f32, 8>(); return a[{index}]; }}"
        );
        let program = program(&source, "f");
        let rows = [0, 1, 2, QUARTER, u32::MAX];
        let seen = Wrapped::default();
        let (resources, options) = (Resources::new(), Options::default());
        program.call::<F32>(rows.len(), &rows, &resources, &options, &seen).expect("it runs");
        assert_eq!(*seen.0.lock().unwrap(), expected, "{index}");
    }
}

/// The bounds of `look(i)`, where `i` may be any index from 0 to 2.
fn intervals_of(source: &str) -> (f32, f32) {
    let source =
        format!("{source} fn g(x: f32) -> f32 {{ return look(clamp(i32(sin(x) * 1e4), 0, 2)); }}");
    let (module, info) = module(&source);
    let program = Program::function(&module, &info, "g", &Settings::default()).expect("it lowers");
    let (resources, options) = (Resources::new(), Options::default());
    let found = program.call::<Intervals>(1, &[0], &resources, &options, &()).expect("it runs");
    match found.row(0)[0] {
        Lane::Float(x) => (x.lo(), x.hi()),
        other => panic!("{other:?}"),
    }
}

#[test]
fn buffers_have_the_layout_of_the_host() {
    let source = "
        struct Light { colour: vec3f, power: f32, m: mat3x3f, ids: array<vec4u, 2>, }
        @group(0) @binding(0) var<uniform> light: Light;
        @group(1) @binding(3) var<storage> values: array<f32>;
        fn f(i: u32) -> vec4f {
            return vec4f(light.power, light.m[i][2], values[i], f32(light.ids[1].y + arrayLength(&values)));
        }";
    // The offsets in bytes: colour is at 0, power at 12, m at 16 (with columns of 16 bytes), ids at 64 (16 bytes each).
    let mut bytes = vec![0u8; 96];
    let mut put = |at: usize, word: u32| bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
    put(12, 7f32.to_bits());
    put(16 + 16 + 8, 9f32.to_bits());
    put(64 + 16 + 4, 40);
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, bytes);
    let values: Vec<u8> = [1f32, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    resources.set_buffer(1, 3, values);
    let program = program(source, "f");
    let results =
        program.call::<F32>(2, &[1, 9], &resources, &Options::default(), &()).unwrap().words();
    let found: Vec<f32> = results.into_iter().map(f32::from_bits).collect();
    assert_eq!(found[..4], [7.0, 9.0, 2.0, 43.0]);
    assert_eq!(found[6], 3.0, "an index beyond the end selects the last element");
    resources.set_buffer(0, 0, vec![0; 8]);
    let stop = program.call::<F32>(1, &[0], &resources, &Options::default(), &()).unwrap_err();
    assert_eq!(stop, Stop::Short { name: "light".to_owned(), found: 8, needed: 96 });
}

#[test]
fn a_dispatch_shares_memory_within_workgroups() {
    let source = "
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @group(0) @binding(1) var<storage, read_write> total: atomic<u32>;
        var<workgroup> part: array<u32, 64>;
        @compute @workgroup_size(64)
        fn main(@builtin(local_invocation_index) i: u32, @builtin(global_invocation_id) id: vec3u) {
            part[i] = id.x;
            workgroupBarrier();
            for (var step = 32u; step > 0u; step /= 2u) {
                if i < step { part[i] += part[i + step]; }
                workgroupBarrier();
            }
            out[id.x] = part[0] - id.x;
            let before = atomicAdd(&total, 1u);
            if before == 100u { atomicMax(&total, 1000u); }
        }";
    let (module, info) = module(source);
    let program = Program::entry_point(&module, &info, "main", &Settings::default()).unwrap();
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, vec![0; 4 * 128]);
    resources.set_buffer(0, 1, vec![0; 4]);
    program.dispatch::<F32>([2, 1, 1], &mut resources, &Options::default(), &()).unwrap();
    let word = |bytes: &[u8], k: usize| u32::from_le_bytes(bytes[4 * k..][..4].try_into().unwrap());
    let out = resources.buffer(0, 0).unwrap();
    for id in 0..128usize {
        let sum: u32 = if id < 64 { (0..64).sum() } else { (64..128).sum() };
        assert_eq!(word(out, id), sum - id as u32);
    }
    // Each operation runs in all lanes before the next operation. An atomic runs lane after lane.
    assert_eq!(word(resources.buffer(0, 1).unwrap(), 0), 1000);
}

#[test]
fn storage_keeps_doubles_between_workgroups() {
    let source = "
        @group(0) @binding(0) var<storage, read_write> x: array<f32>;
        @compute @workgroup_size(1) fn main() { x[0] = x[0] + 1e-9; x[1] = (x[0] - 1.0) * 1e9; }";
    let (module, info) = module(source);
    let program = Program::entry_point(&module, &info, "main", &Settings::default()).unwrap();
    let run = |double: bool| {
        let mut resources = Resources::new();
        let bytes: Vec<u8> = [1f32, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        resources.set_buffer(0, 0, bytes);
        let options = Options::default();
        if double {
            program.dispatch::<F64>([3, 1, 1], &mut resources, &options, &()).unwrap();
        } else {
            program.dispatch::<F32>([3, 1, 1], &mut resources, &options, &()).unwrap();
        }
        let bytes: [u8; 4] = resources.buffer(0, 0).unwrap()[4..].try_into().unwrap();
        f32::from_le_bytes(bytes)
    };
    assert_eq!(run(false), 0.0);
    assert!((run(true) - 3.0).abs() < 1e-6);
}

#[test]
fn overrides_have_defaults_and_values() {
    let source = "
        override scale: f32 = 2.0;
        @id(7) override count: u32 = 3u;
        override both: f32 = scale * 10.0;
        fn f(x: f32) -> f32 { return x * scale + f32(count) + both; }";
    assert_eq!(floats(source, &[1.0]), [25.0]);
    let (module, info) = module(source);
    let overrides = [("scale".to_owned(), 3.0), ("7".to_owned(), 5.0)].into();
    let settings = Settings { overrides, ..Settings::default() };
    let program = Program::function(&module, &info, "f", &settings).unwrap();
    let found = program
        .call::<F32>(1, &[1f32.to_bits()], &Resources::new(), &Options::default(), &())
        .unwrap();
    assert_eq!(found.words(), [(3.0f32 + 5.0 + 30.0).to_bits()]);
}

#[test]
fn flattened_parameters_and_results() {
    let source = "
        struct In { a: vec2f, b: array<u32, 2>, c: bool, }
        struct Out { x: i32, y: bool, z: f32, }
        fn f(s: In, k: i32) -> Out { return Out(k + i32(s.b[1]), !s.c, s.a.y); }";
    let program = program(source, "f");
    use Scalar::{Bool, F32, I32, U32};
    assert_eq!(program.parameters(), [F32, F32, U32, U32, Bool, I32]);
    assert_eq!(program.results(), [I32, Bool, F32]);
    let row = [0, 5f32.to_bits(), 1, 2, 1, (-4i32).cast_unsigned()];
    assert_eq!(words(source, &row), [(-2i32).cast_unsigned(), 0, 5f32.to_bits()]);
}

#[test]
fn half_precision_rounds_each_operation() {
    let source = "enable f16;
        fn f(x: f16, y: f16) -> f32 { return f32(x * y + x); }";
    let half = |x: f32| half::f16::from_f32(x);
    let (x, y) = (half(1.1), half(2.3));
    let product = half(x.to_f32() * y.to_f32());
    let sum = half(product.to_f32() + x.to_f32());
    let row = [u32::from(x.to_bits()), u32::from(y.to_bits())];
    assert_eq!(words(source, &row), [sum.to_f32().to_bits()]);
    let blend = "enable f16;
        fn f(x: f16, y: f16) -> f32 { return f32(mix(x, y, 0.5h)); }";
    let (program, options) = (program(blend, "f"), Options::default());
    let stop = program.call::<Intervals>(1, &row, &Resources::new(), &options, &()).unwrap_err();
    assert!(matches!(stop, Stop::NoRule { what: "this operation on `f16` values", .. }));
}

#[test]
fn subnormals_are_flushed_where_asked() {
    let source = "fn f(x: f32, y: f32) -> f32 { return x * y * 1e20; }";
    let rows: Vec<u32> = [1e-25f32, 1e-19, 1e-42, 1.0].map(f32::to_bits).to_vec();
    let flush = Options { flush: true, ..Options::default() };
    let program = program(source, "f");
    let found =
        program.call::<F32>(2, &rows, &Resources::new(), &flush, &()).expect("it runs").words();
    assert_eq!(found, [0, 0]);
    let kept = floats(source, &[1e-25, 1e-19, 1e-42, 1.0]);
    assert!(kept[0] > 0.9e-24 && kept[1] > 0.9e-22);
}

/// Calls a function body in a mode that flushes subnormal numbers: "Any inputs or outputs of operations listed in
/// 15.7.4 Floating Point Accuracy may be flushed to zero", and "other operations are required to preserve subnormal
/// numbers" (15.7.2).
fn flushed(body: &str) -> Vec<u32> {
    let source = format!(
        "@group(0) @binding(0) var<storage, read> data: array<f32, 3>;
         struct S {{ a: f32, b: vec2f }}
         fn keep(x: f32) -> f32 {{ return x; }}
         fn f(x: f32) -> vec2u {{ {body} }}"
    );
    let rows = [1e-40f32.to_bits()];
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, 1e-40f32.to_le_bytes().repeat(3));
    let flush = Options { flush: true, ..Options::default() };
    let program = program(&source, "f");
    program.call::<F32>(1, &rows, &resources, &flush, &()).expect("it runs").words()
}

#[test]
fn moves_keep_subnormals() {
    let x = 1e-40f32.to_bits();
    for (body, expected) in [
        ("return vec2u(bitcast<u32>(x), 1u);", [x, 1]),
        ("let v = vec3f(x, 1.0, 2.0).zyx; return bitcast<vec2u>(v.zy);", [x, 1.0f32.to_bits()]),
        (
            "return bitcast<vec2u>(vec2f(select(1.0, x, x < 1.0), select(x, 1.0, x < 1.0)));",
            [x, 1.0f32.to_bits()],
        ),
        (
            "var y = 0.0; y = x; var a = array<f32, 2>(); a[1] = y; return bitcast<vec2u>(vec2f(a[1], keep(y)));",
            [x, x],
        ),
        ("let s = S(x, vec2f(x)); return bitcast<vec2u>(vec2f(s.a, s.b.y));", [x, x]),
        ("let k = u32(x + 2.0); return bitcast<vec2u>(vec2f(data[k], data[0]));", [x, x]),
        ("return bitcast<vec2u>(vec2f(bitcast<f32>(71362u), 1e-40));", [71362, x]),
        // The computed number is flushed, but `x` itself keeps its bits.
        ("let y = x * 2.0; return bitcast<vec2u>(vec2f(x, y));", [x, 0]),
        ("let y = x > 1e-45; return vec2u(bitcast<u32>(x), u32(y));", [x, 0]),
    ] {
        assert_eq!(flushed(body), expected, "{body}");
    }
}

#[test]
fn operations_flush_operands_and_results() {
    for expression in [
        "x * 1e10",
        "x + x",
        "x - 0.0",
        "-x",
        "abs(x)",
        "max(x, 0.0)",
        "clamp(x, 0.0, 1.0)",
        "ceil(x)",
        "sign(x)",
        "x / 1e-30",
        "1.5e-38 * 0.5",
        "data[1] * 1e10",
        "f32(x > 0.0)",
        "f32(x == 2e-40) - 1.0",
        "ldexp(x, 100)",
        "dot(vec2f(x), vec2f(1e20))",
    ] {
        let expression = expression.replace("1.5e-38", "(x + 1.5e-38)");
        let body = format!("return vec2u(bitcast<u32>(abs({expression})), 0u);");
        assert_eq!(flushed(&body), [0, 0], "{expression}");
    }
}

#[test]
fn products_and_sums_are_fused_where_asked() {
    let source = "fn f(a: f32, b: f32, c: f32) -> vec3f {
        return vec3f(a * b + c, c - a * b, a * b - c);
    }";
    let (module, info) = module(source);
    let settings = Settings { contract: true, ..Settings::default() };
    let program = Program::function(&module, &info, "f", &settings).unwrap();
    let (a, b) = (1.000_000_1f32, 0.999_999_9f32);
    let c = -(a * b);
    let rows = [a, b, c].map(f32::to_bits);
    let found = program.call::<F32>(1, &rows, &Resources::new(), &Options::default(), &()).unwrap();
    let found: Vec<f32> = found.words().into_iter().map(f32::from_bits).collect();
    assert_eq!(found, [a.mul_add(b, c), (-a).mul_add(b, c), a.mul_add(b, -c)]);
    assert_ne!(found[0], 0.0);
    assert_eq!(floats(source, &[a, b, c])[0], 0.0);
    assert!((doubles(source, &[a, b, c])[0] - f64::from(found[0])).abs() < 1e-20);
    assert!(intervals(source, &[a, b, c])[0].contains(f64::from(found[0])));
}

#[test]
fn sizes_may_be_override_expressions() {
    let source = "
        override n: u32 = 2u;
        const unit = 4;
        override wide: u32 = n * unit + 0u;
        var<workgroup> part: array<u32, wide>;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(n * 4u)
        fn main(@builtin(local_invocation_index) i: u32) {
            part[i] = i * i;
            workgroupBarrier();
            out[i] = part[wide - 1u - i];
        }";
    let (module, info) = module(source);
    for (n, width) in [(None, 8usize), (Some(3.0), 12)] {
        let overrides = n.map(|n| ("n".to_owned(), n)).into_iter().collect();
        let settings = Settings { overrides, ..Settings::default() };
        let program = Program::entry_point(&module, &info, "main", &settings).unwrap();
        let mut resources = Resources::new();
        resources.set_buffer(0, 0, vec![0; 4 * width]);
        program.dispatch::<F32>([1, 1, 1], &mut resources, &Options::default(), &()).unwrap();
        let words = resources.buffer(0, 0).unwrap().chunks(4);
        let found: Vec<u32> =
            words.map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
        let expected: Vec<u32> = (0..width as u32).rev().map(|i| i * i).collect();
        assert_eq!(found, expected);
    }
}
