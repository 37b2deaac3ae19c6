//! Domains for the parameters of a function that is known only at run time.
//!
//! A domain consists of parts. Each part samples one number or one vector as *words*: `u32`s that contain the bits of
//! the components. A parameter has one or more parts. A *row* contains the words of all parts, one after another. As in
//! tuples of Rust types, one sample in eight ties parts: a part gets the same value as another part, the opposite
//! value, or nearly the same value.

use std::collections::HashSet;
use std::fmt::Debug;
use std::ops::{Range, RangeInclusive};

use glam::{Vec2, Vec3, Vec4};

use super::perpendicular::Perpendicular;
use super::plausible::{self, Often, Plausible};
use super::transform::Transform;
use super::words::Words;
use super::{
    AnyF32, Domain, Emptiness, Held, Hemisphere, Integers, Just, OneOf, Origin, REJECTIONS,
    Shrinkable, Source, Sphere, Stream, UnitRgb, UnitVector, complexity,
};
use crate::value::{Scalar, Shape, Shareable, format_lane};

/// One in `TIES` samples has tied parts.
const TIES: u64 = 8;

/// Makes a float close to a given float: the difference is the given float times 2^-8 to 2^-23. The subtraction of such
/// floats loses digits. A test needs such floats to find the lost digits of variances and gradients. For an integer,
/// the result is the given integer or the next larger integer.
fn nearly(word: u32, source: &mut Source) -> u32 {
    let like = f32::from_bits(word);
    let bits = source.bits();
    match like.is_normal() {
        true => {
            let step = like * (1.0 / 256.0) / f32::from(1_u16 << (bits >> 1 & 15));
            (if bits & 1 == 0 { like + step } else { like - step }).to_bits()
        }
        // The word is a small integer, which has the bits of a subnormal float.
        false => word.saturating_add(bits & 1),
    }
}

/// The largest number of cases in which Karat combines edges of different parts.
const COMBINATIONS: usize = 1024;

/// If a domain has at most this many rows, its filter is applied to all rows before the first case.
const LISTED: u64 = 1 << 16;

/// A domain of Rust values that are converted to words.
struct Of<D>(D);

fn stored<V: Shareable>(value: &V) -> Vec<u32> {
    let mut words = Vec::new();
    value.store(&mut words);
    words
}

impl<D: Domain> Words for Of<D>
where
    D::Value: Shareable,
{
    fn width(&self) -> usize {
        D::Value::shape().lanes().len()
    }
    fn draw(&self, source: &mut Source) -> Option<Vec<u32>> {
        self.0.draw(source).as_ref().map(stored)
    }
    fn edges(&self) -> Vec<Vec<u32>> {
        self.0.edges().iter().map(stored).collect()
    }
    fn emptiness(&self) -> Option<Emptiness> {
        self.0.emptiness()
    }
    fn size(&self) -> Option<u64> {
        self.0.size()
    }
    fn nth(&self, index: u64) -> Option<Vec<u32>> {
        self.0.nth(index).as_ref().map(stored)
    }
    fn admits(&self, words: &[u32]) -> Option<bool> {
        self.0.admits(&D::Value::load(&mut words.iter()))
    }
    fn ends(&self) -> Option<[Vec<u32>; 2]> {
        let (least, most) = self.0.ends()?;
        Some([stored(&least), stored(&most)])
    }
    fn shrink(&self, words: &[u32]) -> Vec<Vec<u32>> {
        self.0.shrink(&D::Value::load(&mut words.iter())).iter().map(stored).collect()
    }
}

/// A list of values. A value is simplified to simpler values of the list, the simplest first.
struct Listed(Vec<Vec<u32>>, Vec<Scalar>);

impl Listed {
    fn weight(&self, words: &[u32]) -> Vec<u64> {
        let lanes = self.1.iter().zip(words);
        lanes
            .map(|(scalar, word)| match scalar {
                Scalar::F32 | Scalar::F16 => complexity(&f32::from_bits(*word)),
                Scalar::I32 => complexity(&word.cast_signed()),
                Scalar::U32 | Scalar::Bool => complexity(word),
            })
            .map(Option::unwrap_or_default)
            .collect()
    }
}

