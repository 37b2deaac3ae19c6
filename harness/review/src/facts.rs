//! The metadata of a golden and its frame, and the differences in the metadata that may explain different pixels.

use std::fmt;

use serde::Serialize;
use serde_json::Value;

use karat::unstable::golden::Provenance;
use karat::unstable::metric::ExposureRange;

/// The kind of difference between a golden's metadata and a frame's metadata.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// There is no golden.
    New,
    /// The golden has no metadata.
    Unknown,
    /// The shader differs.
    Shader,
    /// The shader differs. The driver or the adapter differs, too.
    ShaderAndDriver,
    /// The driver or the adapter differs.
    Driver,
    /// The processor of a software rasteriser differs.
    Processor,
    /// A property that the test declares about the frame, such as a seed, differs.
    Declared,
    /// No recorded property differs.
    Nothing,
}

impl Cause {
    pub(super) fn of(exists: bool, golden: Option<&Provenance>, actual: &Provenance) -> Self {
        let Some(golden) = golden else { return if exists { Self::Unknown } else { Self::New } };
        let shader = golden.shader != actual.shader;
        let adapter = golden.adapter != actual.adapter;
        let processor = golden.processor != actual.processor;
        match (shader, adapter, processor) {
            (true, false, false) => Self::Shader,
            (true, _, _) => Self::ShaderAndDriver,
            (false, true, _) => Self::Driver,
            (false, false, true) => Self::Processor,
            (false, false, false) if golden.facts != actual.facts => Self::Declared,
            (false, false, false) => Self::Nothing,
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::New => "new: there is no golden yet",
            Self::Unknown => "the golden has no provenance",
            Self::Shader => "the shader changed",
            Self::ShaderAndDriver => "the shader and the driver changed",
            Self::Driver => "only the driver changed",
            Self::Processor => "only the processor changed",
            Self::Declared => "in the provenance, only the facts that the test adds have changed",
            Self::Nothing => {
                "shader and driver are the same: the frame isn't deterministic, or its inputs changed"
            }
        })
    }
}

/// A property in the metadata of the golden, of the frame, or of both.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Fact {
    /// The name of the property: `adapter.name`.
    pub name: String,
    /// The golden's value. Empty if the golden doesn't have this property.
    pub golden: String,
    /// The frame's value. Empty if the frame doesn't have this property.
    pub actual: String,
    /// `true` if golden and frame both have a value, and the values differ.
    pub differs: bool,
}

/// Returns the properties that the test declares, if their values differ between golden and frame, or if only one of
/// the two has a value.
pub(super) fn declared(golden: Option<&Provenance>, actual: &Provenance) -> Vec<Fact> {
    let Some(golden) = golden else { return Vec::new() };
    let names: std::collections::BTreeSet<_> =
        golden.facts.keys().chain(actual.facts.keys()).collect();
    let fact = |name: &String| {
        let value = |side: &Provenance| side.facts.get(name).cloned().unwrap_or_default();
        let differs = golden.facts.get(name) != actual.facts.get(name);
        Fact { name: name.clone(), golden: value(golden), actual: value(actual), differs }
    };
    names.into_iter().map(fact).filter(|fact| fact.differs).collect()
}

/// Returns each property that the golden or the frame has, in the order of the metadata.
pub(super) fn table(golden: Option<&Provenance>, actual: &Provenance) -> Vec<Fact> {
    let golden = golden.map(lines).unwrap_or_default();
    let actual = lines(actual);
    let value = |side: &[(String, String)], name: &str| {
        let line = side.iter().find(|(other, _)| other == name);
        line.map(|(_, value)| value.clone()).unwrap_or_default()
    };
    let mut names: Vec<&String> = golden.iter().chain(&actual).map(|(name, _)| name).collect();
    let mut seen = std::collections::BTreeSet::new();
    // The list leaves out the frame's name and the hash of the golden. The page shows the finding and the modules
    // elsewhere.
    let aside = |name: &str| {
        let shown = ["finding.", "modules."].iter().any(|group| name.starts_with(group));
        shown || ["case", "compared_with"].contains(&name)
    };
    names.retain(|name| !aside(name) && seen.insert(*name));
    let fact = |name: &String| {
        let (golden, actual) = (value(&golden, name), value(&actual, name));
        let differs = !golden.is_empty() && !actual.is_empty() && golden != actual;
        Fact { name: name.clone(), golden, actual, differs }
    };
    names.into_iter().map(fact).collect()
}

