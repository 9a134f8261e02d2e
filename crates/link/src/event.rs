//! What happens on a link, to be shown to the user.

use std::fmt;

use crate::{address::Address, autopilot::Autopilot, output::Output};

/// Something that a user should know. [`fmt::Display`] gives one line.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum LinkEvent {
    /// The address was opened.
    Opened(Address),
    /// The address cannot be opened; it is tried again every second.
    CannotOpen {
        /// Where.
        address: Address,
        /// What the system says.
        reason: String,
    },
    /// The connection broke; it is opened again.
    Lost {
        /// Where.
        address: Address,
        /// What the system says.
        reason: String,
    },
    /// An autopilot was heard.
    Autopilot(Autopilot),
    /// None was heard in a dry run, and what would be sent to this one is shown.
    AutopilotAssumed(Autopilot),
    /// The autopilot has not been heard for a while.
    AutopilotSilent {
        /// How long, seconds.
        for_s: f64,
    },
    /// The autopilot's clock began again.
    AutopilotRestarted,
    /// Positions are sent from now on.
    Sending(Output),
    /// As [`LinkEvent::Sending`], to an autopilot of which is not known whether it reads that message.
    SendingToUnknown(Output),
    /// Positions are not sent from now on.
    NotSending(NotSending),
    /// The autopilot knew no origin and was told one.
    OriginSet {
        /// Degrees north.
        lat_deg: f64,
        /// Degrees east.
        lon_deg: f64,
    },
    /// The autopilot refuses the positions that it is commanded to take, from now on.
    PositionsRefused {
        /// The result that it gives.
        result: String,
    },
    /// The autopilot takes the positions again that it refused.
    PositionsAccepted,
    /// The camera's attitude is taken from the gimbal with this number from now on.
    Gimbal(u8),
    /// What would be sent.
    WouldSend(String),
}

/// Why no position is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NotSending {
    /// The track is searching, ambiguous or lost, or has not begun.
    NoPosition,
    /// The 95 % radius is above the limit.
    TooUncertain,
    /// The position is that of the image centre, since no height is known.
    ImageCentre,
    /// No recent fix supports the position, and the message would put it in the place of the autopilot's own.
    NoRecentFix,
    /// Without a fix for long, the position is what the autopilot's own velocity makes of the last one.
    OwnVelocity,
    /// No autopilot is heard.
    NoAutopilot,
    /// The autopilot has not told its version yet, on which the message and its contents depend.
    NoVersion,
    /// The autopilot has not told the origin of its metres.
    NoOrigin,
    /// The autopilot does not read the message that is to carry positions, and why.
    NotRead(&'static str),
}

impl fmt::Display for NotSending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoPosition => "the track has no position that may be used",
            Self::TooUncertain => "the position is too uncertain",
            Self::ImageCentre => {
                "no height is known, so the position is that of the image centre and not of the aircraft"
            }
            Self::NoRecentFix => {
                "no recent fix supports the position, which would replace the autopilot's own"
            }
            Self::OwnVelocity => {
                "without a fix for 10 s the position would be the autopilot's own velocity sent back"
            }
            Self::NoAutopilot => "no autopilot is heard",
            Self::NoVersion => "the autopilot has not told its version yet",
            Self::NoOrigin => "the autopilot has not told the origin of its local frame",
            Self::NotRead(reason) => reason,
        })
    }
}

impl fmt::Display for LinkEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Opened(address) => write!(f, "{address}: open"),
            Self::CannotOpen { address, reason } => {
                write!(
                    f,
                    "{address}: cannot be opened ({reason}); trying again every second"
                )
            }
            Self::Lost { address, reason } => {
                write!(f, "{address}: connection lost ({reason}); opening it again")
            }
            Self::Autopilot(autopilot) => write!(f, "autopilot: {autopilot}"),
            Self::AutopilotAssumed(autopilot) => {
                write!(f, "autopilot: none heard; assumed: {autopilot}")
            }
            Self::AutopilotSilent { for_s } => {
                write!(
                    f,
                    "autopilot: nothing heard for {for_s:.0} s; waiting for it"
                )
            }
            Self::AutopilotRestarted => f.write_str("autopilot: restarted"),
            Self::Sending(output) => write!(f, "sending positions as {output}"),
            Self::SendingToUnknown(output) => write!(
                f,
                "sending positions as {output}, which ArduPilot and PX4 read; whether this autopilot does is not known (NMEA sentences are \
                 read by others)"
            ),
            Self::NotSending(reason) => write!(f, "not sending positions: {reason}"),
            Self::OriginSet { lat_deg, lon_deg } => write!(
                f,
                "the autopilot had no origin and was told {lat_deg:.7} {lon_deg:.7}"
            ),
            Self::PositionsRefused { result } => {
                write!(f, "the autopilot refuses the positions: {result}")
            }
            Self::PositionsAccepted => f.write_str("the autopilot takes the positions"),
            Self::Gimbal(id) => write!(f, "the camera's attitude is that of gimbal {id}"),
            Self::WouldSend(text) => write!(f, "would send {text}"),
        }
    }
}
