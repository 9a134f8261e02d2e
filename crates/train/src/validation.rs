//! How good a model is on pictures that it never saw: what localisation asks of it, by the CPU engine that will run it.

use crate::TrainError;
use crate::data::{Pair, PairOptions, Source, apply};
use grimnet_net::{Domain, ExtractOptions, Extractor, Features, Model};
use image::GrayImage;
use nalgebra::{Matrix3, SMatrix, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Two points closer than this are the same.
const SAME_PX: f64 = 3.0;
/// RANSAC rounds of the homography estimate.
const ROUNDS: usize = 500;

/// Figures on held-aside pictures; shares are 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Pairs measured.
    pub pairs: usize,
    /// Share of the keypoints of the area both views see that the other view has, too, within 3 px.
    pub repeatability: f64,
    /// Right matches (mutual nearest, within 3 px) per keypoint of the shared area.
    pub matching_score: f64,
    /// Right share of the matches.
    pub match_precision: f64,
    /// Share of pairs whose estimated homography moves the corners by less than 1, 3 and 5 px on average.
    pub homography_accuracy: [f64; 3],
    /// Share of photos whose place is the first, or among the first five, of the gallery.
    pub recall: [f64; 2],
    /// Views in the gallery.
    pub gallery: usize,
}

/// Figures by the name of what was kept aside.
pub type Validations = Vec<(String, Validation)>;

/// Views for validation and for fitting the whitening: like training's, a little larger.
pub fn validation_options(training: &PairOptions) -> PairOptions {
    PairOptions {
        side_px: 256,
        points: 32,
        ..training.clone()
    }
}

/// Pairs of a source, seeded.
pub fn pairs_of(source: &dyn Source, count: usize, options: &PairOptions, seed: u64) -> Vec<Pair> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut out = Vec::with_capacity(count);
    let mut empty = 0;
    while out.len() < count && empty < 20 {
        let group = source.group(options.group.min(count - out.len()), options, &mut random);
        empty = if group.is_empty() { empty + 1 } else { 0 };
        out.extend(group);
    }
    out
}

/// The mask of the photo of a pair.
fn mask_of(pair: &Pair) -> GrayImage {
    let side = pair.uav.width();
    GrayImage::from_fn(side, side, |x, y| {
        let cell = ((y / 8) * (side / 8) + x / 8) as usize;
        image::Luma([if pair.uav_seen[cell] { 255 } else { 0 }])
    })
}

/// Features of both views of a pair.
///
/// # Errors
/// Where the network refuses the pictures.
pub fn features_of(
    pair: &Pair,
    extractors: &[Extractor; 2],
    options: &ExtractOptions,
) -> Result<[Features; 2], TrainError> {
    let sat = extractors[0].extract(&pair.sat, None, options)?;
    let uav = extractors[1].extract(&pair.uav, Some(&mask_of(pair)), options)?;
    Ok([sat, uav])
}

/// Extractors of both domains.
///
/// # Errors
/// Where the model cannot be run.
pub fn extractors_of(model: &Model) -> Result<[Extractor; 2], TrainError> {
    Ok([
        Extractor::new(model, Domain::Sat)?,
        Extractor::new(model, Domain::Uav)?,
    ])
}

/// What a model makes of pairs: all that [`Validation`] is computed from, so that descriptors can be whitened in several ways
/// and the network runs once.
#[derive(Clone, Debug)]
pub struct Sight {
    /// All figures but those of recall.
    matching: Validation,
    /// Global descriptors of the map views and of the photos, row by row.
    globals: [Vec<f32>; 2],
    /// Their length.
    length: usize,
}

impl Sight {
    /// Runs the model on pairs, and tells after each.
    ///
    /// # Errors
    /// Where the network refuses the pictures.
    pub fn of(
        model: &Model,
        pairs: &[Pair],
        on_pair: &mut dyn FnMut(),
    ) -> Result<Self, TrainError> {
        let extractors = extractors_of(model)?;
        let options = ExtractOptions {
            max_keypoints: 512,
            ..ExtractOptions::default()
        };
        let mut out = Validation {
            pairs: pairs.len(),
            ..Validation::default()
        };
        let [mut sat_globals, mut uav_globals] = [const { Vec::new() }; 2];
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let (mut right, mut matched) = (0usize, 0usize);
        for pair in pairs {
            let [sat, uav] = features_of(pair, &extractors, &options)?;
            let measured = measure(pair, &sat, &uav, &mut random);
            out.repeatability += measured.repeatability;
            out.matching_score += measured.score;
            right += measured.right;
            matched += measured.matched;
            for (sum, bound) in out.homography_accuracy.iter_mut().zip([1.0, 3.0, 5.0]) {
                *sum += f64::from(u8::from(measured.corner_error_px < bound));
            }
            sat_globals.extend(sat.global);
            uav_globals.extend(uav.global);
            on_pair();
        }
        let n = pairs.len().max(1) as f64;
        out.repeatability /= n;
        out.matching_score /= n;
        out.match_precision = right as f64 / matched.max(1) as f64;
        out.homography_accuracy.iter_mut().for_each(|v| *v /= n);
        Ok(Self {
            matching: out,
            globals: [sat_globals, uav_globals],
            length: model.spec().global_len(),
        })
    }

