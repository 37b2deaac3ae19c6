//! Checks the compressed data of a chunk before the `exr` crate decompresses the chunk.

use super::block::Block;
use super::header::{PartHeader, Sample};

/// Checks the lengths at the beginning of a DWA chunk. The codec reserves as much memory as these lengths state, even
/// if the chunk is shorter.
pub(super) fn check_dwa(data: &[u8], part: &PartHeader, block: Block) -> Result<(), String> {
    let pixels = block.bytes(part);
    let counter = |index: usize| {
        let bytes = data.get(index * 8..index * 8 + 8)?.try_into().ok()?;
        usize::try_from(u64::from_le_bytes(bytes)).ok()
    };
    let squares = block.width.div_ceil(8) * block.height.div_ceil(8) * part.channels.len();
    let most = [
        (1, pixels),         // the data of channels that are only deflated
        (6, 2 * pixels + 2), // the runs; in the worst case, each 127 bytes need one more
        (7, pixels),         // the data of channels that are stored as runs
        (8, squares * 64),   // coefficients
        (9, squares),        // means
    ];
    for (index, most) in most {
        if counter(index).is_none_or(|count| count > most) {
            return Err("a length in the chunk is too large".to_owned());
        }
    }
    Ok(())
}

/// Checks the values in a B44 chunk, which are stored as differences. If a decoded value is below zero, the codec
/// panics in a build with overflow checks, and returns wrong values in a build without these checks.
pub(super) fn check_b44(data: &[u8], part: &PartHeader, block: Block) -> Result<(), String> {
    let mut rest = data;
    let squares = block.width.div_ceil(4) * block.height.div_ceil(4);
    for channel in &part.channels {
        let (lengths, length) = match channel.sample {
            Sample::Half => (squares, None),
            Sample::Uint | Sample::Float => (1, Some(block.width * block.height * 4)),
        };
        for _ in 0..lengths {
            // A shift of 13 or more marks a square in which all values are equal.
            let uniform = rest.get(2).is_some_and(|byte| byte >> 2 >= 13);
            let length = length.unwrap_or(if uniform { 3 } else { 14 });
            let (taken, left) =
                rest.split_at_checked(length).ok_or("the chunk has too little data")?;
            rest = left;
            if taken.try_into().is_ok_and(leads_below_zero) && channel.sample == Sample::Half {
                return Err("the chunk's differences overflow".to_owned());
            }
        }
    }
    Ok(())
}

/// Checks if a decoded value in a square of 4 by 4 values is below zero. The compressed square consists of the first
/// value (16 bits), a shift (6 bits), and 15 differences (6 bits each). In the first column, a difference is relative
/// to the value above. In all other columns, it is relative to the value on the left.
fn leads_below_zero(square: &[u8; 14]) -> bool {
    let field = |bit: usize| {
        let two = u16::from_be_bytes([square[bit / 8], *square.get(bit / 8 + 1).unwrap_or(&0)]);
        i64::from(two >> (10 - bit % 8) & 0x3f)
    };
    let shift = square[2] >> 2;
    let mut values = [0_i64; 16];
    values[0] = i64::from(u16::from_be_bytes([square[0], square[1]]));
    let column = [(4, 0), (8, 4), (12, 8)];
    let steps = (1..4).flat_map(|x| [0, 4, 8, 12].map(|y| (y + x, y + x - 1)));
    for (number, (to, from)) in column.into_iter().chain(steps).enumerate() {
        let value = values[from] + ((field(22 + 6 * number) - 32) << shift);
        if value < 0 {
            return true;
        }
        values[to] = value & 0xffff;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::leads_below_zero;

    #[test]
    fn squares_of_b44_are_followed_to_their_last_value() {
        // All differences are 0. A difference is stored plus 32, as 0b100000. A shift of 0 stands before the 15
        // differences.
        let mut square =
            [0x80, 0x00, 0x02, 0x08, 0x20, 0x82, 0x08, 0x20, 0x82, 0x08, 0x20, 0x82, 0x08, 0x20];
        assert!(!leads_below_zero(&square));
        square[..2].copy_from_slice(&[0, 0]);
        assert!(!leads_below_zero(&square), "0 isn't below zero");
        // The last difference is -1.
        square[13] = 0x1f;
        assert!(leads_below_zero(&square));
    }
}
