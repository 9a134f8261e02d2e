//! `grim track`: follows a flight over its frames.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Result, bail};
use grimnet_flight::Flight;
use grimnet_locate::Localizer;
use grimnet_output::OutputPolicy;
use grimnet_pack::Pack;
use grimnet_track::{TrackOptions, TrackPoint};
use indicatif::ProgressBar;

use super::track_options::OutputArgs;
pub use super::track_options::TrackArgs;
use super::track_output::{TRACK_SO_FAR, check_outputs, open_nmea, open_output, while_read};
use super::track_reader::WhileRead;
use super::track_replay::replay;
use super::track_report::{ReportFolder, Scored};
use super::track_source::Source;
use crate::exit::Exit;
use crate::formats::{RowOutput, TextStream, stopped};
use crate::localise::{open_pack, warn_if_off_the_map};
use crate::tracking::frames::{Frame, Frames};
use crate::tracking::line::{TrackLine, state_text};
use crate::tracking::live::{Live, check_time_of_day};
use crate::tracking::recorded_telemetry::{RecordedTelemetry, beside_video};
use crate::tracking::recording::Recorder;
use crate::tracking::session::{Session, Tracked};
use crate::tracking::smoothed::smoothed_lines;
use crate::tracking::truth::Truth;
use crate::{interrupt, progress};

/// Examples under the help of `grim track`.
pub const EXAMPLES: &str = "\
Examples:
  grim track --pack town.grim flight/ -o flight.gpx
  grim track --pack town.grim flight/ -o flight.gpkg --session flight.html --map town.tif
  grim track --pack town.grim incoming/ --follow --start 24.26,120.72,200
  grim track --pack town.grim flight/ --smooth --report report --map town.tif --truth truth.csv
  grim track --pack town.grim DJI_0001.MP4 --fps 2 --hfov 73
  camera | grim track --pack town.grim - --fps 5 --record recorded
  grim track --pack town.grim incoming/ --follow --mavlink serial:/dev/ttyAMA0:921600
  grim track --pack town.grim rtsp://10.0.0.2/stream --hfov 73 --mavlink udpin:0.0.0.0:14550 --frame-latency 0.3
  grim track --replay recorded

Exit status: 0 the aircraft was found, or a replay gave the same track, 1 it was not, or some frames could not be used, or a replay \
gave another track, 2 wrong use or input that cannot be read, 130 stopped by Ctrl-C (the track so far is written).";

/// Longest step of time in recorded photos, seconds: they are sorted by time, and a long pause is no jump of the clock.
const LONGEST_PAUSE_S: f64 = 1e9;

/// Runs the command.
///
/// # Errors
/// Unreadable pack, model or source; a track that cannot be written. A frame that cannot be used gets a warning and stops nothing.
pub fn run(arguments: &TrackArgs) -> Result<Exit> {
    if let Some(recording) = &arguments.output.replay {
        return replay(arguments, recording);
    }
    let Some(pack) = &arguments.pack else {
        bail!("expected a map pack, --pack AREA.grim");
    };
    let OutputArgs { place, map, .. } = &arguments.output;
    place.check_is_used(map.is_some())?;
    let source = Source::of(arguments)?;
    source.check_times(arguments)?;
    let telemetry_file = telemetry_file(arguments, &source);
    let policy = policy(arguments, pack, &source).protect_all(&telemetry_file);
    let output = &arguments.output;
    check_outputs(arguments, &policy)?;
    if let (Some(_), Some(epoch)) = (&arguments.link.nmea, source.known_epoch(&arguments.frames)) {
        check_time_of_day(epoch)?;
    }
    let mut telemetry = telemetry(arguments, &source, telemetry_file)?;
    let live_options = arguments
        .link
        .live_options(arguments.frames.frame_latency)?;
    let truth = output.truth.as_deref().map(Truth::read).transpose()?;
    let localizer = Arc::new(open_localizer(arguments, pack, truth.as_ref())?);
    let session_file = session_file(arguments, &policy, &localizer)?;
    let report = report_folder(arguments, &policy, localizer.pack())?;
    let needed = localizer.needed_pixels(&arguments.known.known().prior);
    let options = arguments.known.flight_options(clock_jump_s(&source));
    let flight = Flight::new(localizer, options)?;
    let recorder = match &output.record {
        Some(folder) => Some(Recorder::create(folder, &policy)?),
        None => None,
    };
    let stream = open_output(arguments, &policy)?;
    let nmea = open_nmea(arguments, &policy)?;
    // Before the first frame is waited for.
    let live = Live::start(&live_options, source.is_live())?;
    // Before it is opened: a program that decodes a stream ends with the flight.
    let stop = Arc::new(AtomicBool::new(false));
    interrupt::stop_on_interrupt(&stop)?;
    let mut frames = source.open(arguments, needed, &policy)?;
    if let (Some(telemetry), Some(ends_s)) = (&mut telemetry, frames.ends_s()) {
        telemetry.compare_with_video(ends_s);
    }
    let session = Session::new(flight, arguments.known.known(), recorder, output.smooth);
    let mut followed = Followed {
        session,
        beside: Beside {
            telemetry,
            live,
            nmea,
        },
        truth,
        named_in_truth: 0,
        session_file,
        scored: Vec::new(),
        lines: Vec::new(),
        keeps_lines: output.smooth || report.is_some(),
    };
    let partial = stream.partial_path();
    let rows = while_read(stream, arguments);
    let interrupted = write_track(&mut followed, frames.as_mut(), rows, output.smooth, &stop)
        .map_err(|error| stopped(error, TRACK_SO_FAR, partial))?;
    if let Some(report) = report {
        report.write(&followed.scored)?;
    }
    #[cfg(feature = "serve")]
    if let Some(file) = &followed.session_file {
        file.write()?;
    }
    let exit = summarise(&followed, frames.as_ref(), interrupted);
    if let Some(nmea) = followed.beside.nmea {
        nmea.finish(TextStream::finish)?;
    }
    followed.session.finish()?;
    Ok(exit)
}

