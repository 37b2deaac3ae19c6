//! Runs tests that are written in WGSL. The host judges the values that the tests' expectations compared.

use std::sync::atomic::{AtomicBool, Ordering};

use super::demand::Demand;
use super::plan::Plan;
use super::session::{Asserted, Session};
use super::trial::{Body, Last};
use super::{Agreement, Failure, Probe, Together, Vacuous};
use crate::diagnostic::one_line;
use crate::domain::{Emptiness, Held, Origin, Shrinkable, Stream};
use crate::expectation::{KEPT_WORDS, MOST_KEPT, Wanted};
use crate::judge::{Class, Described, Judge, Judged};
use crate::package::Package;
use crate::record::ExpectationDetails;
use crate::reflect::Program;
use crate::run::{Identity, Memory};
use crate::tolerance::{Abs, LaneError, Rel, Tolerance, Ulp};
use crate::value::{Scalar, format_f32, format_lane};

/// An expectation in a case's report, with its values. The shader reports the expectations that may have
/// failed.
struct Kept<'r> {
    words: &'r [u32],
}

impl Kept<'_> {
    fn kind(&self) -> (Option<Wanted>, usize) {
        let (kind, width) = (self.words[1] / 8, (self.words[1] % 8) as usize);
        (Wanted::ALL.get(kind as usize).copied(), width.clamp(1, 4))
    }

    fn bound(&self, index: usize) -> f64 {
        f64::from(f32::from_bits(self.words[10 + index]))
    }

    /// Checks in `f64` if the expectation holds. Values that aren't finite fail.
    fn holds(&self) -> bool {
        let (Some(wanted), width) = self.kind() else { return false };
        (0..width).all(|lane| self.lane_holds(wanted, lane))
    }

    fn lane_holds(&self, wanted: Wanted, lane: usize) -> bool {
        let (actual, expected) = (self.words[2 + lane], self.words[6 + lane]);
        let (a, e) = (f32::from_bits(actual), f32::from_bits(expected));
        let finite = a.is_finite() && e.is_finite();
        let within = |tolerance: Tolerance| {
            tolerance.unusable().is_none() && tolerance.measure(0, a, f64::from(e)).passes()
        };
        let (first, second) = (self.bound(0), self.bound(1));
        match wanted {
            Wanted::True | Wanted::EqualU32 | Wanted::EqualI32 => actual == expected,
            Wanted::EqualF32 => finite && a == e,
            Wanted::Near => finite && within(Abs(first).into()),
            Wanted::Relative => finite && within(Rel(first).into()),
            Wanted::Ulp => finite && within(Ulp(first).into()),
            Wanted::Within => {
                // The error is relative to the larger value, as in the WGSL community's test runner.
                let largest = f64::from(a.abs().max(e.abs()));
                finite && within(Abs(second.max(first * largest)).into())
            }
            Wanted::Finite => a.is_finite(),
            Wanted::AtMost => finite && a <= e,
            Wanted::Less => finite && a < e,
            Wanted::InRange => {
                let a = f64::from(a);
                let bounded = first.is_finite() && second.is_finite();
                a.is_finite() && bounded && first <= a && a <= second
            }
        }
    }

    /// Describes the expectation in a message: both values, and the largest allowed error.
    fn text(&self) -> String {
        let (Some(wanted), width) = self.kind() else {
            return "a damaged report from the shader".to_owned();
        };
        let scalar = match wanted {
            Wanted::True => Scalar::Bool,
            Wanted::EqualU32 => Scalar::U32,
            Wanted::EqualI32 => Scalar::I32,
            _ => Scalar::F32,
        };
        let show = |words: &[u32]| {
            let lanes: Vec<_> = words.iter().map(|word| format_lane(scalar, *word)).collect();
            if width == 1 { lanes[0].clone() } else { format!("({})", lanes.join(", ")) }
        };
        let (actual, expected) = (show(&self.words[2..2 + width]), show(&self.words[6..6 + width]));
        let bound = |index: usize| format_f32(f32::from_bits(self.words[10 + index]));
        let (first, second) = (bound(0), bound(1));
        match wanted {
            Wanted::Near => format!("{actual}, expected {expected} within {first}"),
            Wanted::Relative => {
                format!("{actual}, expected {expected} within a relative error of {first}")
            }
            Wanted::Ulp => {
                let unusable = Tolerance::from(Ulp(self.bound(0))).unusable();
                let nothing = unusable.map_or("", |_| ", which isn't a usable bound");
                format!("{actual}, expected {expected} within {first} ulp{nothing}")
            }
            Wanted::Within => {
                format!(
                    "{actual}, expected {expected} within {first} times the larger of the two absolute values, or within {second}"
                )
            }
            Wanted::Finite => format!("{actual}, expected a finite value"),
            Wanted::AtMost => format!("{actual}, expected at most {expected}"),
            Wanted::Less => format!("{actual}, expected less than {expected}"),
            Wanted::InRange => format!("{actual}, expected a value from {first} to {second}"),
            _ => format!("{actual}, expected {expected}"),
        }
    }
}

