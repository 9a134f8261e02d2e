//! Huffman tables of a baseline JPEG (ITU-T T.81, annex C), as what each code does.

use crate::damage::{Checked, Damage};

/// Bits of a code that are looked up at once; longer codes are searched.
const LOOKUP_BITS: u32 = 10;

/// What an end-of-block code advances by.
pub(crate) const END_OF_BLOCK: u32 = 127;

/// What a code does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Code(u32);

impl Code {
    const INVALID: Self = Self(0);

    const fn new(all_bits: u32, value_bits: u32, advance: u32) -> Self {
        Self(all_bits | value_bits << 5 | advance << 9)
    }

    /// Bits of the code and of the value behind it.
    #[inline(always)]
    pub(crate) fn all_bits(self) -> u32 {
        self.0 & 31
    }

    /// Bits of the value behind the code.
    #[inline(always)]
    pub(crate) fn value_bits(self) -> u32 {
        self.0 >> 5 & 15
    }

    /// By how many coefficients an AC code advances.
    #[inline(always)]
    pub(crate) fn advance(self) -> u32 {
        self.0 >> 9
    }

    /// The value behind this code at the top of `window` (EXTEND, F.2.2.1); 0 if it has none.
    #[inline(always)]
    pub(crate) fn value(self, window: u64) -> i32 {
        let size = self.value_bits();
        let behind_code = window << (self.all_bits() - size);
        // Two shifts, as none may be by 64.
        let bits = (behind_code >> 1 >> (63 - size)) as i32;
        // The topmost bit of a value is 1 if it is positive.
        let negative = !(behind_code as i64 >> 63) as i32;
        bits + (negative & (1 - (1 << size)))
    }
}

/// A Huffman table.
pub(crate) struct Table {
    lookup: [Code; 1 << LOOKUP_BITS],
    /// Codes longer than [`LOOKUP_BITS`]: the code's last 16-bit value, and what it does; ascending.
    long: Vec<(u16, Code)>,
    /// First 16-bit value of the long codes.
    first_long: u32,
}

impl Table {
    /// The table with this many codes of each length and these symbols; `None` if no such code exists (annex C).
    pub(crate) fn new(counts: &[u8; 16], symbols: &[u8], is_ac: bool) -> Option<Self> {
        let mut table = Self {
            lookup: [Code::INVALID; 1 << LOOKUP_BITS],
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
                let does = code_of_symbol(symbol, length, is_ac);
                if length <= LOOKUP_BITS {
                    let shift = LOOKUP_BITS - length;
                    let first = (code << shift) as usize;
                    table.lookup[first..first + (1 << shift)].fill(does);
                } else {
                    let shift = 16 - length;
                    table.first_long = table.first_long.min(code << shift);
                    let last = ((code + 1) << shift) - 1;
                    table.long.push((last as u16, does));
                }
                code += 1;
            }
            code <<= 1;
        }
        Some(table)
    }

    /// What the code at the top of `window` does.
    #[inline(always)]
    pub(crate) fn find(&self, window: u64) -> Checked<Code> {
        match self.lookup[(window >> (64 - LOOKUP_BITS)) as usize] {
            Code::INVALID => self.find_long((window >> 48) as u16),
            code => Ok(code),
        }
    }

    #[cold]
    fn find_long(&self, code: u16) -> Checked<Code> {
        if u32::from(code) < self.first_long {
            return Err(Damage::HuffmanCode);
        }
        let at = self.long.partition_point(|&(last, _)| last < code);
        match self.long.get(at) {
            Some(&(_, found)) if found != Code::INVALID => Ok(found),
            _ => Err(Damage::HuffmanCode),
        }
    }
}

/// What a code of `length` bits for `symbol` does; invalid if baseline files have no such symbol.
fn code_of_symbol(symbol: u8, length: u32, is_ac: bool) -> Code {
    if !is_ac {
        // 8-bit samples have differences of up to 11 bits.
        return if symbol > 11 {
            Code::INVALID
        } else {
            Code::new(length + u32::from(symbol), u32::from(symbol), 1)
        };
    }
    let (run, size) = (u32::from(symbol >> 4), u32::from(symbol & 15));
    match (run, size) {
        (0, 0) => Code::new(length, 0, END_OF_BLOCK),
        (15, 0) => Code::new(length, 0, 16),
        (_, 0) => Code::INVALID,
        _ => Code::new(length + size, size, run + 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_follow_their_codes() {
        // Table F.1 of T.81: a value of 3 bits is -7 to -4 or 4 to 7; the code itself has two bits here.
        let code = Code::new(5, 3, 1);
        let expected = [-7, -6, -5, -4, 4, 5, 6, 7];
        for (bits, value) in (0u64..).zip(expected) {
            assert_eq!(code.value((0b01 << 62) | bits << 59 | 0x1234), value);
        }
        assert_eq!(Code::new(4, 0, END_OF_BLOCK).value(u64::MAX), 0);
        assert_eq!(Code::new(17, 15, 1).value(u64::MAX), 32767);
        assert_eq!(Code::new(31, 15, 1).value(0), -32767);
    }

    #[test]
    fn more_codes_than_bits_allow_are_no_table() {
        let mut counts = [0; 16];
        counts[0] = 3;
        assert!(Table::new(&counts, &[1, 2, 3], true).is_none());
    }
}
