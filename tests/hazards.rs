//! Tests that each hazard inside the library's functions is fixed, or accepted with a reason.

use karat_inspect::hazards::{Class, Hazard, Kind};
use shaders::PBR;

/// Each fault of the library is accepted with a reason. `as_written` contains formulas as the source documents print
/// them. In these formulas, `hazards` must find faults.
// Lesson 111
#[test]
fn the_library_has_none_that_is_not_argued() {
    let hazards =
        karat_inspect::hazards(&PBR).with_accepted().run().expect("each declaration is true");
    let open: Vec<_> = hazards.faults().collect();
    assert!(open.is_empty(), "{open:#?}");
    assert!(hazards.functions > 180, "{} functions were looked at", hazards.functions);
    let faults = hazards.found.iter().filter(|one| one.class == Class::Fault);
    let (documents, own): (Vec<_>, Vec<_>) =
        faults.partition(|one| one.function.starts_with("as_written::"));
    assert!(documents.len() > 10 && own.len() < 5, "{own:#?}");
    let as_written = || hazards.found.iter().filter(|one| one.function.starts_with("as_written::"));
    for (kind, text) in [
        (Kind::Unbounded, "pow(1.0 - dot(v, h), 5.0)"),
        (Kind::LostDigits, "(n_dot_h * alpha2 - n_dot_h) * n_dot_h + 1.0"),
        (Kind::Unbounded, "cos(phi)"),
        (Kind::Infinite, "1.0 / (1.0 + n.z)"),
    ] {
        let has_it = |one: &Hazard| one.kind == kind || one.kinds.contains(&kind);
        let is = as_written().any(|one| has_it(one) && one.text == text);
        assert!(is, "no {kind:?} at {text}: {:#?}", as_written().collect::<Vec<_>>());
    }
}
