//! Dates as cameras write them, and seconds since 1970.

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Seconds since 1970-01-01 00:00 UTC of a date in the Gregorian calendar; `None` for a date that does not exist.
///
/// ```
/// let unix_s = grimnet_photo::calendar::unix_s([2001, 9, 9], [1, 46], 40.5);
/// assert_eq!(unix_s, Some(1_000_000_000.5));
/// assert_eq!(grimnet_photo::calendar::unix_s([2026, 2, 29], [0, 0], 0.0), None);
/// ```
pub fn unix_s([year, month, day]: [i64; 3], [hour, minute]: [i64; 2], second: f64) -> Option<f64> {
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = match month {
        4 | 6 | 9 | 11 => 30,
        2 => 28 + i64::from(leap),
        1..=12 => 31,
        _ => return None,
    };
    // A leap second is written as 60.
    let exists = (1..=9999).contains(&year)
        && (1..=days).contains(&day)
        && (0..24).contains(&hour)
        && (0..60).contains(&minute)
        && (0.0..61.0).contains(&second);
    exists.then(|| {
        days_from_civil(year, month, day) as f64 * DAY_S
            + (hour * 3600 + minute * 60) as f64
            + second
    })
}

/// Year, month, day, hour, minute and milliseconds of the minute of a time in seconds since 1970, rounded to milliseconds. `None` if
/// it is not finite or not in the years 1 to 9999.
pub fn civil(unix_s: f64) -> Option<([i64; 3], [i64; 2], i64)> {
    // 0001-01-01 and 10000-01-01.
    if !(-62_135_596_800.0..253_402_300_800.0 - 0.001).contains(&unix_s) {
        return None;
    }
    let ms = (unix_s * 1e3).round() as i64;
    let (days, of_day_ms) = (ms.div_euclid(86_400_000), ms.rem_euclid(86_400_000));
    let minutes = of_day_ms / 60_000;
    Some((
        civil_from_days(days),
        [minutes / 60, minutes % 60],
        of_day_ms % 60_000,
    ))
}

/// `2026-06-21T10:00:00.500Z` (RFC 3339); `None` as [`civil`].
pub fn rfc3339(unix_s: f64) -> Option<String> {
    let ([year, month, day], [hour, minute], ms) = civil(unix_s)?;
    Some(format!(
        "{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{:02}.{:03}Z",
        ms / 1000,
        ms % 1000
    ))
}

/// Days since 1970-01-01 (H. Hinnant, "chrono-Compatible Low-Level Date Algorithms", 2013).
fn days_from_civil(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + day_of_year - 719_468
}

/// The inverse of [`days_from_civil`].
fn civil_from_days(days: i64) -> [i64; 3] {
    let days = days + 719_468;
    let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let month = (shifted + 2) % 12 + 1;
    let year = era * 400 + year_of_era + i64::from(month <= 2);
    [year, month, day_of_year - (153 * shifted + 2) / 5 + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_dates_and_the_way_back() {
        // `date -u -d ... +%s`
        for (date, time, expected) in [
            ([1970, 1, 1], [0, 0], 0.0),
            ([2000, 2, 29], [12, 30], 951_827_400.0),
            ([2026, 6, 21], [10, 0], 1_782_036_000.0),
            ([1900, 3, 1], [0, 0], -2_203_891_200.0),
        ] {
            let unix_s = unix_s(date, time, 0.0).unwrap();
            assert_eq!(unix_s, expected);
            assert_eq!(civil(unix_s + 1.25), Some((date, time, 1250)));
        }
        for days in (-700_000..2_900_000).step_by(997) {
            let [year, month, day] = civil_from_days(days);
            assert_eq!(days_from_civil(year, month, day), days);
        }
    }

    #[test]
    fn text_and_what_has_none() {
        assert_eq!(
            rfc3339(1_782_036_000.499_6).as_deref(),
            Some("2026-06-21T10:00:00.500Z")
        );
        assert_eq!(rfc3339(f64::NAN), None);
        assert_eq!(rfc3339(1e15), None);
        assert_eq!(unix_s([2026, 13, 1], [0, 0], 0.0), None);
        assert_eq!(unix_s([0, 0, 0], [0, 0], 0.0), None);
    }
}
