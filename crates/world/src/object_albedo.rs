//! Colour of solids and trees where a ray hits them.

use nalgebra::Vector3;

use crate::colour::{Rgb, rgb8, toned};
use crate::look::Season;
use crate::noise::fbm;
use crate::random::{hash_cell, hash2, unit};
use crate::solid::{Finish, Roof, Solid};
use crate::solid_ray::{Face, SolidHit};
use crate::tree::{Species, Tree, TreeHit};

type V3 = Vector3<f32>;

pub(crate) fn tree_albedo(tree: &Tree, hit: &TreeHit, season: Season) -> Rgb {
    let a = unit(hash2(tree.seed, 1));
    let b = unit(hash2(tree.seed, 2));
    if tree.bare(season) {
        return rgb8(128, 112, 96).mix(rgb8(98, 86, 76), a);
    }
    let leaf = match (tree.species, season) {
        (Species::Conifer, _) => rgb8(58, 78, 50).mix(rgb8(72, 92, 62), a),
        (Species::Evergreen, _) => rgb8(74, 96, 50).mix(rgb8(96, 112, 62), a),
        (_, Season::Spring) => rgb8(122, 148, 70).mix(rgb8(96, 126, 56), a),
        (_, Season::Summer) => rgb8(78, 108, 48)
            .mix(rgb8(110, 130, 66), a)
            .mix(rgb8(88, 116, 76), b * 0.5),
        (_, Season::Autumn) => {
            let turned = match tree.seed & 3 {
                0 => rgb8(178, 140, 60),
                1 => rgb8(158, 98, 54),
                2 => rgb8(138, 126, 62),
                _ => rgb8(104, 116, 58),
            };
            turned.mix(rgb8(110, 112, 60), a * 0.6)
        }
        (_, Season::Winter) => rgb8(96, 104, 70),
    };
    leaf * (0.9 + 0.35 * b - 0.12 * hit.rho)
}

fn rgb_of(c: [u8; 3]) -> Rgb {
    rgb8(c[0], c[1], c[2])
}

pub(crate) fn solid_albedo(
    solid: &Solid,
    hit: &SolidHit,
    p: V3,
    season: Season,
    pixel_m: f32,
) -> Rgb {
    match (solid.finish, hit.face) {
        (Finish::Car | Finish::Van | Finish::Truck, face) => vehicle(solid, hit, p, face),
        (Finish::Hedge, _) => {
            let n = fbm(p.x * 14.0, p.y * 14.0 + p.z * 9.0);
            let brown = if season == Season::Winter { 0.5 } else { 0.0 };
            toned(
                rgb_of(solid.roof_rgb).mix(rgb8(104, 90, 70), brown),
                1.0 + 0.35 * n,
            )
        }
        (_, Face::Wall) => wall(solid, hit, p),
        (_, Face::Roof) => roof(solid, hit, pixel_m),
    }
}

fn wall(solid: &Solid, hit: &SolidHit, p: V3) -> Rgb {
    let base = rgb_of(solid.wall_rgb);
    let along = if hit.face_index < 2 {
        hit.local.y
    } else {
        hit.local.x
    };
    let height = p.z - solid.base_m;
    let stain = 1.0 + 0.08 * fbm(along * 3.0 + unit(solid.seed) * 99.0, height * 2.0);
    if solid.finish == Finish::Glass {
        return toned(base, stain);
    }
    let tall = solid.eaves_m - solid.base_m;
    if tall < 2.4 || solid.finish == Finish::Plain {
        return toned(base, stain);
    }
    if solid.finish == Finish::Metal {
        let door = along.rem_euclid(11.0) < 4.0 && height < 3.8;
        return toned(base, stain * if door { 0.7 } else { 1.0 });
    }
    // Windows: one row a storey.
    let storey = (height - 0.9).rem_euclid(3.1);
    let bay = 2.2 + 1.6 * unit(hash2(solid.seed, 4));
    let across = along.rem_euclid(bay);
    if storey < 1.5 && across > bay * 0.28 && across < bay * 0.72 && height < tall - 0.4 {
        return rgb8(58, 64, 72);
    }
    toned(base, stain)
}

