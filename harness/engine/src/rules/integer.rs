//! Rules for integers: wrapping arithmetic, bits, packed bytes.

use super::integer_rules;
use crate::interval::Range;

fn signed<const N: usize>(x: [u32; N]) -> [i32; N] {
    x.map(u32::cast_signed)
}

integer_rules! {
    /// Functions from integers to an integer.
    Integer {
        AddI[2] true {
            exact: |[x, y]| x.wrapping_add(y),
            range: |[x, y]| Some(Range::or_full(x.lo() + y.lo(), x.hi() + y.hi(), true)),
        }
        AddU[2] false {
            exact: |[x, y]| x.wrapping_add(y),
            range: |[x, y]| Some(Range::or_full(x.lo() + y.lo(), x.hi() + y.hi(), false)),
        }
        SubtractI[2] true {
            exact: |[x, y]| x.wrapping_sub(y),
            range: |[x, y]| Some(Range::or_full(x.lo() - y.hi(), x.hi() - y.lo(), true)),
        }
        SubtractU[2] false {
            exact: |[x, y]| x.wrapping_sub(y),
            range: |[x, y]| Some(Range::or_full(x.lo() - y.hi(), x.hi() - y.lo(), false)),
        }
        MultiplyI[2] true {
            exact: |[x, y]| x.wrapping_mul(y),
            range: |[x, y]| Some(product(x, y, true)),
        }
        MultiplyU[2] false {
            exact: |[x, y]| x.wrapping_mul(y),
            range: |[x, y]| Some(product(x, y, false)),
        }
        /// The result is `x` if the divisor is 0, or if the quotient overflows.
        DivideI[2] true {
            exact: |x| {
                let [x, y] = signed(x);
                let harmless = if y == 0 || (x == i32::MIN && y == -1) { 1 } else { y };
                (x / harmless).cast_unsigned()
            },
        }
        DivideU[2] false {
            exact: |[x, y]| x / if y == 0 { 1 } else { y },
            range: |[x, y]| (y.lo() > 0).then(|| Range::between(x.lo() / y.hi(), x.hi() / y.lo())),
        }
        /// The remainder is 0 if the divisor is 0, or if the quotient overflows. Otherwise it has the sign of `x`.
        RemainderI[2] true {
            exact: |x| {
                let [x, y] = signed(x);
                let harmless = if y == 0 || (x == i32::MIN && y == -1) { 1 } else { y };
                (x % harmless).cast_unsigned()
            },
        }
        RemainderU[2] false {
            exact: |[x, y]| x % if y == 0 { 1 } else { y },
            range: |[x, y]| (y.lo() > 0).then(|| Range::between(0, x.hi().min(y.hi() - 1))),
        }
        NegateI[1] true {
            exact: |[x]| x.wrapping_neg(),
            range: |[x]| Some(Range::or_full(-x.hi(), -x.lo(), true)),
        }
        AbsI[1] true = Abs {
            exact: |[x]| x.cast_signed().wrapping_abs().cast_unsigned(),
        }
        AbsU[1] false = Abs {
            exact: |[x]| x,
            range: |[x]| Some(x),
        }
        SignI[1] true = Sign {
            exact: |[x]| x.cast_signed().signum().cast_unsigned(),
            range: |[x]| Some(Range::between(x.lo().signum(), x.hi().signum())),
        }
        MinI[2] true = Min {
            exact: |x| { let [x, y] = signed(x); x.min(y).cast_unsigned() },
            range: |[x, y]| Some(Range::between(x.lo().min(y.lo()), x.hi().min(y.hi()))),
        }
        MinU[2] false = Min {
            exact: |[x, y]| x.min(y),
            range: |[x, y]| Some(Range::between(x.lo().min(y.lo()), x.hi().min(y.hi()))),
        }
        MaxI[2] true = Max {
            exact: |x| { let [x, y] = signed(x); x.max(y).cast_unsigned() },
            range: |[x, y]| Some(Range::between(x.lo().max(y.lo()), x.hi().max(y.hi()))),
        }
        MaxU[2] false = Max {
            exact: |[x, y]| x.max(y),
            range: |[x, y]| Some(Range::between(x.lo().max(y.lo()), x.hi().max(y.hi()))),
        }
        ClampI[3] true = Clamp {
            exact: |x| { let [x, low, high] = signed(x); x.max(low).min(high).cast_unsigned() },
            range: |[x, low, high]| Some(Range::between(
                x.lo().max(low.lo()).min(high.lo()),
                x.hi().max(low.hi()).min(high.hi()),
            )),
        }
        ClampU[3] false = Clamp {
            exact: |[x, low, high]| x.max(low).min(high),
            range: |[x, low, high]| Some(Range::between(
                x.lo().max(low.lo()).min(high.lo()),
                x.hi().max(low.hi()).min(high.hi()),
            )),
        }
        AndI[2] true { exact: |[x, y]| x & y }
        AndU[2] false {
            exact: |[x, y]| x & y,
            range: |[x, y]| Some(Range::between(0, x.hi().min(y.hi()))),
        }
        OrI[2] true { exact: |[x, y]| x | y }
        OrU[2] false { exact: |[x, y]| x | y }
        XorI[2] true { exact: |[x, y]| x ^ y }
        XorU[2] false { exact: |[x, y]| x ^ y }
        NotI[1] true {
            exact: |[x]| !x,
            range: |[x]| Some(Range::between(-1 - x.hi(), -1 - x.lo())),
        }
        NotU[1] false {
            exact: |[x]| !x,
            range: |[x]| {
                let last = i64::from(u32::MAX);
                Some(Range::between(last - x.hi(), last - x.lo()))
            },
        }
        /// Shifts by the lowest five bits of `by`.
        ShiftLeftI[2] true { exact: |[x, by]| x.wrapping_shl(by) }
        ShiftLeftU[2] false { exact: |[x, by]| x.wrapping_shl(by) }
        ShiftRightI[2] true { exact: |[x, by]| x.cast_signed().wrapping_shr(by).cast_unsigned() }
        ShiftRightU[2] false {
            exact: |[x, by]| x.wrapping_shr(by),
            range: |[x, by]| by.word().map(|by| Range::between(x.lo() >> (by & 31), x.hi() >> (by & 31))),
        }
        /// Keeps the bits, and reads them as the other integer type.
        ToI[1] true {
            exact: |[x]| x,
            range: |[x]| Some(Range::or_full(x.lo(), x.hi(), true)),
        }
        ToU[1] false {
            exact: |[x]| x,
            range: |[x]| Some(Range::or_full(x.lo(), x.hi(), false)),
        }
        TrailingZerosI[1] true = CountTrailingZeros { exact: |[x]| x.trailing_zeros() }
        TrailingZerosU[1] false = CountTrailingZeros { exact: |[x]| x.trailing_zeros() }
        LeadingZerosI[1] true = CountLeadingZeros { exact: |[x]| x.leading_zeros() }
        LeadingZerosU[1] false = CountLeadingZeros { exact: |[x]| x.leading_zeros() }
        OnesI[1] true = CountOneBits { exact: |[x]| x.count_ones() }
        OnesU[1] false = CountOneBits { exact: |[x]| x.count_ones() }
        ReverseI[1] true = ReverseBits { exact: |[x]| x.reverse_bits() }
        ReverseU[1] false = ReverseBits { exact: |[x]| x.reverse_bits() }
        /// The index of the lowest 1 bit. If `x` has no 1 bit, all bits of the result are 1.
        FirstTrailingI[1] true = FirstTrailingBit {
            exact: |[x]| if x == 0 { u32::MAX } else { x.trailing_zeros() },
        }
        FirstTrailingU[1] false = FirstTrailingBit {
            exact: |[x]| if x == 0 { u32::MAX } else { x.trailing_zeros() },
        }
        /// The index of the highest bit that differs from the sign bit.
        FirstLeadingI[1] true = FirstLeadingBit {
            exact: |[x]| {
                let bits = if x.cast_signed() < 0 { !x } else { x };
                if bits == 0 { u32::MAX } else { 31 - bits.leading_zeros() }
            },
        }
        FirstLeadingU[1] false = FirstLeadingBit {
            exact: |[x]| if x == 0 { u32::MAX } else { 31 - x.leading_zeros() },
        }
        ExtractI[3] true = ExtractBits {
            exact: |[x, offset, count]| {
                let (offset, count) = field(offset, count);
                if count == 0 {
                    0
                } else {
                    ((x << (32 - offset - count)).cast_signed() >> (32 - count)).cast_unsigned()
                }
            },
        }
        ExtractU[3] false = ExtractBits {
            exact: |[x, offset, count]| {
                let (offset, count) = field(offset, count);
                if count == 0 { 0 } else { (x >> offset) & (u32::MAX >> (32 - count)) }
            },
        }
        InsertI[4] true = InsertBits { exact: |x| insert(x) }
        InsertU[4] false = InsertBits { exact: |x| insert(x) }
        DotBytesI[2] true = Dot4I8Packed {
            exact: |[x, y]| {
                let products = x.to_le_bytes().into_iter().zip(y.to_le_bytes());
                products
                    .map(|(x, y)| i32::from(x.cast_signed()) * i32::from(y.cast_signed()))
                    .sum::<i32>()
                    .cast_unsigned()
            },
        }
        DotBytesU[2] false = Dot4U8Packed {
            exact: |[x, y]| {
                let products = x.to_le_bytes().into_iter().zip(y.to_le_bytes());
                products.map(|(x, y)| u32::from(x) * u32::from(y)).sum()
            },
        }
        PackBytes[4] false { exact: |x| u32::from_le_bytes(x.map(|x| x as u8)) }
        PackBytesClampI[4] false {
            exact: |x| {
                u32::from_le_bytes(signed(x).map(|x| x.clamp(-128, 127) as u8))
            },
        }
        PackBytesClampU[4] false {
            exact: |x| u32::from_le_bytes(x.map(|x| x.min(255) as u8)),
        }
        /// Byte number `y` of the word `x`, as a signed number.
        ByteI[2] true {
            exact: |[x, y]| {
                i32::from(x.to_le_bytes()[y as usize & 3].cast_signed()).cast_unsigned()
            },
        }
        ByteU[2] false { exact: |[x, y]| u32::from(x.to_le_bytes()[y as usize & 3]) }
    }
}

