//! The network's output for every position of an image.

use std::sync::Arc;

use grimnet_kernels::Tensor;
use image::GrayImage;

use crate::extractor::Shared;
use crate::forward::Output;
use crate::spec::KEYPOINT_CELL_PX;
use crate::{ExtractOptions, Keypoint, VladSum, describe, keypoints};

/// Heatmap, descriptor field and NetVLAD field of one image, from which the features of any window are computed. The memory
/// returns to the [`crate::Extractor`] when this is dropped.
pub struct Dense {
    output: Output,
    shared: Arc<Shared>,
}

impl Dense {
    pub(crate) fn new(output: Output, shared: Arc<Shared>) -> Self {
        Self { output, shared }
    }

    /// Width of the image.
    pub fn width_px(&self) -> u32 {
        self.output.descriptors.width() as u32 * KEYPOINT_CELL_PX
    }

    /// Height of the image.
    pub fn height_px(&self) -> u32 {
        self.output.descriptors.height() as u32 * KEYPOINT_CELL_PX
    }

    /// Probability of each pixel to be a keypoint, row by row: height x width values.
    pub fn heatmap(&self) -> &[f32] {
        &self.output.heatmap
    }

    /// One descriptor for each 8 x 8 px cell, (height / 8) x (width / 8) x D, not scaled to unit length.
    pub fn descriptors(&self) -> &Tensor {
        &self.output.descriptors
    }

    /// Keypoints inside the window (left, top, width, height; clipped to the image), strongest first. Keypoints near masked
    /// pixels are ignored (the mask is that of the whole image; 0 is masked). Each of several adjacent windows gets the
    /// keypoints that the whole image has there.
    pub fn keypoints(
        &self,
        window_px: [u32; 4],
        options: &ExtractOptions,
        mask: Option<&GrayImage>,
    ) -> Vec<Keypoint> {
        let window = self.clip(window_px).map(|v| v as usize);
        keypoints::keypoints(
            &self.output.heatmap,
            self.width_px() as usize,
            window,
            options,
            mask,
        )
    }

    /// Descriptors of points of this image: n x D values, each row of unit length.
    pub fn describe(&self, keypoints: &[Keypoint]) -> Vec<f32> {
        describe::describe(self.shared.isa, &self.output.descriptors, keypoints)
    }

    /// The NetVLAD sum over the window (left, top, width, height; clipped to the image): over all positions
    /// ([`crate::NetSpec::vlad_pitch_px`] apart) whose centre lies in it and of whose square at least half is visible in the
    /// mask. The sums of adjacent windows add up to that of the whole.
    pub fn vlad(&self, window_px: [u32; 4], mask: Option<&GrayImage>) -> VladSum {
        let Shared {
            isa,
            vlad,
            vlad_input,
            ..
        } = &*self.shared;
        let vectors = self.output.vlad_vectors(*vlad_input);
        let window = self.clip(window_px);
        self.shared.with_vlad_scratch(|scratch| {
            vlad.sum(*isa, vectors, &self.output.vlad, window, mask, scratch)
        })
    }

    /// The window that is the whole image.
    pub(crate) fn whole(&self) -> [u32; 4] {
        [0, 0, self.width_px(), self.height_px()]
    }

    /// From left, top, width, height to left, top, right, bottom within the image.
    fn clip(&self, [x, y, width, height]: [u32; 4]) -> [u32; 4] {
        let (right, bottom) = (
            x.saturating_add(width).min(self.width_px()),
            y.saturating_add(height).min(self.height_px()),
        );
        [x.min(right), y.min(bottom), right, bottom]
    }
}

impl Drop for Dense {
    fn drop(&mut self) {
        self.shared.give_back(std::mem::take(&mut self.output));
    }
}

impl std::fmt::Debug for Dense {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Dense({} x {} px)", self.width_px(), self.height_px())
    }
}
