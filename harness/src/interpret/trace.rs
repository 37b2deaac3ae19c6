//! Each operation of one call, in three arithmetics.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use karat_engine::{F32, F64, Interval, Intervals, Lanes, Observer, OutOfRange, Truth};

use super::Interpreted;
use crate::diagnostic::Span;
use crate::probe::ProbeError;

/// An operation on floats: one value a component.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Step {
    /// Its place in the author's file.
    pub span: Span,
    /// The operation, as the author wrote it.
    pub text: String,
    /// What a conforming implementation gives that rounds to nearest.
    pub single: Vec<f32>,
    /// The same in double precision; empty where that takes another way.
    pub double: Vec<f64>,
    /// The least and the largest that WGSL allows; `None`: anything. Empty where intervals take
    /// another way.
    pub allowed: Vec<Option<(f32, f32)>>,
}

/// Steps of a call. A loop has many, and nobody reads more.
const MOST: usize = 1000;

/// What an operation gave, one after the other.
struct Values<F> {
    all: Mutex<Vec<(usize, F)>>,
    /// Whether an index has left its array: WGSL allows anything from there on.
    lost: AtomicBool,
}

macro_rules! values {
    ($arithmetic:ty, $float:ty, $active:expr, $anything:expr) => {
        impl Observer<$arithmetic> for Values<$float> {
            fn floats(&self, lanes: &Lanes<'_, $arithmetic>) {
                let mut values = self.all.lock().unwrap_or_else(PoisonError::into_inner);
                let anything: Option<$float> = $anything;
                let lost = anything.filter(|_| self.lost.load(Ordering::Relaxed));
                let site = std::ptr::from_ref(lanes.site).addr();
                if lanes.active.first().is_some_and($active) && values.len() < 16 * MOST {
                    values.extend(lanes.floats.iter().map(|lane| (site, lost.unwrap_or(lane[0]))));
                }
            }

            fn out_of_range(&self, _: &OutOfRange<'_>) {
                self.lost.store(true, Ordering::Relaxed);
            }
        }
    };
}
values!(F32, f32, |active: &bool| *active, None);
values!(F64, f64, |active: &bool| *active, None);
values!(Intervals, Interval, |active: &Truth| *active != Truth::False, Some(Interval::UNBOUNDED));

impl<F: Copy> Values<F> {
    fn new() -> Self {
        Self { all: Mutex::default(), lost: AtomicBool::new(false) }
    }

    /// The components of each operation together: its site, how often that came before, and values.
    /// `components` tells how many a site has.
    fn groups(self, components: &dyn Fn(usize) -> usize) -> Vec<((usize, usize), Vec<F>)> {
        let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
        let mut groups: Vec<((usize, usize), Vec<F>)> = Vec::new();
        for (site, value) in self.all.into_inner().unwrap_or_else(PoisonError::into_inner) {
            match groups.last_mut() {
                // A loop of one operation is that operation again and again.
                Some(((last, _), values)) if *last == site && values.len() < components(site) => {
                    values.push(value);
                }
                _ => {
                    let count = counts.entry(site).or_default();
                    groups.push(((site, *count), vec![value]));
                    *count += 1;
                }
            }
        }
        groups
    }
}

impl Interpreted {
    /// The operations of a call, in the order in which they run.
    pub(crate) fn trace(&self, row: &[u32]) -> Result<Vec<Step>, ProbeError> {
        let options = self.options();
        let (single, double, bounds) = (Values::new(), Values::new(), Values::new());
        self.observed::<F32>(1, row, &options, &single)?;
        self.observed::<F64>(1, row, &options, &double)?;
        // Half precision has no bounds: then the column stays empty.
        let bounded = self.observed::<Intervals>(1, row, &options, &bounds).is_ok();
        let sites: BTreeMap<usize, &karat_engine::Site> =
            self.lowered.sites().iter().map(|one| (std::ptr::from_ref(one).addr(), one)).collect();
        let components = |site: usize| {
            let site = sites.get(&site).and_then(|site| Some((&site.function, site.expression?)));
            site.map_or(1, |(function, at)| self.program.components(function, at.index()))
        };
        let double: BTreeMap<_, Vec<f64>> = double.groups(&components).into_iter().collect();
        let bounds: BTreeMap<_, Vec<Interval>> = match bounded {
            true => bounds.groups(&components).into_iter().collect(),
            false => BTreeMap::new(),
        };
        let step = |(key, single): ((usize, usize), Vec<f32>)| {
            let (span, text) = self.author_of(sites.get(&key.0)?)?;
            let ends = |x: &Interval| x.is_bounded().then(|| (x.lo(), x.hi()));
            Some(Step {
                span,
                text,
                single,
                double: double.get(&key).cloned().unwrap_or_default(),
                allowed: bounds
                    .get(&key)
                    .map(|all| all.iter().map(ends).collect())
                    .unwrap_or_default(),
            })
        };
        Ok(single.groups(&components).into_iter().filter_map(step).take(MOST).collect())
    }
}
