//! The world under construction, and the primitives that all kinds of blocks are built from.

use nalgebra::Vector2;

use super::occupancy::{Holder, Occupancy};
use super::site::Site;
use crate::convex::Convex;
use crate::cover::{Cover, Patch, Shape};
use crate::ground::Ground;
use crate::random::Stream;
use crate::solid::{Finish, Life, Roof, Solid};
use crate::tree::{Species, Tree};

type V2 = Vector2<f32>;

/// The local style of building: every town has a few roof colours that prevail.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    pub(super) tiles: [[u8; 3]; 3],
    /// Share of flat roofs among town houses.
    pub(super) flat: f32,
}

pub(super) const STYLES: [Style; 5] = [
    Style {
        tiles: [[172, 98, 72], [158, 84, 62], [186, 118, 88]],
        flat: 0.25,
    },
    Style {
        tiles: [[92, 92, 98], [112, 106, 106], [78, 76, 82]],
        flat: 0.3,
    },
    Style {
        tiles: [[128, 104, 88], [108, 90, 80], [150, 132, 116]],
        flat: 0.35,
    },
    Style {
        tiles: [[170, 104, 80], [96, 94, 98], [130, 84, 70]],
        flat: 0.3,
    },
    Style {
        tiles: [[146, 78, 66], [196, 190, 180], [110, 124, 134]],
        flat: 0.6,
    },
];

/// The world under construction.
pub(super) struct Builder {
    pub(super) ground: Ground,
    pub(super) solids: Vec<Solid>,
    pub(super) trees: Vec<Tree>,
    pub(super) patches: Vec<Patch>,
    pub(super) parcels: Vec<Patch>,
    pub(super) occupancy: Occupancy,
    pub(super) style: Style,
    pub(super) random: Stream,
}

impl Builder {
    pub(super) fn mark_roads(&mut self) {
        let side = self.occupancy.side;
        for y in 0..side {
            for x in 0..side {
                let p = V2::new(x as f32 + 0.5, y as f32 + 0.5) + V2::repeat(self.occupancy.low);
                if self.ground.on_road(p, 0.8) {
                    self.occupancy.cells[y * side + x] = Holder::Road;
                }
            }
        }
    }

    pub(super) fn seed(&mut self) -> u32 {
        self.random.next_u32()
    }

    /// A layout rectangle as a world rectangle: middle and direction warped, size kept.
    pub(super) fn site(&self, centre: V2, along: V2, half: V2) -> Site {
        let warp = &self.ground.warp;
        Site {
            centre: warp.world_from_layout(centre),
            axis: warp.world_direction(centre, along),
            half,
        }
    }

    /// Whether a world rectangle, grown by a margin, is free of everything marked.
    pub(super) fn free(&self, site: &Site, margin_m: f32) -> bool {
        let h = site.half + V2::repeat(margin_m);
        let (nu, nv) = ((h.x / 0.9).ceil() as i32, (h.y / 0.9).ceil() as i32);
        (-nu..=nu).all(|i| {
            (-nv..=nv).all(|j| {
                let p = site.at(h.x * i as f32 / nu as f32, h.y * j as f32 / nv as f32);
                !self.occupancy.taken(p)
            })
        })
    }

    /// Marks a world rectangle as taken.
    pub(super) fn take(&mut self, site: &Site) {
        let h = site.half;
        let (nu, nv) = ((h.x / 0.6).ceil() as i32, (h.y / 0.6).ceil() as i32);
        for i in -nu..=nu {
            for j in -nv..=nv {
                let p = site.at(h.x * i as f32 / nu as f32, h.y * j as f32 / nv as f32);
                self.occupancy.take(p);
            }
        }
    }

    pub(super) fn parcel(&mut self, cover: Cover, outline: Convex, axis: V2, rank: u8) {
        let seed = self.seed();
        self.parcels
            .push(Patch::convex(cover, outline, axis, rank, seed));
    }

