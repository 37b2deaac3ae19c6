//! What can go wrong inside of the library's functions is mended, or accepted with a reason.

use karat::unstable::hazards::Kind;
use shaders::PBR;

#[test]
fn the_library_has_none_that_is_not_argued() {
    let hazards = PBR.hazards().run().expect("each declaration is true");
    assert!(hazards.found.is_empty(), "{hazards}");
    assert!(hazards.functions > 180, "{} functions were looked at", hazards.functions);
    assert!(hazards.accepted > 40, "{} are accepted", hazards.accepted);
}

/// The documents' formulas light up: what their tests show is found without a test.
#[test]
fn the_documents_formulas_light_up() {
    let hazards = PBR.hazards().only(["as_written::"]).with_accepted().run();
    let found = hazards.expect("they are looked at").found;
    for (kind, text) in [
        (Kind::Unbounded, "pow(1.0 - dot(v, h), 5.0)"),
        (Kind::LostDigits, "(n_dot_h * alpha2 - n_dot_h) * n_dot_h + 1.0"),
        (Kind::Unbounded, "cos(phi)"),
        (Kind::Infinite, "1.0 / (1.0 + n.z)"),
    ] {
        let is =
            |hazard: &&karat::unstable::hazards::Hazard| hazard.kind == kind && hazard.text == text;
        assert!(found.iter().any(|hazard| is(&hazard)), "no {kind:?} at {text}: {found:#?}");
    }
}
