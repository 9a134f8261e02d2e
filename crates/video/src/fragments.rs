//! The samples of movie fragments (`moof`; ISO/IEC 14496-12, 8.8), which some recorders write so that a recording that breaks off
//! can be read.

use crate::fields::{Fields, boxes, find};
use crate::sample::Sample;

/// `trun` says duration, size, flags or composition time of each sample.
const EACH_SAMPLE: u32 = 0xf00;

/// What a fragment says of a sample if it says nothing else.
#[derive(Debug, Clone, Copy, Default)]
struct Defaults {
    duration: u32,
    bytes: u32,
    flags: u32,
}

/// Reads fragments in the order of the file.
#[derive(Debug, Default)]
pub(crate) struct Fragments {
    track: u32,
    defaults: Defaults,
    /// Decoding time after the last sample, units of the track.
    next_time: i64,
}

impl Fragments {
    /// For the track with this number, with the defaults of `mvex` in `moov`.
    pub(crate) fn new(moov: &[u8], track: u32) -> Self {
        let defaults = find(moov, b"mvex").and_then(|mvex| {
            boxes(mvex)
                .filter(|one| one.kind == *b"trex")
                .find_map(|trex| {
                    let mut fields = Fields(trex.body);
                    fields.version_and_flags()?;
                    let is_ours = fields.u32()? == track;
                    fields.u32()?;
                    let defaults = Defaults {
                        duration: fields.u32()?,
                        bytes: fields.u32()?,
                        flags: fields.u32()?,
                    };
                    is_ours.then_some(defaults)
                })
        });
        Self {
            track,
            defaults: defaults.unwrap_or_default(),
            next_time: 0,
        }
    }

    /// Adds the samples of the fragment that begins at `start` in the file. What is damaged ends the fragment. `limit` is the
    /// largest number of samples.
    pub(crate) fn add(&mut self, moof: &[u8], start: u64, limit: u64, samples: &mut Vec<Sample>) {
        let mut data_end = start;
        for traf in boxes(moof).filter(|one| one.kind == *b"traf") {
            if self
                .add_track(traf.body, start, &mut data_end, limit, samples)
                .is_none()
            {
                return;
            }
        }
    }

    fn add_track(
        &mut self,
        traf: &[u8],
        start: u64,
        data_end: &mut u64,
        limit: u64,
        samples: &mut Vec<Sample>,
    ) -> Option<()> {
        let mut fields = Fields(find(traf, b"tfhd")?);
        let (_, flags) = fields.version_and_flags()?;
        let is_ours = fields.u32()? == self.track;
        // Without a stated base: the fragment's first byte, or the end of the data before.
        let mut base = if flags & 0x02_0000 != 0 {
            start
        } else {
            *data_end
        };
        let mut defaults = self.defaults;
        if flags & 0x01 != 0 {
            base = fields.u64()?;
        }
        if flags & 0x02 != 0 {
            fields.u32()?;
        }
        if flags & 0x08 != 0 {
            defaults.duration = fields.u32()?;
        }
        if flags & 0x10 != 0 {
            defaults.bytes = fields.u32()?;
        }
        if flags & 0x20 != 0 {
            defaults.flags = fields.u32()?;
        }
        if let (Some(tfdt), true) = (find(traf, b"tfdt"), is_ours) {
            let mut fields = Fields(tfdt);
            let (version, _) = fields.version_and_flags()?;
            self.next_time = i64::try_from(fields.by_version(version)?).ok()?;
        }
        *data_end = base;
        for run in boxes(traf).filter(|one| one.kind == *b"trun") {
            self.add_run(run.body, base, data_end, defaults, is_ours, limit, samples)?;
        }
        Some(())
    }

    #[allow(clippy::too_many_arguments, reason = "what a run depends on")]
    fn add_run(
        &mut self,
        trun: &[u8],
        base: u64,
        data_end: &mut u64,
        defaults: Defaults,
        is_ours: bool,
        limit: u64,
        samples: &mut Vec<Sample>,
    ) -> Option<()> {
        let mut fields = Fields(trun);
        let (_, flags) = fields.version_and_flags()?;
        let count = fields.u32()?;
        if flags & 0x01 != 0 {
            *data_end = base.checked_add_signed(i64::from(fields.i32()?))?;
        }
        // Nothing is said of each of them, and they are not ours: there may be thousands of millions.
        if !is_ours && flags & EACH_SAMPLE == 0 {
            let bytes = u64::from(count) * u64::from(defaults.bytes);
            *data_end = data_end.checked_add(bytes)?;
            return Some(());
        }
        let mut first_flags = None;
        if flags & 0x04 != 0 {
            first_flags = Some(fields.u32()?);
        }
        for number in 0..count {
            let mut value = |flag: u32, default: u32| {
                if flags & flag == 0 {
                    Some(default)
                } else {
                    fields.u32()
                }
            };
            let duration = value(0x100, defaults.duration)?;
            let bytes = value(0x200, defaults.bytes)?;
            let mut sample_flags = value(0x400, defaults.flags)?;
            let shift = value(0x800, 0)? as i32;
            if let (0, Some(first)) = (number, first_flags) {
                sample_flags = first;
            }
            let offset = *data_end;
            *data_end = offset.checked_add(u64::from(bytes))?;
            if !is_ours {
                continue;
            }
            if samples.len() as u64 >= limit {
                return None;
            }
            samples.push(Sample {
                offset,
                bytes,
                // Bit 16: sample_is_non_sync_sample.
                is_sync: sample_flags & 0x1_0000 == 0,
                composition: self.next_time.saturating_add(i64::from(shift)),
            });
            self.next_time = self.next_time.saturating_add(i64::from(duration));
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::boxed;

    fn numbers(values: &[u32]) -> Vec<u8> {
        values.iter().flat_map(|n| n.to_be_bytes()).collect()
    }

    #[test]
    fn runs_of_other_tracks_cost_nothing_however_many_samples_they_claim() {
        // Track 2, whose samples have no bytes (0x10), and a thousand runs of it that say nothing of each sample.
        let tfhd = boxed(b"tfhd", &numbers(&[0x10, 2, 0]));
        let trun = boxed(b"trun", &numbers(&[0, u32::MAX]));
        let other = boxed(b"traf", &[tfhd, trun.repeat(1000)].concat());
        // Then ten bytes of track 2, and track 1, which begins where they end: three samples of five bytes.
        let tfhd = boxed(b"tfhd", &numbers(&[0x10, 2, 10]));
        let trun = boxed(b"trun", &numbers(&[0, 1]));
        let before = boxed(b"traf", &[tfhd, trun].concat());
        let tfhd = boxed(b"tfhd", &numbers(&[0x10, 1, 5]));
        let trun = boxed(b"trun", &numbers(&[0, 3]));
        let ours = boxed(b"traf", &[tfhd, trun].concat());
        let mut samples = Vec::new();
        let moof = [other, before, ours].concat();
        Fragments::new(&[], 1).add(&moof, 100, 1000, &mut samples);
        let offsets: Vec<u64> = samples.iter().map(|sample| sample.offset).collect();
        assert_eq!(offsets, [110, 115, 120]);
    }
}
