//! Values of features, in conditions and for `#{NAME}`.

use std::ops::Range;
use std::sync::Arc;

use super::Reader;
use super::ahead::value_of;
use crate::diagnostic::{Diagnostic, Mend, Span};
use crate::package::PackageError;
use crate::package::feature::{Feature, is_on};

impl Reader<'_> {
    pub(super) fn braced(&mut self, at: usize) -> Result<(), PackageError> {
        let rest = &self.text()[at..];
        let Some(length) = rest.find('}') else {
            return Err(self.error(at..at + 2, "the `}` of this `#{` is missing"));
        };
        let name = rest[2..length].trim().to_owned();
        self.value(at..at + length + 1, name)
    }

    /// Replaces a range by the value of a feature.
    pub(super) fn value(&mut self, range: Range<usize>, name: String) -> Result<(), PackageError> {
        let Some(value) = self.features.get(&name).copied() else {
            return Err(self.no_value(&name, range));
        };
        let value = value.to_string();
        let (before, after) = (&self.text()[..range.start], &self.text()[range.end..]);
        let is_part = |c: char| c.is_alphanumeric() || c == '_';
        // In `#{COUNT}u`, the suffix belongs to the number.
        let suffix = after.chars().take_while(|c| is_part(*c)).count();
        if before.ends_with(is_part)
            || suffix > 1
            || suffix == 1 && !after.starts_with(['u', 'i', 'f', 'h'])
        {
            return Err(self.error(range, "a feature's value can't be a part of a name"));
        }
        self.mask(range.start..range.end + suffix);
        // Code that reads tokens sees the part of the value that fits. The text gets the whole value.
        for (byte, new) in self.bytes[range.clone()].iter_mut().zip(value.bytes()) {
            *byte = new;
        }
        self.found.replaced.push((range, value));
        Ok(())
    }

    pub(super) fn no_value(&self, name: &str, range: Range<usize>) -> PackageError {
        let span = Span { file: Arc::clone(self.file), range };
        let diagnostic = Diagnostic::new(format!("feature `{name}` has no value"))
            .at(span, "")
            .note(format!(
                "set the value: `.feature(\"{name}\", 3)` in Rust, or `--feature {name}=3`"
            ))
            .mended_by(Some(Mend::Feature(name.to_owned())));
        PackageError::Shader(Box::new(diagnostic))
    }

    pub(super) fn holds(
        &self,
        word: &str,
        rest: &str,
        whole: &Range<usize>,
    ) -> Result<bool, PackageError> {
        if word != "if" {
            if rest.is_empty() || rest.contains(char::is_whitespace) {
                return Err(
                    self.error(whole.clone(), &format!("`#{word}` needs exactly one feature"))
                );
            }
            return Ok(is_on(&self.features, rest) == (word == "ifdef"));
        }
        let wrong = "an `#if` must compare a feature with a value: `#if NAME >= 3`";
        let at = rest.find(['=', '!', '<', '>']);
        let at = at.ok_or_else(|| self.error(whole.clone(), wrong))?;
        let (name, rest) = (rest[..at].trim(), &rest[at..]);
        let length = rest.find(|c| !matches!(c, '=' | '!' | '<' | '>')).unwrap_or(rest.len());
        let (operator, value) = (&rest[..length], rest[length..].trim());
        let value = self.parsed(value, whole)?;
        let holds: fn(std::cmp::Ordering) -> bool = match operator {
            "==" => std::cmp::Ordering::is_eq,
            "!=" => std::cmp::Ordering::is_ne,
            ">" => std::cmp::Ordering::is_gt,
            ">=" => std::cmp::Ordering::is_ge,
            "<" => std::cmp::Ordering::is_lt,
            "<=" => std::cmp::Ordering::is_le,
            _ => return Err(self.error(whole.clone(), wrong)),
        };
        // A feature that isn't set is neither equal to a value nor different from it.
        let Some(own) = self.features.get(name) else {
            return Err(self.no_value(name, whole.clone()));
        };
        let equality = matches!(operator, "==" | "!=");
        let order = match (own, value) {
            (Feature::Number(own), Feature::Number(value)) => own.cmp(&value),
            (Feature::Flag(own), Feature::Flag(value)) if equality => own.cmp(&value),
            (own, value) => {
                let message = format!(
                    "feature `{name}` is {own}, which doesn't allow the comparison `{operator} {value}`"
                );
                return Err(self.error(whole.clone(), &message));
            }
        };
        Ok(holds(order))
    }

    /// The value in a `#define` or `#if`. A feature without a value is on.
    pub(super) fn parsed(
        &self,
        value: &str,
        whole: &Range<usize>,
    ) -> Result<Feature, PackageError> {
        let wrong =
            || self.error(whole.clone(), "a value must be a whole number, `true` or `false`");
        value_of(value).ok_or_else(wrong)
    }
}
