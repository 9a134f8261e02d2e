//! Roads as drawn in the layout: carriageway, markings, repairs, pavements.

use nalgebra::Vector2;

use crate::bucket_grid::Extent;
use crate::colour::{Rgb, rgb8};
use crate::convex::left_of;
use crate::grass::grass;
use crate::ground_noise::GroundNoise;
use crate::look::Season;
use crate::noise::fbm;
use crate::random::{hash_cell, hash2, unit};

type V2 = Vector2<f32>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum RoadClass {
    /// Two ruts between fields.
    Track,
    /// Residential, without markings.
    Lane,
    /// Between villages: edge lines, no pavement.
    Rural,
    /// Two marked lanes, pavements.
    Street,
    /// Four lanes.
    Arterial,
}

impl RoadClass {
    /// Half the carriageway, metres.
    pub(crate) fn half_m(self) -> f32 {
        match self {
            Self::Track => 1.6,
            Self::Lane => 2.8,
            Self::Rural => 3.3,
            Self::Street => 4.2,
            Self::Arterial => 7.4,
        }
    }

    /// Pavement or verge beside the carriageway, metres.
    pub(crate) fn pavement_m(self) -> f32 {
        match self {
            Self::Track => 0.6,
            Self::Lane => 1.5,
            Self::Rural => 1.4,
            Self::Street => 2.2,
            Self::Arterial => 3.2,
        }
    }

    /// Centre line to parcel, metres.
    pub(crate) fn reach_m(self) -> f32 {
        self.half_m() + self.pavement_m()
    }
}

/// A straight road in the layout.
#[derive(Clone, Debug)]
pub(crate) struct Road {
    pub(crate) start: V2,
    pub(crate) dir: V2,
    pub(crate) length_m: f32,
    pub(crate) class: RoadClass,
    pub(crate) seed: u32,
    /// Reach of the roads met at the start and the end.
    pub(crate) crossing_m: [f32; 2],
}

/// Appearance of a point on or beside a road.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RoadSurface {
    pub(crate) albedo: Rgb,
    /// A number that differs between surfaces whose border is antialiased.
    pub(crate) id: u32,
}

struct Place {
    along: f32,
    side: f32,
    distance: f32,
}

impl Place {
    fn on_line(&self, road: &Road) -> bool {
        self.along >= 0.0 && self.along <= road.length_m
    }
}

impl Road {
    pub(crate) fn between(a: V2, b: V2, class: RoadClass, seed: u32, crossing_m: [f32; 2]) -> Self {
        let d = b - a;
        let length_m = d.norm().max(1e-3);
        Self {
            start: a,
            dir: d / length_m,
            length_m,
            class,
            seed,
            crossing_m,
        }
    }

    pub(crate) fn at(&self, along_m: f32, side_m: f32) -> V2 {
        self.start + self.dir * along_m + left_of(self.dir) * side_m
    }

    #[inline]
    fn place(&self, q: V2) -> Place {
        let d = q - self.start;
        let along = d.dot(&self.dir);
        let side = d.dot(&left_of(self.dir));
        let over = (-along).max(along - self.length_m).max(0.0);
        Place {
            along,
            side,
            distance: if over > 0.0 {
                side.hypot(over)
            } else {
                side.abs()
            },
        }
    }

    /// Distance beyond the edge of the carriageway; negative on it.
    pub(crate) fn beyond_kerb_m(&self, q: V2) -> f32 {
        self.place(q).distance - self.class.half_m()
    }
}

impl Extent for Road {
    fn bounds(&self) -> (V2, V2) {
        let end = self.at(self.length_m, 0.0);
        let r = V2::repeat(self.class.reach_m());
        (self.start.inf(&end) - r, self.start.sup(&end) + r)
    }

    fn near(&self, centre: V2, radius_m: f32) -> bool {
        self.place(centre).distance < self.class.reach_m() + radius_m
    }
}

