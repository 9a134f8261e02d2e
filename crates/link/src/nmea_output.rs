//! NMEA sentences to a receiver, live.

use std::{
    str::FromStr,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, channel},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use crate::{
    address::{Address, AddressError},
    clock::LinkClock,
    error::LinkError,
    event::LinkEvent,
    link::PointAt,
    nmea::nmea_sentences,
    reopened::Reopened,
};

/// Sentences are sent at this rate, hertz. Autopilots want a receiver to report 5 times a second.
const RATE_HZ: f64 = 5.0;
/// Whether to stop is looked at this often.
const SLICE: Duration = Duration::from_millis(20);

/// Where sentences go.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum NmeaTarget {
    /// `udpout:HOST:PORT`, `tcp:HOST:PORT` or `serial:PATH:BAUD`.
    Address(Address),
    /// Anything else is the path of a file.
    File(std::path::PathBuf),
}

impl FromStr for NmeaTarget {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let kinds = ["udpin:", "udpout:", "tcp:", "serial:"];
        if !kinds.iter().any(|kind| text.starts_with(kind)) {
            return Ok(Self::File(text.into()));
        }
        match text.parse()? {
            // A receiver of sentences says nothing, so it would never be known.
            Address::UdpIn { .. } => Err(AddressError(text.to_owned())),
            address => Ok(Self::Address(address)),
        }
    }
}

/// Sends sentences to an address on a thread of its own until it is dropped.
#[derive(Debug)]
pub struct NmeaOutput {
    events: Receiver<LinkEvent>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl NmeaOutput {
    /// Starts sending. The address is opened again when it breaks. Positions are asked from `point_at` for the time of sending on
    /// `clock`, which counts from 1970; those with a 95 % radius above `max_radius95_m` are not sent.
    ///
    /// # Errors
    /// [`LinkError::Thread`] if no thread can be started.
    pub fn start(
        address: Address,
        max_radius95_m: f64,
        clock: LinkClock,
        point_at: PointAt,
    ) -> Result<Self, LinkError> {
        let (sender, events) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let what = address.to_string();
        let thread = thread::Builder::new()
            .name("nmea".to_owned())
            .spawn(move || {
                let mut receiver = Reopened::new(address);
                at_rate(&stopped, || {
                    let point = point_at(clock.now_s());
                    let text = point.and_then(|point| nmea_sentences(&point, max_radius95_m));
                    let mut happened = Vec::new();
                    if let Some(text) = text {
                        receiver.send(text.as_bytes(), &mut happened);
                    }
                    for event in happened {
                        // Whoever does not listen does not want to know.
                        let _ = sender.send(event);
                    }
                });
            })
            .map_err(|source| LinkError::Thread { what, source })?;
        Ok(Self {
            events,
            stop,
            thread: Some(thread),
        })
    }

    /// What happened since the last call.
    pub fn events(&self) -> impl Iterator<Item = LinkEvent> + '_ {
        self.events.try_iter()
    }
}

impl Drop for NmeaOutput {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic there has nothing left to break.
            let _ = thread.join();
        }
    }
}

/// Calls `each` at the rate until it is stopped.
fn at_rate(stop: &AtomicBool, mut each: impl FnMut()) {
    let period = Duration::from_secs_f64(1.0 / RATE_HZ);
    let mut next = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        let now = Instant::now();
        if now < next {
            thread::sleep((next - now).min(SLICE));
            continue;
        }
        // What was missed is not made up.
        next = (next + period).max(now);
        each();
    }
}
