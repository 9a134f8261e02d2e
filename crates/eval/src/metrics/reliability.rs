//! Reliability of the stated confidences: how often fixes of a stated confidence are right (DeGroot & Fienberg 1983).

use serde::Serialize;

use super::footprint::is_right;
use super::frame::Frame;
use super::statistics::wilson_interval;

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
    /// 95 % interval of `right_share` (Wilson 1927).
    pub right_share_interval: [f64; 2],
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
        let fixes: Vec<(f64, bool)> = frames
            .iter()
            .filter(|frame| frame.fixed)
            .filter_map(|frame| Some((frame.confidence?, is_right(frame))))
            .collect();
        if fixes.is_empty() {
            return None;
        }
        let bins: Vec<Bin> = LIMITS
            .windows(2)
            .filter_map(|limits| Bin::of(&fixes, limits[0], limits[1]))
            .collect();
        let count = fixes.len() as f64;
        let outcome = |right: bool| f64::from(u8::from(right));
        Some(Self {
            fixes: fixes.len(),
            calibration_error: bins
                .iter()
                .map(|bin| bin.fixes as f64 * (bin.mean_confidence - bin.right_share).abs())
                .sum::<f64>()
                / count,
            brier: fixes
                .iter()
                .map(|(confidence, right)| (confidence - outcome(*right)).powi(2))
                .sum::<f64>()
                / count,
            bins,
        })
    }
}

impl Bin {
    fn of(fixes: &[(f64, bool)], from: f64, to: f64) -> Option<Self> {
        let inside: Vec<(f64, bool)> = fixes
            .iter()
            .copied()
            .filter(|(confidence, _)| {
                (from..to).contains(confidence) || (to >= 1.0 && *confidence >= to)
            })
            .collect();
        let right = inside.iter().filter(|(_, right)| *right).count();
        let count = inside.len();
        let right_share = right as f64 / count.max(1) as f64;
        (count > 0).then(|| Self {
            from,
            to,
            fixes: count,
            right,
            mean_confidence: inside.iter().map(|(c, _)| c).sum::<f64>() / count as f64,
            right_share,
            right_share_interval: wilson_interval(right_share, count),
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
