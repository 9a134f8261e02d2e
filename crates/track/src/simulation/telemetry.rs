//! What the autopilot reports: attitude, height and velocity, with errors that change slowly.

use rand_chacha::ChaCha8Rng;

use super::{
    delivered::Delivered,
    errors::{Drift, normal},
    options::FlightOptions,
    path::{Truth, truth_at},
};
use crate::attitude::Attitude;
use crate::input::{Height, Input, Velocity};

/// Attitudes and velocities a second.
const TELEMETRY_HZ: f64 = 10.0;
/// Correlation time of the error of roll and pitch, seconds.
const ATTITUDE_CORRELATION_S: f64 = 2.0;

/// Attitude, height and velocity, delivered at once.
pub(super) fn telemetry(
    options: &FlightOptions,
    path: &[Truth],
    rng: &mut ChaCha8Rng,
) -> Vec<Delivered> {
    let mut lean =
        [0, 1].map(|_| Drift::new(options.attitude_sigma_deg, ATTITUDE_CORRELATION_S, rng));
    let mut slip = [0, 1].map(|_| {
        Drift::new(
            options.velocity_sigma_m_s,
            options.velocity_correlation_s,
            rng,
        )
    });
    let compass_deg = 4.0 * normal(rng);
    let height_error = 1.0 + 0.01 * normal(rng);
    let mut deliveries = Vec::new();
    let interval_s = 1.0 / TELEMETRY_HZ;
    for tick in 0..(options.duration_s * TELEMETRY_HZ) as u32 {
        let time_s = f64::from(tick) * interval_s;
        let truth = truth_at(path, time_s);
        let lean_deg = lean.each_mut().map(|error| error.step(interval_s, rng));
        let slip_m_s = slip.each_mut().map(|error| error.step(interval_s, rng));
        let mut deliver = |input| {
            deliveries.push(Delivered {
                arrival_s: time_s,
                input,
            })
        };
        if options.attitude {
            deliver(Input::Attitude(Attitude {
                time_s,
                yaw_deg: truth.yaw_deg + compass_deg,
                pitch_deg: truth.pitch_deg + lean_deg[0],
                roll_deg: truth.roll_deg + lean_deg[1],
            }));
        }
        if tick % 5 == 0 {
            deliver(Input::Height(Height {
                time_s,
                agl_m: truth.height_agl_m * height_error,
                amsl_m: None,
            }));
        }
        if options.velocity && tick % 2 == 0 {
            deliver(Input::Velocity(Velocity {
                time_s,
                east_m_s: truth.velocity_m_s.x + slip_m_s[0],
                north_m_s: truth.velocity_m_s.y + slip_m_s[1],
                sigma_m_s: options.velocity_sigma_m_s,
            }));
        }
    }
    deliveries
}
