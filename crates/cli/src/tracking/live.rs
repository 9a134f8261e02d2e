//! What runs beside a flight: the link to an autopilot, and sentences for a receiver.

use std::collections::VecDeque;
use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use grimnet_answer::printable_text;
use grimnet_flight::{Flight, LeftOut};
use grimnet_link::{
    Address, Link, LinkClock, LinkEvent, LinkOptions, MAX_RADIUS95_M, NmeaOutput, PointAt,
};
use grimnet_track::{Input, TrackPoint, TrackState, Tracker};

use super::frame_clock::{FrameClock, Now};
use super::frame_time::Epoch;
use super::pace::Pace;

/// How often telemetry is taken from the link.
const PERIOD: Duration = Duration::from_millis(10);
/// Telemetry older than this is forgotten while no frame has come, seconds: it says nothing of the first one, and a wait on the ground
/// may be long.
const KEPT_BEFORE_FRAMES_S: f64 = 5.0;

/// Which of them run.
#[derive(Debug, Clone, Default)]
pub struct LiveOptions {
    /// The autopilot.
    pub mavlink: Option<LinkOptions>,
    /// The receiver of NMEA sentences.
    pub nmea: Option<Address>,
    /// How old frames of a clock of their own are when they come, seconds. `None` if nobody said that they have one.
    pub frame_latency_s: Option<f64>,
}

impl LiveOptions {
    fn is_empty(&self) -> bool {
        self.mavlink.is_none() && self.nmea.is_none()
    }
}

/// What the links ask, and what they gave.
#[derive(Debug, Default)]
struct Published {
    /// The filter of the last frame, with the telemetry that came since. `None` while there is no position.
    tracker: Option<Tracker>,
    /// The telemetry that the flight goes without.
    left_out: LeftOut,
    /// For how long after its exposure the fix of the last frame is a recent one, seconds.
    fix_is_recent_for_s: f64,
    /// The frames' clock, which is the filter's, is so far ahead of the links', seconds. `None` before the first frame.
    ahead_s: Option<f64>,
    /// Telemetry that the flight did not take in yet, at times of the links' clock, in order of arrival.
    telemetry: VecDeque<Input>,
}

type Shared = Arc<Mutex<Published>>;

/// The links of a flight. They are open until this is dropped: before the first frame, so that a wrong cable shows on the ground, and
/// so that attitude and height are known when it comes.
pub struct Live {
    /// Whether sentences are sent, which carry the time of day.
    has_nmea: bool,
    /// Whether the frames come while the aircraft flies.
    is_live: bool,
    frame_clock: FrameClock,
    pace: Pace,
    warned_of_coarse: bool,
    shared: Shared,
    running: Option<Running>,
}

