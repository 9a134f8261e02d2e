//! Fills the plan with things: buildings, trees, cars, water, courts.

mod blocks;
mod clutter;
mod farmland;
mod green;
mod houses;
mod railway;
mod roofs;
mod traffic;
mod water;
mod works;

use nalgebra::Vector2;

use crate::convex::{Convex, left_of};
use crate::cover::{Cover, Patch, Shape};
use crate::ground::Ground;
use crate::layout::{Block, Layout, Town, Zone};
use crate::random::Stream;
use crate::solid::{Finish, Life, Roof, Solid};
use crate::tree::{Species, Tree};
use crate::warp::Warp;
use crate::world::WorldConfig;

type V2 = Vector2<f32>;

/// What generation hands to the world.
pub(crate) struct Populated {
    pub(crate) ground: Ground,
    pub(crate) solids: Vec<Solid>,
    pub(crate) trees: Vec<Tree>,
}

/// The local style of building: every town has a few roof colours that prevail.
#[derive(Clone, Copy, Debug)]
struct Style {
    tiles: [[u8; 3]; 3],
    /// Share of flat roofs among town houses.
    flat: f32,
}

/// A rectangle in the world.
#[derive(Clone, Copy, Debug)]
struct Site {
    centre: V2,
    axis: V2,
    half: V2,
}

impl Site {
    fn at(&self, u: f32, v: f32) -> V2 {
        self.centre + self.axis * u + left_of(self.axis) * v
    }

    fn part(&self, u: f32, v: f32, half_u: f32, half_v: f32) -> Self {
        Self {
            centre: self.at(u, v),
            axis: self.axis,
            half: V2::new(half_u, half_v),
        }
    }
}

/// One square metre of the ground may hold one thing.
struct Occupancy {
    low: f32,
    side: usize,
    cells: Vec<Holder>,
}

/// What holds a square metre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Holder {
    Nothing,
    Road,
    Thing,
}

impl Occupancy {
    fn index(&self, p: V2) -> Option<usize> {
        let (x, y) = (p.x - self.low, p.y - self.low);
        let limit = self.side as f32;
        (x >= 0.0 && y >= 0.0 && x < limit && y < limit)
            .then(|| y as usize * self.side + x as usize)
    }

    fn taken(&self, p: V2) -> bool {
        self.index(p)
            .is_none_or(|i| self.cells[i] != Holder::Nothing)
    }

    fn thing(&self, p: V2) -> bool {
        self.index(p).is_none_or(|i| self.cells[i] == Holder::Thing)
    }

    fn take(&mut self, p: V2) {
        if let Some(i) = self.index(p) {
            self.cells[i] = Holder::Thing;
        }
    }
}

/// The world under construction.
struct Builder {
    ground: Ground,
    solids: Vec<Solid>,
    trees: Vec<Tree>,
    patches: Vec<Patch>,
    parcels: Vec<Patch>,
    occupancy: Occupancy,
    style: Style,
    random: Stream,
}

