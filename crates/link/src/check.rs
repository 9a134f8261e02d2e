//! Which parameters of an autopilot must change so that it takes the positions.

mod ardupilot;
mod px4;
mod rule;

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use self::rule::Rule;
pub use self::rule::{Finding, Verdict};
use crate::{
    address::Address,
    autopilot::{Autopilot, AutopilotKind},
    clock::LinkClock,
    connection::Connection,
    error::LinkError,
    event::LinkEvent,
    options::LinkOptions,
    output::Output,
    parameters::read_parameters,
    session::Session,
    signing::SigningKey,
};

const WAIT: Duration = Duration::from_millis(20);

/// What to check, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckOptions {
    /// Where the autopilot is.
    pub address: Address,
    /// The message that is to carry positions. `None`: [`Output::for_autopilot`].
    pub output: Option<Output>,
    /// The autopilot's MAVLink system. `None`: the first one that is heard.
    pub system_id: Option<u8>,
    /// The key with which messages are signed.
    pub signing: Option<SigningKey>,
    /// How long to wait for an autopilot, seconds.
    pub within_s: f64,
}

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckReport {
    /// Who answered.
    pub autopilot: Autopilot,
    /// The message that was checked for.
    pub output: Output,
    /// Why this autopilot cannot take that message at all.
    pub refused: Option<&'static str>,
    /// Parameter by parameter.
    pub findings: Vec<Finding>,
}

impl CheckReport {
    /// Whether the autopilot takes the positions as it is set.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.refused.is_none() && !self.findings.iter().any(Finding::must_change)
    }
}

/// Reads the parameters of an autopilot and compares them with what the positions need. `heard` is told what happens.
///
/// # Errors
/// [`LinkError::NoAutopilot`] if none is heard in time.
pub fn check(
    options: &CheckOptions,
    heard: &mut dyn FnMut(&LinkEvent),
) -> Result<CheckReport, LinkError> {
    let mut connection = Connection::new(options.address.clone(), options.signing.as_ref());
    let autopilot = find_autopilot(&mut connection, options, heard)?;
    let output = options
        .output
        .unwrap_or_else(|| Output::for_autopilot(&autopilot));
    let (refused, rules) = rules_for(&autopilot, output);
    let names: Vec<&str> = rules.iter().flat_map(Rule::names).copied().collect();
    let mut events = Vec::new();
    let found = read_parameters(&mut connection, &autopilot, &names, &mut events);
    events.iter().for_each(heard);
    Ok(CheckReport {
        autopilot,
        output,
        refused,
        findings: findings(&autopilot, &rules, &found),
    })
}

/// Why the autopilot does not take the message, and else the parameters that matter.
fn rules_for(autopilot: &Autopilot, output: Output) -> (Option<&'static str>, Vec<Rule>) {
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

fn findings(autopilot: &Autopilot, rules: &[Rule], found: &BTreeMap<String, f64>) -> Vec<Finding> {
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

fn find_autopilot(
    connection: &mut Connection,
    options: &CheckOptions,
    heard: &mut dyn FnMut(&LinkEvent),
) -> Result<Autopilot, LinkError> {
    let link_options = LinkOptions {
        system_id: options.system_id,
        ..LinkOptions::new(options.address.clone())
    };
    let clock = LinkClock::unix();
    let mut session = Session::new(link_options, clock.now_s());
    let within = Duration::try_from_secs_f64(options.within_s).unwrap_or(Duration::MAX);
    let began = Instant::now();
    loop {
        let mut events = Vec::new();
        for (header, message) in connection.receive(WAIT, &mut events) {
            session.receive(&header, &message, clock.now_s());
        }
        for message in session.poll(clock.now_s(), &|_| None) {
            connection.send(session.system_id(), &message, &mut events);
        }
        // That there is no track is no news here.
        session
            .events
            .retain(|event| !matches!(event, LinkEvent::NotSending(_)));
        events.append(&mut session.events);
        events.iter().for_each(&mut *heard);
        match session.autopilot() {
            Some(autopilot) if session.is_version_settled(clock.now_s()) => return Ok(autopilot),
            None if began.elapsed() > within => {
                let reason = connection.failure().map(|why| format!(" ({why})"));
                return Err(LinkError::NoAutopilot {
                    address: options.address.to_string(),
                    within_s: options.within_s,
                    reason: reason.unwrap_or_default(),
                });
            }
            Some(_) | None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::Version;

    fn autopilot(kind: AutopilotKind, major: u8, minor: u8) -> Autopilot {
        Autopilot {
            system_id: 1,
            component_id: 1,
            kind,
            version: Some(Version {
                major,
                minor,
                patch: 0,
            }),
        }
    }

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