impl Words for Listed {
    fn width(&self) -> usize {
        self.1.len()
    }
    fn draw(&self, source: &mut Source) -> Option<Vec<u32>> {
        self.nth(source.below(self.0.len() as u64))
    }
    fn edges(&self) -> Vec<Vec<u32>> {
        OneOf(self.0.clone()).edges()
    }
    fn emptiness(&self) -> Option<Emptiness> {
        OneOf(self.0.clone()).emptiness()
    }
    fn size(&self) -> Option<u64> {
        Some(self.0.len() as u64)
    }
    fn nth(&self, index: u64) -> Option<Vec<u32>> {
        usize::try_from(index).ok().and_then(|index| self.0.get(index)).cloned()
    }
    fn admits(&self, words: &[u32]) -> Option<bool> {
        Some(self.0.iter().any(|listed| listed == words))
    }
    fn shrink(&self, words: &[u32]) -> Vec<Vec<u32>> {
        let own = self.weight(words);
        let mut simpler: Vec<_> = self.0.iter().filter(|row| self.weight(row) < own).collect();
        simpler.sort_by_key(|row| self.weight(row));
        simpler.into_iter().cloned().collect()
    }
}

/// A part with additional values. The additional values follow the first two edges, and one sample in eight is an
/// additional value.
struct Beside {
    own: Box<dyn Words>,
    more: Vec<Vec<u32>>,
}

impl Words for Beside {
    fn width(&self) -> usize {
        self.own.width()
    }
    fn draw(&self, source: &mut Source) -> Option<Vec<u32>> {
        const SHARE: u64 = 8;
        match source.below(SHARE) {
            0 => self.more.get(source.below(self.more.len() as u64) as usize).cloned(),
            _ => self.own.draw(source),
        }
    }
    fn edges(&self) -> Vec<Vec<u32>> {
        let mut all = self.own.edges();
        let rest = all.split_off(all.len().min(2));
        all.extend(self.more.iter().cloned());
        all.extend(rest);
        all
    }
    fn emptiness(&self) -> Option<Emptiness> {
        self.own.emptiness()
    }
    fn size(&self) -> Option<u64> {
        None
    }
    fn nth(&self, _: u64) -> Option<Vec<u32>> {
        None
    }
    fn admits(&self, words: &[u32]) -> Option<bool> {
        if self.more.iter().any(|more| more == words) { Some(true) } else { self.own.admits(words) }
    }
    fn ends(&self) -> Option<[Vec<u32>; 2]> {
        self.own.ends()
    }
    fn shrink(&self, words: &[u32]) -> Vec<Vec<u32>> {
        self.own.shrink(words)
    }
}

/// One part of a [`Dynamic`] domain: a number, or a vector.
///
/// ```
/// use karat::unstable::domain::Part;
/// use karat::unstable::value::Scalar;
///
/// let fraction = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 has both ends");
/// assert_eq!(fraction.width(), 1);
/// ```
pub struct Part {
    words: Box<dyn Words>,
    /// The description of the part's values in messages: `from 0 to 1`.
    described: String,
}

impl Debug for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Part({})", self.described)
    }
}

impl Part {
    fn of<D: Domain + 'static>(domain: D, described: impl Into<String>) -> Self
    where
        D::Value: Shareable,
    {
        Self { words: Box::new(Of(domain)), described: described.into() }
    }

