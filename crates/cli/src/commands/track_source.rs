//! Where the frames of `grim track` come from.

use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Result, bail};

use grimnet_locate::NeededPixels;
use grimnet_output::OutputPolicy;
use grimnet_photo::pictures::picture_files;

use super::track_options::{FrameArgs, TrackArgs};
use crate::tracking::following::Following;
use crate::tracking::frame_time::{Epoch, TimeSource};
use crate::tracking::frames::Frames;
use crate::tracking::handover::Keep;
use crate::tracking::photo_list::PhotoList;
use crate::tracking::standard_input::{Repeated, StreamedFrames};
use crate::tracking::video::{
    DEFAULT_FRAMES_PER_S, is_live_address, is_video, open_stream, open_video,
};
use crate::{inputs, photos};

/// A photo of a folder that waited for this long is left out for a newer one, where no link asks for the position now.
const MOST_WAIT: Duration = Duration::from_secs(2);

/// Where frames come from, as the command line names it.
pub enum Source {
    /// Photos, sorted by time.
    Photos(Vec<PathBuf>),
    /// A folder that photos are written into.
    Folder(PathBuf),
    /// A recorded video.
    Video(PathBuf),
    /// The address of a live stream.
    Stream(PathBuf),
    /// JPEGs one after another.
    StandardInput,
}

impl Source {
    /// The source that the command line names.
    ///
    /// # Errors
    /// Sources that do not go together, or photos that are not there.
    pub fn of(arguments: &TrackArgs) -> Result<Self> {
        let source = arguments.source.as_slice();
        if arguments.frames.follow {
            return match source {
                [folder] => Ok(Self::Folder(folder.clone())),
                _ => bail!("--follow expects one folder"),
            };
        }
        match source {
            [only] if only == Path::new("-") => Ok(Self::StandardInput),
            [only] if is_live_address(only) => Ok(Self::Stream(only.clone())),
            [only] if is_video(only) => Ok(Self::Video(only.clone())),
            several if several.iter().any(|path| is_video(path)) => {
                bail!("expected one video, or photos; not several sources together")
            }
            _ => Ok(Self::Photos(photos::expand(source)?)),
        }
    }

    /// Whether frames come while the aircraft flies.
    pub fn is_live(&self) -> bool {
        matches!(
            self,
            Self::Folder(_) | Self::Stream(_) | Self::StandardInput
        )
    }

    /// What the times of the frames count from, if that is known before the first one.
    pub fn known_epoch(&self, frames: &FrameArgs) -> Option<Epoch> {
        let is_video = matches!(self, Self::Video(_) | Self::Stream(_));
        (is_video || frames.fps.is_some()).then_some(Epoch::Start)
    }

    /// Checks that what is said of the frames' times has an effect.
    ///
    /// # Errors
    /// It has none.
    pub fn check_times(&self, arguments: &TrackArgs) -> Result<()> {
        let frames = &arguments.frames;
        match self {
            Self::Video(_) if frames.clock_offset != 0.0 => bail!(
                "--clock-offset is added to the times of photos, and those of a video count from its beginning; --telemetry-delay \
                 moves the times of recorded telemetry"
            ),
            Self::Stream(_) if frames.clock_offset != 0.0 => bail!(
                "--clock-offset is added to the times of photos, and those of a live stream count from its first frame; \
                 --frame-latency says how old frames are when they come"
            ),
            Self::Video(_) | Self::Stream(_) if frames.time_from != TimeSource::default() => bail!(
                "--time-from says where the times of photos come from, and those of a video or a live stream count from its beginning"
            ),
            _ => {}
        }
        if frames.frame_latency.is_none() {
            return Ok(());
        }
        if !self.is_live() {
            bail!(
                "--frame-latency says how old frames are when they come while the aircraft flies, and these are recorded; expected the \
                 address of a stream, `-`, or --follow"
            );
        }
        if !arguments.link.is_connected() {
            bail!(
                "--frame-latency moves the positions that are sent during the flight; expected --mavlink, or --nmea with an address"
            );
        }
        Ok(())
    }

    /// The recorded video.
    pub fn video(&self) -> Option<&Path> {
        match self {
            Self::Video(path) => Some(path),
            _ => None,
        }
    }

    /// The files that are known before it is opened, which no output may replace.
    pub fn files(&self) -> Vec<PathBuf> {
        match self {
            Self::Photos(paths) => paths.clone(),
            // Whether it can be read is said when it is opened.
            Self::Folder(folder) => picture_files(folder).unwrap_or_default(),
            Self::Video(path) => vec![path.clone()],
            Self::Stream(_) | Self::StandardInput => Vec::new(),
        }
    }

    /// Opens it; `needed` is how many pixels of its photos are used. Files that become known during the flight are added to the
    /// inputs of `policy`.
    ///
    /// # Errors
    /// The source cannot be read.
    pub fn open(
        self,
        arguments: &TrackArgs,
        needed: NeededPixels,
        policy: &OutputPolicy,
    ) -> Result<Box<dyn Frames>> {
        let frames = &arguments.frames;
        let options = frames.options(needed);
        Ok(match self {
            Self::Photos(paths) => {
                paths
                    .iter()
                    .try_for_each(|path| inputs::check_regular(path))?;
                Box::new(PhotoList::new(paths, &options)?)
            }
            Self::Folder(folder) => Box::new(Following::new(
                &folder,
                options,
                frames.idle.map(Duration::from_secs_f64),
                most_wait(arguments),
                policy.clone(),
            )?),
            Self::Video(path) => {
                let frames_per_s = frames.fps.unwrap_or(DEFAULT_FRAMES_PER_S);
                open_video(&path, frames_per_s, options.limits)?
            }
            Self::Stream(address) => {
                let frames_per_s = frames.fps.unwrap_or(DEFAULT_FRAMES_PER_S);
                open_stream(&address, frames_per_s, options.limits)?
            }
            Self::StandardInput => {
                // Without a link it may be a recorded flight, of which nothing may be lost.
                let keep = if arguments.link.is_connected() {
                    Keep::Newest
                } else {
                    Keep::All
                };
                let input = BufReader::new(std::io::stdin());
                let policy = policy.clone();
                Box::new(StreamedFrames::new(
                    input,
                    options,
                    policy,
                    keep,
                    Repeated::First,
                )?)
            }
        })
    }
}

/// How long a photo of a folder may wait for its turn where a newer one is there. Between photos a link is given positions from the
/// last one that was searched, so that its age counts.
fn most_wait(arguments: &TrackArgs) -> Duration {
    let given = arguments.frames.most_wait.map(Duration::from_secs_f64);
    given.unwrap_or(if arguments.link.is_connected() {
        Duration::ZERO
    } else {
        MOST_WAIT
    })
}