/// Appearance of a layout point on one of the roads near it; `None` if it is not on a road or pavement.
pub(crate) fn road_surface(
    roads: &[Road],
    near: &[u32],
    q: V2,
    noise: &GroundNoise,
    season: Season,
) -> Option<RoadSurface> {
    let mut on: Option<(&Road, Place)> = None;
    let mut crossing = false;
    let mut beside: Option<(&Road, f32, Place)> = None;
    for &i in near {
        let road = &roads[i as usize];
        let place = road.place(q);
        let beyond = place.distance - road.class.half_m();
        if beyond < 0.0 {
            crossing |= on.is_some();
            // A road's rounded end never covers another road.
            let rank = |r: &Road, p: &Place| (p.on_line(r), r.class);
            if on
                .as_ref()
                .is_none_or(|(r, p)| rank(road, &place) > rank(r, p))
            {
                on = Some((road, place));
            }
        } else if beyond < road.class.pavement_m()
            && beside.as_ref().is_none_or(|(_, b, _)| beyond < *b)
        {
            beside = Some((road, beyond, place));
        }
    }
    if let Some((road, place)) = on {
        return Some(carriageway(road, &place, crossing, noise, season));
    }
    beside.map(|(road, beyond, place)| pavement(road, beyond, &place, noise, season))
}

fn asphalt_tone(seed: u32) -> Rgb {
    let t = unit(hash2(seed, 5));
    rgb8(78, 78, 80).mix(rgb8(132, 128, 122), t)
}

fn carriageway(
    road: &Road,
    place: &Place,
    crossing: bool,
    noise: &GroundNoise,
    season: Season,
) -> RoadSurface {
    let (along, side) = (place.along, place.side);
    let half = road.class.half_m();
    if road.class == RoadClass::Track {
        let soil = rgb8(150, 132, 104).mix(rgb8(118, 100, 76), 0.5 + 0.5 * noise.mid);
        let green = grass(season, 0.35 + 0.2 * noise.mid);
        let rut = ((side.abs() - 0.85).abs() * 1.6 + 0.35 * noise.fine + 0.25 * noise.mid)
            .clamp(0.0, 1.0);
        return RoadSurface {
            albedo: soil.mix(green, rut * 0.8),
            id: 3,
        };
    }
    let mut tone = 1.0 + 0.10 * noise.fine + 0.10 * noise.mid + 0.12 * noise.coarse;
    let lanes = if road.class == RoadClass::Arterial {
        4.0
    } else {
        2.0
    };
    let lane_m = 2.0 * half / lanes;
    let lane_phase = (side + half) / lane_m;
    // Wheel paths wear lighter, the middle of a lane gathers oil.
    let in_lane = lane_phase - lane_phase.floor() - 0.5;
    tone *= 1.0 + 0.07 * (in_lane.abs() * 12.0).cos() * -0.8;
    let mut id = 8;
    // Repairs: rectangles of other asphalt in some stretches of each lane.
    let stretch = (along / 6.5).floor();
    let patch = hash_cell(road.seed, stretch as i32, lane_phase.floor() as i32);
    if patch.is_multiple_of(4) {
        let u = along / 6.5 - stretch;
        let (lo, hi) = (
            0.5 * unit(patch >> 3),
            0.55 + 0.45 * unit(patch.rotate_left(9)),
        );
        if u > lo && u < hi && in_lane.abs() < 0.22 + 0.28 * unit(patch.rotate_left(17)) {
            tone *= 0.72 + 0.5 * unit(patch.rotate_left(21));
            id = 9 + (patch >> 16 & 7);
        }
    }
    // A resurfaced stretch here and there.
    let section = hash_cell(road.seed ^ 77, (along / 55.0).floor() as i32, 0);
    tone *= 0.88 + 0.26 * unit(section);
    // Sealed cracks.
    let crack =
        (unit(section) - 0.5) * half + fbm(along * 1.6 + unit(road.seed) * 500.0, 40.0) * 1.6;
    let gap = fbm(along * 0.9, 77.0 + unit(road.seed) * 300.0);
    if (side - crack).abs() < 0.06 && section.is_multiple_of(3) && gap > 0.1 {
        tone *= 0.6;
    }
    let mut albedo = asphalt_tone(road.seed) * (tone * tone).max(0.1);
    if !crossing {
        let paint = marking(road, along, side, lane_m, lanes);
        if let Some((colour, strength)) = paint {
            let worn = (strength * (0.75 + 0.5 * noise.fine + 0.3 * noise.mid)).clamp(0.0, 0.95);
            albedo = albedo.mix(colour, worn);
            id += 32;
        }
    }
    RoadSurface { albedo, id }
}