    /// A closed range of a scalar. The ends are rounded to the scalar's type. `None` for booleans, and if an end of an
    /// integer range isn't an integer.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    /// use karat::unstable::value::Scalar;
    ///
    /// assert!(Part::range(Scalar::U32, 0.0..=7.0).is_some());
    /// assert!(Part::range(Scalar::U32, -1.0..=7.0).is_none());
    /// ```
    pub fn range(scalar: Scalar, range: RangeInclusive<f64>) -> Option<Self> {
        let (low, high) = range.into_inner();
        let whole = low.fract() == 0.0 && high.fract() == 0.0;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "ends of floats are rounded to the type"
        )]
        let text = match scalar {
            // The description shows the ends after rounding to the type.
            Scalar::F32 | Scalar::F16 => format!("from {} to {}", low as f32, high as f32),
            _ => format!("from {low} to {high}"),
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "ranges of integers are looked at first, others are rounded"
        )]
        Some(match scalar {
            Scalar::F32 | Scalar::F16 => Self::of(low as f32..=high as f32, text),
            Scalar::I32 => {
                let fits = |x: f64| (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&x);
                if !(whole && fits(low) && fits(high)) {
                    return None;
                }
                Self::of(Integers(low as i32..=high as i32), text)
            }
            Scalar::U32 => {
                let fits = |x: f64| (0.0..=f64::from(u32::MAX)).contains(&x);
                if !(whole && fits(low) && fits(high)) {
                    return None;
                }
                Self::of(Integers(low as u32..=high as u32), text)
            }
            Scalar::Bool => return None,
        })
    }

    /// Makes a part from a list of values. Each value in `rows` has one word for each of `scalars`.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    /// use karat::unstable::value::Scalar;
    ///
    /// let axes = Part::listed(
    ///     vec![Scalar::I32; 2],
    ///     vec![vec![1, 0], vec![0, 1]], // two rows of two words
    /// );
    /// assert_eq!(axes.width(), 2);
    /// ```
    pub fn listed(scalars: Vec<Scalar>, rows: Vec<Vec<u32>>) -> Self {
        let described = match &*rows {
            [row] => lanes_text(&scalars, row),
            rows => format!("one of {}", rows.len()),
        };
        Self { words: Box::new(Listed(rows, scalars)), described }
    }

    /// Any value of a scalar: all integers, or all finite floats.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    /// use karat::unstable::value::Scalar;
    ///
    /// assert_eq!(Part::any(Scalar::U32).width(), 1);
    /// ```
    pub fn any(scalar: Scalar) -> Self {
        match scalar {
            Scalar::F32 | Scalar::F16 => Self::of(AnyF32::finite(), "any"),
            Scalar::I32 => Self::of(Integers(i32::MIN..=i32::MAX), "any"),
            Scalar::U32 => Self::of(Integers(0..=u32::MAX), "any"),
            Scalar::Bool => {
                let described = plausible::described(scalar);
                Self { described, ..Self::listed(vec![scalar], vec![vec![0], vec![1]]) }
            }
        }
    }

    /// Unconstrained numbers. Half of the integers and of the `f32` values are small, and the others have any size, up
    /// to 2^20 for `f32`. `f16` values are from -2048 to 2048.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    /// use karat::unstable::value::Scalar;
    ///
    /// assert_eq!(Part::plausible(Scalar::F32).width(), 1);
    /// ```
    pub fn plausible(scalar: Scalar) -> Self {
        let described = plausible::described(scalar);
        match scalar {
            Scalar::F32 => Self::of(Plausible::floats(), described),
            Scalar::F16 => {
                let most = plausible::LARGEST_HALF;
                Self::of(-most..=most, described)
            }
            Scalar::I32 => Self::of(Plausible::<i32>::i32(), described),
            Scalar::U32 => Self::of(Plausible::<u32>::u32(), described),
            Scalar::Bool => Self::any(scalar),
        }
    }

    /// The part with this name: `unit_vector` with two to four floats, or `hemisphere` or `unit_rgb` with three. `None`
    /// if the name or the size is unknown.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    ///
    /// assert_eq!(Part::named("unit_vector", 4).map(|part| part.width()), Some(4));
    /// assert!(Part::named("hemisphere", 2).is_none());
    /// ```
    pub fn named(name: &str, size: u8) -> Option<Self> {
        const UNIT: &str = "a unit vector";
        Some(match (name, size) {
            ("unit_vector", 2) => Self::of(Sphere::<Vec2>::unit(), UNIT),
            ("unit_vector", 3) => Self::of(UnitVector, UNIT),
            ("unit_vector", 4) => Self::of(Sphere::<Vec4>::unit(), UNIT),
            ("hemisphere", 3) => Self::of(Hemisphere, "a unit vector with z of at least 0"),
            ("unit_rgb", 3) => Self::of(UnitRgb, "a colour from 0 to 1"),
            _ => return None,
        })
    }

    /// Vectors of the length `radius`. If `filled` is `true`, the part also has shorter vectors: see [`Sphere`]. `None`
    /// if `size`, the number of components, isn't 2, 3 or 4.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    ///
    /// let disk = Part::sphere(2, 0.5, true).expect("two components");
    /// assert_eq!(disk.described(), "a vector with a length of at most 0.5");
    /// ```
    pub fn sphere(size: u8, radius: f32, filled: bool) -> Option<Self> {
        fn of<V: Shareable>(radius: f32, filled: bool) -> Part
        where
            Sphere<V>: Domain<Value = V> + 'static,
        {
            let sphere = Sphere::<V>::of_radius(radius);
            match filled {
                true => {
                    Part::of(sphere.filled(), format!("a vector with a length of at most {radius}"))
                }
                false => Part::of(sphere, format!("a vector of length {radius}")),
            }
        }
        Some(match size {
            2 => of::<Vec2>(radius, filled),
            3 => of::<Vec3>(radius, filled),
            4 => of::<Vec4>(radius, filled),
            _ => return None,
        })
    }

    /// Unit vectors with `z` of at least `least`, a cosine: see [`Hemisphere::above`].
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    ///
    /// assert_eq!(Part::hemisphere_above(0.01).width(), 3);
    /// ```
    pub fn hemisphere_above(least: f32) -> Self {
        Self::of(Hemisphere.above(least), format!("a unit vector with z of at least {least}"))
    }

    /// The names that [`named`](Self::named) knows.
    pub const NAMES: [&str; 3] = ["unit_vector", "hemisphere", "unit_rgb"];

    /// Matrices that rotate, scale, mirror and move points. Each matrix has an inverse. If `perspective` is `true`,
    /// the edge cases of 4 x 4 matrices include a perspective projection. `None` if matrices of this size don't
    /// transform points.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    ///
    /// assert_eq!(Part::transform(4, 3, false).map(|part| part.width()), Some(12));
    /// ```
    pub fn transform(columns: u8, rows: u8, perspective: bool) -> Option<Self> {
        let described = "a transform with an inverse".to_owned();
        Some(Self { words: Box::new(Transform::of(columns, rows, perspective)?), described })
    }

    /// Loop counts of 1 or more. Half of the counts are small. `None` for types that aren't integers.
    #[doc(hidden)]
    pub fn counts(scalar: Scalar) -> Option<Self> {
        /// The largest small count. Any loop finishes this many iterations quickly.
        const FEW: u8 = 8;
        /// The largest count: loops over the samples of a pixel or the taps of a filter rarely need more iterations.
        const MOST: u8 = 64;
        let described = format!("from 1 to {MOST}, with half of the values at most {FEW}");
        let (most, few) = (u32::from(MOST), u32::from(FEW));
        Some(match scalar {
            Scalar::U32 => {
                Self::of(Often { all: Integers(1..=most), often: Integers(1..=few) }, described)
            }
            Scalar::I32 => {
                let (most, few) = (i32::from(MOST), i32::from(FEW));
                Self::of(Often { all: Integers(1..=most), often: Integers(1..=few) }, described)
            }
            _ => return None,
        })
    }

    /// The description of the part's values in messages.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    /// use karat::unstable::value::Scalar;
    ///
    /// let part = Part::range(Scalar::U32, 1.0..=8.0).expect("whole numbers");
    /// assert_eq!(part.described(), "from 1 to 8");
    /// ```
    #[must_use]
    pub fn described(&self) -> &str {
        &self.described
    }

    /// Checks if an unconstrained number is 0, 1, -1 or an end of its range.
    #[doc(hidden)]
    pub fn is_plain(scalar: Scalar, word: u32) -> bool {
        plausible::is_plain(scalar, word)
    }

    /// The value at `index` in the list of values that are tried first. A sampled value if `index` is `None` or past
    /// the end of the list.
    #[doc(hidden)]
    pub fn value(&self, index: Option<usize>, source: &mut Source) -> Option<Vec<u32>> {
        let edge = index.and_then(|index| self.words.edges().get(index).cloned());
        edge.or_else(|| self.words.draw(source))
    }

    /// The same part with additional values. If `all` is `false`, drops additional values outside of the part's own
    /// domain.
    #[doc(hidden)]
    #[must_use]
    pub fn beside(self, mut more: Vec<Vec<u32>>, all: bool) -> Self {
        more.retain(|words| all || self.words.admits(words) != Some(false));
        if more.is_empty() {
            return self;
        }
        Self { words: Box::new(Beside { own: self.words, more }), described: self.described }
    }

    /// The number of words in each value.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    ///
    /// assert_eq!(Part::named("unit_rgb", 3).map(|part| part.width()), Some(3));
    /// ```
    #[must_use]
    pub fn width(&self) -> usize {
        self.words.width()
    }
}