/// The report that the shader writes for a case: the number of evaluated expectations, and the number of
/// suspected expectations, which may have failed. Kernels that report values add the values of the first few
/// suspected expectations.
struct Report<'r> {
    words: &'r [u32],
}

impl<'r> Report<'r> {
    fn evaluated(&self) -> u32 {
        self.words[0]
    }

    fn suspected(&self) -> usize {
        self.words[1] as usize
    }

    fn kept(&self) -> impl Iterator<Item = Kept<'r>> {
        let words = self.words[2..].chunks_exact(KEPT_WORDS);
        words.take(self.suspected().min(MOST_KEPT)).map(|words| Kept { words })
    }

    /// Checks if the reported values prove that all expectations hold. Returns `false` if the report lacks the
    /// values of an expectation that may have failed.
    fn passes(&self) -> bool {
        self.kept().count() == self.suspected() && self.kept().all(|kept| kept.holds())
    }

    fn described(&self, program: &Program) -> Described {
        let failed = self.kept().filter(|kept| !kept.holds()).map(|kept| {
            let seen = kept.text();
            let Some(span) = program.expectation(kept.words[0]) else {
                return ExpectationDetails { place: String::new(), seen };
            };
            let text = span.file.text.get(span.range.clone()).unwrap_or_default();
            let seen = format!("`{}` saw {seen}", one_line(text));
            ExpectationDetails { place: span.to_string(), seen }
        });
        let expectations: Vec<_> = failed.collect();
        let more = self.suspected().checked_sub(MOST_KEPT).filter(|more| *more > 0);
        let note = more.map(|more| match expectations.is_empty() {
            false => ("and", format!("{more} more")),
            true => (
                "unclear",
                format!(
                    "{} values lie very close to their bounds. Karat judged only the first {MOST_KEPT} of these \
                     values, and they pass. Widen the tolerance by a thousandth, or split the test",
                    self.suspected()
                ),
            ),
        });
        Described { expectations, notes: note.into_iter().collect() }
    }
}

struct Reports<'r> {
    program: &'r Program,
}

impl Judge for Reports<'_> {
    fn judge(&self, _: usize, actual: &[u32]) -> Judged {
        let report = Report { words: actual };
        let measure = LaneError::statement(report.passes());
        let class = if report.evaluated() == 0 { Class::Idle } else { Class::Other };
        Judged { measure, lane: 0, class }
    }

    fn describe(&self, actual: &[u32]) -> Option<Described> {
        Some(Report { words: actual }.described(self.program))
    }
}

pub(super) const NAME: &str = "expects";

/// A stream of one test's cases for the function that several tests share. Writes the test's arguments at their place
/// in the shared function's arguments, and 0 elsewhere.
#[derive(Debug)]
struct Placed<'s> {
    stream: Rows<'s>,
    which: u32,
    first: usize,
    words: usize,
}

/// A wrapper that implements `Debug` for a stream, because [`Placed`] derives `Debug`.
struct Rows<'s>(&'s dyn Stream);

impl std::fmt::Debug for Rows<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("rows")
    }
}

impl Placed<'_> {
    fn place(&self, own: &[u32], rows: &mut Vec<u32>) {
        let start = rows.len();
        rows.push(self.which);
        rows.resize(start + self.first, 0);
        rows.extend_from_slice(own);
        rows.resize(start + self.words, 0);
    }
}

impl Stream for Placed<'_> {
    fn width(&self) -> usize {
        self.words
    }

    fn size(&self) -> Option<u64> {
        self.stream.0.size()
    }

    fn emptiness(&self) -> Option<Emptiness> {
        self.stream.0.emptiness()
    }

    fn edges(&self) -> usize {
        self.stream.0.edges()
    }

    fn row(&self, origin: Origin<'_>, rows: &mut Vec<u32>) -> bool {
        let mut own = Vec::new();
        let made = self.stream.0.row(origin, &mut own);
        if made {
            self.place(&own, rows);
        }
        made
    }

    /// Returns `None`, because Karat never simplifies or replays a case in the shared kernel. For that, Karat runs the
    /// test in its own kernel.
    fn value(&self, _: Origin<'_>) -> Option<Held> {
        None
    }

    fn shrinkable(&self, _: Origin<'_>) -> Option<Shrinkable<'_, Held>> {
        None
    }

    fn admits(&self, _: &[u32]) -> Option<bool> {
        None
    }

    fn shrink(&self, _: &[u32]) -> Vec<Vec<u32>> {
        Vec::new()
    }

    fn described(&self) -> String {
        self.stream.0.described()
    }

    fn show(&self, row: &[u32]) -> String {
        let end = (self.first + self.stream.0.width()).min(row.len());
        self.stream.0.show(&row[self.first.min(end)..end])
    }
}

