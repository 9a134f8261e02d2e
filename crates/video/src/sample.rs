//! One coded frame in the file.

/// Memory that the index takes for each sample: the sample, when it is shown, and its place among those that are taken.
pub(crate) const SAMPLE_MEMORY_BYTES: u64 = 128;

/// Where a coded frame is, and when it is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    /// First byte in the file.
    pub offset: u64,
    pub bytes: u32,
    /// Decoding can start here.
    pub is_sync: bool,
    /// Composition time, units of the track. Frames that others are predicted from come earlier in the file than they are shown.
    pub composition: i64,
}
