//! The message about a frame that differs.

use std::fmt;

use super::compare::Deviation;
use super::tolerance::{CriterionMargin, FrameCriterion};
use crate::tolerance::{beyond, power, significant};
use crate::value::format_f32;

impl Deviation {
    /// The first bound that the frame exceeds: the measured value as text, and this value divided by the bound.
    pub(crate) fn worst_margin(&self) -> (String, Option<f64>) {
        let Some(margin) = self.margins.iter().find(|margin| !margin.passes()) else {
            return (String::new(), None);
        };
        let value = match (margin.criterion, &self.worst) {
            // A value can't be divided by a bound of zero.
            (FrameCriterion::Gate, Some(worst)) if self.gate.relative == 0.0 => {
                format!("abs {}", significant(f64::from((worst.actual - worst.golden).abs())))
            }
            (FrameCriterion::Gate, _) => {
                format!("rel {}", significant(margin.value * f64::from(self.gate.relative)))
            }
            _ => format!("{} {}", margin.name, significant(margin.value)),
        };
        (value, Some(margin.ratio()).filter(|ratio| ratio.is_finite()))
    }

    pub(super) fn summary(&self) -> String {
        let Self { outliers, pixels, bounds, worst, gate, .. } = self;
        let relative = power(gate.relative);
        match worst {
            Some(_) => format!(
                "{outliers} of {pixels} pixels differ by more than rel {relative}, within {bounds}"
            ),
            None => {
                format!("no pixel differs by more than rel {relative}, but another metric fails")
            }
        }
    }
}

/// The first line of the message shows the difference and its position. Each further line adds one fact.
impl fmt::Display for Deviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pixels, frame_pixels, worst, gate, sweep, margins, exposures, pinned, .. } =
            self;
        let relative = gate.relative;
        f.write_str(&self.summary())?;
        if pixels < frame_pixels {
            let share = significant(100.0 * *pixels as f64 / *frame_pixels as f64);
            write!(f, "\n  compared: {share}% of the frame, and the mask excludes the rest")?;
        }
        if let Some(worst) = worst {
            write!(
                f,
                "\n  worst: pixel ({}, {}) {}: {} instead of {}, {}",
                worst.x,
                worst.y,
                ["red", "green", "blue", "alpha"].get(worst.channel).unwrap_or(&"?"),
                format_f32(worst.actual),
                format_f32(worst.golden),
                beyond((worst.actual - worst.golden).into(), worst.ratio.into()),
            )?;
        }
        for margin in margins {
            let word = if margin.passes() { "passes" } else { "fails " };
            write!(f, "\n  {word} {margin}")?;
        }
        let flip = margins.iter().any(|margin| margin.criterion == FrameCriterion::Flip);
        if flip {
            let pinned = if *pinned { ", pinned in the golden" } else { "" };
            write!(f, "\n  FLIP used exposures of {exposures}{pinned}")?;
        }
        // For a tolerance of zero, all four tolerances below would be zero.
        if worst.is_some() && gate.relative > 0.0 {
            write!(f, "\n  pixels that exceed a tolerance of")?;
            let shares = [1.0, 10.0, 100.0, 1000.0].into_iter().zip(sweep).enumerate();
            for (index, (factor, share)) in shares {
                let tolerance = significant(f64::from(relative * factor));
                let comma = if index == 0 { "" } else { "," };
                write!(f, "{comma} {tolerance}: {share:.3}%")?;
            }
        }
        write_what_would_pass(margins, gate.relative, f)
    }
}

/// For each bound that the frame exceeds, writes the smallest bound that the frame would pass, rounded up to two
/// digits.
fn write_what_would_pass(
    margins: &[CriterionMargin],
    relative: f32,
    f: &mut fmt::Formatter<'_>,
) -> fmt::Result {
    let failing = margins.iter().filter(|margin| !margin.passes() && margin.value.is_finite());
    for (index, margin) in failing.enumerate() {
        f.write_str(if index == 0 { "\n  would pass:" } else { "," })?;
        match margin.criterion {
            FrameCriterion::Gate => {
                let needed = rounded_up(margin.value * f64::from(relative));
                write!(f, " a gate of rel {needed}")?;
            }
            _ => write!(f, " {} of {}", margin.name, rounded_up(margin.value))?,
        }
    }
    Ok(())
}

fn rounded_up(value: f64) -> String {
    let unit = 10_f64.powf(value.abs().log10().floor() - 1.0);
    significant((value / unit).ceil() * unit)
}