    pub(super) fn pave(&mut self, cover: Cover, site: &Site, rank: u8) {
        let seed = self.seed();
        self.patches.push(Patch::rectangle(
            cover,
            site.centre,
            site.axis,
            site.half,
            rank,
            seed,
        ));
    }

    /// A footpath or stream along world points.
    pub(super) fn ribbon(&mut self, cover: Cover, points: &[V2], half_m: &[f32], rank: u8) {
        let seed = self.seed();
        let mut start_m = 0.0;
        for (i, pair) in points.windows(2).enumerate() {
            let (a, b) = (pair[0], pair[1]);
            self.patches.push(Patch {
                cover,
                shape: Shape::Segment {
                    a,
                    b,
                    half_m: [half_m[i], half_m[i + 1]],
                    start_m,
                },
                centre: (a + b) * 0.5,
                axis: V2::x(),
                half: V2::repeat(half_m[i]),
                rank,
                seed,
            });
            start_m += (b - a).norm();
        }
    }

    #[allow(clippy::too_many_arguments)]
    pub(super) fn solid(
        &mut self,
        site: &Site,
        base_m: f32,
        eaves_m: f32,
        roof: Roof,
        finish: Finish,
        roof_rgb: [u8; 3],
        wall_rgb: [u8; 3],
        life: Life,
    ) {
        let seed = self.seed();
        self.solids.push(Solid {
            centre: site.centre,
            axis: site.axis,
            half: site.half,
            base_m,
            eaves_m,
            roof,
            finish,
            roof_rgb,
            wall_rgb,
            seed,
            life,
        });
    }

    /// A tree if the place is free of buildings and roads.
    pub(super) fn tree(&mut self, centre: V2, radius_m: f32, species: Species) {
        if self.occupancy.taken(centre) {
            return;
        }
        self.tree_anywhere(centre, radius_m, species);
    }

    pub(super) fn tree_anywhere(&mut self, centre: V2, radius_m: f32, species: Species) {
        let r = &mut self.random;
        let (base_m, top_m) = match species {
            Species::Broadleaf | Species::Evergreen => {
                let top = radius_m * r.range(1.9, 2.6) + 1.0;
                (top * 0.22, top)
            }
            Species::Conifer => {
                let top = radius_m * r.range(2.4, 3.6);
                (-top * 0.8, top)
            }
            Species::Fruit => (0.8, radius_m * 1.6 + 1.0),
            Species::Shrub => (-radius_m * 0.3, radius_m * r.range(0.8, 1.3)),
        };
        let life = if r.chance(0.5) {
            Life::Lasting
        } else {
            Life::Fixed
        };
        let seed = r.next_u32();
        let crown = Tree {
            centre,
            radius_m,
            base_m,
            top_m,
            species,
            seed,
            life,
        };
        if radius_m < 2.4 || species == Species::Conifer {
            self.trees.push(crown);
            return;
        }
        // A large crown is a few smaller ones grown together.
        let turn = r.range(0.0, std::f32::consts::TAU);
        let lobes = 2 + r.below(3);
        for k in 0..lobes {
            let angle = turn + k as f32 * std::f32::consts::TAU / lobes as f32 + r.range(-0.4, 0.4);
            let out = radius_m * r.range(0.3, 0.5);
            let radius = radius_m * r.range(0.55, 0.75);
            let top_m = top_m * r.range(0.8, 1.04);
            self.trees.push(Tree {
                centre: centre + V2::new(angle.cos(), angle.sin()) * out,
                radius_m: radius,
                base_m: (top_m - radius * 2.2).max(base_m),
                top_m,
                ..crown.clone()
            });
        }
    }

    pub(super) fn any_species(&mut self) -> Species {
        match self.random.below(10) {
            0..=5 => Species::Broadleaf,
            6..=7 => Species::Evergreen,
            8 => Species::Conifer,
            _ => Species::Shrub,
        }
    }
}
