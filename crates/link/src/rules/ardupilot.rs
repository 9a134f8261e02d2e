//! Parameters of ArduPilot (EKF3, 4.5 and later).

use std::collections::BTreeMap;

use super::rule::{Chosen, MAX_NOISE_M, MIN_NOISE_M, NOISE_REASON, Rule, USUAL_NOISE_M};
use crate::{autopilot::Version, output::Output};

const EKF: [Rule; 2] = [
    Rule::value(
        &["AHRS_EKF_TYPE"],
        3.0,
        "positions from outside are taken by EKF3 only",
    ),
    Rule::value(&["EK3_ENABLE"], 1.0, "EKF3 has to run"),
];

/// The noise that EKF3 assumes at least, for positions of GNSS and, while a receiver states its accuracy, for `ODOMETRY` too.
const LEAST_NOISE: Rule = Rule::within(
    &["EK3_POSNE_M_NSE"],
    MIN_NOISE_M,
    MAX_NOISE_M,
    USUAL_NOISE_M,
    NOISE_REASON,
)
.advice();

const ODOMETRY: [Rule; 5] = [
    Rule::value(
        &["VISO_TYPE"],
        1.0,
        "MAVLink; 3 (VOXL) would move our positions to where the autopilot already believes to be; reboot after the change",
    ),
    Rule::within(
        &["VISO_DELAY_MS"],
        0.0,
        100.0,
        35.0,
        "positions are extrapolated to the time of sending, so only the way to the autopilot is left",
    ),
    Rule::within(
        &["VISO_QUAL_MIN"],
        0.0,
        40.0,
        0.0,
        "the quality is 50 % and less while no recent photo supports the position; without this parameter, or below 0, the autopilot cannot be armed before there is a position",
    )
    .advice(),
    Rule::value(&["VISO_SCALE"], 1.0, "our metres are metres"),
    Rule::within(
        &["VISO_POS_M_NSE"],
        MIN_NOISE_M,
        MAX_NOISE_M,
        USUAL_NOISE_M,
        NOISE_REASON,
    )
    .advice(),
];

/// The rules of one source set.
macro_rules! source_set {
    ($group:literal, $posxy:literal, $velxy:literal, $posz:literal, $velz:literal, $yaw:literal) => {
        [
            Rule::value(
                &[$posxy],
                6.0,
                "ExternalNav: the horizontal position is ours",
            )
            .of_group($group),
            Rule::value(
                &[$velxy],
                0.0,
                "none: ODOMETRY's velocity is that of the track and no measurement of its own",
            )
            .of_group($group),
            Rule::within(
                &[$posz],
                0.0,
                2.0,
                1.0,
                "1, the barometer: our height is the autopilot's own",
            )
            .of_group($group),
            Rule::value(
                &[$velz],
                0.0,
                "none: nothing measures the vertical velocity",
            )
            .of_group($group),
            Rule::within(
                &[$yaw],
                0.0,
                3.0,
                1.0,
                "1, the compass: our attitude is the autopilot's own",
            )
            .of_group($group),
        ]
    };
}

const SET_1: [Rule; 5] = source_set!(
    1,
    "EK3_SRC1_POSXY",
    "EK3_SRC1_VELXY",
    "EK3_SRC1_POSZ",
    "EK3_SRC1_VELZ",
    "EK3_SRC1_YAW"
);
const SET_2: [Rule; 5] = source_set!(
    2,
    "EK3_SRC2_POSXY",
    "EK3_SRC2_VELXY",
    "EK3_SRC2_POSZ",
    "EK3_SRC2_VELZ",
    "EK3_SRC2_YAW"
);
const SET_3: [Rule; 5] = source_set!(
    3,
    "EK3_SRC3_POSXY",
    "EK3_SRC3_VELXY",
    "EK3_SRC3_POSZ",
    "EK3_SRC3_VELZ",
    "EK3_SRC3_YAW"
);

const GPS_INPUT: [Rule; 5] = [
    Rule::value(
        &["GPS1_TYPE", "GPS_TYPE"],
        14.0,
        "MAV: the receiver is GPS_INPUT; reboot after the change",
    ),
    Rule::value(
        &["EK3_SRC1_POSXY"],
        3.0,
        "GPS: the horizontal position is the receiver's",
    ),
    Rule::value(
        &["EK3_SRC1_VELXY"],
        0.0,
        "none: the velocity in GPS_INPUT follows the autopilot's own, which would be fed back to it",
    ),
    Rule::within(
        &["EK3_SRC1_POSZ"],
        0.0,
        2.0,
        1.0,
        "1, the barometer: our height is the autopilot's own",
    ),
    Rule::value(
        &["EK3_SRC1_VELZ"],
        0.0,
        "none: nothing measures the vertical velocity",
    ),
];

/// The parameters that matter for a message.
///
/// # Errors
/// Why ArduPilot does not take it.
pub(crate) fn rules(output: Output, version: Option<Version>) -> Result<Vec<Rule>, &'static str> {
    let mut rules = EKF.to_vec();
    match output {
        Output::Odometry => {
            rules.extend(ODOMETRY);
            rules.push(LEAST_NOISE);
            rules.extend([SET_1, SET_2, SET_3].concat());
        }
        Output::PositionEstimate => {
            if version.is_some_and(|version| !version.is_at_least(4, 5)) {
                return Err("MAV_CMD_EXTERNAL_POSITION_ESTIMATE needs ArduPilot 4.5 or later");
            }
        }
        Output::GpsInput => {
            rules.extend(GPS_INPUT);
            rules.push(LEAST_NOISE);
        }
        Output::GlobalPositionSensor => {
            return Err("ArduPilot does not read GLOBAL_POSITION_SENSOR; use ODOMETRY");
        }
    }
    Ok(rules)
}

/// The source set with our positions; set 2 if there is none, since set 1 usually is that of GNSS.
pub(crate) fn chosen(values: &BTreeMap<String, f64>) -> Chosen<'_> {
    let sets = [
        (2, "EK3_SRC2_POSXY"),
        (3, "EK3_SRC3_POSXY"),
        (1, "EK3_SRC1_POSXY"),
    ];
    let group = sets
        .iter()
        .find(|(_, name)| values.get(*name) == Some(&6.0))
        .map_or(2, |(group, _)| *group);
    Chosen { values, group }
}
