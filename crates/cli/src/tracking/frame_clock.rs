//! How the clock of the frames stands to the one of the links.
//!
//! The links ask for the position at the present moment, and a fix holds at the exposure of its photo. If the two clocks differ, all
//! positions are wrong by the way that is flown in the difference.

use std::collections::VecDeque;

use super::frame_time::Epoch;
use super::own_clock::OwnClock;

/// The date of a first photo that differs by more from the system's is of another time: of a clock that was never set, or of a flight
/// that is played again, seconds.
const SAME_CLOCK_S: f64 = 60.0;
/// A photo that comes earlier than its own time by more than this has another clock, seconds.
const MAX_EARLY_S: f64 = 0.1;
/// Photos that are all older than this when they come have another clock, or come too late to be of use, seconds.
const MAX_LATE_S: f64 = 3.0;
/// Whether photos come before their time is compared over so many frames.
const COMPARED: usize = 10;
/// Whether they come too late, over so many: the least age counts, since a photo may wait.
const LATE_COMPARED: usize = 5;
/// From so many frames on there is a warning that photos are too old: the first ones may have waited for the program.
const LATE_BEFORE_WARNING: usize = 3;

/// A clock of the frames' own that is wrong by more than this part is warned of. It moves velocities by as much, and positions by the
/// way that is flown in a fraction of a second.
const WARNED_GAIN: f64 = 0.01;
/// That is told by frames that came so long after each other, seconds: single ones come some tenths of a second late.
const WARNED_OVER_S: f64 = 45.0;
/// With a clock that is wrong by more than this part no position is given.
const MAX_GAIN: f64 = 0.1;

/// What the clocks show when a frame is taken in, seconds.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// The links' clock.
    pub link_s: f64,
    /// The system's clock, since 1970.
    pub system_s: f64,
}

/// The frames' clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Base {
    /// The system's.
    System,
    /// One of its own, set by the first frame when that was taken in.
    FirstFrame,
    /// As that, because the dates of the frames are of another time than the system's, and nobody said that it is right so.
    OtherTime,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Agreement {
    Agrees,
    /// Frames come so many seconds before their time.
    Early(f64),
    /// Frames come so many seconds after their time, at least.
    Late(f64),
    /// Their own clock gains so many seconds in a second.
    Gains(f64),
}

impl Agreement {
    fn is_same_kind(self, other: Self) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }
}

/// See the module.
#[derive(Debug)]
pub struct FrameClock {
    /// Whether the frames come while the aircraft flies.
    is_live: bool,
    /// How old frames of a clock of their own are when they come, seconds. `None` if nobody said that they have one.
    latency_s: Option<f64>,
    base: Option<Base>,
    ahead_s: f64,
    /// Where that is not the system's.
    own: OwnClock,
    /// How old the last frames were when they came, beyond the latency, seconds.
    ages_s: VecDeque<f64>,
    agreement: Agreement,
    reported: Agreement,
    warned_of_gain: bool,
}

impl FrameClock {
    /// Before the first frame. Frames of a flight that is over are played again from the moment of the first one. Live frames with a
    /// `latency_s` have a clock of their own.
    pub fn new(is_live: bool, latency_s: Option<f64>) -> Self {
        Self {
            is_live,
            latency_s,
            base: None,
            ahead_s: 0.0,
            own: OwnClock::default(),
            ages_s: VecDeque::with_capacity(COMPARED),
            agreement: Agreement::Agrees,
            reported: Agreement::Agrees,
            warned_of_gain: false,
        }
    }

    /// What to add to a time of the links to get one of the frames, seconds. `None` before the first frame.
    pub fn ahead_s(&self) -> Option<f64> {
        self.base.map(|_| self.ahead_s)
    }

    /// Whether positions may be asked for the present moment.
    pub fn agrees(&self) -> bool {
        self.base != Some(Base::OtherTime) && self.agreement == Agreement::Agrees
    }

