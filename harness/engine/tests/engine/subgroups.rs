//! Tests subgroup operations, in which lanes get values of other lanes.

use karat_engine::{
    Choice, Elsewhere, F32, Options, Priorities, Program, Resources, Schedule, Settings,
};

use crate::common::module;

const LANES: u32 = 64;

/// Runs a shader's body in one workgroup. `schedule` sets the size of subgroups. Returns the words of the buffer `d`
/// after the run.
fn run(body: &str, schedule: Schedule) -> Vec<u32> {
    let source = format!(
        "@group(0) @binding(0) var<storage, read_write> d: array<u32>;
         var<workgroup> w: array<u32, {LANES}>;
         @compute @workgroup_size({LANES}) fn main(@builtin(local_invocation_index) i: u32,
             @builtin(subgroup_size) size: u32, @builtin(subgroup_invocation_id) own: u32,
             @builtin(subgroup_id) group: u32, @builtin(num_subgroups) groups: u32) {{
             let x = (i * 7u + 3u) % 13u;
             let f = f32(x) - 5.0;
             {body}
         }}"
    );
    let (module, info) = module(&source);
    let program = Program::entry_point(&module, &info, "main", &Settings::default());
    let program = program.unwrap_or_else(|refusal| panic!("{refusal}\n{source}"));
    assert!(program.has_subgroups());
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, vec![0xff; 4 * LANES as usize]);
    let options = Options { schedule, ..Options::default() };
    program.dispatch::<F32>([1, 1, 1], &mut resources, &options, &()).expect("it runs");
    let bytes = resources.buffer(0, 0).expect("it was bound");
    let words = bytes.chunks_exact(4).map(|word| word.try_into().expect("four bytes"));
    words.map(u32::from_le_bytes).collect()
}

fn x(i: u32) -> u32 {
    (i * 7 + 3) % 13
}

/// A lane: the number of its subgroup's first lane, the subgroup's size, and the lane's number in the subgroup.
type Lane = (u32, u32, u32);

#[test]
fn subgroup_operations_exchange_values_between_lanes() {
    let all = |(first, size, _): Lane| (first..first + size).map(x);
    let f = |i: u32| x(i) as f32 - 5.0;
    let floats = |(first, size, _): Lane| (first..first + size).map(f);
    let before = |(first, _, own): Lane| (first..first + own).map(x);
    let cases: &[(&str, &dyn Fn(Lane) -> u32)] = &[
        ("d[i] = size;", &|(_, size, _)| size),
        ("d[i] = own;", &|(.., own)| own),
        ("d[i] = group;", &|(first, size, _)| first / size),
        ("d[i] = groups;", &|(_, size, _)| LANES / size),
        ("d[i] = subgroupAdd(x);", &|lane| all(lane).sum()),
        ("d[i] = subgroupMul(x | 1u);", &|lane| all(lane).fold(1, |a, b| a.wrapping_mul(b | 1))),
        ("d[i] = subgroupMin(x);", &|lane| all(lane).min().unwrap_or(0)),
        ("d[i] = subgroupMax(x);", &|lane| all(lane).max().unwrap_or(0)),
        ("d[i] = subgroupAnd(x | 4u);", &|lane| all(lane).fold(u32::MAX, |a, b| a & (b | 4))),
        ("d[i] = subgroupOr(x);", &|lane| all(lane).fold(0, |a, b| a | b)),
        ("d[i] = subgroupXor(x);", &|lane| all(lane).fold(0, |a, b| a ^ b)),
        ("d[i] = u32(subgroupAll(x < 12u));", &|lane| u32::from(all(lane).all(|x| x < 12))),
        ("d[i] = u32(subgroupAny(x == 12u));", &|lane| u32::from(all(lane).any(|x| x == 12))),
        ("d[i] = subgroupExclusiveAdd(x);", &|lane| before(lane).sum()),
        ("d[i] = subgroupInclusiveAdd(x);", &|lane| before(lane).sum::<u32>() + x(lane.0 + lane.2)),
        ("d[i] = subgroupExclusiveMul(x | 1u);", &|lane| {
            before(lane).fold(1, |a, b| a.wrapping_mul(b | 1))
        }),
        ("d[i] = subgroupBroadcast(x, 2u);", &|(first, ..)| x(first + 2)),
        ("d[i] = subgroupBroadcastFirst(x);", &|(first, ..)| x(first)),
        ("d[i] = subgroupShuffle(x, size - 1u - own);", &|(first, size, own)| {
            x(first + size - 1 - own)
        }),
        ("d[i] = subgroupShuffleXor(x, 3u);", &|(first, _, own)| x(first + (own ^ 3))),
        ("d[i] = select(0u, subgroupShuffleUp(x, 1u), own > 0u);", &|(first, _, own)| {
            if own > 0 { x(first + own - 1) } else { 0 }
        }),
        ("d[i] = select(0u, subgroupShuffleDown(x, 1u), own + 1u < size);", &|lane| {
            let (first, size, own) = lane;
            if own + 1 < size { x(first + own + 1) } else { 0 }
        }),
        ("d[i] = quadBroadcast(x, 1u);", &|(first, _, own)| x(first + (own & !3) + 1)),
        ("d[i] = quadSwapX(x);", &|(first, _, own)| x(first + (own ^ 1))),
        ("d[i] = quadSwapY(x);", &|(first, _, own)| x(first + (own ^ 2))),
        ("d[i] = quadSwapDiagonal(x);", &|(first, _, own)| x(first + (own ^ 3))),
        ("d[i] = subgroupBallot(x < 6u).x;", &|(first, size, _)| {
            (0..size.min(32)).map(|k| u32::from(x(first + k) < 6) << k).sum()
        }),
        ("d[i] = subgroupBallot(x < 6u).y;", &|(first, size, _)| {
            (32..size).map(|k| u32::from(x(first + k) < 6) << (k - 32)).sum()
        }),
        ("d[i] = bitcast<u32>(subgroupMax(vec2f(f, -f)).y);", &|lane| {
            floats(lane).map(|f| -f).fold(f32::MIN, f32::max).to_bits()
        }),
        ("d[i] = bitcast<u32>(subgroupMin(i32(f)));", &|lane| {
            floats(lane).map(|f| f as i32).min().unwrap_or(0).cast_unsigned()
        }),
        ("d[i] = bitcast<u32>(subgroupAdd(f));", &|lane| floats(lane).sum::<f32>().to_bits()),
        // Inactive lanes contribute nothing.
        ("d[i] = 0u; if (x & 1u) == 1u { d[i] = subgroupAdd(x); }", &|lane| {
            let odd = |x: &u32| x & 1 == 1;
            if odd(&x(lane.0 + lane.2)) { all(lane).filter(odd).sum() } else { 0 }
        }),
        ("d[i] = 0u; if own >= 2u { d[i] = subgroupBroadcastFirst(i); }", &|(first, _, own)| {
            if own >= 2 { first + 2 } else { 0 }
        }),
        // Values stay the same across a barrier.
        ("w[i] = x; workgroupBarrier(); let y = w[63u - i]; d[i] = subgroupAdd(y) + x;", &|lane| {
            let (first, size, own) = lane;
            (first..first + size).map(|i| x(63 - i)).sum::<u32>() + x(first + own)
        }),
    ];
    for (body, expected) in cases {
        for subgroup in [4, 8, 16, 32, 64, 128] {
            for (together, priorities) in [
                (usize::MAX, Priorities::ByNumber),
                (1, Priorities::Backwards),
                (1, Priorities::Shuffled(5)),
                (8, Priorities::Shuffled(9)),
            ] {
                let schedule = Schedule { together, priorities, subgroup, ..Schedule::default() };
                let found = run(body, schedule.clone());
                for (i, found) in (0..LANES).zip(found) {
                    // If the workgroup ends inside of a subgroup, the subgroup is smaller.
                    let size = subgroup.min(LANES);
                    if subgroup > LANES && (body.contains("size") || body.contains("groups")) {
                        continue;
                    }
                    let (first, own) = (i / size * size, i % size);
                    assert_eq!(found, expected((first, size, own)), "{body} {i}, {schedule:?}");
                }
            }
        }
    }
}