fn lanes_text(scalars: &[Scalar], words: &[u32]) -> String {
    let lanes = scalars.iter().zip(words).map(|(scalar, word)| format_lane(*scalar, *word));
    lanes.collect::<Vec<_>>().join(", ")
}

/// The arguments of a function, sampled part by part: see `Probe::over_dynamic`.
///
/// ```
/// # use karat::unstable::domain::{Dynamic, Part};
/// # use karat::prelude::*;
/// # use karat::unstable::value::{Scalar, Shape};
/// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
/// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
/// # let x = Dynamic::new(&parameters, vec![vec![part]]);
/// assert_eq!(x.described(), "x from 0 to 1");
/// ```
pub struct Dynamic {
    parts: Vec<Part>,
    /// For each part, the index of its parameter.
    owners: Vec<usize>,
    /// The parameters' names and types.
    names: Vec<String>,
    shapes: Vec<Shape>,
    edges: Vec<Vec<u32>>,
    /// The vectors that are made perpendicular to other vectors. Each vector comes after the vectors on which it
    /// depends.
    relations: Vec<Perpendicular>,
    filter: Option<Filter>,
}

type Holds = dyn Fn(&[u32]) -> bool + Send + Sync;

struct Filter {
    statement: String,
    holds: Box<Holds>,
    /// If the domain is small, all rows that the filter keeps.
    listed: Option<Vec<Vec<u32>>>,
}

