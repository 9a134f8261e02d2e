//! The vote over a whole map. With heading and scale assumed, each keypoint of the query and each similar one of the map
//! ([`grimnet_pack::KeypointIndex`]) vote for a position of the photo's centre. Where many agree is a candidate, whatever its tile's
//! descriptor says: a tile is found by the part of the photo that did not change.

use grimnet_geo::LevelPx;
use grimnet_pack::{KeypointIndex, Level, Neighbour, Reach};
use rayon::prelude::*;

use crate::{options::MapVoteOptions, query_features::QueryFeatures};

/// A place with many votes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    /// The tile whose centre is nearest.
    pub tile: usize,
    /// Sum of the votes; the most similar keypoint of the map has one vote for each keypoint of the query, others less.
    pub votes: f32,
}

/// The places with the most votes of each query, at most one for each tile, with the keypoints of a rectangle of the map only if one is
/// given (two opposite corners).
pub(crate) fn map_vote(
    level: &Level,
    index: KeypointIndex<'_>,
    queries: &[QueryFeatures],
    area: Option<[LevelPx; 2]>,
    options: &MapVoteOptions,
) -> Vec<Vec<Place>> {
    queries
        .par_iter()
        .map(|query| {
            let votes = Votes::of(index, query, area, options);
            places(level, votes.counted(), options)
        })
        .collect()
}

/// What one vote of the most similar keypoint counts. Sums of whole numbers do not depend on their order.
const ONE_VOTE: f32 = 1024.0;
/// Fewer votes than this at a place are chance.
const FEWEST_VOTES: u8 = 3;

/// A vote for a square of 2 x 2 bins: its number, the keypoint of the query, what it counts. As a number, votes of one square, and
/// then of one keypoint, lie side by side, the weightiest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Vote {
    square: [i32; 2],
    keypoint: u16,
    minus_weight: i16,
}

/// The votes of a query.
#[derive(Debug, Default)]
struct Votes {
    all: Vec<Vote>,
    bin_px: f64,
}

impl Votes {
    fn of(
        index: KeypointIndex<'_>,
        query: &QueryFeatures,
        area: Option<[LevelPx; 2]>,
        options: &MapVoteOptions,
    ) -> Self {
        let reach = Reach {
            lists: options.lists,
            neighbours: options.neighbours,
        };
        let mut votes = Self {
            all: Vec::new(),
            bin_px: options.bin_px,
        };
        let descriptors = query.strongest_in_f32(options.keypoints);
        index.search(&descriptors, reach, area, |neighbour| {
            votes.add(&neighbour, query);
        });
        votes
    }

    /// A vote for each of the four squares that the bin is a part of.
    fn add(&mut self, neighbour: &Neighbour, query: &QueryFeatures) {
        let Some(point) = query.points.get(neighbour.descriptor) else {
            return;
        };
        let centre = [
            neighbour.position.x + query.centre_px.x - f64::from(point.x),
            neighbour.position.y + query.centre_px.y - f64::from(point.y),
        ];
        let bin = centre.map(|along| (along / self.bin_px).floor() as i32);
        let weight = ONE_VOTE / (1.0 + neighbour.rank as f32).sqrt();
        for corner in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            self.all.push(Vote {
                square: [bin[0] - corner[0], bin[1] - corner[1]],
                keypoint: neighbour.descriptor as u16,
                minus_weight: -(weight as i16),
            });
        }
    }

    /// The middle of each square with enough votes, and their sum. Of several votes of a keypoint the weightiest counts.
    fn counted(mut self) -> Vec<(LevelPx, f32)> {
        self.drop_chance();
        self.all.sort_unstable();
        self.all.dedup_by_key(|vote| (vote.square, vote.keypoint));
        let squares = self.all.chunk_by(|a, b| a.square == b.square);
        squares
            .map(|votes| {
                let sum: i32 = votes.iter().map(|vote| -i32::from(vote.minus_weight)).sum();
                let [x, y] = votes[0].square.map(|bin| f64::from(bin + 1) * self.bin_px);
                (LevelPx { x, y }, sum as f32 / ONE_VOTE)
            })
            .collect()
    }

    /// Drops the votes for squares that have few; nearly all do, and sorting takes most of the time.
    fn drop_chance(&mut self) {
        const SLOTS: usize = 1 << 18;
        let slot = |vote: &Vote| {
            let [x, y] = vote.square.map(|bin| bin as u32);
            // Multiplicative hashing (Knuth, volume 3, 6.4).
            let hash = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77);
            (hash.wrapping_mul(0xc2b2_ae3d) >> 14) as usize % SLOTS
        };
        let mut counts = vec![0u8; SLOTS];
        for vote in &self.all {
            let count = &mut counts[slot(vote)];
            *count = count.saturating_add(1);
        }
        self.all.retain(|vote| counts[slot(vote)] >= FEWEST_VOTES);
    }
}

/// The best squares, each as the tile that shows most around it; the best square of each tile.
fn places(level: &Level, mut squares: Vec<(LevelPx, f32)>, options: &MapVoteOptions) -> Vec<Place> {
    squares.sort_by(|(a, by_a), (b, by_b)| {
        by_b.total_cmp(by_a)
            .then(a.y.total_cmp(&b.y))
            .then(a.x.total_cmp(&b.x))
    });
    let mut places: Vec<Place> = Vec::new();
    for (centre, votes) in squares {
        if places.len() == options.places {
            break;
        }
        let Some(tile) = level.tile_around(centre) else {
            continue;
        };
        if places.iter().all(|place| place.tile != tile) {
            places.push(Place { tile, votes });
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    fn votes(of: &[([i32; 2], u16, i16)]) -> Votes {
        let vote = |&(square, keypoint, weight): &([i32; 2], u16, i16)| Vote {
            square,
            keypoint,
            minus_weight: -weight,
        };
        Votes {
            all: of.iter().map(vote).collect(),
            bin_px: 32.0,
        }
    }

    #[test]
    fn votes_of_a_square_add_up_and_a_keypoint_votes_once() {
        let counted = votes(&[
            ([3, -2], 0, 1024),
            ([3, -2], 0, 512),
            ([3, -2], 1, 512),
            ([3, -2], 2, 256),
            ([8, 8], 3, 1024),
        ])
        .counted();
        assert_eq!(counted, [(LevelPx { x: 128.0, y: -32.0 }, 1.75)]);
    }

    #[test]
    fn the_order_of_votes_does_not_matter() {
        let mut of: Vec<([i32; 2], u16, i16)> = (0..4000)
            .map(|i| ([i % 7, i % 5], (i % 97) as u16, (i % 1000) as i16))
            .collect();
        let forwards = votes(&of).counted();
        of.reverse();
        assert_eq!(votes(&of).counted(), forwards);
        assert_eq!(forwards.len(), 35);
    }
}
