//! The network's answer at every place of a picture.

use std::sync::Arc;

use grimnet_kernels::Tensor;
use image::GrayImage;

use crate::extractor::Shared;
use crate::forward::Output;
use crate::spec::KEYPOINT_CELL_PX;
use crate::{ExtractOptions, Keypoint, VladSum, describe, keypoints};

/// Heatmap, descriptor field and NetVLAD field of one picture, from which the features of any window are taken. Its memory
/// goes back to the [`crate::Extractor`] when it is dropped.
pub struct Dense {
    output: Output,
    shared: Arc<Shared>,
}

impl Dense {
    pub(crate) fn new(output: Output, shared: Arc<Shared>) -> Self {
        Self { output, shared }
    }

    /// Width of the picture.
    pub fn width_px(&self) -> u32 {
        self.output.descriptors.width() as u32 * KEYPOINT_CELL_PX
    }

    /// Height of the picture.
    pub fn height_px(&self) -> u32 {
        self.output.descriptors.height() as u32 * KEYPOINT_CELL_PX
    }

    /// The probability of each pixel to be a keypoint, row by row: height x width values.
    pub fn heatmap(&self) -> &[f32] {
        &self.output.heatmap
    }

    /// One vector for each 8 x 8 px cell, (height / 8) x (width / 8) x D, not of unit length.
    pub fn descriptors(&self) -> &Tensor {
        &self.output.descriptors
    }

    /// Keypoints inside the window (left, top, width, height; clipped to the picture), strongest first. Places near pixels
    /// that the mask (of the whole picture) does not show are left out. Of windows side by side, each gets the keypoints that
    /// the whole picture would have there.
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

    /// Descriptors of points of this picture: n x D, each row of unit length.
    pub fn describe(&self, keypoints: &[Keypoint]) -> Vec<f32> {
        describe::describe(self.shared.isa, &self.output.descriptors, keypoints)
    }

    /// The NetVLAD sum over the window (left, top, width, height; clipped to the picture): over all positions (8 px apart in
    /// `compact`, 32 px in `vgg16`) whose centre lies in it and whose square the mask shows at least by half. Sums of windows
    /// side by side add up to that of the whole.
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

    /// The whole picture as a window.
    pub(crate) fn whole(&self) -> [u32; 4] {
        [0, 0, self.width_px(), self.height_px()]
    }

    /// From left, top, width, height to left, top, right, bottom inside the picture.
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
