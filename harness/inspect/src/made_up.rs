//! Generates arguments and resources for functions without a test. [`hazards`](mod@crate::hazards),
//! [`compare`](mod@crate::compare), [`matrix`](mod@crate::matrix) and tests in `*.test.toml` use this module.
//!
//! The range of a number is the one that [`Ranges`] declares for its name. Without a declaration, the name may suggest
//! a range (`n_dot_l`, `NoV`, `worldNormal`, `perceptualRoughness`). Otherwise the type determines the range. The
//! inputs include both ends of each range, and 0 and 1 if the range contains them. Members of structures and buffers
//! get their values by the same rules.

#[cfg(test)]
mod bounds;
mod content;
mod extents;
mod meaning;
mod resources;

use std::collections::{BTreeMap, BTreeSet};

use karat::package::{Package, PackageError};
use karat::unstable::package::{Declaration, End, declared_hazards, scope};
use karat::unstable::reflect::{Function, Literals, Program};
use karat_core::domain::{Dynamic, Numbering, Part, Stream};
use karat_core::value::{Scalar, Shape};

use meaning::Meaning;

pub(crate) use content::{Content, Numbered};
pub(crate) use extents::Extents;
pub(crate) use resources::fitted;
pub(crate) use resources::{INVOCATIONS, SEED, beyond, data, fixtures};
pub(crate) use resources::{Input, Mix, Resources};

/// The declared ranges of arguments and members, by name. Declarations are in `[inputs]` of `karat.toml` or in `karat
/// hazards --input`.
///
/// A name is an argument's name (`roughness`), a member's name (`groups`), or a member's name after the name of its
/// variable or argument (`params.groups`). The last form has precedence.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranges {
    declared: BTreeMap<String, Declaration>,
    /// The arguments and members that are builtin values, each with the builtin value's name.
    builtins: Vec<(String, String)>,
    extents: Option<Extents>,
    /// `true` if a range that a name suggests counts as declared.
    named: bool,
    /// `true` to ignore names. An undeclared input then has any value of its type.
    nameless: bool,
    /// `true` if unconstrained numbers of buffers are negative.
    negative: bool,
    /// The numbers in the shader's text, if inputs also take their values from there.
    literals: Option<Literals>,
    /// The overrides' values in `karat.toml`.
    overrides: BTreeMap<String, f64>,
}

impl Ranges {
    /// Reads the ranges that a package's `karat.toml` declares.
    ///
    /// # Errors
    /// Returns an error if `karat.toml` can't be read.
    pub fn of(package: &Package) -> Result<Self, PackageError> {
        let hazards = declared_hazards(package)?;
        Ok(Self { declared: hazards.inputs, overrides: hazards.overrides, ..Self::default() })
    }

    /// Declares the range of a name, from `least` to `most`. Replaces an earlier declaration.
    ///
    /// # Errors
    /// Returns an error, as a sentence, if an end isn't finite, or if `least` is above `most`.
    pub fn declare(&mut self, name: &str, least: f64, most: f64) -> Result<(), String> {
        if !(least <= most && least.is_finite() && most.is_finite()) {
            return Err(format!(
                "the input `{name}` is declared from {least} to {most}, which isn't a range"
            ));
        }
        self.declared.insert(name.to_owned(), Declaration::Range(least, most));
        Ok(())
    }

    pub(crate) fn names(&self) -> impl Iterator<Item = &String> {
        self.declared.keys()
    }

    pub(crate) fn without(&self, name: &str) -> Self {
        let mut all = self.clone();
        all.declared.remove(name);
        all
    }

    pub(crate) fn overrides(&self) -> &BTreeMap<String, f64> {
        &self.overrides
    }

    /// Returns the ranges for one function. Declarations for only this function have precedence.
    #[must_use]
    pub(crate) fn scoped(&self, function: &str) -> Self {
        let mut all = self.clone();
        for (key, declared) in &self.declared {
            if let (Some(of), own) = scope(key)
                && of == function
            {
                all.declared.insert(own.to_owned(), declared.clone());
            }
        }
        all
    }

