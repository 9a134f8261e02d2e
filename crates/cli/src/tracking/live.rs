//! What runs beside a flight: the link to an autopilot, and sentences for a receiver.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use grimnet_answer::printable_text;
use grimnet_link::{Address, Link, LinkClock, LinkEvent, LinkOptions, NmeaOutput, PointAt};
use grimnet_track::{Input, Tracker};

use super::frame_time::Epoch;

/// Photos of a clock that differs by more from the system's are those of a flight that is played again, seconds.
const SAME_CLOCK_S: f64 = 60.0;
/// How often telemetry is taken from the link.
const PERIOD: Duration = Duration::from_millis(10);
/// Positions with a 95 % radius above this are not written as sentences, metres.
pub const MAX_NMEA_RADIUS95_M: f64 = 150.0;

/// Which of them run.
#[derive(Debug, Clone, Default)]
pub struct LiveOptions {
    /// The autopilot.
    pub mavlink: Option<LinkOptions>,
    /// The receiver of NMEA sentences.
    pub nmea: Option<Address>,
}

impl LiveOptions {
    fn is_empty(&self) -> bool {
        self.mavlink.is_none() && self.nmea.is_none()
    }
}

/// The filter as the links ask it: the one of the last frame, with the telemetry that came since.
type SharedTracker = Arc<Mutex<Option<Tracker>>>;

/// The links of a flight. They start with its first frame, whose time sets their clock, and end when this is dropped.
pub struct Live {
    options: LiveOptions,
    shared: SharedTracker,
    running: Option<Running>,
}

struct Running {
    telemetry: Receiver<Input>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    /// Links that have not started yet.
    pub fn new(options: LiveOptions) -> Self {
        Self {
            options,
            shared: SharedTracker::default(),
            running: None,
        }
    }

    /// Starts the links at the first frame.
    ///
    /// # Errors
    /// No thread can be started; sentences, which carry the time of day, without one.
    pub fn start(&mut self, first_frame_s: f64, epoch: Epoch) -> Result<()> {
        if self.running.is_some() || self.options.is_empty() {
            return Ok(());
        }
        if self.options.nmea.is_some() {
            check_time_of_day(epoch)?;
        }
        let clock = clock(first_frame_s, epoch);
        let shared = Arc::clone(&self.shared);
        let point_at: PointAt = Arc::new(move |time_s| {
            let tracker = shared.lock().unwrap_or_else(PoisonError::into_inner);
            tracker.as_ref()?.point_at(time_s)
        });
        let mavlink = match &self.options.mavlink {
            Some(options) => Some(Link::start(options.clone(), clock, Arc::clone(&point_at))?),
            None => None,
        };
        let nmea = match &self.options.nmea {
            Some(address) => Some(NmeaOutput::start(
                address.clone(),
                MAX_NMEA_RADIUS95_M,
                clock,
                point_at,
            )?),
            None => None,
        };
        let (sender, telemetry) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let shared = Arc::clone(&self.shared);
        let thread = thread::Builder::new()
            .name("telemetry".to_owned())
            .spawn(move || {
                // The last turn tells what the end of the flight brought.
                let mut is_last = false;
                while !is_last {
                    is_last = stopped.load(Ordering::Relaxed);
                    turn(mavlink.as_ref(), nmea.as_ref(), &shared, &sender);
                    thread::sleep(PERIOD);
                }
            })
            .context("cannot start a thread")?;
        self.running = Some(Running {
            telemetry,
            stop,
            thread: Some(thread),
        });
        Ok(())
    }

    /// Telemetry that came since the last call, in order of arrival.
    pub fn telemetry(&self) -> Vec<Input> {
        self.running
            .as_ref()
            .map_or(Vec::new(), |running| running.telemetry.try_iter().collect())
    }

    /// Makes `tracker` the one that the links ask.
    pub fn publish(&self, tracker: &Tracker) {
        if self.running.is_some() {
            *self.shared.lock().unwrap_or_else(PoisonError::into_inner) = Some(tracker.clone());
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if let Some(running) = &mut self.running {
            running.stop.store(true, Ordering::Relaxed);
            if let Some(thread) = running.thread.take() {
                // A panic there has nothing left to break.
                let _ = thread.join();
            }
        }
    }
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

/// Seconds on the clock of the frames: the system's, or for a flight that is played again one that begins with its first frame.
fn clock(first_frame_s: f64, epoch: Epoch) -> LinkClock {
    let system = LinkClock::unix();
    if epoch == Epoch::Unix && (system.now_s() - first_frame_s).abs() <= SAME_CLOCK_S {
        system
    } else {
        LinkClock::from_time_s(first_frame_s)
    }
}

/// Takes telemetry and events from the links.
fn turn(
    mavlink: Option<&Link>,
    nmea: Option<&NmeaOutput>,
    shared: &SharedTracker,
    sender: &Sender<Input>,
) {
    if let Some(link) = mavlink {
        for input in link.inputs() {
            let mut tracker = shared.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(tracker) = tracker.as_mut() {
                // What the filter refuses is told by the session, which gets the same.
                let _ = tracker.push(input);
            }
            // Nobody listens at the end of the flight.
            let _ = sender.send(input);
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
    // Nothing can be told where standard error is closed.
    let _ = writeln!(std::io::stderr(), "{text}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_is_the_systems_or_begins_with_a_flight_that_is_played_again() {
        let now_s = LinkClock::unix().now_s();
        assert!((clock(now_s - 5.0, Epoch::Unix).now_s() - now_s).abs() < 2.0);
        assert!((clock(1000.0, Epoch::Unix).now_s() - 1000.0).abs() < 2.0);
        assert!((clock(7.0, Epoch::Start).now_s() - 7.0).abs() < 2.0);
    }

    #[test]
    fn sentences_without_the_time_of_day_are_refused() {
        let mut live = Live::new(LiveOptions {
            mavlink: None,
            nmea: Some("udpout:127.0.0.1:9".parse().unwrap()),
        });
        let error = live.start(0.0, Epoch::Start).unwrap_err();
        assert!(error.to_string().contains("time of day"), "{error}");
    }
}
