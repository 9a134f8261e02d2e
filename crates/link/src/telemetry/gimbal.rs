//! What a gimbal says of itself: which one it is, and when and in which frame its attitude is true.

use mavlink::dialects::common::{GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, GimbalDeviceFlags};

use crate::time_sync::TimeSync;

/// A message that seems to have taken longer than this says that the gimbal's clock is not what it was, seconds.
const LATE_S: f64 = 0.3;

/// The number of a gimbal: 1 to 6 for one that its manager, such as the autopilot, reports, else its own component.
pub(crate) fn gimbal_id(component_id: u8, data: &GIMBAL_DEVICE_ATTITUDE_STATUS_DATA) -> u8 {
    match data.gimbal_device_id {
        0 => component_id,
        number => number,
    }
}

/// Whether the yaw is relative to north, and not to the aircraft's nose.
pub(crate) fn is_relative_to_north(flags: GimbalDeviceFlags) -> bool {
    // Without either flag of the newer definition, a locked yaw is one relative to north.
    flags.contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME)
        || (!flags.contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME)
            && flags.contains(GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_LOCK))
}

/// The clock of a gimbal that counts from a start of its own.
///
/// The earliest arrival, relative to the time stamp, had the shortest way. So messages that come together, as they do over USB
/// and through routers, keep the times at which they were true.
#[derive(Debug, Default)]
pub(crate) struct GimbalClock {
    arrivals: TimeSync,
    last_boot_ms: Option<u32>,
}

impl GimbalClock {
    /// The time, on the link's clock, of a message that came at `now_s`; that of its arrival if the gimbal's clock stands still.
    pub fn time_s(&mut self, boot_ms: u32, now_s: f64) -> f64 {
        if self.last_boot_ms.replace(boot_ms) == Some(boot_ms) {
            return now_s;
        }
        let boot_s = f64::from(boot_ms) * 1e-3;
        self.arrivals.arrival(boot_s, now_s);
        let time_s = self.arrivals.time_s(boot_s).unwrap_or(now_s).min(now_s);
        if now_s - time_s > LATE_S {
            self.arrivals = TimeSync::default();
            self.arrivals.arrival(boot_s, now_s);
            return now_s;
        }
        time_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times that the clock gives to messages, each with its time stamp and its arrival.
    fn times(messages: impl IntoIterator<Item = (u32, f64)>) -> Vec<f64> {
        let mut clock = GimbalClock::default();
        let time_s = |(boot_ms, now_s)| clock.time_s(boot_ms, now_s);
        messages.into_iter().map(time_s).collect()
    }

    #[test]
    fn messages_that_come_together_keep_their_times() {
        // 20 Hz; the gimbal started at 100 s, and five messages each arrive with the last of them, 10 ms late.
        let messages = (0..50).map(|step| (step * 50, 100.01 + f64::from(step / 5 * 5 + 4) * 0.05));
        // Once one came without waiting.
        for (step, time_s) in times(messages).into_iter().enumerate().skip(5) {
            let expected_s = 100.01 + step as f64 * 0.05;
            assert!((time_s - expected_s).abs() < 1e-9, "{step}: {time_s}");
        }
    }

    #[test]
    fn a_clock_that_stands_or_is_slow_does_not_make_messages_old() {
        for slower in [1, 10, 1000, u32::MAX] {
            let messages =
                (0..1000).map(|step| (step * 50 / slower, 100.0 + f64::from(step) * 0.05));
            let given = times(messages.clone());
            for (time_s, (_, now_s)) in given.iter().zip(messages) {
                assert!(
                    (now_s - LATE_S..=now_s).contains(time_s),
                    "{slower}: {time_s} {now_s}"
                );
            }
            assert!(given.is_sorted(), "{slower}");
        }
    }

    #[test]
    fn a_gimbal_that_restarts_is_followed() {
        let before = (0..40).map(|step| (600_000 + step * 50, 100.0 + f64::from(step) * 0.05));
        let after = (0..40).map(|step| (step * 50, 105.0 + f64::from(step) * 0.05));
        let expected: Vec<f64> = before
            .clone()
            .chain(after.clone())
            .map(|(_, now_s)| now_s)
            .collect();
        for (time_s, expected_s) in times(before.chain(after)).iter().zip(expected) {
            assert!((time_s - expected_s).abs() < 1e-6, "{time_s} {expected_s}");
        }
    }
}
