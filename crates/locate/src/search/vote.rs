//! The translation vote. With heading and scale assumed, every mutual match of the strongest keypoints votes for a translation of
//! the query over the tile. The peak of that histogram ranks hundreds of candidates at the cost of a small matrix product each.

use nalgebra::{Point2, Vector2};

use crate::{options::VoteOptions, search::matching::Match};

/// The peak of a vote.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Peak {
    /// Matches in the fullest 2 x 2 bins.
    pub votes: u32,
    /// Centre of these bins: tile position minus query position, pixels.
    pub shift_px: Vector2<f64>,
}

/// A histogram that keeps its memory from one vote to the next.
#[derive(Debug, Default)]
pub struct Histogram {
    bins: Vec<u32>,
}

impl Histogram {
    /// Lets `matches` vote for the translation from `query` to `tile` keypoints, pixels. Translations that are not finite are ignored.
    pub fn vote(
        &mut self,
        options: &VoteOptions,
        matches: &[Match],
        query: &[Point2<f32>],
        tile: &[Point2<f32>],
    ) -> Peak {
        let shift = |pair: &Match| {
            let (q, t) = (
                query.get(pair.query as usize)?,
                tile.get(pair.tile as usize)?,
            );
            let shift = [
                f64::from(t.x) - f64::from(q.x),
                f64::from(t.y) - f64::from(q.y),
            ];
            shift
                .iter()
                .all(|along| along.is_finite() && along.abs() < MAX_SHIFT_PX)
                .then_some(shift)
        };
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for shift in matches.iter().filter_map(shift) {
            for axis in 0..2 {
                low[axis] = low[axis].min(shift[axis]);
                high[axis] = high[axis].max(shift[axis]);
            }
        }
        if low[0] > high[0] {
            return Peak::default();
        }
        // An empty row and column at the far sides avoid an edge case in the 2 x 2 sum. Bins are aligned with zero translation.
        let first = low.map(|along| (along / options.bin_px).floor());
        let count =
            [0, 1].map(|axis| ((high[axis] / options.bin_px).floor() - first[axis]) as usize + 2);
        self.bins.clear();
        self.bins.resize(count[0] * count[1], 0);
        for shift in matches.iter().filter_map(shift) {
            let [x, y] =
                [0, 1].map(|axis| ((shift[axis] / options.bin_px).floor() - first[axis]) as usize);
            self.bins[y * count[0] + x] += 1;
        }
        let mut best = Peak::default();
        for y in 0..count[1] - 1 {
            for x in 0..count[0] - 1 {
                let at = y * count[0] + x;
                let votes = self.bins[at]
                    + self.bins[at + 1]
                    + self.bins[at + count[0]]
                    + self.bins[at + count[0] + 1];
                if votes > best.votes {
                    let shift_px = Vector2::new(
                        (first[0] + x as f64 + 1.0) * options.bin_px,
                        (first[1] + y as f64 + 1.0) * options.bin_px,
                    );
                    best = Peak { votes, shift_px };
                }
            }
        }
        best
    }
}

/// Longer translations are ignored; this limits the size of the histogram.
const MAX_SHIFT_PX: f64 = 8192.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(count: u32) -> Vec<Match> {
        (0..count)
            .map(|i| Match {
                query: i,
                tile: i,
                similarity: 1.0,
            })
            .collect()
    }

    #[test]
    fn the_common_shift_wins() {
        let mut query = Vec::new();
        let mut tile = Vec::new();
        for i in 0..40u16 {
            let (x, y) = (f32::from(i * 53 % 512), f32::from(i * 97 % 512));
            query.push(Point2::new(x, y));
            // One in four agrees, within the width of a bin; the others are spread.
            let (dx, dy) = if i % 4 == 0 {
                (-130.0 + f32::from(i % 3), 71.0)
            } else {
                (f32::from(i * 83 % 400), f32::from(i * 41 % 400))
            };
            tile.push(Point2::new(x + dx, y + dy));
        }
        let mut histogram = Histogram::default();
        let peak = histogram.vote(&VoteOptions::default(), &pairs(40), &query, &tile);
        assert!(peak.votes >= 10, "{peak:?}");
        assert!(
            (peak.shift_px[0] + 130.0).abs() <= 25.0 && (peak.shift_px[1] - 71.0).abs() <= 25.0,
            "{peak:?}"
        );
        // The same buffers again give the same answer.
        assert_eq!(
            histogram.vote(&VoteOptions::default(), &pairs(40), &query, &tile),
            peak
        );
    }

    #[test]
    fn nothing_to_vote_on_has_no_peak() {
        let mut histogram = Histogram::default();
        let options = VoteOptions::default();
        assert_eq!(histogram.vote(&options, &[], &[], &[]), Peak::default());
        let lost = [
            Point2::new(f32::NAN, 0.0),
            Point2::new(f32::INFINITY, 0.0),
            Point2::new(1e9, 0.0),
        ];
        assert_eq!(
            histogram.vote(&options, &pairs(9), &[Point2::origin(); 9], &lost),
            Peak::default()
        );
        let one = [Point2::new(5.0, 5.0)];
        assert_eq!(histogram.vote(&options, &pairs(1), &one, &one).votes, 1);
    }
}
