//! Errors of the filter.

/// Why an input was not taken. The state of the filter is as it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A number is not finite or out of range.
    #[error("{field} is {value}; expected {expected}")]
    Invalid {
        /// The field's name.
        field: &'static str,
        /// What it holds.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// The input is older than the filter can go back. If the next inputs are as well, the clock was set back, and the filter starts
    /// again at the new time.
    #[error(
        "the input is {age_s:.1} s older than the newest one; inputs may be at most {lag_s:.1} s late"
    )]
    TooLate {
        /// How much older than the newest input, seconds.
        age_s: f64,
        /// The lag, seconds.
        lag_s: f64,
    },
    /// The clock of the inputs jumped. If the next inputs confirm it, the filter starts again at the new time.
    #[error(
        "the input's time is {by_s:.1} s away from the newest one; check the clocks of camera and telemetry"
    )]
    ClockJump {
        /// New time minus the newest time before, seconds.
        by_s: f64,
    },
}

/// Why options were refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("option {name} is {value}; expected {expected}")]
pub struct OptionsError {
    /// The option's name.
    pub name: &'static str,
    /// What it holds.
    pub value: f64,
    /// What it should be.
    pub expected: &'static str,
}
