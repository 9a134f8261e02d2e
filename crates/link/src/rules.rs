//! What an autopilot has to be set to so that it takes a message with positions.

mod ardupilot;
mod px4;
mod rule;

use std::collections::BTreeMap;

pub(crate) use self::rule::Rule;
pub use self::rule::{Finding, Verdict};
use crate::{
    autopilot::{Autopilot, AutopilotKind},
    output::Output,
};

/// Why the autopilot does not take the message, and else the parameters that matter.
pub(crate) fn rules_for(
    autopilot: &Autopilot,
    output: Output,
) -> (Option<&'static str>, Vec<Rule>) {
    let answer = match autopilot.kind {
        AutopilotKind::ArduPilot => ardupilot::rules(output, autopilot.version),
        AutopilotKind::Px4 => px4::rules(output, autopilot.version),
        AutopilotKind::Other => Err("only ArduPilot and PX4 are known; use NMEA sentences"),
    };
    match answer {
        Ok(rules) => (None, rules),
        Err(reason) => (Some(reason), Vec::new()),
    }
}

/// How each of the rules that matter stands with the values that were read.
pub(crate) fn findings(
    autopilot: &Autopilot,
    rules: &[Rule],
    found: &BTreeMap<String, f64>,
) -> Vec<Finding> {
    let found = match autopilot.kind {
        AutopilotKind::ArduPilot => ardupilot::chosen(found),
        _ => px4::chosen(found),
    };
    rules
        .iter()
        .filter(|rule| found.concerns(rule))
        .map(|rule| rule.finding(found.values))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden_tests::autopilot;

    /// What is to be set, and whether it must be.
    fn to_set(
        autopilot: &Autopilot,
        output: Output,
        values: &[(&str, f64)],
    ) -> Vec<(&'static str, f64, bool)> {
        let values = values
            .iter()
            .map(|(name, value)| ((*name).to_owned(), *value))
            .collect();
        let (refused, rules) = rules_for(autopilot, output);
        assert_eq!(refused, None);
        findings(autopilot, &rules, &values)
            .iter()
            .filter(|finding| matches!(finding.verdict, Verdict::Wrong | Verdict::Advice))
            .map(|finding| (finding.parameter, finding.set_to, finding.must_change()))
            .collect()
    }

    #[test]
    fn the_noise_that_the_guide_advises_is_left_as_it_is() {
        let ardupilot = autopilot(AutopilotKind::ArduPilot, 4, 6);
        let px4 = autopilot(AutopilotKind::Px4, 1, 17);
        let newer_px4 = autopilot(AutopilotKind::Px4, 1, 18);
        for (autopilot, output, name, default_m) in [
            (&ardupilot, Output::Odometry, "VISO_POS_M_NSE", 0.2),
            (&ardupilot, Output::Odometry, "EK3_POSNE_M_NSE", 0.5),
            (&ardupilot, Output::GpsInput, "EK3_POSNE_M_NSE", 0.5),
            (&px4, Output::Odometry, "EKF2_EVP_NOISE", 0.1),
            (
                &newer_px4,
                Output::GlobalPositionSensor,
                "EKF2_AGP0_NOISE",
                0.5,
            ),
        ] {
            for noise_m in [1.0, 5.0, 10.0] {
                let to_set = to_set(autopilot, output, &[(name, noise_m)]);
                assert!(to_set.is_empty(), "{noise_m}: {to_set:?}");
            }
            assert_eq!(
                to_set(autopilot, output, &[(name, default_m)]),
                [(name, 5.0, false)]
            );
        }
    }

    #[test]
    fn the_velocity_and_height_of_gps_input_are_not_to_be_fused() {
        let ardupilot = autopilot(AutopilotKind::ArduPilot, 4, 6);
        let gnss = [
            ("GPS1_TYPE", 14.0),
            ("EK3_SRC1_POSXY", 3.0),
            ("EK3_SRC1_VELXY", 3.0),
            ("EK3_SRC1_POSZ", 3.0),
            ("EK3_SRC1_VELZ", 3.0),
        ];
        assert_eq!(
            to_set(&ardupilot, Output::GpsInput, &gnss),
            [
                ("EK3_SRC1_VELXY", 0.0, true),
                ("EK3_SRC1_POSZ", 1.0, true),
                ("EK3_SRC1_VELZ", 0.0, true),
            ]
        );
    }
}
