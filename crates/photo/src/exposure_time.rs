//! When a photo was taken, according to EXIF.

use serde::Serialize;

use crate::calendar;

/// When a photo was taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ExposureTime {
    /// Seconds since 1970-01-01 00:00. A clock without a time zone is taken for UTC.
    pub unix_s: f64,
    /// Whether the camera recorded fractions of a second.
    pub has_fraction: bool,
    /// Whether the camera recorded its time zone.
    pub has_zone: bool,
}

impl ExposureTime {
    /// From EXIF's `DateTimeOriginal` (`YYYY:MM:DD hh:mm:ss`), `SubSecTimeOriginal` (digits after the decimal point) and
    /// `OffsetTimeOriginal` (`+08:00`). `None` if the date does not exist; cameras without a clock write zeros or blanks.
    pub(crate) fn from_exif(
        date: &str,
        fraction: Option<&str>,
        offset: Option<&str>,
    ) -> Option<Self> {
        let numbers: Vec<i64> = date
            .split([':', ' ', '-', 'T'])
            .filter(|part| !part.is_empty())
            .map(|part| part.parse().ok())
            .collect::<Option<_>>()?;
        let [year, month, day, hour, minute, second] = numbers[..] else {
            return None;
        };
        let fraction = fraction
            .map(str::trim)
            .filter(|digits| !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()))
            .and_then(|digits| format!("0.{digits}").parse::<f64>().ok());
        let zone_s = offset.and_then(offset_s);
        let local_s = calendar::unix_s([year, month, day], [hour, minute], second as f64)?;
        Some(Self {
            unix_s: local_s + fraction.unwrap_or(0.0) - zone_s.unwrap_or(0.0),
            has_fraction: fraction.is_some(),
            has_zone: zone_s.is_some(),
        })
    }
}

/// Seconds to the east of UTC of `+08:00`, `-03:30` or `Z`.
fn offset_s(text: &str) -> Option<f64> {
    let text = text.trim();
    if text == "Z" {
        return Some(0.0);
    }
    let (sign, rest) = match text.split_at_checked(1)? {
        ("+", rest) => (1.0, rest),
        ("-", rest) => (-1.0, rest),
        _ => return None,
    };
    let (hours, minutes) = rest.split_once(':')?;
    let (hours, minutes): (u32, u32) = (hours.parse().ok()?, minutes.parse().ok()?);
    (hours <= 14 && minutes < 60).then(|| sign * f64::from(hours * 3600 + minutes * 60))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_and_zones() {
        let at = |fraction, zone| {
            ExposureTime::from_exif("2026:06:21 10:00:00", fraction, zone).unwrap()
        };
        let plain = at(None, None);
        assert_eq!(plain.unix_s, 1_782_036_000.0);
        assert!(!plain.has_fraction && !plain.has_zone);
        assert_eq!(at(Some("25 "), None).unix_s, plain.unix_s + 0.25);
        assert_eq!(at(None, Some("+08:00")).unix_s, plain.unix_s - 8.0 * 3600.0);
        assert_eq!(at(None, Some("-03:30")).unix_s, plain.unix_s + 12_600.0);
        assert!(!at(Some("   "), Some("   :  ")).has_zone);
    }

    #[test]
    fn a_camera_without_a_clock_has_no_time() {
        for date in [
            "0000:00:00 00:00:00",
            "    :  :     :  :  ",
            "",
            "2026:02:30 10:00:00",
        ] {
            assert_eq!(ExposureTime::from_exif(date, None, None), None, "{date}");
        }
    }
}