    /// Records in `drawn` which declared array lengths apply to one of the bindings, and which declared number of
    /// workgroups applies to the pass.
    pub(crate) fn note_sizes<'b>(
        &self,
        bindings: impl Iterator<Item = &'b str>,
        pass: Option<&str>,
        drawn: &mut Drawn,
    ) {
        let own = |path: &str| path.rsplit("::").next().unwrap_or(path).to_owned();
        let lengths = bindings.map(|binding| format!("length({})", own(binding)));
        let passes = pass.into_iter().flat_map(|pass| [pass.to_owned(), own(pass)]);
        let all = lengths.chain(passes.map(|pass| format!("workgroups({pass})")));
        all.filter(|key| self.declared.contains_key(key)).for_each(|key| drawn.add(key));
    }

    /// Returns the number of elements of a runtime-sized array, or `usual` without a declaration. If `least` is `true`,
    /// returns the smallest number in the declared range.
    pub(crate) fn length(&self, binding: &str, usual: u32, least: bool) -> u32 {
        let own = binding.rsplit("::").next().unwrap_or(binding);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it saturates")]
        match self.declared.get(&format!("length({own})")) {
            Some(Declaration::Range(from, _)) if least => from.ceil() as u32,
            Some(Declaration::Range(from, to)) => {
                usual.clamp(from.ceil() as u32, (to.floor() as u32).max(from.ceil() as u32))
            }
            Some(Declaration::MultipleOf(of)) => usual.max(1).next_multiple_of(*of),
            _ => usual,
        }
    }

    /// The number of workgroups of a pass in each direction; `usual` without a declaration. With a declaration, the
    /// product of the three numbers is in the declared range.
    pub(crate) fn workgroups(&self, pass: &str, usual: [u32; 3]) -> [u32; 3] {
        let own = pass.rsplit("::").next().unwrap_or(pass);
        let keys = [pass, own].map(|name| format!("workgroups({name})"));
        let declared = keys.iter().find_map(|key| self.declared.get(key));
        let Some(Declaration::Range(least, most)) = declared else { return usual };
        let total = usual.iter().fold(1_u32, |all, count| all.saturating_mul(*count));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it saturates")]
        let [least, most] = [least.ceil() as u32, most.floor() as u32];
        match total.clamp(least.max(1), most.max(least).max(1)) {
            same if same == total => usual,
            other => [other, 1, 1],
        }
    }

    /// Returns ranges for a function without callers: each range that a name suggests counts as declared.
    #[must_use]
    pub(crate) fn with_names(&self) -> Self {
        Self { named: true, ..self.clone() }
    }

    #[must_use]
    pub(crate) fn without_names(&self) -> Self {
        Self { nameless: true, ..self.clone() }
    }

    /// Returns the ranges with negative numbers for unconstrained inputs in buffers.
    #[must_use]
    pub(crate) fn negative(&self) -> Self {
        Self { negative: true, ..self.clone() }
    }

    /// Returns the ranges with the numbers in a shader's text as further values of inputs. The shader may compare
    /// inputs with these numbers.
    #[must_use]
    pub(crate) fn with_literals(&self, literals: Literals) -> Self {
        Self { literals: Some(literals), ..self.clone() }
    }

    /// Sets the value of an `override`, by its name or its `@id`, in each function that uses it.
    pub(crate) fn set_override(&mut self, name: &str, value: f64) {
        self.overrides.insert(name.to_owned(), value);
    }

    pub(crate) fn overrides_of(&self, package: &Package, name: &str) -> BTreeMap<String, f64> {
        if self.overrides.is_empty() {
            return BTreeMap::new();
        }
        let program = Program::of_function(package, name).ok();
        let has =
            |name: &String| program.as_ref().is_some_and(|program| program.has_override(name));
        self.overrides
            .iter()
            .filter(|(name, _)| has(name))
            .map(|(name, x)| (name.clone(), *x))
            .collect()
    }

    /// The numbers of a type in the shader's text, each with the next smaller and the next larger number. The order of
    /// the numbers depends on the input's name. For integers, 0 comes before the numbers of the text. For `i32`, -1
    /// follows 0.
    fn beside(&self, path: &str, scalar: Scalar) -> Vec<Vec<u32>> {
        let Some(literals) = &self.literals else { return Vec::new() };
        let mut all: Vec<[u32; 3]> = match scalar {
            Scalar::F32 => {
                let near = |x: &f32| [*x, x.next_up(), x.next_down()].map(f32::to_bits);
                literals.floats.iter().map(near).collect()
            }
            Scalar::U32 | Scalar::I32 => {
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "of a literal of the other type"
                )]
                let near = |x: &i64| [*x, x + 1, x - 1].map(|x| x as u32);
                literals.wholes.iter().map(near).collect()
            }
            _ => return Vec::new(),
        };
        if !all.is_empty() {
            let own = usize::from(blake3::hash(path.as_bytes()).as_bytes()[0]);
            let count = all.len();
            all.rotate_left(own % count);
        }
        let least = match scalar {
            Scalar::U32 => &[0][..],
            Scalar::I32 => &[0, u32::MAX],
            _ => &[],
        };
        least.iter().chain(all.as_flattened()).map(|word| vec![*word]).collect()
    }

    /// Returns the ranges for the arguments of a function, including the builtin values of an entry point.
    #[must_use]
    pub fn of_function(&self, function: &Function) -> Self {
        Self { builtins: function.form.builtins.clone(), ..self.scoped(&function.name) }
    }

    pub(crate) fn get(&self, path: &str) -> Option<&Declaration> {
        let own = path.rsplit('.').next().unwrap_or(path);
        self.declared.get(path).or_else(|| self.declared.get(own))
    }

    /// Returns the name of the builtin value if the input at this path is a builtin value.
    fn builtin(&self, path: &str) -> Option<&str> {
        let mut all = self.builtins.iter();
        all.find(|(known, _)| known == path).map(|(_, builtin)| builtin.as_str())
    }
}