/// Returns each value in a provenance, with its name. The name of a value is its path, such as `adapter.name`.
fn lines(provenance: &Provenance) -> Vec<(String, String)> {
    let mut value = serde_json::to_value(provenance).expect("provenance is plain data");
    // The exposures get a unit, because two numbers without a unit are hard to understand.
    if let Some(ExposureRange { start, stop }) = provenance.exposures {
        value["exposures"] = if start == stop {
            format!("{start} stops")
        } else {
            format!("{start} to {stop} stops")
        }
        .into();
    }
    let mut lines = Vec::new();
    leaves("", &value, &mut lines);
    lines
}

fn leaves(path: &str, value: &Value, lines: &mut Vec<(String, String)>) {
    match value {
        Value::Object(members) => {
            for (name, value) in members {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                leaves(&path, value, lines);
            }
        }
        Value::String(text) => lines.push((path.to_owned(), text.clone())),
        other => lines.push((path.to_owned(), other.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat::image::Precision;
    use karat::unstable::path::Adapter;

    fn provenance() -> Provenance {
        Provenance {
            schema: 1,
            case: "scene".to_owned(),
            shader: "aa".to_owned(),
            modules: std::collections::BTreeMap::new(),
            pixels: "bb".to_owned(),
            width: 2,
            height: 1,
            color_space: "linear sRGB".to_owned(),
            precision: Precision::Half,
            tolerance: "rel 1e-3".to_owned(),
            adapter: Adapter {
                path: "vulkan".to_owned(),
                name: "llvmpipe".to_owned(),
                driver: "Mesa 22".to_owned(),
                software: true,
            },
            processor: "one".to_owned(),
            facts: std::collections::BTreeMap::new(),
            folder: String::new(),
            cargo_package: String::new(),
            compared_with: String::new(),
            compared_profile: String::new(),
            finding: None,
            exposures: None,
            table: None,
            accepted_by: String::new(),
            accepted_at: String::new(),
            because: String::new(),
        }
    }

    #[test]
    fn the_cause_is_what_changed() {
        let golden = provenance();
        let said = |change: fn(&mut Provenance)| {
            let mut actual = provenance();
            change(&mut actual);
            Cause::of(true, Some(&golden), &actual).to_string()
        };
        assert_eq!(said(|p| p.shader = "cc".to_owned()), "the shader changed");
        assert_eq!(said(|p| p.adapter.driver = "Mesa 23".to_owned()), "only the driver changed");
        assert_eq!(said(|p| p.processor = "two".to_owned()), "only the processor changed");
        assert_eq!(
            said(|p| {
                p.shader = "cc".to_owned();
                p.adapter.driver = "Mesa 23".to_owned();
            }),
            "the shader and the driver changed"
        );
        let seeded = |p: &mut Provenance| drop(p.facts.insert("seed".to_owned(), "8".to_owned()));
        assert_eq!(
            said(seeded),
            "in the provenance, only the facts that the test adds have changed"
        );
        assert_eq!(
            said(|_| {}),
            "shader and driver are the same: the frame isn't deterministic, or its inputs changed"
        );
        assert_eq!(Cause::of(false, None, &golden).to_string(), "new: there is no golden yet");
    }

    #[test]
    fn facts_that_differ_are_marked() {
        let golden = Provenance { because: "why".to_owned(), ..provenance() };
        let actual = Provenance { shader: "cc".to_owned(), ..provenance() };
        let facts = table(Some(&golden), &actual);
        let differing: Vec<_> = facts.iter().filter(|fact| fact.differs).collect();
        assert_eq!(differing.len(), 1);
        assert_eq!((differing[0].name.as_str(), differing[0].actual.as_str()), ("shader", "cc"));
        let because = facts.iter().find(|fact| fact.name == "because").expect("the golden's");
        assert!(!because.differs && because.golden == "why" && because.actual.is_empty());
        assert!(facts.iter().any(|fact| fact.name == "adapter.driver"));
    }

    #[test]
    fn exposures_have_their_unit() {
        let exposures = Some(ExposureRange { start: -1.41, stop: 3.0 });
        let golden = Provenance { exposures, ..provenance() };
        let facts = table(Some(&golden), &provenance());
        let known = facts.iter().find(|fact| fact.name == "exposures").expect("the golden's");
        assert_eq!((known.golden.as_str(), known.actual.as_str()), ("-1.41 to 3 stops", ""));
        let exposures = Some(ExposureRange { start: 1.5, stop: 1.5 });
        let facts = table(None, &Provenance { exposures, ..provenance() });
        assert!(facts.iter().any(|fact| fact.actual == "1.5 stops"));
        assert!(!facts.iter().any(|fact| fact.name.starts_with("exposures.")));
    }
}