    /// The figures; the gallery is the map views of `pairs`, which must be those that were seen, and `distractors` (global
    /// descriptors, row by row).
    pub fn validation(&self, pairs: &[Pair], distractors: &[f32]) -> Validation {
        let ([sat, uav], length) = (&self.globals, self.length);
        let gallery = [sat.as_slice(), distractors].concat();
        let mut out = Validation {
            gallery: gallery.len() / length,
            ..self.matching
        };
        for (i, query) in uav.chunks_exact(length).enumerate() {
            let dot = |row: &[f32]| row.iter().zip(query).map(|(a, b)| a * b).sum::<f32>();
            let similarities: Vec<f32> = gallery.chunks_exact(length).map(dot).collect();
            // Another view that overlaps the place counts as found, too: only others can be in the way.
            let rivals = similarities
                .iter()
                .enumerate()
                .filter(|(j, s)| {
                    **s > similarities[i]
                        && pairs
                            .get(*j)
                            .is_none_or(|other| other.place.overlap(&pairs[i].place) < 0.3)
                })
                .count();
            for (sum, within) in out.recall.iter_mut().zip([1, 5]) {
                *sum += f64::from(u8::from(rivals < within)) / pairs.len() as f64;
            }
        }
        out
    }

    /// The same with descriptors as `model` whitens them, which differs from the one that saw the pairs in its whitening alone.
    #[must_use]
    pub fn whitened(&self, model: &Model) -> Self {
        Self {
            globals: self.globals.clone().map(|rows| model.whitened(rows)),
            length: model.spec().global_len(),
            ..*self
        }
    }
}

struct Measured {
    repeatability: f64,
    score: f64,
    right: usize,
    matched: usize,
    corner_error_px: f64,
}

fn measure(pair: &Pair, sat: &Features, uav: &Features, random: &mut ChaCha8Rng) -> Measured {
    let side = f64::from(pair.sat.width());
    let h = &pair.uav_from_sat_px;
    let at = |f: &Features| {
        f.keypoints
            .iter()
            .map(|k| [f64::from(k.x_px), f64::from(k.y_px)])
            .collect::<Vec<_>>()
    };
    let (a, b) = (at(sat), at(uav));
    let cells = side as usize / 8;
    let seen = |[x, y]: [f64; 2]| {
        let inside = (0.0..side - 1.0).contains(&x) && (0.0..side - 1.0).contains(&y);
        inside && pair.uav_seen[(y as usize / 8) * cells + x as usize / 8]
    };
    // A point that the other view does not show is near nothing there.
    let mapped: Vec<[f64; 2]> = a
        .iter()
        .map(|p| pair.mapping.uav_from_sat(*p, side, 0.0).at())
        .map(|at| at.unwrap_or([f64::INFINITY; 2]))
        .collect();
    let shared: Vec<usize> = (0..a.len()).filter(|i| seen(mapped[*i])).collect();
    let near = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]) < SAME_PX;
    let repeated = shared
        .iter()
        .filter(|i| b.iter().any(|q| near(mapped[**i], *q)))
        .count();
    let d = sat.descriptor_dim;
    let matches = mutual_matches(&sat.descriptors, &uav.descriptors, d);
    let right = matches
        .iter()
        .filter(|(i, j)| near(mapped[*i], b[*j]))
        .count();
    let estimate = ransac(
        &matches
            .iter()
            .map(|(i, j)| (a[*i], b[*j]))
            .collect::<Vec<_>>(),
        random,
    );
    let corners = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]];
    let corner_error_px = estimate.map_or(f64::MAX, |estimate| {
        let error = |p: [f64; 2]| {
            let (u, v) = (apply(&estimate, p), apply(h, p));
            (u[0] - v[0]).hypot(u[1] - v[1])
        };
        corners.into_iter().map(error).sum::<f64>() / 4.0
    });
    let count = shared.len().max(1) as f64;
    Measured {
        repeatability: repeated as f64 / count,
        score: right as f64 / count,
        right,
        matched: matches.len(),
        corner_error_px,
    }
}