/// The parts of a [`Dynamic`] domain for an argument, from its name and type.
///
/// # Errors
/// Returns an error, as a sentence, if a declared range contains no value of the argument's type.
pub fn suggested(name: &str, shape: &Shape, ranges: &Ranges) -> Result<Vec<Part>, String> {
    Ok(described(name, shape, ranges)?.into_iter().map(|one| one.part).collect())
}

/// The largest generated derivative: the change of a number from a pixel to its neighbour.
const STEEPEST: f64 = 0.5;

const DERIVATIVES: &str = "derivatives";

/// One number or direction in an argument or a resource.
struct Described {
    path: String,
    part: Part,
    /// `true` if neither a declaration nor the name constrains the number.
    guessed: bool,
    declared: bool,
    /// `true` if the number isn't free: a declared number, a builtin value with a range in WGSL, or a float whose name
    /// counts as a declaration.
    known: bool,
    /// `true` for a size that follows from the dispatch.
    sized: bool,
    scalars: Vec<Scalar>,
}

/// Describes the numbers of an argument, in the order of its lanes.
fn described(path: &str, shape: &Shape, ranges: &Ranges) -> Result<Vec<Described>, String> {
    if let Some(value) = shape.quad() {
        let mut all = described(path, value, ranges)?;
        let values = all.len();
        for direction in [0, 1] {
            for at in 0..values {
                all.extend(slopes(&all[..values], at, direction, ranges));
            }
        }
        return Ok(all);
    }
    match shape {
        Shape::Struct { members, .. } => {
            let own = |(name, member): &(String, Shape)| {
                described(&format!("{path}.{name}"), member, ranges)
            };
            let all = members.iter().map(own).collect::<Result<Vec<_>, _>>()?;
            Ok(all.into_iter().flatten().collect())
        }
        Shape::Array { element, length } => {
            let all = (0..*length).map(|_| described(path, element, ranges));
            Ok(all.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
        }
        other => described_numbers(path, other, ranges),
    }
}

/// The derivatives of one number, horizontally or vertically.
fn slopes(values: &[Described], at: usize, direction: usize, ranges: &Ranges) -> Vec<Described> {
    let path = &values[at].path;
    let is_pixel = ranges.builtin(path) == Some(meaning::POSITION);
    let lane = values[..at].iter().rev().take_while(|before| before.path == *path).count();
    let slope = |scalar: &Scalar| {
        // The position of the next pixel differs by 1.
        let step = f32::from(u8::from(lane == direction)).to_bits();
        // Texture levels depend on the logarithm of a derivative, so small derivatives are common.
        let small = || Part::range(*scalar, -STEEPEST..=STEEPEST);
        let part = if is_pixel {
            Part::just(*scalar, step)
        } else {
            small().unwrap_or_else(|| Part::just(*scalar, 0))
        };
        Described {
            // This derivative is fixed, so it has no name in the list of ranges.
            path: if is_pixel { String::new() } else { DERIVATIVES.to_owned() },
            part,
            guessed: false,
            declared: false,
            known: false,
            sized: false,
            scalars: vec![*scalar],
        }
    };
    values[at].scalars.iter().map(slope).collect()
}

fn described_numbers(path: &str, shape: &Shape, ranges: &Ranges) -> Result<Vec<Described>, String> {
    let own = path.rsplit('.').next().unwrap_or(path);
    let declared = ranges.get(path);
    let meaning = match declared {
        Some(Declaration::Range(least, most)) => Meaning::Range(*least, *most),
        Some(_) => Meaning::Any,
        None if ranges.nameless => Meaning::Any,
        None => Meaning::of(own, shape),
    };
    let builtin = ranges.builtin(path);
    let is_whole = matches!(shape.lanes().first(), Some(Scalar::U32 | Scalar::I32));
    let one = |part, scalars| Described {
        path: path.to_owned(),
        part,
        guessed: meaning == Meaning::Any && builtin.is_none(),
        declared: declared.is_some(),
        known: declared.is_some()
            // A name doesn't limit an integer.
            || ranges.named && meaning != Meaning::Any && builtin.is_none() && !is_whole
            || builtin.is_some_and(meaning::has_range),
        sized: false,
        scalars,
    };
    if let Some(Declaration::Elements { .. }) = declared {
        return Err(format!(
            "the elements of `{path}` are declared, but its type is {shape}: write `[least, most]`"
        ));
    }
    if let Some(Declaration::Named(kind)) = declared {
        let size = match shape {
            Shape::Vector { size, scalar: Scalar::F32 } => *size,
            _ => 0,
        };
        return match Part::named(kind, size) {
            Some(part) => Ok(vec![one(part, shape.lanes())]),
            None => Err(format!("`{path}` is declared as \"{kind}\", but its type is {shape}")),
        };
    }
    if meaning == Meaning::Direction {
        return Ok(Part::named("unit_vector", 3)
            .map(|part| one(part, shape.lanes()))
            .into_iter()
            .collect());
    }
    if let (Meaning::Any, Shape::Matrix { columns, rows, .. }) = (meaning, shape)
        && !ranges.nameless
        && meaning::is_transform(own)
        && let Some(part) = Part::transform(*columns, *rows, meaning::is_projection(own))
    {
        return Ok(vec![Described { guessed: false, known: false, ..one(part, shape.lanes()) }]);
    }
    let listed = match declared {
        Some(Declaration::Values(all)) => Some(all),
        _ => None,
    };
    let part = |(lane, scalar): (usize, Scalar)| {
        if let Some(all) = listed {
            let words = all.iter().map(|x| Some(vec![exact(scalar, *x)?]));
            let words = words.collect::<Option<Vec<_>>>().ok_or_else(|| {
                let scalar = Shape::Scalar(scalar);
                format!("`{path}` is declared as one of {all:?}, but some of these numbers aren't {scalar}")
            })?;
            return Ok(one(Part::listed(vec![scalar], words), vec![scalar]));
        }
        let of_builtin = || Meaning::of_builtin(builtin?, lane);
        let of_size = || {
            // A count may be smaller than the number of elements.
            let is_named = !ranges.nameless;
            let whole = matches!(scalar, Scalar::U32 | Scalar::I32);
            let extents = ranges.extents.filter(|_| whole || scalar == Scalar::F32)?;
            let size = extents.size(own, lane, shape.lanes().len(), whole);
            let size = size.filter(|_| is_named);
            let is_unknown = whole && meaning == Meaning::Any;
            let unknown = || extents.unknown(own, lane).filter(|_| is_unknown);
            let size = f64::from(size.or_else(unknown)?);
            Some(Meaning::Range(size, size))
        };
        let meaning = match declared {
            None => of_builtin().or_else(of_size).unwrap_or(meaning),
            Some(_) => meaning,
        };
        let part = match (meaning.part(scalar), declared) {
            (Some(part), _) => part,
            (None, Some(Declaration::Range(least, most))) => {
                let scalar = Shape::Scalar(scalar);
                return Err(format!(
                    "`{path}` is declared from {least} to {most}, but no {scalar} is in this range"
                ));
            }
            // A name that suggests a number doesn't constrain a boolean, such as `is_diffuse`.
            (None, _) => Meaning::Any.part(scalar).unwrap_or_else(|| Part::just(scalar, 0)),
        };
        let sized = declared.is_none() && of_size().is_some();
        let part = match declared.is_some() || sized || builtin.is_some() {
            true => part,
            false => part.beside(ranges.beside(path, scalar), is_whole),
        };
        let one = one(part, vec![scalar]);
        Ok(Described { sized, known: one.known && !sized, ..one })
    };
    shape.lanes().into_iter().enumerate().map(part).collect()
}

/// The bits of a number, rounded for floats; `None` if an integer or a boolean can't represent the number.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked")]
fn exact(scalar: Scalar, x: f64) -> Option<u32> {
    let whole = x.fract() == 0.0;
    match scalar {
        Scalar::F32 => Some((x as f32).to_bits()),
        Scalar::F16 => Some(u32::from(half::f16::from_f64(x).to_bits())),
        Scalar::I32 if whole && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&x) => {
            Some((x as i32).cast_unsigned())
        }
        Scalar::U32 if whole && (0.0..=f64::from(u32::MAX)).contains(&x) => Some(x as u32),
        Scalar::Bool if x == 0.0 || x == 1.0 => Some(x as u32),
        _ => None,
    }
}

