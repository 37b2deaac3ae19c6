//! Serializes NaN and infinities as text (`NaN`, `inf`), because JSON has no such numbers.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Number {
    Finite(f64),
    Other(String),
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "what serde calls it with")]
pub(in super::super) fn serialize<S: Serializer>(
    value: &f64,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let number =
        if value.is_finite() { Number::Finite(*value) } else { Number::Other(value.to_string()) };
    number.serialize(serializer)
}

pub(in super::super) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<f64, D::Error> {
    match Number::deserialize(deserializer)? {
        Number::Finite(value) => Ok(value),
        Number::Other(text) => text.parse().map_err(serde::de::Error::custom),
    }
}