    /// Takes in the time of a frame, and that of the newest one that waits. Gives the line to be logged.
    pub fn frame(
        &mut self,
        time_s: f64,
        epoch: Epoch,
        newest_s: Option<f64>,
        now: Now,
    ) -> Option<String> {
        // A photo that waited says nothing of the clock.
        let newest_s = newest_s.map_or(time_s, |newest_s| newest_s.max(time_s));
        let base_text = self.choose_base(newest_s, epoch, now);
        // If the frame came at the moment of its exposure, or as long after it as is said.
        let least_ahead_s = newest_s + self.latency_s.unwrap_or(0.0) - now.link_s;
        self.ahead_s = if self.base == Some(Base::System) {
            // It may have been set since the links' clock began.
            now.system_s - now.link_s
        } else {
            self.own.take(now.link_s, least_ahead_s)
        };
        let age_s = self.ahead_s - least_ahead_s;
        if self.ages_s.len() == COMPARED {
            self.ages_s.pop_front();
        }
        self.ages_s.push_back(age_s);
        let least_of_s = |count: usize| {
            let last_s = self.ages_s.iter().rev().take(count);
            last_s.copied().fold(f64::INFINITY, f64::min)
        };
        let gain = self.own.gain().unwrap_or(0.0);
        self.agreement = if gain.abs() > MAX_GAIN && self.base != Some(Base::System) {
            Agreement::Gains(gain)
        } else if least_of_s(COMPARED) < -MAX_EARLY_S {
            Agreement::Early(-least_of_s(COMPARED))
        } else if least_of_s(LATE_COMPARED) > MAX_LATE_S {
            Agreement::Late(least_of_s(LATE_COMPARED))
        } else {
            Agreement::Agrees
        };
        if self.base == Some(Base::OtherTime) {
            return base_text;
        }
        base_text
            .or_else(|| self.agreement_text())
            .or_else(|| self.gain_text())
    }

    /// Chooses the frames' clock, again where a later frame has the system's after all.
    fn choose_base(&mut self, newest_s: f64, epoch: Epoch, now: Now) -> Option<String> {
        let is_dated = self.is_live && epoch == Epoch::Unix && self.latency_s.is_none();
        let has_system_clock = is_dated && (now.system_s - newest_s).abs() <= SAME_CLOCK_S;
        match self.base {
            None if has_system_clock => {
                self.base = Some(Base::System);
                None
            }
            None => {
                if is_dated {
                    self.base = Some(Base::OtherTime);
                    return Some(other_time_text(now.system_s - newest_s));
                }
                self.base = Some(Base::FirstFrame);
                let is_unknown = self.is_live && self.latency_s.is_none();
                is_unknown.then(|| UNKNOWN_LATENCY.to_owned())
            }
            Some(Base::OtherTime) if has_system_clock => {
                self.base = Some(Base::System);
                self.ages_s.clear();
                Some(
                    "the photos' times are those of this computer's clock from now on; the photos before were of another time"
                        .to_owned(),
                )
            }
            Some(_) => None,
        }
    }

    /// What is reported where the clocks begin or cease to agree.
    fn agreement_text(&mut self) -> Option<String> {
        let now = self.agreement;
        let too_soon = matches!(now, Agreement::Late(_)) && self.ages_s.len() < LATE_BEFORE_WARNING;
        if now.is_same_kind(self.reported) || too_soon {
            return None;
        }
        self.reported = now;
        let is_system = self.base == Some(Base::System);
        Some(match now {
            Agreement::Agrees => {
                "the photos' clock agrees with the link's again; positions are given".to_owned()
            }
            Agreement::Early(by_s) if is_system => format!(
                "the photos' clock is at least {by_s:.1} s ahead of this computer's, so that positions would be wrong: none is given \
                 until they agree. Set the clocks, or give --clock-offset -{by_s:.1} less the time that a photo takes to come"
            ),
            Agreement::Late(by_s) if is_system => format!(
                "the photos are {by_s:.1} s old when they come: their clock is behind this computer's, or they come too late. No \
                 position is given until that changes. Set the clocks, or give --clock-offset {by_s:.1} less the time that a photo takes to come"
            ),
            // A clock of their own is the one by which they do not come early.
            Agreement::Early(_) => return None,
            Agreement::Late(by_s) => format!(
                "the photos come {by_s:.1} s later than the times since the first one say: they are processed more slowly than they \
                 were taken, or --fps or the photos' clock does not fit. No position is given until that changes"
            ),
            Agreement::Gains(gain) => format!(
                "the photos come {}: --fps or the photos' clock does not fit, or they are processed more slowly than they were taken. \
                 No position is given until that changes",
                speed_text(gain)
            ),
        })
    }

