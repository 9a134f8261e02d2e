//! A position in the entropy-coded data with all that reading on from there needs.

use crate::bits::Bits;
use crate::damage::Checked;
use crate::reduced::layout::{Layout, McuData, Predicted};
use crate::restart::take_restart_marker;

/// Reads MCUs one after the other.
#[derive(Debug, Clone)]
pub(crate) struct Cursor<'a> {
    pub bits: Bits<'a>,
    pub predicted: Predicted,
    /// MCUs up to the next restart marker; `None` where there are no markers, or it is not known.
    pub until_restart: Option<u32>,
    /// Number of the next restart marker, 0 to 7.
    pub next_marker: u8,
}

impl<'a> Cursor<'a> {
    /// At the beginning of a scan, or behind the restart marker before the one with number `next_marker`.
    pub(crate) fn at_interval(layout: &Layout<'_>, bits: Bits<'a>, next_marker: u8) -> Self {
        Self {
            bits,
            predicted: Predicted::default(),
            until_restart: Some(layout.restart_interval).filter(|&interval| interval > 0),
            next_marker,
        }
    }

    /// Goes behind a restart marker, if one is due before the next MCU.
    pub(crate) fn take_due_marker(&mut self, layout: &Layout<'_>) -> Checked<()> {
        if self.until_restart == Some(0) {
            take_restart_marker(&mut self.bits, self.next_marker)?;
            self.next_marker = (self.next_marker + 1) % 8;
            self.until_restart = Some(layout.restart_interval);
            self.predicted = Predicted::default();
        }
        Ok(())
    }

    /// Reads an MCU, before which no marker is due.
    #[inline]
    pub(crate) fn read_mcu(&mut self, layout: &Layout<'_>, data: &mut McuData) -> Checked<()> {
        layout.read_mcu(&mut self.bits, &mut self.predicted, data)?;
        if let Some(until_restart) = &mut self.until_restart {
            *until_restart = until_restart.saturating_sub(1);
        }
        Ok(())
    }
}
