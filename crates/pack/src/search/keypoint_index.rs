//! An inverted file over the keypoints of a level (Sivic and Zisserman 2003). Each local descriptor goes to the list whose centroid has
//! the largest product with it, with its position and the code of its difference to the centroid. A query's descriptor finds the most
//! similar keypoints of a whole map in a few lists, without reading a descriptor of the map.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use grimnet_geo::LevelPx;
use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt};
use grimnet_net::{KMeans, nearest_by_product};

use super::hamming_code::{HammingDistances, code_bits, code_words, push_code};
use super::inverted_lists::are_starts;
use super::top_k::{Hit, TopK};

/// Step of stored positions, level pixels: the vote over them has coarser bins.
pub(crate) const POSITION_STEP_PX: u32 = 8;

/// Training vectors per centroid: what faiss takes for few (`Clustering::min_points_per_centroid` is 39).
const POINTS_PER_CENTROID: usize = 32;
const ITERATIONS: usize = 8;
const MAX_LISTS: usize = 1 << 14;
const SEED: u64 = 1477;

/// Where a keypoint lies, in steps of [`POSITION_STEP_PX`] from the corner of the level's feature units: x, y.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct KeypointPosition(pub [u16; 2]);

impl KeypointPosition {
    /// The position of a point, pixels from the corner of the level's feature units; `None` if it is not one of 2^16 steps.
    pub fn of(px: [f64; 2]) -> Option<Self> {
        let step = |along: f64| {
            let steps = (along / f64::from(POSITION_STEP_PX)).floor();
            (0.0..=f64::from(u16::MAX))
                .contains(&steps)
                .then_some(steps as u16)
        };
        Some(Self([step(px[0])?, step(px[1])?]))
    }

    /// The middle of the step, pixels from the corner of the level's feature units.
    fn px(self) -> [f64; 2] {
        self.0
            .map(|steps| (f64::from(steps) + 0.5) * f64::from(POSITION_STEP_PX))
    }
}

/// Number of lists for so many keypoints: a power of two near their square root.
pub fn lists_for(keypoints: u64) -> usize {
    (keypoints.isqrt() as usize)
        .next_power_of_two()
        .min(MAX_LISTS)
}

/// Number of descriptors that centroids are trained on.
pub fn training_points(lists: usize) -> usize {
    lists * POINTS_PER_CENTROID
}

/// Centroids by spherical k-means, `lists x dim`, from descriptors `n x dim`.
pub fn train(descriptors: &[f32], dim: usize, lists: usize) -> Vec<f32> {
    let k_means = KMeans {
        clusters: lists,
        iterations: ITERATIONS,
        spherical: true,
        seed: SEED,
    };
    k_means.run(descriptors, dim)
}

/// List and code of each descriptor (`n x dim`).
pub fn encode(centroids: &[f32], descriptors: &[f32], dim: usize) -> (Vec<u32>, Vec<u64>) {
    let lists = nearest_by_product(centroids, descriptors, dim);
    let mut codes = Vec::with_capacity(lists.len() * code_words(dim));
    let mut rotated = vec![0.0; code_bits(dim)];
    for (descriptor, &list) in descriptors.chunks_exact(dim).zip(&lists) {
        let centroid = &centroids[list as usize * dim..][..dim];
        push_code(descriptor, centroid, &mut rotated, &mut codes);
    }
    (lists, codes)
}

/// The index of a level.
#[derive(Clone, Copy, Debug)]
pub struct KeypointIndex<'a> {
    dim: usize,
    /// Corner of the level's feature units, level pixels.
    origin_px: [i64; 2],
    /// `lists x dim`.
    centroids: &'a [f32],
    /// Where each list starts, and the total: `lists + 1`.
    list_starts: &'a [u32],
    /// In the order of the lists.
    positions: &'a [KeypointPosition],
    /// In the same order, `n x code_words(dim)`.
    codes: &'a [u64],
}

/// How far a search goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// Lists that are visited for each descriptor, the nearest ones.
    pub lists: usize,
    /// Keypoints that are found for each descriptor, and those as similar as the last of them.
    pub neighbours: usize,
}

