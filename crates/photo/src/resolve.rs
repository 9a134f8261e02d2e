//! Decides which metadata of a photo are used for its view.

use crate::metadata::Metadata;
use crate::view::{View, ViewPrior};
use crate::{heading, scale};

impl View {
    /// Determines the view from metadata and prior knowledge. `size_px` is the displayed size of the photo at full size
    /// ([`crate::Photo::full_size_px`]).
    ///
    /// Prior knowledge overrides metadata. Of the metadata, the gimbal's yaw is preferred to the aircraft's yaw and that to EXIF's
    /// image direction. Altitude above sea level is never used as height above ground; height above the take-off point is used with
    /// a relative 1-sigma of 15 %. Prior values that are no numbers or out of range are ignored, with an entry in
    /// `View::set_aside`.
    pub fn resolve(metadata: &Metadata, size_px: (u32, u32), prior: &ViewPrior) -> Self {
        let mut view = Self::default();
        view.set_aside.extend(metadata.notes.iter().cloned());
        let attitude = heading::resolve(metadata, size_px, prior, &mut view);
        view.attitude = attitude;
        scale::resolve(metadata, size_px, prior, attitude, &mut view);
        heading::state_pitch(metadata, prior, &mut view);
        view
    }
}
