//! The attitude of the camera that a photo's metadata tell.

use grimnet_photo::{Tilt, View};
use grimnet_track::Attitude;

/// The attitude that the photo's metadata tell.
pub(crate) fn recorded_attitude(view: &View, time_s: f64) -> Option<Attitude> {
    attitude_towards(view, view.heading?.heading_deg, time_s)
}

/// The attitude that the pitch of a photo's view gives where the photo's top points to `top_deg`, degrees clockwise from true north.
pub(crate) fn attitude_towards(view: &View, top_deg: f64, time_s: f64) -> Option<Attitude> {
    let camera = view.attitude?;
    let top_from_yaw_deg = Tilt::top_from_yaw_deg(camera.pitch_from_nadir_deg, camera.roll_deg);
    let yaw_deg = top_deg - top_from_yaw_deg;
    Some(Attitude::from_gimbal(
        time_s,
        yaw_deg,
        camera.gimbal_pitch_deg(),
        camera.roll_deg,
    ))
}
