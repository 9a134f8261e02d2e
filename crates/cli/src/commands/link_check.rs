//! `grim link check`.

use std::io::Write;

use anyhow::Result;
use clap::Args;
use grimnet_link::{Address, CheckOptions, CheckReport, Finding, LinkEvent, Verdict};

use super::link_options::{LinkChoice, address};
use crate::exit::Exit;
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
    write_report(&mut std::io::stdout().lock(), &report)?;
    Ok(if report.is_ready() {
        Exit::Done
    } else {
        Exit::Incomplete
    })
}

fn write_report(out: &mut impl Write, report: &CheckReport) -> std::io::Result<()> {
    writeln!(out, "{}, positions as {}", report.autopilot, report.output)?;
    if let Some(reason) = report.refused {
        return writeln!(out, "not possible: {reason}");
    }
    for finding in &report.findings {
        let found = finding
            .found
            .map_or("-".to_owned(), |value| value.to_string());
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
    let changes = || {
        let differs =
            |finding: &&Finding| matches!(finding.verdict, Verdict::Wrong | Verdict::Advice);
        report.findings.iter().filter(differs)
    };
    if changes().next().is_some() {
        writeln!(
            out,
            "\nTo type in MAVProxy (or set the same names in the parameter list of a ground station), then reboot the autopilot:"
        )?;
        for finding in changes() {
            writeln!(out, "  param set {} {}", finding.parameter, finding.set_to)?;
        }
    } else if report.is_ready() {
        writeln!(out, "\nThe autopilot is ready.")?;
    }
    Ok(())
}
