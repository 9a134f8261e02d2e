//! The bits of the entropy-coded data of a JPEG.

use crate::damage::{Checked, Damage};

/// Bytes after the last block of a scan or restart interval that are tolerated: some encoders align their output to 16 bits.
const MAX_PADDING_BITS: u32 = 7 + 16;

/// A position in a file: the offset of a byte, and how many of its bits are before the position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct BitPosition(u64);

impl BitPosition {
    /// The byte that the position is in.
    pub(crate) fn byte(self) -> usize {
        (self.0 >> 3) as usize
    }
}

/// The bits of a scan, without stuffed bytes, up to the next marker.
#[derive(Debug, Clone)]
pub(crate) struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The next bits, the first one topmost; zero behind `count`.
    pub(crate) window: u64,
    /// Bits in `window`.
    pub(crate) count: u32,
    at_marker: bool,
}

impl<'a> Bits<'a> {
    pub(crate) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self {
            bytes,
            at,
            window: 0,
            count: 0,
            at_marker: false,
        }
    }

    /// The bits behind a position that [`Bits::position`] told.
    pub(crate) fn at_position(bytes: &'a [u8], position: BitPosition) -> Self {
        let mut bits = Self::new(bytes, position.byte());
        bits.refill();
        let before = (position.0 & 7) as u32;
        // A position within a byte has that byte behind it.
        bits.window <<= before;
        bits.count = bits.count.saturating_sub(before);
        bits
    }

    /// The file.
    pub(crate) fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The offset of the first byte that was not read yet: of a marker, if only padding may be left.
    pub(crate) fn read_to(&self) -> usize {
        self.at
    }

    /// Where the next bit is in the file.
    pub(crate) fn position(&self) -> BitPosition {
        let mut byte = self.at;
        for _ in 0..self.count.div_ceil(8) {
            let is_stuffed = byte >= 2 && self.bytes.get(byte - 2..byte) == Some(&[0xFF, 0]);
            byte = byte.saturating_sub(if is_stuffed { 2 } else { 1 });
        }
        let before = (8 - self.count % 8) % 8;
        BitPosition((byte as u64) << 3 | u64::from(before))
    }

    /// Fills the window to 56 bits at least, as far as there are data.
    #[inline(always)]
    pub(crate) fn refill(&mut self) {
        if self.count > 55 || self.at_marker {
            return;
        }
        if let Some(next) = self
            .bytes
            .get(self.at..)
            .and_then(|rest| rest.first_chunk::<8>())
        {
            let next = u64::from_be_bytes(*next);
            if !has_ff(next) {
                let whole = (64 - self.count) / 8;
                // Bits behind the last whole byte are cut off, so that the window is zero behind `count`.
                let kept = next & (u64::MAX << (64 - 8 * whole));
                self.window |= kept >> self.count;
                self.count += 8 * whole;
                self.at += whole as usize;
                return;
            }
        }
        self.refill_bytewise();
    }

    #[cold]
    fn refill_bytewise(&mut self) {
        while self.count <= 56 {
            let Some(&byte) = self.bytes.get(self.at) else {
                self.at_marker = true;
                return;
            };
            if byte == 0xFF {
                if self.bytes.get(self.at + 1) != Some(&0) {
                    self.at_marker = true;
                    return;
                }
                self.at += 1;
            }
            self.at += 1;
            self.window |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// Drops bits; an error if there are not so many.
    #[inline(always)]
    pub(crate) fn skip(&mut self, bits: u32) -> Checked<()> {
        if bits > self.count {
            return Err(Damage::TooShort);
        }
        self.window <<= bits;
        self.count -= bits;
        Ok(())
    }

    /// The position of the marker behind the data, of which only padding may be left.
    pub(crate) fn end(&mut self) -> Checked<usize> {
        while !self.at_marker {
            if self.count > MAX_PADDING_BITS {
                return Err(Damage::TooLong);
            }
            self.refill();
        }
        if self.count > MAX_PADDING_BITS {
            return Err(Damage::TooLong);
        }
        Ok(self.at)
    }
}

/// Whether a byte is 0xFF (S. E. Anderson, Bit Twiddling Hacks, "Determine if a word has a zero byte", on the complement).
#[inline(always)]
fn has_ff(word: u64) -> bool {
    let inverse = !word;
    inverse.wrapping_sub(0x0101_0101_0101_0101) & word & 0x8080_8080_8080_8080 != 0
}