pub(crate) struct Arguments {
    pub(crate) domain: Dynamic,
    described: Vec<Described>,
}

impl Arguments {
    pub(crate) fn of(function: &Function, ranges: &Ranges) -> Result<Self, String> {
        let mut parts = Vec::new();
        let mut all = Vec::new();
        let ranges = ranges.of_function(function);
        for (name, shape) in &function.parameters {
            parts.push(suggested(name, shape, &ranges)?);
            all.extend(described(name, shape, &ranges)?);
        }
        Ok(Self { domain: Dynamic::new(&function.parameters, parts), described: all })
    }

    /// The domain of a fragment function's inputs. Inputs that are sizes follow from the number of pixels.
    pub(crate) fn of_draw(
        function: &Function,
        ranges: &Ranges,
        extents: Extents,
    ) -> Result<Self, String> {
        Self::of(function, &Ranges { extents: Some(extents), ..ranges.clone() })
    }

    /// The number of rows (each has the arguments of one case), at most `cases`, and the lanes (scalars) of all rows.
    /// Edges come first and are at most half of the rows. If the domain has fewer than `cases` values, each value
    /// occurs once.
    pub(crate) fn rows(&self, seed: u64, cases: usize) -> (usize, Vec<u32>) {
        let numbering = Numbering::of(&self.domain, seed, cases as u64, cases as u64);
        let mut rows = Vec::new();
        let count = self.domain.rows(&numbering, 0..numbering.count, &mut rows);
        (usize::try_from(count).unwrap_or_default(), rows)
    }

