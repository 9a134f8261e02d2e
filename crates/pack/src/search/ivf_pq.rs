//! Inverted lists with product-quantised residuals (IVFADC, Jégou, Douze and Schmid 2011), as faiss `IndexIVFPQ`
//! does it with the inner product: a vector goes to the list whose centroid has the largest product with it, its
//! difference to the centroid is cut into parts, each part is replaced by the nearest of 256 codewords. A query is
//! compared as `q c + sum_m q_m codeword_m`. Rows are unit vectors, so products are cosines.

use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt};
use grimnet_net::{KMeans, nearest_by_distance, nearest_by_product};
use rayon::prelude::*;

use super::exact::Filter;
use super::inverted_lists::{are_starts, sort_by_list};
use super::top_k::{Hit, TopK};
use crate::error::{PackError, Result};

/// Codewords of a subquantiser: one byte.
pub const CODEWORDS: usize = 256;

/// Training vectors per centroid below which faiss warns (`Clustering::min_points_per_centroid`).
pub const FEW_POINTS_PER_CENTROID: usize = 39;

/// Maximum number of training vectors per coarse centroid (faiss: `max_points_per_centroid`).
const COARSE_POINTS_PER_CENTROID: usize = 256;

/// Maximum number of training vectors for the codebooks.
const CODEBOOK_POINTS: usize = 64 * CODEWORDS;

/// Lloyd iterations for the coarse centroids and the codebooks (faiss: 10 and 25).
const COARSE_ITERATIONS: usize = 10;
const CODEBOOK_ITERATIONS: usize = 25;

const SEED: u64 = 1477;

/// Centroids and codebooks.
#[derive(Clone, Debug, PartialEq)]
pub struct IvfPqCodec {
    /// Numbers in a vector.
    pub dim: usize,
    /// Coarse centroids, `nlist x dim`.
    pub centroids: Vec<f32>,
    /// Codewords, `subquantisers x 256 x (dim / subquantisers)`.
    pub codebooks: Vec<f32>,
    /// Bytes per vector.
    pub subquantisers: usize,
}

/// Encoded vectors sorted by list.
#[derive(Clone, Debug, PartialEq)]
pub struct IvfPqLists {
    /// Where each list starts, and the total: `nlist + 1`.
    pub list_starts: Vec<u32>,
    /// Index of each vector, ascending within a list.
    pub ids: Vec<u32>,
    /// Codes in the same order, `n x subquantisers`.
    pub codes: Vec<u8>,
}

impl IvfPqCodec {
    /// Checks that an index can be trained.
    ///
    /// # Errors
    /// Returns [`PackError::Index`] with the reason if it cannot.
    pub fn check(vectors: usize, dim: usize, nlist: usize, subquantisers: usize) -> Result<()> {
        if nlist == 0 || subquantisers == 0 || !dim.is_multiple_of(subquantisers.max(1)) {
            return Err(PackError::Index(format!(
                "{subquantisers} subquantisers do not divide descriptors of {dim} numbers into equal parts"
            )));
        }
        let least = nlist.max(CODEWORDS);
        if vectors < least {
            return Err(PackError::Index(format!(
                "it needs at least {least} tiles to be trained, the map has {vectors}"
            )));
        }
        Ok(())
    }

    /// Which of `vectors` vectors to train on: evenly spaced, bounded in number.
    pub fn training_sample(vectors: usize, nlist: usize) -> Vec<usize> {
        let most = (nlist * COARSE_POINTS_PER_CENTROID).clamp(CODEBOOK_POINTS, 1 << 16);
        let count = vectors.min(most);
        (0..count)
            .map(|i| (i as u128 * vectors as u128 / count as u128) as usize)
            .collect()
    }

