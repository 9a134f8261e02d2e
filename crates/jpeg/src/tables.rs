//! Tables of a baseline JPEG, and the segments that define them.

use crate::damage::{Checked, Damage};
use crate::huffman::Table;

/// What an application segment (APP0) of Motion JPEG begins with. Such frames may leave out their Huffman tables, which are then the
/// standard ones (OpenDML AVI File Format Extensions 1.02, "Motion JPEG DIB Format"); many webcams leave them out.
const MOTION_JPEG: &[u8] = b"AVI1\0";

/// The standard Huffman tables as a segment (DHT) has them: DC and AC of the luminance, then of the chrominance (ITU-T T.81, tables
/// K.3, K.5, K.4 and K.6).
const STANDARD_HUFFMAN: [u8; 416] = [
    0, 0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 0,
    2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 125, 1, 2, 3, 0, 4, 17, 5, 18, 33, 49, 65, 6, 19, 81,
    97, 7, 34, 113, 20, 50, 129, 145, 161, 8, 35, 66, 177, 193, 21, 82, 209, 240, 36, 51, 98, 114,
    130, 9, 10, 22, 23, 24, 25, 26, 37, 38, 39, 40, 41, 42, 52, 53, 54, 55, 56, 57, 58, 67, 68, 69,
    70, 71, 72, 73, 74, 83, 84, 85, 86, 87, 88, 89, 90, 99, 100, 101, 102, 103, 104, 105, 106, 115,
    116, 117, 118, 119, 120, 121, 122, 131, 132, 133, 134, 135, 136, 137, 138, 146, 147, 148, 149,
    150, 151, 152, 153, 154, 162, 163, 164, 165, 166, 167, 168, 169, 170, 178, 179, 180, 181, 182,
    183, 184, 185, 186, 194, 195, 196, 197, 198, 199, 200, 201, 202, 210, 211, 212, 213, 214, 215,
    216, 217, 218, 225, 226, 227, 228, 229, 230, 231, 232, 233, 234, 241, 242, 243, 244, 245, 246,
    247, 248, 249, 250, 1, 0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7,
    8, 9, 10, 11, 17, 0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 119, 0, 1, 2, 3, 17, 4, 5, 33,
    49, 6, 18, 65, 81, 7, 97, 113, 19, 34, 50, 129, 8, 20, 66, 145, 161, 177, 193, 9, 35, 51, 82,
    240, 21, 98, 114, 209, 10, 22, 36, 52, 225, 37, 241, 23, 24, 25, 26, 38, 39, 40, 41, 42, 53,
    54, 55, 56, 57, 58, 67, 68, 69, 70, 71, 72, 73, 74, 83, 84, 85, 86, 87, 88, 89, 90, 99, 100,
    101, 102, 103, 104, 105, 106, 115, 116, 117, 118, 119, 120, 121, 122, 130, 131, 132, 133, 134,
    135, 136, 137, 138, 146, 147, 148, 149, 150, 151, 152, 153, 154, 162, 163, 164, 165, 166, 167,
    168, 169, 170, 178, 179, 180, 181, 182, 183, 184, 185, 186, 194, 195, 196, 197, 198, 199, 200,
    201, 202, 210, 211, 212, 213, 214, 215, 216, 217, 218, 226, 227, 228, 229, 230, 231, 232, 233,
    234, 242, 243, 244, 245, 246, 247, 248, 249, 250,
];

/// Huffman and quantisation tables, and the restart interval, as the segments read so far define them.
#[derive(Default)]
pub(crate) struct Tables {
    dc: [Option<Box<Table>>; 4],
    ac: [Option<Box<Table>>; 4],
    quantisation: [Option<Box<[u16; 64]>>; 4],
    /// MCUs between restart markers; 0 for no markers.
    pub(crate) restart_interval: u32,
}

impl Tables {
    /// Takes in a segment that defines tables; others are ignored.
    pub(crate) fn take(&mut self, marker: u8, body: &[u8]) -> Checked<()> {
        match marker {
            0xC4 => self.take_huffman(body)?,
            0xDB => self.take_quantisation(body)?,
            0xE0 if body.starts_with(MOTION_JPEG) => self.take_standard_huffman()?,
            0xDD => {
                let interval = u16_at(body, 0).ok_or(Damage::ScanHeader)?;
                self.restart_interval = u32::from(interval);
            }
            _ => {}
        }
        Ok(())
    }

    /// The DC and AC table that a scan header selects for a component (B.2.3).
    pub(crate) fn huffman(&self, selector: u8) -> Checked<(&Table, &Table)> {
        let dc = self.dc[usize::from((selector >> 4) & 3)].as_deref();
        let ac = self.ac[usize::from(selector & 3)].as_deref();
        dc.zip(ac).ok_or(Damage::ScanHeader)
    }

    /// Steps of the coefficients, in zigzag order.
    pub(crate) fn quantisation(&self, index: u8) -> Option<&[u16; 64]> {
        self.quantisation[usize::from(index & 3)].as_deref()
    }

    /// The standard Huffman tables in place of those that are missing.
    fn take_standard_huffman(&mut self) -> Checked<()> {
        let mut standard = Self::default();
        standard.take_huffman(&STANDARD_HUFFMAN)?;
        let dc = self.dc.iter_mut().zip(standard.dc);
        let ac = self.ac.iter_mut().zip(standard.ac);
        for (table, standard) in dc.chain(ac) {
            if table.is_none() {
                *table = standard;
            }
        }
        Ok(())
    }

    /// DHT (B.2.4.2).
    fn take_huffman(&mut self, mut body: &[u8]) -> Checked<()> {
        while let Some((&head, rest)) = body.split_first() {
            let (counts, rest) = rest.split_first_chunk::<16>().ok_or(Damage::ScanHeader)?;
            let count: usize = counts.iter().map(|&n| usize::from(n)).sum();
            let symbols = rest.get(..count).ok_or(Damage::ScanHeader)?;
            let class = head >> 4;
            let table = Table::new(counts, symbols, class == 1).ok_or(Damage::ScanHeader)?;
            let tables = match class {
                0 => &mut self.dc,
                _ => &mut self.ac,
            };
            tables[usize::from(head & 3)] = Some(Box::new(table));
            body = &rest[count..];
        }
        Ok(())
    }

    /// DQT (B.2.4.1).
    fn take_quantisation(&mut self, mut body: &[u8]) -> Checked<()> {
        while let Some((&head, rest)) = body.split_first() {
            let mut steps = Box::new([0; 64]);
            let length = if head >> 4 == 0 { 64 } else { 128 };
            let listed = rest.get(..length).ok_or(Damage::ScanHeader)?;
            for (index, step) in steps.iter_mut().enumerate() {
                *step = match length {
                    64 => u16::from(listed[index]),
                    _ => u16::from_be_bytes([listed[2 * index], listed[2 * index + 1]]),
                };
            }
            self.quantisation[usize::from(head & 3)] = Some(steps);
            body = &rest[length..];
        }
        Ok(())
    }
}

/// The number of two bytes at an offset.
pub(crate) fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    let two = bytes.get(at..)?.first_chunk::<2>()?;
    Some(u16::from_be_bytes(*two))
}
