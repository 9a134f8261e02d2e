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
    address::Address, clock::LinkClock, error::LinkError, event::LinkEvent, link::PointAt,
    nmea::nmea_sentences, reopened::Reopened,
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
    /// The path of a file: what does not look like an address.
    File(std::path::PathBuf),
}

/// Why a text says no target.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is neither an address for sentences nor a file; expected udpout:HOST:PORT, tcp:HOST:PORT, serial:PATH:BAUD, or the name \
     of a file, ./NAME if there is a colon in it"
)]
pub struct NmeaTargetError(pub String);

impl FromStr for NmeaTarget {
    type Err = NmeaTargetError;

    fn from_str(text: &str) -> Result<Self, NmeaTargetError> {
        match text.parse() {
            // A receiver of sentences says nothing, so it would never be known.
            Ok(Address::UdpIn { .. }) => Err(NmeaTargetError(text.to_owned())),
            Ok(address) => Ok(Self::Address(address)),
            Err(_) if looks_like_an_address(text) => Err(NmeaTargetError(text.to_owned())),
            Err(_) => Ok(Self::File(text.into())),
        }
    }
}

/// Whether a text begins with a scheme, as `udp:HOST`, or ends with a port or baud rate, as `HOST:5000`. A single letter is the drive
/// of a path.
fn looks_like_an_address(text: &str) -> bool {
    let (Some((scheme, _)), Some((_, number))) = (text.split_once(':'), text.rsplit_once(':'))
    else {
        return false;
    };
    let is_scheme = scheme.len() > 1 && scheme.bytes().all(|byte| byte.is_ascii_alphabetic());
    let is_number = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
    !text.starts_with('.') && (is_scheme || is_number)
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
                    // A wrong port shows before there is a position.
                    receiver.keep_open(&mut happened);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistyped_address_is_no_file() {
        for text in [
            "udpout:10.0.0.2:5000",
            "tcp:[::1]:10110",
            "serial:COM3:9600",
        ] {
            let target: NmeaTarget = text.parse().unwrap();
            assert_eq!(target, NmeaTarget::Address(text.parse().unwrap()));
        }
        for text in [
            "-",
            "flight.nmea",
            "out/2026-11-27T10:20:30Z.nmea",
            "C:\\flight.nmea",
            "./udp:5000",
            "/dev/ttyUSB0",
        ] {
            assert_eq!(text.parse(), Ok(NmeaTarget::File(text.into())));
        }
        for text in [
            "udp:127.0.0.1:5000",
            "udp:127.0.0.1",
            "tcp://10.0.0.2:10110",
            "tcp:10.0.0.2",
            "http://10.0.0.2/nmea",
            "10.0.0.2:5000",
            "/dev/ttyUSB0:9600",
            "udpin:0.0.0.0:5000",
        ] {
            let refused = text.parse::<NmeaTarget>().unwrap_err();
            assert!(refused.to_string().contains("udpout:HOST:PORT"), "{text}");
        }
    }
}
