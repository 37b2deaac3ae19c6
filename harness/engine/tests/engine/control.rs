//! Compares WGSL's branches and loops with the same branches and loops in Rust. The cases of a call take different
//! branches.

use karat_engine::{F32, Options, Program, Resources, Settings};

use crate::common::{call, floats, program, words};

#[test]
fn branches_differ_by_lane() {
    let source = "
        fn f(x: i32) -> i32 {
            if x < 0 { return -x; }
            if x % 2 == 0 { return x * 10; } else if x % 3 == 0 { return x * 100; }
            return x;
        }";
    let rows: Vec<u32> = (-600i32..700).map(i32::cast_unsigned).collect();
    let expected: Vec<u32> = (-600i32..700)
        .map(|x| {
            if x < 0 {
                -x
            } else if x % 2 == 0 {
                x * 10
            } else if x % 3 == 0 {
                x * 100
            } else {
                x
            }
        })
        .map(i32::cast_unsigned)
        .collect();
    assert_eq!(words(source, &rows), expected);
}

fn walked(n: u32) -> u32 {
    let mut sum = 0u32;
    let mut i = 0u32;
    'outer: loop {
        if i >= n {
            break;
        }
        i += 1;
        if i % 5 == 3 {
            continue;
        }
        let mut j = 0u32;
        while j < i {
            j += 1;
            if j == 7 {
                continue;
            }
            if (i ^ j) & 15 == 9 {
                break;
            }
            if sum > 4000 {
                break 'outer;
            }
            sum += i * j % 13;
        }
        sum += 1;
    }
    sum
}

#[test]
fn nested_loops_leave_at_different_times() {
    let source = "
        fn f(n: u32) -> u32 {
            var sum = 0u;
            var i = 0u;
            loop {
                if i >= n { break; }
                i += 1u;
                if i % 5u == 3u { continue; }
                var j = 0u;
                while j < i {
                    j += 1u;
                    if j == 7u { continue; }
                    if ((i ^ j) & 15u) == 9u { break; }
                    if sum > 4000u { return sum; }
                    sum += i * j % 13u;
                }
                sum += 1u;
            }
            return sum;
        }";
    let rows: Vec<u32> = (0..301).map(|i| (i * 7919) % 90).collect();
    let expected: Vec<u32> = rows.iter().map(|&n| walked(n)).collect();
    assert_eq!(words(source, &rows), expected);
}

#[test]
fn loops_with_continuing_and_break_if() {
    let source = "
        fn f(n: u32) -> u32 {
            var i = 0u;
            var odd = 0u;
            loop {
                if i % 2u == 0u { continue; }
                odd += i;
                continuing {
                    i += 1u;
                    break if i > n;
                }
            }
            return odd;
        }";
    let rows: Vec<u32> = (0..50).collect();
    let expected: Vec<u32> = rows.iter().map(|&n| (0..=n).filter(|i| i % 2 == 1).sum()).collect();
    assert_eq!(words(source, &rows), expected);
}

#[test]
fn switches_select_break_and_default() {
    let source = "
        fn f(x: i32) -> i32 {
            var y = 0;
            switch x {
                case 0 { y = 5; }
                case 1, 2: { y = 6; if x == 2 { break; } y = 7; }
                default { y = -1; }
                case -3 { return 99; }
            }
            for (var i = 0; i < 4; i++) {
                switch i + x {
                    case 3: { continue; }
                    case 5: { y += 1000; break; }
                    default: { }
                }
                y += 10;
            }
            return y;
        }";
    let rows: Vec<u32> = (-4i32..6).map(i32::cast_unsigned).collect();
    let expected = (-4i32..6).map(|x| {
        let mut y = match x {
            0 => 5,
            1 => 7,
            2 => 6,
            -3 => return 99,
            _ => -1,
        };
        for i in 0..4 {
            match i + x {
                3 => continue,
                5 => y += 1000,
                _ => {}
            }
            y += 10;
        }
        y
    });
    let expected: Vec<u32> = expected.map(i32::cast_unsigned).collect();
    assert_eq!(words(source, &rows), expected);
}

#[test]
fn short_circuits_and_calls() {
    let source = "
        var<private> calls: u32;
        fn touch(x: bool) -> bool { calls += 1u; return x; }
        fn f(a: u32, b: u32) -> u32 {
            let both = touch(a != 0u) && touch(b != 0u);
            let any = touch(a != 0u) || touch(b != 0u);
            return calls * 4u + u32(both) * 2u + u32(any);
        }";
    let result = words(source, &[0, 0, 0, 1, 1, 0, 1, 1]);
    assert_eq!(result, [3 * 4, 3 * 4 + 1, 3 * 4 + 1, 3 * 4 + 3]);
}