/// A point of a roof.
struct RoofPoint {
    base: Rgb,
    /// Metres from the middle, along the ridge and across it.
    u: f32,
    v: f32,
    /// Stains, about -1 to 1.
    grime: f32,
    /// Finer wear, about -1 to 1; fades where a pixel cannot resolve it.
    fine: f32,
    /// Distance to the nearest edge, metres.
    edge: f32,
    /// Size of a pixel on the ground, metres.
    pixel_m: f32,
}

impl RoofPoint {
    /// How well a pattern of this period (metres) is resolved: 0 not at all, 1 fully.
    fn resolved(&self, period_m: f32) -> f32 {
        ((period_m / self.pixel_m - 1.5) * 0.8).clamp(0.0, 1.0)
    }
}

fn roof(solid: &Solid, hit: &SolidHit, pixel_m: f32) -> Rgb {
    let (u, v) = (hit.local.x, hit.local.y);
    let shift = unit(solid.seed) * 430.0;
    let edge = solid.half.x - u.abs();
    let at = RoofPoint {
        base: rgb_of(solid.roof_rgb),
        u,
        v,
        // Stains and wear at two scales, fixed to the roof.
        grime: fbm(u * 2.2 + shift, v * 2.2 - shift),
        fine: fbm(u * 9.0 - shift, v * 9.0 + shift) * (0.22 / pixel_m).min(1.2),
        edge: edge.min(solid.half.y - v.abs()),
        pixel_m,
    };
    match solid.finish {
        Finish::Tiles => tiled_roof(solid, hit, &at),
        Finish::Metal => metal_roof(solid, &at),
        Finish::Bitumen | Finish::Gravel | Finish::Membrane | Finish::Slab => flat_roof(solid, &at),
        finish => other_roof(finish, &at),
    }
}

fn tiled_roof(solid: &Solid, hit: &SolidHit, at: &RoofPoint) -> Rgb {
    let RoofPoint {
        base,
        u,
        v,
        grime,
        fine,
        ..
    } = *at;
    let down = if hit.face_index >= 8 { u } else { v };
    let course = (down * (std::f32::consts::TAU / 0.42)).cos() * 0.05 * at.resolved(0.42);
    let ridge = match solid.roof {
        Roof::Gable(_) => v.abs(),
        Roof::Hip(_) => {
            let h = solid.half;
            let on_ridge = if u.abs() < h.x - h.y {
                v.abs()
            } else {
                f32::INFINITY
            };
            on_ridge.min(((h.x - u.abs()) - (h.y - v.abs())).abs() * 0.7)
        }
        _ => f32::INFINITY,
    };
    let cap = if ridge < 0.17 { 0.14 } else { 0.0 };
    let moss = (grime * 1.4 - 0.35).clamp(0.0, 0.5);
    let replaced = hash_cell(
        solid.seed,
        (u / 1.7).floor() as i32,
        (down / 1.3).floor() as i32,
    );
    let swap = if replaced.is_multiple_of(29) {
        0.12
    } else {
        0.0
    };
    toned(
        base.mix(rgb8(84, 84, 62), moss * 0.5),
        1.0 + course + cap + swap + 0.10 * fine + 0.08 * grime,
    )
}

fn metal_roof(solid: &Solid, at: &RoofPoint) -> Rgb {
    let RoofPoint {
        base,
        u,
        v,
        grime,
        fine,
        edge,
        ..
    } = *at;
    let pitch = if solid.half.x * solid.half.y > 300.0 {
        1.1
    } else {
        0.7
    };
    let seam = if u.rem_euclid(pitch) < 0.16 {
        -0.09 * at.resolved(pitch)
    } else {
        0.0
    };
    let sheet = hash_cell(
        solid.seed,
        (u / 3.3).floor() as i32,
        (v / 7.0).floor() as i32,
    );
    let rust = ((grime * 1.6 - 0.3).clamp(0.0, 0.8)) * if solid.seed & 3 == 0 { 1.0 } else { 0.25 };
    // Light strips of translucent sheet.
    let strip = solid.seed & 12 == 0
        && u.rem_euclid(7.0) < 1.0
        && v.abs() < solid.half.y * 0.85
        && v.abs() > 0.6;
    if strip {
        return toned(rgb8(202, 206, 196), 1.0 + 0.05 * fine);
    }
    let tone = 1.0
        + seam
        + 0.07 * (unit(sheet) - 0.5)
        + 0.06 * fine
        + 0.07 * grime
        + if edge < 0.25 { 0.08 } else { 0.0 };
    toned(base.mix(rgb8(140, 96, 70), rust), tone)
}