    /// What is reported once where a clock of the frames' own goes wrong by little.
    fn gain_text(&mut self) -> Option<String> {
        let gain = self.own.gain_since_step(MAX_GAIN, WARNED_OVER_S)?;
        let is_new = self.agrees()
            && self.base != Some(Base::System)
            && gain.abs() > WARNED_GAIN
            && !std::mem::replace(&mut self.warned_of_gain, true);
        is_new.then(|| {
            format!(
                "the photos come {}, so that velocities are wrong by as much, and positions by the way that is flown in some tenths of \
                 a second: does --fps, or the photos' clock, fit, and is no photo lost?",
                speed_text(gain)
            )
        })
    }
}

/// What is reported where nobody said how old frames are when they come.
const UNKNOWN_LATENCY: &str = "the times of the frames are not of this computer's clock, so that each frame is taken for exposed when \
    it comes: the time that it takes to come, often some tenths of a second, makes positions wrong by the way that is flown in it, which \
    the stated radius does not contain. Measure it and give --frame-latency S (docs/autopilot.md, \"One clock\")";

/// How fast photos come, where their clock gains so many seconds in a second.
fn speed_text(gain: f64) -> String {
    let faster = if gain > 0.0 { "faster" } else { "more slowly" };
    format!("{:.1} % {faster} than their times say", 100.0 * gain.abs())
}

