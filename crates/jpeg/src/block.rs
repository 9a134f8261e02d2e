//! The coefficients of one block of entropy-coded data (ITU-T T.81, F.2.2).

use crate::bits::Bits;
use crate::damage::{Checked, Damage};
use crate::huffman::{END_OF_BLOCK, Table};

/// Bound on a dequantised DC coefficient: eight times the samples' range of -128 to 127, and an eighth more for inexact encoders.
const MAX_DC: i32 = 1024 * 9 / 8;

/// Reads the difference of a block's DC coefficient from that of the block before.
#[inline(always)]
pub(crate) fn dc_difference(bits: &mut Bits<'_>, table: &Table) -> Checked<i32> {
    bits.refill();
    let code = table.find(bits.window)?;
    let value = code.value(bits.window);
    bits.skip(code.all_bits())?;
    Ok(value)
}

/// Reads the AC coefficients of a block up to its end: `take` gets each one's index in zigzag order, 1 to 63, and its value.
#[inline(always)]
pub(crate) fn ac_coefficients(
    bits: &mut Bits<'_>,
    table: &Table,
    mut take: impl FnMut(usize, i32),
) -> Checked<()> {
    let mut next = 1;
    while next < 64 {
        if bits.count < 32 {
            bits.refill();
        }
        let code = table.find(bits.window)?;
        let value = code.value(bits.window);
        bits.skip(code.all_bits())?;
        if code.advance() == END_OF_BLOCK {
            return Ok(());
        }
        next += code.advance() as usize;
        if next > 64 {
            return Err(Damage::TooManyCoefficients);
        }
        take(next - 1, value);
    }
    Ok(())
}

/// An error if a DC coefficient is beyond what samples of 8 bits have.
#[inline(always)]
pub(crate) fn check_dc(dc: i32, step: i32) -> Checked<()> {
    if dc.saturating_mul(step).saturating_abs() > MAX_DC + step {
        return Err(Damage::BrightnessOutOfRange);
    }
    Ok(())
}
