//! Whether the tilt of the telemetry is that which the photos show.
//!
//! Seen from a tilted camera the ground converges towards its horizon. A fix says where the photo's corners are on the ground, and
//! with the field of view that tells how far the view is off the vertical. Angles of another convention, a camera that is mounted
//! askew and a roll that is turned about differ from it in fix after fix, where the filter would take the aircraft to be elsewhere.

use std::collections::VecDeque;

use grimnet_geo::{LonLat, offset_en_m};
use grimnet_track::Attitude;

use super::median::median;

/// So many of the latest fixes are compared.
const FIXES: usize = 5;
/// So many of them must contradict: fixes of wrong places show any tilt.
const NEEDED: usize = 4;
/// Fixes that are nearer to the one before in time are not compared, seconds: in a gust or at the beginning of a turn an attitude is late,
/// and at any frame rate a contradiction has to last for longer than that.
const LEAST_APART_S: f64 = 0.8;
/// A tilt this far off is inconsistent, degrees. Over a dense town photos taken straight down look tilted by 7 degrees in the median: roofs
/// lean outwards.
const LEAST_OFF_DEG: f64 = 15.0;

/// The reported tilt is not that of the photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltWarning {
    /// Pitch that the latest fixes show minus the reported one, median, degrees.
    pub pitch_deg: f64,
    /// The same of roll, degrees.
    pub roll_deg: f64,
}

impl std::fmt::Display for TiltWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the tilt of the telemetry is not that of the photos, which show {:+.0} degrees of pitch and {:+.0} of roll more: those of \
             the camera were expected, 0 where it looks straight down",
            // Without the sign of a zero.
            self.pitch_deg.round() + 0.0,
            self.roll_deg.round() + 0.0
        )
    }
}

/// Compares the reported tilt with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct TiltCheck {
    /// Times of the latest fixes, seconds, and pitch and roll that they show minus those reported, degrees.
    off_deg: VecDeque<(f64, [f64; 2])>,
    warning: Option<TiltWarning>,
}

impl TiltCheck {
    /// Takes in what a fix shows, and the attitude that was reported for it.
    pub fn fix(&mut self, measured: MeasuredTilt, reported: &Attitude) {
        // A clock may be set back.
        let is_near = |last: &(f64, [f64; 2])| (reported.time_s - last.0).abs() < LEAST_APART_S;
        if self.off_deg.back().is_some_and(is_near) {
            return;
        }
        if self.off_deg.len() == FIXES {
            self.off_deg.pop_front();
        }
        let off_deg = [
            measured.pitch_deg - reported.pitch_deg,
            measured.roll_deg - reported.roll_deg,
        ];
        self.off_deg.push_back((reported.time_s, off_deg));
        let contradicting = self
            .off_deg
            .iter()
            .filter(|(_, [pitch, roll])| pitch.hypot(*roll) > LEAST_OFF_DEG)
            .count();
        if contradicting >= NEEDED && self.warning.is_none() {
            let [pitch_deg, roll_deg] =
                [0, 1].map(|axis| median(self.off_deg.iter().map(|(_, off)| off[axis])));
            self.warning = Some(TiltWarning {
                pitch_deg,
                roll_deg,
            });
        }
    }

    /// What is inconsistent; once it is, it stays so.
    pub fn warning(&self) -> Option<TiltWarning> {
        self.warning
    }
}

/// The direction of view that a fix shows, as [`Attitude`] has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MeasuredTilt {
    pub pitch_deg: f64,
    pub roll_deg: f64,
}

impl MeasuredTilt {
    /// From where the photo's corners are (top left, top right, bottom right, bottom left; degrees), its size and its focal length.
    ///
    /// The corners tell the projective transform from the photo to the ground (Heckbert 1989, section 2.2.3), whose denominator
    /// vanishes along the horizon `l`; the ground's normal is then `K^T l` (Hartley & Zisserman 2004, section 8.6). `None` if a corner is
    /// missing or the corners are no quadrangle.
    pub fn of(corners_deg: &[[f64; 2]], size_px: (u32, u32), focal_length_px: f64) -> Option<Self> {
        let corners: &[[f64; 2]; 4] = corners_deg.try_into().ok()?;
        let first = LonLat::new(corners[0][0], corners[0][1]);
        let [p0, p1, p2, p3] = corners.map(|[lon, lat]| offset_en_m(first, LonLat::new(lon, lat)));
        let sum = (p0.0 - p1.0 + p2.0 - p3.0, p0.1 - p1.1 + p2.1 - p3.1);
        let (right, bottom) = ((p1.0 - p2.0, p1.1 - p2.1), (p3.0 - p2.0, p3.1 - p2.1));
        let cross = |a: (f64, f64), b: (f64, f64)| a.0 * b.1 - a.1 * b.0;
        let area = cross(right, bottom);
        // The denominator across the photo is 1 + g x + h y, x and y from 0 at the top left to 1.
        let (g, h) = (cross(sum, bottom) / area, cross(right, sum) / area);
        let down = [
            focal_length_px * g / f64::from(size_px.0),
            focal_length_px * h / f64::from(size_px.1),
            1.0 + 0.5 * (g + h),
        ];
        let length = down.iter().map(|part| part * part).sum::<f64>().sqrt();
        let [x, y, z] = down.map(|part| part / length);
        (length.is_finite() && z > 0.0).then(|| Self {
            pitch_deg: y.asin().to_degrees(),
            roll_deg: x.atan2(z).to_degrees(),
        })
    }