    /// Trains centroids (spherical k-means) and codebooks (k-means of residuals) on `n x dim` unit vectors.
    ///
    /// # Errors
    /// As [`IvfPqCodec::check`].
    pub fn train(points: &[f32], dim: usize, nlist: usize, subquantisers: usize) -> Result<Self> {
        let n = points.len() / dim.max(1);
        Self::check(n, dim, nlist, subquantisers)?;
        let coarse = KMeans {
            clusters: nlist,
            iterations: COARSE_ITERATIONS,
            spherical: true,
            seed: SEED,
        };
        let centroids = coarse.run(points, dim);
        let step = n.div_ceil(CODEBOOK_POINTS);
        let points: Vec<f32> = points
            .chunks_exact(dim)
            .step_by(step)
            .flat_map(|p| p.iter().copied())
            .collect();
        let residuals = residuals(&centroids, &points, dim).1;
        let part = dim / subquantisers;
        let codebooks = (0..subquantisers)
            .into_par_iter()
            .flat_map_iter(|m| {
                let k_means = KMeans {
                    clusters: CODEWORDS,
                    iterations: CODEBOOK_ITERATIONS,
                    spherical: false,
                    seed: SEED + 1 + m as u64,
                };
                k_means.run(&cut(&residuals, dim, m, part), part)
            })
            .collect();
        Ok(Self {
            dim,
            centroids,
            codebooks,
            subquantisers,
        })
    }

    /// List and code (`n x subquantisers`) of each of `n x dim` vectors.
    pub fn encode(&self, vectors: &[f32]) -> (Vec<u32>, Vec<u8>) {
        let (lists, residuals) = residuals(&self.centroids, vectors, self.dim);
        let part = self.dim / self.subquantisers;
        let columns: Vec<Vec<u32>> = (0..self.subquantisers)
            .into_par_iter()
            .map(|m| {
                let codebook = &self.codebooks[m * CODEWORDS * part..(m + 1) * CODEWORDS * part];
                nearest_by_distance(codebook, &cut(&residuals, self.dim, m, part), part)
            })
            .collect();
        let codes = (0..lists.len())
            .flat_map(|i| columns.iter().map(move |c| c[i] as u8))
            .collect();
        (lists, codes)
    }

    /// Sorts encoded vectors by list.
    pub fn lists(&self, lists: &[u32], codes: &[u8]) -> IvfPqLists {
        let nlist = self.centroids.len() / self.dim;
        let (ids, list_starts) = sort_by_list(lists, nlist);
        let m = self.subquantisers;
        let codes = ids
            .iter()
            .flat_map(|&i| codes[i as usize * m..][..m].iter().copied())
            .collect();
        IvfPqLists {
            list_starts,
            ids,
            codes,
        }
    }

    /// Joins codec and lists for searching.
    pub fn view<'a>(&'a self, lists: &'a IvfPqLists) -> Option<IvfPqView<'a>> {
        IvfPqView::new(
            self.dim,
            self.centroids.len() / self.dim,
            self.subquantisers,
            lists.ids.len(),
            &self.centroids,
            &self.codebooks,
            &lists.list_starts,
            &lists.ids,
            &lists.codes,
        )
    }
}

/// An index whose numbers lie in a mapped file or in memory.
#[derive(Clone, Copy, Debug)]
pub struct IvfPqView<'a> {
    dim: usize,
    nlist: usize,
    subquantisers: usize,
    centroids: &'a [f32],
    codebooks: &'a [f32],
    list_starts: &'a [u32],
    ids: &'a [u32],
    codes: &'a [u8],
}

