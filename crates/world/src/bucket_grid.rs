//! A square grid of buckets, for finding the items near a point.

use nalgebra::Vector2;

type V2 = Vector2<f32>;

pub(crate) const CELL_M: f32 = 8.0;

/// An item that covers a bounded part of the plane.
pub(crate) trait Extent {
    /// Lower and upper corner of an enclosing box.
    fn bounds(&self) -> (V2, V2);
    /// Whether the item is within `radius_m` of the point; may be true for items slightly farther away.
    fn near(&self, centre: V2, radius_m: f32) -> bool;
}

/// Item indices by cell, in ascending order within a cell.
#[derive(Debug, Default)]
pub(crate) struct BucketGrid {
    origin: f32,
    side: usize,
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl BucketGrid {
    /// A grid over the square from `low` to `high` along both axes; items outside are not included.
    pub(crate) fn build<T: Extent>(low: f32, high: f32, items: &[T]) -> Self {
        let side = ((high - low) / CELL_M).ceil().max(1.0) as usize;
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(items.len() * 4);
        let reach = CELL_M * std::f32::consts::FRAC_1_SQRT_2 + 0.05;
        for (index, item) in items.iter().enumerate() {
            let (a, b) = item.bounds();
            let cell = |v: f32| ((v - low) / CELL_M).floor().clamp(-1.0, side as f32) as i64;
            let clamp = |v: i64| v.clamp(0, side as i64 - 1) as usize;
            if cell(b.x) < 0
                || cell(b.y) < 0
                || cell(a.x) >= side as i64
                || cell(a.y) >= side as i64
            {
                continue;
            }
            for cy in clamp(cell(a.y))..=clamp(cell(b.y)) {
                for cx in clamp(cell(a.x))..=clamp(cell(b.x)) {
                    let centre = V2::new(
                        low + (cx as f32 + 0.5) * CELL_M,
                        low + (cy as f32 + 0.5) * CELL_M,
                    );
                    if item.near(centre, reach) {
                        pairs.push(((cy * side + cx) as u32, index as u32));
                    }
                }
            }
        }
        pairs.sort_unstable();
        let mut starts = vec![0_u32; side * side + 1];
        for &(cell, _) in &pairs {
            starts[cell as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        Self {
            origin: low,
            side,
            starts,
            items: pairs.into_iter().map(|(_, i)| i).collect(),
        }
    }

    #[inline]
    pub(crate) fn cell_of(&self, p: V2) -> Option<usize> {
        let x = (p.x - self.origin) * (1.0 / CELL_M);
        let y = (p.y - self.origin) * (1.0 / CELL_M);
        let limit = self.side as f32;
        (x >= 0.0 && y >= 0.0 && x < limit && y < limit)
            .then(|| y as usize * self.side + x as usize)
    }

    #[inline]
    pub(crate) fn in_cell(&self, cell: usize) -> &[u32] {
        &self.items[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    #[inline]
    pub(crate) fn at(&self, p: V2) -> &[u32] {
        self.cell_of(p).map_or(&[], |c| self.in_cell(c))
    }

    pub(crate) fn side(&self) -> usize {
        self.side
    }

    pub(crate) fn origin(&self) -> f32 {
        self.origin
    }
}
