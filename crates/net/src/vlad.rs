//! NetVLAD (paper, eq. 5-7; Arandjelovic et al. 2016) as sums that can be added.

use std::ops::AddAssign;

use grimnet_kernels::{Isa, MatMut, MatRef, PlainKernel, Tensor, matmul_nn};
use image::GrayImage;
use rayon::prelude::*;

use crate::describe::{inverse_norm, normalise};

use crate::seen::square_is_seen;
use crate::softmax::softmax;
use crate::{Model, NetError};

/// Unnormalised VLAD of a part of an image: K x D, row k is the sum over positions n of a_nk (u_n - c_k), where u_n is the
/// position's vector, scaled to unit length unless the network has [`crate::VladInput::DeepestUnscaled`], and a_n its soft
/// assignment. The sums of parts add up to the sum of the whole.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VladSum(Vec<f32>);

impl VladSum {
    /// From the K x D values of [`VladSum::as_slice`].
    pub fn from_vec(values: Vec<f32>) -> Self {
        Self(values)
    }

    /// The K x D values; empty for the default, which is the sum over no positions.
    pub fn as_slice(&self) -> &[f32] {
        &self.0
    }

    /// Writes the VLAD vector (each row of `dim` values scaled to unit length, then the whole) to `out`, of K x D values.
    pub(crate) fn normalise_into(&self, dim: usize, out: &mut [f32]) {
        let len = self.0.len().min(out.len());
        out[..len].copy_from_slice(&self.0[..len]);
        out[len..].fill(0.0);
        out.chunks_exact_mut(dim).for_each(normalise);
        normalise(out);
    }
}

impl AddAssign<&VladSum> for VladSum {
    fn add_assign(&mut self, other: &VladSum) {
        if self.0.len() < other.0.len() {
            self.0.resize(other.0.len(), 0.0);
        }
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a += b);
    }
}

impl AddAssign for VladSum {
    fn add_assign(&mut self, other: VladSum) {
        *self += &other;
    }
}

/// The layer's parameters, without the assignment's weights, which are a convolution of the network.
pub(crate) struct VladLayer {
    pub clusters: usize,
    pub pitch_px: u32,
    /// Whether vectors are scaled to unit length.
    scaled: bool,
    assign_bias: Vec<f32>,
    centres: Vec<f32>,
}

/// Clusters whose assignments are transposed together: a cache line of floats.
const CLUSTER_BLOCK: usize = 16;

/// Fewest positions whose vectors one task gathers.
const POSITIONS: usize = 64;

/// What the layer computes for an image: enough for the sum over any window.
#[derive(Default)]
pub(crate) struct VladField {
    /// Soft assignments: positions x clusters.
    assignments: Vec<f32>,
    /// The factor of each position's vector: the reciprocal of its length, or 1 if it is not scaled.
    inverse_norms: Vec<f32>,
}

/// Scratch memory of a window's sum.
#[derive(Default)]
pub(crate) struct VladScratch {
    assignments_by_cluster: Vec<f32>,
    vectors: Vec<f32>,
    positions: Vec<(u32, u32)>,
}

impl VladLayer {
    pub(crate) fn new(model: &Model) -> Result<Self, NetError> {
        let spec = model.spec();
        Ok(Self {
            clusters: spec.vlad.clusters,
            pitch_px: spec.vlad_pitch_px(),
            scaled: spec.vlad.input.is_scaled(),
            assign_bias: model.values("netvlad.assign.bias")?,
            centres: model.values("netvlad.centres")?,
        })
    }

    /// Computes the soft assignments of all positions. `products` holds for each position the products of the assignment's
    /// weights with its unscaled vector; they are divided by the length here.
    pub(crate) fn assign(
        &self,
        isa: Isa,
        vectors: &Tensor,
        products: &Tensor,
        field: &mut VladField,
    ) {
        let (height, width, clusters) = (vectors.height(), vectors.width(), self.clusters);
        field.assignments.resize(height * width * clusters, 0.0);
        field.inverse_norms.resize(height * width, 0.0);
        let norms = field.inverse_norms.par_chunks_exact_mut(width);
        let rows = field
            .assignments
            .par_chunks_exact_mut(width * clusters)
            .zip(norms);
        rows.enumerate().for_each(|(y, (assignments, norms))| {
            isa.vectorise(AssignRow {
                vectors,
                products,
                y,
                scaled: self.scaled,
                bias: &self.assign_bias,
                assignments,
                norms,
            });
        });
    }

