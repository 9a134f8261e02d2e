//! Which parameters of an autopilot must change so that it takes the positions.

use std::time::{Duration, Instant};

use crate::{
    address::Address,
    autopilot::Autopilot,
    clock::LinkClock,
    connection::Connection,
    error::LinkError,
    event::LinkEvent,
    exchange::exchange,
    options::LinkOptions,
    output::Output,
    parameters::read_parameters,
    rules::{Finding, Rule, findings, rules_for},
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

/// Reads the parameters of an autopilot and compares them with what the positions need. `heard` is told what happens. Nothing of the
/// autopilot is changed: not its parameters, nor the rates of its telemetry.
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
    let mut session = Session::without_telemetry(link_options, clock.now_s());
    let within = Duration::try_from_secs_f64(options.within_s).unwrap_or(Duration::MAX);
    let began = Instant::now();
    let mut something_came = false;
    loop {
        let mut events = exchange(connection, &mut session, &clock, WAIT, &|_| None);
        something_came |= connection.has_received();
        // That there is no track is no news here.
        session
            .events
            .retain(|event| !matches!(event, LinkEvent::NotSending(_)));
        events.append(&mut session.events);
        events.iter().for_each(&mut *heard);
        match session.autopilot() {
            Some(autopilot) if session.is_version_settled(clock.now_s()) => return Ok(autopilot),
            None if began.elapsed() > within => {
                let failure = connection.failure().map(|why| format!(" ({why})"));
                let wanted = options.system_id;
                let wanted = wanted.map(|id| format!("; system {id} was awaited"));
                let unread = if something_came {
                    "; bytes came, but no heartbeat of an autopilot that is taken in: the baud rate, the version of MAVLink or \
                     the signing key may be another"
                } else {
                    ""
                };
                return Err(LinkError::NoAutopilot {
                    address: options.address.to_string(),
                    within_s: options.within_s,
                    reason: failure.unwrap_or_default() + &wanted.unwrap_or_default() + unread,
                });
            }
            Some(_) | None => {}
        }
    }
}
