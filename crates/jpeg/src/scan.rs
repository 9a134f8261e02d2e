//! Checks the entropy-coded data of a baseline JPEG without decoding pixels.
//!
//! Huffman codes resynchronise after damage, so a decoder rarely meets an invalid code: it goes on with the wrong number of blocks,
//! and everything after the damage is shifted. Here the blocks are counted: each restart interval and each scan must hold exactly
//! the blocks that the frame header states, each block at most 64 coefficients, and each mean brightness must be one of 8 bits
//! (ITU-T T.81, annexes B and F).

use crate::bits::Bits;
use crate::damage::{Checked, Damage};
use crate::error::JpegError;
use crate::huffman::{END_OF_BLOCK, Table};
use crate::structure::{Frame, JpegStructure};

/// Bound on a dequantised DC coefficient: eight times the samples' range of -128 to 127, and an eighth more for inexact encoders.
const MAX_DC: i32 = 1024 * 9 / 8;

/// Checks all scans of a baseline file. Returns `None` if nothing contradicts the frame header.
pub(crate) fn check(bytes: &[u8], frame: &Frame) -> Option<Damage> {
    Checker::new(bytes, frame).run().err()
}

/// Checks the scans of a stream whose tables may be in another one, as those of a TIFF's tiles are in its tag `JPEGTables` (TIFF
/// Technical Note 2), and finds what contradicts its frame header. Progressive streams and those of more than 8 bits are not checked.
#[must_use]
pub fn check_scans(tables: Option<&[u8]>, stream: &[u8]) -> Option<Damage> {
    let frame = match JpegStructure::read(stream) {
        Ok(structure) => structure.frame,
        Err(JpegError::Unsupported(_)) => return None,
        Err(_) => return Some(Damage::ScanHeader),
    };
    if frame.is_progressive {
        return None;
    }
    let mut checker = Checker::new(tables.unwrap_or(stream), &frame);
    let tables_are_read = tables.is_none() || checker.run().is_ok();
    checker.bytes = stream;
    checker.at = 2;
    let result = if tables_are_read {
        checker.run()
    } else {
        Err(Damage::ScanHeader)
    };
    result.err()
}

struct Checker<'a> {
    bytes: &'a [u8],
    at: usize,
    frame: &'a Frame,
    dc_tables: [Option<Box<Table>>; 4],
    ac_tables: [Option<Box<Table>>; 4],
    /// First entry of each quantisation table.
    dc_steps: [i32; 4],
    restart_interval: u32,
}

/// One component of a scan.
struct ScanComponent<'t> {
    dc: &'t Table,
    ac: &'t Table,
    /// Blocks in an MCU.
    blocks: u32,
    dc_step: i32,
    predicted: i32,
}

impl<'a> Checker<'a> {
    fn new(bytes: &'a [u8], frame: &'a Frame) -> Self {
        Self {
            bytes,
            at: 2,
            frame,
            dc_tables: Default::default(),
            ac_tables: Default::default(),
            dc_steps: [1; 4],
            restart_interval: 0,
        }
    }

    fn run(&mut self) -> Checked<()> {
        loop {
            match self.next_marker()? {
                0xD9 => return Ok(()),
                0x01 | 0xD0..=0xD8 => {}
                0xDA => {
                    let header = self.segment()?;
                    self.scan(header)?;
                }
                marker => {
                    let body = self.segment()?;
                    match marker {
                        0xC4 => self.take_huffman_tables(body)?,
                        0xDB => self.take_quantisation_tables(body)?,
                        0xDD => {
                            self.restart_interval =
                                u32::from(u16_at(body, 0).ok_or(Damage::ScanHeader)?);
                        }
                        _ => {}
                    }
                }
            }
        }
    }

    /// The next marker; fill bytes before it are skipped.
    fn next_marker(&mut self) -> Checked<u8> {
        if self.bytes.get(self.at) != Some(&0xFF) {
            return Err(Damage::ScanHeader);
        }
        while self.bytes.get(self.at) == Some(&0xFF) {
            self.at += 1;
        }
        let marker = *self.bytes.get(self.at).ok_or(Damage::TooShort)?;
        self.at += 1;
        Ok(marker)
    }

