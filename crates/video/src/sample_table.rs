//! The samples of a track from its tables (`stbl`; ISO/IEC 14496-12, 8.6 and 8.7).

use crate::error::Fault;
use crate::fields::{Fields, find};
use crate::sample::{SAMPLE_MEMORY_BYTES, Sample};

/// Reads the tables; `limit` is the largest number of samples.
pub(crate) fn samples(stbl: &[u8], limit: u64) -> Result<Vec<Sample>, Fault> {
    let sizes = Sizes::read(stbl).ok_or_else(|| missing("stsz"))?;
    let count = sizes.count();
    if u64::from(count) > limit {
        return Err(Fault::TooLarge {
            what: format!("the index of {count} frames"),
            needed_bytes: u64::from(count) * SAMPLE_MEMORY_BYTES,
        });
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut places = Places::read(stbl)?;
    let mut deltas = Runs::read(find(stbl, b"stts")).ok_or_else(|| missing("stts"))?;
    let mut shifts = Runs::read(find(stbl, b"ctts"));
    let syncs = sync_numbers(stbl);
    let mut next_sync = 0;
    let mut decoded_at: i64 = 0;
    let mut samples = Vec::with_capacity(count as usize);
    for number in 0..count {
        let bytes = sizes.get(number).ok_or_else(|| missing("stsz"))?;
        // A table that ends early is that of a recording that was cut: frames up to there.
        let Some(offset) = places.next(bytes) else {
            break;
        };
        // `ctts` of version 0 should be without sign, and is written with one.
        let shift = match &mut shifts {
            Some(shifts) => shifts.next().unwrap_or(0) as i32,
            None => 0,
        };
        let is_sync = match &syncs {
            Some(syncs) => {
                let is_sync = syncs.get(next_sync) == Some(&(number + 1));
                next_sync += usize::from(is_sync);
                is_sync
            }
            None => true,
        };
        samples.push(Sample {
            offset,
            bytes,
            is_sync,
            composition: decoded_at.saturating_add(i64::from(shift)),
        });
        decoded_at = decoded_at.saturating_add(i64::from(deltas.next().unwrap_or(0)));
    }
    Ok(samples)
}

fn missing(table: &str) -> Fault {
    Fault::damaged(format!(
        "the index of its frames has no usable table `{table}`"
    ))
}

/// `stsz`: sizes in bytes.
struct Sizes<'a> {
    /// Of all samples, or 0.
    common: u32,
    count: u32,
    each: &'a [u8],
}

impl<'a> Sizes<'a> {
    fn read(stbl: &'a [u8]) -> Option<Self> {
        let mut fields = Fields(find(stbl, b"stsz")?);
        fields.version_and_flags()?;
        let (common, count) = (fields.u32()?, fields.u32()?);
        Some(Self {
            common,
            count,
            each: fields.0,
        })
    }

    fn count(&self) -> u32 {
        let listed = u32::try_from(self.each.len() / 4).unwrap_or(u32::MAX);
        if self.common == 0 {
            self.count.min(listed)
        } else {
            self.count
        }
    }

    fn get(&self, number: u32) -> Option<u32> {
        if self.common > 0 {
            return Some(self.common);
        }
        Fields(self.each.get(4 * number as usize..)?).u32()
    }
}

/// Where samples are: chunks (`stco`, `co64`) of several samples (`stsc`).
struct Places<'a> {
    chunks: &'a [u8],
    /// Whether the chunks' offsets have 64 bits.
    is_wide: bool,
    /// First chunk, from 1, and samples in each from there on.
    runs: Vec<(u32, u32)>,
    run: usize,
    /// The current chunk, from 1.
    chunk: u32,
    left_in_chunk: u32,
    offset: u64,
}

impl<'a> Places<'a> {
    fn read(stbl: &'a [u8]) -> Result<Self, Fault> {
        let (table, is_wide) = match find(stbl, b"stco") {
            Some(table) => (table, false),
            None => (find(stbl, b"co64").ok_or_else(|| missing("stco"))?, true),
        };
        let chunks = table.get(8..).ok_or_else(|| missing("stco"))?;
        let runs = find(stbl, b"stsc").and_then(|table| {
            let mut fields = Fields(table);
            fields.version_and_flags()?;
            let count = fields.u32()?;
            let mut runs = Vec::new();
            for _ in 0..count {
                let run = (fields.u32()?, fields.u32()?);
                fields.u32()?;
                runs.push(run);
            }
            Some(runs)
        });
        let runs = runs
            .filter(|runs| runs.first().is_some_and(|first| first.0 == 1))
            .ok_or_else(|| missing("stsc"))?;
        Ok(Self {
            chunks,
            is_wide,
            runs,
            run: 0,
            chunk: 0,
            left_in_chunk: 0,
            offset: 0,
        })
    }

    /// Where the next sample is, which has so many bytes.
    fn next(&mut self, bytes: u32) -> Option<u64> {
        while self.left_in_chunk == 0 {
            let at = self.chunk as usize * if self.is_wide { 8 } else { 4 };
            let mut fields = Fields(self.chunks.get(at..)?);
            self.offset = fields.by_version(u8::from(self.is_wide))?;
            self.chunk += 1;
            let after = self.runs.get(self.run + 1);
            if after.is_some_and(|after| self.chunk >= after.0) {
                self.run += 1;
            }
            self.left_in_chunk = self.runs.get(self.run)?.1;
        }
        self.left_in_chunk -= 1;
        let offset = self.offset;
        self.offset = offset.checked_add(u64::from(bytes))?;
        Some(offset)
    }
}

/// Tables of values with the number of samples that each holds for (`stts`, `ctts`).
struct Runs<'a> {
    rest: Fields<'a>,
    left: u32,
    value: u32,
}

impl<'a> Runs<'a> {
    fn read(table: Option<&'a [u8]>) -> Option<Self> {
        Some(Self {
            rest: Fields(table?.get(8..)?),
            left: 0,
            value: 0,
        })
    }

    /// The value of the next sample; the last one goes on.
    fn next(&mut self) -> Option<u32> {
        while self.left == 0 {
            match (self.rest.u32(), self.rest.u32()) {
                (Some(count), Some(value)) => (self.left, self.value) = (count, value),
                _ => return Some(self.value),
            }
        }
        self.left -= 1;
        Some(self.value)
    }
}

/// Numbers of the samples that decoding can start at, from 1; `None` if it can at all of them.
fn sync_numbers(stbl: &[u8]) -> Option<Vec<u32>> {
    let mut fields = Fields(find(stbl, b"stss")?);
    fields.version_and_flags()?;
    let count = fields.u32()?;
    Some((0..count).map_while(|_| fields.u32()).collect())
}
