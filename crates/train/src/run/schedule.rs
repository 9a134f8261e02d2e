//! Progress of a run and the learning rate schedule.

use crate::config::TrainConfig;
use crate::run::checkpoint::Position;

/// Share of the run that is done: of its steps if their number is configured, otherwise of its time.
pub(crate) fn share_done(config: &TrainConfig, position: &Position) -> f64 {
    match config.steps {
        Some(steps) => position.step as f64 / steps.max(1) as f64,
        None => position.elapsed_s / (config.minutes * 60.0),
    }
}

/// Remaining time at the mean speed so far, seconds.
pub(crate) fn remaining_s(config: &TrainConfig, position: &Position) -> f64 {
    let left = match config.steps {
        Some(steps) => {
            let per_step_s = position.elapsed_s / position.step.max(1) as f64;
            steps.saturating_sub(position.step) as f64 * per_step_s
        }
        None => config.minutes * 60.0 - position.elapsed_s,
    };
    left.max(0.0)
}

/// Linear warm-up, constant, then cosine decay to a thousandth.
pub(crate) fn learning_rate(config: &TrainConfig, updates: u64, done: f64) -> f64 {
    let rise = ((updates + 1) as f64 / config.warmup_steps.max(1) as f64).min(1.0);
    let fall = if done > config.decay_from && config.decay_from < 1.0 {
        let t = ((done - config.decay_from) / (1.0 - config.decay_from)).min(1.0);
        0.5 + 0.5 * (std::f64::consts::PI * t).cos()
    } else {
        1.0
    };
    config.learning_rate * (rise * fall).max(1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_decide_where_given_and_time_otherwise() {
        let position = Position {
            step: 50,
            elapsed_s: 120.0,
            ..Position::default()
        };
        let mut config = TrainConfig {
            minutes: 10.0,
            ..TrainConfig::default()
        };
        assert!((share_done(&config, &position) - 0.2).abs() < 1e-12);
        assert!((remaining_s(&config, &position) - 480.0).abs() < 1e-9);
        config.steps = Some(100);
        assert!((share_done(&config, &position) - 0.5).abs() < 1e-12);
        assert!((remaining_s(&config, &position) - 120.0).abs() < 1e-9);
    }

    #[test]
    fn the_rate_rises_stays_and_falls() {
        let config = TrainConfig {
            learning_rate: 1.0,
            warmup_steps: 10,
            decay_from: 0.5,
            ..TrainConfig::default()
        };
        assert!((learning_rate(&config, 4, 0.0) - 0.5).abs() < 1e-12);
        assert!((learning_rate(&config, 100, 0.3) - 1.0).abs() < 1e-12);
        assert!((learning_rate(&config, 100, 0.75) - 0.5).abs() < 1e-12);
        assert!(learning_rate(&config, 100, 1.0) < 0.002);
    }
}
