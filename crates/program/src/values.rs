//! Values of options: what is not in range is refused with the option's name, before any work.

use std::net::SocketAddr;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};
use grimnet_photo::{HEIGHT_AGL_RANGE_M, HFOV_RANGE_DEG, PHOTO_GSD_RANGE_M, PITCH_RANGE_DEG};

/// Photos that a demo or a calibration may make for each scene: more fill a disk.
const PHOTO_COUNT_RANGE: RangeInclusive<usize> = 1..=100_000;
/// Procedural worlds that a calibration may draw: each is a map on the disk.
const WORLD_COUNT_RANGE: RangeInclusive<usize> = 0..=1000;

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
    /// A standard deviation in metres, 0 to 100 km: squares of more, or radii, are no numbers.
    sigma_m: "a number of metres, from 0 to 100000" if |v| (0.0..=1e5).contains(&v);
    /// A standard deviation of a velocity in metres per second.
    sigma_m_s: "a number of metres per second, from 0 to 1000" if |v| (0.0..=1e3).contains(&v);
    /// A ground resolution of a map in metres per pixel, from a tenth of a millimetre to 10 km.
    gsd_m: "a ground resolution in metres per pixel, from 0.0001 to 10000" if |v| (1e-4..=1e4).contains(&v);
    /// A probability, 0 to 1.
    probability: "a probability from 0 to 1" if |v| (0.0..=1.0).contains(&v);
    /// A duration in milliseconds, above zero.
    duration_ms: "a number of milliseconds, above 0" if |v| v > 0.0;
    /// A duration in seconds, above zero, at most a day.
    duration_s: "a number of seconds, above 0 and at most 86400" if |v| v > 0.0 && v <= 86_400.0;
    /// A difference of times in seconds, at most a day.
    seconds: "a number of seconds, from -86400 to 86400" if |v| v.abs() <= 86_400.0;
    /// How late something comes, in seconds, half a minute at most.
    latency_s: "a number of seconds, from 0 to 30" if |v| (0.0..=30.0).contains(&v);
    /// A duration in minutes, above zero, ten hours at most.
    minutes: "a number of minutes, above 0 and at most 600" if |v| v > 0.0 && v <= 600.0;
    /// A frame rate, at most 30 frames a second.
    frame_rate_hz: "frames a second, above 0 and at most 30" if |v| v > 0.0 && v <= 30.0;
    /// A number of frames per second, above zero, at most 1000.
    rate_per_s: "a number of frames per second, above 0 and at most 1000" if |v| v > 0.0 && v <= 1000.0;
    /// A share above 0 and below 1.
    inner_share: "a share above 0 and below 1" if |v| v > 0.0 && v < 1.0;
}

/// A height above ground in metres, in the range of [`grimnet_photo::HEIGHT_AGL_RANGE_M`].
///
/// # Errors
/// What was expected, if the text is not a number or out of range.
pub fn height_agl_m(text: &str) -> Result<f64, String> {
    number_within(text, &HEIGHT_AGL_RANGE_M, "a height in metres")
}

/// The ground resolution of a photo in metres per pixel, in the range of [`grimnet_photo::PHOTO_GSD_RANGE_M`].
///
/// # Errors
/// What was expected, if the text is not a number or out of range.
pub fn photo_gsd_m(text: &str) -> Result<f64, String> {
    number_within(text, &PHOTO_GSD_RANGE_M, "metres of ground per pixel")
}

/// A horizontal field of view in degrees, in the range of [`grimnet_photo::HFOV_RANGE_DEG`].
///
/// # Errors
/// What was expected, if the text is not a number or out of range.
pub fn fov_deg(text: &str) -> Result<f64, String> {
    number_within(text, &HFOV_RANGE_DEG, "an angle in degrees")
}

/// The pitch of a camera in degrees, in the range of [`grimnet_photo::PITCH_RANGE_DEG`].
///
/// # Errors
/// What was expected, if the text is not a number or out of range.
pub fn pitch_deg(text: &str) -> Result<f64, String> {
    let what = "degrees, where -90 is straight down";
    number_within(text, &PITCH_RANGE_DEG, what)
}

fn number_within(text: &str, range: &RangeInclusive<f64>, what: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if range.contains(&value) => Ok(value),
        _ => Err(format!(
            "expected {what}, from {} to {}",
            range.start(),
            range.end()
        )),
    }
}

