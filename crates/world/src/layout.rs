//! The plan: districts, roads and blocks, with straight lines in layout coordinates.
//!
//! Districts are Voronoi cells of jittered seeds. Each is cut recursively along its shorter direction
//! until its blocks have the size of its zone; the cuts are roads.

use nalgebra::Vector2;

use crate::convex::{Convex, left_of};
use crate::random::Stream;
use crate::road::{Road, RoadClass};

type V2 = Vector2<f32>;

/// Use of a district.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Zone {
    /// Perimeter blocks with courtyards.
    Centre,
    /// Small crooked parcels, built all over.
    OldTown,
    Terraces,
    Suburb,
    Apartments,
    Industry,
    Park,
    Sports,
    Village,
    Fields,
    Forest,
    Orchard,
    Meadow,
}

impl Zone {
    pub(crate) fn urban(self) -> bool {
        !matches!(
            self,
            Self::Fields | Self::Forest | Self::Orchard | Self::Meadow
        )
    }

    /// Longest and widest block, metres.
    fn block_m(self) -> (f32, f32) {
        match self {
            Self::Centre => (105.0, 80.0),
            Self::OldTown => (80.0, 48.0),
            Self::Terraces => (150.0, 58.0),
            Self::Suburb => (140.0, 68.0),
            Self::Apartments => (150.0, 105.0),
            Self::Industry => (190.0, 130.0),
            Self::Village => (130.0, 75.0),
            Self::Fields => (230.0, 110.0),
            Self::Forest => (280.0, 240.0),
            Self::Orchard => (150.0, 110.0),
            Self::Meadow => (210.0, 170.0),
            Self::Park | Self::Sports => (1.0e4, 1.0e4),
        }
    }

    fn street(self, depth: u32, random: &mut Stream) -> Option<RoadClass> {
        match self {
            Self::Centre | Self::Apartments | Self::Industry => {
                Some(if depth == 0 || random.chance(0.5) {
                    RoadClass::Street
                } else {
                    RoadClass::Lane
                })
            }
            Self::Terraces | Self::Suburb => Some(if depth == 0 {
                RoadClass::Street
            } else {
                RoadClass::Lane
            }),
            Self::OldTown | Self::Village => Some(RoadClass::Lane),
            Self::Fields => random.chance(0.4).then_some(RoadClass::Track),
            Self::Forest => Some(RoadClass::Track),
            Self::Orchard | Self::Meadow => random.chance(0.3).then_some(RoadClass::Track),
            Self::Park | Self::Sports => None,
        }
    }
}

/// A piece of land surrounded by roads or boundaries; its outline already excludes the roads.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    pub(crate) outline: Convex,
    pub(crate) zone: Zone,
}

#[derive(Clone, Debug)]
pub(crate) struct District {
    pub(crate) outline: Convex,
    pub(crate) zone: Zone,
    pub(crate) seed: u32,
}

#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) districts: Vec<District>,
    pub(crate) roads: Vec<Road>,
    pub(crate) blocks: Vec<Block>,
}

/// Position and size of the town.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Town {
    pub(crate) middle: V2,
    pub(crate) radius_m: f32,
}

impl Layout {
    pub(crate) fn new(low: f32, high: f32, town: Town, random: &mut Stream) -> Self {
        let mut layout = Self {
            districts: Vec::new(),
            roads: Vec::new(),
            blocks: Vec::new(),
        };
        let seeds = district_seeds(low, high, town, random);
        let zones: Vec<Zone> = seeds.iter().map(|&s| zone_at(s, town, random)).collect();
        let pair_seed = random.next_u32();
        for i in 0..seeds.len() {
            // Neighbours are kept in the edge widths until the road classes are known.
            let mut cell = Convex::rectangle(V2::repeat(low), V2::repeat(high));
            cell.edge_half_width_m = vec![-1.0; 4];
            for (j, other) in seeds.iter().enumerate() {
                let apart = other - seeds[i];
                if i == j || apart.norm() > 900.0 {
                    continue;
                }
                let mid = (other + seeds[i]) * 0.5;
                if let Some(clipped) = cell.clip_left(mid, left_of(apart.normalize()), j as f32) {
                    cell = clipped;
                }
            }
            let n = cell.points.len();
            for e in 0..n {
                let (a, b) = (cell.points[e], cell.points[(e + 1) % n]);
                let neighbour = cell.edge_half_width_m[e];
                let class = (neighbour >= 0.0)
                    .then(|| boundary_class(i, neighbour as usize, &zones, pair_seed))
                    .flatten();
                cell.edge_half_width_m[e] = class.map_or(0.0, RoadClass::reach_m);
                if let Some(class) = class
                    && (neighbour as usize) > i
                    && (b - a).norm() > 2.0
                {
                    let seed = random.next_u32();
                    let reach = RoadClass::Arterial.reach_m().min(class.reach_m() + 2.0);
                    layout
                        .roads
                        .push(Road::between(a, b, class, seed, [reach, reach]));
                }
            }
            let mut own = random.fork(i as u64);
            layout.districts.push(District {
                outline: cell.clone(),
                zone: zones[i],
                seed: own.next_u32(),
            });
            layout.divide(cell, zones[i], 0, &mut own);
        }
        layout
    }

