//! Videos that are cut, altered, or too large: what can be decoded is, and nothing panics.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

#[path = "golden/videos.rs"]
mod videos;

use grimnet_limits::PhotoLimits;
use grimnet_video::{Video, VideoError};
use proptest::prelude::*;
use videos::{VIDEOS, golden};

fn bytes_of(name: &str) -> Vec<u8> {
    fs_err::read(golden(name)).unwrap()
}

/// Opens a video of these bytes; gives the times of its frames and whether they were decoded.
fn frames_of(bytes: &[u8], limits: &PhotoLimits) -> Result<Vec<(f64, bool)>, VideoError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mp4");
    fs_err::write(&path, bytes).unwrap();
    let frames = Video::open(&path, limits)?.at_rate(60.0)?;
    let mut found = Vec::new();
    for frame in frames {
        if let Err(error) = &frame.picture {
            let text = error.to_string();
            assert!(text.contains("flight.mp4"), "{text}");
        }
        found.push((frame.time_s, frame.picture.is_ok()));
    }
    Ok(found)
}

fn place_of(bytes: &[u8], kind: &[u8; 4]) -> usize {
    bytes.windows(4).position(|four| four == kind).unwrap()
}

/// The video with its index at the beginning, as it stands in files that are made for streaming.
fn index_first(bytes: &[u8]) -> Vec<u8> {
    let moov = place_of(bytes, b"moov") - 4;
    let ftyp_end = u32::from_be_bytes(bytes[..4].try_into().unwrap()) as usize;
    let mut index = bytes[moov..].to_vec();
    let shift = index.len() as u32;
    let stco = place_of(&index, b"stco");
    let count = u32::from_be_bytes(index[stco + 8..stco + 12].try_into().unwrap()) as usize;
    for entry in index[stco + 12..][..4 * count].chunks_exact_mut(4) {
        let moved = u32::from_be_bytes(entry.try_into().unwrap()) + shift;
        entry.copy_from_slice(&moved.to_be_bytes());
    }
    [&bytes[..ftyp_end], &index, &bytes[ftyp_end..moov]].concat()
}

#[test]
fn a_truncated_video_gives_the_frames_that_are_in_it() {
    let whole = index_first(&bytes_of("h264_b_frames.mp4"));
    let all = frames_of(&whole, &PhotoLimits::DEFAULT).unwrap();
    assert_eq!(all.len(), 30);
    let index_end = place_of(&whole, b"mdat") + 4;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mp4");
    let mut before = 0;
    for tenths in 2..10 {
        let end = index_end + (whole.len() - index_end) * tenths / 10;
        let frames = frames_of(&whole[..end], &PhotoLimits::DEFAULT).unwrap();
        assert!(frames.len() >= before && frames.len() < 30, "{tenths}");
        assert!(frames.iter().all(|frame| frame.1), "{tenths}: {frames:?}");
        before = frames.len();
        fs_err::write(&path, &whole[..end]).unwrap();
        let video = Video::open(&path, &PhotoLimits::DEFAULT).unwrap();
        let last_s = video.info().truncated_at_s.unwrap();
        assert!((last_s - 29.0 / 15.0).abs() < 1e-6, "{last_s}");
    }
    assert!(before > 15);
}

#[test]
fn a_recording_that_was_not_finished_has_no_index() {
    let bytes = bytes_of("h265_10_bit.mp4");
    let moov = place_of(&bytes, b"moov") - 4;
    let error = frames_of(&bytes[..moov], &PhotoLimits::DEFAULT).unwrap_err();
    assert!(matches!(error, VideoError::NoIndex { .. }), "{error}");
    // One with fragments can be read up to its end.
    let bytes = bytes_of("h264_fragments.mp4");
    let frames = frames_of(&bytes[..bytes.len() / 2], &PhotoLimits::DEFAULT).unwrap();
    assert!((8..25).contains(&frames.len()), "{frames:?}");
    assert!(frames.iter().all(|frame| frame.1));
}

