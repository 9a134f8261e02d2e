//! Where the next frame has to be searched.

use grimnet_geo::LonLat;
use nalgebra::Matrix2;

use crate::{filter::Filter, hypothesis::Hypothesis, options::TrackOptions};

/// Standard deviations that a window reaches: 99.9 % of a circular normal distribution.
const WINDOW_SIGMAS: f64 = 3.72;
/// Standard deviations of the heading's range.
const HEADING_SIGMAS: f64 = 3.0;
/// A heading is never searched in less than this, degrees to either side.
const LEAST_HEADING_DEG: f64 = 5.0;
/// A range of the heading wider than this is the whole circle, degrees to either side.
const MOST_HEADING_DEG: f64 = 90.0;
/// The ground resolution is searched at least this far to either side, relative.
const LEAST_GSD_RANGE: f64 = 0.1;
/// Hypotheses lighter than this are not searched for.
const LEAST_WEIGHT: f64 = 1e-3;
/// So many misses double the window while the position is believed; otherwise each does.
const MISSES_PER_DOUBLING: u32 = 3;
/// After so many doublings the whole map is searched.
const MOST_DOUBLINGS: u32 = 5;
/// Below this weight of all hypotheses together the whole map is searched as well.
const ENOUGH_WEIGHT: f64 = 0.9;

/// Where to search, the likeliest first.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Search {
    /// Windows. Empty if nothing is known.
    pub windows: Vec<SearchWindow>,
    /// Whether the whole map has to be searched too, if the windows give no fix.
    pub whole_map: bool,
}

/// A part of the map in which the photo's centre is expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchWindow {
    /// Expected image centre.
    pub centre: LonLat,
    /// Radius, metres: 99.9 % of the uncertainty and half a footprint, opened by misses.
    pub radius_m: f64,
    /// Expected bearing of the photo's top and how far to either side it may be, degrees. `None` if unknown.
    pub heading_deg: Option<(f64, f64)>,
    /// Least and largest ground resolution, metres per pixel of the full-size photo. `None` if unknown.
    pub gsd_m: Option<(f64, f64)>,
    /// Weight of the hypothesis.
    pub weight: f64,
}

impl Search {
    /// Where to search a frame taken at `time_s`, which is not before the latest input.
    pub(crate) fn of(
        filter: &Filter,
        time_s: f64,
        half_footprint_m: f64,
        options: &TrackOptions,
    ) -> Self {
        let mut begun;
        let filter = if !filter.has_begun && time_s.is_finite() {
            // Before the first frame there is the start, if one is known.
            begun = filter.clone();
            begun.begin(time_s, options);
            &begun
        } else {
            filter
        };
        let believed = filter.believed.is_some();
        let doublings = if believed {
            filter.misses / MISSES_PER_DOUBLING
        } else {
            filter.misses
        };
        let mut ahead = filter.bank.clone();
        ahead.propagate(time_s, options);
        let mut windows: Vec<SearchWindow> = ahead
            .hypotheses
            .iter_mut()
            .filter(|hypothesis| hypothesis.weight >= LEAST_WEIGHT)
            .filter_map(|hypothesis| {
                let opened = f64::from(1u32 << doublings.min(MOST_DOUBLINGS));
                window(
                    filter,
                    hypothesis,
                    time_s,
                    half_footprint_m,
                    opened,
                    options,
                )
            })
            .collect();
        windows.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        let known: f64 = windows.iter().map(|window| window.weight).sum();
        Self {
            whole_map: doublings >= MOST_DOUBLINGS || known < ENOUGH_WEIGHT,
            windows,
        }
    }
}

fn window(
    filter: &Filter,
    hypothesis: &mut Hypothesis,
    time_s: f64,
    half_footprint_m: f64,
    opened: f64,
    options: &TrackOptions,
) -> Option<SearchWindow> {
    let gsd = hypothesis.gsd;
    let view = filter
        .sensors
        .view(time_s, gsd.map(|gsd| gsd.gsd_m()), options);
    hypothesis.look(view);
    let (centre_m, observation, noise) = hypothesis.seen(view, options);
    let covariance: Matrix2<f64> =
        observation * hypothesis.covariance * observation.transpose() + noise;
    let sigma_m = covariance.symmetric_eigenvalues().max().max(0.0).sqrt();
    let heading_deg = hypothesis.heading_at(time_s).and_then(|heading| {
        let top_deg = heading.heading_deg + filter.sensors.top_from_yaw_deg(time_s);
        let side_deg = (HEADING_SIGMAS * heading.sigma_deg()).max(LEAST_HEADING_DEG);
        (side_deg <= MOST_HEADING_DEG).then_some((top_deg.rem_euclid(360.0), side_deg))
    });
    let gsd_m = gsd.map(|gsd| {
        let factor = (HEADING_SIGMAS * gsd.variance.sqrt())
            .max((1.0 + LEAST_GSD_RANGE).ln())
            .exp();
        let at_centre_m = gsd.gsd_m() * filter.sensors.gsd_over_nadir(time_s);
        (at_centre_m / factor, at_centre_m * factor)
    });
    Some(SearchWindow {
        centre: filter.lonlat_from_en(centre_m)?,
        radius_m: (WINDOW_SIGMAS * sigma_m + half_footprint_m) * opened,
        heading_deg,
        gsd_m,
        weight: hypothesis.weight,
    })
}
