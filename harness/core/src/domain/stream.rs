//! Domains that hide the types of their values. To the code that uses such a domain, a case is a row of words, or a
//! value whose type only the closures of the check know.
//!
//! The code that samples, runs, compares and simplifies cases is compiled only once, because it uses the trait
//! [`Stream`] instead of concrete types. A stream is either a domain of Rust types ([`Typed`], compiled for each type),
//! or a domain that is made at run time. A row contains the words (`u32`s with the bits of each component) of all
//! arguments of a case, one after another.

use std::any::Any;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use super::{Domain, Emptiness, Origin, Shrinkable, Source};
use crate::value::{Arguments, Shape};

/// A domain that hides the type of its values.
#[doc(hidden)]
pub trait Stream: Send + Sync {
    /// The number of words in a row. It is 0 if values don't consist of words.
    fn width(&self) -> usize;

    /// The number of values in a finite domain.
    fn size(&self) -> Option<u64>;

    /// See [`Domain::emptiness`].
    fn emptiness(&self) -> Option<Emptiness>;

    /// The number of edges.
    fn edges(&self) -> usize;

    /// Appends the row of the value at `origin` to `rows`. Returns `false` if the domain has no value at `origin`.
    fn row(&self, origin: Origin<'_>, rows: &mut Vec<u32>) -> bool;

    /// Appends the rows of the cases in `range`, up to the first case without a value. Returns the number of appended
    /// rows.
    fn rows(&self, cases: &Numbering, range: Range<u64>, rows: &mut Vec<u32>) -> u64 {
        // The code runs for each case, and tests are compiled with few optimisations, so this code is a plain loop.
        let mut index = range.start;
        while index < range.end {
            let mut source = cases.source(index);
            if !self.row(cases.origin(index, &mut source), rows) {
                break;
            }
            index += 1;
        }
        index - range.start
    }

    /// The value at `origin`, with its row.
    fn value(&self, origin: Origin<'_>) -> Option<Held>;

    /// The value at `origin` with its row, and simpler values.
    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Held>>;

    /// Returns `Some(true)` if the domain has a value with this row, `Some(false)` if it has none, and `None` if the
    /// domain can't check rows.
    fn admits(&self, row: &[u32]) -> Option<bool>;

    /// The lower and the upper bound of each lane, as two rows: each lane of every value is between the same lanes of
    /// these rows. `None` if the domain has no such bounds.
    fn ends(&self) -> Option<[Vec<u32>; 2]> {
        None
    }

    /// The rows of values that are simpler than the value of `row`, the simplest first.
    fn shrink(&self, row: &[u32]) -> Vec<Vec<u32>>;

    /// A description of each argument's domain, for messages. The description is empty if the test's author chose the
    /// domain, and so knows it.
    fn described(&self) -> String {
        String::new()
    }

    /// The row's value in Rust notation.
    fn show(&self, row: &[u32]) -> String;
}

/// A value that hides its type.
#[derive(Clone, Debug)]
#[doc(hidden)]
pub struct Held {
    value: Arc<dyn Value>,
    /// The value's words. Empty if the value doesn't consist of words.
    #[doc(hidden)]
    pub row: Vec<u32>,
}

trait Value: Any + Debug + Send + Sync {}

impl<T: Any + Debug + Send + Sync> Value for T {}

impl Held {
    pub(super) fn of<V: Debug + Send + Sync + 'static>(value: V, row: Vec<u32>) -> Self {
        Self { value: Arc::new(value), row }
    }

    /// The value.
    ///
    /// # Panics
    /// Panics if the value isn't a `V`. The closures of a check always use the type of the check's domain.
    #[doc(hidden)]
    pub fn get<V: 'static>(&self) -> &V {
        let value: &dyn Any = &*self.value;
        value.downcast_ref().expect("a check's closures know the type of its values")
    }

    /// The value in its `Debug` form.
    #[doc(hidden)]
    pub fn shown(&self) -> String {
        format!("{:?}", self.value)
    }

    /// The same value with `words` appended to its row.
    #[doc(hidden)]
    pub fn with(&self, words: &[u32]) -> Self {
        Self { value: Arc::clone(&self.value), row: [&*self.row, words].concat() }
    }
}

/// The rule that assigns a value of the domain to each case number of a check.
#[derive(Clone, Copy, Debug)]
#[doc(hidden)]
pub struct Numbering {
    #[doc(hidden)]
    pub seed: u64,
    #[doc(hidden)]
    pub count: u64,
    edges: usize,
    /// `true` if case i is value i of the domain.
    enumerated: bool,
}

