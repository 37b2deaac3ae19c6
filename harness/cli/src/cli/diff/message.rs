//! Writes a comparison as text.

use std::io::{self, Write};

use karat::unstable::output::counted;
use karat::unstable::value::format_f32;

use super::comparison::{Comparison, Ending, FlipResult, GateResult, LdrResult, Reason, Side};
use crate::cli::table::{BAD, GOOD};

pub(super) fn write(comparison: &Comparison, out: &mut dyn Write) -> io::Result<()> {
    let Comparison { a, b, tolerance, .. } = comparison;
    for (name, side) in [("a", a), ("b", b)] {
        write!(out, "{name}: {}, {} x {}", side.file, side.width, side.height)?;
        write_parts(side, out)?;
        write_census(side, out)?;
    }
    if comparison.of_other_primaries() {
        writeln!(
            out,
            "note: the files name different primaries (chromaticities {} and {}); Karat compares the \
             values without a conversion",
            primaries(a),
            primaries(b)
        )?;
    }
    let equal = comparison.verdict == Ending::Equal;
    if let (Some(gate), Some(flip), false) = (&comparison.gate, &comparison.flip, equal) {
        write_gate(gate, comparison.compared, out)?;
        write_flip(flip, out)?;
        comparison.ldr_flip.as_ref().map_or(Ok(()), |flip| write_ldr(flip, out))?;
    }
    let all = u64::from(a.width) * u64::from(a.height);
    if comparison.gate.is_some() && (comparison.compared as u64) < all {
        let by = if comparison.own_mask { "the part `mask` of image b" } else { "the mask" };
        writeln!(out, "{} of {all} pixels are compared, selected by {by}", comparison.compared)?;
    }
    if let Some(file) = &comparison.heatmap {
        let scale = comparison.heatmap_full.map(|full| format!(", errors shown from 0 to {full}"));
        let unseen = comparison.flip.as_ref().is_some_and(|flip| flip.note.is_some());
        let unseen = if unseen { ", without the differences that FLIP ignores" } else { "" };
        writeln!(out, "heatmap: {file}{}{unseen}", scale.unwrap_or_default())?;
    }
    match (comparison.verdict, comparison.reason) {
        (Ending::Equal, _) => writeln!(out, "{GOOD}equal, bit for bit{GOOD:#}"),
        (Ending::Within, _) => writeln!(out, "{GOOD}within {tolerance}{GOOD:#}"),
        (_, Some(Reason::Size)) => writeln!(out, "{BAD}the images differ in size{BAD:#}"),
        (_, Some(Reason::NonFinite)) => {
            writeln!(
                out,
                "{BAD}the images differ: NaN and infinities differ from every value{BAD:#}"
            )
        }
        _ => writeln!(out, "{BAD}the images differ by more than {tolerance}{BAD:#}"),
    }
}

/// Formats the coordinates of red, green, blue and white: `(0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.3127, 0.329)`.
fn primaries(side: &Side) -> String {
    let points: Vec<_> = side
        .chromaticities
        .chunks(2)
        .map(|point| format!("({}, {})", point[0], point[1]))
        .collect();
    points.join(", ")
}

/// Prints which part of the file Karat compares, and which parts it ignores.
fn write_parts(side: &Side, out: &mut dyn Write) -> io::Result<()> {
    let [compared, others @ ..] = side.parts.as_slice() else { return Ok(()) };
    write!(out, ", of which Karat compares part `{compared}` and ignores `{}`", others.join("`, `"))
}

fn write_census(side: &Side, out: &mut dyn Write) -> io::Result<()> {
    if let Some((x, y)) = side.first_non_finite {
        let Side { nan, infinite, .. } = side;
        write!(
            out,
            ", {} with NaN and {infinite} with infinities, the first at ({x}, {y})",
            counted(*nan, "pixel")
        )?;
    }
    writeln!(out)
}

fn write_gate(gate: &GateResult, compared: usize, out: &mut dyn Write) -> io::Result<()> {
    let GateResult { relative, off, bounds, worst, sweep } = gate;
    let allowed = format!("{relative:e}");
    let allowed = allowed.strip_suffix("e0").unwrap_or(&allowed);
    write!(out, "gate: {off} of {compared} pixels differ by more than rel {allowed}")?;
    if let Some(bounds) = bounds {
        write!(out, ", within {bounds}")?;
    }
    writeln!(out)?;
    let Some(worst) = worst else { return Ok(()) };
    let (a, b) = (format_f32(worst.a), format_f32(worst.b));
    let (x, y, channel) = (worst.x, worst.y, worst.channel);
    write!(out, "  worst: pixel ({x}, {y}) {channel}: {b} instead of {a}, ")?;
    match f64::from(worst.ratio) {
        // No number is a multiple of a bound of 0.
        ratio if ratio.is_infinite() => {
            let error = short(f64::from((worst.b - worst.a).abs()));
            writeln!(out, "abs {error}, and no error is allowed")?;
        }
        ratio => writeln!(out, "{} times the allowed error", short(ratio))?,
    }
    // All multiples of 0 are 0.
    if *relative == 0.0 {
        return Ok(());
    }
    let shares = [1.0, 10.0, 100.0, 1000.0].into_iter().zip(sweep);
    let shares: Vec<String> = shares
        .map(|(factor, share)| format!("{}: {share:.3}%", short(f64::from(relative * factor))))
        .collect();
    writeln!(out, "  pixels that differ at a tolerance of {}", shares.join(", "))
}

fn write_flip(flip: &FlipResult, out: &mut dyn Write) -> io::Result<()> {
    if let Some(note) = &flip.note {
        return writeln!(out, "HDR-FLIP: {note}");
    }
    let of = |bound: Option<f64>| bound.map_or_else(String::new, |b| format!(" of {}", short(b)));
    write!(out, "HDR-FLIP: largest tile {}{}", short(flip.largest_tile), of(flip.tile_bound))?;
    if let Some(tile) = flip.tile {
        write!(out, ", in {tile}")?;
    }
    let mean = short(flip.mean);
    writeln!(out, "; mean {mean}{}; exposures {}", of(flip.mean_bound), flip.exposures)
}

/// Prints LDR-FLIP, the number that other FLIP tools give for PNGs.
fn write_ldr(flip: &LdrResult, out: &mut dyn Write) -> io::Result<()> {
    let (mean, tile) = (short(flip.mean), short(flip.largest_tile));
    writeln!(out, "LDR-FLIP: largest tile {tile}; mean {mean}; no bound applies to LDR-FLIP")
}

/// Formats a number with three significant digits.
fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    if rounded != 0.0 && !(1e-4..1e6).contains(&rounded.abs()) {
        return format!("{rounded:e}");
    }
    rounded.to_string()
}
