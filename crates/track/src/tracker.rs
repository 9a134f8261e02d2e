//! The filter as a user sees it: inputs in any order, the track at any time.

use crate::{
    clock_watch::{ClockWatch, Verdict},
    error::{InputError, OptionsError},
    filter::Filter,
    input::Input,
    lag::{Lag, Taken},
    options::TrackOptions,
    point::TrackPoint,
    window::Search,
};

/// How many inputs were taken, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct InputCounts {
    /// Taken as the newest.
    pub in_order: u64,
    /// Taken late.
    pub late: u64,
    /// Ignored as duplicates.
    pub duplicates: u64,
    /// Refused as invalid.
    pub invalid: u64,
    /// Refused as older than the lag.
    pub too_late: u64,
    /// Refused because the clock jumped.
    pub clock_jumps: u64,
    /// Restarts, because a clock was set or inputs turned out to be wrong.
    pub restarts: u64,
}

/// Follows one aircraft.
///
/// # Example
/// ```
/// use grimnet_geo::LonLat;
/// use grimnet_track::{Input, PositionFix, TrackOptions, TrackState, Tracker};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let mut tracker = Tracker::new(TrackOptions::default())?;
/// for frame in 0..8 {
///     tracker.push(Input::Fix(PositionFix {
///         time_s: f64::from(frame) * 0.5,
///         // 5 m/s to the north.
///         lonlat: LonLat::new(120.7, 24.2 + f64::from(frame) * 2.5 / 110_800.0),
///         covariance_en_m2: [1.0, 0.0, 1.0],
///         map_error_m: 1.0,
///         heading_deg: Some(0.0),
///         gsd_m: 0.05,
///         confidence: 0.99,
///     }))?;
/// }
/// let point = tracker.point_at(4.0).ok_or("before the first input")?;
/// assert_eq!(point.state, TrackState::Tracking);
/// let estimate = point.estimate.ok_or("no position")?;
/// assert!((estimate.velocity_north_m_s - 5.0).abs() < 1.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Tracker {
    options: TrackOptions,
    lag: Lag,
    counts: InputCounts,
    clocks: ClockWatch,
    clock_step_s: Option<f64>,
    /// Whether a fix was taken in.
    has_fix: bool,
}

impl Tracker {
    /// A tracker before any input.
    ///
    /// # Errors
    /// [`OptionsError`] if an option is not finite or out of range.
    pub fn new(options: TrackOptions) -> Result<Self, OptionsError> {
        options.validate()?;
        Ok(Self {
            options,
            lag: Lag::new(),
            counts: InputCounts::default(),
            clocks: ClockWatch::default(),
            clock_step_s: None,
            has_fix: false,
        })
    }

    /// The options.
    pub fn options(&self) -> &TrackOptions {
        &self.options
    }

    /// Sets [`TrackOptions::focal_length_px`], which the first photo may tell only after telemetry was taken in. It has no effect
    /// on what was taken in so far. `false`, and nothing changes, after the first fix or if the value is not finite and above 0.
    pub fn set_focal_length_px(&mut self, focal_length_px: f64) -> bool {
        let possible = focal_length_px.is_finite() && focal_length_px > 0.0;
        if possible && !self.has_fix {
            self.options.focal_length_px = Some(focal_length_px);
        }
        possible && !self.has_fix
    }

    /// Whether [`TrackOptions::start`] waits for the first frame: its uncertainty grows from the first fix, miss or motion on.
    pub fn awaits_start(&self) -> bool {
        self.options.start.is_some() && !self.head().has_begun
    }

    /// How many inputs were taken, and how.
    pub fn counts(&self) -> InputCounts {
        self.counts
    }

    /// Time of the newest input, seconds.
    pub fn newest_s(&self) -> Option<f64> {
        self.lag.newest_s()
    }

    /// Takes in an input. It may be up to [`TrackOptions::lag_s`] older than the newest one: the state is then, bit for bit,
    /// as if all had come in order.
    ///
    /// Single inputs of an impossible time are refused. Where several in a row agree that the camera's clock was set, or that of the
    /// telemetry while no frames come, the filter starts again with them ([`Taken::Restarted`], [`Tracker::clock_step_s`]).
    /// Telemetry is then refused for as long as it is not of the camera's new time.
    ///
    /// # Errors
    /// [`InputError`] if the input is invalid, too late, or far away in time. The state is then as before.
    pub fn push(&mut self, input: Input) -> Result<Taken, InputError> {
        if let Err(error) = input.validate() {
            self.counts.invalid += 1;
            return Err(error);
        }
        match self
            .clocks
            .check(&input, self.lag.newest_s(), &self.options)
        {
            Verdict::Take => {}
            Verdict::Refuse(error) => {
                match error {
                    InputError::TooLate { .. } => self.counts.too_late += 1,
                    _ => self.counts.clock_jumps += 1,
                }
                return Err(error);
            }
            Verdict::StartAgain { by_s, inputs } => {
                self.clock_step_s = Some(by_s);
                self.lag = self.lag.restarted();
                self.counts.restarts += 1;
                for input in inputs {
                    self.take(input);
                }
                return Ok(Taken::Restarted);
            }
        }
        let taken = self.take(input);
        match taken {
            Taken::Duplicate => self.counts.duplicates += 1,
            Taken::Late => self.counts.late += 1,
            Taken::InOrder | Taken::Restarted => self.counts.in_order += 1,
        }
        Ok(taken)
    }

    fn take(&mut self, input: Input) -> Taken {
        self.has_fix |= matches!(input, Input::Fix(_));
        self.lag.push(input, &self.options)
    }

    /// Forgets all inputs: what they said turned out to be wrong. The aircraft may have flown on since the first frame, so that after one
    /// [`TrackOptions::start`] is forgotten as well.
    pub fn restart(&mut self) {
        self.lag = self.lag.restarted();
        self.clocks.restart();
        self.counts.restarts += 1;
    }

    /// By how much the clock of the inputs was set when the filter last started again for that, about, seconds: negative if it was set
    /// back. `None` if it never was.
    pub fn clock_step_s(&self) -> Option<f64> {
        self.clock_step_s
    }

    /// The track at a time: extrapolated after the newest input, as known up to that time before it. `None` before the first
    /// input, for a time older than the lag, and for a time that is not finite.
    pub fn point_at(&self, time_s: f64) -> Option<TrackPoint> {
        self.lag.newest_s()?;
        if !time_s.is_finite() {
            return None;
        }
        if time_s >= self.head().time_s {
            return Some(TrackPoint::of(self.head(), time_s, &self.options));
        }
        let state = self.lag.state_at(time_s, &self.options)?;
        Some(TrackPoint::of(&state, time_s, &self.options))
    }

    /// Where to search a frame taken at `time_s`, of which half the footprint's diagonal is `half_footprint_m`: with what is known
    /// up to that time if newer inputs came before the frame, up to the lag. A tracked frame has one small window; misses open it
    /// step by step to the whole map.
    pub fn search(&self, time_s: f64, half_footprint_m: f64) -> Search {
        let newest_s = self.head().time_s;
        if time_s < newest_s
            && let Some(state) = self.lag.state_at(time_s, &self.options)
        {
            return Search::of(&state, time_s, half_footprint_m, &self.options);
        }
        let time_s = if time_s.is_finite() {
            time_s.max(newest_s)
        } else {
            newest_s
        };
        Search::of(self.head(), time_s, half_footprint_m, &self.options)
    }

    /// The state after all inputs.
    pub(crate) fn head(&self) -> &Filter {
        self.lag.head()
    }
}
