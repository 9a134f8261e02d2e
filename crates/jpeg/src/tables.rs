//! Tables of a baseline JPEG, and the segments that define them.

use crate::damage::{Checked, Damage};
use crate::huffman::Table;

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