    /// At most `cases` rows. Three quarters are sampled as in [`rows`](Self::rows). The last quarter comes from
    /// `others`, which has the same arguments, but ignores the ranges that names suggest. In every second row from
    /// `others`, two undeclared inputs of the same type are equal.
    pub(crate) fn rows_beside(&self, others: &Self, seed: u64, cases: usize) -> (usize, Vec<u32>) {
        /// One in four rows comes from `others`.
        const SHARE: usize = 4;
        let (count, mut rows) = self.rows(seed, cases - cases / SHARE);
        let (more, mut of_others) = others.rows(seed, (cases - count).min(cases / SHARE));
        let lanes: Vec<Option<Scalar>> =
            self.lanes().map(|(one, scalar)| Some(scalar).filter(|_| !one.declared)).collect();
        let pairs: Vec<(usize, usize)> = (0..lanes.len())
            .flat_map(|to| (0..to).map(move |from| (from, to)))
            .filter(|(from, to)| lanes[*from].is_some() && lanes[*from] == lanes[*to])
            .collect();
        let width = self.width().max(1);
        for (at, row) in of_others.chunks_exact_mut(width).enumerate().skip(1).step_by(2) {
            if let Some((from, to)) = pairs.get(at / 2 % pairs.len().max(1)) {
                row[*to] = row[*from];
            }
        }
        rows.extend(of_others);
        (count + more, rows)
    }

    /// The rows that run over one content (set of generated values) of the resources. All rows run over the first
    /// content, and some rows over each further content.
    pub(crate) fn part(&self, rows: &[u32], count: usize, draw: usize) -> (usize, Vec<u32>) {
        /// One in four rows runs over each further content.
        const SHARE: usize = 4;
        self.select(rows, count, |at| draw == 0 || count < SHARE || at % SHARE == draw % SHARE)
    }

    /// Returns the rows that `wanted` selects by their index.
    pub(crate) fn select(
        &self,
        rows: &[u32],
        count: usize,
        wanted: impl Fn(usize) -> bool,
    ) -> (usize, Vec<u32>) {
        let width = self.width();
        let at: Vec<usize> = (0..count).filter(|at| wanted(*at)).collect();
        (at.len(), at.iter().flat_map(|at| &rows[at * width..][..width]).copied().collect())
    }

    pub(crate) fn width(&self) -> usize {
        self.domain.width()
    }

    fn lanes(&self) -> impl Iterator<Item = (&Described, Scalar)> {
        self.described.iter().flat_map(|one| one.scalars.iter().map(move |scalar| (one, *scalar)))
    }

    pub(crate) fn are_declared(&self) -> bool {
        self.described.iter().all(|one| one.declared || one.path.is_empty())
    }

    /// Checks if no argument is free.
    pub(crate) fn are_known(&self) -> bool {
        self.described.iter().all(|one| one.known)
    }

    /// For each lane, `true` if the lane is free. With `not_declared`, a lane counts as free if it isn't declared.
    pub(crate) fn free(&self, not_declared: bool) -> Vec<bool> {
        self.lanes().map(|(one, _)| if not_declared { !one.declared } else { !one.known }).collect()
    }

    /// The lanes of a row that aren't free.
    pub(crate) fn known_of(&self, row: &[u32]) -> Vec<u32> {
        let all = self.lanes().zip(row);
        all.filter(|((one, _), _)| one.known).map(|(_, word)| *word).collect()
    }

    /// Replaces subnormal numbers by 0, as drivers may do (WGSL 15.7.4). A hazard that only a subnormal number shows
    /// isn't a finding.
    pub(crate) fn without_subnormals(&self, rows: &mut [u32]) {
        let scalars: Vec<Scalar> = self.lanes().map(|(_, scalar)| scalar).collect();
        for (word, scalar) in rows.iter_mut().zip(scalars.iter().cycle()) {
            if *scalar == Scalar::F32 && f32::from_bits(*word).is_subnormal() {
                *word = 0;
            }
        }
    }

    /// Makes `count` rows with the known lanes of `row` and the free lanes of `others`. If `others` has too few rows,
    /// its rows repeat.
    pub(crate) fn held(&self, row: &[u32], others: &[u32], count: usize) -> Vec<u32> {
        let known: Vec<bool> = self.lanes().map(|(one, _)| one.known).collect();
        self.replaced(row, others, count, &|lane| !known[lane])
    }

    /// Makes `count` copies of `row`, in which the lanes that `takes` selects come from `others`.
    pub(crate) fn replaced(
        &self,
        row: &[u32],
        others: &[u32],
        count: usize,
        takes: &dyn Fn(usize) -> bool,
    ) -> Vec<u32> {
        let width = self.width();
        let all = others.len() / width.max(1);
        // The other rows are evenly spread, so that they include edges and random samples.
        let number = |at: usize| if all > count { at * all / count } else { at % all.max(1) };
        let other = |at: usize| &others[number(at) * width..][..width];
        let lane = |at, lane| if takes(lane) { other(at)[lane] } else { row[lane] };
        (0..count).flat_map(|at| (0..width).map(move |own| lane(at, own))).collect()
    }