impl Debug for Dynamic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Dynamic({})", self.described())
    }
}

impl Dynamic {
    /// Makes a domain. `parts` has the parts of each parameter. The parts of a parameter must have as many words as the
    /// parameter's type.
    ///
    /// ```
    /// use karat::unstable::domain::{Dynamic, Part};
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let direction = Shape::Vector { size: 3, scalar: Scalar::F32 };
    /// let parameters = [("n".to_owned(), direction), ("i".to_owned(), Shape::Scalar(Scalar::U32))];
    /// let unit = Part::named("unit_vector", 3).expect("the name is known");
    /// let domain = Dynamic::new(&parameters, vec![vec![unit], vec![Part::any(Scalar::U32)]]);
    /// assert_eq!(domain.shapes().len(), 2);
    /// ```
    pub fn new(parameters: &[(String, Shape)], parts: Vec<Vec<Part>>) -> Self {
        let (names, shapes) = parameters.iter().cloned().unzip();
        let owners = parts.iter().enumerate().flat_map(|(at, own)| vec![at; own.len()]).collect();
        let parts: Vec<Part> = parts.into_iter().flatten().collect();
        let edges = combined(&parts.iter().map(|part| part.words.edges()).collect::<Vec<_>>());
        Self { parts, owners, names, shapes, edges, relations: Vec::new(), filter: None }
    }

    /// Makes a vector perpendicular to other vectors. `lanes` are the positions of the vector's words in a row, and
    /// `to` has one position for each of the other vectors: the position of that vector's first word. All these vectors
    /// must have the same number of components. If one of the other vectors is made perpendicular, too, call this
    /// function for that vector first. Call [`filtered`](Self::filtered) last.
    ///
    /// ```
    /// use karat::unstable::domain::{Dynamic, Part};
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let direction = Shape::Vector { size: 3, scalar: Scalar::F32 };
    /// let parameters = ["n", "t"].map(|name| (name.to_owned(), direction.clone()));
    /// let unit = || vec![Part::named("unit_vector", 3).expect("the name is known")];
    /// let frames = Dynamic::new(&parameters, vec![unit(), unit()]).perpendicular(3..6, vec![0], "n");
    /// assert_eq!(frames.described(), "n a unit vector; t a unit vector perpendicular to n");
    /// ```
    #[must_use]
    pub fn perpendicular(mut self, lanes: Range<usize>, to: Vec<usize>, names: &str) -> Self {
        let mut below = 0;
        for part in &mut self.parts {
            if lanes.contains(&below) {
                part.described.push_str(&format!(" perpendicular to {names}"));
            }
            below += part.width();
        }
        self.relations.push(Perpendicular { lanes, to });
        let edges = std::mem::take(&mut self.edges);
        let mut seen = HashSet::new();
        let settled = edges.into_iter().filter_map(|row| self.settled(row));
        self.edges = settled.filter(|row| seen.insert(row.clone())).collect();
        self
    }

    /// Keeps only the arguments for which `holds` returns `true`. If the domain is finite and has at most 65,536
    /// values, a check tries all of the remaining values.
    ///
    /// ```
    /// use karat::unstable::domain::{Dynamic, Part};
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let index = |name: &str| (name.to_owned(), Shape::Scalar(Scalar::U32));
    /// let small = || vec![Part::range(Scalar::U32, 0.0..=3.0).expect("whole")];
    /// let pairs = Dynamic::new(&[index("i"), index("n")], vec![small(), small()]);
    /// let below = pairs.filtered("i < n", |row| row[0] < row[1]);
    /// assert_eq!(below.described(), "i from 0 to 3; n from 0 to 3; where i < n");
    /// ```
    #[must_use]
    pub fn filtered(
        mut self,
        statement: &str,
        holds: impl Fn(&[u32]) -> bool + Send + Sync + 'static,
    ) -> Self {
        let all = self.count().filter(|count| *count <= LISTED);
        let listed = all.map(|count| {
            let rows = (0..count).filter_map(|index| self.nth(index));
            rows.filter(|row| holds(row)).collect()
        });
        self.edges.retain(|row| holds(row));
        let (statement, holds) = (statement.to_owned(), Box::new(holds));
        self.filter = Some(Filter { statement, holds, listed });
        self
    }

