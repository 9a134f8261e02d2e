//! The filter's whole state as a function of its inputs in order of time.

use grimnet_geo::LonLat;

use crate::{
    alias_rate::AliasRate,
    bank::{Bank, Place, Usual},
    confidence::ConfidenceOdds,
    hypothesis::Hypothesis,
    input::{Input, PositionFix},
    options::TrackOptions,
    plane::LocalPlane,
    radius::radius95_m,
    sensors::{Change, Sensors},
};

/// Weight of the case that no hypothesis is right, while none is believed.
const LEAST_ELSEWHERE: f64 = 1e-7;
/// A standard deviation per axis for a 95 % radius of a circular normal distribution: `1 / sqrt(-2 ln 0.05)`.
const SIGMA_PER_RADIUS95: f64 = 0.408_508_6;

/// Everything that the filter knows. It depends on the inputs in order of time and on nothing else.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Filter {
    /// Time of the latest input, seconds.
    pub time_s: f64,
    /// Whether a frame was taken in, by this filter or one before it: the start is where the first one was taken.
    pub has_begun: bool,
    pub plane: Option<LocalPlane>,
    pub bank: Bank,
    pub sensors: Sensors,
    /// The hypothesis that was last believed.
    pub believed: Option<u64>,
    /// Whether it was believed at any time.
    pub was_believed: bool,
    /// Whether the leader is believed no more only because too much time passed from one frame to the next.
    outlasted: bool,
    /// Frames without a fix since the last one.
    pub misses: u32,
    /// Frames since the last fix that the leader took for right.
    unsupported: u32,
    rate: AliasRate,
    confidence: ConfidenceOdds,
}

impl Filter {
    /// The filter before any input. `has_begun`: after one that took in a frame, so that nobody knows where the start is from here.
    pub fn new(has_begun: bool) -> Self {
        Self {
            time_s: f64::NEG_INFINITY,
            has_begun,
            plane: None,
            bank: Bank::new(),
            sensors: Sensors::default(),
            believed: None,
            was_believed: false,
            outlasted: false,
            misses: 0,
            unsupported: 0,
            rate: AliasRate::default(),
            confidence: ConfidenceOdds::default(),
        }
    }

    /// Takes in the next input. Its time must not be before the latest one's, and it must be valid.
    pub fn apply(&mut self, input: &Input, options: &TrackOptions) {
        self.time_s = input.time_s();
        let change = self.sensors.take(input);
        if !self.has_begun && input.is_of_frame() {
            self.begin(input.time_s(), options);
        }
        let hypotheses = &mut self.bank.hypotheses;
        match input {
            _ if self.sensors.looks_too_far_aside(input, options) => {}
            Input::Attitude(attitude) => {
                for hypothesis in hypotheses {
                    hypothesis.attitude(attitude, change, options);
                }
            }
            Input::Height(_) => {
                if let Some(Change::Climb(climb)) = change {
                    for hypothesis in hypotheses {
                        hypothesis.climb(climb);
                    }
                }
            }
            Input::Velocity(velocity) => {
                if let Some(Change::Velocity(how)) = change {
                    for hypothesis in hypotheses {
                        hypothesis.velocity(velocity, how, options);
                    }
                }
            }
            Input::Motion(motion) => {
                for hypothesis in hypotheses {
                    hypothesis.motion(motion, &self.sensors, options);
                }
            }
            Input::Fix(fix) => self.fix(fix, options),
            Input::Miss(_) => {
                self.misses = self.misses.saturating_add(1);
                self.unsupported = self.unsupported.saturating_add(1);
            }
        }
    }

    /// The first frame was taken at `time_s`: places the start, if one is known. It is where that frame was taken, however long before it
    /// telemetry was recorded.
    pub fn begin(&mut self, time_s: f64, options: &TrackOptions) {
        self.has_begun = true;
        let Some(start) = options.start else { return };
        let plane = LocalPlane::new(start.lonlat);
        let id = self.bank.new_id();
        let sigma_m = start.radius95_m * SIGMA_PER_RADIUS95;
        let mut hypothesis = Hypothesis::at_start(
            id,
            time_s,
            plane.en_from_lonlat(start.lonlat),
            sigma_m,
            &self.sensors,
            options,
        );
        hypothesis.weight = 0.5;
        self.bank.elsewhere = 0.5;
        self.bank.hypotheses.push(hypothesis);
        self.plane = Some(plane);
    }

