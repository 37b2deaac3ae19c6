//! The provenance of a golden or a pending frame. A golden's provenance is in its EXR, and as TOML beside the EXR.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::compare::FrameDifference;
use super::table::TableFacts;
use super::tolerance::{CriterionMargin, FrameCriterion};
use crate::image::Precision;
use crate::metric::{ExposureRange, Rect};
use crate::path::Adapter;

/// The provenance of a golden or a pending frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of this format: [`Provenance::SCHEMA`].
    pub schema: u32,
    /// Name of the golden.
    pub case: String,
    /// [`text_hash`](crate::diagnostic::text_hash) of the linked WGSL.
    pub shader: String,
    /// Hashes of the linked modules, by the paths of their files from the project's root. A module outside of the
    /// project has its name as the key. The map is empty for goldens from older versions of Karat.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub modules: BTreeMap<String, String>,
    /// blake3 hash of the size and the stored pixels; for a table, of its columns and cells.
    pub pixels: String,
    /// Width in pixels, or number of columns of a table.
    pub width: u32,
    /// Height in pixels, or number of rows of a table.
    pub height: u32,
    /// Colour space of the values; empty for a table.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub color_space: String,
    /// Format of the stored samples.
    pub precision: Precision,
    /// The tolerance of the frame: `rel 1e-3 or (FLIP tile 0.01 and mean FLIP 0.005)`.
    pub tolerance: String,
    /// The adapter that rendered the frame. The name of a software rasteriser includes its compiler's version and its
    /// vector width, because the results depend on this version and width.
    pub adapter: Adapter,
    /// Vendor and model of the processor, on which the results of software rasterisers depend.
    pub processor: String,
    /// Facts that the author added, by name: the seed, the number of samples per pixel.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub facts: BTreeMap<String, String>,
    /// The folder of the goldens with which a pending frame was compared, as a path from the project's root.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub folder: String,
    /// The Cargo package that contains `folder`. The name is empty if there is no package, or if an older Karat wrote
    /// the file.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub cargo_package: String,
    /// Hash of the pixels of the golden with which this frame was compared; empty if there was no golden.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub compared_with: String,
    /// The profile that owns the golden of the comparison; empty for the golden for all profiles.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub compared_profile: String,
    /// The difference between a pending frame and its golden; `None` for goldens and for frames without a golden.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finding: Option<FrameFinding>,
    /// The exposures of HDR-FLIP. Accepting the golden pins the exposures: later frames don't change them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposures: Option<ExposureRange>,
    /// The facts about a table's columns; `None` for a frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<TableFacts>,
    /// Name of the person who accepted the golden.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub accepted_by: String,
    /// The time of acceptance, in UTC.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub accepted_at: String,
    /// The reason for accepting the golden.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub because: String,
}

/// The reason why Karat can't use a file's provenance.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ProvenanceError {
    /// A newer version of Karat wrote the provenance.
    #[error("the metadata comes from a newer Karat (version {0} of the format, but this Karat reads version {max}): update Karat", max = Provenance::SCHEMA)]
    Newer(u32),
    /// The provenance can't be parsed, or has control characters.
    #[error("the metadata can't be read ({0})")]
    Damaged(String),
}

impl Provenance {
    /// Version of the format that Karat writes, and the latest version that it reads.
    pub const SCHEMA: u32 = 1;

    /// Reads the metadata of an EXR file.
    ///
    /// # Errors
    /// Returns an error if a newer Karat wrote the metadata, or if the metadata isn't a provenance.
    pub fn parse(metadata: &str) -> Result<Self, ProvenanceError> {
        #[derive(Deserialize)]
        struct Version {
            schema: u32,
        }
        let damaged = |error: serde_json::Error| ProvenanceError::Damaged(error.to_string());
        let all = serde_json::from_str(metadata).map_err(damaged)?;
        if has_controls(&all) {
            // Pending frames may come from a stranger's CI run. Listing them would send control characters to a
            // terminal.
            return Err(ProvenanceError::Damaged("it has control characters".to_owned()));
        }
        match serde_json::from_str(metadata).map_err(damaged)? {
            Version { schema } if schema > Self::SCHEMA => Err(ProvenanceError::Newer(schema)),
            _ => serde_json::from_str(metadata).map_err(damaged),
        }
    }

