//! Hazards that are less than others: a later operation drops each of them, or no caller gives such arguments.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::{Hazard, Kind};
use crate::interpret::hazards::Fine;
use crate::package::Package;
use crate::package::stage::Stage;
use crate::reflect::{Idiom, Program};

/// Why a hazard is less than others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Lowered {
    /// The result is finite in each case: a `select` or a branch drops the value, or `clamp`, `min` or `max` bounds an
    /// infinity.
    Hidden,
    /// It reads the bits of a number, and these were drawn at random, or its author wrote them.
    Bits,
    /// Each case has a number beyond 10,000 of which nothing is known, one within 1e-10 of 0, or a matrix without an inverse.
    Extreme,
    /// A float that becomes an integer, edges of `clamp`, or an index that wraps, of numbers of which nothing is known; a place in a
    /// texture, or in an array as long as its buffer, whose sizes are made up; or an element by the counter of a loop whose end
    /// is no constant.
    Guessed,
    /// WGSL has no bound for it: a sine or a cosine beyond pi, an arcsine or arccosine by `atan2` of a zero, a power of 0, or a
    /// determinant. Or a sine or a cosine is near its zero, where it has few digits.
    Builtin,
    /// The whole part of a number is taken off, and digits with it: a hash, or a place within a tile.
    Remainder,
    /// The same operation is NaN for other arguments, a hazard of its own.
    Nan,
    /// The contents of buffers decide it alone: it is fine over others, or an index or a loop that buffers of zeros don't have.
    Contents,
    /// Two computed numbers of which nothing is known are so close that their difference has few digits; or of those that are
    /// known, in fewer than one case in a hundred.
    Close,
    /// A quotient, a product or a power is infinite, or without a bound in WGSL, of numbers of which nothing is known; or a quotient
    /// is NaN, and infinite as often: its divisor is 0, whatever it divides.
    Arithmetic,
    /// Nothing is known of the arguments, and the functions that lead here, and that no other one calls, don't show it.
    Called,
    /// The functions and entry points that lead here were looked at as well: each ran the operation often, and it was
    /// fine; or has no hazard of this kind at all.
    Callers,
}

impl Lowered {
    /// The reason in words.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Hidden => "a later operation drops it in each case that was drawn",
            Self::Bits => {
                "each word is some number, and this one was made up, or its author wrote it"
            }
            Self::Extreme => {
                "each case has a number beyond 10,000 of which nothing is known, one within 1e-10 of 0, or a matrix without an inverse"
            }
            Self::Guessed => {
                "nothing is known of the numbers, the texture or the buffer that it was asked with"
            }
            Self::Builtin => {
                "WGSL has no bound for this function there, or few digits are left: no other way to write it is better"
            }
            Self::Remainder => "the whole part of a number is taken off, and digits with it",
            Self::Nan => "it is NaN for other arguments, a hazard of its own",
            Self::Contents => "a buffer's contents decide it alone, and over others it is fine",
            Self::Close => {
                "two computed numbers are nearly the same, in few of the cases, or nothing is known of them"
            }
            Self::Arithmetic => {
                "nothing is known of its numbers: by 0, or by large ones, it is infinite"
            }
            Self::Called => {
                "nothing is known of the arguments, and it wasn't seen in the functions that lead here"
            }
            Self::Callers => {
                "no function that leads here called it with such arguments, of those that were drawn"
            }
        }
    }
}

/// Cases in which an operation has to be fine where another function leads to it: edges of its inputs are among the
/// first hundred.
const ENOUGH: usize = 256;

/// Of one difference in so many it says little that few digits are left, though all arguments are known: any two numbers may
/// meet.
const RARELY: usize = 100;

/// Who calls whom in a package, and who was looked at whole.
#[derive(Debug, Default)]
pub(super) struct Callers {
    /// Functions by those that they call.
    by_called: BTreeMap<String, BTreeSet<String>>,
    /// Functions all of whose operations and inputs were looked at.
    whole: BTreeSet<String>,
    /// Of each function the cases in which an operation was fine, by its place.
    fine: BTreeMap<String, Fine>,
    /// The words of modules that aren't valid: they may call each function of such a name.
    unsure: BTreeSet<String>,
    /// False if a module can't be read: it may call anything.
    complete: bool,
    /// Compute entry points.
    passes: BTreeSet<String>,
}

