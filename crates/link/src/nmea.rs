//! NMEA 0183 sentences: GGA and RMC.

use std::fmt::Write as _;

use grimnet_geo::wrap_longitude_deg;
use grimnet_track::{Estimate, TrackPoint, TrackState};

use crate::{
    gate::{sigma_m, usable},
    gnss,
};

/// Knots in a metre per second.
const KNOTS: f64 = 3600.0 / 1852.0;
/// Parts of a minute of arc that a sentence holds: five digits, 2 cm.
const PER_MINUTE: f64 = 1e5;
const PER_DEGREE: u64 = 60 * 100_000;

/// GGA and RMC for the track at a time, each with its line end. `None` where the position may not be used: the track is
/// searching, ambiguous or lost, its 95 % radius is above `max_radius95_m`, or it is that of the image centre.
///
/// `time_s` of the point counts from 1970-01-01 UTC. A position without a recent fix has quality 6 and mode E (estimated), any
/// other quality 1 and mode A. Ten satellites are stated, since receivers refuse less than six; the dilution of precision is
/// the standard deviation over 5 m.
#[must_use]
pub fn nmea_sentences(point: &TrackPoint, max_radius95_m: f64) -> Option<String> {
    let (state, estimate) = usable(Some(point), max_radius95_m).ok()?;
    let moment = Moment::from_unix_s(point.time_s)?;
    let mut text = String::new();
    push_sentence(&mut text, &gga(&estimate, state, &moment));
    push_sentence(&mut text, &rmc(&estimate, state, &moment));
    Some(text)
}

fn gga(estimate: &Estimate, state: TrackState, moment: &Moment) -> String {
    let altitude = estimate
        .altitude_amsl_m
        .map_or(String::new(), |altitude_m| format!("{altitude_m:.1}"));
    format!(
        "GPGGA,{},{},{},{:02},{:.1},{altitude},M,,M,,",
        moment.time(),
        place(estimate),
        if state == TrackState::Tracking { 1 } else { 6 },
        gnss::SATELLITES,
        gnss::hdop(sigma_m(estimate)),
    )
}

fn rmc(estimate: &Estimate, state: TrackState, moment: &Moment) -> String {
    let (east, north) = (estimate.velocity_east_m_s, estimate.velocity_north_m_s);
    let course_deg = east.atan2(north).to_degrees().rem_euclid(360.0);
    format!(
        "GPRMC,{},A,{},{:.2},{:.1},{},,,{}",
        moment.time(),
        place(estimate),
        east.hypot(north) * KNOTS,
        // 359.96 would be written as 360.0.
        if course_deg >= 359.95 {
            0.0
        } else {
            course_deg
        },
        moment.date(),
        if state == TrackState::Tracking {
            'A'
        } else {
            'E'
        },
    )
}

/// `ddmm.mmmmm,N,dddmm.mmmmm,E`.
fn place(estimate: &Estimate) -> String {
    let lon_deg = wrap_longitude_deg(estimate.lon_deg);
    let parts = |degrees: f64| {
        let units = (degrees.abs() * 60.0 * PER_MINUTE).round() as u64;
        (units / PER_DEGREE, units % PER_DEGREE)
    };
    let (lat, lat_rest) = parts(estimate.lat_deg);
    let (lon, lon_rest) = parts(lon_deg);
    format!(
        "{lat:02}{:02}.{:05},{},{lon:03}{:02}.{:05},{}",
        lat_rest / 100_000,
        lat_rest % 100_000,
        if estimate.lat_deg < 0.0 { 'S' } else { 'N' },
        lon_rest / 100_000,
        lon_rest % 100_000,
        if lon_deg < 0.0 { 'W' } else { 'E' },
    )
}

fn push_sentence(text: &mut String, body: &str) {
    let checksum = body.bytes().fold(0, |sum, byte| sum ^ byte);
    // Writing to a string cannot fail.
    let _ = write!(text, "${body}*{checksum:02X}\r\n");
}

/// A moment in UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Moment {
    year: i64,
    month: i64,
    day: i64,
    /// Hundredths of a second since midnight.
    centiseconds: i64,
}

impl Moment {
    /// `None` if the time is not finite or far outside of what has a date.
    fn from_unix_s(unix_s: f64) -> Option<Self> {
        const DAY: i64 = 8_640_000;
        if !(0.0..1e11).contains(&unix_s) {
            return None;
        }
        let centiseconds = (unix_s * 100.0).round() as i64;
        // Days to a date: H. Hinnant, "chrono-compatible low-level date algorithms", civil_from_days.
        let days = centiseconds.div_euclid(DAY) + 719_468;
        let era = days.div_euclid(146_097);
        let of_era = days.rem_euclid(146_097);
        let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
        let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let shifted = (5 * of_year + 2) / 153;
        let month = if shifted < 10 {
            shifted + 3
        } else {
            shifted - 9
        };
        Some(Self {
            year: year_of_era + era * 400 + i64::from(month <= 2),
            month,
            day: of_year - (153 * shifted + 2) / 5 + 1,
            centiseconds: centiseconds.rem_euclid(DAY),
        })
    }

    fn time(&self) -> String {
        let seconds = self.centiseconds / 100;
        format!(
            "{:02}{:02}{:02}.{:02}",
            seconds / 3600,
            seconds / 60 % 60,
            seconds % 60,
            self.centiseconds % 100,
        )
    }

    fn date(&self) -> String {
        format!("{:02}{:02}{:02}", self.day, self.month, self.year % 100)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(unix_s: f64) -> (i64, i64, i64, String) {
        let moment = Moment::from_unix_s(unix_s).unwrap();
        (moment.year, moment.month, moment.day, moment.time())
    }

    #[test]
    fn moments_are_those_of_the_calendar() {
        assert_eq!(moment(0.0), (1970, 1, 1, "000000.00".to_owned()));
        // `date -ud @951782400`, a leap day; `date -ud @4102444799`.
        assert_eq!(
            moment(951_782_400.25),
            (2000, 2, 29, "000000.25".to_owned())
        );
        assert_eq!(
            moment(4_102_444_799.0),
            (2099, 12, 31, "235959.00".to_owned())
        );
        // The end of a second is the next one, over midnight too.
        assert_eq!(
            moment(951_782_399.999),
            (2000, 2, 29, "000000.00".to_owned())
        );
        for time_s in [f64::NAN, f64::INFINITY, -1.0, 1e300] {
            assert_eq!(Moment::from_unix_s(time_s), None);
        }
    }
}