    /// Two measures of how unusual a row is: the number of very large or very small floats, and the number of values
    /// that aren't plain. Plain values are 0, 1, -1 and the ends of the range of unconstrained numbers.
    pub(crate) fn oddity(&self, row: &[u32]) -> [usize; 2] {
        /// The largest usual magnitude. Positions, times and sizes are rarely larger.
        const MOST: f32 = 1e4;
        /// The smallest usual magnitude. Distances, weights and densities in a scene are rarely smaller.
        const LEAST: f32 = 1e-10;
        let is_extreme = |scalar: Scalar, word: u32| {
            let size = f32::from_bits(word).abs();
            scalar == Scalar::F32 && (size > MOST || size > 0.0 && size < LEAST)
        };
        let all = || self.lanes().zip(row);
        let extreme = all().filter(|((_, scalar), word)| is_extreme(*scalar, **word)).count();
        let odd = all().filter(|((_, scalar), word)| !Part::is_plain(*scalar, **word)).count();
        [extreme, odd]
    }

    /// Makes a row for each pixel of a draw. An input for the pixel's position has the coordinates of the pixel's
    /// centre. The first two numbers of a vector rise from 0 to 1 horizontally and vertically, as texture coordinates
    /// do. Each other float changes evenly from its value in `row` to its value in `other`. All other lanes come from
    /// `row`.
    pub(crate) fn of_pixels(
        &self,
        function: &Function,
        [row, other]: [&[u32]; 2],
        [across, down]: [u32; 2],
    ) -> Vec<u32> {
        let is_position = |one: &Described| {
            let mut builtins = function.form.builtins.iter();
            builtins.any(|(path, builtin)| *path == one.path && builtin == meaning::POSITION)
        };
        // The index of the first two lanes of each vector, with `true` if the vector is a position.
        let (mut at, mut vectors, mut others) = (0, Vec::new(), Vec::new());
        for (index, one) in self.described.iter().enumerate() {
            let path = |other: usize| self.described.get(other).map(|other| &other.path);
            let begins = index.checked_sub(1).and_then(path) != Some(&one.path);
            let is_number = one.scalars == [Scalar::F32] && !one.declared;
            if begins && is_number && path(index + 1) == Some(&one.path) {
                vectors.push((at, is_position(one)));
            }
            if one.scalars == [Scalar::F32] {
                others.push(at);
            }
            at += one.scalars.len();
        }
        let pixels = (0..down).flat_map(|y| (0..across).map(move |x| [x, y]));
        let mut rows = Vec::with_capacity(row.len() * (across * down) as usize);
        for pixel in pixels {
            let first = rows.len();
            rows.extend_from_slice(row);
            // The share grows along the diagonal, so that a float differs between neighbours in both directions.
            let share = (pixel[0] + pixel[1]) as f32 / (across + down - 2).max(1) as f32;
            for at in &others {
                let [one, other] = [row, other].map(|row| f32::from_bits(row[*at]));
                rows[first + at] = (one + (other - one) * share).to_bits();
            }
            for (at, is_position) in &vectors {
                for (lane, (index, count)) in pixel.into_iter().zip([across, down]).enumerate() {
                    let center = index as f32 + 0.5;
                    let value = if *is_position { center } else { center / count as f32 };
                    rows[first + at + lane] = value.to_bits();
                }
            }
        }
        rows
    }

    /// Checks if all undeclared integers of a row are small, so that a loop that counts to such an integer ends soon.
    pub(crate) fn counts_little(&self, row: &[u32]) -> bool {
        /// The largest magnitude that counts as small. With 8 iterations each, three nested loops have only 512
        /// iterations.
        const MOST: u32 = 8;
        self.lanes().zip(row).all(|((one, scalar), word)| match scalar {
            Scalar::I32 => one.declared || word.cast_signed().unsigned_abs() <= MOST,
            Scalar::U32 => one.declared || *word <= MOST,
            _ => true,
        })
    }

    pub(crate) fn drawn(&self) -> Drawn {
        let mut drawn = Drawn::default();
        self.described.iter().for_each(|one| drawn.note(one));
        drawn
    }
}

/// The generated inputs of one call of a function.
#[derive(Clone, Debug)]
pub struct MadeUp {
    /// The lanes of the arguments.
    pub lanes: Vec<u32>,
    /// The contents of buffers and textures, and the samplers.
    pub fixtures: karat::fixture::Fixtures,
    /// The buffer members outside of arrays, with their values.
    pub members: Vec<(String, String)>,
    /// The ranges from which all inputs were sampled.
    pub drawn: Drawn,
}

