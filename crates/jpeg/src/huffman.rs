//! Huffman tables of a baseline JPEG (ITU-T T.81, annex C), as what each code does.

use crate::damage::{Checked, Damage};

/// Bits of a code that are looked up at once; longer codes are searched.
const LOOKUP_BITS: u32 = 10;

/// What an end-of-block code advances by.
pub(crate) const END_OF_BLOCK: u16 = 127;

/// A Huffman table as what each code does: bits 0 to 4 hold the bits to skip, the others a DC coefficient's size, or by how many
/// coefficients an AC code advances. For AC codes the skipped bits include those of the value. 0 is an invalid code.
pub(crate) struct Table {
    lookup: [u16; 1 << LOOKUP_BITS],
    /// Codes longer than [`LOOKUP_BITS`]: the code's last 16-bit value, and its entry; ascending.
    long: Vec<(u16, u16)>,
    /// First 16-bit value of the long codes.
    first_long: u32,
}

impl Table {
    /// The table with this many codes of each length and these symbols; `None` if no such code exists (annex C).
    pub(crate) fn new(counts: &[u8; 16], symbols: &[u8], is_ac: bool) -> Option<Self> {
        let mut table = Self {
            lookup: [0; 1 << LOOKUP_BITS],
            long: Vec::new(),
            first_long: 1 << 16,
        };
        let mut symbols = symbols.iter();
        let mut code = 0u32;
        for (length, &count) in (1u32..).zip(counts) {
            for &symbol in symbols.by_ref().take(usize::from(count)) {
                if code >= 1 << length {
                    return None;
                }
                let entry = entry(symbol, length, is_ac);
                if length <= LOOKUP_BITS {
                    let shift = LOOKUP_BITS - length;
                    let first = (code << shift) as usize;
                    table.lookup[first..first + (1 << shift)].fill(entry);
                } else {
                    let shift = 16 - length;
                    table.first_long = table.first_long.min(code << shift);
                    let last = ((code + 1) << shift) - 1;
                    table.long.push((last as u16, entry));
                }
                code += 1;
            }
            code <<= 1;
        }
        Some(table)
    }

    /// The entry of the code at the top of `window`.
    #[inline(always)]
    pub(crate) fn find(&self, window: u64) -> Checked<u16> {
        match self.lookup[(window >> (64 - LOOKUP_BITS)) as usize] {
            0 => self.find_long((window >> 48) as u16),
            entry => Ok(entry),
        }
    }

    #[cold]
    fn find_long(&self, code: u16) -> Checked<u16> {
        if u32::from(code) < self.first_long {
            return Err(Damage::HuffmanCode);
        }
        let at = self.long.partition_point(|&(last, _)| last < code);
        match self.long.get(at) {
            Some(&(_, entry)) if entry != 0 => Ok(entry),
            _ => Err(Damage::HuffmanCode),
        }
    }
}

/// The entry of a symbol whose code has `length` bits; 0 if baseline files have no such symbol.
fn entry(symbol: u8, length: u32, is_ac: bool) -> u16 {
    let length = length as u16;
    if !is_ac {
        // 8-bit samples have differences of up to 11 bits.
        return if symbol > 11 {
            0
        } else {
            length | u16::from(symbol) << 5
        };
    }
    let (run, size) = (u16::from(symbol >> 4), u16::from(symbol & 15));
    match (run, size) {
        (0, 0) => length | END_OF_BLOCK << 5,
        (15, 0) => length | 16 << 5,
        (_, 0) => 0,
        _ => (length + size) | (run + 1) << 5,
    }
}
