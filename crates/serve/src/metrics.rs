//! Figures for Prometheus, in its text format 0.0.4 (<https://prometheus.io/docs/instrumenting/exposition_formats/>).

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::admission::Admission;

/// Upper bounds of the histogram's buckets, seconds.
const BUCKETS_S: [f64; 12] = [
    0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0,
];

/// Counts of one service.
#[derive(Debug, Default)]
pub(crate) struct Metrics {
    counts: Mutex<Counts>,
    pub(crate) connections: AtomicU64,
    /// Requests whose client left before the answer.
    pub(crate) left: AtomicU64,
}

#[derive(Debug, Default)]
struct Counts {
    /// By method, route and status. Routes are those of the router, so there are few.
    requests: BTreeMap<(String, String, u16), u64>,
    /// By map and `fix` or `no_fix`.
    answers: BTreeMap<(String, &'static str), u64>,
    localisation: Histogram,
}

#[derive(Debug, Default)]
struct Histogram {
    buckets: [u64; BUCKETS_S.len()],
    count: u64,
    sum_s: f64,
}

impl Histogram {
    fn add(&mut self, seconds: f64) {
        for (bucket, bound) in self.buckets.iter_mut().zip(BUCKETS_S) {
            *bucket += u64::from(seconds <= bound);
        }
        self.count += 1;
        self.sum_s += seconds;
    }

    /// Writes the buckets, the sum and the count of the histogram `name`.
    fn lines(&self, out: &mut String, name: &str) {
        let bucket = format!("{name}_bucket");
        for (count, bound) in self.buckets.iter().zip(BUCKETS_S) {
            line(out, &bucket, &format!("le=\"{bound}\""), count);
        }
        line(out, &bucket, "le=\"+Inf\"", self.count);
        line(out, &format!("{name}_sum"), "", self.sum_s);
        line(out, &format!("{name}_count"), "", self.count);
    }
}

impl Metrics {
    fn counts(&self) -> MutexGuard<'_, Counts> {
        // Counts are right after every addition.
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A request was answered.
    pub(crate) fn request(&self, method: &str, route: &str, status: u16) {
        *self
            .counts()
            .requests
            .entry((method.to_owned(), route.to_owned(), status))
            .or_default() += 1;
    }

    /// A photo was localised, or not.
    pub(crate) fn answer(&self, map: &str, is_fix: bool, took: Duration) {
        let mut counts = self.counts();
        let state = if is_fix { "fix" } else { "no_fix" };
        *counts.answers.entry((map.to_owned(), state)).or_default() += 1;
        counts.localisation.add(took.as_secs_f64());
    }

    /// The text that Prometheus reads.
    pub(crate) fn text(&self, localisations: &Admission, conversions: &Admission) -> String {
        let counts = self.counts();
        let mut out = String::new();
        family(
            &mut out,
            "grimnet_requests_total",
            "counter",
            "Requests answered.",
        );
        for ((method, route, status), count) in &counts.requests {
            let labels = format!("method=\"{method}\",route=\"{route}\",status=\"{status}\"");
            line(&mut out, "grimnet_requests_total", &labels, count);
        }
        let name = "grimnet_requests_left_total";
        let help = "Requests whose client left before the answer.";
        family(&mut out, name, "counter", help);
        line(&mut out, name, "", self.left.load(Ordering::Relaxed));
        family(
            &mut out,
            "grimnet_localisations_total",
            "counter",
            "Photos that were localised (fix) or not (no_fix).",
        );
        for ((map, state), count) in &counts.answers {
            let labels = format!("map=\"{map}\",state=\"{state}\"");
            line(&mut out, "grimnet_localisations_total", &labels, count);
        }
        let name = "grimnet_localisation_seconds";
        let help = "Time to decode and localise a photo.";
        family(&mut out, name, "histogram", help);
        counts.localisation.lines(&mut out, name);
        for (name, help, value) in self.gauges(localisations, conversions) {
            family(&mut out, name, "gauge", help);
            line(&mut out, name, "", value);
        }
        out
    }

    /// Name, help and value of what goes up and down.
    fn gauges(
        &self,
        localisations: &Admission,
        conversions: &Admission,
    ) -> [(&'static str, &'static str, u64); 7] {
        [
            (
                "grimnet_localisations_running",
                "Localisations that run now.",
                localisations.running() as u64,
            ),
            (
                "grimnet_localisations_waiting",
                "Requests whose photo arrives or waits for a localisation.",
                localisations.waiting() as u64,
            ),
            (
                "grimnet_localisations_body_bytes",
                "Bytes of the bodies of these requests.",
                localisations.body_bytes() as u64,
            ),
            (
                "grimnet_conversions_running",
                "Lists of answers that are written in another format now.",
                conversions.running() as u64,
            ),
            (
                "grimnet_conversions_waiting",
                "Requests whose answers arrive or wait to be written in another format.",
                conversions.waiting() as u64,
            ),
            (
                "grimnet_conversions_body_bytes",
                "Bytes of the bodies of these requests.",
                conversions.body_bytes() as u64,
            ),
            (
                "grimnet_connections",
                "Open connections.",
                self.connections.load(Ordering::Relaxed),
            ),
        ]
    }
}

fn family(out: &mut String, name: &str, kind: &str, help: &str) {
    // Writing to a string does not fail.
    let _ = writeln!(out, "# HELP {name} {help}\n# TYPE {name} {kind}");
}

fn line(out: &mut String, name: &str, labels: &str, value: impl std::fmt::Display) {
    let _ = if labels.is_empty() {
        writeln!(out, "{name} {value}")
    } else {
        writeln!(out, "{name}{{{labels}}} {value}")
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::admission::Work;
    use crate::limits::Limits;

    #[test]
    fn buckets_are_cumulative() {
        let metrics = Metrics::default();
        for ms in [5, 60, 60, 200_000] {
            metrics.answer("town", ms < 100, Duration::from_millis(ms));
        }
        metrics.request("POST", "/v1/locate", 200);
        let [localisations, conversions] = [Work::Localisation, Work::Conversion]
            .map(|work| Admission::new(work, &Limits::default(), 1));
        let text = metrics.text(&localisations, &conversions);
        for expected in [
            "grimnet_localisation_seconds_bucket{le=\"0.01\"} 1\n",
            "grimnet_localisation_seconds_bucket{le=\"0.1\"} 3\n",
            "grimnet_localisation_seconds_bucket{le=\"60\"} 3\n",
            "grimnet_localisation_seconds_bucket{le=\"+Inf\"} 4\n",
            "grimnet_localisation_seconds_count 4\n",
            "grimnet_localisations_total{map=\"town\",state=\"fix\"} 3\n",
            "grimnet_localisations_total{map=\"town\",state=\"no_fix\"} 1\n",
            "grimnet_requests_total{method=\"POST\",route=\"/v1/locate\",status=\"200\"} 1\n",
            "grimnet_localisations_running 0\n",
            "grimnet_conversions_waiting 0\n",
        ] {
            assert!(text.contains(expected), "{expected}in\n{text}");
        }
    }
}
