//! A loop without an end is a verdict on drivers, too: the engine goes round it first, so that no driver
//! hangs in it until the deadline ends the process.

use crate::interpret::Interpreted;
use crate::path::Device;
use crate::probe::{Call, Prepared, ProbeError, Started};

/// A function on a driver, each batch of whose cases the engine has run before.
struct Guarded<'e> {
    prepared: Box<dyn Prepared + 'e>,
    function: Interpreted,
}

impl Prepared for Guarded<'_> {
    fn capacity(&self) -> usize {
        self.prepared.capacity()
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        match self.function.words(cases, arguments) {
            Err(endless @ ProbeError::Rounds { .. }) => Err(endless),
            // Whatever else the engine can't do isn't the driver's matter.
            _ => self.prepared.start(cases, arguments),
        }
    }

    fn reads_half_floats(&self) -> bool {
        self.prepared.reads_half_floats()
    }
}

/// Guards a function whose loops have no bound that the IR shows, on a driver that would stay in them. A
/// driver that leaves loops by itself has its rounds counted there.
pub(super) fn guarded<'e>(
    device: &Device,
    call: &Call<'_>,
    prepared: Box<dyn Prepared + 'e>,
) -> Box<dyn Prepared + 'e> {
    if device.leaves_loops() || call.probed.program.most_rounds().is_some() {
        return prepared;
    }
    match Interpreted::new(call.probed, call.fixtures) {
        Ok(function) => Box::new(Guarded { prepared, function }),
        Err(_) => prepared,
    }
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
        let guarded = Guarded { prepared: Box::new(Hanging), function };
        assert!(guarded.start(3, &[1, 2, 3]).is_ok());
        let Err(error) = guarded.start(3, &[1, 7, 3]) else { panic!("it ends") };
        assert!(matches!(error, ProbeError::Rounds { case: 1, .. }), "{error}");
        assert!(error.to_string().contains("3:5"), "the loop's line is missing: {error}");
    }
}