/// Paint at a place on the carriageway: colour and strength.
fn marking(road: &Road, along: f32, side: f32, lane_m: f32, lanes: f32) -> Option<(Rgb, f32)> {
    const WHITE: Rgb = rgb8(225, 225, 220);
    const YELLOW: Rgb = rgb8(214, 170, 70);
    if road.class <= RoadClass::Lane {
        return None;
    }
    let half = road.class.half_m();
    let yellow = road.seed.is_multiple_of(3);
    let from_start = along - road.crossing_m[0];
    let from_end = road.length_m - road.crossing_m[1] - along;
    let end = from_start.min(from_end);
    if end < 0.3 {
        return None;
    }
    let town = road.class != RoadClass::Rural;
    let zebra = town && hash2(road.seed, u32::from(from_start < from_end)) % 8 < 6;
    if zebra {
        if end < 3.6 {
            let stripe = (side + 40.0).rem_euclid(1.0);
            return (end > 0.8 && stripe < 0.5 && side.abs() < half - 0.3).then_some((WHITE, 0.95));
        }
        if (4.6..5.1).contains(&end) {
            let leaving = (side < 0.0) == (from_start < from_end);
            return (!leaving && side.abs() > 0.2).then_some((WHITE, 0.95));
        }
        if end < 5.4 {
            return None;
        }
    }
    let dash = |on: f32, period: f32| along.rem_euclid(period) < on;
    // Arrows in the approach lanes.
    if town && (9.0..12.5).contains(&end) {
        let approaching = (side > 0.0) == (from_start < from_end);
        let in_lane = (side.abs() / lane_m).fract() - 0.5;
        let head = end < 10.4;
        let wide = if head { (end - 9.0) * 0.32 } else { 0.10 };
        if approaching && (in_lane * lane_m).abs() < wide {
            return Some((WHITE, 0.9));
        }
    }
    let centre = side.abs();
    if lanes > 3.0 {
        if (0.12..0.30).contains(&centre) {
            return Some((if yellow { YELLOW } else { WHITE }, 0.9));
        }
        if (centre - lane_m).abs() < 0.09 && dash(4.0, 10.0) {
            return Some((WHITE, 0.85));
        }
        if (centre - (half - 0.45)).abs() < 0.09 {
            return Some((WHITE, 0.8));
        }
    } else {
        if centre < 0.09 && (dash(3.0, if town { 7.5 } else { 9.0 }) || end < 16.0) {
            return Some((if yellow { YELLOW } else { WHITE }, 0.85));
        }
        if (centre - (half - 0.28)).abs() < 0.08 && (!town || road.seed & 8 == 0) {
            return Some((WHITE, 0.7));
        }
    }
    // Parking bays along some streets.
    if road.class == RoadClass::Street && road.seed & 16 == 0 && end > 10.0 {
        let edge = half - 2.1;
        if side > edge && along.rem_euclid(5.6) < 0.12 {
            return Some((WHITE, 0.7));
        }
    }
    None
}

fn pavement(
    road: &Road,
    beyond: f32,
    place: &Place,
    noise: &GroundNoise,
    season: Season,
) -> RoadSurface {
    let green = || grass(season, 0.5 + 0.4 * noise.mid) * (1.0 + 0.25 * noise.fine);
    if road.class <= RoadClass::Track || road.class == RoadClass::Rural {
        let dust = rgb8(150, 140, 118) * (1.0 + 0.2 * noise.fine);
        let edge = (1.0 - beyond / 0.7 + 0.8 * noise.fine).clamp(0.0, 1.0);
        return RoadSurface {
            albedo: green().mix(dust, edge * 0.8),
            id: 4,
        };
    }
    if beyond < 0.22 {
        let kerb = rgb8(176, 174, 168) * (1.0 + 0.1 * noise.fine);
        return RoadSurface {
            albedo: kerb,
            id: 5,
        };
    }
    // Some pavements have a strip of grass next to the kerb.
    if road.seed & 0x60 == 0 && beyond < 1.2 {
        return RoadSurface {
            albedo: green(),
            id: 6,
        };
    }
    let base = match road.seed >> 8 & 3 {
        0 => rgb8(156, 150, 142),
        1 => rgb8(170, 160, 146),
        2 => rgb8(160, 132, 118),
        _ => rgb8(132, 130, 128),
    };
    let stretch = hash_cell(
        road.seed,
        (place.along / 14.0).floor() as i32,
        (place.side > 0.0) as i32,
    );
    let joint = place.along.rem_euclid(2.4) < 0.14;
    let tone = (1.0 + 0.12 * noise.fine + 0.12 * noise.mid) * (0.86 + 0.28 * unit(stretch));
    RoadSurface {
        albedo: base * (tone * if joint { 0.82 } else { 1.0 }),
        id: 7,
    }
}
