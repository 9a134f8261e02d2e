//! What kind of surface a motion was measured over. Waves, foam, crops in the wind and herds move themselves: from two photos
//! alone that looks like motion of the camera. That a surface is ground is known from the map, where a photo has a fix, and from
//! photo to photo, where the surface moves with such ground.

use crate::{
    frame_features::FrameFeatures,
    geometry::{homography::Homography, transform::Transform as _},
    pipeline::guided_matching::KeypointPair,
    search::{matching::Match, scratch::Scratch},
};

/// So many keypoints on the ground must agree with a motion. By chance hardly one does.
const LEAST_ON_GROUND: usize = 8;
/// Keypoints on the ground must agree at least this much as often as all do, or the motion is that of another surface.
const LEAST_SHARE_OF_ALL: f64 = 0.5;

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Surface {
    /// Ground that the map shows.
    Mapped,
    /// It moved with ground.
    Followed,
    /// Nothing shows that it is ground.
    Unknown,
}

impl Surface {
    /// The surface of the matches in `scratch.guided` that agree with the similarity from the second photo to the first within
    /// `threshold_px`.
    pub fn of(
        first_from_second: &Homography,
        first: &FrameFeatures,
        keypoints: &KeypointPair<'_>,
        threshold_px: f64,
        scratch: &Scratch,
    ) -> Self {
        let agrees = |found: &Match| {
            let from = keypoints.points[found.query as usize].cast::<f64>();
            let to = keypoints.tile_points[found.tile as usize];
            first_from_second
                .map(from)
                .is_some_and(|mapped| nalgebra::distance(&mapped, &to) <= threshold_px)
        };
        let agreeing = scratch.guided.iter().filter(|found| agrees(found));
        let others = scratch.matches.iter().filter(|found| !agrees(found));
        let of_first = |found: &&Match| found.tile as usize;
        Self::from_keypoints(
            first,
            &agreeing.map(|found| of_first(&found)).collect::<Vec<_>>(),
            &others.map(|found| of_first(&found)).collect::<Vec<_>>(),
        )
    }

    /// From the first photo's keypoints that agree with the motion, and those whose most similar keypoint does not.
    fn from_keypoints(first: &FrameFeatures, agreeing: &[usize], others: &[usize]) -> Self {
        let on_ground = |keypoints: &[usize]| {
            let ground = keypoints
                .iter()
                .filter(|&&keypoint| first.is_ground(keypoint));
            ground.count()
        };
        let mapped = agreeing
            .iter()
            .filter(|&&keypoint| first.is_on_map(keypoint))
            .count();
        classify(
            mapped,
            [on_ground(agreeing), on_ground(others)],
            [agreeing.len(), others.len()],
        )
    }

    /// By how much it may have moved itself, 1 sigma per axis, where matches agree within `threshold`; in the same unit.
    pub fn sigma(self, threshold: f64) -> Option<f64> {
        match self {
            Self::Mapped => Some(0.0),
            // Anywhere in a circle of the threshold's radius.
            Self::Followed => Some(0.5 * threshold),
            Self::Unknown => None,
        }
    }
}

/// `mapped` of the agreeing keypoints are on the map; of the keypoints on the ground and of all so many agree and do not.
fn classify(mapped: usize, ground: [usize; 2], all: [usize; 2]) -> Surface {
    let share =
        |[agreeing, others]: [usize; 2]| agreeing as f64 / (agreeing + others).max(1) as f64;
    if ground[0] < LEAST_ON_GROUND || share(ground) < LEAST_SHARE_OF_ALL * share(all) {
        Surface::Unknown
    } else if mapped >= LEAST_ON_GROUND {
        Surface::Mapped
    } else {
        Surface::Followed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_is_ground_if_what_is_known_as_ground_moves_with_it() {
        assert_eq!(classify(20, [30, 20], [60, 40]), Surface::Mapped);
        assert_eq!(classify(3, [30, 20], [60, 40]), Surface::Followed);
        assert_eq!(classify(7, [7, 0], [60, 40]), Surface::Unknown);
        // 60 of 100 agree, but of those on the ground one in eleven: the motion is that of another surface.
        assert_eq!(classify(10, [10, 100], [60, 40]), Surface::Unknown);
        assert_eq!(classify(0, [0, 0], [0, 0]), Surface::Unknown);
    }

    #[test]
    fn ground_that_is_followed_may_move_by_what_matches_cannot_tell() {
        assert_eq!(Surface::Mapped.sigma(10.0), Some(0.0));
        assert_eq!(Surface::Followed.sigma(10.0), Some(5.0));
        assert_eq!(Surface::Unknown.sigma(10.0), None);
    }
}
