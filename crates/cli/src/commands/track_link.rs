//! Options of `grim track` for an autopilot, a receiver of NMEA sentences, and recorded telemetry.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use grimnet_link::{Address, CameraMount, LinkOptions, NmeaTarget, VELOCITY_SIGMA_M_S};
use grimnet_track::FixedMount;

use super::link_options::{LinkChoice, address};
use crate::formats::TextTarget;
use crate::tracking::live::LiveOptions;
use crate::values;

/// Heading of these options.
const LINK: &str = "Autopilot and telemetry";

/// What the flight is connected with.
#[derive(Debug, Args)]
pub struct TrackLinkArgs {
    /// Read an autopilot's attitude, height and velocity and send it positions: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or
    /// serial:PATH:BAUD
    ///
    /// Nothing is sent while the track is searching, ambiguous or lost. `grim link check` says which parameters the autopilot lacks.
    #[arg(long, value_name = "ADDRESS", value_parser = address, help_heading = LINK)]
    pub mavlink: Option<Address>,

    #[command(flatten)]
    pub message: LinkChoice,

    /// Camera whose attitude the autopilot's telemetry gives: gimbal (the first that reports, else as fixed), gimbal:ID (the
    /// one with this MAVLink component or number), fixed (to the aircraft, see --camera-mount), unknown (attitude is not used)
    /// [default: gimbal; fixed with --camera-mount]
    #[arg(long, value_name = "MOUNT", help_heading = LINK)]
    pub mavlink_camera: Option<CameraMount>,

    /// How a camera without a gimbal is mounted on the aircraft, degrees: where the picture's top points, clockwise from the nose,
    /// and its pitch (-90 looks straight down) [default: 0,-90]
    ///
    /// For attitudes of the aircraft, from --mavlink or --telemetry. 90 is a camera whose picture has the right wing at its top,
    /// 0,-60 one that looks ahead by 30 degrees from straight down, which needs the field of view, too.
    #[arg(long, value_name = "YAW[,PITCH]", allow_hyphen_values = true, conflicts_with = "pitch", help_heading = LINK)]
    pub camera_mount: Option<FixedMount>,

    /// Error of the autopilot's velocity, metres per second (1 sigma per axis); 0: velocities are not used
    #[arg(long, value_name = "M_S", default_value_t = VELOCITY_SIGMA_M_S, value_parser = values::sigma_m_s, allow_hyphen_values = true, help_heading = LINK)]
    pub mavlink_velocity_sigma: f64,

    /// Print what would be sent to the autopilot, and send nothing; --nmea then takes a file or `-`
    #[arg(long, requires = "mavlink", help_heading = LINK)]
    pub dry_run: bool,

    /// Send NMEA sentences (GGA and RMC): udpout:HOST:PORT, tcp:HOST:PORT, serial:PATH:BAUD, a file, or `-` for standard output
    #[arg(long, value_name = "TARGET", help_heading = LINK)]
    pub nmea: Option<NmeaTarget>,

    /// Recorded attitude, height and velocity: CSV, DJI's SRT subtitles, or MISB ST 0601 KLV, alone or in an MPEG transport stream
    /// [default: the SRT beside a video, or what is in a transport stream]
    #[arg(long, value_name = "FILE", help_heading = LINK)]
    pub telemetry: Option<PathBuf>,

    /// The times of the recorded telemetry are so many seconds late; early if negative
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = values::seconds, allow_hyphen_values = true, help_heading = LINK)]
    pub telemetry_delay: f64,
}

impl TrackLinkArgs {
    /// What runs beside the flight, whose frames are so old when they come if they have a clock of their own.
    ///
    /// # Errors
    /// A key that cannot be read, or sentences that would be sent in a dry run.
    pub fn live_options(&self, frame_latency_s: Option<f64>) -> Result<LiveOptions> {
        let mavlink = match &self.mavlink {
            Some(address) => {
                let mut options = LinkOptions::new(address.clone());
                options.output = self.message.mavlink_message;
                options.system_id = self.message.mavlink_system;
                options.signing = self.message.key()?;
                options.dry_run = self.dry_run;
                options.telemetry.camera_mount = self.mavlink_camera();
                options.telemetry.fixed_mount = self.camera_mount.unwrap_or_default();
                let sigma_m_s = self.mavlink_velocity_sigma;
                options.telemetry.velocity_sigma_m_s = (sigma_m_s > 0.0).then_some(sigma_m_s);
                Some(options)
            }
            None => None,
        };
        let nmea = match &self.nmea {
            Some(NmeaTarget::Address(address)) if self.dry_run => bail!(
                "--dry-run sends nothing, and --nmea {address} sends sentences; --nmea - or --nmea FILE shows them"
            ),
            Some(NmeaTarget::Address(address)) => Some(address.clone()),
            _ => None,
        };
        Ok(LiveOptions {
            mavlink,
            nmea,
            frame_latency_s,
        })
    }

    /// Whose attitude the autopilot's telemetry gives. A mount on the aircraft is not that of a gimbal, whatever gimbals report.
    fn mavlink_camera(&self) -> CameraMount {
        let of_mount = self.camera_mount.map(|_| CameraMount::Fixed);
        self.mavlink_camera.or(of_mount).unwrap_or_default()
    }

    /// Whether attitudes of the aircraft may come from the autopilot.
    pub fn reads_attitude_of_aircraft(&self) -> bool {
        let is_of_aircraft = matches!(
            self.mavlink_camera(),
            CameraMount::Fixed | CameraMount::GimbalIfReported
        );
        self.mavlink.is_some() && is_of_aircraft
    }

    /// Whether positions go to an autopilot or a receiver during the flight.
    pub fn is_connected(&self) -> bool {
        self.mavlink.is_some() || matches!(self.nmea, Some(NmeaTarget::Address(_)))
    }

    /// The file or standard output that takes NMEA sentences.
    pub fn nmea_target(&self) -> Option<TextTarget<'_>> {
        match &self.nmea {
            Some(NmeaTarget::File(path)) => Some(TextTarget::of(Some(path))),
            _ => None,
        }
    }
}
