//! When a sample is shown: the edit list of a track (`elst`; ISO/IEC 14496-12, 8.6.6).

use crate::error::Fault;
use crate::fields::{Fields, find};

/// Cameras write one or two parts, editors one for each cut. Each frame is compared with all of them.
const MAX_EDITS: usize = 1000;

/// A stretch of the track that is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edit {
    /// When it begins, seconds of the movie.
    starts_s: f64,
    /// Its first composition time, units of the track.
    from: i64,
    /// Its length, seconds.
    length_s: f64,
}

/// See the module.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EditList {
    /// `None`: everything is shown, from the earliest frame on.
    edits: Option<Vec<Edit>>,
    units_per_s: f64,
}

impl EditList {
    /// The edit list of a `trak`.
    pub(crate) fn read(
        trak: &[u8],
        movie_units_per_s: u32,
        units_per_s: u32,
    ) -> Result<Self, Fault> {
        let edits = find(trak, b"edts")
            .and_then(|edts| find(edts, b"elst"))
            .and_then(|elst| edits(elst, f64::from(movie_units_per_s.max(1))))
            .filter(|edits| !edits.is_empty());
        if let Some(count) = edits
            .as_ref()
            .map(Vec::len)
            .filter(|&count| count > MAX_EDITS)
        {
            let found = format!("a video of {count} cuts, more than {MAX_EDITS}");
            return Err(Fault::Unsupported(found));
        }
        Ok(Self {
            edits,
            units_per_s: f64::from(units_per_s.max(1)),
        })
    }

    /// When samples with these composition times are shown, seconds; `None` for one that is only there for others.
    pub(crate) fn shown_s(&self, compositions: &[i64]) -> Vec<Option<f64>> {
        let Some(edits) = &self.edits else {
            let first = compositions.iter().copied().min().unwrap_or(0);
            let time = |at: &i64| Some(at.saturating_sub(first) as f64 / self.units_per_s);
            return compositions.iter().map(time).collect();
        };
        compositions
            .iter()
            .map(|at| {
                edits.iter().find_map(|edit| {
                    let within_s = at.saturating_sub(edit.from) as f64 / self.units_per_s;
                    // Lengths are rounded to the movie's units.
                    let is_shown = within_s >= 0.0 && within_s < edit.length_s;
                    is_shown.then_some(edit.starts_s + within_s)
                })
            })
            .collect()
    }
}

fn edits(elst: &[u8], movie_units_per_s: f64) -> Option<Vec<Edit>> {
    let mut fields = Fields(elst);
    let (version, _) = fields.version_and_flags()?;
    let count = fields.u32()?;
    let mut edits = Vec::new();
    let mut starts_s = 0.0;
    for _ in 0..count {
        let length = fields.by_version(version)?;
        let from = if version == 1 {
            fields.u64()? as i64
        } else {
            i64::from(fields.i32()?)
        };
        fields.u32()?; // The rate: 1 in videos of cameras.
        let length_s = length as f64 / movie_units_per_s;
        // -1: nothing is shown. A length of 0 goes to the end (fragmented files).
        if from >= 0 {
            edits.push(Edit {
                starts_s,
                from,
                length_s: if length == 0 { f64::INFINITY } else { length_s },
            });
        }
        starts_s += length_s;
    }
    Some(edits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::boxed;

    fn list(entries: &[(u32, i32)]) -> EditList {
        read(entries).unwrap()
    }

    fn read(entries: &[(u32, i32)]) -> Result<EditList, Fault> {
        let mut elst = vec![0; 4];
        elst.extend((entries.len() as u32).to_be_bytes());
        for (length, from) in entries {
            elst.extend(length.to_be_bytes());
            elst.extend(from.to_be_bytes());
            elst.extend(0x1_0000u32.to_be_bytes());
        }
        EditList::read(&boxed(b"edts", &boxed(b"elst", &elst)), 1000, 30)
    }

    #[test]
    fn a_delay_a_start_within_the_track_and_an_end() {
        // Half a second of nothing, then two seconds from the composition time 60 on.
        let list = list(&[(500, -1), (2000, 60)]);
        assert_eq!(
            list.shown_s(&[0, 59, 60, 90, 119, 120]),
            [
                None,
                None,
                Some(0.5),
                Some(1.5),
                Some(0.5 + 59.0 / 30.0),
                None
            ]
        );
    }

    #[test]
    fn without_edits_the_first_frame_shown_is_at_zero() {
        let list = EditList::read(&[], 1000, 30).unwrap();
        assert_eq!(
            list.shown_s(&[2, 6, 4]),
            [Some(0.0), Some(4.0 / 30.0), Some(2.0 / 30.0)]
        );
    }

    #[test]
    fn a_length_of_zero_goes_to_the_end() {
        assert_eq!(list(&[(0, 2)]).shown_s(&[2, 32]), [Some(0.0), Some(1.0)]);
    }

    #[test]
    fn more_edits_than_a_cut_video_has_are_refused() {
        assert!(read(&[(1, 0); MAX_EDITS]).is_ok());
        let fault = read(&[(1, 0); MAX_EDITS + 1]).unwrap_err();
        assert!(fault.to_string().contains("1001 cuts"), "{fault}");
    }
}
