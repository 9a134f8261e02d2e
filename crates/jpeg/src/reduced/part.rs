//! Parts of a scan that are read side by side.
//!
//! Huffman codes resynchronise: a reader that begins anywhere soon meets the codes' true boundaries, and from an MCU that begins where
//! one truly begins it reads what a reader from the scan's beginning does (Klein and Wiseman, Parallel Huffman Decoding with
//! Applications to JPEG Files, 2003). Only its DC coefficients differ, by a constant. [`join`](crate::reduced::join) finds that MCU.

use std::ops::Range;

use rayon::prelude::*;

use crate::bits::{BitPosition, Bits};
use crate::reduced::cursor::Cursor;
use crate::reduced::layout::{Layout, McuData, Predicted};
use crate::restart::marker_at;

/// Fewest bytes of a part that is worth a thread.
const MIN_PART_BYTES: usize = 64 << 10;
/// Most parts of a scan: each may hold MCUs that are read in vain.
const MAX_PARTS: usize = 4;

/// MCUs that were read one after the other.
#[derive(Debug)]
pub(crate) struct Part<'a> {
    /// Where each begins.
    pub starts: Vec<BitPosition>,
    pub data: McuData,
    /// Behind the last one.
    pub end: Cursor<'a>,
    /// Number of the restart marker after the first interval; `None` if the part begins anywhere, so that it is not known.
    first_marker: Option<u8>,
}

impl<'a> Part<'a> {
    pub(crate) fn new(cursor: Cursor<'a>, is_at_interval: bool) -> Self {
        Self {
            starts: Vec::new(),
            data: McuData::default(),
            first_marker: is_at_interval.then_some(cursor.next_marker),
            end: cursor,
        }
    }

    /// Number of MCUs.
    pub(crate) fn len(&self) -> usize {
        self.starts.len()
    }

    /// The DC coefficients from which those of the MCU at `index` differ, in this part.
    pub(crate) fn predicted_before(&self, index: usize, layout: &Layout<'_>) -> Predicted {
        let mut predicted = Predicted::default();
        let begins_interval = self.first_marker.is_some()
            && index.checked_rem(layout.restart_interval as usize) == Some(0);
        if index == 0 || begins_interval {
            return predicted;
        }
        let mut block = (index - 1) * layout.blocks_of_mcu;
        for (component, predicted) in layout.components.iter().zip(&mut predicted) {
            block += component.blocks.0 * component.blocks.1;
            *predicted = self.data.dcs.get(block - 1).copied().unwrap_or_default();
        }
        predicted
    }

    /// What is added to this part's DC coefficients if `cursor`, which is where the MCU at `index` begins, goes on with it; `None`
    /// if it counts restart intervals otherwise.
    pub(crate) fn dc_offset(
        &self,
        index: usize,
        cursor: &Cursor<'_>,
        layout: &Layout<'_>,
    ) -> Option<Predicted> {
        let before = self.predicted_before(index, layout);
        let offset = std::array::from_fn(|c| cursor.predicted[c].wrapping_sub(before[c]));
        let interval = layout.restart_interval as usize;
        let Some(first_marker) = self.first_marker.filter(|_| interval > 0) else {
            return Some(offset);
        };
        let until_restart = (interval - index % interval) as u32;
        let next_marker = (usize::from(first_marker) + index / interval) % 8;
        let is_same = cursor.until_restart == Some(until_restart)
            && usize::from(cursor.next_marker) == next_marker
            && offset == Predicted::default();
        is_same.then_some(offset)
    }

    /// Whether the part was read without knowing where restart markers are due.
    pub(crate) fn begins_anywhere(&self) -> bool {
        self.first_marker.is_none()
    }

    /// Reads up to the byte `until`, to `max` MCUs, or to damage, for which the offset of the first byte that was not read is
    /// returned.
    fn read(&mut self, layout: &Layout<'_>, until: usize, max: usize) -> Option<usize> {
        while self.len() < max && self.end.bits.read_to() < until {
            let mut cursor = self.end.clone();
            let start = match cursor.take_due_marker(layout) {
                Ok(()) => cursor.bits.position(),
                Err(_) => return Some(cursor.bits.read_to()),
            };
            if cursor.read_mcu(layout, &mut self.data).is_err() {
                return Some(cursor.bits.read_to());
            }
            self.starts.push(start);
            self.end = cursor;
        }
        None
    }

