//! What one client, and all clients together, may take.

use std::time::Duration;

use grimnet_photo::PhotoLimits;

/// Limits of the service. The defaults suit photos of drones and a machine on the same network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Largest request body, bytes.
    pub max_body_bytes: usize,
    /// Limits on one photo.
    pub photo: PhotoLimits,
    /// Localisations that run at the same time, and so many conversions of answers.
    pub at_once: usize,
    /// Requests that may wait for a localisation, and for a conversion of answers; more are refused with status 503. One whose body
    /// arrives does not wait yet. All bodies together may have the size of the largest for each request that runs or may wait.
    pub queue: usize,
    /// Longest time of one localisation or conversion from when its body is there, waiting included.
    pub locate_time: Duration,
    /// Longest time for a request body to arrive.
    pub body_time: Duration,
    /// Longest pause while a body arrives.
    pub body_pause: Duration,
    /// Longest time for the head of a request to arrive, and longest time that a connection may be idle.
    pub head_time: Duration,
    /// Longest time that a client may take no byte of an answer.
    pub write_pause: Duration,
    /// Connections at the same time; more wait until one is closed.
    pub connections: usize,
    /// Clients that may follow tracks at the same time; each takes a connection.
    pub listeners: usize,
}

impl Limits {
    /// Time for open requests to end when the service is stopped: as long as one that has just begun may take.
    #[must_use]
    pub fn end_time(&self) -> Duration {
        self.body_time.saturating_add(self.locate_time)
    }
}

impl Default for Limits {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            max_body_bytes: 64 << 20,
            // The largest sensors of survey cameras have 150 million pixels, of small drones 50 million.
            photo: PhotoLimits::of_memory(512 << 20),
            at_once: cores,
            queue: 8,
            locate_time: Duration::from_secs(60),
            body_time: Duration::from_secs(60),
            body_pause: Duration::from_secs(10),
            head_time: Duration::from_secs(15),
            write_pause: Duration::from_secs(30),
            connections: 256,
            listeners: 64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn security_md_states_the_defaults() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../SECURITY.md");
        let page = std::fs::read_to_string(path).unwrap();
        let limits = Limits::default();
        let seconds = |time: Duration| format!("{} s", time.as_secs());
        let rows = [
            format!(
                "| request, memory of a photo | {} MiB, {} MiB |",
                limits.max_body_bytes >> 20,
                limits.photo.max_memory_bytes >> 20
            ),
            format!(
                "| localisations at once, waiting requests, connections | one for each core, {}, {} |",
                limits.queue, limits.connections
            ),
            format!(
                "| head, pause in a body, whole body, localisation with its wait | {} |",
                [
                    limits.head_time,
                    limits.body_pause,
                    limits.body_time,
                    limits.locate_time
                ]
                .map(seconds)
                .join(", ")
            ),
            format!(
                "| open requests when the service is stopped | {} |",
                seconds(limits.end_time())
            ),
            format!(
                "| clients that follow tracks, pause in which a client takes no byte of an answer | {}, {} |",
                limits.listeners,
                seconds(limits.write_pause)
            ),
        ];
        for row in rows {
            assert!(page.contains(&row), "SECURITY.md should hold:\n{row}");
        }
    }
}