    pub(super) fn parse_toml(facts: &str) -> Result<Self, ProvenanceError> {
        let damaged = |error: &dyn std::fmt::Display| ProvenanceError::Damaged(error.to_string());
        let all: Value = toml::from_str(facts)
            .map_err(|error: toml::de::Error| damaged(&error.message().to_owned()))?;
        Self::parse(&all.to_string())
    }

    pub(super) fn metadata(&self) -> String {
        serde_json::to_string(self).expect("provenance is plain data")
    }
}

/// Checks if a text in `value` has a control character other than a line break or a tab.
fn has_controls(value: &Value) -> bool {
    let controls = |text: &str| text.chars().any(|c| c.is_control() && !"\n\r\t".contains(c));
    match value {
        Value::String(text) => controls(text),
        Value::Array(items) => items.iter().any(has_controls),
        Value::Object(members) => {
            members.iter().any(|(name, value)| controls(name) || has_controls(value))
        }
        _ => false,
    }
}

/// The difference between a frame and its golden. The test stores the difference in the pending file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameFinding {
    /// The difference, as text.
    pub verdict: String,
    /// All measurements, in order.
    pub margins: Vec<CriterionMargin>,
    /// `true` if the profile has its own golden but doesn't need it, because the frame would pass with the golden for
    /// all profiles.
    #[serde(default)]
    pub base_passes: bool,
}

impl From<&FrameDifference> for FrameFinding {
    fn from(difference: &FrameDifference) -> Self {
        let margins = match difference {
            FrameDifference::Values(deviation) => deviation.margins.clone(),
            FrameDifference::NonFinite(census) => vec![CriterionMargin {
                criterion: FrameCriterion::Finite,
                name: "pixels with NaN or infinity".to_owned(),
                value: (census.nan + census.infinite) as f64,
                bound: 0.0,
                place: census.first.map(|(x, y)| Rect::new(x, y, 1, 1)),
                note: None,
            }],
            _ => Vec::new(),
        };
        let verdict = match difference {
            FrameDifference::Values(deviation) => deviation.summary(),
            other => other.to_string(),
        };
        Self { verdict, margins, base_passes: false }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_keep_nan_and_infinity_in_json() {
        let margin = |value| CriterionMargin {
            criterion: FrameCriterion::Flip,
            name: "largest FLIP tile".to_owned(),
            value,
            bound: 0.01,
            place: Some(Rect::new(1, 2, 16, 16)),
            note: Some("alpha".to_owned()),
        };
        for value in [0.25, 1e-300, f64::INFINITY] {
            let text = serde_json::to_string(&margin(value)).expect("plain data");
            let read: CriterionMargin = serde_json::from_str(&text).expect("as written");
            assert_eq!(read, margin(value), "{text}");
        }
        let text = serde_json::to_string(&margin(f64::NAN)).expect("plain data");
        let read: CriterionMargin = serde_json::from_str(&text).expect("as written");
        assert!(read.value.is_nan() && !read.passes(), "{text}");
    }

    #[test]
    fn facts_of_another_version_or_shape_have_their_errors() {
        assert_eq!(Provenance::parse(r#"{"schema": 2}"#), Err(ProvenanceError::Newer(2)));
        let escape = r#"{"schema": 1, "adapter": {"name": "\u001b[31mred"}}"#;
        let error = Provenance::parse(escape).expect_err("a terminal's escape").to_string();
        assert!(error.contains("it has control characters"), "{error}");
        for damaged in ["", "{}", "[]", r#"{"schema": "one"}"#, r#"{"schema": 1}"#] {
            let error = Provenance::parse(damaged).expect_err(damaged);
            assert!(matches!(error, ProvenanceError::Damaged(_)), "{damaged}: {error}");
        }
    }
}
