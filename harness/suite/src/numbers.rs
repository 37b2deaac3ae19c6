//! Numbers in tables.

use karat::value::{Scalar, format_f32};

/// A hexadecimal float of C99, as WGSL and Karat write it; exact in `f64` with up to 13 digits behind the
/// point, which are more than an f32 has.
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

/// The lane that a cell of a table gives an argument; `None` if it is no finite value of the type.
pub(crate) fn argument(scalar: Scalar, cell: &str) -> Option<u32> {
    let Some(value) = hexadecimal(cell).filter(|_| scalar.is_float()) else {
        return scalar.parse(cell);
    };
    #[expect(clippy::cast_possible_truncation, reason = "it is compared")]
    let single = value as f32;
    (f64::from(single).to_bits() == value.to_bits()).then_some(single.to_bits())
}

/// What a cell of a table expects of a component; `None` if it is no finite number, `true` or `false`.
///
/// A decimal that an `f32` is printed as stands for that `f32`, so that what was returned once is expected
/// exactly. Any other number is what it says, with all its digits.
#[must_use]
pub fn expected(scalar: Scalar, cell: &str) -> Option<f64> {
    match cell {
        "true" => Some(1.0),
        "false" => Some(0.0),
        cell => match hexadecimal(cell) {
            Some(value) => Some(value),
            None => Some(meant(scalar, cell.parse().ok().filter(|value: &f64| value.is_finite())?)),
        },
    }
}

/// The number that an author's decimal stands for, beside results of this type: in a table, as `equals`,
/// as `is`, as an end of `in_range`.
///
/// `0.3` is the `f32` that WGSL makes of it, as it is of `return 0.3;`: a decimal with no more digits than
/// tell one `f32` from the others. One with more digits, such as `0.3333333333333333`, is what it says:
/// it is the exact value that a tolerance is about.
pub(crate) fn meant(scalar: Scalar, value: f64) -> f64 {
    if !scalar.is_float() {
        return value;
    }
    let single = nearest(scalar, value);
    let printed = format_f32(single as f32).parse() == Ok(value);
    if printed && single.is_finite() { single } else { value }
}

/// The nearest number of the type that results have: what a decimal of any length is where it has to be
/// equal, as no other can be.
pub(crate) fn nearest(scalar: Scalar, value: f64) -> f64 {
    #[expect(clippy::cast_possible_truncation, reason = "that is what it is for")]
    let single = value as f32;
    if scalar.is_float() { single.into() } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_f32_prints_is_that_f32() {
        for value in [0.1_f32, 1.9999999, 1e-40, f32::MAX, -3.0, 16_777_216.0] {
            assert_eq!(expected(Scalar::F32, &format_f32(value)), Some(value.into()), "{value}");
            assert_eq!(argument(Scalar::F32, &format_f32(value)), Some(value.to_bits()));
        }
        let third = expected(Scalar::F32, "0.3333333333333333").expect("a number");
        assert!((third - 1.0 / 3.0).abs() < 1e-16 && third != f64::from(third as f32));
        assert_eq!(expected(Scalar::F32, "0x1.8p-1"), Some(0.75));
        assert_eq!(argument(Scalar::F32, "0x1.8p-1"), Some(0.75_f32.to_bits()));
        assert_eq!(argument(Scalar::F32, "0x1.00000001p+0"), None, "no f32");
        assert_eq!(expected(Scalar::U32, "4294967295"), Some(4_294_967_295.0));
        for none in ["", "nan", "inf", "x"] {
            assert_eq!(expected(Scalar::F32, none), None, "{none}");
        }
    }
}
