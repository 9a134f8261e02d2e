//! Goes through the segments of a baseline JPEG from scan to scan.

use crate::damage::{Checked, Damage};
use crate::tables::{Tables, u16_at};

/// The headers of a file's scans, one after the other, and the tables that hold for each.
pub(crate) struct ScanHeaders<'a> {
    pub(crate) bytes: &'a [u8],
    /// Behind a header: where the scan's data begin. The caller sets it to the marker behind them.
    pub(crate) at: usize,
    pub(crate) tables: Tables,
}

impl<'a> ScanHeaders<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            at: 2,
            tables: Tables::default(),
        }
    }

    /// Those of another stream, for which the tables read so far hold.
    pub(crate) fn of_stream<'b>(self, bytes: &'b [u8]) -> ScanHeaders<'b> {
        ScanHeaders {
            bytes,
            at: 2,
            tables: self.tables,
        }
    }

    /// The body of the next scan's header; `None` at the end-of-image marker.
    pub(crate) fn next_scan(&mut self) -> Checked<Option<&'a [u8]>> {
        loop {
            match self.next_marker()? {
                0xD9 => return Ok(None),
                0x01 | 0xD0..=0xD8 => {}
                0xDA => return self.segment().map(Some),
                marker => {
                    let body = self.segment()?;
                    self.tables.take(marker, body)?;
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
}
