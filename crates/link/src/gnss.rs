//! What receivers of GNSS positions expect beside the position.

/// Satellites to state where a receiver refuses a position without any. There are none; receivers ask for 6 or more.
pub(crate) const SATELLITES: u8 = 10;
/// Error of a range that turns a standard deviation into a dilution of precision, metres (GPS SPS Performance Standard, 2020:
/// 4 m to 6 m).
const RANGE_ERROR_M: f64 = 5.0;
/// GPS time began at 1980-01-06 UTC, seconds after 1970-01-01.
const GPS_EPOCH_S: f64 = 315_964_800.0;
/// GPS time is ahead of UTC by this, seconds, since 2017.
const LEAP_S: f64 = 18.0;
const WEEK_S: f64 = 604_800.0;

/// Dilution of precision that goes with a position's standard deviation.
pub(crate) fn hdop(sigma_m: f64) -> f64 {
    (sigma_m / RANGE_ERROR_M).clamp(0.1, 99.0)
}

/// GPS week, and milliseconds in it, of a time in seconds since 1970-01-01 UTC.
pub(crate) fn gps_week(unix_s: f64) -> (u16, u32) {
    let gps_s = (unix_s - GPS_EPOCH_S + LEAP_S).max(0.0);
    let in_week_s = gps_s % WEEK_S;
    ((gps_s / WEEK_S) as u16, (in_week_s * 1e3) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weeks_are_counted_from_the_epoch_of_gps() {
        assert_eq!(gps_week(GPS_EPOCH_S - 18.0), (0, 0));
        // 2019-04-07 00:00:00 GPS time began week 2048 (the second rollover), 18 s before midnight UTC.
        assert_eq!(gps_week(1_554_595_200.0 - 18.0), (2048, 0));
        assert_eq!(gps_week(1_554_595_200.0 - 17.5), (2048, 500));
        assert_eq!(gps_week(0.0), (0, 0));
    }
}