impl Numbering {
    /// Numbers the cases of a check. If a finite domain has at most `enumerated` values, each value is a case. For any
    /// other domain, there are `limit` cases: up to half of the cases are edges, and the others are samples.
    #[doc(hidden)]
    pub fn of(stream: &dyn Stream, seed: u64, limit: u64, enumerated: u64) -> Self {
        match stream.size() {
            Some(count) if count <= enumerated => Self { seed, count, edges: 0, enumerated: true },
            _ => {
                let most = usize::try_from(limit / 2).unwrap_or(usize::MAX);
                let edges = stream.edges().min(most);
                Self { seed, count: limit, edges, enumerated: false }
            }
        }
    }

    /// The same numbering with another seed.
    #[doc(hidden)]
    pub fn with_seed(&self, seed: u64) -> Self {
        Self { seed, ..*self }
    }

    /// The random numbers from which the value of case `index` is sampled.
    #[inline]
    #[doc(hidden)]
    pub fn source(&self, index: u64) -> Source {
        Source::new(self.seed, index)
    }

    /// The origin of the value of case `index`: an index into the domain, an edge, or random numbers from `source`,
    /// which must be the source of this case.
    #[inline]
    #[doc(hidden)]
    pub fn origin<'s>(&self, index: u64, source: &'s mut Source) -> Origin<'s> {
        let edge = usize::try_from(index).ok().filter(|index| *index < self.edges);
        match edge {
            _ if self.enumerated => Origin::Nth(index),
            Some(edge) => Origin::Edge(edge),
            None => Origin::Draw(source),
        }
    }
}

/// A [`Stream`] of the values of a Rust domain.
#[derive(Debug)]
#[doc(hidden)]
pub struct Typed<D: Domain> {
    domain: D,
    edges: OnceLock<Vec<D::Value>>,
    words: Option<Words<D::Value>>,
    hold: fn(D::Value) -> Held,
}

#[derive(Debug)]
struct Words<V> {
    shapes: fn() -> Vec<Shape>,
    store: fn(&V, &mut Vec<u32>),
    load: fn(&[u32]) -> V,
}

impl<D: Domain> Typed<D> {
    /// A stream of values that needn't consist of words. Its rows are empty.
    #[doc(hidden)]
    pub fn values(domain: D) -> Self {
        Self { domain, edges: OnceLock::new(), words: None, hold: |value| Held::of(value, vec![]) }
    }

    /// A stream of arguments. Its rows contain the arguments' words.
    #[doc(hidden)]
    pub fn arguments(domain: D) -> Self
    where
        D::Value: Arguments,
    {
        let words = Words {
            shapes: D::Value::shapes,
            store: D::Value::store_all,
            load: |row| D::Value::load_all(&mut row.iter()),
        };
        let hold = |value: D::Value| {
            let mut row = Vec::new();
            value.store_all(&mut row);
            Held::of(value, row)
        };
        Self { domain, edges: OnceLock::new(), words: Some(words), hold }
    }

    fn of(&self, origin: Origin<'_>) -> Option<D::Value> {
        match origin {
            Origin::Nth(index) => self.domain.nth(index),
            Origin::Edge(index) => self.all_edges().get(index).cloned(),
            Origin::Draw(source) => self.domain.draw(source),
        }
    }

    fn all_edges(&self) -> &[D::Value] {
        self.edges.get_or_init(|| self.domain.edges())
    }
}

impl<D: Domain> Stream for Typed<D> {
    fn width(&self) -> usize {
        let shapes = self.words.as_ref().map(|words| (words.shapes)()).unwrap_or_default();
        shapes.iter().map(|shape| shape.lanes().len()).sum()
    }

    fn size(&self) -> Option<u64> {
        self.domain.size()
    }

    fn emptiness(&self) -> Option<Emptiness> {
        self.domain.emptiness()
    }

    fn edges(&self) -> usize {
        self.all_edges().len()
    }

    fn row(&self, origin: Origin<'_>, rows: &mut Vec<u32>) -> bool {
        let Some(value) = self.of(origin) else { return false };
        if let Some(words) = &self.words {
            (words.store)(&value, rows);
        }
        true
    }

    fn value(&self, origin: Origin<'_>) -> Option<Held> {
        self.of(origin).map(self.hold)
    }

    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Held>> {
        Some(self.domain.shrinkable(origin)?.map(&self.hold))
    }

    fn admits(&self, row: &[u32]) -> Option<bool> {
        let words = self.words.as_ref()?;
        self.domain.admits(&(words.load)(row))
    }

    fn ends(&self) -> Option<[Vec<u32>; 2]> {
        let words = self.words.as_ref()?;
        let (least, most) = self.domain.ends()?;
        Some([least, most].map(|value| {
            let mut row = Vec::new();
            (words.store)(&value, &mut row);
            row
        }))
    }

    fn shrink(&self, row: &[u32]) -> Vec<Vec<u32>> {
        let Some(words) = &self.words else { return Vec::new() };
        let stored = |value: &D::Value| {
            let mut row = Vec::new();
            (words.store)(value, &mut row);
            row
        };
        self.domain.shrink(&(words.load)(row)).iter().map(stored).collect()
    }