    fn divide(&mut self, piece: Convex, zone: Zone, depth: u32, random: &mut Stream) {
        let frame = piece.frame();
        let (longest, widest) = zone.block_m();
        let (longest, widest) = (
            longest * random.range(0.8, 1.2),
            widest * random.range(0.85, 1.15),
        );
        let too_long = frame.length_m / longest;
        let too_wide = frame.width_m / widest;
        if (too_long <= 1.3 && too_wide <= 1.3) || depth > 9 {
            if let Some(outline) = piece.inset(0.3)
                && outline.area_m2() > 60.0
            {
                self.blocks.push(Block { outline, zone });
            }
            return;
        }
        let across = left_of(frame.along);
        // Cut along the long axis when the piece is too wide for its kind, else across it.
        let along_cut = too_wide > too_long;
        let parts = if along_cut { too_wide } else { too_long };
        let share = if parts > 2.0 {
            (parts / 2.0).round().max(1.0) / parts
        } else {
            0.5 + random.range(-0.08, 0.08)
        };
        let share = if random.chance(0.5) {
            share
        } else {
            1.0 - share
        }
        .clamp(0.3, 0.7);
        let (dir, extent) = if along_cut {
            (frame.along, frame.width_m)
        } else {
            (across, frame.length_m)
        };
        let tilt = random.normal() * 0.02;
        let dir = (dir + left_of(dir) * tilt).normalize();
        let step = if along_cut { across } else { frame.along };
        let origin = frame.centre + step * (extent * (share - 0.5));
        let class = zone.street(depth, random);
        let width = class.map_or(0.0, RoadClass::reach_m);
        if let (Some(class), Some([(a, wa), (b, wb)])) = (class, piece.chord(origin, dir)) {
            self.roads
                .push(Road::between(a, b, class, random.next_u32(), [wa, wb]));
        }
        for side in [dir, -dir] {
            if let Some(part) = piece.clip_left(origin, side, width) {
                self.divide(part, zone, depth + 1, random);
            }
        }
    }
}

fn district_seeds(low: f32, high: f32, town: Town, random: &mut Stream) -> Vec<V2> {
    let spacing = 215.0;
    let side = ((high - low) / spacing).ceil() as i32;
    let mut seeds = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let shift = if y & 1 == 0 { 0.25 } else { -0.25 };
            let p = V2::new(
                low + (x as f32 + 0.5 + shift + random.range(-0.32, 0.32)) * spacing,
                low + (y as f32 + 0.5 + random.range(-0.32, 0.32)) * spacing,
            );
            // Larger districts in the country.
            if (p - town.middle).norm() > town.radius_m && random.chance(0.3) {
                continue;
            }
            seeds.push(p);
        }
    }
    seeds
}

fn zone_at(p: V2, town: Town, random: &mut Stream) -> Zone {
    let d = (p - town.middle).norm() / town.radius_m + random.normal() * 0.12;
    let roll = random.unit();
    let among = |table: &[(f32, Zone)]| {
        let mut left = roll;
        for &(share, zone) in table {
            if left < share {
                return zone;
            }
            left -= share;
        }
        table[table.len() - 1].1
    };
    if d < 0.35 {
        among(&[
            (0.4, Zone::Centre),
            (0.3, Zone::OldTown),
            (0.2, Zone::Apartments),
            (0.1, Zone::Park),
        ])
    } else if d < 1.0 {
        among(&[
            (0.26, Zone::Suburb),
            (0.18, Zone::Terraces),
            (0.14, Zone::Apartments),
            (0.15, Zone::Industry),
            (0.08, Zone::Park),
            (0.07, Zone::Sports),
            (0.07, Zone::OldTown),
            (0.05, Zone::Centre),
        ])
    } else {
        among(&[
            (0.42, Zone::Fields),
            (0.20, Zone::Forest),
            (0.10, Zone::Meadow),
            (0.10, Zone::Orchard),
            (0.10, Zone::Village),
            (0.08, Zone::Industry),
        ])
    }
}

fn boundary_class(i: usize, j: usize, zones: &[Zone], pair_seed: u32) -> Option<RoadClass> {
    let (low, high) = (i.min(j) as u32, i.max(j) as u32);
    let roll = crate::random::unit(crate::random::hash2(pair_seed ^ low, high));
    match (zones[i].urban(), zones[j].urban()) {
        (true, true) => Some(if roll < 0.4 {
            RoadClass::Arterial
        } else {
            RoadClass::Street
        }),
        (false, false) => match roll {
            r if r < 0.4 => Some(RoadClass::Rural),
            r if r < 0.8 => Some(RoadClass::Track),
            _ => None,
        },
        _ => Some(if roll < 0.35 {
            RoadClass::Street
        } else {
            RoadClass::Rural
        }),
    }
}
