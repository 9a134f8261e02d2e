//! Colour of grass.

use crate::colour::{Rgb, rgb8};
use crate::look::Season;

/// Grass from dry (0) to lush (1).
pub(crate) fn grass(season: Season, lush: f32) -> Rgb {
    let (dry, wet) = match season {
        Season::Spring => (rgb8(128, 138, 78), rgb8(84, 122, 46)),
        Season::Summer => (rgb8(146, 138, 88), rgb8(80, 104, 46)),
        Season::Autumn => (rgb8(146, 132, 86), rgb8(92, 104, 52)),
        Season::Winter => (rgb8(138, 124, 96), rgb8(98, 100, 68)),
    };
    dry.mix(wet, lush.clamp(0.0, 1.0))
}