struct Running {
    clock: LinkClock,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    /// Starts the links, for frames that come while the aircraft flies or of a flight that is over.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn start(options: &LiveOptions, is_live: bool) -> Result<Self> {
        let shared = Shared::default();
        let running = if options.is_empty() {
            None
        } else {
            Some(Running::start(options, &shared)?)
        };
        Ok(Self {
            has_nmea: options.nmea.is_some(),
            is_live,
            frame_clock: FrameClock::new(is_live, options.frame_latency_s),
            pace: Pace::default(),
            warned_of_coarse: false,
            shared,
            running,
        })
    }

    /// For a flight that is over: waits until the links' clock reaches the time of a frame, or until `stop`. The first frame sets
    /// that clock.
    pub fn wait_until(&self, frame_s: f64, stop: &AtomicBool) {
        let running = self.running.as_ref().filter(|_| !self.is_live);
        let (Some(running), Some(ahead_s)) = (running, self.frame_clock.ahead_s()) else {
            return;
        };
        loop {
            let early_s = frame_s - (running.clock.now_s() + ahead_s);
            if early_s <= 0.0 || stop.load(Ordering::Relaxed) {
                return;
            }
            thread::sleep(PERIOD.min(Duration::try_from_secs_f64(early_s).unwrap_or(PERIOD)));
        }
    }

    /// Says that a frame is taken in. `newest_s` is the time of the newest frame that waits,
    /// `is_coarse` whether the frames' times are known to a second only. While the clocks do not agree, there is no position.
    ///
    /// # Errors
    /// Sentences, which carry the time of day, without one.
    pub fn frame(
        &mut self,
        frame_s: f64,
        epoch: Epoch,
        newest_s: Option<f64>,
        is_coarse: bool,
    ) -> Result<()> {
        let Some(running) = &self.running else {
            return Ok(());
        };
        if self.has_nmea {
            check_time_of_day(epoch)?;
        }
        let now = Now {
            link_s: running.clock.now_s(),
            system_s: LinkClock::unix().now_s(),
        };
        if let Some(text) = self.frame_clock.frame(frame_s, epoch, newest_s, now) {
            tracing::warn!("{text}");
        }
        if is_coarse && self.is_live && !std::mem::replace(&mut self.warned_of_coarse, true) {
            tracing::warn!(
                "the photos' times have no fraction of a second, so that positions are up to a second of flight off, which the \
                 stated radius does not contain: write EXIF SubSecTimeOriginal, or names with milliseconds (docs/flight.md)"
            );
        }
        self.pace.frame(frame_s);
        let mut published = lock(&self.shared);
        published.ahead_s = self.frame_clock.ahead_s();
        if !self.frame_clock.agrees() {
            published.tracker = None;
        }
        Ok(())
    }

    /// Telemetry that came since the last call, in order of arrival, at the times of the frames' clock.
    pub fn telemetry(&self) -> Vec<Input> {
        lock(&self.shared).take_telemetry()
    }

    /// Makes the track of `flight` the one that the links ask, if the clocks agree.
    pub fn publish(&self, flight: &Flight) {
        self.publish_track(flight.tracker(), flight.left_out_now());
    }

    fn publish_track(&self, tracker: &Tracker, left_out: LeftOut) {
        let Some(running) = self.running.as_ref().filter(|_| self.frame_clock.agrees()) else {
            return;
        };
        let now_s = running.clock.now_s() + self.frame_clock.ahead_s().unwrap_or(0.0);
        let least_s = tracker.options().coasting_after_s;
        let has_fix = |frame_s: &f64| {
            let estimate = tracker.point_at(*frame_s).and_then(|point| point.estimate);
            estimate.is_some_and(|estimate| estimate.is_at_fix())
        };
        let last_s = self.pace.last_s().filter(has_fix);
        let fix_is_recent_for_s = last_s.map_or(least_s, |last_s| {
            self.pace.fix_is_recent_for_s(now_s - last_s, least_s)
        });
        let mut published = lock(&self.shared);
        published.tracker = Some(tracker.clone());
        published.left_out = left_out;
        published.fix_is_recent_for_s = fix_is_recent_for_s;
    }
}

impl Running {
    fn start(options: &LiveOptions, shared: &Shared) -> Result<Self> {
        let clock = LinkClock::unix();
        let asked = Arc::clone(shared);
        let point_at: PointAt = Arc::new(move |time_s| {
            let published = lock(&asked);
            published.point_at(time_s + published.ahead_s?)
        });
        let mavlink = match &options.mavlink {
            Some(options) => Some(Link::start(options.clone(), clock, Arc::clone(&point_at))?),
            None => None,
        };
        let nmea = match &options.nmea {
            Some(address) => Some(NmeaOutput::start(
                address.clone(),
                MAX_RADIUS95_M,
                clock,
                point_at,
            )?),
            None => None,
        };
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let shared = Arc::clone(shared);
        let thread = thread::Builder::new()
            .name("telemetry".to_owned())
            .spawn(move || {
                // The last turn tells what the end of the flight brought.
                let mut is_last = false;
                while !is_last {
                    is_last = stopped.load(Ordering::Relaxed);
                    turn(mavlink.as_ref(), nmea.as_ref(), &shared);
                    thread::sleep(PERIOD);
                }
            })
            .context("cannot start a thread")?;
        Ok(Self {
            clock,
            stop,
            thread: Some(thread),
        })
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic there has nothing left to break.
            let _ = thread.join();
        }
    }
}

fn lock(shared: &Shared) -> MutexGuard<'_, Published> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Checks that frames have the time of day, which NMEA sentences carry.
///
/// # Errors
/// They have none.
pub fn check_time_of_day(epoch: Epoch) -> Result<()> {
    if epoch != Epoch::Unix {
        bail!(
            "NMEA sentences need the time of day, and these frames have none: name the photos by date and time, or use \
             their EXIF data"
        );
    }
    Ok(())
}