/// The offset and the length of a bit field, limited to the bits of a word.
#[inline(always)]
fn field(offset: u32, count: u32) -> (u32, u32) {
    let offset = offset.min(32);
    let count = count.min(32 - offset);
    // An empty field may begin at bit 32, but a shift by 32 is invalid.
    if count == 0 { (0, 0) } else { (offset, count) }
}

#[inline(always)]
fn insert([x, new, offset, count]: [u32; 4]) -> u32 {
    let (offset, count) = field(offset, count);
    if count == 0 {
        return x;
    }
    let mask = (u32::MAX >> (32 - count)) << offset;
    (x & !mask) | ((new << offset) & mask)
}

fn product(x: Range, y: Range, signed: bool) -> Range {
    // A product of two `u32` may be too large for an `i64`.
    let wide = |a: i64, b: i64| i128::from(a) * i128::from(b);
    let corners =
        [wide(x.lo(), y.lo()), wide(x.lo(), y.hi()), wide(x.hi(), y.lo()), wide(x.hi(), y.hi())];
    let fits = corners.map(|corner| i64::try_from(corner).ok());
    match fits {
        [Some(a), Some(b), Some(c), Some(d)] => {
            Range::or_full(a.min(b).min(c).min(d), a.max(b).max(c).max(d), signed)
        }
        _ => Range::full(signed),
    }
}

impl Integer {
    pub(crate) fn divides(self) -> bool {
        matches!(self, Self::DivideI | Self::DivideU | Self::RemainderI | Self::RemainderU)
    }
}