    /// Applies the relations to a row. `None` if a vector can't be made perpendicular, or if the filter rejects the
    /// row.
    fn settled(&self, mut row: Vec<u32>) -> Option<Vec<u32>> {
        if !self.relations.iter().all(|relation| relation.settle(&mut row)) {
            return None;
        }
        let holds = self.filter.as_ref().is_none_or(|filter| (filter.holds)(&row));
        holds.then_some(row)
    }

    /// A description of each argument's domain: `x from 0 to 1; n a unit vector`.
    ///
    /// ```
    /// # use karat::unstable::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::unstable::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// assert_eq!(x.described(), "x from 0 to 1");
    /// ```
    #[must_use]
    pub fn described(&self) -> String {
        let of = |(at, name): (usize, &String)| {
            let own = self.parts.iter().zip(&self.owners).filter(|(_, owner)| **owner == at);
            let mut own: Vec<&str> = own.map(|(part, _)| &*part.described).collect();
            own.dedup();
            (!own.is_empty()).then(|| format!("{name} {}", own.join(" / ")))
        };
        let mut all: Vec<_> = self.names.iter().enumerate().filter_map(of).collect();
        all.extend(self.filter.iter().map(|filter| format!("where {}", filter.statement)));
        all.join("; ")
    }

    /// The types of the parameters.
    ///
    /// ```
    /// # use karat::unstable::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::unstable::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// assert_eq!(x.shapes(), [Shape::Scalar(Scalar::F32)]);
    /// ```
    #[must_use]
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    fn split<'r>(&self, row: &'r [u32]) -> Vec<&'r [u32]> {
        let mut rest = row;
        let parts = self.parts.iter().map(|part| {
            let (own, others) = rest.split_at(part.width().min(rest.len()));
            rest = others;
            own
        });
        parts.collect()
    }

    fn draw(&self, source: &mut Source) -> Option<Vec<u32>> {
        if let Some(Filter { listed: Some(listed), .. }) = &self.filter {
            return listed.get(usize::try_from(source.below(listed.len() as u64)).ok()?).cloned();
        }
        (0..REJECTIONS).find_map(|_| self.settled(self.drawn(source)?))
    }

    fn drawn(&self, source: &mut Source) -> Option<Vec<u32>> {
        let mut rows = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            rows.push(part.words.draw(source)?);
        }
        if self.parts.len() > 1 && source.below(TIES) == 0 {
            let count = self.parts.len() as u64;
            let from = source.below(count);
            let to = (from + 1 + source.below(count - 1)) % count;
            #[expect(clippy::cast_possible_truncation, reason = "fewer than a usize")]
            let (from, to) = (from as usize, to as usize);
            let like = rows[from].clone();
            let tied = |source: &mut Source, how: u64| -> Vec<u32> {
                match how {
                    0 => like.clone(),
                    1 => like.iter().map(|word| word ^ 0x8000_0000).collect(),
                    _ => like.iter().map(|word| nearly(*word, source)).collect(),
                }
            };
            let how = source.below(4);
            // A mean or a variance of several numbers loses digits if all the numbers are almost equal.
            let to = if how == 3 { 0..rows.len() } else { to..to + 1 };
            for to in to.filter(|to| *to != from) {
                let tied = tied(source, how);
                if rows[to].len() == tied.len() && self.parts[to].words.admits(&tied) == Some(true)
                {
                    rows[to] = tied;
                }
            }
        }
        Some(rows.concat())
    }

    fn nth(&self, mut index: u64) -> Option<Vec<u32>> {
        if let Some(Filter { listed: Some(listed), .. }) = &self.filter {
            return listed.get(usize::try_from(index).ok()?).cloned();
        }
        if index >= self.count()? {
            return None;
        }
        let mut row = Vec::new();
        for part in &self.parts {
            let size = part.words.size()?;
            row.extend(part.words.nth(index % size)?);
            index /= size;
        }
        Some(row)
    }

    fn count(&self) -> Option<u64> {
        match &self.filter {
            Some(Filter { listed, .. }) => return listed.as_ref().map(|rows| rows.len() as u64),
            None if !self.relations.is_empty() => return None,
            None => {}
        }
        self.parts.iter().try_fold(1_u64, |count, part| count.checked_mul(part.words.size()?))
    }

    fn of(&self, origin: Origin<'_>) -> Option<Vec<u32>> {
        match origin {
            Origin::Nth(index) => self.nth(index),
            Origin::Edge(index) => self.edges.get(index).cloned(),
            Origin::Draw(source) => self.draw(source),
        }
    }

    fn simpler(&self, row: &[u32]) -> Vec<Vec<u32>> {
        let words = self.split(row);
        let mut found = Vec::new();
        let mut below = 0;
        for (at, part) in self.parts.iter().enumerate() {
            let own = self.relations.iter().find(|relation| relation.lanes.contains(&below));
            for simpler in part.words.shrink(words[at]) {
                let replaced = words.iter().enumerate();
                let replaced =
                    replaced.map(|(other, own)| if other == at { &*simpler } else { own });
                let Some(settled) = self.settled(replaced.collect::<Vec<_>>().concat()) else {
                    continue;
                };
                // A vector that was made perpendicular may be less simple than before. Then the search for the simplest
                // row might not end.
                if own.is_none_or(|own| own.weight(&settled) < own.weight(row)) {
                    found.push(settled);
                }
            }
            below += part.width();
        }
        found
    }

    fn at(&self, row: Vec<u32>) -> Shrinkable<'_, Held> {
        let held = self.held(row.clone());
        Shrinkable::new(held, move || {
            self.simpler(&row).into_iter().map(|simpler| self.at(simpler)).collect()
        })
    }

    fn held(&self, row: Vec<u32>) -> Held {
        Held::of(Shown(self.show(&row)), row)
    }
}

