//! Joins parts of a scan to what a reader from its beginning would have read.

use std::ops::Range;

use crate::bits::Bits;
use crate::damage::Checked;
use crate::reduced::cursor::Cursor;
use crate::reduced::layout::{Layout, Predicted};
use crate::reduced::part::Part;

/// MCUs of a part that are MCUs of the picture.
#[derive(Debug)]
pub(crate) struct Run {
    /// Index of the part.
    pub part: usize,
    /// Index of the first MCU in the part.
    pub from: usize,
    /// Index of the first MCU in the picture.
    pub first_mcu: usize,
    /// Number of MCUs.
    pub count: usize,
    /// What is added to their DC coefficients.
    pub dc_offset: Predicted,
}

/// The MCUs of a whole scan.
#[derive(Debug)]
pub(crate) struct JoinedScan<'a> {
    pub parts: Vec<Part<'a>>,
    /// In order; together they hold each MCU of the picture once.
    pub runs: Vec<Run>,
    /// Offset of the marker behind the scan.
    pub end: usize,
}

/// Joins parts that were read from a scan, the first from its beginning. MCUs between them are read here.
pub(crate) fn join<'a>(
    layout: &Layout<'_>,
    mut parts: Vec<Part<'a>>,
    start: Cursor<'a>,
) -> Checked<JoinedScan<'a>> {
    let between = parts.len();
    parts.push(Part::new(start.clone(), false));
    let mut runs: Vec<Run> = Vec::new();
    let mut cursor = start;
    let mut mcu = 0;
    let mut next_part = 0;
    while mcu < layout.mcus {
        cursor.take_due_marker(layout)?;
        let position = cursor.bits.position();
        let is_behind = |part: &Part<'_>| part.starts.last().is_none_or(|&last| last < position);
        while next_part < between && is_behind(&parts[next_part]) {
            next_part += 1;
        }
        let met = parts[next_part..between].first().and_then(|part| {
            let index = part.starts.binary_search(&position).ok()?;
            Some((part, index, part.dc_offset(index, &cursor, layout)?))
        });
        if let Some((part, index, dc_offset)) = met {
            let until_restart = cursor.until_restart.filter(|_| part.begins_anywhere());
            let count = (part.len() - index)
                .min(layout.mcus - mcu)
                .min(until_restart.map_or(usize::MAX, |count| count as usize));
            cursor = cursor_behind(layout, part, index..index + count, &cursor, dc_offset);
            runs.push(Run {
                part: next_part,
                from: index,
                first_mcu: mcu,
                count,
                dc_offset,
            });
            mcu += count;
            next_part += 1;
            continue;
        }
        let part = &mut parts[between];
        cursor.read_mcu(layout, &mut part.data)?;
        part.starts.push(position);
        let from = part.len() - 1;
        match runs.last_mut().filter(|run| run.part == between) {
            Some(run) if run.from + run.count == from => run.count += 1,
            _ => runs.push(Run {
                part: between,
                from,
                first_mcu: mcu,
                count: 1,
                dc_offset: Predicted::default(),
            }),
        }
        mcu += 1;
    }
    let end = cursor.bits.end()?;
    Ok(JoinedScan { parts, runs, end })
}

/// The cursor behind MCUs of a part that were taken over where `before` was.
fn cursor_behind<'a>(
    layout: &Layout<'_>,
    part: &Part<'a>,
    taken: Range<usize>,
    before: &Cursor<'a>,
    dc_offset: Predicted,
) -> Cursor<'a> {
    let bits = match part.starts.get(taken.end) {
        Some(&next) => Bits::at_position(before.bits.bytes(), next),
        None => part.end.bits.clone(),
    };
    let last = part.predicted_before(taken.end, layout);
    let predicted = std::array::from_fn(|c| last[c].wrapping_add(dc_offset[c]));
    // A part that counts restart intervals is taken to its end, or to that of the picture.
    let (until_restart, next_marker) = if part.begins_anywhere() {
        let count = taken.len() as u32;
        let until_restart = before.until_restart.map(|left| left.saturating_sub(count));
        (until_restart, before.next_marker)
    } else {
        (part.end.until_restart, part.end.next_marker)
    };
    Cursor {
        bits,
        predicted,
        until_restart,
        next_marker,
    }
}