/// The result of a run. Some kernels only count the expectations that may have failed.
enum Counted {
    /// The run gave a verdict or an error.
    Concluded(Result<Agreement, Failure>),
    /// An expectation may have failed. The test must run again with a kernel that reports values.
    Suspicious,
}

impl<'a> Plan<'a> {
    /// Runs a test that is written in WGSL.
    ///
    /// A kernel that only counts failures compiles in a third of the time of a kernel that also reports values.
    /// Drivers compile one kernel with several tests faster than several kernels. So Karat first runs several
    /// tests in one counting kernel. If a test doesn't pass in the counting kernel, Karat runs that test again
    /// in its own kernel, which reports values.
    pub(super) fn expects(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
    ) -> Result<Agreement, Failure> {
        let identity = Identity::of(&self.probe.name, NAME)?;
        if let Some(agreement) = self.together(&identity, stream, demand) {
            return Ok(agreement);
        }
        let alone = |package: &'a Package, telling| {
            let probe = Probe { package, telling, together: None, ..self.probe.clone() };
            Plan { probe, ..self.clone() }
        };
        let counting = alone(self.probe.package, self.probe.telling);
        match (counting.counted(&identity, stream, demand), self.probe.telling) {
            (Counted::Concluded(verdict), _) => verdict,
            (Counted::Suspicious, None) => unreachable!("without telling it concludes"),
            (Counted::Suspicious, Some(package)) => {
                match alone(package, None).counted(&identity, stream, demand) {
                    Counted::Concluded(verdict) => verdict,
                    Counted::Suspicious => unreachable!("without telling it concludes"),
                }
            }
        }
    }

    /// Runs the test in the shared kernel, and returns the verdict if the test passes. Returns `None` if the
    /// test has remembered or replayed inputs, because such a test needs its own kernel.
    fn together(
        &self,
        identity: &Identity,
        stream: &dyn Stream,
        demand: &Demand,
    ) -> Option<Agreement> {
        let Together { package, shapes, which, first, words, .. } = self.probe.together.as_ref()?;
        let name = &self.probe.name;
        let replays = identity.case(name, &identity.check).is_some();
        let remembers =
            || Memory::open(identity).is_some_and(|m| !m.of(name, &identity.check).is_empty());
        if replays || remembers() {
            return None;
        }
        let probe = Probe { package, ..self.probe.clone() };
        let stream = Placed { stream: Rows(stream), which: *which, first: *first, words: *words };
        let demand = Demand { arguments: shapes.to_vec(), ..*demand };
        match (Plan { probe, ..self.clone() }).counted(identity, &stream, &demand) {
            Counted::Concluded(Ok(agreement)) => Some(agreement),
            _ => None,
        }
    }

    fn counted(&self, identity: &Identity, stream: &dyn Stream, demand: &Demand) -> Counted {
        let asserted = Asserted::new(NAME, "all its expectations hold".to_owned());
        let suspicious = AtomicBool::new(false);
        // If the test doesn't pass in the shared kernel, a later run gives the verdict.
        let withheld = AtomicBool::new(false);
        let run = (identity, &withheld);
        let mut verb = |session: &Session<'_>| {
            let reports = Reports { program: &session.called.probed.program };
            let tally = session.run(&mut |batch, running| {
                let tally = session.judge(batch, running, |_| None, &reports)?;
                if self.probe.telling.is_some() && tally.fails() {
                    // Nobody sees this error, because a later run gives the verdict.
                    suspicious.store(true, Ordering::Relaxed);
                    return session.called.vacuous(Vacuous::NoExpectation);
                }
                Ok(tally)
            })?;
            let asserted = tally.tally.census.judged() > 0;
            session.expect_tested(asserted, tally, Vacuous::NoExpectation)
        };
        let last: Last<'_> = &mut |verdict: Result<_, _>, _| {
            let elsewhere = self.probe.together.is_some() && verdict.is_err();
            withheld.store(elsewhere || suspicious.load(Ordering::Relaxed), Ordering::Relaxed);
            verdict
        };
        let verb = (&mut verb as Body<'_>, last);
        let verdict = self.conclude_unless(run, &asserted, stream, demand, verb);
        match suspicious.into_inner() {
            true => Counted::Suspicious,
            false => Counted::Concluded(verdict),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::{Just, Numbering, Typed};

    #[test]
    fn rows_of_arguments_are_placed_where_the_kernel_reads_them() {
        let domain = (Just(7_u32), Just(9_u32));
        let alone = Typed::arguments(&domain);
        let row = |first: usize, words: usize| {
            let placed = Placed { stream: Rows(&alone), which: 3, first, words };
            let mut rows = Vec::new();
            let cases = Numbering::of(&placed, 1, 1, 1);
            assert_eq!((placed.rows(&cases, 0..1, &mut rows), placed.width()), (1, words));
            rows
        };
        assert_eq!(row(1, 3), [3, 7, 9]);
        assert_eq!(row(2, 6), [3, 0, 7, 9, 0, 0]);
    }

    fn kept(wanted: Wanted, actual: f32, expected: f32, bounds: [f32; 2]) -> [u32; KEPT_WORDS] {
        let mut words = [0; KEPT_WORDS];
        words[1] = wanted as u32 * 8 + 1;
        (words[2], words[6]) = (actual.to_bits(), expected.to_bits());
        (words[10], words[11]) = (bounds[0].to_bits(), bounds[1].to_bits());
        words
    }

    // Lesson 104
    #[test]
    fn a_case_without_kept_values_fails() {
        let passes = |words: &[u32]| Report { words }.passes();
        assert!(passes(&[3, 0]) && !passes(&[3, 1]), "a report that only counts");
        let good = kept(Wanted::Near, 1.0, 1.0, [0.0; 2]);
        let bad = kept(Wanted::Near, 2.0, 1.0, [0.0; 2]);
        let report = |suspected: u32, kept: [[u32; KEPT_WORDS]; MOST_KEPT]| {
            let words = [&[9, suspected][..], &kept.concat()].concat();
            passes(&words)
        };
        assert!(report(3, [good; 3]) && !report(4, [good; 3]) && !report(2, [good, bad, good]));
        assert!(
            report(1, [good, bad, bad]),
            "values after the counted ones belong to an earlier case"
        );
    }

    // Lesson 100
    #[test]
    fn the_host_compares_kept_values_exactly() {
        let holds = |wanted, actual, expected, bounds| {
            Kept { words: &kept(wanted, actual, expected, bounds) }.holds()
        };
        assert!(holds(Wanted::Near, 1.5, 1.0, [0.5, 0.0]));
        assert!(!holds(Wanted::Near, 1.5_f32.next_up(), 1.0, [0.5, 0.0]));
        assert!(holds(Wanted::Ulp, 1.0_f32.next_up(), 1.0, [1.0, 0.0]));
        assert!(!holds(Wanted::Ulp, 1.0_f32.next_up().next_up(), 1.0, [1.0, 0.0]));
        assert!(!holds(Wanted::Ulp, 1.0, 1.0, [4.3e9, 0.0]), "no two numbers are farther apart");
        assert!(holds(Wanted::Within, 1000.9, 1000.0, [1e-3, 1e-6]));
        assert!(!holds(Wanted::Within, 1002.0, 1000.0, [1e-3, 1e-6]));
        assert!(holds(Wanted::InRange, 1.0, 0.0, [0.0, 1.0]));
        assert!(!holds(Wanted::InRange, 1.1, 0.0, [0.0, 1.0]));
        assert!(!holds(Wanted::InRange, 1.0, 0.0, [0.0, f32::INFINITY]));
        assert!(!holds(Wanted::Relative, -3.4e38, 3.4e38, [1.05, 0.0]));
        assert!(
            holds(Wanted::AtMost, 1.0, 1.0, [0.0; 2]) && !holds(Wanted::Less, 1.0, 1.0, [0.0; 2])
        );
        for wanted in Wanted::ALL.into_iter().filter(|wanted| *wanted as u32 > 2) {
            for bad in [f32::NAN, f32::INFINITY] {
                assert!(!holds(wanted, bad, bad, [f32::MAX, f32::MAX]), "{wanted:?} {bad}");
            }
        }
        for bound in [f32::NAN, f32::INFINITY, -1.0] {
            assert!(!holds(Wanted::Near, 1.0, 1.5, [bound, 0.0]), "{bound}");
        }
    }
}
