//! The exposure time of a frame: from its name or from its metadata.

use std::path::Path;

use grimnet_photo::{ExposureTime, calendar};
use serde::{Deserialize, Serialize};

/// What the seconds of a flight count from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Epoch {
    /// 1970-01-01 00:00 UTC.
    Unix,
    /// The beginning of the flight, or whatever the names count from.
    Start,
}

/// When a frame was exposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTime {
    /// Seconds.
    pub time_s: f64,
    /// What they count from.
    pub epoch: Epoch,
    /// Whether it is better than to a second.
    pub has_fraction: bool,
}

/// Where the times of photos come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum TimeSource {
    /// From EXIF with fractions of a second, else from the name, else from EXIF
    #[default]
    Auto,
    /// From EXIF only
    Exif,
    /// From the name only
    Name,
}

impl TimeSource {
    /// That what it asks does not state a time, for messages.
    pub fn silent_text(self) -> &'static str {
        match self {
            Self::Auto => "neither its EXIF data nor its name state when it was taken",
            Self::Exif => {
                "its EXIF data do not state when it was taken, and --time-from exif asks its EXIF data only"
            }
            Self::Name => {
                "its name does not state when it was taken, and --time-from name asks its name only"
            }
        }
    }
}

/// Photos of earlier and later years are of no drone: such a number is something else.
const YEARS: std::ops::Range<i64> = 1970..2100;
/// Times from 2001 on count seconds, milliseconds, microseconds or nanoseconds since 1970 if they have so many digits. A number that is
/// filled up with zeros counts the frames.
const UNIX_DIGITS: [(usize, f64); 4] = [(10, 1.0), (13, 1e3), (16, 1e6), (19, 1e9)];

/// The time of a photo; `None` if neither its metadata nor its name tell it.
pub fn frame_time(
    name: &str,
    exposure: Option<ExposureTime>,
    source: TimeSource,
) -> Option<FrameTime> {
    let of_exif = exposure.map(|exposure| FrameTime {
        time_s: exposure.unix_s,
        epoch: Epoch::Unix,
        has_fraction: exposure.has_fraction,
    });
    match source {
        TimeSource::Exif => of_exif,
        TimeSource::Name => from_name(name),
        TimeSource::Auto => of_exif
            .filter(|time| time.has_fraction)
            .or_else(|| from_name(name))
            .or(of_exif),
    }
}

/// The time in a file's name, without folder and ending: a date and time of day (`20260621_100000`, `2026-06-21T10-00-00.5`,
/// `2026-06-21 10.00.00`, `DJI_20260621100000_0001`), seconds since 1970 (10 digits, with a decimal point if they have a fraction; 13,
/// 16 or 19 digits for milliseconds, microseconds or nanoseconds), or seconds with a decimal point (`frame_12.50`).
pub fn from_name(name: &str) -> Option<FrameTime> {
    let path = Path::new(name);
    // `frame_12.50` has no ending, and `12.50.jpg` has one.
    let stem = match path.extension().and_then(|ending| ending.to_str()) {
        Some(ending) if !ending.bytes().all(|b| b.is_ascii_digit()) => path.file_stem()?,
        _ => path.file_name()?,
    };
    let stem = stem.to_str()?;
    date_in(stem).or_else(|| number_in(stem))
}

/// A number of digits of the name, and what follows it directly.
struct Digits<'a> {
    text: &'a str,
    /// The digits behind a decimal point that follows.
    fraction: Option<&'a str>,
}

fn digit_groups(stem: &str) -> Vec<Digits<'_>> {
    let mut groups = Vec::new();
    let mut rest = stem;
    while let Some(at) = rest.find(|c: char| c.is_ascii_digit()) {
        let (text, after) = split_digits(&rest[at..]);
        let (fraction, after) = match after.strip_prefix('.').map(split_digits) {
            Some((fraction, after)) if !fraction.is_empty() => (Some(fraction), after),
            _ => (None, after),
        };
        groups.push(Digits { text, fraction });
        rest = after;
    }
    groups
}

fn split_digits(text: &str) -> (&str, &str) {
    let end = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    text.split_at(end)
}

/// The first run of groups that together are a date and a time of day.
fn date_in(stem: &str) -> Option<FrameTime> {
    let groups = digit_groups(stem);
    (0..groups.len()).find_map(|first| {
        let mut digits = String::new();
        for (at, group) in groups.iter().enumerate().skip(first).take(6) {
            digits.push_str(group.text);
            let mut fraction = group.fraction;
            if let Some(next) = fraction.filter(|next| is_part_of_date(group.text, next)) {
                digits.push_str(next);
                fraction = None;
            }
            if digits.len() >= 14 {
                // Milliseconds may follow in the same group, or in the next one: `20260621_100000_500`.
                let more = &digits[14..];
                let fraction = if !more.is_empty() {
                    Some(more)
                } else {
                    let next = groups.get(at + 1).filter(|next| next.text.len() == 3);
                    fraction.or(next.map(|next| next.text))
                };
                return date(&digits[..14], fraction);
            }
            if fraction.is_some() {
                return None;
            }
        }
        None
    })
}