/// Opens model and pack. Warns of a start and of a truth that are not on the map.
///
/// # Errors
/// Model or pack cannot be read, or they do not fit together.
fn open_localizer(arguments: &TrackArgs, pack: &Path, truth: Option<&Truth>) -> Result<Localizer> {
    let options = arguments.known.options();
    let pack = open_pack(pack, options.mode)?;
    let localizer = Localizer::new(arguments.model.open()?, pack)?.with_options(options);
    if let Some(start) = &arguments.known.start {
        warn_if_off_the_map("--start", start, &localizer)?;
    }
    if let Some(truth) = truth {
        truth.warn_if_off_the_map(&localizer)?;
    }
    Ok(localizer)
}

/// A step of time beyond which the clock of the source has jumped, seconds.
fn clock_jump_s(source: &Source) -> f64 {
    if source.is_live() {
        TrackOptions::default().clock_jump_s
    } else {
        LONGEST_PAUSE_S
    }
}

/// The file of `--session`.
#[cfg(feature = "serve")]
type SessionFile<'a> = super::track_session::SessionFile<'a>;
/// This build has none.
#[cfg(not(feature = "serve"))]
type SessionFile<'a> = std::marker::PhantomData<&'a ()>;

/// Opens the file of `--session`, if it is asked for.
///
/// # Errors
/// It may not be written, the map cannot be read, or this build has no such files.
fn session_file<'a>(
    arguments: &'a TrackArgs,
    policy: &'a OutputPolicy,
    localizer: &Arc<Localizer>,
) -> Result<Option<SessionFile<'a>>> {
    let output = &arguments.output;
    let Some(path) = &output.session else {
        return Ok(None);
    };
    #[cfg(feature = "serve")]
    {
        let map = output.map.as_deref();
        SessionFile::open(path, policy, localizer.clone(), map, &output.place).map(Some)
    }
    #[cfg(not(feature = "serve"))]
    {
        let _ = (path, policy, localizer);
        bail!(super::absent::message("grim track --session", "serve"))
    }
}

/// Opens the folder of `--report`, if it is asked for.
///
/// # Errors
/// It may not be written, or the map cannot be read or is not that of the pack.
fn report_folder(
    arguments: &TrackArgs,
    policy: &OutputPolicy,
    pack: &Pack,
) -> Result<Option<ReportFolder>> {
    let output = &arguments.output;
    let map = output.map.as_deref();
    let open = |folder| ReportFolder::open(folder, policy, map, &output.place, pack);
    output.report.as_deref().map(open).transpose()
}

/// What may be replaced: nothing that this run reads, as far as it is known before anything is opened.
fn policy(arguments: &TrackArgs, pack: &Path, source: &Source) -> OutputPolicy {
    let output = &arguments.output;
    output
        .overwrite
        .policy()
        .protect(pack)
        .protect_all(source.files())
        .protect_all(&arguments.model.model)
        .protect_all(&output.map)
        .protect_all(&output.truth)
        .protect_all(&arguments.link.message.mavlink_key)
}

