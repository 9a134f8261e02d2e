//! Which square metres of the ground are taken.

use nalgebra::Vector2;

type V2 = Vector2<f32>;

/// A grid of square metres, each of which holds at most one object.
pub(super) struct Occupancy {
    pub(super) low: f32,
    pub(super) side: usize,
    pub(super) cells: Vec<Holder>,
}

/// What a square metre holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Holder {
    Nothing,
    Road,
    Thing,
}

impl Occupancy {
    pub(super) fn index(&self, p: V2) -> Option<usize> {
        let (x, y) = (p.x - self.low, p.y - self.low);
        let limit = self.side as f32;
        (x >= 0.0 && y >= 0.0 && x < limit && y < limit)
            .then(|| y as usize * self.side + x as usize)
    }

    pub(super) fn taken(&self, p: V2) -> bool {
        self.index(p)
            .is_none_or(|i| self.cells[i] != Holder::Nothing)
    }

    pub(super) fn thing(&self, p: V2) -> bool {
        self.index(p).is_none_or(|i| self.cells[i] == Holder::Thing)
    }

    pub(super) fn take(&mut self, p: V2) {
        if let Some(i) = self.index(p) {
            self.cells[i] = Holder::Thing;
        }
    }
}
