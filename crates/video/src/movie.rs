//! The container: where the frames of an MP4 or MOV file are, when they are shown, and how they are coded
//! (ISO/IEC 14496-12, QuickTime File Format).

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use grimnet_limits::PhotoLimits;

use crate::colour::ColourDescription;
use crate::edit_list::EditList;
use crate::error::{Fault, VideoError};
use crate::fields::{Fields, boxes, find};
use crate::fragments::Fragments;
use crate::pixel_aspect::PixelAspect;
use crate::rotation::Rotation;
use crate::sample::{SAMPLE_MEMORY_BYTES, Sample};
use crate::sample_entry::{Codec, SampleEntry};
use crate::sample_table;

/// Seconds from 1904-01-01, which times in `mvhd` count from, to 1970-01-01.
const UNIX_EPOCH_S: u64 = 2_082_844_800;
/// A file begins with one of these boxes.
const FIRST_BOXES: [&[u8; 4]; 8] = [
    b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot", b"moof",
];

/// See the module.
#[derive(Debug)]
pub(crate) struct Movie {
    pub codec: Codec,
    /// SPS, PPS and VPS outside of the frames, as NAL units.
    pub parameter_sets: Vec<Vec<u8>>,
    /// Bytes of the length before each NAL unit.
    pub nal_length_bytes: usize,
    pub colour: Option<ColourDescription>,
    pub aspect: Option<PixelAspect>,
    pub rotation: Rotation,
    /// In order of decoding, those alone that are in the file.
    pub samples: Vec<Sample>,
    /// When each is shown, seconds; `None` for one that is only there for others.
    pub shown_s: Vec<Option<f64>>,
    /// When the last frame is shown according to the index, if frames are missing at the end of the file.
    pub truncated_at_s: Option<f64>,
    /// When the file says that it was made, seconds from 1970-01-01 by the camera's clock.
    pub created_unix_s: Option<f64>,
}

impl Movie {
    /// Reads the index.
    pub(crate) fn read(
        path: &Path,
        file: &mut File,
        limits: &PhotoLimits,
    ) -> Result<Self, VideoError> {
        let limit_bytes = limits.max_memory_bytes;
        let tops = TopLevel::read(path, file, limit_bytes)?;
        tops.movie(limit_bytes)
            .map_err(|fault| fault.of(path, limit_bytes))
    }
}

/// The boxes of a file that hold its index.
struct TopLevel {
    moov: Vec<u8>,
    /// Fragments, with their first byte in the file.
    moofs: Vec<(u64, Vec<u8>)>,
    file_bytes: u64,
}

impl TopLevel {
    fn read(path: &Path, file: &mut File, limit_bytes: u64) -> Result<Self, VideoError> {
        let read_error = |source| VideoError::Read {
            path: path.to_owned(),
            source,
        };
        let file_bytes = file.metadata().map_err(read_error)?.len();
        let mut moov = None;
        let mut moofs = Vec::new();
        let mut index_bytes: u64 = 0;
        let mut at: u64 = 0;
        while at + 8 <= file_bytes {
            file.seek(SeekFrom::Start(at)).map_err(read_error)?;
            let mut head = [0; 16];
            let head_bytes = (file_bytes - at).min(16) as usize;
            file.read_exact(&mut head[..head_bytes])
                .map_err(read_error)?;
            let mut fields = Fields(&head);
            let size = fields.u32().unwrap_or(0);
            let kind: [u8; 4] = fields.array().unwrap_or_default();
            if at == 0 && !FIRST_BOXES.iter().any(|first| **first == kind) {
                return Err(VideoError::Unsupported {
                    path: path.to_owned(),
                    found: "neither an MP4 nor a MOV file".to_owned(),
                });
            }
            let (size, header_bytes) = match size {
                0 => (file_bytes - at, 8),
                1 => (fields.u64().unwrap_or(0), 16),
                size => (u64::from(size), 8),
            };
            let Some(end) = at.checked_add(size).filter(|_| size >= header_bytes) else {
                break;
            };
            if end > file_bytes {
                // What was cut off; frames before the cut are there.
                break;
            }
            if &kind == b"moov" || &kind == b"moof" {
                // With its entry among the fragments: a box may be empty.
                index_bytes += size + size_of::<(u64, Vec<u8>)>() as u64;
                if index_bytes > limit_bytes {
                    let what = "its index".to_owned();
                    let needed_bytes = index_bytes;
                    return Err(Fault::TooLarge { what, needed_bytes }.of(path, limit_bytes));
                }
                let mut body = vec![0; (size - header_bytes) as usize];
                file.seek(SeekFrom::Start(at + header_bytes))
                    .and_then(|_| file.read_exact(&mut body))
                    .map_err(read_error)?;
                if &kind == b"moof" {
                    moofs.push((at, body));
                } else if moov.is_none() {
                    moov = Some(body);
                }
            }
            at = end;
        }
        let moov = moov.ok_or_else(|| VideoError::NoIndex {
            path: path.to_owned(),
        })?;
        Ok(Self {
            moov,
            moofs,
            file_bytes,
        })
    }

