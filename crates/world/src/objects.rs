//! Ray casting: the first object that a ray hits, and how much sunlight reaches a point.

use nalgebra::{Vector2, Vector3};

use crate::bucket_grid::{BucketGrid, CELL_M};
use crate::look::{Look, Season};
use crate::noise::split_floor;
use crate::solid::{Finish, Solid};
use crate::solid_ray::{Face, SolidHit};
use crate::tree::{Tree, TreeHit};

type V2 = Vector2<f32>;
type V3 = Vector3<f32>;

/// The first object above the ground that a ray hits.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Hit {
    Solid { index: u32, hit: SolidHit },
    Tree { index: u32, hit: TreeHit },
}

impl Hit {
    /// Distance along the ray, in lengths of its direction vector.
    pub(crate) fn t(&self) -> f32 {
        match self {
            Self::Solid { hit, .. } => hit.t,
            Self::Tree { hit, .. } => hit.t,
        }
    }
}

/// The object that a shadow ray starts from and must not hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Skip {
    Nothing,
    Solid(u32),
    Tree(u32),
}

/// Walks the grid cells along the horizontal part of a ray (Amanatides and Woo 1987).
struct Walk {
    x: i32,
    y: i32,
    step: [i32; 2],
    next: [f32; 2],
    delta: [f32; 2],
    t: f32,
    end: f32,
    side: i32,
}

impl Walk {
    #[inline]
    fn new(origin_m: f32, side: usize, o: V3, d: V3, t_min: f32, t_max: f32) -> Self {
        let p = V2::new(o.x + d.x * t_min - origin_m, o.y + d.y * t_min - origin_m);
        let ((_, cx), (_, cy)) = (split_floor(p.x / CELL_M), split_floor(p.y / CELL_M));
        let axis = |p: f32, c: f32, d: f32| {
            if d > 1e-9 {
                (1, t_min + ((c + 1.0) * CELL_M - p) / d, CELL_M / d)
            } else if d < -1e-9 {
                (-1, t_min + (c * CELL_M - p) / d, -CELL_M / d)
            } else {
                (0, f32::INFINITY, f32::INFINITY)
            }
        };
        let (sx, nx, dx) = axis(p.x, cx, d.x);
        let (sy, ny, dy) = axis(p.y, cy, d.y);
        Self {
            x: cx as i32,
            y: cy as i32,
            step: [sx, sy],
            next: [nx, ny],
            delta: [dx, dy],
            t: t_min,
            end: t_max,
            side: side as i32,
        }
    }

    /// The next cell (if inside the grid) with the interval in which the ray is over it.
    #[inline]
    fn next(&mut self) -> Option<(Option<usize>, f32, f32)> {
        if self.t >= self.end {
            return None;
        }
        let inside = self.x >= 0 && self.y >= 0 && self.x < self.side && self.y < self.side;
        let cell = inside.then(|| (self.y * self.side + self.x) as usize);
        let from = self.t;
        let axis = usize::from(self.next[1] < self.next[0]);
        let to = self.next[axis].min(self.end);
        if axis == 0 {
            self.x += self.step[0];
        } else {
            self.y += self.step[1];
        }
        self.next[axis] += self.delta[axis];
        self.t = to.max(from);
        if to >= self.end {
            self.t = self.end;
        }
        Some((cell, from, to))
    }
}

/// Everything that stands on the ground, indexed for ray casting.
#[derive(Debug)]
pub(crate) struct Objects {
    pub(crate) solids: Vec<Solid>,
    solid_grid: BucketGrid,
    pub(crate) trees: Vec<Tree>,
    tree_grid: BucketGrid,
    /// Height of the highest object in each cell of the grids.
    cell_top_m: Vec<f32>,
    /// Height of the highest object of all.
    pub(crate) top_m: f32,
}

impl Objects {
    /// Indexes objects in the square from `low` to `high` along both axes, metres.
    pub(crate) fn new(low: f32, high: f32, solids: Vec<Solid>, trees: Vec<Tree>) -> Self {
        let solid_grid = BucketGrid::build(low, high, &solids);
        let tree_grid = BucketGrid::build(low, high, &trees);
        let cells = solid_grid.side() * solid_grid.side();
        let cell_top_m: Vec<f32> = (0..cells)
            .map(|c| {
                let solid_tops = solid_grid
                    .in_cell(c)
                    .iter()
                    .map(|&i| solids[i as usize].top_m());
                let tree_tops = tree_grid
                    .in_cell(c)
                    .iter()
                    .map(|&i| trees[i as usize].top_m);
                solid_tops.chain(tree_tops).fold(0.0, f32::max)
            })
            .collect();
        let top_m = cell_top_m.iter().copied().fold(0.0, f32::max);
        Self {
            solids,
            solid_grid,
            trees,
            tree_grid,
            cell_top_m,
            top_m,
        }
    }

