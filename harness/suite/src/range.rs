//! The range of `in_range`, which may exclude its upper end.

use std::fmt;
use std::ops::{Bound, RangeBounds};

use serde::Deserialize;

/// A range: `[0, 1]`, `"0..1"`, or `"0..<1"`, which excludes the upper end.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "toml::Value")]
pub(crate) struct Range {
    least: f64,
    most: f64,
    /// `true` if the range excludes the upper end.
    half_open: bool,
}

impl Range {
    pub(crate) fn bounds(self) -> (Bound<f64>, Bound<f64>) {
        let most = if self.half_open { Bound::Excluded } else { Bound::Included };
        (Bound::Included(self.least), most(self.most))
    }

    pub(crate) fn contains(self, value: f64) -> bool {
        self.bounds().contains(&value)
    }

    /// Returns the range, or an error if it contains no number.
    pub(crate) fn checked(self) -> Result<Self, String> {
        let is_some = if self.half_open { self.least < self.most } else { self.least <= self.most };
        let quote = if self.half_open { "\"" } else { "" };
        let wrong = || {
            format!(
                "in_range = {quote}{self}{quote} contains no number: write the lower end first, then a higher end"
            )
        };
        if is_some { Ok(self) } else { Err(wrong()) }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { least, most, half_open } = self;
        if *half_open { write!(f, "{least}..<{most}") } else { write!(f, "[{least}, {most}]") }
    }
}

impl TryFrom<toml::Value> for Range {
    type Error = String;

    fn try_from(value: toml::Value) -> Result<Self, String> {
        #[expect(clippy::cast_precision_loss, reason = "ends of 2^53 and above are rounded")]
        let number = |value: &toml::Value| {
            let number = value.as_float().or_else(|| value.as_integer().map(|one| one as f64));
            number.ok_or_else(|| format!("an end of a range must be a number, but is {value}"))
        };
        match &value {
            toml::Value::Array(list) => match &**list {
                [least, most] => {
                    let (least, most) = (number(least)?, number(most)?);
                    Ok(Self { least, most, half_open: false })
                }
                list => Err(format!("the list must have two entries, but has {}", list.len())),
            },
            toml::Value::String(text) => {
                let wanted = || format!("`{text}` isn't a range: write [0, 1], or \"0..<1\"");
                let (least, most) = text.split_once("..").ok_or_else(wanted)?;
                let end = most.strip_prefix('<');
                // Rejects `0...1`, which isn't `0..` followed by the fraction `.1`.
                let parsed = |end: &str| {
                    let number = end.trim().parse::<f64>().ok().filter(|_| !end.starts_with('.'));
                    number.ok_or_else(wanted)
                };
                Ok(Self {
                    least: parsed(least)?,
                    most: parsed(end.unwrap_or(most))?,
                    half_open: end.is_some(),
                })
            }
            other => Err(format!("write a range as [0, 1] or \"0..<1\", not as {other}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Range;

    #[test]
    fn a_range_may_include_or_exclude_its_upper_end() {
        let bounds =
            |text: &str| Range::try_from(toml::Value::from(text)).map(|one| one.to_string());
        assert_eq!(bounds("0..1").as_deref(), Ok("[0, 1]"));
        assert_eq!(bounds("-1.5 .. 2").as_deref(), Ok("[-1.5, 2]"));
        assert_eq!(bounds("0..<1").as_deref(), Ok("0..<1"));
        for wrong in ["0...1", "0..=1", "0..", "..1", "0..<", "1"] {
            assert!(bounds(wrong).is_err(), "{wrong}");
        }
    }
}
