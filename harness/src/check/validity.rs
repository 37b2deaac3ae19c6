//! The verb `is_valid`: checks that a whole package is valid, including functions that no test calls.

use crate::diagnostic::{Blame, Blamed};
use crate::package::Package;
use crate::path::Adapter;
use crate::record::{PathRecord, Subject};
use crate::reflect::{Invalid, ReflectError, Validated};
use crate::run::{Fails, KnownIssue, Passed, or_panic, reported};

const CHECK: &str = "is_valid";
const ASSERTED: &str = "naga validates each module";

impl Package {
    /// Validates every module with all of its functions and entry points, including functions that no test calls. Karat
    /// writes a record of the verdict. If a module is valid only with some features, set these features with
    /// [`module_features`](Self::module_features).
    ///
    /// ```
    /// use karat::Package;
    ///
    /// Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }").is_valid();
    /// ```
    ///
    /// # Panics
    /// Panics if a module isn't valid. [`try_is_valid`](Self::try_is_valid) returns the reason.
    #[track_caller]
    pub fn is_valid(&self) -> Validated {
        let modules = self.modules().unwrap_or_default();
        let subject = Subject::Function {
            package: self.root().display().to_string(),
            function: self.name(),
            check: CHECK.to_owned(),
            assertion: ASSERTED.to_owned(),
            location: String::new(),
            domain: String::new(),
            seed: 0,
        };
        or_panic(reported(subject, &|| true, |report| {
            let result = self.try_is_valid();
            report.read.extend(modules.iter().filter_map(|module| self.file_of(module)));
            report.paths = paths(&result, modules.len());
            result
        }))
    }
}

/// The results of naga, and of Tint if Tint ran. In the record, each compiler is a path, and each module is a case.
/// Empty if Karat can't read the package's modules, or if there are none.
fn paths(result: &Result<Validated, Invalid>, modules: usize) -> Vec<PathRecord> {
    let (errors, opinion) = match result {
        Ok(found) => (&[][..], &found.opinion),
        Err(Invalid::Modules { errors, opinion, .. }) => (&**errors, &**opinion),
        Err(_) => return Vec::new(),
    };
    // Tint's errors are failures only if `karat.toml` requires Tint.
    let required = |(_, error): &&(String, ReflectError)| matches!(error, ReflectError::Refused(_));
    let refused = errors.iter().filter(required).count().min(opinion.refused.len());
    let rejected = errors.iter().filter(|error| !required(error)).count();
    let naga = ("naga", "the validator of wgpu", modules, rejected, ASSERTED);
    let judged = opinion.accepted + opinion.refused.len();
    let tint = ("tint", "the compiler of Chrome", judged, refused, "Tint accepts each module");
    let all = [naga, tint].into_iter().filter(|(_, _, cases, ..)| *cases > 0);
    let record = |(path, name, cases, failures, asserted): (&str, &str, usize, usize, &str)| {
        let adapter = Adapter {
            path: path.to_owned(),
            name: name.to_owned(),
            driver: String::new(),
            software: true,
        };
        let count = |number: usize| u64::try_from(number).unwrap_or(u64::MAX);
        PathRecord {
            cases: count(cases),
            failures: count(failures),
            asserted: asserted.to_owned(),
            ..PathRecord::of(adapter)
        }
    };
    all.map(record).collect()
}

impl Passed for Validated {
    fn known_issues(&self) -> &[KnownIssue] {
        &[]
    }
}

impl Blamed for Invalid {
    fn blame(&self) -> Blame<'_> {
        Blame::TEST
    }
}

impl Fails for Invalid {
    fn is_verdict(&self) -> bool {
        matches!(self, Self::Modules { .. })
    }

    fn location(&self) -> Option<String> {
        let Self::Modules { errors, .. } = self else { return None };
        errors.iter().find_map(|(_, error)| Some(error.diagnostic()?.location()?.to_string()))
    }
}
