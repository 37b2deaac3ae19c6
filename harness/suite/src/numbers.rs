//! Reads numbers from tables.

use karat::unstable::value::Scalar;
use karat::unstable::value::format_f32;
use karat::{Tolerance, Ulp};

/// Parses a hexadecimal float, as in C99 and WGSL. The result is exact if at most 13 digits follow the point. An `f32`
/// needs only 6.
#[must_use]
pub fn hexadecimal(word: &str) -> Option<f64> {
    let (sign, word) = match word.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, word),
    };
    let rest = word.strip_prefix("0x").or_else(|| word.strip_prefix("0X"))?;
    let (digits, exponent) = rest.split_once(['p', 'P'])?;
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let all = format!("{whole}{fraction}");
    if all.is_empty() || all.len() > 13 {
        return None;
    }
    let mantissa = u64::from_str_radix(&all, 16).ok()?;
    let exponent: i32 = exponent.parse().ok().filter(|e| (-1000..1000).contains(e))?;
    let shift = exponent - 4 * i32::try_from(fraction.len()).ok()?;
    #[expect(clippy::cast_precision_loss, reason = "13 digits are 52 bits")]
    let value = mantissa as f64 * 2.0_f64.powi(shift);
    Some(sign * value)
}

/// Parses a table cell as a scalar of an argument, and returns its bits. `None` if the cell isn't a value of this type.
/// A float may be `inf`, `-inf` or `nan`, so that a table can test how a function handles them.
pub(crate) fn argument(scalar: Scalar, cell: &str) -> Option<u32> {
    let unsigned = cell.strip_prefix(['-', '+']).unwrap_or(cell);
    let named = unsigned.to_ascii_lowercase();
    if scalar.is_float() && ["inf", "infinity", "nan"].contains(&&*named) {
        return cell.parse().ok().map(f32::to_bits);
    }
    let Some(value) = hexadecimal(cell).filter(|_| scalar.is_float()) else {
        return scalar.parse(cell);
    };
    #[expect(clippy::cast_possible_truncation, reason = "it is compared")]
    let single = value as f32;
    (f64::from(single).to_bits() == value.to_bits()).then_some(single.to_bits())
}

/// The comparison between a function's results and an expected number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The results must equal the number.
    Equal,
    /// The results must be near the number.
    Near,
}

impl From<&Tolerance> for Wanted {
    fn from(tolerance: &Tolerance) -> Self {
        if *tolerance == Ulp(0.0).into() { Self::Equal } else { Self::Near }
    }
}

/// Checks if a component of type `scalar` can have the value `number`. For integers and `bool`, the value must be
/// exact. For floats, the number must not overflow.
pub(crate) fn fits(scalar: Scalar, number: f64) -> bool {
    match scalar {
        Scalar::I32 => f64::from(number as i32) == number,
        Scalar::U32 => f64::from(number as u32) == number,
        Scalar::Bool => number == 0.0 || number == 1.0,
        // The comparison uses the exact number, in `f64`.
        _ => !number.is_finite() || (number as f32).is_finite(),
    }
}

/// The expected value of a component from a table cell: a finite number, `true` or `false`.
///
/// `0.3` means the `f32` that Karat prints as `0.3`. A decimal with more digits is exact. If results must equal the
/// number, each decimal means the nearest `f32`.
///
/// # Errors
/// Returns an error if the cell isn't a finite number, or the component can't represent it.
pub fn expected(scalar: Scalar, cell: &str, wanted: Wanted) -> Result<f64, String> {
    let decimal = || {
        let value = cell.parse().ok().filter(|value: &f64| value.is_finite());
        value.map(|value| meant(scalar, value, wanted))
    };
    let value = match cell {
        "true" => Some(1.0),
        "false" => Some(0.0),
        cell => hexadecimal(cell).or_else(decimal),
    };
    let none = || format!("`{cell}` isn't a finite number, and Karat compares only finite numbers");
    let value = value.ok_or_else(none)?;
    match fits(scalar, value) {
        true => Ok(value),
        false => Err(format!(
            "`{cell}` isn't of type {}, so no result can equal `{cell}`",
            scalar.wgsl()
        )),
    }
}

/// The expected number for a decimal in a test file or its table, as `f64`. `scalar` is the type of the results.
///
/// A decimal that Karat would print for an `f32` means exactly this `f32`: `0.3` is the value that `return 0.3;`
/// returns. A decimal with more digits, such as `0.3333333333333333`, is exact, and the tolerance applies to it. If
/// results must equal the number, the decimal means the nearest `f32`, because functions can't return any other number.
pub(crate) fn meant(scalar: Scalar, value: f64, wanted: Wanted) -> f64 {
    #[expect(clippy::cast_possible_truncation, reason = "the nearest is wanted")]
    let single = value as f32;
    let printed = || format_f32(single).parse() == Ok(value);
    if scalar.is_float() && single.is_finite() && (wanted == Wanted::Equal || printed()) {
        single.into()
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 170
    #[test]
    fn a_printed_f32_is_read_back() {
        let expected = |scalar, cell: &str| expected(scalar, cell, Wanted::Near);
        for value in [0.1_f32, 1.9999999, 1e-40, f32::MAX, -3.0, 16_777_216.0] {
            assert_eq!(expected(Scalar::F32, &format_f32(value)), Ok(value.into()), "{value}");
            assert_eq!(argument(Scalar::F32, &format_f32(value)), Some(value.to_bits()));
        }
        let third = expected(Scalar::F32, "0.3333333333333333").expect("a number");
        assert!((third - 1.0 / 3.0).abs() < 1e-16 && third != f64::from(third as f32));
        // If results must equal the number, it means the nearest `f32`, whatever its number of digits.
        let third =
            super::expected(Scalar::F32, "0.3333333333333333", Wanted::from(&Ulp(0.0).into()));
        assert_eq!(third, Ok(f64::from(1.0_f32 / 3.0)));
        assert_eq!(meant(Scalar::F32, 1e39, Wanted::Equal), 1e39, "each f32 is smaller");
        assert_eq!(meant(Scalar::I32, 16_777_217.0, Wanted::Equal), 16_777_217.0);
        assert_eq!(expected(Scalar::F32, "0x1.8p-1"), Ok(0.75));
        assert_eq!(argument(Scalar::F32, "0x1.8p-1"), Some(0.75_f32.to_bits()));
        assert_eq!(argument(Scalar::F32, "0x1.00000001p+0"), None, "no f32");
        assert_eq!(expected(Scalar::U32, "4294967295"), Ok(4_294_967_295.0));
        for (scalar, cell) in
            [(Scalar::U32, "5.5"), (Scalar::I32, "-2147483649"), (Scalar::Bool, "2")]
        {
            assert!(
                expected(scalar, cell).is_err_and(|why| why.contains("so no result can equal"))
            );
        }
        assert_eq!(argument(Scalar::F32, "-inf"), Some(f32::NEG_INFINITY.to_bits()));
        assert!(argument(Scalar::F32, "nan").is_some_and(|lane| f32::from_bits(lane).is_nan()));
        for (scalar, cell) in
            [(Scalar::U32, "inf"), (Scalar::F32, "infinite"), (Scalar::F32, "1e39")]
        {
            assert_eq!(argument(scalar, cell), None, "{cell}");
        }
        for none in ["", "nan", "inf", "x"] {
            assert!(expected(Scalar::F32, none).is_err(), "{none}");
        }
    }
}