#[test]
fn a_damaged_frame_costs_those_up_to_the_next_start() {
    for (name, group) in [("h264_slices_full_range.mov", 10), ("h265_10_bit.mp4", 15)] {
        let mut bytes = bytes_of(name);
        let mdat = place_of(&bytes, b"mdat") + 4;
        // The lengths of NAL units in the first group of pictures.
        bytes[mdat + 200..mdat + 4000].fill(0xff);
        let frames = frames_of(&bytes, &PhotoLimits::DEFAULT).unwrap();
        assert_eq!(frames.len(), 30, "{name}");
        assert!(frames[..group].iter().any(|frame| !frame.1), "{name}");
        assert!(frames[2 * group - 1].1, "{name}: {frames:?}");
    }
}

#[test]
fn missing_parameter_sets_are_told() {
    let mut bytes = bytes_of("h264_b_frames.mp4");
    let avcc = place_of(&bytes, b"avcC") + 4;
    // No SPS, no PPS.
    bytes[avcc + 5] = 0xe0;
    bytes[avcc + 6] = 0;
    let error = frames_of(&bytes, &PhotoLimits::DEFAULT)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("flight.mp4") && error.contains("SPS"),
        "{error}"
    );
    bytes[avcc - 4..avcc].copy_from_slice(b"free");
    let error = frames_of(&bytes, &PhotoLimits::DEFAULT)
        .unwrap_err()
        .to_string();
    assert!(error.contains("avcC"), "{error}");
}

#[test]
fn limits_are_compared_before_anything_is_decoded() {
    for name in ["h264_b_frames.mp4", "h265_10_bit.mp4"] {
        let error = frames_of(&bytes_of(name), &PhotoLimits::of_memory(1 << 18)).unwrap_err();
        assert!(
            matches!(error, VideoError::TooLarge { .. }),
            "{name} {error}"
        );
        assert!(error.to_string().contains("px"), "{error}");
        frames_of(&bytes_of(name), &PhotoLimits::of_memory(8 << 20)).unwrap();
    }
    // An index of a thousand million frames of one byte.
    let mut bytes = bytes_of("h264_b_frames.mp4");
    let stsz = place_of(&bytes, b"stsz") + 4;
    bytes[stsz + 4..stsz + 12].copy_from_slice(&[0, 0, 0, 1, 0x40, 0, 0, 0]);
    let error = frames_of(&bytes, &PhotoLimits::DEFAULT).unwrap_err();
    assert!(matches!(error, VideoError::TooLarge { .. }), "{error}");
}

#[test]
fn what_is_no_video_is_refused_by_name() {
    for (bytes, is_unsupported) in [
        (&b"hello, this is a text"[..], true),
        (b"", false),
        (b"\0\0\0\x08moov", false),
        (b"\0\0\0\0mdat", false),
    ] {
        let error = frames_of(bytes, &PhotoLimits::DEFAULT).unwrap_err();
        assert_eq!(error.is_unsupported(), is_unsupported, "{error}");
        assert!(error.to_string().contains("flight.mp4"), "{error}");
    }
}

#[test]
fn what_the_container_says_is_told() {
    let video = Video::open(golden("h264_b_frames.mp4"), &PhotoLimits::DEFAULT).unwrap();
    let info = video.info();
    // 2026-05-01T12:00:00Z
    assert_eq!(info.created_unix_s, Some(1_777_636_800.0));
    assert_eq!(
        (info.codec, info.size_px, info.frames),
        ("H.264", (176, 112), 30)
    );
    assert_eq!(info.truncated_at_s, None);
    let turned = Video::open(golden("h264_rotated.mp4"), &PhotoLimits::DEFAULT).unwrap();
    assert_eq!(turned.info().size_px, (112, 176));
    assert_eq!(turned.info().created_unix_s, None);
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(60))]

    #[test]
    fn altered_videos_are_read_or_refused(
        video in 0..VIDEOS.len(),
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        in_index in any::<bool>(),
        keep in 0.3..1.4f64,
    ) {
        let mut bytes = bytes_of(VIDEOS[video]);
        let from = if in_index { place_of(&bytes, b"moov") } else { 0 };
        for (at, value) in changes {
            let at = from + at.index(bytes.len() - from);
            bytes[at] = value;
        }
        bytes.truncate((bytes.len() as f64 * keep) as usize);
        if let Ok(frames) = frames_of(&bytes, &PhotoLimits::of_memory(64 << 20)) {
            prop_assert!(frames.iter().all(|frame| frame.0.is_finite()));
        }
    }
}