/// Whether what a point follows and what follows it are parts of a date, as in `10.00.05`, `2026.06.21` and `20260621.100005`.
fn is_part_of_date(before: &str, after: &str) -> bool {
    matches!((before.len(), after.len()), (2 | 4, 2) | (8, 6))
}

fn date(digits: &str, fraction: Option<&str>) -> Option<FrameTime> {
    let number = |from: usize, to: usize| digits.get(from..to)?.parse::<i64>().ok();
    let year = number(0, 4).filter(|year| YEARS.contains(year))?;
    let whole_s = calendar::unix_s(
        [year, number(4, 6)?, number(6, 8)?],
        [number(8, 10)?, number(10, 12)?],
        number(12, 14)? as f64,
    )?;
    let fraction_s = match fraction {
        Some(digits) => format!("0.{digits}").parse::<f64>().ok()?,
        None => 0.0,
    };
    Some(FrameTime {
        time_s: whole_s + fraction_s,
        epoch: Epoch::Unix,
        has_fraction: fraction.is_some(),
    })
}

/// The last number that is a time.
fn number_in(stem: &str) -> Option<FrameTime> {
    digit_groups(stem).iter().rev().find_map(|group| {
        let unit = UNIX_DIGITS
            .iter()
            .find(|(digits, _)| *digits == group.text.len())
            .filter(|_| !group.text.starts_with('0'));
        let whole: f64 = group.text.parse().ok()?;
        let fraction_s = match group.fraction {
            Some(fraction) => format!("0.{fraction}").parse::<f64>().ok()?,
            None => 0.0,
        };
        match unit {
            Some((digits, per_s)) => Some(FrameTime {
                time_s: (whole + fraction_s) / per_s,
                epoch: Epoch::Unix,
                has_fraction: *digits > 10 || group.fraction.is_some(),
            }),
            None => group.fraction.is_some().then_some(FrameTime {
                time_s: whole + fraction_s,
                epoch: Epoch::Start,
                has_fraction: true,
            }),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEN: f64 = 1_782_036_000.0;

    #[test]
    fn dates_numbers_and_neither() {
        for (name, time_s, epoch) in [
            ("20260621_100000.jpg", TEN, Epoch::Unix),
            ("20260621_100000_500.jpg", TEN + 0.5, Epoch::Unix),
            ("20260621100000250.jpg", TEN + 0.25, Epoch::Unix),
            ("2026-06-21T10-00-00.5.jpg", TEN + 0.5, Epoch::Unix),
            ("2026-06-21 10.00.00.jpg", TEN, Epoch::Unix),
            ("2026.06.21_10.00.00.500.jpg", TEN + 0.5, Epoch::Unix),
            ("20260621.100000.jpg", TEN, Epoch::Unix),
            ("DJI_20260621100000_0001_V.JPG", TEN, Epoch::Unix),
            ("a/b/frame_1782036000.125.png", TEN + 0.125, Epoch::Unix),
            ("frame_1782036000125.png", TEN + 0.125, Epoch::Unix),
            ("cam2_1782036000125000.jpg", TEN + 0.125, Epoch::Unix),
            ("cam2_1782036000125000000.jpg", TEN + 0.125, Epoch::Unix),
            // With the number of the camera it would be a date in 2171.
            ("cam2_1711011212345.jpg", 1_711_011_212.345, Epoch::Unix),
            ("frame_12.50.jpg", 12.5, Epoch::Start),
            ("12.50", 12.5, Epoch::Start),
        ] {
            let time = from_name(name).unwrap_or_else(|| panic!("{name}"));
            assert!((time.time_s - time_s).abs() < 1e-6, "{name}: {time:?}");
            assert_eq!(time.epoch, epoch, "{name}");
        }
        for name in [
            "flight_001.jpg",
            "DJI_0042.jpg",
            "photo.jpg",
            "20261399_250000.jpg",
            // Numbers of frames, as KITTI writes them.
            "0000000042.png",
            "frame_0000000000042.png",
            "",
        ] {
            assert_eq!(from_name(name), None, "{name}");
        }
    }

    #[test]
    fn the_finer_time_is_taken() {
        let exif = |has_fraction| {
            Some(ExposureTime {
                unix_s: TEN + 100.0,
                has_fraction,
                has_zone: false,
            })
        };
        let of = |exif, source| {
            frame_time("20260621_100000.jpg", exif, source)
                .unwrap()
                .time_s
        };
        assert_eq!(of(exif(true), TimeSource::Auto), TEN + 100.0);
        assert_eq!(of(exif(false), TimeSource::Auto), TEN);
        assert_eq!(of(exif(false), TimeSource::Exif), TEN + 100.0);
        assert_eq!(of(exif(true), TimeSource::Name), TEN);
        assert_eq!(
            frame_time("a.jpg", exif(false), TimeSource::Auto)
                .unwrap()
                .time_s,
            TEN + 100.0
        );
        assert_eq!(frame_time("a.jpg", None, TimeSource::Auto), None);
    }
}
