//! Parameters of PX4 (EKF2, 1.15 and later).

use std::collections::BTreeMap;

use super::rule::{Chosen, MAX_NOISE_M, MIN_NOISE_M, NOISE_REASON, Rule, USUAL_NOISE_M};
use crate::{autopilot::Version, output::Output};

const ODOMETRY: [Rule; 7] = [
    Rule::value(
        &["EKF2_EV_CTRL"],
        1.0,
        "bit 0 alone: the horizontal position is ours, height, velocity and yaw are not",
    ),
    Rule::within(
        &["EKF2_HGT_REF"],
        0.0,
        2.0,
        0.0,
        "0, the barometer: our height is the autopilot's own",
    ),
    Rule::within(
        &["EKF2_EV_DELAY"],
        0.0,
        100.0,
        20.0,
        "milliseconds: positions are extrapolated to the time of sending; reboot after the change",
    ),
    Rule::value(
        &["EKF2_EV_NOISE_MD"],
        0.0,
        "the variances in the message are used",
    ),
    Rule::within(
        &["EKF2_EVP_NOISE"],
        MIN_NOISE_M,
        MAX_NOISE_M,
        USUAL_NOISE_M,
        NOISE_REASON,
    )
    .advice(),
    Rule::within(&["EKF2_EVP_GATE"], 3.0, 100.0, 5.0, "standard deviations").advice(),
    Rule::within(
        &["EKF2_EV_QMIN"],
        0.0,
        40.0,
        0.0,
        "the quality is 50 % and less while no recent photo supports the position",
    )
    .advice(),
];

/// The rules of one slot for positions from outside.
macro_rules! slot {
    ($group:literal, $id:literal, $ctrl:literal, $delay:literal, $noise:literal, $gate:literal) => {
        [
            Rule::value(&[$id], 1.0, "our sensor's number; 0 turns the slot off").of_group($group),
            Rule::value(&[$ctrl], 1.0, "bit 0: the horizontal position is fused").of_group($group),
            Rule::within(
                &[$delay],
                0.0,
                100.0,
                20.0,
                "milliseconds: positions are extrapolated to the time of sending; reboot after the change",
            )
            .of_group($group),
            Rule::within(&[$noise], MIN_NOISE_M, MAX_NOISE_M, USUAL_NOISE_M, NOISE_REASON)
                .advice()
                .of_group($group),
            Rule::within(&[$gate], 3.0, 100.0, 3.0, "standard deviations")
                .advice()
                .of_group($group),
        ]
    };
}

const SLOT_0: [Rule; 5] = slot!(
    0,
    "EKF2_AGP0_ID",
    "EKF2_AGP0_CTRL",
    "EKF2_AGP0_DELAY",
    "EKF2_AGP0_NOISE",
    "EKF2_AGP0_GATE"
);
const SLOT_1: [Rule; 5] = slot!(
    1,
    "EKF2_AGP1_ID",
    "EKF2_AGP1_CTRL",
    "EKF2_AGP1_DELAY",
    "EKF2_AGP1_NOISE",
    "EKF2_AGP1_GATE"
);
const SLOT_2: [Rule; 5] = slot!(
    2,
    "EKF2_AGP2_ID",
    "EKF2_AGP2_CTRL",
    "EKF2_AGP2_DELAY",
    "EKF2_AGP2_NOISE",
    "EKF2_AGP2_GATE"
);
const SLOT_3: [Rule; 5] = slot!(
    3,
    "EKF2_AGP3_ID",
    "EKF2_AGP3_CTRL",
    "EKF2_AGP3_DELAY",
    "EKF2_AGP3_NOISE",
    "EKF2_AGP3_GATE"
);

/// The parameters that matter for a message.
///
/// # Errors
/// Why PX4 does not take it.
pub(crate) fn rules(output: Output, version: Option<Version>) -> Result<Vec<Rule>, &'static str> {
    let older_than = |major, minor| version.is_some_and(|v| !v.is_at_least(major, minor));
    match output {
        Output::Odometry => Ok(ODOMETRY.to_vec()),
        Output::GlobalPositionSensor if older_than(1, 18) => {
            Err("GLOBAL_POSITION_SENSOR needs PX4 1.18 or later; use ODOMETRY")
        }
        Output::GlobalPositionSensor => Ok([SLOT_0, SLOT_1, SLOT_2, SLOT_3].concat()),
        Output::PositionEstimate if older_than(1, 15) => {
            Err("MAV_CMD_EXTERNAL_POSITION_ESTIMATE needs PX4 1.15 or later")
        }
        Output::PositionEstimate => Ok(Vec::new()),
        Output::GpsInput => Err("PX4 does not read GPS_INPUT; use ODOMETRY"),
    }
}

/// The slot with our number; slot 0 if there is none.
pub(crate) fn chosen(values: &BTreeMap<String, f64>) -> Chosen<'_> {
    let slots = [
        (0, "EKF2_AGP0_ID"),
        (1, "EKF2_AGP1_ID"),
        (2, "EKF2_AGP2_ID"),
        (3, "EKF2_AGP3_ID"),
    ];
    let group = slots
        .iter()
        .find(|(_, name)| values.get(*name) == Some(&f64::from(crate::messages::SENSOR_ID)))
        .map_or(0, |(group, _)| *group);
    Chosen { values, group }
}
