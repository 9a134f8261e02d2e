//! A survey-like flight over the world.

use serde::{Deserialize, Serialize};

use crate::camera::Pose;
use crate::random::Stream;
use crate::world::World;

/// One photo of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Where the camera truly was.
    pub pose: Pose,
    /// What the drone's metadata say: position, height and heading with their usual errors, tilt
    /// as commanded.
    pub reported: Pose,
}

/// Poses along parallel lines with turns between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// In the order of flight.
    pub frames: Vec<Frame>,
}

/// Closest to the map's edge that a camera comes, metres; a photo of 170 m x 125 m fits.
const MARGIN_M: f64 = 115.0;

impl Flight {
    /// Plans `n` photos over the whole of `world`: lines across it, the heading turning at their
    /// ends, 100-130 m above the ground, with tilt of about 2 degrees. The flight stays 115 m
    /// (or, in small worlds, a quarter of the side) inside the map.
    pub fn plan(world: &World, n: usize, seed: u64) -> Self {
        let mut random = Stream::new(seed ^ 0xf117);
        let size = world.size_m();
        let margin = MARGIN_M.min(size * 0.25);
        let inner = size - 2.0 * margin;
        // About as many photos along a line as there are lines, a little denser along.
        let lines = ((n as f64 / 1.4).sqrt().round() as usize).max(1);
        let turned = random.chance(0.5);
        // The path over the unit square: up and down, joined by half turns.
        let waypoints: Vec<[f64; 2]> = (0..lines)
            .flat_map(|i| {
                let across = if lines == 1 {
                    0.5
                } else {
                    i as f64 / (lines - 1) as f64
                };
                let ends = if i % 2 == 0 { [0.0, 1.0] } else { [1.0, 0.0] };
                ends.map(|along| [across, along])
            })
            .collect();
        let lengths: Vec<f64> = waypoints
            .windows(2)
            .map(|w| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1]))
            .collect();
        let total: f64 = lengths.iter().sum();
        let height_phase = f64::from(random.range(0.0, 6.0));
        let mut frames = Vec::with_capacity(n);
        for k in 0..n {
            let mut left = total * (k as f64 + 0.5) / n as f64;
            let mut leg = 0;
            while leg + 1 < lengths.len() && left > lengths[leg] {
                left -= lengths[leg];
                leg += 1;
            }
            let (a, b) = (
                waypoints[leg],
                waypoints[(leg + 1).min(waypoints.len() - 1)],
            );
            let t = (left / lengths.get(leg).copied().unwrap_or(1.0).max(1e-9)).clamp(0.0, 1.0);
            let (u, v) = (a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t);
            let (du, dv) = (b[0] - a[0], b[1] - a[1]);
            let ((x, y), (dx, dy)) = if turned {
                ((v, u), (dv, du))
            } else {
                ((u, v), (du, dv))
            };
            let mut normal = |deviation: f64| f64::from(random.normal()) * deviation;
            // Wind makes the drone crab; near the turns it yaws.
            let turning = (t - 0.5).abs() * 2.0;
            let heading = dx.atan2(dy).to_degrees()
                + normal(6.0)
                + if turning > 0.85 { normal(35.0) } else { 0.0 };
            let inside = |p: f64| p.clamp(margin, size - margin);
            let pose = Pose {
                x_m: inside(margin + x * inner + normal(6.0)),
                y_m: inside(margin + y * inner + normal(6.0)),
                height_agl_m: (115.0 + 9.0 * (k as f64 * 0.37 + height_phase).sin() + normal(2.0))
                    .clamp(100.0, 130.0),
                heading_deg: heading.rem_euclid(360.0),
                pitch_off_nadir_deg: normal(1.6),
                roll_deg: normal(1.2),
            };
            let reported = Pose {
                x_m: pose.x_m + normal(1.5),
                y_m: pose.y_m + normal(1.5),
                height_agl_m: pose.height_agl_m + normal(1.8),
                heading_deg: (pose.heading_deg + normal(1.5)).rem_euclid(360.0),
                pitch_off_nadir_deg: 0.0,
                roll_deg: 0.0,
            };
            frames.push(Frame { pose, reported });
        }
        Self { frames }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::WorldConfig;

    #[test]
    fn flight_covers_the_map_inside_its_margin() {
        let world = World::new(WorldConfig {
            size_m: 600.0,
            ..WorldConfig::default()
        });
        let flight = Flight::plan(&world, 40, 3);
        assert_eq!(flight.frames.len(), 40);
        assert_eq!(flight, Flight::plan(&world, 40, 3));
        let mut quadrants = [0; 4];
        for Frame { pose, reported } in &flight.frames {
            assert!((115.0..=485.0).contains(&pose.x_m) && (115.0..=485.0).contains(&pose.y_m));
            assert!((100.0..=130.0).contains(&pose.height_agl_m));
            assert!((pose.height_agl_m - reported.height_agl_m).abs() < 10.0);
            quadrants[usize::from(pose.x_m > 300.0) + 2 * usize::from(pose.y_m > 300.0)] += 1;
        }
        assert!(quadrants.iter().all(|&q| q >= 5), "{quadrants:?}");
        let headings: Vec<f64> = flight.frames.iter().map(|f| f.pose.heading_deg).collect();
        let north = headings
            .iter()
            .filter(|h| **h < 90.0 || **h > 270.0)
            .count();
        assert!(north > 5 && north < 36, "{north}");
    }
}
