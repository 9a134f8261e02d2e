//! Risk against coverage: the share of failures among the most confident answers (El-Yaniv & Wiener 2010).

use super::frame::Frame;

/// One point of the curve: of the most confident answers that make up `coverage` of all frames, a share `risk` are failures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Share of all frames, answered or not.
    pub coverage: f64,
    /// Share of these whose error is beyond [`RISK_BEYOND_M`].
    pub risk: f64,
}

/// An error beyond this is a failure: the paper's success radius, metres.
pub const RISK_BEYOND_M: f64 = 20.0;

/// The curve, most confident answers first; ties are ordered by stated radius. It ends at the share of frames with a fix.
#[must_use]
pub fn curve(frames: &[Frame]) -> Vec<Point> {
    let mut answered: Vec<&Frame> = frames.iter().filter(|f| f.error_m.is_some()).collect();
    let order = |f: &Frame| {
        (
            -f.confidence.unwrap_or(0.0),
            f.radius95_m.unwrap_or(f64::INFINITY),
        )
    };
    answered.sort_by(|a, b| {
        let (a, b) = (order(a), order(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut failures = 0usize;
    answered
        .iter()
        .enumerate()
        .map(|(i, frame)| {
            failures += usize::from(frame.error_m.is_some_and(|e| e > RISK_BEYOND_M));
            Point {
                coverage: (i + 1) as f64 / frames.len() as f64,
                risk: failures as f64 / (i + 1) as f64,
            }
        })
        .collect()
}

/// Area under the curve over the frames with a fix (Geifman & El-Yaniv 2017); 0 is best, `None` without fixes.
#[must_use]
pub fn area(frames: &[Frame]) -> Option<f64> {
    let points = curve(frames);
    let count = points.len();
    (count > 0).then(|| points.iter().map(|p| p.risk).sum::<f64>() / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn figures_of_a_case_done_by_hand() {
        let frame = |confidence, error_m| Frame {
            confidence,
            error_m,
            radius95_m: error_m.map(|_| 3.0),
            fixed: error_m.is_some(),
            ..Frame::default()
        };
        let frames = [
            frame(Some(0.9), Some(50.0)),
            frame(Some(0.99), Some(2.0)),
            frame(None, None),
            frame(Some(0.95), Some(1.0)),
        ];
        let points = curve(&frames);
        let coverages: Vec<f64> = points.iter().map(|p| p.coverage).collect();
        assert_eq!(coverages, [0.25, 0.5, 0.75]);
        assert_eq!((points[0].risk, points[1].risk), (0.0, 0.0));
        assert_relative_eq!(points[2].risk, 1.0 / 3.0);
        assert_relative_eq!(area(&frames).unwrap(), 1.0 / 9.0);
        assert_eq!(area(&[frame(None, None)]), None);
    }
}
