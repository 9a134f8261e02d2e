//! Arguments of `grim track`.

use std::path::PathBuf;

use clap::{Arg, ArgGroup, Args};
use grimnet_flight::{FlightOptions, Known};
use grimnet_locate::{DEFAULT_MAP_ERROR_M, HeadingPrior, Near, NeededPixels, Options, Prior};
use grimnet_photo::ViewPrior;
use grimnet_track::{Start, TrackOptions, Vehicle};

use super::map_place::MapPlace;
use super::track_link::TrackLinkArgs;
use super::{LimitsChoice, ModelChoice};
use crate::outputs::OverwriteChoice;
use crate::tracking::formats::TrackFormat;
use crate::tracking::frame_time::TimeSource;
use crate::tracking::frames::FrameOptions;
use crate::values;

/// Heading of the options about frames.
const FRAMES: &str = "Frames";
/// Heading of the options that state what is known.
const KNOWN: &str = "What you know about the flight";
/// Heading of the options about output.
const OUTPUT: &str = "Output";

/// Options that --replay reads; all others are refused beside it.
const REPLAY_OPTIONS: [&str; 4] = ["replay", "format", "out", "overwrite"];
/// What the options begin with that say something of the link of --mavlink.
const OF_MAVLINK: &str = "mavlink_";

/// Refuses an option where it would have no effect.
fn refuse_without_effect(option: Arg) -> Arg {
    let name = option.get_id().as_str();
    let is_replayed = REPLAY_OPTIONS.contains(&name);
    let is_of_mavlink = name.starts_with(OF_MAVLINK);
    let option = if is_replayed {
        option
    } else {
        option.conflicts_with("replay")
    };
    if is_of_mavlink {
        option.requires("mavlink")
    } else {
        option
    }
}

/// What kind of aircraft carries the camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum VehicleChoice {
    /// Can stop and turn at any time
    #[default]
    Multirotor,
    /// Faster; cannot stop; turns by banking
    Plane,
}

/// Arguments of `grim track`.
#[derive(Debug, Args)]
#[command(mut_args(refuse_without_effect))]
pub struct TrackArgs {
    /// Photos, folders of photos or patterns; a video; `-` for standard input
    ///
    /// Photos are taken in order of time. Standard input holds JPEG pictures one after the other, or lines with the names of
    /// photo files. MP4 and MOV videos (H.264, H.265) are decoded here, other videos and addresses such as rtsp:// by an `ffmpeg`
    /// process. Of an address, which is a live stream, and of standard input beside --mavlink or --nmea ADDRESS, the newest frame is
    /// taken where frames come faster than they are processed.
    #[arg(required_unless_present = "replay")]
    pub source: Vec<PathBuf>,

    /// The map pack (made by `grim map build`)
    #[arg(
        short,
        long,
        value_name = "AREA.grim",
        required_unless_present = "replay"
    )]
    pub pack: Option<PathBuf>,

    #[command(flatten)]
    pub frames: FrameArgs,

    #[command(flatten)]
    pub known: KnownArgs,

    #[command(flatten)]
    pub link: TrackLinkArgs,

    #[command(flatten)]
    pub model: ModelChoice,

    #[command(flatten)]
    pub output: OutputArgs,
}

/// How frames come and when they were taken.
#[derive(Debug, Args)]
pub struct FrameArgs {
    /// Follow a folder into which photos are being written, until Ctrl-C
    ///
    /// Only complete files are taken: those whose size does not change any more, or that were renamed into the folder. A file that
    /// ends too early counts as damaged when 3 s have brought no more of it. Each name is taken once.
    #[arg(long, help_heading = FRAMES)]
    pub follow: bool,

    /// With --follow: end after so many seconds without a new photo
    #[arg(long, value_name = "S", requires = "follow", value_parser = values::duration_s, allow_hyphen_values = true, help_heading = FRAMES)]
    pub idle: Option<f64>,

