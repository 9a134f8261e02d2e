//! `grim link check`.

use std::io::Write;

use anyhow::Result;
use clap::Args;
use grimnet_link::{Address, CheckOptions, CheckReport, Finding, LinkEvent, Verdict};

use super::link_options::{LinkChoice, address};
use crate::exit::Exit;
use crate::standard_output::StandardOutput;
use crate::values;
use grimnet_answer::printable_text;

/// Examples under the help of `grim link check`.
pub const EXAMPLES: &str = "\
Examples:
  grim link check --mavlink udpin:0.0.0.0:14550
  grim link check --mavlink serial:/dev/ttyACM0:921600
  grim link check --mavlink tcp:127.0.0.1:5760 --mavlink-message gps-input

Exit status: 0 the autopilot is ready, 1 parameters must change, 2 no autopilot was heard.
docs/autopilot.md in the repository goes through the whole setup.";

/// Arguments of `grim link check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The autopilot: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PATH:BAUD
    #[arg(long, value_name = "ADDRESS", value_parser = address)]
    mavlink: Address,

    #[command(flatten)]
    link: LinkChoice,

    /// Seconds to wait for an autopilot
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = values::duration_s)]
    wait: f64,
}

/// Reads parameters and prints what they should be.
///
/// # Errors
/// No autopilot is heard; a key that cannot be read.
pub fn run(arguments: &CheckArgs) -> Result<Exit> {
    let options = CheckOptions {
        address: arguments.mavlink.clone(),
        output: arguments.link.mavlink_message,
        system_id: arguments.link.mavlink_system,
        signing: arguments.link.key()?,
        within_s: arguments.wait,
    };
    let mut tell = |event: &LinkEvent| {
        if matches!(event, LinkEvent::CannotOpen { .. } | LinkEvent::Lost { .. }) {
            tracing::warn!("{}", printable_text(&event.to_string()));
        }
    };
    let report = grimnet_link::check(&options, &mut tell)?;
    write_report(&mut StandardOutput, &report)?;
    Ok(if report.is_ready() {
        Exit::Done
    } else {
        Exit::Incomplete
    })
}

fn write_report(out: &mut dyn Write, report: &CheckReport) -> std::io::Result<()> {
    writeln!(out, "{}, positions as {}", report.autopilot, report.output)?;
    if let Some(reason) = report.refused {
        return writeln!(out, "not possible: {reason}");
    }
    for finding in &report.findings {
        // Parameters are floats of 32 bits, of which 0.2 is 0.20000000298.
        let found = finding
            .found
            .map_or("-".to_owned(), |value| (value as f32).to_string());
        writeln!(
            out,
            "{:8} {:16} is {found}, expected {}: {}",
            finding.verdict, finding.parameter, finding.expected, finding.reason
        )?;
    }
    let missing = |finding: &&Finding| finding.needed && finding.verdict == Verdict::Missing;
    if report.findings.iter().any(|finding| missing(&finding)) {
        writeln!(
            out,
            "\nThe autopilot does not know a parameter that is needed: its firmware lacks the feature, or it did not answer."
        )?;
    }
    let write_commands = |out: &mut dyn Write, verdict: Verdict, heading: &str| {
        let mut findings = report
            .findings
            .iter()
            .filter(|finding| finding.verdict == verdict)
            .peekable();
        if findings.peek().is_some() {
            writeln!(out, "\n{heading}")?;
        }
        findings.try_for_each(|finding| {
            writeln!(out, "  param set {} {}", finding.parameter, finding.set_to)
        })
    };
    let how = "in MAVProxy (or set the same names in the parameter list of a ground station), then reboot the autopilot:";
    write_commands(out, Verdict::Wrong, &format!("To type {how}"))?;
    if report.is_ready() {
        writeln!(out, "\nThe autopilot is ready.")?;
    }
    write_commands(
        out,
        Verdict::Advice,
        &format!("Advice, without which positions are taken too; to type {how}"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_link::{Autopilot, AutopilotKind, Output};

    fn finding(parameter: &'static str, verdict: Verdict, needed: bool) -> Finding {
        Finding {
            parameter,
            found: Some(0.1),
            expected: "1 to 10".to_owned(),
            set_to: 5.0,
            verdict,
            needed,
            reason: "metres",
        }
    }

    fn written(findings: Vec<Finding>) -> String {
        let report = CheckReport {
            autopilot: Autopilot {
                system_id: 1,
                component_id: 1,
                kind: AutopilotKind::Px4,
                version: None,
            },
            output: Output::Odometry,
            refused: None,
            findings,
        };
        let mut out = Vec::new();
        write_report(&mut out, &report).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn values_are_shown_as_they_were_set() {
        let mut default = finding("VISO_POS_M_NSE", Verdict::Advice, false);
        default.found = Some(f64::from(0.2_f32));
        let text = written(vec![default]);
        assert!(text.contains(" is 0.2, expected"), "{text}");
    }

    #[test]
    fn an_autopilot_that_is_ready_is_said_to_be_whatever_is_advised() {
        let right = finding("EKF2_EV_CTRL", Verdict::Right, true);
        let advice = finding("EKF2_EVP_NOISE", Verdict::Advice, false);
        let wrong = finding("EKF2_EV_DELAY", Verdict::Wrong, true);
        let text = written(vec![right.clone(), advice.clone()]);
        let ready = text.find("The autopilot is ready.").unwrap();
        let advised = text.find("  param set EKF2_EVP_NOISE 5").unwrap();
        assert!(
            ready < advised && text[ready..advised].contains("Advice"),
            "{text}"
        );
        let text = written(vec![right, advice, wrong]);
        assert!(!text.contains("is ready"), "{text}");
        let needed = text.find("  param set EKF2_EV_DELAY 5").unwrap();
        assert!(needed < text.find("Advice").unwrap(), "{text}");
    }
}
