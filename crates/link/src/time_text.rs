//! Dates and times as text.

/// Seconds since 1970-01-01 UTC of a date and time as RFC 3339 has it: `2026-05-01T12:00:00.25Z`, `...+02:00`. A space in the
/// place of `T` is taken; a time without an offset is UTC.
pub(crate) fn unix_s_from_rfc3339(text: &str) -> Option<f64> {
    let bytes = text.as_bytes();
    let digits = |from: usize, length: usize| -> Option<i64> {
        let part = text.get(from..from + length)?;
        part.bytes()
            .all(|byte| byte.is_ascii_digit())
            .then(|| part.parse().ok())?
    };
    let is = |at: usize, allowed: &[u8]| bytes.get(at).is_some_and(|byte| allowed.contains(byte));
    let well_formed = is(4, b"-") && is(7, b"-") && is(10, b"Tt ") && is(13, b":") && is(16, b":");
    if !well_formed {
        return None;
    }
    let (year, month, day) = (digits(0, 4)?, digits(5, 2)?, digits(8, 2)?);
    let (hour, minute, second) = (digits(11, 2)?, digits(14, 2)?, digits(17, 2)?);
    let in_range = (1..=12).contains(&month)
        && (1..=days_of_month(year, month)).contains(&day)
        && hour < 24
        && minute < 60
        && second <= 60;
    if !in_range {
        return None;
    }
    let rest = text.get(19..)?;
    let fraction = rest.strip_prefix('.').map_or("", |rest| {
        let end = rest.find(|c: char| !c.is_ascii_digit());
        &rest[..end.unwrap_or(rest.len())]
    });
    let offset = if rest.starts_with('.') {
        &rest[1 + fraction.len()..]
    } else {
        rest
    };
    let of_day = hour * 3600 + minute * 60 + second - offset_s(offset)?;
    let part: f64 = if fraction.is_empty() {
        0.0
    } else {
        format!("0.{fraction}").parse().ok()?
    };
    Some((days_from_civil(year, month, day) * 86_400 + of_day) as f64 + part)
}

/// Seconds east of UTC of `Z`, `+02:00`, `+0200` and `+02` (ISO 8601), or nothing.
fn offset_s(text: &str) -> Option<i64> {
    if matches!(text, "" | "Z" | "z") {
        return Some(0);
    }
    let sign = match text.as_bytes().first()? {
        b'+' => 1,
        b'-' => -1,
        _ => return None,
    };
    let digits = text.get(1..)?;
    let (hours, minutes) = match digits.split_once(':') {
        Some(parts) => parts,
        None if digits.len() == 2 => (digits, "00"),
        None => (digits.get(..2)?, digits.get(2..)?),
    };
    let two = |part: &str| -> Option<i64> {
        (part.len() == 2 && part.bytes().all(|byte| byte.is_ascii_digit()))
            .then(|| part.parse().ok())?
    };
    Some(sign * (two(hours)? * 3600 + two(minutes)? * 60))
}

/// Days of a month, 1 to 12.
fn days_of_month(year: i64, month: i64) -> i64 {
    let next = match month {
        12 => days_from_civil(year + 1, 1, 1),
        _ => days_from_civil(year, month + 1, 1),
    };
    next - days_from_civil(year, month, 1)
}

/// Days since 1970-01-01 (H. Hinnant, "chrono-compatible low-level date algorithms", days_from_civil).
fn days_from_civil(year: i64, month: i64, day: i64) -> i64 {
    let year = year - i64::from(month <= 2);
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let shifted = if month > 2 { month - 3 } else { month + 9 };
    let of_year = (153 * shifted + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        // `date -ud '2000-02-29 00:00:00' +%s` and the like.
        for (text, expected) in [
            ("1970-01-01T00:00:00Z", 0.0),
            ("2000-02-29T00:00:00.25Z", 951_782_400.25),
            ("1999-12-31T23:59:59Z", 946_684_799.0),
            ("2026-09-21 14:13:20", 1_790_000_000.0),
            ("2026-09-21t16:13:20.5+02:00", 1_790_000_000.5),
            ("2026-09-21T08:43:20-05:30", 1_790_000_000.0),
            // As `date +%FT%T%z` writes it, and PostgreSQL.
            ("2026-09-21T08:43:20-0530", 1_790_000_000.0),
            ("2026-09-21 16:13:20+02", 1_790_000_000.0),
        ] {
            assert_eq!(unix_s_from_rfc3339(text), Some(expected), "{text}");
        }
        for text in [
            "",
            "2026-09-21",
            "2026-13-21T14:13:20Z",
            "2026-00-21T14:13:20Z",
            "2026-02-29T14:13:20Z",
            "2026-04-31T14:13:20Z",
            "2026-12-32T14:13:20Z",
            "2026-09-21T24:13:20Z",
            "2026-09-21T14:13:20x",
            "2026-09-21T14:13:20+2:00",
            "2026-09-21T14:13:20+2",
            "2026-09-21T14:13:20+02000",
            "äöü6-09-21T14:13:20Z",
            "2026-09-21T14:13:2ö",
        ] {
            assert_eq!(unix_s_from_rfc3339(text), None, "{text}");
        }
    }
}