impl MadeUp {
    /// Generates the inputs of case number `case`. Edges come first.
    ///
    /// # Errors
    /// Returns an error, as a sentence, if a resource can't be generated, or if the declared range of an argument
    /// contains no value of the argument's type.
    pub fn of(
        probed: &karat::unstable::probe::Probed,
        ranges: &Ranges,
        case: usize,
    ) -> Result<Self, String> {
        let arguments = Arguments::of(probed.function(), ranges)?;
        let (count, rows) = arguments.rows(SEED, CASES);
        let width = arguments.width();
        let lanes = rows.get(case * width..(case + 1) * width).filter(|_| case < count);
        let lanes = lanes
            .ok_or_else(|| format!("the function has {count} cases, counted from 0"))?
            .to_vec();
        let content = Content::OF_FUNCTIONS[case % Content::OF_FUNCTIONS.len()];
        let Resources { fixtures, members, drawn, .. } = Resources::of(probed, ranges, content)?;
        let mut all = arguments.drawn();
        all.merge(drawn);
        Ok(Self { lanes, fixtures, members, drawn: all })
    }

    /// Generates the resources of a compute pass, with content number `case`. Sizes follow from the dispatch. In case
    /// 0, the undeclared integers of an array are 0, 1, 2 and so on; in case 1, they count down to 0.
    ///
    /// # Errors
    /// Returns an error if the entry point isn't valid, or if a resource can't be generated.
    pub fn of_pass(
        (package, name): (&Package, &str),
        overrides: &BTreeMap<String, f64>,
        workgroups: [u32; 3],
        ranges: &Ranges,
        case: usize,
    ) -> Result<Self, String> {
        let (program, bindings, size) = Program::of_pass(package, name, overrides)?;
        let content = Content::OF_PASSES[case % Content::OF_PASSES.len()];
        let extents = Extents::of(size, workgroups, content);
        extents.expect_few()?;
        let made = Resources::of_pass((&program, &bindings), ranges, extents, None)?;
        let Resources { fixtures, members, drawn, .. } = made;
        Ok(Self { lanes: Vec::new(), fixtures, members, drawn })
    }

    /// The names and values of the arguments.
    #[must_use]
    pub fn arguments(&self, function: &Function) -> Vec<(String, String)> {
        let mut rest = &*self.lanes;
        // A pass has no arguments.
        if rest.is_empty() {
            return Vec::new();
        }
        let named = function.parameters.iter().map(|(name, shape)| {
            let (own, others) = rest.split_at(shape.lanes().len().min(rest.len()));
            rest = others;
            (name.clone(), shape.format(own))
        });
        named.collect()
    }
}

const CASES: usize = 1024;

/// The ranges from which inputs were sampled, for a report.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[serde(transparent)]
pub struct Drawn {
    /// The names of the inputs, by the range from which they were sampled.
    by: BTreeMap<String, BTreeSet<String>>,
}

impl Drawn {
    fn note(&mut self, one: &Described) {
        if one.path.is_empty() {
            return;
        }
        let described =
            if one.sized { "from the size of the dispatch" } else { one.part.described() };
        self.by.entry(described.to_owned()).or_default().insert(one.path.clone());
    }

    /// Adds an input that isn't sampled, because its values are declared.
    fn add(&mut self, name: String) {
        self.by.entry("as declared".to_owned()).or_default().insert(name);
    }

    pub(crate) fn merge(&mut self, other: Self) {
        for (key, names) in other.by {
            self.by.entry(key).or_default().extend(names);
        }
    }

    /// Combines the ranges with those of `others`, from which a quarter of the samples come.
    pub(crate) fn beside(self, others: &Self) -> Self {
        let mut all = Self::default();
        for (key, names) in self.by {
            for name in names {
                let is_known = others.by.get(&key).is_some_and(|known| known.contains(&name));
                let wider = || format!("{key}, but a quarter of the samples have any value");
                let key = if is_known { key.clone() } else { wider() };
                all.by.entry(key).or_default().insert(name);
            }
        }
        all
    }

    /// The full names (`params.groups`) and the short names (`groups`) of all inputs.
    pub(crate) fn names(&self) -> BTreeSet<&str> {
        let all = self.by.values().flatten();
        all.flat_map(|path| [path.as_str(), path.rsplit('.').next().unwrap_or(path)]).collect()
    }
}

impl Drawn {
    /// A line for each range, with the names of at most `most` inputs that have the range.
    #[must_use]
    pub fn lines(&self, most: usize) -> Vec<String> {
        let line = |(text, names): (&String, &BTreeSet<String>)| {
            let shown: Vec<&str> = names.iter().take(most).map(String::as_str).collect();
            let more = match names.len().saturating_sub(most) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("{text}: {}{more}", shown.join(", "))
        };
        self.by.iter().map(line).collect()
    }
}