impl Published {
    /// The track at a time of the frames' clock. Between two frames that come seldom, or late, it does not coast: the filter counts
    /// from the exposure of the last one with a fix, and knows nothing of when the next one can be there.
    fn point_at(&self, frame_s: f64) -> Option<TrackPoint> {
        let mut point = self.tracker.as_ref()?.point_at(frame_s)?;
        let age_s = point
            .estimate
            .and_then(|estimate| estimate.age_of_last_fix_s);
        let is_recent = age_s.is_some_and(|age_s| age_s <= self.fix_is_recent_for_s);
        if point.state == TrackState::Coasting && is_recent {
            point.state = TrackState::Tracking;
        }
        Some(point)
    }

    /// Takes in telemetry that came between two frames: keeps it for the flight, and moves the track that the links ask, unless the
    /// flight goes without it.
    fn take(&mut self, input: Input) {
        self.telemetry.push_back(input);
        let Some(ahead_s) = self.ahead_s else {
            let is_old = |kept: &Input| kept.time_s() < input.time_s() - KEPT_BEFORE_FRAMES_S;
            while self.telemetry.front().is_some_and(is_old) {
                self.telemetry.pop_front();
            }
            return;
        };
        let input = input.moved_in_time(ahead_s);
        let is_left_out = self.left_out.contains(&input);
        if let Some(tracker) = self.tracker.as_mut().filter(|_| !is_left_out) {
            // What the filter refuses is reported by the session, which gets the same.
            let _ = tracker.push(input);
        }
    }

    /// The telemetry that the flight did not take in yet, at times of the frames' clock. None before the first frame.
    fn take_telemetry(&mut self) -> Vec<Input> {
        let Some(ahead_s) = self.ahead_s else {
            return Vec::new();
        };
        let taken = self.telemetry.drain(..);
        taken.map(|input| input.moved_in_time(ahead_s)).collect()
    }
}

/// Takes telemetry and events from the links.
fn turn(mavlink: Option<&Link>, nmea: Option<&NmeaOutput>, shared: &Shared) {
    if let Some(link) = mavlink {
        for input in link.inputs() {
            lock(shared).take(input);
        }
        link.events().for_each(|event| tell(&event));
    }
    if let Some(nmea) = nmea {
        nmea.events().for_each(|event| tell(&event));
    }
}