/// What is reported where the newest photo is so many seconds old by its date.
fn other_time_text(age_s: f64) -> String {
    let side = if age_s < 0.0 { "newer" } else { "older" };
    format!(
        "the newest photo is {:.0} s {side} than this computer's clock says, so that positions would be wrong: none is given until that \
         changes. Set the clocks or their time zones, or give --clock-offset {age_s:.1}; for a camera whose clock cannot be set, or a \
         flight that is played again, give --frame-latency S",
        age_s.abs()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEGAN_S: f64 = 1_782_036_000.0;

    /// Frames once a second, `age_s` old by their own clock when they come. Gives the lines that are logged.
    fn fly(clock: &mut FrameClock, seconds: std::ops::Range<u32>, age_s: f64) -> Vec<String> {
        seconds
            .filter_map(|second| {
                let now_s = BEGAN_S + f64::from(second);
                clock.frame(now_s - age_s, Epoch::Unix, None, at(now_s))
            })
            .collect()
    }

    /// Both clocks at the same time.
    fn at(now_s: f64) -> Now {
        Now {
            link_s: now_s,
            system_s: now_s,
        }
    }

    #[test]
    fn a_clock_ahead_or_behind_is_told_once_and_gives_no_position() {
        for (age_s, expected, option) in [
            (
                -5.0,
                "5.0 s ahead of this computer's",
                "--clock-offset -5.0",
            ),
            (5.0, "5.0 s old when they come", "--clock-offset 5.0"),
        ] {
            let mut clock = FrameClock::new(true, None);
            let lines = fly(&mut clock, 0..30, age_s);
            assert_eq!(lines.len(), 1, "{lines:?}");
            assert!(lines[0].contains(expected), "{lines:?}");
            assert!(lines[0].contains(option), "{lines:?}");
            assert!(!clock.agrees());
            let lines = fly(&mut clock, 30..60, 0.2);
            assert_eq!(lines.len(), 1, "{lines:?}");
            assert!(
                lines[0].contains("agrees with the link's again"),
                "{lines:?}"
            );
            assert!(clock.agrees());
        }
    }

    #[test]
    fn one_clock_is_silent_also_where_single_photos_wait() {
        let mut clock = FrameClock::new(true, None);
        assert!(fly(&mut clock, 0..1, 40.0).is_empty());
        assert!(!clock.agrees(), "an old photo gives no position");
        assert!(fly(&mut clock, 1..20, 0.2).is_empty());
        assert!(fly(&mut clock, 20..24, 6.0).is_empty());
        assert!(clock.agrees());
        assert_eq!(clock.ahead_s(), Some(0.0));
    }

    #[test]
    fn an_old_photo_does_not_set_the_clock() {
        // The newest photo that is there has the system's clock.
        let mut clock = FrameClock::new(true, None);
        let newest_s = Some(BEGAN_S - 0.3);
        let lines = clock.frame(BEGAN_S - 180.0, Epoch::Unix, newest_s, at(BEGAN_S));
        assert_eq!((lines, clock.ahead_s()), (None, Some(0.0)));
        // The old one is alone.
        let mut clock = FrameClock::new(true, None);
        let lines = clock.frame(BEGAN_S - 180.0, Epoch::Unix, None, at(BEGAN_S));
        assert!(lines.unwrap().contains("180 s older"));
        assert_eq!(clock.ahead_s(), Some(-180.0));
        assert!(!clock.agrees());
        let lines = fly(&mut clock, 1..30, 0.2);
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains("from now on"), "{lines:?}");
        assert_eq!(clock.ahead_s(), Some(0.0));
        assert!(clock.agrees());
    }

    #[test]
    fn the_systems_clock_may_be_set_during_the_flight() {
        let mut clock = FrameClock::new(true, None);
        fly(&mut clock, 0..5, 0.2);
        let now = Now {
            link_s: BEGAN_S + 5.0,
            system_s: BEGAN_S + 1000.0,
        };
        let lines = clock.frame(BEGAN_S + 999.8, Epoch::Unix, None, now);
        assert_eq!((lines, clock.ahead_s()), (None, Some(995.0)));
        assert!(clock.agrees());
    }

    /// Frames without dates, `per_s` of their seconds in a second, for so many seconds. Gives the lines that are logged.
    fn stream(clock: &mut FrameClock, per_s: f64, seconds: u32) -> Vec<String> {
        (0..seconds)
            .filter_map(|second| {
                let now = at(BEGAN_S + f64::from(second));
                clock.frame(per_s * f64::from(second), Epoch::Start, None, now)
            })
            .collect()
    }

    #[test]
    fn a_clock_of_the_frames_that_goes_much_too_fast_or_too_slow_gives_no_position() {
        for (per_s, expected) in [(2.0, "100.0 % faster"), (0.5, "50.0 % more slowly")] {
            let mut clock = FrameClock::new(true, Some(0.3));
            let lines = stream(&mut clock, per_s, 600);
            assert!(lines.last().unwrap().contains(expected), "{lines:?}");
            let late = "later than the times since the first one say";
            assert!(lines.len() == 1 || lines[0].contains(late), "{lines:?}");
            assert!(lines.len() <= 2 && !clock.agrees(), "{lines:?}");
        }
    }

    /// The frames are counted, so that their clock stands still in a pause. That is taken for frames that come late, and accepted once no
    /// frame has come earlier for two spans.
    #[test]
    fn a_pause_of_a_stream_costs_half_a_minute() {
        let mut clock = FrameClock::new(true, Some(0.3));
        stream(&mut clock, 1.0, 60);
        let mut lines = Vec::new();
        let mut without_s = 0;
        for second in 60..300 {
            let came_s = BEGAN_S + f64::from(second) + 12.0;
            lines.extend(clock.frame(f64::from(second), Epoch::Start, None, at(came_s)));
            without_s += u32::from(!clock.agrees());
        }
        assert!(without_s <= 30, "{without_s} s");
        let expected = ["later than the times", "agrees with the link's again"];
        assert_eq!(lines.len(), expected.len(), "{lines:?}");
        for (line, expected) in lines.iter().zip(expected) {
            assert!(line.contains(expected), "{line}");
        }
        let ahead_s = clock.ahead_s().unwrap();
        assert!((ahead_s + BEGAN_S + 12.0 - 0.3).abs() < 1e-6, "{ahead_s}");
    }

    /// Such as a camera of 29.97 frames a second with `--fps 30`, or a second that is 10 ms too short.
    #[test]
    fn a_clock_of_the_frames_that_drifts_is_followed_for_hours() {
        for (per_s, warned) in [
            (29.97 / 30.0, None),
            (1.0005, None),
            (1.0 / 0.985, Some("1.5 % faster")),
            (1.0 / 1.02, Some("2.0 % more slowly")),
        ] {
            let mut clock = FrameClock::new(true, Some(0.0));
            let lines = stream(&mut clock, per_s, 7200);
            assert!(clock.agrees(), "{per_s}");
            assert_eq!(lines.len(), usize::from(warned.is_some()), "{lines:?}");
            if let Some(warned) = warned {
                assert!(lines[0].contains(warned), "{lines:?}");
            }
            // At the last frame, which came at the moment of its exposure.
            let frame_s = 7199.0 + BEGAN_S + clock.ahead_s().unwrap();
            let off_s = frame_s - per_s * 7199.0;
            assert!((-1e-6..0.61).contains(&off_s), "{per_s}: {off_s}");
        }
    }

    #[test]
    fn a_first_frame_that_waited_is_no_other_clock() {
        let mut clock = FrameClock::new(true, Some(0.0));
        for (time_s, came_s) in [(0.0, 2.0), (0.5, 2.1), (1.0, 2.2), (1.5, 2.3), (2.0, 2.4)] {
            let lines = clock.frame(time_s, Epoch::Start, None, at(came_s));
            assert_eq!(lines, None);
            assert!(clock.agrees());
        }
        let ahead_s = clock.ahead_s().unwrap();
        assert!((ahead_s + 0.4).abs() < 1e-9, "{ahead_s}");
    }

    #[test]
    fn recorded_photos_begin_now_however_young_they_are() {
        let mut clock = FrameClock::new(false, None);
        assert_eq!(clock.ahead_s(), None);
        let lines = clock.frame(BEGAN_S - 30.0, Epoch::Unix, None, at(BEGAN_S));
        assert_eq!((lines, clock.ahead_s()), (None, Some(-30.0)));
        assert!(clock.agrees());
    }

    #[test]
    fn an_unknown_latency_of_live_frames_is_told_once() {
        let mut clock = FrameClock::new(true, None);
        let lines: Vec<String> = (0..30)
            .filter_map(|second| {
                let now = at(BEGAN_S + f64::from(second));
                clock.frame(f64::from(second), Epoch::Start, None, now)
            })
            .collect();
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains("--frame-latency S"), "{lines:?}");
        assert!(clock.agrees());
    }

    /// At the moment at which a frame comes, the frames' clock shows more than the frame's time by the latency.
    #[test]
    fn a_stated_latency_is_the_age_at_which_frames_come() {
        let mut clock = FrameClock::new(true, Some(0.5));
        for (time_s, came_s) in [(0.0, 100.2), (1.0, 101.0), (2.0, 102.3)] {
            let lines = clock.frame(time_s, Epoch::Start, None, at(came_s));
            assert_eq!(lines, None);
            assert!(clock.agrees());
        }
        // The second one came first after its exposure.
        let ahead_s = clock.ahead_s().unwrap();
        assert!((101.0 + ahead_s - 1.5).abs() < 1e-9, "{ahead_s}");
    }

    /// Such as one whose time zone is wrong.
    #[test]
    fn dates_of_another_time_give_positions_only_with_a_latency() {
        for (latency_s, agrees) in [(None, false), (Some(0.2), true)] {
            let mut clock = FrameClock::new(true, latency_s);
            let lines = fly(&mut clock, 0..30, 8.0 * 3600.0);
            assert_eq!(clock.agrees(), agrees);
            assert_eq!(lines.is_empty(), agrees, "{lines:?}");
            let expected = -8.0 * 3600.0 + latency_s.unwrap_or(0.0);
            let ahead_s = clock.ahead_s().unwrap();
            assert!((ahead_s - expected).abs() < 1e-6, "{ahead_s}");
            if !agrees {
                assert_eq!(lines.len(), 1, "{lines:?}");
                assert!(lines[0].contains("--clock-offset 28800.0"), "{lines:?}");
            }
        }
    }
}