#[derive(Clone)]
struct Shown(String);

impl Debug for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Combines edges into rows. First come rows in which each edge of each part occurs at least once, so that a few cases
/// cover all edges. Then come all combinations of the first edges of the parts.
fn combined(edges: &[Vec<Vec<u32>>]) -> Vec<Vec<u32>> {
    if edges.iter().any(Vec::is_empty) {
        return Vec::new();
    }
    let product = |most: usize| -> usize {
        edges.iter().map(|own| own.len().min(most)).fold(1, usize::saturating_mul)
    };
    let longest = edges.iter().map(Vec::len).max().unwrap_or(0);
    let most = (1..=longest).rev().find(|most| product(*most) <= COMBINATIONS).unwrap_or(1);
    // If there are many parts, even the combinations of two edges of each part are too many.
    let firsts = (0..product(most).min(COMBINATIONS)).map(|mut rest| {
        let row = edges.iter().map(|own| {
            let length = own.len().min(most);
            let at = rest % length;
            rest /= length;
            own[at].as_slice()
        });
        row.collect::<Vec<_>>().concat()
    });
    let each = (0..longest).map(|at| {
        edges.iter().map(|own| own[at % own.len()].as_slice()).collect::<Vec<_>>().concat()
    });
    let mut rows: Vec<Vec<u32>> = Vec::new();
    let mut seen = HashSet::new();
    for row in each.chain(firsts) {
        if seen.insert(row.clone()) {
            rows.push(row);
        }
    }
    rows
}

impl Stream for Dynamic {
    fn width(&self) -> usize {
        self.parts.iter().map(Part::width).sum()
    }

    fn size(&self) -> Option<u64> {
        self.count()
    }

    fn emptiness(&self) -> Option<Emptiness> {
        let mut parts = self.parts.iter().zip(&self.owners);
        let of_part = parts.find_map(|(part, owner)| Some(part.words.emptiness()?.in_part(*owner)));
        of_part.or_else(|| {
            let filter = self.filter.as_ref()?;
            let is_empty = filter.listed.as_ref().is_some_and(Vec::is_empty);
            let fault = format!("keeps none of the arguments: {}", filter.statement);
            is_empty.then(|| Emptiness::of("filter", &fault))
        })
    }

    fn edges(&self) -> usize {
        self.edges.len()
    }

    fn row(&self, origin: Origin<'_>, rows: &mut Vec<u32>) -> bool {
        let Some(row) = self.of(origin) else { return false };
        rows.extend(row);
        true
    }

    fn value(&self, origin: Origin<'_>) -> Option<Held> {
        Some(self.held(self.of(origin)?))
    }

    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Held>> {
        Some(self.at(self.of(origin)?))
    }

    fn ends(&self) -> Option<[Vec<u32>; 2]> {
        let mut rows = [Vec::new(), Vec::new()];
        for part in &self.parts {
            for (row, own) in rows.iter_mut().zip(part.words.ends()?) {
                row.extend(own);
            }
        }
        Some(rows)
    }

