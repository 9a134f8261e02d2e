//! Checks the entropy-coded data of a baseline JPEG without decoding pixels.
//!
//! Huffman codes resynchronise after damage, so a decoder rarely meets an invalid code: it goes on with the wrong number of blocks,
//! and everything after the damage is shifted. Here the blocks are counted: each restart interval and each scan must hold exactly
//! the blocks that the frame header states, each block at most 64 coefficients, and each mean brightness must be one of 8 bits
//! (ITU-T T.81, annexes B and F).

use crate::bits::Bits;
use crate::block::{ac_coefficients, check_dc, dc_difference};
use crate::damage::{Checked, Damage};
use crate::error::JpegError;
use crate::huffman::Table;
use crate::restart::take_restart_marker;
use crate::scan_header::ScanHeaders;
use crate::structure::{Frame, JpegStructure};

/// Checks all scans of a baseline file. Returns `None` if nothing contradicts the frame header.
pub(crate) fn check(bytes: &[u8], frame: &Frame) -> Option<Damage> {
    check_all(&mut ScanHeaders::new(bytes), frame).err()
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
    let mut headers = ScanHeaders::new(tables.unwrap_or(stream));
    if tables.is_some() {
        if check_all(&mut headers, &frame).is_err() {
            return Some(Damage::ScanHeader);
        }
        headers = headers.of_stream(stream);
    }
    check_all(&mut headers, &frame).err()
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

fn check_all(headers: &mut ScanHeaders<'_>, frame: &Frame) -> Checked<()> {
    while let Some(header) = headers.next_scan()? {
        headers.at = check_scan(headers, header, frame)?;
    }
    Ok(())
}

/// Checks one scan: its header (B.2.3) and its data. Returns the position of the marker after it.
fn check_scan(headers: &ScanHeaders<'_>, header: &[u8], frame: &Frame) -> Checked<usize> {
    let count = usize::from(*header.first().ok_or(Damage::ScanHeader)?);
    let selectors = header.get(1..1 + 2 * count).ok_or(Damage::ScanHeader)?;
    let mut components = Vec::with_capacity(count);
    let mut mcus = 0;
    for &[id, selector] in selectors.as_chunks::<2>().0 {
        let of_frame = frame
            .components
            .iter()
            .find(|component| component.id == id)
            .ok_or(Damage::ScanHeader)?;
        let (blocks, mcus_of_scan) = if count == 1 {
            (1, frame.blocks(of_frame))
        } else {
            (of_frame.h * of_frame.v, frame.mcus())
        };
        mcus = mcus_of_scan;
        let (dc, ac) = headers.tables.huffman(selector)?;
        let steps = headers.tables.quantisation(of_frame.quantisation);
        components.push(ScanComponent {
            dc,
            ac,
            blocks,
            dc_step: steps.map_or(1, |steps| i32::from(steps[0])),
            predicted: 0,
        });
    }
    let restart_interval = headers.tables.restart_interval;
    scan_data(
        headers.bytes,
        headers.at,
        &mut components,
        mcus,
        restart_interval,
    )
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
            take_restart_marker(&mut bits, restarts)?;
            restarts = (restarts + 1) % 8;
            until_restart = restart_interval;
            for component in components.iter_mut() {
                component.predicted = 0;
            }
        }
    }
    bits.end()
}

#[inline(always)]
fn block(bits: &mut Bits<'_>, component: &mut ScanComponent<'_>) -> Checked<()> {
    component.predicted += dc_difference(bits, component.dc)?;
    check_dc(component.predicted, component.dc_step)?;
    ac_coefficients(bits, component.ac, |_, _| {})
}