    /// First solid or tree on a downward ray, `None` if it reaches the ground.
    #[inline]
    pub(crate) fn cast(&self, o: V3, d: V3, look: &Look) -> Option<Hit> {
        let t_ground = -o.z / d.z;
        let t_top = ((self.top_m - o.z) / d.z).max(0.0);
        let mut walk = Walk::new(
            self.solid_grid.origin(),
            self.solid_grid.side(),
            o,
            d,
            t_top,
            t_ground,
        );
        let mut best: Option<Hit> = None;
        let mut best_t = t_ground;
        while let Some((cell, _, to)) = walk.next() {
            let Some(cell) = cell else { continue };
            if o.z + d.z * to < self.cell_top_m[cell] {
                for &index in self.solid_grid.in_cell(cell) {
                    let solid = &self.solids[index as usize];
                    if let Some(hit) = solid.intersect(o, d, t_top, best_t)
                        && solid.life.present(solid.seed, look.epoch, look.change)
                    {
                        best_t = hit.t;
                        best = Some(Hit::Solid { index, hit });
                    }
                }
                for &index in self.tree_grid.in_cell(cell) {
                    let tree = &self.trees[index as usize];
                    if let Some(hit) = tree.intersect(o, d, t_top, best_t, look.season)
                        && tree.life.present(tree.seed, look.epoch, look.change)
                    {
                        best_t = hit.t;
                        best = Some(Hit::Tree { index, hit });
                    }
                }
            }
            if best_t <= to {
                break;
            }
        }
        best
    }

    /// Share of the sunlight that reaches `o`, 0 to 1; `sun` is the unit vector to the sun.
    #[inline]
    pub(crate) fn sunlight(&self, o: V3, sun: V3, skip: Skip, look: &Look) -> f32 {
        let t_top = (self.top_m - o.z) / sun.z;
        if t_top <= 0.0 {
            return 1.0;
        }
        let mut walk = Walk::new(
            self.solid_grid.origin(),
            self.solid_grid.side(),
            o,
            sun,
            0.0,
            t_top,
        );
        let mut light = 1.0_f32;
        // A tree that spans several cells must dim the light once only.
        let mut dimmed = [u32::MAX; 4];
        let mut count = 0;
        while let Some((cell, from, _)) = walk.next() {
            let Some(cell) = cell else { continue };
            let lowest_m = o.z + sun.z * from;
            if lowest_m > self.cell_top_m[cell] {
                continue;
            }
            for &index in self.solid_grid.in_cell(cell) {
                let solid = &self.solids[index as usize];
                if skip == Skip::Solid(index) || lowest_m > solid.top_m() {
                    continue;
                }
                if solid.intersect(o, sun, 1e-3, t_top).is_some_and(|h| {
                    h.face == Face::Wall || h.face == Face::Roof && solid.finish != Finish::Glass
                }) && solid.life.present(solid.seed, look.epoch, look.change)
                {
                    return 0.0;
                }
            }
            for &index in self.tree_grid.in_cell(cell) {
                let tree = &self.trees[index as usize];
                if skip == Skip::Tree(index) || lowest_m > tree.top_m || dimmed.contains(&index) {
                    continue;
                }
                if tree.life.present(tree.seed, look.epoch, look.change)
                    && tree.intersect(o, sun, 1e-3, t_top, look.season).is_some()
                {
                    light *= if tree.bare(look.season) {
                        0.62
                    } else {
                        shade_of(look.season)
                    };
                    if light < 0.05 {
                        return 0.0;
                    }
                    dimmed[count & 3] = index;
                    count += 1;
                }
            }
        }
        light
    }
}

fn shade_of(season: Season) -> f32 {
    match season {
        Season::Summer => 0.08,
        Season::Spring => 0.15,
        Season::Autumn => 0.2,
        Season::Winter => 0.12,
    }
}
