//! How far the tilt of a view may be off, which all measurements that are seen in such views share.

use crate::{
    gauss_markov::GaussMarkov,
    kalman::{TILT, UNKNOWN_TILT},
    options::TrackOptions,
};

/// The errors of the tilt in the state, radians, and where they are.
pub(crate) fn tilt_errors(options: &TrackOptions) -> [(usize, GaussMarkov); 2] {
    [
        (TILT, attitude_tilt_error(options)),
        (UNKNOWN_TILT, unknown_tilt(options)),
    ]
}

/// The error of the tilt of a reported attitude, radians.
pub(crate) fn attitude_tilt_error(options: &TrackOptions) -> GaussMarkov {
    GaussMarkov {
        sigma: options.attitude_sigma_deg.to_radians(),
        correlation_s: options.attitude_correlation_s,
    }
}

/// The tilt of a camera of which no attitude is known, radians.
pub(crate) fn unknown_tilt(options: &TrackOptions) -> GaussMarkov {
    GaussMarkov {
        sigma: options.unknown_tilt_sigma_deg.to_radians(),
        correlation_s: options.unknown_tilt_correlation_s,
    }
}