    /// With --follow: a photo that waited for this long is left out for a newer one, and counted [default: 2; with --mavlink or
    /// --nmea ADDRESS 0, so that the newest photo is taken]
    #[arg(long, value_name = "S", requires = "follow", value_parser = values::duration_s, allow_hyphen_values = true, help_heading = FRAMES)]
    pub most_wait: Option<f64>,

    /// Where the times of photos come from; a clock without time zone is taken for UTC
    #[arg(long, value_enum, default_value_t, conflicts_with = "fps", help_heading = FRAMES)]
    pub time_from: TimeSource,

    /// Seconds to add to the times that photos tell, where the camera's clock is behind; negative where it is ahead
    #[arg(long, value_name = "S", default_value_t = 0.0, conflicts_with = "fps", value_parser = values::seconds, allow_hyphen_values = true, help_heading = FRAMES)]
    pub clock_offset: f64,

    /// How old live frames are when they come, seconds, if their times are not of this computer's clock: of a stream, with --fps, or
    /// of a camera whose clock cannot be set
    ///
    /// For --mavlink and --nmea: an error of it makes positions wrong by the way that is flown in the error. Without it, 0 is taken
    /// for frames without dates, with a warning.
    #[arg(long, value_name = "S", value_parser = values::latency_s, allow_hyphen_values = true, help_heading = FRAMES)]
    pub frame_latency: Option<f64>,

    /// Frames per second: of photos that are numbered in order and have no times; of a video, how many are taken [default: 2]
    #[arg(long, value_name = "N", value_parser = values::rate_per_s, allow_hyphen_values = true, help_heading = FRAMES)]
    pub fps: Option<f64>,

    #[command(flatten)]
    pub limits: LimitsChoice,
}

impl FrameArgs {
    /// How photos are read and get their times.
    pub fn options(&self, needed: NeededPixels) -> FrameOptions {
        FrameOptions {
            source: self.time_from,
            frames_per_s: self.fps,
            clock_offset_s: self.clock_offset,
            limits: self.limits.photo(),
            needed: Some(needed),
        }
    }
}

/// What the user knows.
#[derive(Debug, Args)]
pub struct KnownArgs {
    /// Where the aircraft is at the first frame, to 95 % within the radius [default: anywhere on the map]
    #[arg(long, value_name = "LAT,LON,RADIUS_M", allow_hyphen_values = true, help_heading = KNOWN)]
    pub start: Option<Near>,

    /// Type of aircraft
    #[arg(long, value_enum, default_value_t, help_heading = KNOWN)]
    pub vehicle: VehicleChoice,

    /// Pitch at which a gimbal holds the camera, degrees: -90 looks straight down, -60 towards the photo's top by 30 degrees;
    /// needs the field of view, too; overrides metadata [default: from the photos, else about straight down]
    #[arg(long, value_name = "DEG", value_parser = values::pitch_deg, allow_hyphen_values = true, help_heading = KNOWN)]
    pub pitch: Option<f64>,

    /// Height above ground, metres; overrides metadata [default: from the photos]
    #[arg(long, value_name = "M", value_parser = values::height_agl_m, allow_hyphen_values = true, help_heading = KNOWN)]
    pub height_agl: Option<f64>,

    /// Horizontal field of view, degrees; overrides metadata [default: from the photos]
    #[arg(long, value_name = "DEG", value_parser = values::fov_deg, allow_hyphen_values = true, help_heading = KNOWN)]
    pub hfov: Option<f64>,

    /// Do not use headings and attitudes of the photos' metadata
    #[arg(long, help_heading = KNOWN)]
    pub no_heading: bool,

    /// Position error of the map itself, metres (1 sigma per axis); the stated radius includes it
    #[arg(long, value_name = "M", value_parser = values::sigma_m, allow_hyphen_values = true, default_value_t = DEFAULT_MAP_ERROR_M, help_heading = KNOWN)]
    pub map_error: f64,
}

