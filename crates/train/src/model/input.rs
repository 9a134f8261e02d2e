//! The network's input: pictures of both domains as tensors.

use crate::data::Pair;
use burn::tensor::{Device, Tensor, TensorData};
use grimnet_net::{Domain, NetSpec};
use image::RgbImage;
use serde::{Deserialize, Serialize};

/// Consecutive pictures of a batch that belong to one domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Number of pictures.
    pub pictures: usize,
    /// Their domain.
    pub domain: Domain,
}

/// A batch in the layout of the network.
#[derive(Clone, Debug)]
pub struct Input {
    /// `[n, h, w, 3]`, normalised by the mean and standard deviation of the description; sides are multiples of 32.
    pub pictures: Tensor<4>,
    /// `[n, h / 8, w / 8, 64]`: mean of the channels, with each 8 x 8 cell in row-major order.
    pub grey_cells: Tensor<4>,
    /// `[n, (h / 8) * (w / 8), 1]`: 1 for cells inside the picture, 0 for cells outside.
    pub seen: Tensor<3>,
    /// The parts of the batch in order; their pictures add up to n.
    pub parts: Vec<Part>,
}

/// Builds an [`Input`]. Black pixels in cells outside the picture are replaced by the mean colour.
pub struct InputBuilder {
    table: [[f32; 256]; 3],
    pictures: Vec<f32>,
    grey: Vec<f32>,
    seen: Vec<f32>,
    parts: Vec<Part>,
    size_px: (usize, usize),
}

impl InputBuilder {
    /// For pictures of this size.
    pub fn new(spec: &NetSpec, width_px: usize, height_px: usize) -> Self {
        let value =
            |c: usize, v: usize| (v as f32 / 255.0 - spec.input_mean[c]) / spec.input_std[c];
        Self {
            table: std::array::from_fn(|c| std::array::from_fn(|v| value(c, v))),
            pictures: Vec::new(),
            grey: Vec::new(),
            seen: Vec::new(),
            parts: Vec::new(),
            size_px: (width_px, height_px),
        }
    }

    /// Adds a picture; `seen` says for each 8 x 8 cell whether it is inside the picture (`None`: all are).
    pub fn push(&mut self, image: &RgbImage, seen: Option<&[bool]>, domain: Domain) {
        let (width, height) = self.size_px;
        let (columns, rows) = (width / 8, height / 8);
        let (first, first_grey) = (self.pictures.len(), self.grey.len());
        self.pictures.resize(first + width * height * 3, 0.0);
        self.grey.resize(first_grey + width * height, 0.0);
        let (pictures, grey) = (&mut self.pictures[first..], &mut self.grey[first_grey..]);
        for (i, pixel) in image.as_raw().chunks_exact(3).enumerate() {
            let (x, y) = (i % width, i / width);
            let cell = (y / 8) * columns + x / 8;
            if seen.is_some_and(|seen| !seen[cell]) && pixel == [0; 3] {
                continue;
            }
            let mut sum = 0.0;
            for c in 0..3 {
                let value = self.table[c][pixel[c] as usize];
                pictures[i * 3 + c] = value;
                sum += value;
            }
            grey[cell * 64 + (y % 8) * 8 + x % 8] = sum / 3.0;
        }
        match seen {
            Some(seen) => self
                .seen
                .extend(seen.iter().map(|s| f32::from(u8::from(*s)))),
            None => self.seen.extend(std::iter::repeat_n(1.0, columns * rows)),
        }
        match self.parts.last_mut() {
            Some(part) if part.domain == domain => part.pictures += 1,
            _ => self.parts.push(Part {
                pictures: 1,
                domain,
            }),
        }
    }

    /// Copies everything to the device.
    pub fn finish(self, device: &Device) -> Input {
        let (width, height) = self.size_px;
        let n: usize = self.parts.iter().map(|part| part.pictures).sum();
        let cells = (width / 8) * (height / 8);
        Input {
            pictures: Tensor::from_data(
                TensorData::new(self.pictures, [n, height, width, 3]),
                device,
            ),
            grey_cells: Tensor::from_data(
                TensorData::new(self.grey, [n, height / 8, width / 8, 64]),
                device,
            ),
            seen: Tensor::from_data(TensorData::new(self.seen, [n, cells, 1]), device),
            parts: self.parts,
        }
    }
}

/// Which views share normalisation statistics and parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Norms {
    /// Each domain has its own (DA-BN; paper, eq. 3).
    #[default]
    ByDomain,
    /// Photos use those of the maps: plain batch normalisation, for comparison (paper, table 10).
    Joint,
}

/// The input of a batch of pairs: all map views first, then all photos.
pub fn input_of(pairs: &[Pair], spec: &NetSpec, norms: Norms, device: &Device) -> Input {
    let side = pairs.first().map_or(0, |pair| pair.sat.width() as usize);
    let mut builder = InputBuilder::new(spec, side, side);
    for pair in pairs {
        builder.push(&pair.sat, None, Domain::Sat);
    }
    for pair in pairs {
        let domain = match norms {
            Norms::ByDomain => Domain::Uav,
            Norms::Joint => Domain::Sat,
        };
        builder.push(&pair.uav, Some(&pair.uav_seen), domain);
    }
    builder.finish(device)
}
