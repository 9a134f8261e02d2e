//! Motion from one frame to the next, from the keypoints of their searches.

use grimnet_locate::{FrameFeatures, FramePair, FrameTilt, Localizer, LocateError};
use grimnet_track::{Attitude, RelativeMotion, TrackOptions};

/// A motion over a longer time than this says little, seconds: the photos hardly overlap.
const LONGEST_S: f64 = 90.0;

/// What is kept of a frame for the motion to the next one.
#[derive(Debug, Clone)]
pub(crate) struct SearchedFrame {
    /// Exposure time, seconds.
    pub time_s: f64,
    /// Its keypoints.
    pub features: FrameFeatures,
    /// Attitude of the camera, if it is known.
    pub attitude: Option<Attitude>,
    /// Focal length of the full-size photo, pixels, if it is known.
    pub focal_length_px: Option<f64>,
    /// Pixels of the photo for one pixel at the focal length that the track refers to.
    pub px_per_reference_px: f64,
}

/// The motion from `first` to `second`; `None` if too few keypoints agree on one, or the frames are not in order of time. Keypoints
/// of `second` that moved with the ground of `first` are marked.
///
/// # Errors
/// The keypoints cannot be compared.
pub(crate) fn motion_between(
    localizer: &Localizer,
    first: &SearchedFrame,
    second: &mut SearchedFrame,
    options: &TrackOptions,
) -> Result<Option<RelativeMotion>, LocateError> {
    let interval_s = second.time_s - first.time_s;
    if !(interval_s > 0.0 && interval_s <= LONGEST_S) {
        return Ok(None);
    }
    let tilts = first
        .attitude
        .zip(second.attitude)
        .filter(|_| second.focal_length_px.is_some())
        .map(|(first, second)| [frame_tilt(&first), frame_tilt(&second)]);
    // The filter knows the error of the attitude, and how far a camera may be tilted of which none is known. What it cannot know
    // is an attitude of one of them that could not be taken out.
    let is_known_of_one = first.attitude.or(second.attitude).is_some();
    let sigma_deg = if tilts.is_none() && is_known_of_one {
        change_sigma_deg(
            options.unknown_tilt_sigma_deg,
            options.unknown_tilt_correlation_s,
            interval_s,
        )
    } else {
        0.0
    };
    let pair = FramePair {
        focal_length_px: second.focal_length_px.unwrap_or(1.0),
        tilts,
        tilt_change_sigma_deg: sigma_deg,
    };
    let found = localizer.motion_between(&first.features, &mut second.features, &pair)?;
    let to_reference = 1.0 / first.px_per_reference_px;
    Ok(found.map(|motion| RelativeMotion {
        from_time_s: first.time_s,
        time_s: second.time_s,
        forward_px: motion.forward_px * to_reference,
        right_px: motion.right_px * to_reference,
        turn_deg: motion.turn_deg,
        sigma_px: motion.sigma_px() * to_reference,
        surface_sigma_px: motion
            .surface_sigma_px
            .map(|sigma_px| sigma_px * to_reference),
    }))
}

fn frame_tilt(attitude: &Attitude) -> FrameTilt {
    FrameTilt {
        pitch_deg: attitude.pitch_deg,
        roll_deg: attitude.roll_deg,
    }
}

/// Standard deviation of the change of a first-order Gauss-Markov error of `sigma_deg` per axis, degrees.
fn change_sigma_deg(sigma_deg: f64, correlation_s: f64, interval_s: f64) -> f64 {
    let decay = (-interval_s / correlation_s).exp();
    sigma_deg * (2.0 * (1.0 - decay)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_neighbouring_attitudes_are_alike() {
        assert!(change_sigma_deg(0.5, 2.0, 1e-9) < 1e-4);
        let apart = change_sigma_deg(0.5, 2.0, 100.0);
        assert!((apart - 0.5 * 2f64.sqrt()).abs() < 1e-9);
    }
}
