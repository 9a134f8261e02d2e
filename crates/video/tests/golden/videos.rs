//! The videos beside this file, which `make_golden.py` makes.

use std::path::{Path, PathBuf};

/// Their names.
pub const VIDEOS: [&str; 8] = [
    "h264_b_frames.mp4",
    "h264_cropped.mp4",
    "h264_edit_list.mp4",
    "h264_fragments.mp4",
    "h264_rotated.mp4",
    "h264_slices_full_range.mov",
    "h265_10_bit.mp4",
    "h265_open_groups.mp4",
];

/// The file of this name.
pub fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(name)
}
