//! From the localiser's answer to the filter's measurement.

use grimnet_geo::LonLat;
use grimnet_locate::Fix;
use grimnet_track::PositionFix;

/// No fix is more certain than this, metres per axis, 1 sigma: a tenth of a pixel of a fine map.
const LEAST_SIGMA_M: f64 = 0.1;
/// Largest correlation of the errors to the east and to the north.
const LARGEST_CORRELATION: f64 = 0.99;
/// Confidence of a fix whose model is not calibrated for it. As all have it, it says nothing but that wrong fixes are not rare.
const UNCALIBRATED_CONFIDENCE: f64 = 0.8;

/// The measurement that a fix of a photo exposed at `time_s` gives to the filter.
///
/// A [`Fix`] states its covariance with the map's own error of `map_error_m` (1 sigma per axis,
/// [`grimnet_locate::Options::map_error_m`]). All fixes of a flight share that error, so the filter takes it separately: it is
/// subtracted here.
pub fn position_fix(fix: &Fix, time_s: f64, map_error_m: f64) -> PositionFix {
    let [ee, en, nn] = fix.covariance_en_m2;
    let without_map = |variance_m2: f64| {
        (variance_m2 - map_error_m * map_error_m).max(LEAST_SIGMA_M * LEAST_SIGMA_M)
    };
    let (ee, nn) = (without_map(ee), without_map(nn));
    let most_en = LARGEST_CORRELATION * (ee * nn).sqrt();
    PositionFix {
        time_s,
        lonlat: LonLat::new(fix.lon_deg, fix.lat_deg),
        covariance_en_m2: [ee, en.clamp(-most_en, most_en), nn],
        map_error_m,
        heading_deg: fix.heading_deg,
        gsd_m: fix.gsd_m,
        confidence: fix
            .confidence
            .unwrap_or(UNCALIBRATED_CONFIDENCE)
            .clamp(0.0, 1.0),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use grimnet_locate::{EvidenceUsed, Support, TileRef, TimeMs};
    use grimnet_track::{Input, TrackOptions, Tracker};

    /// A fix with a heading of 30 degrees.
    pub(crate) fn fix(covariance_en_m2: [f64; 3]) -> Fix {
        Fix {
            lat_deg: 24.2,
            lon_deg: 120.7,
            heading_deg: Some(30.0),
            gsd_m: 0.05,
            covariance_en_m2,
            radius95_m: 3.0,
            confidence: Some(0.97),
            support: Support {
                inliers: 60,
                places: 40,
                matches: 90,
                runner_up_inliers: 5,
                spread: 0.5,
                held_back_points: 200,
                held_back_excess: 0.2,
                expected_inliers: 0.5,
                on_map: 1.0,
                inlier_covariance_en_m2: [0.1, 0.0, 0.1],
            },
            inliers: 60,
            matches: 90,
            tile: TileRef {
                level: 0,
                gsd_m: 0.3,
                index: 0,
                similarity: 0.5,
                votes: 20,
            },
            runner_up: None,
            outline_lon_lat_deg: Vec::new(),
            evidence: EvidenceUsed::default(),
            time_ms: TimeMs::default(),
            drawn: None,
        }
    }

    #[test]
    fn the_maps_error_is_taken_out_of_the_covariance() {
        let measured = position_fix(&fix([1.5, 0.2, 2.0]), 7.0, 1.0);
        assert_eq!(measured.covariance_en_m2, [0.5, 0.2, 1.0]);
        assert_eq!(measured.map_error_m, 1.0);
        assert_eq!((measured.time_s, measured.confidence), (7.0, 0.97));
        assert_eq!(measured.lonlat, LonLat::new(120.7, 24.2));
    }

    #[test]
    fn whatever_remains_is_a_covariance_that_the_filter_takes() {
        for covariance_en_m2 in [[1.0, 0.0, 1.0], [1.01, 0.4, 1.01], [0.2, -0.1, 0.3]] {
            let measured = position_fix(&fix(covariance_en_m2), 0.0, 1.0);
            let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
            tracker.push(Input::Fix(measured)).unwrap();
        }
    }

    #[test]
    fn a_fix_of_an_uncalibrated_model_counts_less() {
        let uncalibrated = Fix {
            confidence: None,
            ..fix([2.0, 0.0, 2.0])
        };
        let measured = position_fix(&uncalibrated, 0.0, 1.0);
        assert!(measured.confidence > 0.5);
        assert!(measured.confidence < TrackOptions::default().full_confidence);
    }
}