/// Mutual nearest neighbours of two sets of unit rows.
fn mutual_matches(a: &[f32], b: &[f32], d: usize) -> Vec<(usize, usize)> {
    let (n, m) = (a.len() / d, b.len() / d);
    if n == 0 || m == 0 {
        return Vec::new();
    }
    let mut forth = vec![(0, f32::MIN); n];
    let mut back = vec![(0, f32::MIN); m];
    for (i, x) in a.chunks_exact(d).enumerate() {
        for (j, y) in b.chunks_exact(d).enumerate() {
            let s: f32 = x.iter().zip(y).map(|(x, y)| x * y).sum();
            if s > forth[i].1 {
                forth[i] = (j, s);
            }
            if s > back[j].1 {
                back[j] = (i, s);
            }
        }
    }
    (0..n)
        .filter(|i| back[forth[*i].0].0 == *i)
        .map(|i| (i, forth[i].0))
        .collect()
}

type Match = ([f64; 2], [f64; 2]);

/// Least-squares homography (DLT after Hartley's normalisation).
fn fit(matches: &[Match]) -> Option<Matrix3<f64>> {
    let normaliser = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let points: Vec<[f64; 2]> = points.collect();
        let n = points.len() as f64;
        let c = points
            .iter()
            .fold([0.0, 0.0], |s, p| [s[0] + p[0] / n, s[1] + p[1] / n]);
        let spread = points
            .iter()
            .map(|p| (p[0] - c[0]).hypot(p[1] - c[1]))
            .sum::<f64>()
            / n;
        let s = std::f64::consts::SQRT_2 / spread.max(1e-9);
        Matrix3::new(s, 0.0, -s * c[0], 0.0, s, -s * c[1], 0.0, 0.0, 1.0)
    };
    let (t, u) = (
        normaliser(&mut matches.iter().map(|m| m.0)),
        normaliser(&mut matches.iter().map(|m| m.1)),
    );
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in matches {
        let p = t * Vector3::new(p[0], p[1], 1.0);
        let q = u * Vector3::new(q[0], q[1], 1.0);
        let rows = [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
        ];
        for row in rows {
            let row = SMatrix::<f64, 9, 1>::from(row);
            normal += row * row.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let h = eigen.eigenvectors.column(least);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    Some(u.try_inverse()? * h * t)
}

fn ransac(matches: &[Match], random: &mut ChaCha8Rng) -> Option<Matrix3<f64>> {
    if matches.len() < 6 {
        return None;
    }
    let inliers = |h: &Matrix3<f64>| -> Vec<Match> {
        let fits = |(p, q): &&Match| {
            let [x, y] = apply(h, *p);
            (x - q[0]).hypot(y - q[1]) < SAME_PX
        };
        matches.iter().filter(fits).copied().collect()
    };
    let mut best = Vec::new();
    for _ in 0..ROUNDS {
        let sample: Vec<Match> = (0..4)
            .map(|_| matches[random.random_range(0..matches.len())])
            .collect();
        if let Some(found) = fit(&sample).map(|h| inliers(&h))
            && found.len() > best.len()
        {
            best = found;
        }
    }
    if best.len() < 6 {
        return None;
    }
    let refined = fit(&best)?;
    fit(&inliers(&refined)).or(Some(refined))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ransac_finds_a_homography_among_wrong_matches() {
        let truth = Matrix3::new(1.1, 0.1, 5.0, -0.08, 0.95, 3.0, 1e-4, -2e-4, 1.0);
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let matches: Vec<Match> = (0..80)
            .map(|i| {
                let p = [
                    random.random_range(0.0..200.0),
                    random.random_range(0.0..200.0),
                ];
                let q = apply(&truth, p);
                (
                    p,
                    if i % 2 == 0 {
                        q
                    } else {
                        [random.random_range(0.0..200.0), q[0]]
                    },
                )
            })
            .collect();
        let found = ransac(&matches, &mut random).unwrap();
        for p in [[0.0, 0.0], [200.0, 0.0], [100.0, 150.0]] {
            let (a, b) = (apply(&found, p), apply(&truth, p));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-3);
        }
    }
}
