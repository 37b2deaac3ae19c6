//! Hazards that are less than others: a later operation drops each of them, or no caller gives such arguments.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::{Hazard, Kind};
use crate::package::Package;
use crate::reflect::Program;

/// Why a hazard is less than others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Lowered {
    /// The result is finite in each case: a `select` or a branch drops the value, or `clamp`, `min` or `max` an infinity.
    Hidden,
    /// It reads the bits of a number, and these were drawn at random.
    Bits,
    /// The functions and entry points that lead here were looked at as well, and none of them has it.
    Callers,
}

impl Lowered {
    /// The reason in words.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Hidden => "a later operation drops it in each case",
            Self::Bits => "each word is some number, and this one was made up",
            Self::Callers => "no function that leads here calls it with such arguments",
        }
    }
}

/// Who calls whom in a package, and who was looked at whole.
#[derive(Debug, Default)]
pub(super) struct Callers {
    /// Functions by those that they call.
    by_called: BTreeMap<String, BTreeSet<String>>,
    /// Functions all of whose operations and inputs were looked at.
    whole: BTreeSet<String>,
    /// The words of modules that aren't valid: they may call each function of such a name.
    unsure: BTreeSet<String>,
    /// False if a module can't be read: it may call anything.
    complete: bool,
}

impl Callers {
    pub(super) fn of(package: &Package, whole: BTreeSet<String>) -> Self {
        let mut callers = Self { whole, complete: true, ..Self::default() };
        for module in package.modules().unwrap_or_default() {
            let (Ok(program), Ok(items)) =
                (Program::of_module(package, &module), package.functions_in(&module))
            else {
                match package.words_of(&module) {
                    Some(words) => callers.unsure.extend(words),
                    None => callers.complete = false,
                }
                continue;
            };
            for item in items {
                for called in program.calls(&item.name) {
                    callers.by_called.entry(called).or_default().insert(item.name.clone());
                }
            }
        }
        callers
    }

    /// The functions that lead to this one and that nothing calls. None, if nothing calls this one.
    fn roots<'c>(&'c self, function: &'c str) -> BTreeSet<&'c str> {
        let (mut roots, mut seen) = (BTreeSet::new(), BTreeSet::from([function]));
        let mut open = vec![function];
        while let Some(one) = open.pop() {
            match self.by_called.get(one) {
                None if one != function => drop(roots.insert(one)),
                None => {}
                Some(all) => {
                    open.extend(all.iter().map(String::as_str).filter(|one| seen.insert(one)))
                }
            }
        }
        roots
    }

    /// Why a hazard is less than others, if it is. `rare` are those that were found seldom.
    pub(super) fn lower(
        &self,
        hazard: &Hazard,
        rare: &BTreeMap<(String, Kind), Hazard>,
    ) -> Option<Lowered> {
        if hazard.hidden {
            return Some(Lowered::Hidden);
        }
        // Each word is a float in some case, if bits are drawn at random.
        if hazard.guessed && hazard.text.starts_with("bitcast<f") {
            return Some(Lowered::Bits);
        }
        let name = hazard.function.rsplit("::").next().unwrap_or_default();
        if !self.complete || self.unsure.contains(name) {
            return None;
        }
        let roots = self.roots(&hazard.function);
        let seldom = rare.get(&(hazard.location.clone(), hazard.kind));
        let have = [Some(hazard), seldom].into_iter().flatten();
        let have: BTreeSet<&str> = have
            .flat_map(|one| std::iter::once(&one.function).chain(&one.also))
            .map(String::as_str)
            .collect();
        let none = roots.iter().all(|root| self.whole.contains(*root) && !have.contains(root));
        (!roots.is_empty() && none).then_some(Lowered::Callers)
    }
}

/// The shape of an operation, for those that many write alike: names that aren't called, and numbers, are left out.
/// `fract(sin(dot(uv, vec2(12.9898, 78.233))) * 43758.5453)` is `fract(sin(dot(_, vec2(#, #))) * #)`.
pub(super) fn idiom(text: &str) -> String {
    let is_part = |c: char| c == '_' || c == '.' || c.is_alphanumeric();
    let (mut shape, mut rest) = (String::new(), text);
    while let Some(first) = rest.chars().next() {
        if !is_part(first) {
            shape.push(first);
            rest = &rest[first.len_utf8()..];
            continue;
        }
        let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        let (word, after) = rest.split_at(end);
        match first {
            _ if after.starts_with('(') => shape.push_str(word),
            '0'..='9' | '.' => shape.push('#'),
            _ => shape.push('_'),
        }
        rest = after;
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::idiom;

    #[test]
    fn operations_of_one_shape_are_alike() {
        let hash = |name: &str, number: &str| {
            format!("fract(sin(dot({name}.xy, vec2({number}, 78.233))) * 43758.5)")
        };
        assert_eq!(idiom(&hash("uv", "12.9898")), "fract(sin(dot(_, vec2(#, #))) * #)");
        assert_eq!(idiom(&hash("uv", "12.9898")), idiom(&hash("p", ".5")));
        assert_eq!(idiom("pow(c, 2.2)"), idiom("pow(color.rgb, 2.4)"));
        assert_ne!(idiom("pow(c, 2.2)"), idiom("pow(2.2, c)"));
        assert_ne!(idiom("a / b"), idiom("a * b"));
    }
}