impl std::fmt::Display for Drawn {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.lines(usize::MAX).join("\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A declaration for a member of one variable has precedence over a declaration for all members with this name.
    #[test]
    fn a_path_comes_before_its_last_name() {
        let mut ranges = Ranges::default();
        for (name, ends) in [("b", [0.0, 1.0]), ("a.b", [2.0, 3.0]), ("c.d.b", [4.0, 5.0])] {
            ranges.declare(name, ends[0], ends[1]).expect("the range is valid");
        }
        let get = |path: &str| match ranges.get(path) {
            Some(Declaration::Range(least, most)) => Some((*least, *most)),
            _ => None,
        };
        assert_eq!([get("a.b"), get("c.d.b")], [Some((2.0, 3.0)), Some((4.0, 5.0))]);
        assert_eq!([get("b"), get("x.b"), get("d.b"), get("x.a.b")], [Some((0.0, 1.0)); 4]);
        assert_eq!([get("a"), get("b.a"), get("bb"), get("")], [None; 4]);
        ranges.declare("b", -1.0, -1.0).expect("one number is a range");
        let last = Some(&Declaration::Range(-1.0, -1.0));
        assert_eq!(ranges.get("b"), last, "the last declaration holds");
        for (least, most) in [(1.0, 0.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            ranges.declare("b", least, most).expect_err("the range is invalid");
        }
    }

    fn function(text: &str) -> (karat::unstable::probe::Probed, Ranges) {
        let package = Package::from_source("p", text);
        let probed = karat::unstable::probe::Probed::new(&package, "f").expect("`f` can be called");
        (probed, Ranges::default())
    }

    /// A function with few possible inputs has few rows. All these rows run over each content of the resources.
    #[test]
    fn a_function_with_few_rows_is_tried_with_all_of_them() {
        let (probed, ranges) = function("fn f(b: bool) -> bool { return b; }");
        let arguments =
            Arguments::of(probed.function(), &ranges).expect("the arguments are generated");
        let (count, rows) = arguments.rows(1, 100);
        assert_eq!((count, rows.len()), (2, 2));
        assert_eq!(arguments.part(&rows, count, 3), (count, rows));
        let many: Vec<u32> = (0..10).collect();
        assert_eq!(arguments.part(&many, 10, 0), (10, many.clone()));
        assert_eq!(arguments.part(&many, 10, 1), (3, vec![1, 5, 9]));
        assert_eq!(arguments.part(&many, 10, 4), (3, vec![0, 4, 8]));
        // A function without arguments has one case. A second case is an error.
        let (probed, ranges) = function("fn f() -> f32 { return 1.0; }");
        let cases = [0, 1].map(|case| MadeUp::of(&probed, &ranges, case).map(|one| one.lanes));
        assert_eq!(
            cases,
            [Ok(Vec::new()), Err("the function has 1 cases, counted from 0".to_owned())]
        );
    }

    /// Declared lanes keep their values. In a function without callers, ranges that names suggest count as declared.
    /// Plain numbers come first.
    // Lesson 99
    #[test]
    fn declared_arguments_keep_their_values() {
        let (probed, mut ranges) =
            function("fn f(x: f32, roughness: f32, k: u32) -> f32 { return x; }");
        ranges.declare("k", 0.0, 9.0).expect("the range is valid");
        let of = |ranges: &Ranges| {
            Arguments::of(probed.function(), ranges).expect("the arguments are generated")
        };
        let (called, root) = (of(&ranges), of(&ranges.with_names()));
        let others: Vec<u32> = (10..22).collect();
        assert_eq!(called.known_of(&[1, 2, 3]), [3]);
        assert_eq!(root.known_of(&[1, 2, 3]), [2, 3]);
        assert_eq!(called.held(&[1, 2, 3], &others, 2), [10, 11, 3, 16, 17, 3]);
        assert_eq!(root.held(&[1, 2, 3], &others[..3], 2), [10, 2, 3, 10, 2, 3]);
        let oddity = |x: f32| root.oddity(&[x.to_bits(), 0, 1]);
        assert_eq!([oddity(1.0), oddity(3.5), oddity(1e6)], [[0, 0], [0, 1], [1, 1]]);
        assert!(!root.are_declared() && !root.are_known());
    }

    /// The first two components of a vector argument are texture coordinates: from 0 to 1 across the draw.
    #[test]
    fn pixels_have_coordinates() {
        let (probed, ranges) = function("fn f(uv: vec3f, k: u32) -> f32 { return uv.x; }");
        let arguments =
            Arguments::of(probed.function(), &ranges).expect("the arguments are generated");
        let [row, other] = [[8.0_f32, 8.0, 2.0], [0.0, 0.0, 4.0]]
            .map(|floats| floats.map(f32::to_bits).into_iter().chain([5]).collect::<Vec<u32>>());
        let words = arguments.of_pixels(probed.function(), [&row, &other], [2, 2]);
        let rows: Vec<[f32; 3]> = words
            .chunks_exact(4)
            .map(|row| [0, 1, 2].map(|lane| f32::from_bits(row[lane])))
            .collect();
        let expected = [[0.25, 0.25, 2.0], [0.75, 0.25, 3.0], [0.25, 0.75, 3.0], [0.75, 0.75, 4.0]];
        assert_eq!(rows, expected);
        assert!(words.chunks_exact(4).all(|row| row[3] == 5), "integers come from the first row");
    }
}
