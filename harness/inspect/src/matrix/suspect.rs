//! Names the suspect if two columns differ. The suspect is a column that differs from at least two other columns, which
//! agree with each other.

use super::{Cell, Stop};

/// The side that a column takes if two columns differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// The column agrees with the first column.
    First,
    /// The column agrees with the second column, which differs from the first column.
    Other,
    /// The column agrees with neither of these two columns, or with both.
    Neither,
}

/// Names the suspect if a cell differs from the first column. If further columns agree with the cell, and none with the
/// first column, the first column is the suspect. If further columns agree with the first column, and none with the
/// cell, the cell's column is the suspect. `sides` has the name and side of each column.
pub(super) fn name(cell: &mut Cell, sides: &[(String, Side)]) {
    let of = |side: Side| -> Vec<&str> {
        sides.iter().filter(|(_, own)| *own == side).map(|(name, _)| name.as_str()).collect()
    };
    let (first, other) = (of(Side::First), of(Side::Other));
    let (alone, agreeing) = match (&*first, &*other) {
        ([alone], [_, _, ..]) => (alone, &other),
        ([_, _, ..], [alone]) => (alone, &first),
        _ => return,
    };
    if let Some(Stop::Differs(text)) = &mut cell.stopped {
        let names: Vec<String> = agreeing.iter().map(|name| format!("`{name}`")).collect();
        text.push_str(&format!(
            "; {} agree with each other, so the fault is probably in `{alone}`",
            and(&names)
        ));
        cell.suspect = Some((*alone).to_owned());
    }
}

/// The names in a sentence: `a`, `b` and `c`.
fn and(names: &[String]) -> String {
    match names {
        [all @ .., last] if !all.is_empty() => format!("{} and {last}", all.join(", ")),
        names => names.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 86
    #[test]
    fn the_only_path_that_disagrees_is_the_suspect() {
        use Side::{First, Neither, Other};
        let told = |sides: &[Side]| {
            let mut cell =
                Cell { stopped: Some(Stop::Differs("1 differs".to_owned())), ..Cell::default() };
            let names = ["cpu", "vulkan", "gl", "dx12"].map(str::to_owned);
            let sides: Vec<_> = names.into_iter().zip(sides.iter().copied()).collect();
            name(&mut cell, &sides);
            let text = cell.stopped.as_ref().map_or("", Stop::text).to_owned();
            (cell.suspect, text)
        };
        assert_eq!(told(&[First, Other]), (None, "1 differs".to_owned()), "one against one");
        let (suspect, text) = told(&[First, Other, First]);
        assert_eq!(suspect.as_deref(), Some("vulkan"));
        assert_eq!(
            text,
            "1 differs; `cpu` and `gl` agree with each other, so the fault is probably in `vulkan`"
        );
        let (suspect, text) = told(&[First, Other, Other, Other]);
        assert_eq!(suspect.as_deref(), Some("cpu"));
        assert!(
            text.contains(
                "`vulkan`, `gl` and `dx12` agree with each other, so the fault is probably in `cpu`"
            ),
            "{text}"
        );
        for undecided in [&[First, Other, First, Other][..], &[First, Other, Neither, Neither]] {
            assert_eq!(told(undecided).0, None, "{undecided:?}");
        }
    }
}
