//! Cars: parked in lots, along kerbs, moving on the roads; trees along streets.

use nalgebra::Vector2;

use super::builder::Builder;
use super::site::Site;
use crate::convex::left_of;
use crate::cover::Cover;
use crate::road::RoadClass;
use crate::solid::{Finish, Life, Roof};

type V2 = Vector2<f32>;

const PAINT: [[u8; 3]; 12] = [
    [222, 222, 220],
    [232, 232, 230],
    [214, 214, 212],
    [170, 172, 174],
    [140, 142, 146],
    [54, 54, 58],
    [38, 38, 42],
    [70, 72, 78],
    [58, 76, 112],
    [140, 44, 40],
    [96, 30, 32],
    [120, 110, 90],
];

impl Builder {
    /// A car pointing along `axis`, there in this share of the epochs.
    pub(super) fn car(&mut self, centre: V2, axis: V2, share: f32) {
        let colour = self.random.pick(&PAINT);
        let van = self.random.chance(0.1);
        let half = if van {
            V2::new(2.6, 1.0)
        } else {
            V2::new(self.random.range(2.0, 2.4), 0.9)
        };
        let (finish, top) = if van {
            (Finish::Van, 2.2)
        } else {
            (Finish::Car, 1.45)
        };
        let jitter = V2::new(self.random.range(-0.2, 0.2), self.random.range(-0.15, 0.15));
        let axis = (axis + left_of(axis) * self.random.range(-0.04, 0.04)).normalize();
        let axis = if self.random.chance(0.5) { axis } else { -axis };
        let site = Site {
            centre: centre + jitter,
            axis,
            half,
        };
        self.solid(
            &site,
            0.15,
            top,
            Roof::Flat,
            finish,
            colour,
            colour,
            Life::Moving(share),
        );
    }

    pub(super) fn lorry(&mut self, centre: V2, axis: V2, share: f32) {
        let colour = self.random.pick(&[
            [220, 220, 216],
            [186, 60, 50],
            [60, 90, 140],
            [200, 198, 190],
        ]);
        let site = Site {
            centre,
            axis,
            half: V2::new(self.random.range(4.0, 7.0), 1.25),
        };
        self.solid(
            &site,
            0.3,
            3.6,
            Roof::Flat,
            Finish::Truck,
            colour,
            colour,
            Life::Moving(share),
        );
    }

    /// A parking lot, bays along local u in rows of 16.5 m.
    pub(super) fn parking(&mut self, lot: &Site, share: f32) {
        self.pave(Cover::Stalls, lot, 18);
        self.take(lot);
        let rows = (lot.half.y * 2.0 / 16.5).max(1.0) as i32;
        let columns = (lot.half.x * 2.0 / 2.6) as i32;
        for row in 0..rows {
            for bay in 0..columns {
                for offset in [2.6, 13.9] {
                    let u = -lot.half.x + (bay as f32 + 0.5) * 2.6;
                    let v = -lot.half.y + row as f32 * 16.5 + offset;
                    if v > lot.half.y - 1.5 || self.random.chance(0.12) {
                        continue;
                    }
                    self.car(lot.at(u, v), left_of(lot.axis), share);
                }
            }
        }
    }

    pub(super) fn add_traffic(&mut self) {
        for i in 0..self.ground.roads.len() {
            let road = self.ground.roads[i].clone();
            let (half, length) = (road.class.half_m(), road.length_m);
            let (parked, moving) = match road.class {
                RoadClass::Arterial => (0.0, 0.16),
                RoadClass::Street => (0.45, 0.10),
                RoadClass::Lane => (0.28, 0.02),
                RoadClass::Rural => (0.0, 0.04),
                RoadClass::Track => continue,
            };
            let busy = self.random.range(0.3, 1.3);
            let (from, to) = (road.crossing_m[0] + 8.0, length - road.crossing_m[1] - 8.0);
            let mut along = from;
            while along < to {
                for side in [-1.0, 1.0] {
                    if parked > 0.0 && self.random.chance(parked * 1.3) {
                        let q = road.at(along, side * (half - 1.05));
                        self.car_on(q, road.dir, parked * busy);
                    }
                    if self.random.chance(0.5) {
                        let lane = if road.class == RoadClass::Arterial {
                            self.random.pick(&[0.25, 0.75])
                        } else {
                            0.5
                        };
                        let q = road.at(along + self.random.range(-1.5, 1.5), side * half * lane);
                        self.car_on(q, road.dir, moving * busy);
                    }
                }
                along += self.random.range(5.8, 7.0);
            }
        }
    }

    fn car_on(&mut self, q: V2, dir: V2, share: f32) {
        let p = self.ground.warp.world_from_layout(q);
        let axis = self.ground.warp.world_direction(q, dir);
        if self.random.chance(0.03) {
            self.lorry(p, axis, share);
        } else {
            self.car(p, axis, share);
        }
    }

    pub(super) fn add_street_trees(&mut self) {
        for i in 0..self.ground.roads.len() {
            let road = self.ground.roads[i].clone();
            let chance = match road.class {
                RoadClass::Arterial => 0.7,
                RoadClass::Street => 0.5,
                RoadClass::Lane => 0.15,
                RoadClass::Rural => 0.3,
                RoadClass::Track => 0.25,
            };
            for side in [-1.0_f32, 1.0] {
                if !self.random.chance(chance) {
                    continue;
                }
                let species = self.any_species();
                let size = self.random.range(2.0, 4.2);
                let step = size * self.random.range(2.2, 5.0);
                let beside = road.class.half_m()
                    + self.random.range(1.0, 2.0)
                    + if road.class <= RoadClass::Rural && road.class != RoadClass::Lane {
                        1.5
                    } else {
                        0.0
                    };
                let mut along = road.crossing_m[0] + 6.0;
                while along < road.length_m - road.crossing_m[1] - 6.0 {
                    if self.random.chance(0.88) {
                        let q = road.at(along + self.random.normal() * 0.7, side * beside);
                        let p = self.ground.warp.world_from_layout(q);
                        let radius = size * self.random.range(0.7, 1.25);
                        if !self.crowded(p) {
                            self.tree_anywhere(p, radius, species);
                        }
                    }
                    along += step;
                }
            }
        }
    }

    /// Whether a street tree would stand in a house or on the carriageway.
    fn crowded(&self, p: V2) -> bool {
        self.ground.on_road(p, 0.3) || self.occupancy.thing(p)
    }
}
