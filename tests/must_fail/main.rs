//! Proves that each kind of check can fail: the tests plant faults, and the checks must find these faults.

mod fixtures;
mod functions;
mod goldens;
mod integrals;
mod jobs;
mod known_issues;
mod messages;
mod order;
mod ordinary;
mod outside;
mod processes;
mod properties;
mod sanitizer;

mod weaker;

use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, fresnel};

/// The shader library, with the text `original` in one module replaced by `fault`.
pub(crate) fn mutant(module: &str, original: &str, fault: &str) -> Package {
    let mut modules = Vec::new();
    for name in PBR.modules().expect("the library is readable") {
        let path = PBR.root().join(format!("{}.wgsl", name.replace("::", "/")));
        let mut text = std::fs::read_to_string(path).expect("the library is readable");
        if name == module {
            assert!(text.contains(original), "`{original}` isn't in {module}.wgsl any more");
            text = text.replacen(original, fault, 1);
        }
        modules.push((name, text));
    }
    Package::from_modules("mutant", modules)
}

#[track_caller]
pub(crate) fn disagreement<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the fault was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

pub(crate) fn schlick(package: &Package) -> Result<karat::check::Agreement, Failure> {
    package
        .function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .unrecorded()
        .try_agrees_with(fresnel::schlick, Ulp(11.0))
}