    fn fix(&mut self, fix: &PositionFix, options: &TrackOptions) {
        let plane = *self.plane.get_or_insert(LocalPlane::new(fix.lonlat));
        self.bank.propagate(fix.time_s, options);
        self.keep_open(options);
        self.lose_if_too_wide(options);
        let measured_m = plane.en_from_lonlat(fix.lonlat);
        let fix = &self.sensors.levelled(fix);
        let usual = Usual {
            rate: &self.rate,
            confidence: &self.confidence,
        };
        let effect = self
            .bank
            .fix(fix, measured_m, &usual, &self.sensors, options);
        self.misses = 0;
        let is_supported = self
            .bank
            .leader()
            .is_some_and(|leader| !leader.last_was_wrong);
        self.unsupported = if is_supported {
            0
        } else {
            self.unsupported.saturating_add(1)
        };
        if self.believed.is_some() {
            if effect.leader_changed {
                self.rate.forget_run();
                self.confidence.forget_run();
            } else if let Some(accepted) = effect.leader_accepted {
                self.rate.count(accepted);
                let full = options.full_confidence;
                self.confidence.count(fix.confidence, full, accepted);
            }
        }
        self.believe(options);
        self.re_anchor();
    }

    /// While a hypothesis is believed, the case that none is right keeps some weight.
    fn keep_open(&mut self, options: &TrackOptions) {
        if self.believed.is_some() || self.outlasted {
            self.bank.keep_open(self.time_s, options);
        } else {
            self.bank.at_least_elsewhere(LEAST_ELSEWHERE);
        }
    }

    /// Decides which hypothesis is believed.
    fn believe(&mut self, options: &TrackOptions) {
        let Some(place) = self.bank.leading_place() else {
            return;
        };
        let needed = if self.outlasted {
            options.change_weight
        } else if self.believed.is_none() {
            options.acquire_weight
        } else if place
            .members
            .iter()
            .any(|member| Some(member.id) == self.believed)
        {
            0.0
        } else {
            options.change_weight
        };
        if place.weight >= needed && place.leader.fixes >= options.acquire_fixes {
            self.believed = Some(place.leader.id);
            self.was_believed = true;
            self.outlasted = false;
        }
    }

    /// Whether a place is the one that is believed.
    pub fn believes(&self, place: &Place<'_>, options: &TrackOptions) -> bool {
        place.weight >= options.keep_weight
            && place
                .members
                .iter()
                .any(|member| Some(member.id) == self.believed)
    }

    /// A leader that became too uncertain has to be found again: from nothing where frames had no fix, or one of another place, for the
    /// ground may be another one than the map's or than was thought. Where frames are far apart in time nothing speaks against it.
    fn lose_if_too_wide(&mut self, options: &TrackOptions) {
        if self.believed.is_none() && !self.outlasted {
            return;
        }
        let radius_m = self
            .bank
            .leading_place()
            .map_or(f64::INFINITY, |place| radius95_m(&place.covariance_m2));
        if radius_m <= options.lost_radius_m {
            return;
        }
        self.believed = None;
        self.outlasted = self.unsupported < options.acquire_fixes;
        if !self.outlasted {
            self.bank.at_least_elsewhere(0.5);
            for hypothesis in &mut self.bank.hypotheses {
                hypothesis.fixes = 0;
            }
        }
    }

    /// Moves the plane where the leader went far from its origin.
    fn re_anchor(&mut self) {
        let (Some(plane), Some(leader)) = (self.plane, self.bank.leader()) else {
            return;
        };
        let Some(moved) = plane.moved_to(leader.position_m()) else {
            return;
        };
        for hypothesis in &mut self.bank.hypotheses {
            let before_m = hypothesis.position_m();
            let turn = plane.turn_to(&moved, before_m);
            let now_m = moved.en_from_lonlat(plane.lonlat_from_en(before_m));
            hypothesis.re_anchor(now_m, turn);
        }
        self.plane = Some(moved);
    }

    /// Longitude and latitude of a point of the plane.
    pub fn lonlat_from_en(&self, en_m: nalgebra::Vector2<f64>) -> Option<LonLat> {
        self.plane.map(|plane| plane.lonlat_from_en(en_m))
    }
}
