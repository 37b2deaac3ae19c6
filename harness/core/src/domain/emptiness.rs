//! The reasons why a domain has no value.

/// The reason why a domain has no value.
///
/// ```
/// use karat::Domain;
///
/// let emptiness = Domain::emptiness(&(1.0..=0.0)).expect("it has no value");
/// assert_eq!((emptiness.what, emptiness.fault.as_str()), ("range", "starts at 1, above its end 0"));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Emptiness {
    /// The index of the tuple's part that is empty. `None` if the domain isn't a tuple, or if the part is unknown.
    pub part: Option<usize>,
    /// The name of the empty domain, such as `range`.
    pub what: &'static str,
    /// The cause, such as `starts at 1, above its end 0`.
    pub fault: String,
}

impl Emptiness {
    /// Makes a reason that applies to a whole domain, not to one part of a tuple. `what` names the domain in one word,
    /// and `fault` begins with a verb.
    ///
    /// ```
    /// use karat::unstable::domain::Emptiness;
    ///
    /// let emptiness = Emptiness::of("table", "has no rows");
    /// assert_eq!((emptiness.part, emptiness.what), (None, "table"));
    /// ```
    #[must_use]
    pub fn of(what: &'static str, fault: &str) -> Self {
        Self { part: None, what, fault: fault.to_owned() }
    }

    /// Sets the index of the tuple's part that is empty.
    pub(super) fn in_part(self, part: usize) -> Self {
        Self { part: Some(part), ..self }
    }

    /// Removes the index of the tuple's part, for domains such as [`Map`](super::Map), whose values aren't tuples.
    pub(super) fn apart(self) -> Self {
        Self { part: None, ..self }
    }
}

/// Describes an infinite or NaN end of a range: `ends at inf`. `None` if both ends are finite.
pub(super) fn infinite(low: f32, high: f32) -> Option<String> {
    let fault = |verb: &str, value: f32| format!("{verb} at {value}");
    match (low.is_finite(), high.is_finite()) {
        (true, true) => None,
        (false, _) => Some(fault("starts", low)),
        (true, false) => Some(fault("ends", high)),
    }
}

#[cfg(test)]
mod tests {
    use crate::domain::{Domain, Grid, Integers, Just, OneOf, UnitVector};

    #[test]
    fn each_cause_of_an_empty_domain_has_its_message() {
        let why = |emptiness: Option<super::Emptiness>| {
            let super::Emptiness { part, what, fault } = emptiness.expect("it is empty");
            (part, format!("{what} {fault}"))
        };
        for (range, fault) in [
            (1.0..=0.0, "range starts at 1, above its end 0"),
            (f32::NAN..=1.0, "range starts at NaN"),
            (0.0..=f32::INFINITY, "range ends at inf"),
            (f32::NEG_INFINITY..=f32::NAN, "range starts at -inf"),
        ] {
            assert_eq!(why(Domain::emptiness(&range)), (None, fault.to_owned()));
        }
        let tuple = (UnitVector, OneOf::<f32>(vec![]));
        assert_eq!(why(tuple.emptiness()), (Some(1), "list is empty".to_owned()));
        let mapped = (Just(0.0_f32), 2.0..=1.0_f32).map(|(x, y)| x + y);
        assert_eq!(why(mapped.emptiness()).0, None, "a mapped tuple has no parts");
        let grid = Grid::logarithmic(-1.0..=1.0, 9);
        let through =
            "grid is logarithmic, so its ends -1 and 1 must both be above 0 or both below 0";
        assert_eq!(why(grid.emptiness()).1, through);
        assert_eq!(why(Grid::linear(0.0..=1.0, 0).emptiness()).1, "grid has no points");
        let (low, high) = (3_i32, 2);
        assert_eq!(why(Integers(low..=high).emptiness()).1, "range starts at 3, above its end 2");
        assert!((UnitVector, 0.0..=1.0_f32).emptiness().is_none());
    }
}
