//! A loop without an end is a verdict on drivers, too: the engine goes round it first, so that no driver
//! hangs in it until the deadline ends the process.

use crate::interpret::{Alone, Interpreted};
use crate::path::{Device, MOST_ROUNDS, PathError};
use crate::probe::{Call, Prepared, ProbeError, Started, VECTOR};

/// Rounds that a case may make without its vector's lanes together making more than the driver allows.
const ROUNDS: u64 = MOST_ROUNDS / VECTOR as u64;

/// A function in the engine.
enum Watcher {
    Together(Interpreted),
    Alone(Alone),
}

impl Watcher {
    fn new(call: &Call<'_>) -> Result<Self, ProbeError> {
        Ok(match call.probed.function().form.alone {
            true => Self::Alone(Alone::new(call.probed, call.fixtures)?),
            false => Self::Together(Interpreted::new(call.probed, call.fixtures)?),
        })
    }

    /// The same that stops after fewer rounds.
    fn with_fuel(self, fuel: u64) -> Self {
        match self {
            Self::Together(function) => Self::Together(function.with_fuel(fuel)),
            Self::Alone(function) => Self::Alone(function.with_fuel(fuel)),
        }
    }

    /// Runs a batch, of which nobody wants the results.
    fn run(&self, cases: usize, arguments: &[u32]) -> Result<(), ProbeError> {
        match self {
            Self::Together(function) => function.words(cases, arguments).map(drop),
            Self::Alone(function) => function.words(cases, arguments).map(drop),
        }
    }
}

/// A function on a driver, each batch of whose cases the engine has run before.
struct Guarded<'e> {
    prepared: Box<dyn Prepared + 'e>,
    function: Watcher,
    /// The driver that leaves loops without a word, so that the engine has to have run all of a batch.
    leaves: Option<(&'e Device, String)>,
}

impl Prepared for Guarded<'_> {
    fn capacity(&self) -> usize {
        self.prepared.capacity()
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        match (self.function.run(cases, arguments), &self.leaves) {
            (Err(ProbeError::Rounds { case, diagnostic }), Some((device, of))) => {
                let rounds = u32::try_from(ROUNDS).expect("it fits");
                let told = device.left_loop(of, rounds, diagnostic.location());
                Err(ProbeError::Rounds { case, diagnostic: Box::new(told) })
            }
            (Err(endless @ ProbeError::Rounds { .. }), None) => Err(endless),
            (Err(error), Some((device, of))) => Err(unwatched(device, of, &error)),
            // Whatever else the engine can't do isn't the driver's matter.
            _ => self.prepared.start(cases, arguments),
        }
    }

    fn reads_half_floats(&self) -> bool {
        self.prepared.reads_half_floats()
    }
}

/// Guards a function whose loops have no bound that the IR shows, on a driver that would stay in them. A
/// driver that leaves loops by itself has the rounds of kernels counted there, but of those whose cases
/// run alone or are quads: these the engine runs before, and nothing is believed that it can't run.
pub(super) fn guarded<'e>(
    device: &'e Device,
    call: &Call<'_>,
    prepared: Box<dyn Prepared + 'e>,
) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
    let most = call.probed.program.most_rounds();
    let form = &call.probed.function().form;
    if device.leaves_loops() {
        let counted = !form.alone && !form.fragment;
        if counted || most.is_some_and(|rounds| rounds < MOST_ROUNDS) {
            return Ok(prepared);
        }
        let of = format!("`{}`", call.probed.function().name);
        let function = Watcher::new(call).map_err(|error| unwatched(device, &of, &error))?;
        let function = function.with_fuel(ROUNDS);
        return Ok(Box::new(Guarded { prepared, function, leaves: Some((device, of)) }));
    }
    if most.is_some() {
        return Ok(prepared);
    }
    Ok(match Watcher::new(call) {
        Ok(function) => Box::new(Guarded { prepared, function, leaves: None }),
        // The engine doesn't run this function, and no driver is known to leave its loops.
        Err(_) => prepared,
    })
}

/// Nobody knows whether a driver that leaves loops would run this one to its end.
fn unwatched(device: &Device, of: &str, error: &ProbeError) -> ProbeError {
    let driver = &device.adapter().name;
    let message = format!(
        "{of} has a loop without a bound that can be seen. {driver} leaves loops after {MOST_ROUNDS} rounds \
         without a word, and Karat's engine, which would tell, can't run it: {error}"
    );
    PathError::Route { path: device.path(), message }.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;
    use crate::probe::Probed;

    /// A driver that would never come back.
    struct Hanging;

    impl Prepared for Hanging {
        fn capacity(&self) -> usize {
            8
        }

        fn start<'p>(&'p self, _: usize, rows: &[u32]) -> Result<Started<'p>, ProbeError> {
            assert!(!rows.contains(&7), "it hangs");
            Ok(Box::new(|_| Ok(())))
        }
    }

    #[test]
    fn a_loop_without_an_end_never_reaches_a_driver() {
        let text = "fn f(n: u32) -> u32 {\n    var k = 0u;\n    loop {\n        if k == n { break; }\n        \
                    if n != 7u { k += 1u; }\n    }\n    return k;\n}\n";
        let package = Package::from_source("endless", text);
        let probed = Probed::new(&package, "f").expect("it is valid");
        let fixtures = Vec::new();
        let function = Interpreted::new(&probed, &fixtures).expect("the engine executes it");
        let function = Watcher::Together(function);
        let guarded = Guarded { prepared: Box::new(Hanging), function, leaves: None };
        assert!(guarded.start(3, &[1, 2, 3]).is_ok());
        let Err(error) = guarded.start(3, &[1, 7, 3]) else { panic!("it ends") };
        assert!(matches!(error, ProbeError::Rounds { case: 1, .. }), "{error}");
        assert!(error.to_string().contains("3:5"), "the loop's line is missing: {error}");
    }
}