    fn movie(&self, limit_bytes: u64) -> Result<Movie, Fault> {
        let header = MovieHeader::read(&self.moov);
        let trak = boxes(&self.moov)
            .filter(|one| one.kind == *b"trak")
            .map(|trak| trak.body)
            .find(|trak| is_video(trak))
            .ok_or_else(|| Fault::damaged("its index has no video track"))?;
        let needed = |name: &str| Fault::damaged(format!("its index has no usable box `{name}`"));
        let mdia = find(trak, b"mdia").ok_or_else(|| needed("mdia"))?;
        let stbl = find(mdia, b"minf")
            .and_then(|minf| find(minf, b"stbl"))
            .ok_or_else(|| needed("stbl"))?;
        let units_per_s = media_units_per_s(mdia).ok_or_else(|| needed("mdhd"))?;
        let (track, rotation) = track_header(trak).ok_or_else(|| needed("tkhd"))?;
        let entry = SampleEntry::read(find(stbl, b"stsd").ok_or_else(|| needed("stsd"))?)?;

        let limit = limit_bytes / SAMPLE_MEMORY_BYTES;
        let mut samples = if self.moofs.is_empty() {
            sample_table::samples(stbl, limit)?
        } else {
            sample_table::samples(stbl, limit).unwrap_or_default()
        };
        let mut fragments = Fragments::new(&self.moov, track);
        for (start, moof) in &self.moofs {
            fragments.add(moof, *start, limit, &mut samples);
        }
        let compositions: Vec<i64> = samples.iter().map(|sample| sample.composition).collect();
        let edits = EditList::read(trak, header.units_per_s, units_per_s)?;
        let mut shown_s = edits.shown_s(&compositions);
        let truncated_at_s = self.leave_out_missing(&mut samples, &mut shown_s);
        if shown_s.iter().all(Option::is_none) {
            return Err(Fault::damaged("no frame of its index is in the file"));
        }
        Ok(Movie {
            codec: entry.codec,
            parameter_sets: entry.parameter_sets,
            nal_length_bytes: entry.nal_length_bytes,
            colour: entry.colour,
            aspect: entry.aspect,
            rotation,
            samples,
            shown_s,
            truncated_at_s,
            created_unix_s: header.created_unix_s,
        })
    }

    /// Leaves out what lies behind the end of the file.
    fn leave_out_missing(
        &self,
        samples: &mut Vec<Sample>,
        shown_s: &mut Vec<Option<f64>>,
    ) -> Option<f64> {
        let is_there = |sample: &Sample| {
            sample
                .offset
                .checked_add(u64::from(sample.bytes))
                .is_some_and(|end| end <= self.file_bytes)
        };
        let there = samples.iter().position(|sample| !is_there(sample))?;
        let last_s = shown_s.iter().flatten().copied().reduce(f64::max);
        samples.truncate(there);
        shown_s.truncate(there);
        last_s
    }
}

/// What `mvhd` says.
struct MovieHeader {
    units_per_s: u32,
    created_unix_s: Option<f64>,
}

impl MovieHeader {
    fn read(moov: &[u8]) -> Self {
        let read = || {
            let mut fields = Fields(find(moov, b"mvhd")?);
            let (version, _) = fields.version_and_flags()?;
            let created = fields.by_version(version)?;
            fields.by_version(version)?;
            Some((created, fields.u32()?))
        };
        let (created, units_per_s) = read().unwrap_or((0, 1));
        Self {
            units_per_s,
            // 0 is not set, and 1904 was not.
            created_unix_s: created
                .checked_sub(UNIX_EPOCH_S)
                .filter(|&created| created > 0)
                .map(|unix_s| unix_s as f64),
        }
    }
}

fn is_video(trak: &[u8]) -> bool {
    let handler = find(trak, b"mdia").and_then(|mdia| find(mdia, b"hdlr"));
    handler.and_then(|hdlr| hdlr.get(8..12)) == Some(b"vide")
}

fn media_units_per_s(mdia: &[u8]) -> Option<u32> {
    let mut fields = Fields(find(mdia, b"mdhd")?);
    let (version, _) = fields.version_and_flags()?;
    fields.by_version(version)?;
    fields.by_version(version)?;
    fields.u32().filter(|&units_per_s| units_per_s > 0)
}

/// The number of a track, and how it is turned.
fn track_header(trak: &[u8]) -> Option<(u32, Rotation)> {
    let mut fields = Fields(find(trak, b"tkhd")?);
    let (version, _) = fields.version_and_flags()?;
    fields.by_version(version)?;
    fields.by_version(version)?;
    let track = fields.u32()?;
    fields.u32()?;
    fields.by_version(version)?;
    // Reserved, layer, group, volume, reserved.
    fields.take(16)?;
    // The matrix: a b u c d v x y w, where x' = a x + c y and y' = b x + d y.
    let (a, b) = (fields.i32()?, fields.i32()?);
    fields.u32()?;
    let (c, d) = (fields.i32()?, fields.i32()?);
    let rotation = Rotation::of_matrix([a, b, c, d]);
    Some((track, rotation))
}