    fn show(&self, row: &[u32]) -> String {
        self.words.as_ref().map_or_else(String::new, |words| format!("{:?}", (words.load)(row)))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::domain) struct Cases<'a, D: Domain> {
        typed: Typed<&'a D>,
        numbering: Numbering,
    }

    impl<'a, D: Domain> Cases<'a, D> {
        pub(in crate::domain) fn new(
            domain: &'a D,
            seed: u64,
            limit: u64,
            enumerated: u64,
        ) -> Self {
            let typed = Typed::values(domain);
            let numbering = Numbering::of(&typed, seed, limit, enumerated);
            Self { typed, numbering }
        }

        pub(in crate::domain) fn count(&self) -> u64 {
            self.numbering.count
        }

        pub(in crate::domain) fn get(&self, index: u64) -> Option<D::Value> {
            self.typed.of(self.numbering.origin(index, &mut self.numbering.source(index)))
        }

        pub(in crate::domain) fn shrinkable(&self, index: u64) -> Option<Shrinkable<'a, D::Value>> {
            let mut source = self.numbering.source(index);
            D::shrinkable(self.typed.domain, self.numbering.origin(index, &mut source))
        }
    }

    /// A domain of integers that is made at run time, so its values have no Rust type.
    struct Listed(Vec<u32>);

    impl Stream for Listed {
        fn width(&self) -> usize {
            1
        }
        fn size(&self) -> Option<u64> {
            Some(self.0.len() as u64)
        }
        fn emptiness(&self) -> Option<Emptiness> {
            self.0.is_empty().then(|| Emptiness::of("list", "is empty"))
        }
        fn edges(&self) -> usize {
            0
        }
        fn row(&self, origin: Origin<'_>, rows: &mut Vec<u32>) -> bool {
            let index = match origin {
                Origin::Nth(index) => index,
                Origin::Edge(_) => return false,
                Origin::Draw(source) => source.below(self.0.len() as u64),
            };
            let word = usize::try_from(index).ok().and_then(|index| self.0.get(index));
            rows.extend(word);
            word.is_some()
        }
        fn value(&self, origin: Origin<'_>) -> Option<Held> {
            let mut row = Vec::new();
            self.row(origin, &mut row).then(|| Held::of((), row))
        }
        fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Held>> {
            Some(Shrinkable::new(self.value(origin)?, Vec::new))
        }
        fn admits(&self, row: &[u32]) -> Option<bool> {
            Some(row.len() == 1 && self.0.contains(&row[0]))
        }
        fn shrink(&self, _: &[u32]) -> Vec<Vec<u32>> {
            Vec::new()
        }
        fn show(&self, row: &[u32]) -> String {
            format!("{row:?}")
        }
    }

    #[test]
    fn rows_end_at_the_first_case_without_a_value() {
        let listed = Listed(vec![7, 8, 9]);
        let numbering = Numbering::of(&listed, 1, 10, 10);
        let mut rows = Vec::new();
        assert_eq!((numbering.count, listed.rows(&numbering, 1..3, &mut rows)), (3, 2));
        assert_eq!((listed.rows(&numbering, 2..5, &mut rows), rows), (1, vec![8, 9, 9]));
        let nothing = (0.0..=1.0_f32).filter(|_| false);
        let typed = Typed::arguments(&nothing);
        let numbering = Numbering::of(&typed, 1, 10, 10);
        assert_eq!(typed.rows(&numbering, 0..10, &mut Vec::new()), 0);
    }

    #[test]
    fn rows_hold_the_words_of_the_drawn_values() {
        let domain = (-1.0..=1.0_f32, super::super::Integers(0..=9_u32));
        let typed = Typed::arguments(&domain);
        let numbering = Numbering::of(&typed, 3, 100, 10);
        let (cases, mut rows) = (Cases::new(&domain, 3, 100, 10), Vec::new());
        assert_eq!(typed.rows(&numbering, 0..100, &mut rows), 100);
        assert_eq!((typed.width(), rows.len()), (2, 200));
        for (index, row) in (0..).zip(rows.chunks_exact(2)) {
            let value = cases.get(index).expect("it draws");
            assert_eq!(row, [value.0.to_bits(), value.1]);
            let held = typed.value(numbering.origin(index, &mut numbering.source(index)));
            let held = held.expect("it draws");
            assert_eq!((held.get::<(f32, u32)>(), &*held.row), (&value, row));
            assert_eq!((held.shown(), typed.show(row)), (format!("{value:?}"), held.shown()));
            assert_eq!((typed.admits(row), typed.admits(&[0, 10])), (Some(true), Some(false)));
        }
    }
}
