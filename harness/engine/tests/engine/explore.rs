//! Tests [`Explorer`]: the orders that it chooses have the same results as all orders together.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use karat_engine::{Explorer, Options, Program, Resources, Schedule, Settings, Stores};

use crate::common::module;

#[derive(Clone, Copy, Debug)]
enum Atomic {
    Load(usize),
    Store(usize, u32),
    /// An addition. The `bool` is `true` if its result is used.
    Add(usize, u32, bool),
    Max(usize, u32, bool),
    Exchange(usize, u32),
}

const WORDS: usize = 2;

/// Applies an atomic to memory, and returns its result.
fn run(atomic: Atomic, memory: &mut [u32; WORDS]) -> Option<u32> {
    match atomic {
        Atomic::Load(at) => Some(memory[at]),
        Atomic::Store(at, x) => {
            memory[at] = x;
            None
        }
        Atomic::Add(at, x, used) => {
            let old = memory[at];
            memory[at] += x;
            used.then_some(old)
        }
        Atomic::Max(at, x, used) => {
            let old = memory[at];
            memory[at] = old.max(x);
            used.then_some(old)
        }
        Atomic::Exchange(at, x) => Some(std::mem::replace(&mut memory[at], x)),
    }
}

fn text(atomics: &[Vec<Atomic>]) -> String {
    let mut text = "@group(0) @binding(0) var<storage, read_write> a: array<atomic<u32>, 2>;\n\
                    @group(0) @binding(1) var<storage, read_write> d: array<u32>;\n\
                    @compute @workgroup_size(1) fn main(@builtin(workgroup_id) g: vec3u) {\n"
        .to_owned();
    for (who, own) in atomics.iter().enumerate() {
        writeln!(text, "    if g.x == {who}u {{").expect("text takes text");
        for (at, atomic) in own.iter().enumerate() {
            let (call, used) = match atomic {
                Atomic::Load(k) => (format!("atomicLoad(&a[{k}])"), true),
                Atomic::Store(k, x) => (format!("atomicStore(&a[{k}], {x}u)"), false),
                Atomic::Add(k, x, used) => (format!("atomicAdd(&a[{k}], {x}u)"), *used),
                Atomic::Max(k, x, used) => (format!("atomicMax(&a[{k}], {x}u)"), *used),
                Atomic::Exchange(k, x) => (format!("atomicExchange(&a[{k}], {x}u)"), true),
            };
            match used {
                true => writeln!(text, "        d[{}] = {call};", 4 * who + at),
                false => writeln!(text, "        {call};"),
            }
            .expect("text takes text");
        }
        text += "    }\n";
    }
    text + "}\n"
}

/// The results of a run: the words of memory after the run, then the value that each atomic returned.
type Left = Vec<u32>;

/// Tries all orders one by one, and returns their results. If `late` is set, a store may also take effect later, at any
/// time that WGSL allows.
fn naive(atomics: &[Vec<Atomic>], late: bool) -> BTreeSet<Left> {
    struct State {
        memory: [u32; WORDS],
        at: Vec<usize>,
        results: Vec<u32>,
        /// The stores that haven't taken effect yet.
        stores: Vec<(usize, Atomic)>,
    }
    fn word(atomic: Atomic) -> usize {
        match atomic {
            Atomic::Load(at)
            | Atomic::Store(at, _)
            | Atomic::Add(at, ..)
            | Atomic::Max(at, ..)
            | Atomic::Exchange(at, _) => at,
        }
    }
    fn go(all: &[Vec<Atomic>], late: bool, state: State, to: &mut BTreeSet<Left>) {
        let mut ended = state.stores.is_empty();
        for (who, own) in all.iter().enumerate() {
            let Some(atomic) = own.get(state.at[who]).copied() else { continue };
            ended = false;
            let waiting =
                state.stores.iter().find(|(by, store)| *by == who && word(*store) == word(atomic));
            let State { mut memory, mut at, mut results, mut stores } = State {
                at: state.at.clone(),
                results: state.results.clone(),
                stores: state.stores.clone(),
                ..state
            };
            let has_result = matches!(
                atomic,
                Atomic::Load(_)
                    | Atomic::Exchange(..)
                    | Atomic::Add(_, _, true)
                    | Atomic::Max(_, _, true)
            );
            let result = match (waiting, atomic) {
                (Some((_, Atomic::Store(_, x))), Atomic::Load(_)) => Some(*x),
                (Some(_), _) => continue,
                (None, _) if late && !has_result => {
                    stores.push((who, atomic));
                    None
                }
                (None, _) => run(atomic, &mut memory),
            };
            if let Some(result) = result {
                results[4 * who + at[who]] = result;
            }
            at[who] += 1;
            go(all, late, State { memory, at, results, stores }, to);
        }
        for number in 0..state.stores.len() {
            let mut stores = state.stores.clone();
            let (_, store) = stores.remove(number);
            let mut memory = state.memory;
            run(store, &mut memory);
            let (at, results) = (state.at.clone(), state.results.clone());
            go(all, late, State { memory, at, results, stores }, to);
        }
        if ended {
            to.insert([&state.memory[..], &state.results].concat());
        }
    }
    let mut all = BTreeSet::new();
    let (at, results) = (vec![0; atomics.len()], vec![0; 4 * atomics.len()]);
    go(atomics, late, State { memory: [0; WORDS], at, results, stores: Vec::new() }, &mut all);
    all
}

