//! The K best of a stream of candidates, independent of their order.

use std::cmp::Ordering;

/// A tile found by a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the tile in its level.
    pub tile: usize,
    /// Cosine similarity of the descriptors (an estimate if IVF-PQ is not re-ranked).
    pub similarity: f32,
}

impl Hit {
    /// Better first: larger similarity, then smaller index. NaN comes last.
    pub fn order(&self, other: &Self) -> Ordering {
        let key = |hit: &Self| {
            if hit.similarity.is_nan() {
                f32::NEG_INFINITY
            } else {
                hit.similarity
            }
        };
        key(other)
            .total_cmp(&key(self))
            .then(self.tile.cmp(&other.tile))
    }
}

/// Keeps the `k` best hits.
#[derive(Clone, Debug)]
pub(crate) struct TopK {
    k: usize,
    /// At most `2 k`; cut down when full.
    hits: Vec<Hit>,
    /// Once `k` were seen: nothing below this similarity can be among the best.
    floor: f32,
}

impl TopK {
    pub(crate) fn new(k: usize) -> Self {
        Self {
            k,
            hits: Vec::new(),
            floor: f32::NEG_INFINITY,
        }
    }

    /// Whether a hit of this similarity may still be among the best.
    pub(crate) fn may_take(&self, similarity: f32) -> bool {
        similarity >= self.floor
    }

    pub(crate) fn push(&mut self, hit: Hit) {
        if self.k == 0 || !self.may_take(hit.similarity) {
            return;
        }
        self.hits.push(hit);
        if self.hits.len() >= self.k.max(32).saturating_mul(2) {
            self.cut();
        }
    }

    fn cut(&mut self) {
        if self.hits.len() > self.k {
            self.hits.select_nth_unstable_by(self.k - 1, Hit::order);
            self.hits.truncate(self.k);
            self.floor = self.hits[self.k - 1].similarity;
        }
    }

    pub(crate) fn merge(mut self, other: Self) -> Self {
        other.hits.into_iter().for_each(|hit| self.push(hit));
        self
    }

    /// The best hits, best first.
    pub(crate) fn into_sorted(mut self) -> Vec<Hit> {
        self.hits.sort_unstable_by(Hit::order);
        self.hits.truncate(self.k);
        self.hits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn equals_a_full_sort(
            similarities in prop::collection::vec(0u8..8, 0..300),
            k in prop_oneof![0usize..40, Just(usize::MAX)],
            split in 0usize..300,
        ) {
            let hits: Vec<Hit> = similarities.iter().enumerate()
                .map(|(tile, &s)| Hit { tile, similarity: f32::from(s) }).collect();
            let mut expected = hits.clone();
            expected.sort_by(Hit::order);
            expected.truncate(k);
            let (mut a, mut b) = (TopK::new(k), TopK::new(k));
            for (i, hit) in hits.iter().rev().enumerate() {
                if i < split { a.push(*hit) } else { b.push(*hit) }
            }
            prop_assert_eq!(a.merge(b).into_sorted(), expected);
        }
    }

    #[test]
    fn nan_is_last() {
        let mut hits = [
            Hit {
                tile: 0,
                similarity: f32::NAN,
            },
            Hit {
                tile: 1,
                similarity: -1.0,
            },
        ];
        hits.sort_by(Hit::order);
        assert_eq!(hits[0].tile, 1);
    }
}