    fn admits(&self, row: &[u32]) -> Option<bool> {
        if row.len() != self.width() {
            return Some(false);
        }
        let words = self.split(row);
        let admitted: Vec<_> =
            self.parts.iter().zip(words).map(|(part, own)| part.words.admits(own)).collect();
        let related = self.relations.iter().all(|relation| relation.holds(row));
        let kept = || self.filter.as_ref().is_none_or(|filter| (filter.holds)(row));
        if admitted.contains(&Some(false)) || !related || !kept() {
            return Some(false);
        }
        admitted.into_iter().all(|one| one.is_some()).then_some(true)
    }

    fn shrink(&self, row: &[u32]) -> Vec<Vec<u32>> {
        self.simpler(row)
    }

    fn described(&self) -> String {
        self.described()
    }

    fn show(&self, row: &[u32]) -> String {
        let mut rest = row;
        let shown = self.shapes.iter().map(|shape| {
            let (own, others) = rest.split_at(shape.lanes().len().min(rest.len()));
            rest = others;
            shape.format(own)
        });
        format!("({})", shown.collect::<Vec<_>>().join(", "))
    }
}

impl Part {
    /// A part with a single value.
    ///
    /// ```
    /// use karat::unstable::domain::Part;
    /// use karat::unstable::value::Scalar;
    ///
    /// let half = Part::just(Scalar::F32, 0.5_f32.to_bits());
    /// assert_eq!(half.width(), 1);
    /// ```
    pub fn just(scalar: Scalar, word: u32) -> Self {
        match scalar {
            Scalar::F32 | Scalar::F16 => {
                Self::of(Just(f32::from_bits(word)), format_lane(scalar, word))
            }
            _ => Self::listed(vec![scalar], vec![vec![word]]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Numbering;

    #[test]
    fn a_row_has_the_values_of_each_parameter_in_order() {
        let float = ("x".to_owned(), Shape::Scalar(Scalar::F32));
        let vector = ("n".to_owned(), Shape::Vector { size: 3, scalar: Scalar::F32 });
        let parts = vec![
            vec![Part::range(Scalar::F32, 0.0..=1.0).expect("floats")],
            vec![Part::named("unit_vector", 3).expect("known")],
        ];
        let dynamic = Dynamic::new(&[float, vector], parts);
        assert_eq!(dynamic.described(), "x from 0 to 1; n a unit vector");
        assert_eq!((dynamic.width(), dynamic.size()), (4, None));
        let numbering = Numbering::of(&dynamic, 7, 1000, 1 << 20);
        let mut rows = Vec::new();
        assert_eq!(dynamic.rows(&numbering, 0..1000, &mut rows), 1000);
        for row in rows.chunks_exact(4) {
            assert!((0.0..=1.0).contains(&f32::from_bits(row[0])));
            let length: f32 = row[1..].iter().map(|word| f32::from_bits(*word).powi(2)).sum();
            assert!((length - 1.0).abs() < 1e-5, "{length}");
            assert_eq!(dynamic.admits(row), Some(true));
            for simpler in dynamic.shrink(row) {
                assert_eq!((simpler.len(), dynamic.admits(&simpler)), (4, Some(true)));
            }
        }
    }

    #[test]
    fn finite_parts_are_enumerated() {
        let parts = vec![
            vec![Part::range(Scalar::U32, 1.0..=3.0).expect("whole")],
            vec![Part::any(Scalar::Bool)],
        ];
        let named = |name: &str, scalar| (name.to_owned(), Shape::Scalar(scalar));
        let parameters = [named("n", Scalar::U32), named("b", Scalar::Bool)];
        let dynamic = Dynamic::new(&parameters, parts);
        assert_eq!(dynamic.described(), "n from 1 to 3; b false or true");
        assert_eq!(dynamic.size(), Some(6));
        let all: Vec<_> = (0..6).filter_map(|index| dynamic.nth(index)).collect();
        assert_eq!(all, [[1, 0], [2, 0], [3, 0], [1, 1], [2, 1], [3, 1]]);
        assert_eq!(dynamic.nth(6), None);
        assert_eq!(dynamic.show(&[2, 1]), "(2, true)");
    }

    #[test]
    fn invalid_ranges_are_errors() {
        assert!(Part::range(Scalar::U32, -1.0..=3.0).is_none());
        assert!(Part::range(Scalar::I32, 0.5..=3.0).is_none());
        assert!(Part::range(Scalar::Bool, 0.0..=1.0).is_none());
        let part = Part::range(Scalar::F32, 1.0..=0.0).expect("a range, which is empty");
        let dynamic =
            Dynamic::new(&[("x".to_owned(), Shape::Scalar(Scalar::F32))], vec![vec![part]]);
        assert_eq!(dynamic.emptiness().and_then(|emptiness| emptiness.part), Some(0));
    }
}
