//! Times of photos as EXIF writes them.

/// Seconds of a time as EXIF writes it, `YYYY:MM:DD hh:mm:ss`; only differences mean something. `None` if it is not of that form.
#[must_use]
pub fn seconds_of_exif_time(text: &str) -> Option<f64> {
    let (date, time) = text.trim().split_once(' ')?;
    let numbers = |part: &str| -> Option<[i64; 3]> {
        let mut parts = part.split(':').map(|number| number.parse().ok());
        let three = [parts.next()??, parts.next()??, parts.next()??];
        parts.next().is_none().then_some(three)
    };
    let ([year, month, day], [hour, minute, second]) = (numbers(date)?, numbers(time)?);
    // Days from civil (Hinnant 2013): years begin in March, so that the leap day is the last.
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let days = 365 * year + year.div_euclid(4) - year.div_euclid(100)
        + year.div_euclid(400)
        + (153 * month + 2) / 5
        + day;
    Some((days * 86_400 + hour * 3600 + minute * 60 + second) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exif_times_are_seconds_apart() {
        let at = |text| seconds_of_exif_time(text).unwrap();
        assert_eq!(at("2024:02:29 00:00:05") - at("2024:02:28 23:59:58"), 7.0);
        assert_eq!(
            at("2023:03:01 00:00:00") - at("2023:02:28 00:00:00"),
            86_400.0
        );
        assert_eq!(
            at("2024:01:01 00:00:00") - at("2023:12:31 23:00:00"),
            3600.0
        );
        for text in [
            "",
            "2024-01-01 00:00:00",
            "2024:01:01",
            "2024:01:01 00:00:00:00",
        ] {
            assert_eq!(seconds_of_exif_time(text), None, "{text}");
        }
    }
}
