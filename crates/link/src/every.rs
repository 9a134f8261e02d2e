//! What is done at a rate.

/// Says when it is time again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Every {
    period_s: f64,
    next_s: Option<f64>,
}

impl Every {
    /// At once, and every `period_s` seconds after.
    pub fn seconds(period_s: f64) -> Self {
        Self {
            period_s,
            next_s: None,
        }
    }

    /// Changes the period, beginning with the time that is awaited.
    pub fn set_seconds(&mut self, period_s: f64) {
        if let Some(next_s) = &mut self.next_s {
            *next_s += period_s - self.period_s;
        }
        self.period_s = period_s;
    }

    /// Whether it is time. The rate is kept over small delays; what was missed is not made up.
    pub fn is_due(&mut self, now_s: f64) -> bool {
        match self.next_s {
            Some(next_s) if now_s < next_s => false,
            Some(next_s) if now_s < next_s + self.period_s => {
                self.next_s = Some(next_s + self.period_s);
                true
            }
            _ => {
                self.next_s = Some(now_s + self.period_s);
                true
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_kept_over_delays() {
        let mut every = Every::seconds(0.1);
        let times = (0..1000).map(|step| f64::from(step) * 0.013);
        let due = times.filter(|time_s| every.is_due(*time_s)).count();
        assert_eq!(due, 130);
        // After a long pause, once.
        assert!(every.is_due(100.0));
        assert!(!every.is_due(100.05));
        assert!(every.is_due(100.1));
    }
}