    /// The body of a segment.
    fn segment(&mut self) -> Checked<&'a [u8]> {
        let length = usize::from(u16_at(self.bytes, self.at).ok_or(Damage::ScanHeader)?);
        let body = self
            .bytes
            .get(self.at + 2..self.at + length)
            .ok_or(Damage::ScanHeader)?;
        self.at += length;
        Ok(body)
    }

    /// DHT (B.2.4.2).
    fn take_huffman_tables(&mut self, mut body: &[u8]) -> Checked<()> {
        while let Some((&head, rest)) = body.split_first() {
            let (counts, rest) = rest.split_first_chunk::<16>().ok_or(Damage::ScanHeader)?;
            let count: usize = counts.iter().map(|&n| usize::from(n)).sum();
            let symbols = rest.get(..count).ok_or(Damage::ScanHeader)?;
            let class = head >> 4;
            let table = Table::new(counts, symbols, class == 1).ok_or(Damage::ScanHeader)?;
            let tables = match class {
                0 => &mut self.dc_tables,
                _ => &mut self.ac_tables,
            };
            tables[usize::from(head & 3)] = Some(Box::new(table));
            body = &rest[count..];
        }
        Ok(())
    }

    /// DQT (B.2.4.1).
    fn take_quantisation_tables(&mut self, mut body: &[u8]) -> Checked<()> {
        while let Some((&head, rest)) = body.split_first() {
            let (step, length) = match head >> 4 {
                0 => (rest.first().map(|&step| u16::from(step)), 64),
                _ => (u16_at(rest, 0), 128),
            };
            self.dc_steps[usize::from(head & 3)] = i32::from(step.ok_or(Damage::ScanHeader)?);
            body = rest.get(length..).ok_or(Damage::ScanHeader)?;
        }
        Ok(())
    }

    /// One scan: its header (B.2.3) and its data. Afterwards `at` is that of the next marker.
    fn scan(&mut self, header: &[u8]) -> Checked<()> {
        let count = usize::from(*header.first().ok_or(Damage::ScanHeader)?);
        let selectors = header.get(1..1 + 2 * count).ok_or(Damage::ScanHeader)?;
        let (dc_tables, ac_tables) = (&self.dc_tables, &self.ac_tables);
        let mut components = Vec::with_capacity(count);
        let mut mcus = 0;
        for &[id, tables] in selectors.as_chunks::<2>().0 {
            let of_frame = self
                .frame
                .components
                .iter()
                .find(|component| component.id == id)
                .ok_or(Damage::ScanHeader)?;
            let (blocks, mcus_of_scan) = if count == 1 {
                (1, self.frame.blocks(of_frame))
            } else {
                (of_frame.h * of_frame.v, self.frame.mcus())
            };
            mcus = mcus_of_scan;
            components.push(ScanComponent {
                dc: dc_tables[usize::from((tables >> 4) & 3)]
                    .as_deref()
                    .ok_or(Damage::ScanHeader)?,
                ac: ac_tables[usize::from(tables & 3)]
                    .as_deref()
                    .ok_or(Damage::ScanHeader)?,
                blocks,
                dc_step: self.dc_steps[usize::from(of_frame.quantisation & 3)],
                predicted: 0,
            });
        }
        self.at = scan_data(
            self.bytes,
            self.at,
            &mut components,
            mcus,
            self.restart_interval,
        )?;
        Ok(())
    }
}

/// Follows the data of a scan from `at`. Returns the position of the marker after it.
fn scan_data(
    bytes: &[u8],
    at: usize,
    components: &mut [ScanComponent<'_>],
    mcus: u64,
    restart_interval: u32,
) -> Checked<usize> {
    let mut bits = Bits::new(bytes, at);
    let mut until_restart = restart_interval;
    let mut restarts = 0u8;
    for mcu in 0..mcus {
        for component in components.iter_mut() {
            for _ in 0..component.blocks {
                block(&mut bits, component)?;
            }
        }
        if restart_interval == 0 {
            continue;
        }
        until_restart -= 1;
        if until_restart == 0 && mcu + 1 < mcus {
            let at = bits.end()?;
            if marker_at(bytes, at) != Some(0xD0 + restarts) {
                return Err(Damage::RestartMarker);
            }
            bits = Bits::new(bytes, skip_marker(bytes, at));
            restarts = (restarts + 1) % 8;
            until_restart = restart_interval;
            for component in components.iter_mut() {
                component.predicted = 0;
            }
        }
    }
    bits.end()
}

/// The marker at a position, behind fill bytes.
fn marker_at(bytes: &[u8], at: usize) -> Option<u8> {
    let rest = bytes.get(at..)?;
    let fill = rest.iter().take_while(|&&byte| byte == 0xFF).count();
    (fill > 0).then(|| rest.get(fill).copied()).flatten()
}

fn skip_marker(bytes: &[u8], mut at: usize) -> usize {
    while bytes.get(at) == Some(&0xFF) {
        at += 1;
    }
    at + 1
}

/// One block (F.2.2): the DC difference, then coefficients up to the end of the block.
#[inline(always)]
fn block(bits: &mut Bits<'_>, component: &mut ScanComponent<'_>) -> Checked<()> {
    bits.refill();
    let entry = component.dc.find(bits.window)?;
    let (code_bits, size) = (u32::from(entry & 31), u32::from(entry >> 5));
    bits.skip(code_bits)?;
    if size > 0 {
        let value = (bits.window >> (64 - size)) as i32;
        // EXTEND (F.2.2.1).
        let half = 1 << (size - 1);
        component.predicted += if value < half {
            value - 2 * half + 1
        } else {
            value
        };
        bits.skip(size)?;
    }
    if component.predicted.saturating_mul(component.dc_step).abs() > MAX_DC + component.dc_step {
        return Err(Damage::BrightnessOutOfRange);
    }
    let mut next = 1;
    while next < 64 {
        if bits.count < 32 {
            bits.refill();
        }
        let entry = component.ac.find(bits.window)?;
        bits.skip(u32::from(entry & 31))?;
        let advance = entry >> 5;
        if advance == END_OF_BLOCK {
            return Ok(());
        }
        next += advance;
    }
    if next > 64 {
        return Err(Damage::TooManyCoefficients);
    }
    Ok(())
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    let two = bytes.get(at..)?.first_chunk::<2>()?;
    Some(u16::from_be_bytes(*two))
}