/// A flight while it is followed.
struct Followed<'a> {
    session: Session,
    /// The file of the track with its map.
    #[cfg_attr(
        not(feature = "serve"),
        allow(
            dead_code,
            reason = "builds without the service write no session files"
        )
    )]
    session_file: Option<SessionFile<'a>>,
    beside: Beside,
    truth: Option<Truth>,
    /// Frames of which that says something.
    named_in_truth: usize,
    scored: Vec<Scored>,
    /// The lines, where they are needed at the end.
    lines: Vec<(f64, TrackLine)>,
    keeps_lines: bool,
}

/// What goes on beside the frames.
struct Beside {
    telemetry: Option<RecordedTelemetry>,
    live: Live,
    /// Sentences that are written into a file.
    nmea: Option<WhileRead<TextStream<TrackPoint>>>,
}

impl Followed<'_> {
    /// Takes in the frame that `frames` gave last, with the telemetry of its time, and hands the track on.
    fn frame(&mut self, frame: Frame, frames: &dyn Frames) -> Result<Tracked> {
        let epoch = frames.epoch();
        let Beside {
            telemetry,
            live,
            nmea,
        } = &mut self.beside;
        // The time of one that cannot be read may be of no photo: it says nothing of the clocks, and would use up what belongs to later
        // ones.
        let can_be_read = frame.photo.is_ok();
        if can_be_read {
            live.frame(frame.time_s, epoch, frames.newest_s(), frames.is_coarse())?;
        }
        let recorded = match telemetry {
            Some(telemetry) if can_be_read => telemetry.until(frame.time_s, epoch)?,
            _ => Vec::new(),
        };
        for input in recorded.into_iter().chain(live.telemetry()) {
            self.session.push(input)?;
        }
        let tracked = self.session.frame(frame, epoch)?;
        // What came while the frame was searched.
        for input in live.telemetry() {
            self.session.push(input)?;
        }
        live.publish(self.session.flight());
        if let (Some(nmea), Some(point)) = (nmea, &tracked.point) {
            check_time_of_day(epoch)?;
            nmea.write(|nmea| nmea.write(point))?;
        }
        Ok(tracked)
    }
}

/// The file of the recorded telemetry: the one that is given, else the one beside a video.
fn telemetry_file(arguments: &TrackArgs, source: &Source) -> Option<PathBuf> {
    let beside = || beside_video(source.video()?);
    arguments.link.telemetry.clone().or_else(beside)
}

/// The recorded telemetry: that of a file, else what is within the video.
fn telemetry(
    arguments: &TrackArgs,
    source: &Source,
    file: Option<PathBuf>,
) -> Result<Option<RecordedTelemetry>> {
    let delay_s = arguments.link.telemetry_delay;
    let telemetry = match (file, source.video()) {
        (Some(path), _) if arguments.link.telemetry.is_none() => {
            RecordedTelemetry::beside(&path, delay_s)
        }
        (Some(path), _) => {
            let mount = arguments.link.camera_mount.unwrap_or_default();
            Some(RecordedTelemetry::read(&path, delay_s, mount)?)
        }
        (None, Some(video)) => RecordedTelemetry::within_video(video, delay_s),
        (None, None) => None,
    };
    if telemetry.is_none() && delay_s != 0.0 {
        bail!(
            "--telemetry-delay moves the times of recorded telemetry, and there is none; expected --telemetry FILE"
        );
    }
    let is_of_aircraft = telemetry
        .as_ref()
        .is_some_and(RecordedTelemetry::has_attitude_of_aircraft);
    let is_of_aircraft = is_of_aircraft || arguments.link.reads_attitude_of_aircraft();
    if arguments.link.camera_mount.is_some() && !is_of_aircraft {
        bail!(
            "--camera-mount turns attitudes of the aircraft into those of the camera, and there are none; expected --mavlink, with \
             --mavlink-camera fixed or gimbal, or --telemetry FILE with the columns yaw_deg, pitch_deg and roll_deg"
        );
    }
    Ok(telemetry)
}

/// Follows all frames and writes the track, smoothed at the end if that is asked for. Gives whether it was interrupted.
fn write_track(
    followed: &mut Followed<'_>,
    frames: &mut dyn Frames,
    mut rows: WhileRead<RowOutput<TrackLine>>,
    smooth: bool,
    stop: &AtomicBool,
) -> Result<bool> {
    let interrupted = follow(followed, frames, &mut rows, smooth, stop)?;
    if smooth {
        let options = followed.session.flight().tracker().options();
        let inputs = followed.session.inputs();
        let lines = smoothed_lines(&followed.lines, &inputs, frames.epoch(), options)?;
        for (_, line) in &lines {
            rows.write(|rows| rows.write(line))?;
        }
        // The figures and the report are of the track that is written.
        let truth = followed.truth.as_ref();
        let scored = followed.lines.iter();
        followed.scored = scored
            .map(|frame| Scored::of_smoothed(frame, &lines, truth))
            .collect();
    }
    rows.finish(RowOutput::finish)?;
    Ok(interrupted)
}

