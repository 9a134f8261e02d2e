//! Motion of the camera from one frame to the next ([`Localizer::motion_between`](crate::Localizer::motion_between)), without the map.

pub use grimnet_locate::{FrameFeatures, FrameMotion, FramePair, FrameTilt};