    /// Ground resolution at the photo's centre over that straight below a camera at the same height: as far again as `1 / cos` and met
    /// at an angle, `1 / cos^3` in area.
    pub fn gsd_over_nadir(&self) -> f64 {
        let cos = self.pitch_deg.to_radians().cos() * self.roll_deg.to_radians().cos();
        cos.powf(-1.5)
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::destination_en_m;

    use super::*;

    /// Where a camera with this attitude 120 m above ground sees its corners: 1280 x 960 pixels, focal length 1000.
    fn corners(attitude: &Attitude) -> Vec<[f64; 2]> {
        let [yaw, pitch, roll] =
            [attitude.yaw_deg, attitude.pitch_deg, attitude.roll_deg].map(f64::to_radians);
        let pixels = [
            (-640.0, -480.0),
            (640.0, -480.0),
            (640.0, 480.0),
            (-640.0, 480.0),
        ];
        let on_ground = |(x, y): (f64, f64)| {
            // Towards the photo's top, its right and along its axis; rolled, pitched, turned.
            let (top, right, along) = (-y, x, 1000.0);
            let (right, along) = (
                right * roll.cos() - along * roll.sin(),
                right * roll.sin() + along * roll.cos(),
            );
            let (top, along) = (
                top * pitch.cos() + along * pitch.sin(),
                -top * pitch.sin() + along * pitch.cos(),
            );
            let (north, east) = (
                top * yaw.cos() - right * yaw.sin(),
                top * yaw.sin() + right * yaw.cos(),
            );
            let scale = 120.0 / along;
            let at = destination_en_m(LonLat::new(1.5, 40.0), east * scale, north * scale);
            [at.lon_deg, at.lat_deg]
        };
        pixels.map(on_ground).to_vec()
    }

    fn attitude(yaw_deg: f64, pitch_deg: f64, roll_deg: f64) -> Attitude {
        Attitude {
            time_s: 0.0,
            yaw_deg,
            pitch_deg,
            roll_deg,
        }
    }

    #[test]
    fn the_corners_on_the_ground_tell_pitch_and_roll() {
        for (yaw, pitch, roll) in [
            (0.0, 0.0, 0.0),
            (70.0, 12.0, 0.0),
            (200.0, 0.0, -25.0),
            (310.0, -8.0, 17.0),
        ] {
            let reported = attitude(yaw, pitch, roll);
            let measured = MeasuredTilt::of(&corners(&reported), (1280, 960), 1000.0).unwrap();
            assert!(
                (measured.pitch_deg - pitch).abs() < 0.01,
                "{reported:?} {measured:?}"
            );
            assert!(
                (measured.roll_deg - roll).abs() < 0.01,
                "{reported:?} {measured:?}"
            );
        }
        let level = corners(&attitude(0.0, 0.0, 0.0));
        assert_eq!(MeasuredTilt::of(&level[..3], (1280, 960), 1000.0), None);
        assert_eq!(MeasuredTilt::of(&[level[0]; 4], (1280, 960), 1000.0), None);
    }

    #[test]
    fn a_tilt_that_four_of_five_fixes_contradict_is_inconsistent() {
        let measured = |pitch_deg, roll_deg| MeasuredTilt {
            pitch_deg,
            roll_deg,
        };
        let reported = |number: usize, fixes_per_s: f64, roll_deg: f64| Attitude {
            time_s: number as f64 / fixes_per_s,
            ..attitude(0.0, 0.0, roll_deg)
        };
        let mut right = TiltCheck::default();
        for number in 0..40 {
            // Every fourth is of another place.
            let off = if number % 4 == 0 { 40.0 } else { 7.0 };
            right.fix(measured(3.0, off - 4.0), &reported(number, 1.0, -4.0));
        }
        assert_eq!(right.warning(), None);
        let mut askew = TiltCheck::default();
        for number in 0..NEEDED {
            assert_eq!(askew.warning(), None);
            askew.fix(measured(2.0, -3.0), &reported(number, 1.0, 17.0));
        }
        let warning = askew.warning().unwrap();
        assert_eq!((warning.pitch_deg, warning.roll_deg), (2.0, -20.0));
        for (fixes, fixes_per_s) in [(4, 0.25), (8, 2.0), (40, 10.0), (120, 30.0)] {
            let mut askew = TiltCheck::default();
            for number in 0..fixes {
                askew.fix(measured(2.0, -3.0), &reported(number, fixes_per_s, 17.0));
            }
            assert!(askew.warning().is_some(), "{fixes_per_s} fixes a second");
        }
        let mut gust = TiltCheck::default();
        for number in 0..40 {
            let roll_deg = if number % 10 < 5 { 25.0 } else { 0.0 };
            gust.fix(measured(0.0, 0.0), &reported(number, 5.0, roll_deg));
        }
        assert_eq!(gust.warning(), None, "a second of five fixes is a gust");
    }
}