/// A keypoint of the map that is similar to a descriptor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Index of the descriptor.
    pub descriptor: usize,
    /// Where the keypoint lies, to within half a step of stored positions (4 level pixels).
    pub position: LevelPx,
    /// Number of keypoints that are more similar, among those in the lists that were visited.
    pub rank: usize,
}

impl<'a> KeypointIndex<'a> {
    /// Checks that the parts fit each other; `None` if they do not.
    pub(crate) fn new(
        (dim, lists, keypoints): (usize, usize, usize),
        origin_px: [i64; 2],
        centroids: &'a [f32],
        list_starts: &'a [u32],
        positions: &'a [KeypointPosition],
        codes: &'a [u64],
    ) -> Option<Self> {
        let fits = lists > 0
            && centroids.len() == lists.checked_mul(dim)?
            && centroids.iter().all(|v| v.is_finite())
            && are_starts(list_starts, lists, keypoints)
            && positions.len() == keypoints
            && codes.len() == keypoints.checked_mul(code_words(dim))?;
        fits.then_some(Self {
            dim,
            origin_px,
            centroids,
            list_starts,
            positions,
            codes,
        })
    }

    /// The keypoints of the map, or of a rectangle of it (two opposite corners), that are most similar to each of several descriptors
    /// (`n x dim`, unit vectors): `found` is called for each, descriptor by descriptor.
    pub fn search(
        &self,
        descriptors: &[f32],
        reach: Reach,
        area: Option<[LevelPx; 2]>,
        mut found: impl FnMut(Neighbour),
    ) {
        let count = descriptors.len() / self.dim;
        let lists = self.list_starts.len() - 1;
        let mut products = vec![0.0; count * lists];
        matmul_nt(
            Isa::detect(),
            MatRef::new(descriptors, count, self.dim),
            MatRef::new(self.centroids, lists, self.dim),
            MatMut::new(&mut products, count, lists),
        );
        let area = area.map(|corners| self.steps(corners));
        let mut buffers = Buffers::default();
        for (i, (query, products)) in descriptors
            .chunks_exact(self.dim)
            .zip(products.chunks_exact(lists))
            .enumerate()
        {
            let mut nearest = TopK::new(reach.lists.clamp(1, lists));
            for (tile, &similarity) in products.iter().enumerate() {
                nearest.push(Hit { tile, similarity });
            }
            self.measure(query, nearest.into_sorted(), area, &mut buffers);
            buffers.nearest(reach.neighbours, |at, rank| {
                found(Neighbour {
                    descriptor: i,
                    position: self.position(at),
                    rank,
                });
            });
        }
    }

    fn position(&self, at: usize) -> LevelPx {
        let [x, y] = self.positions[at].px();
        LevelPx {
            x: x + self.origin_px[0] as f64,
            y: y + self.origin_px[1] as f64,
        }
    }

    /// Least and largest steps of a rectangle, clamped to those that there are.
    fn steps(&self, corners: [LevelPx; 2]) -> [KeypointPosition; 2] {
        let steps = corners.map(|corner| {
            let from_origin = [
                corner.x - self.origin_px[0] as f64,
                corner.y - self.origin_px[1] as f64,
            ];
            from_origin.map(|along| (along / f64::from(POSITION_STEP_PX)) as u16)
        });
        let of = |choose: fn(u16, u16) -> u16| {
            KeypointPosition(std::array::from_fn(|a| choose(steps[0][a], steps[1][a])))
        };
        [of(u16::min), of(u16::max)]
    }

    /// The distances of the keypoints in some lists from a descriptor.
    fn measure(
        &self,
        query: &[f32],
        lists: Vec<Hit>,
        area: Option<[KeypointPosition; 2]>,
        buffers: &mut Buffers,
    ) {
        let words = code_words(self.dim);
        buffers.begin(code_bits(self.dim));
        for Hit { tile: list, .. } in lists {
            let centroid = &self.centroids[list * self.dim..][..self.dim];
            buffers.code.clear();
            push_code(query, centroid, &mut buffers.rotated, &mut buffers.code);
            let places = self.list_starts[list] as usize..self.list_starts[list + 1] as usize;
            let first = buffers.distances.len();
            buffers.distances.resize(first + places.len(), 0);
            Isa::detect().vectorise(HammingDistances {
                code: &buffers.code,
                codes: &self.codes[places.start * words..places.end * words],
                distances: &mut buffers.distances[first..],
            });
            if let Some([low, high]) = area {
                let positions = &self.positions[places.clone()];
                let distances = buffers.distances[first..].iter_mut();
                for (position, distance) in positions.iter().zip(distances) {
                    let inside = |a: usize| (low.0[a]..=high.0[a]).contains(&position.0[a]);
                    if !(inside(0) && inside(1)) {
                        *distance = LEFT_OUT;
                    }
                }
            }
            buffers.visited.push(places);
        }
    }
}

