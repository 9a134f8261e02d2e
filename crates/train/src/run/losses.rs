//! The values of the losses.

/// The losses of a step, or their mean over several steps; 0 for losses that were not computed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Keypoint cross-entropy.
    pub keypoint: f32,
    /// Loss of local descriptors.
    pub descriptor: f32,
    /// Loss of global descriptors.
    pub global: f32,
    /// Homography reprojection, in units of `homography.unit_px`.
    pub homography: f32,
    /// Distillation of the teacher's keypoint probabilities.
    pub taught_keypoint: f32,
    /// Distillation of the teacher's local descriptors: 1 - cosine.
    pub taught_descriptor: f32,
    /// Distillation of the teacher's similarities of global descriptors.
    pub taught_global: f32,
    /// Cross-entropy over scene classes.
    pub scene: f32,
}

impl Losses {
    /// Names and values.
    pub fn terms(&self) -> [(&'static str, f32); 8] {
        [
            ("keypoint loss", self.keypoint),
            ("descriptor loss", self.descriptor),
            ("global loss", self.global),
            ("homography loss", self.homography),
            ("taught keypoint loss", self.taught_keypoint),
            ("taught descriptor loss", self.taught_descriptor),
            ("taught global loss", self.taught_global),
            ("scene loss", self.scene),
        ]
    }

    fn slots(&mut self) -> [&mut f32; 8] {
        [
            &mut self.keypoint,
            &mut self.descriptor,
            &mut self.global,
            &mut self.homography,
            &mut self.taught_keypoint,
            &mut self.taught_descriptor,
            &mut self.taught_global,
            &mut self.scene,
        ]
    }

    /// Adds the losses of another step.
    pub fn add(&mut self, other: &Losses) {
        for (slot, (_, value)) in self.slots().into_iter().zip(other.terms()) {
            *slot += value;
        }
    }

    /// All losses multiplied by a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Self {
        self.slots().into_iter().for_each(|slot| *slot *= factor);
        self
    }
}