impl<'a> IvfPqView<'a> {
    /// Checks that the parts fit each other; `None` if they do not.
    #[allow(clippy::too_many_arguments)] // nine numbers and slices of one file; a struct would repeat this one
    pub fn new(
        dim: usize,
        nlist: usize,
        subquantisers: usize,
        vectors: usize,
        centroids: &'a [f32],
        codebooks: &'a [f32],
        list_starts: &'a [u32],
        ids: &'a [u32],
        codes: &'a [u8],
    ) -> Option<Self> {
        let fits = nlist > 0
            && subquantisers > 0
            && dim.is_multiple_of(subquantisers)
            && centroids.len() == nlist.checked_mul(dim)?
            && codebooks.len() == CODEWORDS * dim
            && are_starts(list_starts, nlist, vectors)
            && ids.len() == vectors
            && ids.iter().all(|&id| (id as usize) < vectors)
            && codes.len() == vectors.checked_mul(subquantisers)?;
        fits.then_some(Self {
            dim,
            nlist,
            subquantisers,
            centroids,
            codebooks,
            list_starts,
            ids,
            codes,
        })
    }

    /// Whether the index has this many lists and bytes per code.
    pub fn has_shape(&self, nlist: u32, subquantisers: u32) -> bool {
        (self.nlist, self.subquantisers) == (nlist as usize, subquantisers as usize)
    }

    /// The `k` best vectors of each query (`q x dim`), looking into `nprobe` lists.
    pub fn search(
        &self,
        queries: &[f32],
        k: usize,
        nprobe: usize,
        filter: Option<Filter<'_>>,
    ) -> Vec<Vec<Hit>> {
        queries
            .par_chunks_exact(self.dim)
            .map(|q| self.search_one(q, k, nprobe, filter))
            .collect()
    }

    fn search_one(
        &self,
        query: &[f32],
        k: usize,
        nprobe: usize,
        filter: Option<Filter<'_>>,
    ) -> Vec<Hit> {
        let mut coarse = vec![0.0; self.nlist];
        matmul_nt(
            Isa::detect(),
            MatRef::new(query, 1, self.dim),
            MatRef::new(self.centroids, self.nlist, self.dim),
            MatMut::new(&mut coarse, 1, self.nlist),
        );
        let mut visit = TopK::new(nprobe.clamp(1, self.nlist));
        for (tile, &similarity) in coarse.iter().enumerate() {
            visit.push(Hit { tile, similarity });
        }
        let part = self.dim / self.subquantisers;
        let table: Vec<f32> = self
            .codebooks
            .chunks_exact(part)
            .enumerate()
            .map(|(word, codeword)| {
                let query = &query[word / CODEWORDS * part..][..part];
                query.iter().zip(codeword).map(|(a, b)| a * b).sum()
            })
            .collect();
        let mut best = TopK::new(k);
        for Hit {
            tile: list,
            similarity: base,
        } in visit.into_sorted()
        {
            for at in self.list_starts[list] as usize..self.list_starts[list + 1] as usize {
                let code = &self.codes[at * self.subquantisers..][..self.subquantisers];
                let residual: f32 = table
                    .chunks_exact(CODEWORDS)
                    .zip(code)
                    .map(|(words, &byte)| words[byte as usize])
                    .sum();
                let (tile, similarity) = (self.ids[at] as usize, base + residual);
                if best.may_take(similarity) && filter.is_none_or(|keep| keep(tile)) {
                    best.push(Hit { tile, similarity });
                }
            }
        }
        best.into_sorted()
    }
}

/// List of each vector, and the vector less its centroid.
fn residuals(centroids: &[f32], vectors: &[f32], dim: usize) -> (Vec<u32>, Vec<f32>) {
    let lists = nearest_by_product(centroids, vectors, dim);
    let residuals = vectors
        .chunks_exact(dim)
        .zip(&lists)
        .flat_map(|(vector, &list)| {
            let centroid = &centroids[list as usize * dim..][..dim];
            vector.iter().zip(centroid).map(|(v, c)| v - c)
        })
        .collect();
    (lists, residuals)
}

/// Part `m` (`part` numbers) of each vector, side by side.
fn cut(vectors: &[f32], dim: usize, m: usize, part: usize) -> Vec<f32> {
    vectors
        .chunks_exact(dim)
        .flat_map(|v| v[m * part..(m + 1) * part].iter().copied())
        .collect()
}