#[test]
fn a_call_in_a_loop_starts_anew_each_time() {
    let source = "
        fn count(n: u32) -> u32 {
            var sum: u32;
            for (var i = 0u; i < n; i++) { if i == 3u { return 100u; } sum += i; }
            return sum;
        }
        fn f(n: u32) -> u32 {
            var all = 0u;
            for (var i = 0u; i < n; i++) { all += count(i); }
            return all;
        }";
    let expected: Vec<u32> =
        (0..9u32).map(|n| (0..n).map(|i| if i > 3 { 100 } else { (0..i).sum() }).sum()).collect();
    assert_eq!(words(source, &(0..9).collect::<Vec<_>>()), expected);
}

/// The engine removes a case that runs too many iterations, whatever construct the loop is in. The removal doesn't
/// change the results of the other cases.
#[test]
fn cases_with_long_loops_are_left_out() {
    let source = "
        fn inner(n: u32) -> u32 {
            var sum = 0u;
            for (var j = 0u; j < n % 5u; j++) { if j == 3u { return sum; } sum += j + 1u; }
            return sum;
        }
        fn f(n: u32) -> u32 {
            var sum = n;
            if n % 7u == 0u { sum += 100u; } else {
                switch n % 3u {
                    case 0u: { for (var i = 0u; i < n; i++) { sum += inner(i); } }
                    case 1u: { loop { if sum > 2u * n { break; } sum += 3u; } }
                    default: { sum = 5u; }
                }
                sum += 1000u;
            }
            for (var i = 0u; i < n % 11u; i++) { sum ^= i; }
            return sum;
        }";
    let program = program(source, "f");
    let rows: Vec<u32> = (0..900).collect();
    let plain = call::<F32>(&program, rows.len(), &rows).words();
    let options = |leaves| Options { fuel: 250, leaves, ..Options::default() };
    let alone =
        |n: &u32| program.call::<F32>(1, &[*n], &Resources::new(), &options(false), &()).is_err();
    let long: Vec<usize> = rows.iter().filter(|n| alone(n)).map(|n| *n as usize).collect();
    assert!(long.len() > 100 && long.len() < 800, "{} are long", long.len());
    let left = program.call::<F32>(rows.len(), &rows, &Resources::new(), &options(true), &());
    let left = left.expect("the call removes these cases");
    let mut told: Vec<usize> = left.long().iter().map(|(case, _)| *case).collect();
    told.sort_unstable();
    assert_eq!(told, long);
    let words = left.words();
    for n in rows.iter().filter(|n| !alone(n)) {
        assert_eq!(words[*n as usize], plain[*n as usize], "{n}");
    }
    // In intervals, such a case still stops the call.
    let first = [u32::try_from(long[0]).expect("it is small")];
    let stopped =
        program.call::<karat_engine::Intervals>(1, &first, &Resources::new(), &options(true), &());
    assert!(stopped.is_err());
}

#[test]
fn pointers_to_variables_are_parameters() {
    let source = "
        struct S { a: f32, b: vec3f, }
        fn swap(x: ptr<function, f32>, y: ptr<function, f32>) { let t = *x; *x = *y; *y = t; }
        fn grow(s: ptr<function, S>, by: f32) { (*s).b.y += by; (*s).a = by; }
        fn f(a: f32, b: f32) -> vec3f {
            var x = a; var y = b;
            if a < b { swap(&x, &y); }
            var s = S(1.0, vec3f(x, y, 0.0));
            grow(&s, y);
            return s.b * s.a;
        }";
    assert_eq!(
        floats(source, &[1.0, 2.0, 5.0, 3.0]),
        [2.0 * 1.0, 2.0, 0.0, 5.0 * 3.0, 6.0 * 3.0, 0.0]
    );
}

/// If a program begins with a loop, the registers of its arguments must stay in use until the loop ends, and not only
/// until the last operation that reads them.
#[test]
fn a_program_may_begin_with_a_loop() {
    let source = "@group(0) @binding(0) var<storage, read_write> b: array<u32, 16>;\n\
                  @compute @workgroup_size(4) fn main(@builtin(local_invocation_index) l: u32) {\n    \
                  while b[l] < 8u { b[l] += 1u; b[4u + l] += l; b[8u + l] += b[12u] + b[13u] * b[14u]; }\n}";
    let (module, info) = crate::common::module(source);
    let program = Program::entry_point(&module, &info, "main", &Settings::default());
    let mut resources = Resources::new();
    let words = [0_u32, 1, 2, 3, 0, 0, 0, 0, 0, 0, 0, 0, 5, 7, 11, 0];
    resources.set_buffer(0, 0, words.map(u32::to_le_bytes).concat());
    let program = program.expect("it lowers");
    program.dispatch::<F32>([1; 3], &mut resources, &Options::default(), &()).expect("it runs");
    let left = resources.buffer(0, 0).expect("it is bound").as_chunks::<4>().0;
    for l in 0..4 {
        let rounds = 8 - l;
        let found = [0, 4, 8].map(|at| u32::from_le_bytes(left[(at + l) as usize]));
        assert_eq!(found, [8, rounds * l, rounds * (5 + 7 * 11)], "{l}");
    }
}