/// One line on standard error for each event.
fn tell(event: &LinkEvent) {
    let text = event.to_string();
    let text = printable_text(&text);
    // Nothing can be said where standard error is closed.
    let _ = writeln!(std::io::stderr(), "{text}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_track::{TrackOptions, Velocity};

    use super::super::truth::tests::hovering;

    fn sentences(is_live: bool) -> Live {
        let options = LiveOptions {
            nmea: Some("udpout:127.0.0.1:9".parse().unwrap()),
            ..LiveOptions::default()
        };
        Live::start(&options, is_live).unwrap()
    }

    fn tracker() -> Tracker {
        Tracker::new(TrackOptions::default()).unwrap()
    }

    fn velocity(time_s: f64) -> Input {
        Input::Velocity(Velocity {
            time_s,
            east_m_s: 12.0,
            north_m_s: 0.0,
            sigma_m_s: 0.5,
        })
    }

    fn times_s(inputs: Vec<Input>) -> Vec<f64> {
        inputs.iter().map(Input::time_s).collect()
    }

    fn has_tracker(live: &Live) -> bool {
        live.shared.lock().unwrap().tracker.is_some()
    }

    #[test]
    fn the_links_are_given_no_position_while_the_clocks_differ() {
        let mut live = sentences(true);
        for (ahead_s, expected) in [(-0.2, true), (-0.2, true), (5.0, false)] {
            let frame_s = LinkClock::unix().now_s() + ahead_s;
            live.frame(frame_s, Epoch::Unix, None, false).unwrap();
            live.publish_track(&tracker(), LeftOut::default());
            assert_eq!(has_tracker(&live), expected, "{ahead_s}");
        }
    }

    /// What the fixes contradict does not move the positions between two frames either.
    #[test]
    fn telemetry_that_the_flight_goes_without_is_not_in_the_published_track() {
        let velocity = velocity(1.0);
        let mut published = Published {
            tracker: Some(tracker()),
            ahead_s: Some(2.0),
            ..Published::default()
        };
        let before = published.tracker.clone();
        published.left_out.velocity = true;
        published.take(velocity);
        assert_eq!(times_s(published.take_telemetry()), [3.0]);
        let of = |tracker: &Option<Tracker>| format!("{tracker:?}");
        assert_eq!(of(&published.tracker), of(&before));
        published.left_out = LeftOut::default();
        published.take(velocity);
        assert_ne!(of(&published.tracker), of(&before));
    }

    /// One photo in four seconds: the track coasts only where one of them gave no fix.
    #[test]
    fn the_links_are_given_a_track_that_does_not_coast_between_two_photos() {
        let mut pace = Pace::default();
        let times_s = [0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0];
        times_s.iter().for_each(|time_s| pace.frame(*time_s));
        let mut published = Published {
            tracker: Some(hovering(times_s)),
            ..Published::default()
        };
        let state = |published: &Published, after_s: f64| {
            let point = published.point_at(28.0 + after_s).unwrap();
            point.state
        };
        assert_eq!(state(&published, 4.5), TrackState::Coasting);
        published.fix_is_recent_for_s = pace.fix_is_recent_for_s(0.5, 2.0);
        assert_eq!(state(&published, 4.5), TrackState::Tracking);
        assert_eq!(state(&published, 8.5), TrackState::Coasting);
    }

    #[test]
    fn a_frame_without_a_fix_ends_the_time_for_which_the_last_one_is_recent() {
        let mut live = sentences(true);
        let now_s = LinkClock::unix().now_s();
        let mut times_s = Vec::new();
        for number in 0..8 {
            let frame_s = now_s + 4.0 * f64::from(number - 7);
            live.pace.frame(frame_s);
            times_s.push(frame_s);
        }
        let recent_for_s = |live: &Live| {
            live.publish_track(&hovering(times_s.iter().copied()), LeftOut::default());
            live.shared.lock().unwrap().fix_is_recent_for_s
        };
        assert!(recent_for_s(&live) >= 6.0);
        live.pace.frame(now_s + 0.1);
        assert_eq!(recent_for_s(&live), 2.0);
    }

    /// The first frame gets its attitude and height, and nothing grows while the aircraft waits on the ground.
    #[test]
    fn telemetry_before_the_first_frame_waits_for_its_clock() {
        let mut published = Published::default();
        for time_s in [0.0, 94.0, 96.0, 100.0] {
            published.take(velocity(time_s));
        }
        assert!(published.take_telemetry().is_empty());
        published.ahead_s = Some(-90.0);
        assert_eq!(times_s(published.take_telemetry()), [6.0, 10.0]);
        assert!(published.take_telemetry().is_empty());
    }

    #[test]
    fn a_flight_that_is_over_is_played_at_its_own_speed() {
        let mut live = sentences(false);
        let go_on = AtomicBool::new(false);
        live.wait_until(1000.0, &go_on);
        live.frame(1000.0, Epoch::Unix, None, false).unwrap();
        let clock = live.running.as_ref().unwrap().clock;
        let began_s = clock.now_s();
        live.wait_until(1000.3, &go_on);
        let waited_s = clock.now_s() - began_s;
        assert!(waited_s > 0.2, "{waited_s}");
        assert!(clock.now_s() + live.frame_clock.ahead_s().unwrap() >= 1000.3);
        // Ctrl-C ends the waiting.
        live.wait_until(9e9, &AtomicBool::new(true));
        // Frames that come during the flight are not waited for.
        let mut live = sentences(true);
        let frame_s = LinkClock::unix().now_s();
        live.frame(frame_s, Epoch::Unix, None, false).unwrap();
        live.wait_until(9e9, &go_on);
    }

    #[test]
    fn sentences_without_the_time_of_day_are_refused() {
        let mut live = sentences(true);
        let error = live.frame(0.0, Epoch::Start, None, false).unwrap_err();
        assert!(error.to_string().contains("time of day"), "{error}");
    }
}