    fn reserve(&mut self, layout: &Layout<'_>, mcus: usize) {
        self.starts.reserve_exact(mcus);
        self.data.dcs.reserve_exact(mcus * layout.blocks_of_mcu);
        self.data
            .samples
            .reserve_exact(mcus * layout.samples_of_mcu);
    }
}

/// The number of parts in which a file is read: one for each thread, if each is worth it.
pub(crate) fn part_count(bytes: &[u8]) -> usize {
    let threads = rayon::current_num_threads().min(MAX_PARTS);
    (bytes.len() / MIN_PART_BYTES).clamp(1, threads)
}

/// Reads a scan from `at` in `count` parts. The first begins there.
pub(crate) fn read_parts<'a>(
    layout: &Layout<'_>,
    bytes: &'a [u8],
    at: usize,
    count: usize,
) -> Vec<Part<'a>> {
    let length = bytes.len().saturating_sub(at);
    let bound = |index: usize| at + length * index / count;
    // So many more than its share of MCUs may a part have: a plain sky takes few bytes.
    let max = if count == 1 {
        layout.mcus
    } else {
        (3 * layout.mcus).div_ceil(2 * count)
    };
    let read = |index: usize| {
        let range = bound(index)..bound(index + 1);
        if index == 0 {
            let cursor = Cursor::at_interval(layout, Bits::new(bytes, at), 0);
            let mut part = Part::new(cursor, true);
            part.reserve(layout, max);
            part.read(layout, range.end, max);
            vec![part]
        } else {
            parts_within(layout, bytes, range, max)
        }
    };
    let parts: Vec<Vec<Part<'_>>> = (0..count).into_par_iter().map(read).collect();
    parts.into_iter().flatten().collect()
}

/// Parts that begin within a range of bytes of the scan's data.
fn parts_within<'a>(
    layout: &Layout<'_>,
    bytes: &'a [u8],
    range: Range<usize>,
    max: usize,
) -> Vec<Part<'a>> {
    let mut parts = Vec::new();
    let mut left = max;
    let mut begin = range.start;
    if layout.restart_interval > 0 {
        let window = begin..begin + range.len() / 8;
        if let Some(mut part) = behind_marker_in(layout, bytes, window) {
            part.reserve(layout, left);
            parts.push(part);
        }
    }
    if parts.is_empty() {
        // The second byte of a stuffed 0xFF is no data.
        let is_stuffed = bytes.get(begin.wrapping_sub(1)) == Some(&0xFF);
        begin += usize::from(is_stuffed);
        let cursor = |begin| Cursor {
            bits: Bits::new(bytes, begin),
            predicted: Predicted::default(),
            until_restart: None,
            next_marker: 0,
        };
        let mut part = Part::new(cursor(begin), false);
        part.reserve(layout, left);
        while let Some(stopped) = part.read(layout, range.end, left) {
            let marker = marker_at(bytes, stopped);
            if let Some((marker @ 0xD0..=0xD7, behind)) = marker {
                left -= part.len().min(left);
                let next_marker = (marker - 0xD0 + 1) % 8;
                let cursor = Cursor::at_interval(layout, Bits::new(bytes, behind), next_marker);
                parts.push(std::mem::replace(&mut part, Part::new(cursor, true)));
                break;
            }
            if stopped >= range.end || marker.is_some_and(|(marker, _)| marker != 0) {
                break;
            }
            // Not in step with the codes yet.
            begin = stopped.max(begin + 1);
            part.starts.clear();
            part.data.samples.clear();
            part.data.dcs.clear();
            part.end = cursor(begin);
        }
        parts.push(part);
    }
    if let Some(last) = parts.last_mut().filter(|last| !last.begins_anywhere()) {
        last.read(layout, range.end, left);
    }
    parts
}

/// An empty part behind the first restart marker in a range of bytes.
fn behind_marker_in<'a>(
    layout: &Layout<'_>,
    bytes: &'a [u8],
    range: Range<usize>,
) -> Option<Part<'a>> {
    let searched = bytes.get(range.clone())?;
    let is_marker = |pair: &[u8]| pair[0] == 0xFF && matches!(pair[1], 0xD0..=0xD7);
    let at = range.start + searched.windows(2).position(is_marker)?;
    let (marker, behind) = marker_at(bytes, at)?;
    let next_marker = (marker.wrapping_sub(0xD0) + 1) % 8;
    let cursor = Cursor::at_interval(layout, Bits::new(bytes, behind), next_marker);
    Some(Part::new(cursor, true))
}
