//! A straight flight from one kind of land to others.

use crate::camera::Pose;
use crate::flight::Frame;
use crate::random::Stream;
use crate::world::{Land, World};

/// Least distance from the edge of the map, metres, so that photos lie on it.
const MARGIN_M: f64 = 95.0;
/// Lines that are compared.
const CANDIDATES: usize = 400;
/// A line is looked at so often.
const SAMPLES: usize = 50;
/// Height above the ground, metres.
const HEIGHT_AGL_M: f64 = 115.0;
/// Tilt of the camera that the gimbal does not hold away, degrees, 1 sigma.
const TILT_DEG: f64 = 1.5;
/// Error of the reported tilt, degrees, 1 sigma.
const TILT_ERROR_DEG: f64 = 0.5;
/// Error of the reported heading, degrees, 1 sigma.
const HEADING_ERROR_DEG: f64 = 1.5;

/// Frames at even times along a line that crosses town, countryside and water, as far as the world has them.
#[derive(Clone, Debug, PartialEq)]
pub struct Crossing {
    /// In the order of flight.
    pub frames: Vec<Frame>,
    /// Share of the line over town, countryside and water.
    pub shares: [f64; 3],
}

impl Crossing {
    /// Plans `count` frames, `spacing_m` apart (closer in a small world).
    pub fn plan(world: &World, count: usize, spacing_m: f64, seed: u64) -> Self {
        let mut random = Stream::new(seed ^ 0xc055);
        let size_m = world.size_m();
        let margin_m = MARGIN_M.min(size_m * 0.25);
        let inner_m = size_m - 2.0 * margin_m;
        let length_m = (spacing_m * count.saturating_sub(1) as f64).min(0.9 * inner_m);
        let mut best: Option<(f64, Line, [f64; 3])> = None;
        for _ in 0..CANDIDATES {
            let line = Line {
                from_m: [0, 1].map(|_| margin_m + inner_m * f64::from(random.range(0.0, 1.0))),
                heading_deg: f64::from(random.range(0.0, 360.0)),
                length_m,
            };
            let inside = |p: f64| (margin_m..=size_m - margin_m).contains(&p);
            if !line.at(1.0).into_iter().all(inside) {
                continue;
            }
            let shares = line.shares(world);
            // Half of it town, so that the flight begins and ends with what can be recognised; water as much as there is.
            let score = shares[0].min(0.5) + shares[1].min(0.25) + shares[2].min(0.25) * 2.0;
            if best.as_ref().is_none_or(|(most, ..)| score > *most) {
                best = Some((score, line, shares));
            }
        }
        let (line, shares) = best.map_or_else(
            || {
                let middle = Line {
                    from_m: [size_m / 2.0; 2],
                    heading_deg: 0.0,
                    length_m: 0.0,
                };
                let shares = middle.shares(world);
                (middle, shares)
            },
            |(_, line, shares)| (line, shares),
        );
        let frames = (0..count)
            .map(|number| {
                line.frame(
                    number as f64 / count.saturating_sub(1).max(1) as f64,
                    &mut random,
                )
            })
            .collect();
        Self { frames, shares }
    }
}

/// A straight line over the ground.
struct Line {
    from_m: [f64; 2],
    heading_deg: f64,
    length_m: f64,
}

impl Line {
    /// The place at a share of its length.
    fn at(&self, share: f64) -> [f64; 2] {
        let (sin, cos) = self.heading_deg.to_radians().sin_cos();
        let along_m = share * self.length_m;
        [
            self.from_m[0] + along_m * sin,
            self.from_m[1] + along_m * cos,
        ]
    }

    fn shares(&self, world: &World) -> [f64; 3] {
        let mut shares = [0.0; 3];
        for sample in 0..SAMPLES {
            let [x_m, y_m] = self.at((sample as f64 + 0.5) / SAMPLES as f64);
            let kind = match world.land_at(x_m, y_m) {
                Land::Town => 0,
                Land::Countryside => 1,
                Land::Water => 2,
            };
            shares[kind] += 1.0 / SAMPLES as f64;
        }
        shares
    }

    fn frame(&self, share: f64, random: &mut Stream) -> Frame {
        let mut normal = |deviation: f64| f64::from(random.normal()) * deviation;
        let [x_m, y_m] = self.at(share);
        let pose = Pose {
            x_m,
            y_m,
            height_agl_m: HEIGHT_AGL_M,
            heading_deg: (self.heading_deg + normal(2.0)).rem_euclid(360.0),
            pitch_off_nadir_deg: normal(TILT_DEG),
            roll_deg: 0.0,
        };
        let reported = Pose {
            x_m: pose.x_m + normal(1.5),
            y_m: pose.y_m + normal(1.5),
            height_agl_m: pose.height_agl_m + normal(1.8),
            heading_deg: (pose.heading_deg + normal(HEADING_ERROR_DEG)).rem_euclid(360.0),
            pitch_off_nadir_deg: pose.pitch_off_nadir_deg + normal(TILT_ERROR_DEG),
            roll_deg: 0.0,
        };
        Frame { pose, reported }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::WorldConfig;

    #[test]
    fn the_line_crosses_what_the_world_has() {
        let world = World::new(WorldConfig {
            seed: 7,
            ..WorldConfig::default()
        });
        let crossing = Crossing::plan(&world, 36, 14.0, 7);
        assert_eq!(crossing, Crossing::plan(&world, 36, 14.0, 7));
        assert_eq!(crossing.frames.len(), 36);
        let [town, countryside, water] = crossing.shares;
        assert!(
            town > 0.3 && countryside > 0.1 && water > 0.03,
            "{:?}",
            crossing.shares
        );
        for pair in crossing.frames.windows(2) {
            let step_m =
                (pair[1].pose.x_m - pair[0].pose.x_m).hypot(pair[1].pose.y_m - pair[0].pose.y_m);
            assert!((step_m - 14.0).abs() < 1e-6);
        }
        for frame in &crossing.frames {
            assert!((90.0..=1110.0).contains(&frame.pose.x_m));
            assert!((90.0..=1110.0).contains(&frame.pose.y_m));
        }
    }

    #[test]
    fn the_smallest_world_and_no_frames() {
        let world = World::new(WorldConfig {
            size_m: 100.0,
            ..WorldConfig::default()
        });
        assert_eq!(Crossing::plan(&world, 0, 14.0, 1).frames.len(), 0);
        assert_eq!(Crossing::plan(&world, 5, 14.0, 1).frames.len(), 5);
    }
}
