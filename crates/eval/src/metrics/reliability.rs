//! Reliability of the stated confidences: how often fixes of a stated confidence are right (DeGroot & Fienberg 1983).

use serde::Serialize;

use super::footprint::{is_right, outcome};
use super::frame::Frame;
use super::places::{by_place, places};
use super::statistics::{grouped_share_interval, mean};

/// Limits of the bins of confidence: fine near one, where fixes are given.
const LIMITS: [f64; 12] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1.0];

/// The fixes with a confidence in one range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bin {
    /// Lowest confidence of the bin.
    pub from: f64,
    /// Highest confidence of the bin; it belongs to the next bin, except 1.
    pub to: f64,
    /// Fixes in it.
    pub fixes: usize,
    /// Those that are right.
    pub right: usize,
    /// Mean stated confidence.
    pub mean_confidence: f64,
    /// Share of right fixes.
    pub right_share: f64,
    /// 95 % interval of `right_share`, by place as in [`FootprintSummary`](super::footprint::FootprintSummary).
    pub right_share_interval: [f64; 2],
    /// Places that the fixes are of.
    pub places: usize,
}

/// How the stated confidences of a run agree with how often its fixes are right.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reliability {
    /// Fixes with a stated confidence.
    pub fixes: usize,
    /// The bins that hold fixes, lowest confidence first.
    pub bins: Vec<Bin>,
    /// Mean over all fixes of the difference between stated confidence and share of right fixes in its bin (expected calibration
    /// error, Naeini et al. 2015).
    pub calibration_error: f64,
    /// Mean of the squared difference between stated confidence and outcome (Brier 1950); 0 is best.
    pub brier: f64,
}

impl Reliability {
    /// Reliability of the fixes of a run; `None` if none has a confidence.
    #[must_use]
    pub fn of(frames: &[Frame]) -> Option<Self> {
        let fixes: Vec<(&Frame, f64)> = frames
            .iter()
            .filter(|frame| frame.fixed)
            .filter_map(|frame| Some((frame, frame.confidence?)))
            .collect();
        if fixes.is_empty() {
            return None;
        }
        let bins: Vec<Bin> = LIMITS
            .windows(2)
            .filter_map(|limits| Bin::of(&fixes, limits[0], limits[1]))
            .collect();
        let count = fixes.len() as f64;
        Some(Self {
            fixes: fixes.len(),
            calibration_error: bins
                .iter()
                .map(|bin| bin.fixes as f64 * (bin.mean_confidence - bin.right_share).abs())
                .sum::<f64>()
                / count,
            brier: fixes
                .iter()
                .map(|(frame, confidence)| (confidence - outcome(frame)).powi(2))
                .sum::<f64>()
                / count,
            bins,
        })
    }
}

impl Bin {
    /// Those of the fixes, with their confidences, that are in a range.
    fn of(fixes: &[(&Frame, f64)], from: f64, to: f64) -> Option<Self> {
        let is_inside =
            |confidence: f64| (from..to).contains(&confidence) || (to >= 1.0 && confidence >= to);
        let inside = fixes
            .iter()
            .filter(|(_, confidence)| is_inside(*confidence));
        let (frames, confidences): (Vec<&Frame>, Vec<f64>) = inside.copied().unzip();
        let right_by_place = by_place(&places(&frames), |frame| Some(outcome(frame)));
        Some(Self {
            from,
            to,
            fixes: frames.len(),
            right: frames.iter().filter(|frame| is_right(frame)).count(),
            mean_confidence: mean(&confidences)?,
            right_share: mean(&right_by_place.concat())?,
            right_share_interval: grouped_share_interval(&right_by_place),
            places: right_by_place.len(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn frame(confidence: f64, error_m: f64) -> Frame {
        Frame {
            fixed: true,
            confidence: Some(confidence),
            error_m: Some(error_m),
            ..Frame::default()
        }
    }

    #[test]
    fn bins_of_a_case_done_by_hand() {
        let frames = [
            frame(0.55, 1.0),
            frame(0.57, 50.0),
            frame(0.95, 3.0),
            frame(1.0, 3.0),
            Frame::missed("a", "nothing"),
        ];
        let found = Reliability::of(&frames).unwrap();
        assert_eq!(found.fixes, 4);
        let bins: Vec<(f64, usize, usize)> = found
            .bins
            .iter()
            .map(|b| (b.from, b.fixes, b.right))
            .collect();
        assert_eq!(bins, [(0.5, 2, 1), (0.9, 1, 1), (0.97, 1, 1)]);
        let of_one_place = frames.map(|frame| Frame {
            place: Some("field".to_owned()),
            ..frame
        });
        let by_place = Reliability::of(&of_one_place).unwrap().bins[0];
        assert_eq!((found.bins[0].places, by_place.places), (2, 1));
        let widths = [found.bins[0], by_place].map(|bin| {
            let [low, high] = bin.right_share_interval;
            high - low
        });
        assert_eq!(
            widths[0], 1.0,
            "one right, one wrong: any share may be drawn"
        );
        assert!(widths[1] > 0.85, "one place says as little: {widths:?}");
        assert_relative_eq!(found.bins[0].mean_confidence, 0.56, epsilon = 1e-12);
        assert_relative_eq!(
            found.calibration_error,
            (2.0 * 0.06 + 0.05) / 4.0,
            epsilon = 1e-12
        );
        let brier = (0.45f64.powi(2) + 0.57f64.powi(2) + 0.05f64.powi(2)) / 4.0;
        assert_relative_eq!(found.brier, brier, epsilon = 1e-12);
        assert_eq!(Reliability::of(&[Frame::missed("a", "nothing")]), None);
    }
}