/// A read from a lane that doesn't exist may return any value, like a read with an index outside of an array.
#[test]
fn a_lane_that_is_not_there() {
    let zero = Options {
        outside: Choice { reads: Elsewhere::Number(0), drops: true },
        schedule: Schedule { subgroup: 8, ..Schedule::default() },
        ..Options::default()
    };
    let source = "@group(0) @binding(0) var<storage, read_write> d: array<u32>;
        @compute @workgroup_size(16) fn main(@builtin(local_invocation_index) i: u32) {
            d[i] = subgroupShuffleDown(i, 2u);
        }";
    let (module, info) = module(source);
    let program =
        Program::entry_point(&module, &info, "main", &Settings::default()).expect("valid");
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, vec![0; 64]);
    program.dispatch::<F32>([1, 1, 1], &mut resources, &zero, &()).expect("it runs");
    let bytes = resources.buffer(0, 0).expect("it was bound");
    let words: Vec<u8> = bytes.iter().step_by(4).copied().collect();
    assert_eq!(words, [2, 3, 4, 5, 6, 7, 0, 0, 10, 11, 12, 13, 14, 15, 0, 0]);
    let seen = program.observe_races([1, 1, 1], &mut resources, &Options::default(), None);
    let outside = seen.expect("it runs").outside;
    assert_eq!((outside.len(), outside[0].count, outside[0].invocation), (1, 2, 14));
    let of_eight = Options { outside: Choice::default(), ..zero.clone() };
    let seen = program.observe_races([1, 1, 1], &mut resources, &of_eight, None);
    let outside = seen.expect("it runs").outside;
    assert_eq!((outside.len(), outside[0].count, outside[0].invocation), (1, 4, 6));
}

#[test]
fn an_operation_that_some_of_a_subgroup_miss() {
    let source = "@group(0) @binding(0) var<storage, read_write> d: array<u32>;
        @compute @workgroup_size(64) fn main(@builtin(local_invocation_index) i: u32) {
            var x = 0u;
            if i < 32u { x = subgroupAdd(i); }
            if i < 40u {
                x = subgroupAdd(x);
            }
            d[i] = x;
        }";
    let (module, info) = module(source);
    let program =
        Program::entry_point(&module, &info, "main", &Settings::default()).expect("valid");
    let mut resources = Resources::new();
    resources.set_buffer(0, 0, vec![0; 256]);
    let seen = program.observe_races([1, 1, 1], &mut resources, &Options::default(), None);
    let seen = seen.expect("it runs");
    // In the first branch, the subgroups of 32 are complete.
    assert_eq!(seen.divergences.len(), 1);
    let one = &seen.divergences[0];
    assert_eq!((one.reached, one.missing, one.count), (32, 40, 24));
    assert!(one.parted.as_ref().is_some_and(|site| site.span.location(source).line_number == 5));
}

/// The engine can't call a function with subgroup operations directly, without an entry point, because the cases of a
/// call form no subgroup.
#[test]
fn a_function_has_no_subgroup() {
    let (module, info) = module("fn sum(x: f32) -> f32 { return subgroupAdd(x); }");
    let refusal = Program::function(&module, &info, "sum", &Settings::default());
    assert!(refusal.is_err_and(|refusal| refusal.to_string().contains("subgroup operation")));
}
