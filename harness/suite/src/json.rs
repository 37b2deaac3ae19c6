//! Reads JSON, and rejects duplicate members, because one of the two values must be a mistake.

use std::fmt;

use karat::unstable::value::Shape;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

use crate::domains::lanes;

/// Parses JSON.
///
/// # Errors
/// Returns an error if the text isn't JSON, or an object has two members with the same name.
pub fn json(text: &str) -> Result<Value, serde_json::Error> {
    serde_json::from_str::<Strict>(text).map(|strict| strict.0)
}

/// Reads a value of type `shape` from JSON, and returns its lanes. A structure is an object with its members; a vector
/// or an array is a list.
///
/// # Errors
/// Returns an error if the text isn't JSON, or its value doesn't have this type.
pub fn lanes_of_json(shape: &Shape, text: &str) -> Result<Vec<u32>, String> {
    let value = json(text).map_err(|error| error.to_string())?;
    let value = toml::Value::try_from(value).map_err(|_| "`null` isn't a value".to_owned())?;
    lanes(shape, &value)
}

struct Strict(Value);

impl<'de> Deserialize<'de> for Strict {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Reader).map(Self)
    }
}

struct Reader;

impl<'de> Visitor<'de> for Reader {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        Number::from_f64(value).map(Value::Number).ok_or_else(|| E::custom("not a finite number"))
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Value, A::Error> {
        let mut all = Vec::new();
        while let Some(Strict(element)) = elements.next_element()? {
            all.push(element);
        }
        Ok(Value::Array(all))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut all = Map::new();
        while let Some(name) = members.next_key::<String>()? {
            let Strict(value) = members.next_value()?;
            if all.contains_key(&name) {
                return Err(A::Error::custom(format!("`{name}` is given twice")));
            }
            all.insert(name, value);
        }
        Ok(Value::Object(all))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_are_given_once() {
        let text = r#"{"a": [1, -2, 0.5, true, null, "x"], "b": {"a": 1e3}}"#;
        let plain: Value = serde_json::from_str(text).expect("valid JSON");
        assert_eq!(json(text).expect("nothing is given twice"), plain);
        for twice in [r#"{"a": 1, "a": 1}"#, r#"[{"b": {"a": 1, "c": 2, "a": 3}}]"#] {
            let error = json(twice).expect_err("`a` has two values").to_string();
            assert!(error.starts_with("`a` is given twice at line 1"), "{error}");
        }
        assert!(json("{").is_err() && json("1 2").is_err());
    }
}