/// Takes frame after frame until the last one or `stop`. Gives whether it was interrupted.
fn follow(
    followed: &mut Followed<'_>,
    frames: &mut dyn Frames,
    rows: &mut WhileRead<RowOutput<TrackLine>>,
    only_at_end: bool,
    stop: &AtomicBool,
) -> Result<bool> {
    let bar = match frames.count() {
        Some(count) => progress::bar(count as u64, "following", "frames"),
        None => progress::spinner("waiting for the first frame"),
    };
    let since = Instant::now();
    while let Some(frame) = frames.next(stop)? {
        followed.beside.live.wait_until(frame.time_s, stop);
        let tracked = bar.suspend(|| followed.frame(frame, &*frames))?;
        #[cfg(feature = "serve")]
        if let Some(file) = &mut followed.session_file {
            file.add(&tracked);
        }
        show(&bar, &tracked, followed.session.counts().frames, since);
        if !only_at_end {
            bar.suspend(|| rows.write(|rows| rows.write(&tracked.line)))?;
        }
        if followed.truth.is_some() || followed.keeps_lines {
            let truth = followed.truth.as_ref();
            let is_named = truth.is_some_and(|truth| truth.names(tracked.line.photo()));
            followed.named_in_truth += usize::from(is_named);
            followed.scored.push(Scored::of(&tracked, truth));
            followed.lines.push((tracked.time_s, tracked.line));
        }
    }
    bar.finish_and_clear();
    Ok(stop.load(Ordering::Relaxed))
}

/// The live line: state, position, radius, age of the last fix, frames per second.
fn show(bar: &ProgressBar, tracked: &Tracked, frames: usize, since: Instant) {
    let line = &tracked.line;
    let mut text = state_text(line.state).to_owned();
    if let (Some(lat_deg), Some(lon_deg), Some(radius_m)) =
        (line.lat_deg, line.lon_deg, line.radius95_m)
    {
        text += &format!(" {lat_deg:.6} {lon_deg:.6} ±{radius_m:.1} m");
    }
    if let Some(age_s) = line.age_of_last_fix_s {
        text += &format!(", last fix {age_s:.1} s ago");
    }
    let per_s = frames as f64 / since.elapsed().as_secs_f64().max(1e-3);
    bar.set_message(format!("{text}, {per_s:.1} frames/s"));
    bar.inc(1);
}

/// Tells what became of the frames.
fn summarise(followed: &Followed<'_>, frames: &dyn Frames, interrupted: bool) -> Exit {
    let counts = followed.session.counts();
    if frames.dropped() > 0 {
        tracing::warn!(
            "{} frames were dropped for newer ones, because frames came faster than they were processed",
            frames.dropped()
        );
    }
    if counts.unusable > 0 {
        tracing::warn!(
            "{} of {} frames could not be used",
            counts.unusable,
            counts.frames
        );
    }
    if counts.frames == 0 && !interrupted {
        tracing::warn!("no frame came that can be used");
    } else if counts.usable == 0 && counts.frames > 0 {
        tracing::warn!(
            "the track has no position: {} of {} frames have a fix; `frame` and `reason` of --format jsonl or csv say more",
            counts.fixes,
            counts.frames
        );
    }
    let refused = followed.session.flight().tracker().counts();
    tracing::info!(
        "{} frames, {} with a position on the map, {} with a usable track; inputs: {refused:?}",
        counts.frames,
        counts.fixes,
        counts.usable
    );
    if let Some(text) = super::track_report::figures_text(&followed.scored) {
        // There is nobody left to tell if standard error is gone.
        let _ = writeln!(std::io::stderr(), "{text}");
    } else if let Some(truth) = &followed.truth
        && followed.named_in_truth == 0
        && counts.frames > 0
    {
        tracing::warn!("{}", truth.names_none_text(counts.frames));
    }
    let left_out = counts.unusable + frames.without_time();
    if interrupted {
        Exit::Interrupted
    } else if counts.usable == 0 || left_out > 0 {
        Exit::SomeWithoutFix
    } else {
        Exit::Done
    }
}