const STYLES: [Style; 5] = [
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

/// Worlds lie anywhere on a square of this side of the noise of the ground; further out single precision would show.
const SOILS_M: f32 = 4096.0;

pub(crate) fn populate(
    config: &WorldConfig,
    low: f32,
    high: f32,
    random: &mut Stream,
) -> Populated {
    let size = config.size_m as f32;
    let warp = Warp::new(
        low - 80.0,
        high + 80.0,
        0.05 + 0.16 * config.bend,
        &mut random.fork(1),
    );
    let mut soil = Stream::new(config.seed).fork(5);
    let soil_m = V2::new(soil.range(0.0, SOILS_M), soil.range(0.0, SOILS_M));
    let mut plan = random.fork(2);
    let town = Town {
        middle: V2::new(plan.range(0.3, 0.7), plan.range(0.3, 0.7)) * size,
        // A disc of this radius covers about the urban share of the map.
        radius_m: (config.urban / std::f32::consts::PI).sqrt() * size * 1.12 + 1.0,
    };
    let layout = Layout::new(low - 60.0, high + 60.0, town, &mut plan);
    let style = plan.pick(&STYLES);
    let Layout {
        districts,
        roads,
        blocks,
    } = layout;
    let parcels = districts
        .iter()
        .map(|d| {
            let axis = d.outline.frame().along;
            let cover = match d.zone {
                Zone::Fields | Zone::Meadow | Zone::Orchard | Zone::Village => Cover::Meadow,
                Zone::Forest => Cover::ForestFloor,
                Zone::Centre | Zone::OldTown => Cover::Concrete,
                Zone::Industry => Cover::Asphalt,
                _ => Cover::Lawn,
            };
            Patch::convex(cover, d.outline.clone(), axis, 0, d.seed)
        })
        .collect::<Vec<_>>();
    let side = (high - low) as usize + 1;
    let mut builder = Builder {
        ground: Ground::new(low, high, warp, soil_m, roads, Vec::new()),
        solids: Vec::new(),
        trees: Vec::new(),
        patches: Vec::new(),
        parcels,
        occupancy: Occupancy {
            low,
            side,
            cells: vec![Holder::Nothing; side * side],
        },
        style,
        random: random.fork(3),
    };
    builder.mark_roads();
    builder.add_railway(low, high);
    builder.add_waters(low, high);
    for (i, block) in blocks.iter().enumerate() {
        builder.random = random.fork(100 + i as u64);
        builder.fill(block);
    }
    builder.random = random.fork(4);
    builder.add_traffic();
    builder.add_street_trees();
    let Builder {
        ground,
        solids,
        trees,
        patches,
        parcels,
        ..
    } = builder;
    let Ground { warp, roads, .. } = ground;
    let mut ground = Ground::new(low, high, warp, soil_m, roads, parcels);
    ground.set_patches(low, high, patches);
    Populated {
        ground,
        solids,
        trees,
    }
}

impl Builder {
    fn fill(&mut self, block: &Block) {
        match block.zone {
            Zone::Centre => self.perimeter_block(block),
            Zone::OldTown => self.old_town(block),
            Zone::Terraces => self.terraces(block),
            Zone::Suburb | Zone::Village => self.detached(block),
            Zone::Apartments => self.apartments(block),
            Zone::Industry => self.works(block),
            Zone::Park => self.park(block),
            Zone::Sports => self.sports(block),
            Zone::Fields => self.field(block),
            Zone::Forest => self.forest(block),
            Zone::Orchard => self.orchard(block),
            Zone::Meadow => self.pasture(block),
        }
    }

    fn mark_roads(&mut self) {
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

    fn seed(&mut self) -> u32 {
        self.random.next_u32()
    }

    /// A layout rectangle as a world rectangle: middle and direction warped, size kept.
    fn site(&self, centre: V2, along: V2, half: V2) -> Site {
        let warp = &self.ground.warp;
        Site {
            centre: warp.world_from_layout(centre),
            axis: warp.world_direction(centre, along),
            half,
        }
    }

    /// Whether a world rectangle, grown by a margin, is free of everything marked.
    fn free(&self, site: &Site, margin_m: f32) -> bool {
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
    fn take(&mut self, site: &Site) {
        let h = site.half;
        let (nu, nv) = ((h.x / 0.6).ceil() as i32, (h.y / 0.6).ceil() as i32);
        for i in -nu..=nu {
            for j in -nv..=nv {
                let p = site.at(h.x * i as f32 / nu as f32, h.y * j as f32 / nv as f32);
                self.occupancy.take(p);
            }
        }
    }

    fn parcel(&mut self, cover: Cover, outline: Convex, axis: V2, rank: u8) {
        let seed = self.seed();
        self.parcels
            .push(Patch::convex(cover, outline, axis, rank, seed));
    }

    fn pave(&mut self, cover: Cover, site: &Site, rank: u8) {
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
    fn ribbon(&mut self, cover: Cover, points: &[V2], half_m: &[f32], rank: u8) {
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
    fn solid(
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
    fn tree(&mut self, centre: V2, radius_m: f32, species: Species) {
        if self.occupancy.taken(centre) {
            return;
        }
        self.tree_anywhere(centre, radius_m, species);
    }

    fn tree_anywhere(&mut self, centre: V2, radius_m: f32, species: Species) {
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

    fn any_species(&mut self) -> Species {
        match self.random.below(10) {
            0..=5 => Species::Broadleaf,
            6..=7 => Species::Evergreen,
            8 => Species::Conifer,
            _ => Species::Shrub,
        }
    }
}

/// The largest rectangle of at most `half` around `centre`, sides along `along`, inside the polygon.
fn fit(outline: &Convex, centre: V2, along: V2, half: V2) -> Option<(V2, V2)> {
    let across = left_of(along);
    let mut centre = centre;
    let mut half = half;
    for _ in 0..28 {
        let mut push = V2::zeros();
        let mut worst = 0.0_f32;
        for (su, sv) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let corner = centre + along * (half.x * su) + across * (half.y * sv);
            let depth = outline.depth(corner);
            if depth < 0.0 {
                worst = worst.min(depth);
                push -= (corner - centre).normalize() * (-depth) * 0.4;
            }
        }
        if worst > -0.05 {
            return Some((centre, half));
        }
        centre += push;
        half *= 0.955;
    }
    None
}