impl Callers {
    pub(super) fn of(
        package: &Package,
        whole: BTreeSet<String>,
        fine: BTreeMap<String, Fine>,
    ) -> Self {
        let mut callers = Self { whole, fine, complete: true, ..Self::default() };
        for module in package.modules().unwrap_or_default() {
            let Ok(items) = package.functions_in(&module) else {
                callers.complete = false;
                continue;
            };
            let whole = Program::of_module(package, &module).ok();
            if whole.is_none() {
                match package.words_of(&module) {
                    Some(words) => callers.unsure.extend(words),
                    None => callers.complete = false,
                }
            }
            for item in items {
                if item.entry_point == Some(Stage::Compute) {
                    callers.passes.insert(item.name.clone());
                }
                // Of a module that isn't valid some functions are.
                let own = item.name.rsplit("::").next().unwrap_or_default();
                let alone = || Program::of_items(package, &module, &[own]).ok();
                let Some(program) = whole.clone().or_else(alone) else { continue };
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

    /// Why a hazard is less than others, if it is. `of_kind` has each function with the kinds of hazards in it, and
    /// `now_and_then` the functions that have this one rarely.
    pub(super) fn lower(
        &self,
        hazard: &Hazard,
        of_kind: &BTreeSet<(String, Kind)>,
        now_and_then: &BTreeSet<&str>,
    ) -> Option<Lowered> {
        if hazard.hidden {
            return Some(Lowered::Hidden);
        }
        let is_float = matches!(hazard.kind, Kind::Nan | Kind::Infinite);
        if is_float && hazard.guessed && hazard.idiom == Some(Idiom::Bits) {
            return Some(Lowered::Bits);
        }
        if hazard.idiom == Some(Idiom::WrittenBits) {
            return Some(Lowered::Bits);
        }
        if hazard.extreme {
            return Some(Lowered::Extreme);
        }
        let is_bound = match hazard.kind {
            // The numbers of a pass are all made up.
            Kind::Saturated => hazard.guessed || self.passes.contains(&hazard.function),
            Kind::EdgesReversed => hazard.guessed && hazard.idiom == Some(Idiom::Clamp),
            Kind::OutOfRange => hazard.of_made_up_size || hazard.idiom == Some(Idiom::Counted),
            Kind::Wrapped => hazard.guessed,
            _ => false,
        };
        if is_bound {
            return Some(Lowered::Guessed);
        }
        if let Some(lowered) = hazard.idiom.and_then(|idiom| of_idiom(hazard.kind, idiom)) {
            return Some(lowered);
        }
        if own_functions(hazard).next().is_none() {
            return Some(Lowered::Contents);
        }
        let (cases, of) = hazard.cases;
        if hazard.kind == Kind::LostDigits
            && (hazard.guessed || cases * RARELY < of)
            && hazard.idiom != Some(Idiom::Complement)
        {
            return Some(Lowered::Close);
        }
        if hazard.violation.is_some() || hazard.kind == Kind::Endless {
            return None;
        }
        let is_large = matches!(hazard.kind, Kind::Infinite | Kind::Unbounded);
        let is_arithmetic =
            matches!(hazard.idiom, Some(Idiom::Quotient | Idiom::Product | Idiom::Power));
        let by_callers = self.by_callers(hazard, of_kind, now_and_then);
        // No caller prevents a hazard that each input has.
        let is_chosen = hazard.guessed && hazard.cases.0 < hazard.cases.1;
        by_callers.or((is_chosen && is_large && is_arithmetic).then_some(Lowered::Arithmetic))
    }

    /// Why the functions that lead to a hazard make it less than others, if they do.
    fn by_callers(
        &self,
        hazard: &Hazard,
        of_kind: &BTreeSet<(String, Kind)>,
        now_and_then: &BTreeSet<&str>,
    ) -> Option<Lowered> {
        let mut all = BTreeSet::new();
        for function in own_functions(hazard) {
            let roots = self.roots(function);
            if roots.is_empty() {
                return None;
            }
            all.extend(roots);
        }
        let is_float = matches!(hazard.kind, Kind::Nan | Kind::Infinite);
        let has_it = |root: &str| {
            now_and_then.contains(root) || own_functions(hazard).any(|function| function == root)
        };
        // Of the other kinds a function or a pass reports some alone: that a caller has none says nothing.
        let is_seen = is_float || matches!(hazard.kind, Kind::ByZero | Kind::OutOfRange);
        let may_be_called = |function: &str| {
            let name = function.rsplit("::").next().unwrap_or_default();
            !self.complete || self.unsure.contains(name)
        };
        // Of each kind the first operation of a case alone is reported: another one may stand before this one.
        let is_free = |root: &str| {
            self.whole.contains(root) && !of_kind.contains(&(root.to_owned(), hazard.kind))
        };
        // But each operation that is kept has its numbers, also where another one stands in the report.
        let ran_fine = |root: &str| {
            let count = self.fine.get(root).and_then(|fine| fine.get(&hazard.location)?.all);
            let is_known = is_float && self.whole.contains(root);
            is_known && count.is_some_and(|count| count >= ENOUGH)
        };
        let is_clean = |root: &&str| is_free(root) || ran_fine(root) && !has_it(root);
        if is_seen && !hazard.functions().any(may_be_called) && all.iter().all(is_clean) {
            return Some(Lowered::Callers);
        }
        let could_show = |root: &&str| is_seen || !self.passes.contains(*root);
        let is_unknown = all.iter().all(|root| could_show(root) && !has_it(root));
        (hazard.guessed && is_unknown).then_some(Lowered::Called)
    }
}

/// True of a quotient of numbers of which nothing is known that is NaN, and infinite as often. Where the divisor and what it
/// divides become 0 together, as in `dot(p, v) / dot(v, v)`, NaN is more frequent.
pub(super) fn is_by_zero(nan: &Hazard, infinite: &Hazard) -> bool {
    let is_as_often = infinite.cases.0 * nan.cases.1 >= nan.cases.0 * infinite.cases.1;
    let is_likely = !infinite.extreme && nan.cases.0 < nan.cases.1;
    nan.guessed && nan.idiom == Some(Idiom::Quotient) && is_likely && is_as_often
}

/// The functions of a hazard that have it over contents of buffers that don't decide it alone.
fn own_functions(hazard: &Hazard) -> impl Iterator<Item = &str> {
    hazard.functions().filter(|function| !hazard.by_contents.contains(*function))
}

/// Why an operation that many write is less than others.
fn of_idiom(kind: Kind, idiom: Idiom) -> Option<Lowered> {
    let is_either = matches!(kind, Kind::Unbounded | Kind::LostDigits);
    match idiom {
        Idiom::Builtin if is_either => Some(Lowered::Builtin),
        // A power of 0 with an exponent above it is 0; of another one it may be anything.
        Idiom::Power if kind == Kind::Unbounded => Some(Lowered::Builtin),
        Idiom::Remainder if kind == Kind::LostDigits => Some(Lowered::Remainder),
        _ => None,
    }
}

/// The shape of an operation, for those that many write alike: names that aren't called, and numbers, are left out;
/// types and members of results stay.
/// `fract(sin(dot(uv, vec2(12.9898, 78.233))) * 43758.5453)` is `fract(sin(dot(_, vec2(#, #))) * #)`.
pub(super) fn idiom(text: &str) -> String {
    let is_part = |c: char| c == '_' || c == '.' || c.is_alphanumeric();
    let (mut shape, mut rest) = (String::new(), text);
    let is_template = |after: &str| after.starts_with('<') && after.contains(">(");
    while let Some(first) = rest.chars().next() {
        if !is_part(first) {
            shape.push(first);
            rest = &rest[first.len_utf8()..];
            continue;
        }
        let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        let (word, after) = rest.split_at(end);
        match first {
            _ if after.starts_with('(') || is_template(after) || shape.ends_with('<') => {
                shape.push_str(word)
            }
            '.' if shape.ends_with([')', ']']) => shape.push_str(word),
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
        assert_eq!(idiom("normalize(v).x"), "normalize(_).x");
        assert_eq!(idiom("bitcast<f32>(a.b[i + 3u])"), "bitcast<f32>(_[_ + #])");
        assert_ne!(idiom("vec3<f32>(a)"), idiom("bitcast<f32>(a)"));
        assert_ne!(idiom("a / b"), idiom("a * b"));
    }
}