    /// The sum over the visible positions whose centres lie in the window (left, top, right, bottom in pixels).
    pub(crate) fn sum(
        &self,
        isa: Isa,
        vectors: &Tensor,
        field: &VladField,
        [left, top, right, bottom]: [u32; 4],
        mask: Option<&GrayImage>,
        scratch: &mut VladScratch,
    ) -> VladSum {
        let (clusters, dim, pitch) = (self.clusters, vectors.channels(), self.pitch_px);
        let first = |from: u32| (from.saturating_sub(pitch / 2)).div_ceil(pitch);
        let (columns, rows) = (first(left)..first(right), first(top)..first(bottom));
        let VladScratch {
            assignments_by_cluster,
            vectors: gathered,
            positions,
        } = scratch;
        positions.clear();
        positions.extend(
            rows.flat_map(|y| columns.clone().map(move |x| (y, x)))
                .filter(|&(y, x)| {
                    mask.is_none_or(|mask| square_is_seen(mask, x * pitch, y * pitch, pitch))
                }),
        );
        let count = positions.len();
        gathered.resize(count * dim, 0.0);
        assignments_by_cluster.resize(clusters * count, 0.0);
        let index = |&(y, x): &(u32, u32)| {
            (
                y as usize,
                x as usize,
                y as usize * vectors.width() + x as usize,
            )
        };
        gathered
            .par_chunks_exact_mut(dim)
            .zip(&*positions)
            .with_min_len(POSITIONS)
            .for_each(|(row, position)| {
                let (y, x, at) = index(position);
                let norm = field.inverse_norms[at];
                row.iter_mut()
                    .zip(vectors.pixel(y, x))
                    .for_each(|(out, v)| *out = v * norm);
            });
        let mut sum = vec![0.0; clusters * dim];
        if count > 0 {
            assignments_by_cluster
                .par_chunks_mut(CLUSTER_BLOCK * count)
                .enumerate()
                .for_each(|(block, lines)| {
                    let (first, block) = (block * CLUSTER_BLOCK, lines.len() / count);
                    for (i, position) in positions.iter().enumerate() {
                        let (_, _, at) = index(position);
                        let row = &field.assignments[at * clusters + first..][..block];
                        for (out, a) in lines.iter_mut().skip(i).step_by(count).zip(row) {
                            *out = *a;
                        }
                    }
                });
            matmul_nn(
                isa,
                MatRef::new(assignments_by_cluster, clusters, count),
                MatRef::new(gathered, count, dim),
                MatMut::new(&mut sum, clusters, dim),
            );
            sum.par_chunks_exact_mut(dim)
                .zip(assignments_by_cluster.par_chunks_exact(count))
                .zip(self.centres.par_chunks_exact(dim))
                .for_each(|((row, line), centre)| {
                    let mass = sum_f64(line) as f32;
                    row.iter_mut().zip(centre).for_each(|(v, c)| *v -= mass * c);
                });
        }
        VladSum(sum)
    }
}

/// The sum in double precision, in partial sums that do not wait for each other.
fn sum_f64(values: &[f32]) -> f64 {
    let (chunks, rest) = values.as_chunks::<8>();
    let mut sums = [0.0f64; 8];
    for chunk in chunks {
        for (sum, &v) in sums.iter_mut().zip(chunk) {
            *sum += f64::from(v);
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|&v| f64::from(v)).sum::<f64>()
}

/// A row of positions to be assigned.
struct AssignRow<'a> {
    vectors: &'a Tensor,
    products: &'a Tensor,
    y: usize,
    scaled: bool,
    bias: &'a [f32],
    assignments: &'a mut [f32],
    norms: &'a mut [f32],
}

impl PlainKernel for AssignRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let rows = self
            .assignments
            .chunks_exact_mut(self.bias.len())
            .zip(self.norms);
        for (x, (row, norm)) in rows.enumerate() {
            *norm = if self.scaled {
                inverse_norm(self.vectors.pixel(self.y, x))
            } else {
                1.0
            };
            let products = self.products.pixel(self.y, x);
            for ((v, product), bias) in row.iter_mut().zip(products).zip(self.bias) {
                *v = product * *norm + bias;
            }
            softmax(row);
        }
    }
}
