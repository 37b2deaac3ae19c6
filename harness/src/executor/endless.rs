//! Finds endless loops before a driver runs them, because the driver could hang until the deadline ends the process.
//! If a loop has no visible bound, the engine runs the function first.

use crate::interpret::{Alone, Interpreted};
use crate::path::{Device, MOST_ROUNDS, PathError};
use crate::probe::{Call, Prepared, ProbeError, Started, VECTOR};

/// The largest number of iterations that is allowed for one case. A driver runs several cases together as a vector, and
/// limits the sum of their iterations.
const ROUNDS: u64 = MOST_ROUNDS / VECTOR as u64;

/// Runs a function in the engine, and counts the iterations of the function's loops.
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

    /// Returns the watcher with another limit on iterations.
    fn with_fuel(self, fuel: u64) -> Self {
        match self {
            Self::Together(function) => Self::Together(function.with_fuel(fuel)),
            Self::Alone(function) => Self::Alone(function.with_fuel(fuel)),
        }
    }

    fn run(&self, cases: usize, arguments: &[u32]) -> Result<(), ProbeError> {
        match self {
            Self::Together(function) => function.words(cases, arguments).map(drop),
            Self::Alone(function) => function.words(cases, arguments).map(drop),
        }
    }
}

/// A function that the engine runs on each batch of cases before the driver does.
struct Guarded<'e> {
    prepared: Box<dyn Prepared + 'e>,
    function: Watcher,
    /// The device and the function's name, if the driver silently stops long loops. For such a driver, the engine must
    /// run each batch to its end.
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
            // The engine's other limits don't apply to the driver.
            _ => self.prepared.start(cases, arguments),
        }
    }

    fn reads_half_floats(&self) -> bool {
        self.prepared.reads_half_floats()
    }
}

/// Guards a driver against endless loops, if naga's IR shows no bound for one of the function's loops. If the engine
/// can run the function, the engine runs each batch before the driver does. Some drivers silently stop long loops. On
/// these drivers, most kernels count their own iterations. Other kernels can't count iterations: kernels that run each
/// case alone, and kernels that run in a fragment shader. For these kernels, the engine must run each batch first. If
/// the engine can't run such a kernel, returns an error.
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
        // The engine can't run this function. The driver doesn't stop loops silently, so Karat can trust the driver's
        // results.
        Err(_) => prepared,
    })
}

/// Makes the error for a function that the engine can't run, on a driver that silently stops long loops.
fn unwatched(device: &Device, of: &str, error: &ProbeError) -> ProbeError {
    let driver = &device.adapter().name;
    let message = format!(
        "{of} has a loop without a visible bound. {driver} silently stops loops after {MOST_ROUNDS} iterations. \
         Karat's engine could count the iterations, but can't run {of}: {error}"
    );
    PathError::Route { path: device.path(), message }.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;
    use crate::probe::Probed;

    /// A driver that hangs if an argument is 7.
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

    // Lesson 94
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
