//! The features of a query: keypoints, descriptors, and the position of the photo's centre.

use grimnet_net::{Dense, ExtractOptions, Extractor, Features, Purpose};
use grimnet_pack::quantise::{descriptor_scale, quantise_descriptors};
use grimnet_pack::{DescriptorType, LocalDescriptors};
use grimnet_photo::QueryPx;
use image::{GrayImage, RgbImage};
use nalgebra::{Matrix3, Point2};

use crate::{
    error::Result,
    options::{Adapt, Options},
    search::matching::Descriptors,
};

/// Features of one query. Points are continuous pixels: the centre of the top-left pixel is (0.5, 0.5).
#[derive(Debug, Clone)]
pub(crate) struct QueryFeatures {
    /// Keypoints, strongest first, query pixels.
    pub points: Vec<Point2<f32>>,
    /// Probabilities of the keypoints.
    pub scores: Vec<f32>,
    /// Their descriptors, n x dim, of the same type as those of the pack.
    descriptors: LocalDescriptors,
    /// Dimension of a descriptor.
    pub dim: usize,
    /// The global descriptor.
    pub global: Vec<f32>,
    /// The photo's centre.
    pub centre_px: QueryPx,
    /// Half the square root of the photo's visible area, query pixels.
    pub half_side_px: f64,
    /// Pixels of `Photo::image` from query pixels, both continuous.
    pub photo_px_from_query_px: Matrix3<f64>,
}

/// Added to the network's integer pixel indices to get continuous pixels.
pub(crate) const PIXEL_CENTRE: f32 = 0.5;

/// A photo with fewer keypoints than this cannot be localised.
pub(crate) const MIN_KEYPOINTS: usize = 8;

impl QueryFeatures {
    /// Runs the network over a query for this purpose and returns the network's output, too. The query's descriptors become
    /// `descriptor_type`, that of the level they are compared with.
    pub fn extract(
        (extractor, purpose): (&Extractor, Purpose),
        image: &RgbImage,
        mask: Option<&GrayImage>,
        photo_px_from_query_px: Matrix3<f64>,
        descriptor_type: DescriptorType,
        options: &Options,
    ) -> Result<(Self, Dense)> {
        let extract = ExtractOptions {
            threshold: options.keypoint_threshold,
            max_keypoints: options.max_keypoints,
            nms_radius_px: options.nms_radius_px,
        };
        let dense = match options.adapt {
            Adapt::Photo => extractor.dense_instance(image, mask)?.0,
            Adapt::None | Adapt::Flight => extractor.dense_for(purpose, image, mask)?,
        };
        let features = extractor.features_of(&dense, mask, &extract);
        let seen_px = mask.map_or(image.width() as usize * image.height() as usize, |mask| {
            mask.as_raw().iter().filter(|&&seen| seen > 0).count()
        });
        let query = Self::new(
            &features,
            image.dimensions(),
            seen_px,
            photo_px_from_query_px,
            descriptor_type,
        );
        Ok((query, dense))
    }

    fn new(
        features: &Features,
        size_px: (u32, u32),
        seen_px: usize,
        photo_px_from_query_px: Matrix3<f64>,
        descriptor_type: DescriptorType,
    ) -> Self {
        let dim = features.descriptor_dim;
        let points = features
            .keypoints
            .iter()
            .map(|point| Point2::new(point.x_px + PIXEL_CENTRE, point.y_px + PIXEL_CENTRE));
        Self {
            points: points.collect(),
            scores: features.keypoints.iter().map(|point| point.score).collect(),
            descriptors: match descriptor_type {
                DescriptorType::Int8 => LocalDescriptors::Int8 {
                    values: quantise_descriptors(&features.descriptors, dim),
                    scale: descriptor_scale(dim),
                },
                DescriptorType::Float32 => LocalDescriptors::Float32(features.descriptors.clone()),
            },
            dim,
            global: features.global.clone(),
            centre_px: QueryPx::new(f64::from(size_px.0) / 2.0, f64::from(size_px.1) / 2.0),
            half_side_px: (seen_px as f64).sqrt() / 2.0,
            photo_px_from_query_px,
        }
    }

    /// Descriptors of the `most` strongest keypoints in single precision, n x dim.
    pub fn strongest_in_f32(&self, most: usize) -> Vec<f32> {
        match self.strongest(most) {
            Descriptors::I8 { values, scale } => {
                values.iter().map(|&v| f32::from(v) * scale).collect()
            }
            Descriptors::F32(values) => values.to_vec(),
        }
    }

    /// Descriptors of the `most` strongest keypoints.
    pub fn strongest(&self, most: usize) -> Descriptors<'_> {
        let count = self.points.len().min(most) * self.dim;
        match &self.descriptors {
            LocalDescriptors::Int8 { values, scale } => Descriptors::I8 {
                values: &values[..count],
                scale: *scale,
            },
            LocalDescriptors::Float32(values) => Descriptors::F32(&values[..count]),
        }
    }
}
