//! Values of options: what is not in range is refused with the option's name, before any work.

/// The options that are numbers: each name is a parser for `clap`.
macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident: $expected:literal if $in_range:expr;)*) => {
        $(
            $(#[$doc])*
            ///
            /// # Errors
            /// What was expected, if the text is not a number or out of range.
            pub fn $name(text: &str) -> Result<f64, String> {
                let in_range: fn(f64) -> bool = $in_range;
                match text.trim().parse::<f64>() {
                    Ok(value) if value.is_finite() && in_range(value) => Ok(value),
                    _ => Err(concat!("expected ", $expected).to_owned()),
                }
            }
        )*
    };
}

numbers! {
    /// A length in metres, above zero.
    length_m: "a length in metres, above 0" if |v| v > 0.0;
    /// A distance in pixels, zero or above.
    length_px: "a number of pixels, 0 or above" if |v| v >= 0.0;
    /// A standard deviation in metres, zero or above.
    sigma_m: "a number of metres, 0 or above" if |v| v >= 0.0;
    /// A ground resolution in metres per pixel, above zero.
    gsd_m: "a ground resolution in metres per pixel, above 0" if |v| v > 0.0;
    /// A horizontal field of view in degrees, above 0 and below 180.
    fov_deg: "an angle in degrees, above 0 and below 180" if |v| v > 0.0 && v < 180.0;
    /// A probability, 0 to 1.
    probability: "a probability from 0 to 1" if |v| (0.0..=1.0).contains(&v);
    /// A duration in milliseconds, above zero.
    duration_ms: "a number of milliseconds, above 0" if |v| v > 0.0;
    /// A duration in seconds, above zero, at most a day.
    duration_s: "a number of seconds, above 0 and at most 86400" if |v| v > 0.0 && v <= 86_400.0;
    /// A difference of times in seconds, at most a day.
    seconds: "a number of seconds, from -86400 to 86400" if |v| v.abs() <= 86_400.0;
    /// A duration in minutes, above zero, ten hours at most.
    minutes: "a number of minutes, above 0 and at most 600" if |v| v > 0.0 && v <= 600.0;
    /// A frame rate, at most 30 frames a second.
    frame_rate_hz: "frames a second, above 0 and at most 30" if |v| v > 0.0 && v <= 30.0;
    /// A number of frames per second, above zero.
    rate_per_s: "a number of frames per second, above 0 and at most 1000" if |v| v > 0.0 && v <= 1000.0;
    /// A share above 0 and below 1.
    inner_share: "a share above 0 and below 1" if |v| v > 0.0 && v < 1.0;
}

/// A number of things, one at least.
///
/// # Errors
/// What was expected, if the text is no whole number above zero.
pub fn count(text: &str) -> Result<usize, String> {
    match text.trim().parse::<usize>() {
        Ok(value) if value >= 1 => Ok(value),
        _ => Err("expected a whole number, at least one".to_owned()),
    }
}

/// An amount of memory in MiB, one at least.
///
/// # Errors
/// What was expected, if the text is no whole number or out of range.
pub fn memory_mib(text: &str) -> Result<u64, String> {
    // So that the number of bytes fits 64 bits.
    match text.trim().parse::<u64>() {
        Ok(value) if (1..=u64::MAX >> 20).contains(&value) => Ok(value),
        _ => Err("expected a whole number of MiB, at least 1".to_owned()),
    }
}

/// A number of threads: more than cores is slower, and far more only takes memory.
///
/// # Errors
/// What was expected, if the text is no whole number or out of range.
pub fn threads(text: &str) -> Result<usize, String> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let most = most_threads(cores);
    match text.trim().parse::<usize>() {
        Ok(value) if (1..=most).contains(&value) => Ok(value),
        _ => Err(format!(
            "expected a whole number from 1 to {most}; this machine has {cores} cores"
        )),
    }
}

/// The limit of `--threads`: four for each core, and 64 on small machines.
fn most_threads(cores: usize) -> usize {
    (4 * cores).max(64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_out_of_range_is_refused() {
        assert_eq!(fov_deg("73.5"), Ok(73.5));
        for bad in ["0", "180", "400", "-5", "nan", "inf", "", "wide"] {
            assert!(fov_deg(bad).is_err(), "{bad}");
        }
        assert_eq!(sigma_m("0"), Ok(0.0));
        for bad in ["-1", "NaN", "inf", "1m"] {
            assert!(sigma_m(bad).is_err(), "{bad}");
            assert!(length_m(bad).is_err(), "{bad}");
        }
        assert!(length_m("0").is_err());
        assert_eq!(probability("1"), Ok(1.0));
        assert!(probability("1.01").is_err());
        assert!(inner_share("1").is_err());
    }

    #[test]
    fn memory_is_a_whole_number_whose_bytes_fit() {
        assert_eq!(memory_mib("1024"), Ok(1024));
        for bad in ["0", "-1", "1.5", "99999999999999", "1GiB"] {
            assert!(memory_mib(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn threads_have_a_limit() {
        assert_eq!(threads("1"), Ok(1));
        for bad in ["0", "-1", "100000", "two"] {
            assert!(threads(bad).is_err(), "{bad}");
        }
        assert_eq!(most_threads(2), 64);
        assert_eq!(most_threads(128), 512);
    }
}