/// The path of a file to write that is no text for standard output: `-`, which names that elsewhere, is refused.
pub fn output_file() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| {
        if path == Path::new("-") {
            return Err("expected the path of a file; `-` is not standard output here (`./-` is a file of that name)");
        }
        Ok(path)
    })
}

/// The path of a folder to write into; `-` is refused.
pub fn output_folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| {
        if path == Path::new("-") {
            return Err("expected the path of a folder; standard output cannot take several files (`./-` is a folder of that name)");
        }
        Ok(path)
    })
}

/// An address to listen on.
///
/// # Errors
/// What was expected, if the text is not an IP address and a port.
pub fn socket_address(text: &str) -> Result<SocketAddr, String> {
    text.trim()
        .parse()
        .map_err(|_| "expected an IP address and port, such as 127.0.0.1:8080".to_owned())
}

/// A number of photos to be made.
///
/// # Errors
/// What was expected, if the text is no whole number or out of range.
pub fn photo_count(text: &str) -> Result<usize, String> {
    whole_number_within(text, &PHOTO_COUNT_RANGE)
}

/// A number of procedural worlds.
///
/// # Errors
/// What was expected, if the text is no whole number or out of range.
pub fn world_count(text: &str) -> Result<usize, String> {
    whole_number_within(text, &WORLD_COUNT_RANGE)
}

fn whole_number_within(text: &str, range: &RangeInclusive<usize>) -> Result<usize, String> {
    match text.trim().parse::<usize>() {
        Ok(value) if range.contains(&value) => Ok(value),
        _ => Err(format!(
            "expected a whole number from {} to {}",
            range.start(),
            range.end()
        )),
    }
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
            assert!(gsd_m(bad).is_err(), "{bad}");
            assert!(sigma_m(bad).is_err(), "{bad}");
            assert!(length_m(bad).is_err(), "{bad}");
        }
        assert!(length_m("0").is_err());
        assert_eq!(probability("1"), Ok(1.0));
        assert!(probability("1.01").is_err());
        assert!(inner_share("1").is_err());
    }

    #[test]
    fn ranges_are_those_of_the_library_and_are_stated() {
        assert_eq!(height_agl_m("2"), Ok(2.0));
        assert_eq!(height_agl_m("20000"), Ok(20_000.0));
        for bad in ["1", "25000", "-5", "nan", "inf"] {
            let expected = "expected a height in metres, from 2 to 20000";
            assert_eq!(height_agl_m(bad), Err(expected.to_owned()), "{bad}");
        }
        for bad in ["0.5", "170"] {
            let expected = "expected an angle in degrees, from 1 to 150";
            assert_eq!(fov_deg(bad), Err(expected.to_owned()), "{bad}");
        }
        assert_eq!(pitch_deg("-60"), Ok(-60.0));
        let expected = "expected degrees, where -90 is straight down, from -165 to -15";
        assert_eq!(pitch_deg("30"), Err(expected.to_owned()));
        assert!(sigma_m("100000").is_ok() && sigma_m("1e308").is_err());
        assert!(gsd_m("0.05").is_ok() && gsd_m("1e-308").is_err() && gsd_m("1e20").is_err());
        assert!(photo_gsd_m("1000").is_ok() && photo_gsd_m("5000").is_err());
        assert_eq!(photo_count("100000"), Ok(100_000));
        for bad in ["0", "-1", "1000000000", "many"] {
            let expected = "expected a whole number from 1 to 100000";
            assert_eq!(photo_count(bad), Err(expected.to_owned()), "{bad}");
        }
    }

    #[test]
    fn an_address_has_a_number_and_a_port() {
        assert!(socket_address("127.0.0.1:8080").is_ok() && socket_address("[::1]:0").is_ok());
        for bad in ["localhost:8080", "127.0.0.1", "foo", ""] {
            let expected = "expected an IP address and port, such as 127.0.0.1:8080";
            assert_eq!(socket_address(bad), Err(expected.to_owned()), "{bad}");
        }
    }

    #[test]
    fn a_hyphen_is_no_path_of_a_file_or_folder() {
        use clap::builder::ValueParser;
        for parser in [
            ValueParser::from(output_file()),
            ValueParser::from(output_folder()),
        ] {
            let out = clap::Arg::new("out").value_parser(parser);
            let program = clap::Command::new("program").arg(out);
            let accepts = |path: &str| {
                let parsed = program.clone().try_get_matches_from(["program", path]);
                parsed.is_ok()
            };
            assert!(accepts("./-") && accepts("a.csv") && !accepts("-"));
        }
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