/// Distance of a keypoint that is left out.
const LEFT_OUT: u16 = u16::MAX;

/// What a search needs for one descriptor; kept from one to the next.
#[derive(Default)]
struct Buffers {
    rotated: Vec<f32>,
    code: Vec<u64>,
    /// The keypoints of the lists that were visited.
    visited: Vec<Range<usize>>,
    /// Their distances.
    distances: Vec<u16>,
    /// Number of keypoints at each distance.
    counts: Vec<usize>,
}

impl Buffers {
    fn begin(&mut self, bits: usize) {
        self.rotated.resize(bits, 0.0);
        self.counts.clear();
        self.counts.resize(bits + 1, 0);
        self.visited.clear();
        self.distances.clear();
    }

    /// Calls `found` with place and rank of the nearest keypoints.
    fn nearest(&mut self, neighbours: usize, mut found: impl FnMut(usize, usize)) {
        for &distance in &self.distances {
            if let Some(count) = self.counts.get_mut(usize::from(distance)) {
                *count += 1;
            }
        }
        // From counts to the number that is nearer.
        let mut nearer = 0;
        let mut farthest = None;
        for (distance, count) in self.counts.iter_mut().enumerate() {
            if nearer >= neighbours {
                break;
            }
            farthest = Some(distance as u16);
            nearer += std::mem::replace(count, nearer);
        }
        let Some(farthest) = farthest else { return };
        let places = self.visited.iter().flat_map(Clone::clone);
        for (at, &distance) in places.zip(&self.distances) {
            if distance <= farthest {
                found(at, self.counts[usize::from(distance)]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIM: usize = 128;
    const EVERYTHING: Reach = Reach {
        lists: usize::MAX,
        neighbours: usize::MAX,
    };

    /// Uniform random numbers between -1 and 1.
    fn uniform(seed: u64) -> impl FnMut() -> f32 {
        let mut state = seed;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 23) as f32 - 1.0
        }
    }

    /// Unit vectors around 20 directions.
    fn descriptors(count: usize, seed: u64) -> Vec<f32> {
        let mut random = uniform(seed);
        let mut numbers =
            |spread: f32| -> Vec<f32> { (0..DIM).map(|_| spread * random()).collect() };
        let directions: Vec<Vec<f32>> = (0..20).map(|_| numbers(1.0)).collect();
        (0..count)
            .flat_map(|i| {
                let noise = numbers(0.8);
                let vector = directions[i % 20].iter().zip(noise).map(|(a, b)| a + b);
                unit(vector.collect())
            })
            .collect()
    }

    fn unit(vector: Vec<f32>) -> Vec<f32> {
        let length = vector.iter().map(|v| v * v).sum::<f32>().sqrt();
        vector.into_iter().map(|v| v / length).collect()
    }

    struct Built {
        centroids: Vec<f32>,
        starts: Vec<u32>,
        positions: Vec<KeypointPosition>,
        codes: Vec<u64>,
    }

    /// An index in which descriptor `i` lies at step (i, 2 i).
    fn built(descriptors: &[f32], lists: usize) -> Built {
        let centroids = train(descriptors, DIM, lists);
        let (of, codes) = encode(&centroids, descriptors, DIM);
        let mut order: Vec<usize> = (0..of.len()).collect();
        order.sort_by_key(|&i| of[i]);
        Built {
            starts: (0..=lists as u32)
                .map(|list| of.iter().filter(|&&l| l < list).count() as u32)
                .collect(),
            positions: order
                .iter()
                .map(|&i| KeypointPosition([i as u16, 2 * i as u16]))
                .collect(),
            codes: order
                .iter()
                .flat_map(|&i| codes[2 * i..2 * i + 2].to_vec())
                .collect(),
            centroids,
        }
    }

    impl Built {
        fn index(&self) -> Option<KeypointIndex<'_>> {
            KeypointIndex::new(
                (DIM, self.starts.len() - 1, self.positions.len()),
                [-100, 0],
                &self.centroids,
                &self.starts,
                &self.positions,
                &self.codes,
            )
        }
    }

    /// The numbers of the descriptors found for each query, nearest first.
    fn found(index: &KeypointIndex<'_>, queries: &[f32], reach: Reach) -> Vec<Vec<(usize, usize)>> {
        let mut all = vec![Vec::new(); queries.len() / DIM];
        index.search(queries, reach, None, |neighbour| {
            let step = (neighbour.position.x + 100.0) / f64::from(POSITION_STEP_PX) - 0.5;
            all[neighbour.descriptor].push((neighbour.rank, step as usize));
        });
        all.iter_mut().for_each(|list| list.sort_unstable());
        all
    }

    /// Half of what a descriptor is differs, and it still finds itself among a thousand.
    #[test]
    fn a_changed_descriptor_finds_itself_first() {
        let descriptors = descriptors(1000, 3);
        let built = built(&descriptors, 16);
        let mut random = uniform(5);
        let mut changed = |d: &[f32]| unit(d.iter().map(|v| v + 0.1 * random()).collect());
        let queries: Vec<f32> = descriptors
            .chunks_exact(DIM)
            .step_by(10)
            .flat_map(&mut changed)
            .collect();
        let reach = Reach {
            lists: 4,
            neighbours: 10,
        };
        let hits = found(&built.index().unwrap(), &queries, reach);
        assert!(hits.iter().all(|hits| hits.len() >= 10));
        let right = hits
            .iter()
            .enumerate()
            .filter(|(i, hits)| hits[0] == (0, 10 * i));
        let right = right.count();
        assert!(right > 90, "{right} of 100");
    }

    #[test]
    fn everything_is_found_once_and_ranks_count_those_that_are_nearer() {
        let descriptors = descriptors(300, 9);
        let built = built(&descriptors, 8);
        let hits = found(&built.index().unwrap(), &descriptors[..DIM], EVERYTHING);
        let mut places: Vec<usize> = hits[0].iter().map(|(_, place)| *place).collect();
        places.sort_unstable();
        assert_eq!(places, (0..300).collect::<Vec<_>>());
        for (i, (rank, _)) in hits[0].iter().enumerate() {
            let is_first_of_its_rank = i == 0 || hits[0][i - 1].0 != *rank;
            assert!(*rank <= i && (!is_first_of_its_rank || *rank == i));
        }
    }

    #[test]
    fn keypoints_outside_of_the_area_are_left_out_before_neighbours_are_counted() {
        let descriptors = descriptors(300, 9);
        let built = built(&descriptors, 8);
        let area = [LevelPx { x: 1e9, y: 2000.0 }, LevelPx { x: -1e9, y: 1e9 }];
        let mut places = Vec::new();
        let reach = Reach {
            lists: usize::MAX,
            neighbours: 20,
        };
        built
            .index()
            .unwrap()
            .search(&descriptors[..DIM], reach, Some(area), |neighbour| {
                places.push(neighbour.position);
            });
        assert!(places.len() >= 20 && places.iter().all(|place| place.y >= 2000.0));
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        let good = || built(&descriptors(100, 1), 4);
        assert!(good().index().is_some());
        let bad: [fn(&mut Built); 6] = [
            |b| b.starts[1] = 101,
            |b| b.starts[0] = 1,
            |b| *b.starts.last_mut().unwrap() = 99,
            |b| b.codes.truncate(10),
            |b| b.centroids.truncate(10),
            |b| b.centroids[0] = f32::NAN,
        ];
        for change in bad {
            let mut built = good();
            change(&mut built);
            assert!(built.index().is_none());
        }
    }

    #[test]
    fn positions_outside_of_the_steps_are_none() {
        assert_eq!(KeypointPosition::of([-0.1, 3.0]), None);
        assert_eq!(KeypointPosition::of([0.0, 65536.0 * 8.0]), None);
        assert_eq!(
            KeypointPosition::of([8.0, 65535.9 * 8.0]),
            Some(KeypointPosition([1, 65535]))
        );
    }
}
