//! Tests the values that observers receive.

use std::sync::Mutex;

use karat_engine::{F32, F64, Lanes, Observer, Options, Program, Resources, Runs, Settings};

use crate::common::module;

const SOURCE: &str = "fn root(x: f32) -> f32 {
    let below = x - 1.0;
    return sqrt(below);
}
fn f(x: f32, k: i32) -> f32 {
    let index = k + 1;
    if index > 5 {
        let hidden = max(root(x), 0.0);
        return hidden;
    }
    return x;
}";

/// Collects the lines at which an active lane computes NaN, each with its case, and the values of named let-bindings.
#[derive(Default)]
struct Seen {
    nan: Mutex<Vec<(u32, usize)>>,
    named: Mutex<Vec<(String, usize, String)>>,
}

impl Observer<F32> for Seen {
    fn floats(&self, lanes: &Lanes<'_, F32>) {
        for (lane, (x, active)) in lanes.floats[0].iter().zip(lanes.active).enumerate() {
            if *active && x.is_nan() {
                let line = lanes.site.span.location(SOURCE).line_number;
                self.nan.lock().expect("no panic").push((line, lanes.case + lane));
            }
        }
    }

    fn named(&self, lanes: &Lanes<'_, F32>) {
        for (lane, active) in lanes.active.iter().enumerate().filter(|(_, active)| **active) {
            let _ = active;
            let value = match (lanes.floats.first(), lanes.ints.first()) {
                (Some(floats), _) => floats[lane].to_string(),
                (None, Some(ints)) => ints[lane].to_string(),
                _ => String::new(),
            };
            let name = lanes.site.name.clone().unwrap_or_default();
            self.named.lock().expect("no panic").push((name, lanes.case + lane, value));
        }
    }
}

fn observed<A: Runs>(settings: &Settings, observer: &dyn Observer<A>) {
    let (module, info) = module(SOURCE);
    let program = Program::function(&module, &info, "f", settings).expect("it lowers");
    let rows = [0.5f32.to_bits(), 2, 0.5f32.to_bits(), 9, 5f32.to_bits(), 9];
    program.call::<A>(3, &rows, &Resources::new(), &Options::default(), observer).expect("it runs");
}

#[test]
fn a_hidden_nan_has_its_line_and_case() {
    let seen = Seen::default();
    observed::<F32>(&Settings::default(), &seen);
    // Only case 1 has NaN: case 0 isn't active, and case 2 has a root. `max` hides the NaN.
    assert_eq!(*seen.nan.lock().unwrap(), [(3, 1)]);
    assert!(seen.named.lock().unwrap().is_empty(), "only requested names are shown");
    observed::<F64>(&Settings::default(), &());
}

#[test]
fn named_values_are_shown_where_asked_for() {
    let seen = Seen::default();
    observed::<F32>(&Settings { named: &[""], ..Settings::default() }, &seen);
    let named = seen.named.lock().unwrap();
    let of = |name: &str| -> Vec<(usize, &str)> {
        let found = named.iter().filter(|(found, _, _)| found == name);
        found.map(|(_, case, value)| (*case, value.as_str())).collect()
    };
    assert_eq!(of("index"), [(0, "3"), (1, "10"), (2, "10")]);
    assert_eq!(of("below"), [(1, "-0.5"), (2, "4")]);
    assert_eq!(of("hidden"), [(1, "0"), (2, "2")]);
}
