//! A survey flight over the world.

use serde::{Deserialize, Serialize};

use crate::camera::Pose;
use crate::random::Stream;
use crate::world::World;

/// One photo of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// True pose of the camera.
    pub pose: Pose,
    /// Pose in the drone's metadata: position, height and heading with typical errors, and the commanded tilt of 0.
    pub reported: Pose,
}

/// Poses along parallel lines with turns between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// In the order of flight.
    pub frames: Vec<Frame>,
}

/// Least distance of the camera from the edge of the map, metres; a photo of 170 m x 125 m fits.
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
        // Spacing along a line is a little smaller than between lines.
        let lines = ((n as f64 / 1.4).sqrt().round() as usize).max(1);
        let turned = random.chance(0.5);
        // The path over the unit square: lines in alternating directions.
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
            // Crab angle by wind; larger yaw errors near the turns.
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

    fn plan(size_m: f64, photos: usize, seed: u64) -> Flight {
        let config = WorldConfig {
            size_m,
            ..WorldConfig::default()
        };
        Flight::plan(&World::new(config), photos, seed)
    }

    /// Mean and standard deviation.
    fn moments(values: &[f64]) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        (mean, square.sqrt())
    }

    /// The difference of two headings, -180 to 180 degrees.
    fn turn_deg(from: f64, to: f64) -> f64 {
        (to - from + 180.0).rem_euclid(360.0) - 180.0
    }

    #[test]
    fn flight_covers_the_map_inside_its_margin() {
        for seed in 0..8 {
            let flight = plan(600.0, 40, seed);
            assert_eq!(flight.frames.len(), 40);
            assert_eq!(flight, plan(600.0, 40, seed));
            // A grid of 3 x 3 over the area inside the margin: every part is flown over.
            let mut cells = [0; 9];
            for Frame { pose, .. } in &flight.frames {
                let cell = |p: f64| {
                    let share = (p - MARGIN_M) / (600.0 - 2.0 * MARGIN_M);
                    assert!((0.0..=1.0).contains(&share), "{p}");
                    (share * 3.0).min(2.0) as usize
                };
                cells[cell(pose.x_m) + 3 * cell(pose.y_m)] += 1;
            }
            assert!(cells.iter().all(|&n| n >= 1), "seed {seed}: {cells:?}");
        }
    }

    /// Neighbouring lines are flown in opposite directions, and the camera points along the line but for the wind.
    #[test]
    fn headings_follow_the_direction_of_flight() {
        let flight = plan(2000.0, 400, 5);
        let frames: Vec<&Pose> = flight.frames.iter().map(|f| &f.pose).collect();
        let mut off = Vec::new();
        for pair in frames.windows(2) {
            let (dx, dy) = (pair[1].x_m - pair[0].x_m, pair[1].y_m - pair[0].y_m);
            let course = dx.atan2(dy).to_degrees();
            off.push(turn_deg(course, pair[0].heading_deg).abs());
        }
        off.sort_by(f64::total_cmp);
        let median = off[off.len() / 2];
        assert!(median < 12.0, "median {median}");
        // Along one axis both directions are flown about as often, and the other axis only between the lines.
        let quadrant = |h: f64| ((h + 45.0).rem_euclid(360.0) / 90.0) as usize;
        let mut counts = [0usize; 4];
        frames
            .iter()
            .for_each(|p| counts[quadrant(p.heading_deg)] += 1);
        let (there, back) = if counts[0] + counts[2] > counts[1] + counts[3] {
            (counts[0], counts[2])
        } else {
            (counts[1], counts[3])
        };
        assert!(there > 120 && back > 120, "{counts:?}");
    }

    /// Tilt and the errors of the reported pose have the standard deviations that the documentation and the code give.
    #[test]
    fn tilt_and_reported_errors_have_their_statistics() {
        let flight = plan(4000.0, 2000, 9);
        let all = |value: &dyn Fn(&Frame) -> f64| -> Vec<f64> {
            flight.frames.iter().map(value).collect()
        };
        for (name, values, deviation) in [
            ("pitch", all(&|f| f.pose.pitch_off_nadir_deg), 1.6),
            ("roll", all(&|f| f.pose.roll_deg), 1.2),
            ("east", all(&|f| f.reported.x_m - f.pose.x_m), 1.5),
            ("north", all(&|f| f.reported.y_m - f.pose.y_m), 1.5),
            (
                "height",
                all(&|f| f.reported.height_agl_m - f.pose.height_agl_m),
                1.8,
            ),
            (
                "heading",
                all(&|f| turn_deg(f.pose.heading_deg, f.reported.heading_deg)),
                1.5,
            ),
        ] {
            let (mean, found) = moments(&values);
            // Five standard errors of the mean, and of the standard deviation of 2,000 values.
            assert!(mean.abs() < 0.12 * deviation, "{name}: mean {mean}");
            assert!(
                (found / deviation - 1.0).abs() < 0.08,
                "{name}: deviation {found}, expected {deviation}"
            );
        }
        assert!(
            flight
                .frames
                .iter()
                .all(|f| f.reported.pitch_off_nadir_deg == 0.0 && f.reported.roll_deg == 0.0)
        );
        let heights = all(&|f| f.pose.height_agl_m);
        let (mean, spread) = moments(&heights);
        assert!(
            (mean - 115.0).abs() < 1.5 && (5.0..8.5).contains(&spread),
            "{mean} {spread}"
        );
    }
}