impl KnownArgs {
    /// What is known of every frame.
    pub fn known(&self) -> Known {
        let heading = if self.no_heading {
            HeadingPrior::Unknown
        } else {
            HeadingPrior::FromMetadata
        };
        Known {
            prior: Prior {
                view: ViewPrior {
                    heading,
                    pitch_deg: self.pitch,
                    roll_deg: None,
                    height_agl_m: self.height_agl,
                    hfov_deg: self.hfov,
                    gsd_m: None,
                },
                near: None,
            },
            attitude: None,
        }
    }

    /// How single frames are localised.
    pub fn options(&self) -> Options {
        Options {
            map_error_m: self.map_error,
            ..Options::default()
        }
    }

    /// How the flight is followed; with `clock_jump_s` between two inputs the clock has jumped.
    pub fn flight_options(&self, clock_jump_s: f64) -> FlightOptions {
        let vehicle = match self.vehicle {
            VehicleChoice::Multirotor => Vehicle::Multirotor,
            VehicleChoice::Plane => Vehicle::Plane,
        };
        let start = self.start.map(|start| Start {
            lonlat: start.centre,
            radius95_m: start.radius_m,
        });
        FlightOptions {
            track: TrackOptions {
                vehicle,
                start,
                clock_jump_s,
                ..TrackOptions::default()
            },
            ..FlightOptions::default()
        }
    }
}

/// Where the track goes.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("drawn").args(["report", "session"]).multiple(true)))]
pub struct OutputArgs {
    /// How to write the track [default: by the file's ending; table on a terminal, jsonl in a pipe]
    #[arg(long, value_enum, help_heading = OUTPUT)]
    pub format: Option<TrackFormat>,

    /// Write the track to this file; `-` is standard output [default: standard output]
    ///
    /// During the flight it is in FILE.partial, which is well-formed after every frame; a GeoPackage is written at the end.
    #[arg(short, long, value_name = "FILE", help_heading = OUTPUT)]
    pub out: Option<PathBuf>,

    #[command(flatten)]
    pub overwrite: OverwriteChoice,

    /// For recorded flights: write the track at the end, each point with what came before and after it (RTS smoother)
    #[arg(long, conflicts_with = "follow", help_heading = OUTPUT)]
    pub smooth: bool,

    /// True positions by photo, to state how far the track is from them
    ///
    /// A table with a column `photo`, and `gps_lat`,`gps_lon` (aircraft) or `lat_deg`,`lon_deg` (image centre).
    #[arg(long, value_name = "TRUTH.csv", help_heading = OUTPUT)]
    pub truth: Option<PathBuf>,

    /// Write a page with a map of the track, its ellipses and, with --truth, its error over time into this folder
    #[arg(long, value_name = "DIR", value_parser = values::output_folder(), help_heading = OUTPUT)]
    pub report: Option<PathBuf>,

    /// Write the track with its map as one HTML file with a slider, which opens without any server
    #[arg(long, value_name = "FILE.html", value_parser = values::output_file(), help_heading = OUTPUT)]
    pub session: Option<PathBuf>,

    /// The map, as background of --report and --session
    #[arg(long, value_name = "MAP", requires = "drawn", help_heading = OUTPUT)]
    pub map: Option<PathBuf>,

    #[command(flatten)]
    pub place: MapPlace,

    /// Record the flight into this folder: all inputs, times and answers
    #[arg(long, value_name = "DIR", value_parser = values::output_folder(), help_heading = OUTPUT)]
    pub record: Option<PathBuf>,

    /// Run a recorded flight again, without its photos, and say whether the track is the same
    ///
    /// A folder of --record, whose newest recording is taken, finished (flight.jsonl) or interrupted (flight.jsonl.partial); or
    /// the file of a recording.
    #[arg(long, value_name = "DIR|FILE", help_heading = OUTPUT)]
    pub replay: Option<PathBuf>,
}