/// The results of the orders that the explorer chooses, and the number of these orders.
fn explored(source: &str, groups: usize, stores: Stores) -> (BTreeSet<Left>, usize) {
    let (module, info) = module(source);
    let program = Program::entry_point(&module, &info, "main", &Settings::default());
    let program = program.unwrap_or_else(|refusal| panic!("{refusal}\n{source}"));
    let schedule = Schedule { stores, ..Schedule::one_by_one() };
    let options = Options { schedule, ..Options::default() };
    let mut explorer = Explorer::default();
    let (mut all, mut runs) = (BTreeSet::new(), 0);
    while explorer.begin() {
        let mut resources = Resources::new();
        resources.set_buffer(0, 0, vec![0; 8]);
        resources.set_buffer(0, 1, vec![0; 16 * groups]);
        let workgroups = [groups as u32, 1, 1];
        let words = |resources: &Resources| -> Vec<u32> {
            let of =
                |binding| resources.buffer(0, binding).expect("it is bound").as_chunks::<4>().0;
            of(0).iter().chain(of(1)).map(|word| u32::from_le_bytes(*word)).collect()
        };
        let seen = program.explore(workgroups, &mut resources, &options, &mut explorer);
        seen.unwrap_or_else(|stop| panic!("{stop}\n{source}"));
        assert!(runs < 100_000, "{source}");
        if explorer.is_cut() {
            continue;
        }
        runs += 1;
        let left = words(&resources);
        // Running the recorded turns gives the same result again.
        let turns = explorer.turns().pop().expect("there was a dispatch");
        let again = Schedule { turns, stores, ..Schedule::one_by_one() };
        let mut resources = Resources::new();
        resources.set_buffer(0, 0, vec![0; 8]);
        resources.set_buffer(0, 1, vec![0; 16 * groups]);
        let options = Options { schedule: again, ..Options::default() };
        program.observe_races(workgroups, &mut resources, &options, None).expect("it ran");
        assert_eq!(words(&resources), left, "{source}");
        all.insert(left);
    }
    (all, runs)
}

fn generated(state: &mut u64, invocations: usize, atomics: usize) -> Vec<Vec<Atomic>> {
    let mut draw = |count: u64| {
        *state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) % count
    };
    let mut one = || {
        let (at, x, used) = (draw(WORDS as u64) as usize, 1 + draw(3) as u32, draw(2) == 0);
        match draw(5) {
            0 | 1 => Atomic::Load(at),
            2 => Atomic::Store(at, x),
            3 if x > 1 => Atomic::Max(at, x, used),
            3 => Atomic::Exchange(at, x),
            _ => Atomic::Add(at, x, used),
        }
    };
    (0..invocations).map(|_| (0..atomics).map(|_| one()).collect()).collect()
}

/// The explorer finds exactly the results of all possible orders. If stores take effect at once, the number of explored
/// orders is at most the number of possible orders.
// Lesson 216: each outcome is found
#[test]
fn the_explorer_finds_exactly_the_outcomes_of_all_orders() {
    let mut state = 0x6578_706c;
    for (invocations, atomics, count) in [(2, 2, 60), (2, 3, 40), (2, 4, 20), (3, 2, 30), (3, 3, 4)]
    {
        for _ in 0..count {
            let all = generated(&mut state, invocations, atomics);
            let source = text(&all);
            for (stores, late) in [(Stores::AtOnce, false), (Stores::Late(0), true)] {
                if late && invocations * atomics > 6 {
                    continue;
                }
                let expected = naive(&all, late);
                let (found, runs) = explored(&source, invocations, stores);
                assert_eq!(found, expected, "late: {late}\n{source}");
                let orders: usize = (1..=invocations)
                    .map(|k| {
                        // This is a multinomial coefficient, as a product of binomial coefficients.
                        (1..=atomics).fold(1, |all, j| all * ((k - 1) * atomics + j) / j)
                    })
                    .product();
                assert!(late || runs <= orders, "{runs} of {orders}\n{source}");
            }
        }
    }
}

/// If two orders differ only in the order of commuting atomics, the explorer runs only one of the two.
// Lesson 216: each outcome is found
#[test]
fn equivalent_orders_run_once() {
    for (body, groups, runs) in [
        // Additions whose results aren't used, and reads.
        ("atomicAdd(&a[0], 1u); atomicAdd(&a[0], g.x);", 6, 1),
        ("d[g.x] = atomicLoad(&a[0]);", 5, 1),
        // Each invocation has a word of its own.
        ("d[g.x] = atomicAdd(&a[g.x], 1u);", 2, 1),
        // Additions whose results are used. There are as many orders as permutations.
        ("d[g.x] = atomicAdd(&a[0], 1u);", 4, 24),
        // One invocation writes a word, and three read it. Each reads it before or after the write.
        ("if g.x == 0u { atomicStore(&a[0], 1u); } else { d[g.x] = atomicLoad(&a[0]); }", 4, 8),
        // An invocation that waits for a word has no turn until the word has changed.
        (
            "if g.x == 0u { atomicStore(&a[0], 1u); } else { loop { if atomicLoad(&a[0]) == 1u { break; } } }",
            2,
            5,
        ),
    ] {
        let source = format!(
            "@group(0) @binding(0) var<storage, read_write> a: array<atomic<u32>, 2>;\n\
             @group(0) @binding(1) var<storage, read_write> d: array<u32>;\n\
             @compute @workgroup_size(1) fn main(@builtin(workgroup_id) g: vec3u) {{ {body} }}"
        );
        assert_eq!(explored(&source, groups, Stores::AtOnce).1, runs, "{body}");
    }
}