/// A flat roof with a parapet.
fn flat_roof(solid: &Solid, at: &RoofPoint) -> Rgb {
    let RoofPoint {
        base,
        u,
        v,
        grime,
        fine,
        edge,
        ..
    } = *at;
    if edge < 0.35 {
        // Parapet.
        return toned(rgb_of(solid.wall_rgb), 0.98 + 0.06 * fine);
    }
    let damp = if edge < 1.1 { -0.10 } else { 0.0 };
    let field = hash_cell(
        solid.seed,
        (u / 4.2).floor() as i32,
        (v / 5.3).floor() as i32,
    );
    let joint = if u.rem_euclid(4.2) < 0.14 || v.rem_euclid(5.3) < 0.14 {
        -0.08
    } else {
        0.0
    };
    let pool = -0.16 * ((grime - 0.25) * 3.0).clamp(0.0, 1.0);
    let patch = if field.is_multiple_of(7) {
        0.12 * (unit(field) - 0.5) * 2.0
    } else {
        0.0
    };
    toned(
        base,
        1.0 + damp + joint + pool + patch + 0.12 * fine + 0.08 * grime,
    )
}

fn other_roof(finish: Finish, at: &RoofPoint) -> Rgb {
    let RoofPoint {
        base,
        u,
        v,
        grime,
        fine,
        edge,
        ..
    } = *at;
    match finish {
        Finish::Glass => {
            let bar = u.rem_euclid(1.5) < 0.14 || v.rem_euclid(1.5) < 0.14;
            let hazy = toned(base, 0.85 + 0.10 * fine + 0.15 * grime);
            if bar { toned(hazy, 1.12) } else { hazy }
        }
        Finish::Solar => {
            let frame = u.rem_euclid(1.05) < 0.09 || v.rem_euclid(1.75) < 0.09;
            if frame {
                rgb8(150, 154, 160)
            } else {
                toned(base, 1.0 + 0.06 * fine)
            }
        }
        Finish::Wood => {
            let plank = if u.rem_euclid(0.6) < 0.1 { -0.1 } else { 0.0 };
            toned(base, 1.0 + plank + 0.1 * fine + 0.08 * grime)
        }
        _ => toned(
            base,
            1.0 + 0.05 * fine + 0.06 * grime + if edge < 0.2 { 0.05 } else { 0.0 },
        ),
    }
}

fn vehicle(solid: &Solid, hit: &SolidHit, p: V3, face: Face) -> Rgb {
    let paint = rgb_of(solid.roof_rgb);
    const PANE: Rgb = rgb8(46, 52, 60);
    if face == Face::Wall {
        let low = p.z < 0.45;
        let glazed = solid.finish == Finish::Car && p.z > 0.9;
        return if low {
            rgb8(40, 40, 42)
        } else if glazed {
            PANE
        } else {
            paint * 0.9
        };
    }
    let (x, y) = (hit.local.x / solid.half.x, hit.local.y.abs() / solid.half.y);
    match solid.finish {
        Finish::Car => {
            if (0.12..0.42).contains(&x) && y < 0.86
                || (-0.78..-0.56).contains(&x) && y < 0.8
                || (-0.56..0.12).contains(&x) && y > 0.8
            {
                PANE
            } else if x.abs() > 0.95 || y > 0.95 {
                paint * 0.7
            } else {
                paint * if x > 0.42 { 0.94 } else { 1.05 }
            }
        }
        Finish::Van => {
            if (0.62..0.84).contains(&x) && y < 0.88 {
                PANE
            } else {
                paint
            }
        }
        _ => {
            // Cab in front, load behind.
            if x > 0.66 {
                if (0.88..0.97).contains(&x) {
                    PANE
                } else {
                    paint
                }
            } else if x > 0.6 {
                rgb8(50, 50, 52)
            } else {
                let load = if solid.seed & 1 == 0 {
                    rgb8(210, 208, 202)
                } else {
                    paint
                };
                let rib = if hit.local.x.rem_euclid(1.3) < 0.12 {
                    0.92
                } else {
                    1.0
                };
                toned(load, rib)
            }
        }
    }
}
