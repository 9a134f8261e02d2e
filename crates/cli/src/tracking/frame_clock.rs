//! How the clock of the frames stands to the one of the links.
//!
//! The links ask for the position at the present moment, and a fix holds at the exposure of its photo. If the two clocks differ, all
//! positions are wrong by the way that is flown in the difference.

use std::collections::VecDeque;

use super::frame_time::Epoch;

/// The first photo of a clock that differs by more from the system's is taken for one of a flight that is played again, seconds.
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
    /// One of its own, which showed the time of the first frame when that was taken in.
    FirstFrame,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Agreement {
    Agrees,
    /// Frames come so many seconds before their time.
    Early(f64),
    /// Frames come so many seconds after their time, at least.
    Late(f64),
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
    base: Option<Base>,
    ahead_s: f64,
    frames: usize,
    /// How old the last frames were when they came, seconds.
    ages_s: VecDeque<f64>,
    agreement: Agreement,
    reported: Agreement,
}

impl FrameClock {
    /// Before the first frame. Frames of a flight that is over are played again from the moment of the first one.
    pub fn new(is_live: bool) -> Self {
        Self {
            is_live,
            base: None,
            ahead_s: 0.0,
            frames: 0,
            ages_s: VecDeque::with_capacity(COMPARED),
            agreement: Agreement::Agrees,
            reported: Agreement::Agrees,
        }
    }

    /// What to add to a time of the links to get one of the frames, seconds.
    pub fn ahead_s(&self) -> f64 {
        self.ahead_s
    }

    /// Whether positions may be asked for the present moment.
    pub fn agrees(&self) -> bool {
        self.agreement == Agreement::Agrees
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
        if self.base == Some(Base::System) {
            // It may have been set since the links' clock began.
            self.ahead_s = now.system_s - now.link_s;
        }
        let mut age_s = now.link_s + self.ahead_s - newest_s;
        self.frames += 1;
        if self.base == Some(Base::FirstFrame) && self.frames <= COMPARED && age_s < 0.0 {
            // The first frame had waited.
            self.ahead_s -= age_s;
            self.ages_s.clear();
            age_s = 0.0;
        }
        if self.ages_s.len() == COMPARED {
            self.ages_s.pop_front();
        }
        self.ages_s.push_back(age_s);
        let least_of_s = |count: usize| {
            let last_s = self.ages_s.iter().rev().take(count);
            last_s.copied().fold(f64::INFINITY, f64::min)
        };
        self.agreement = if least_of_s(COMPARED) < -MAX_EARLY_S {
            Agreement::Early(-least_of_s(COMPARED))
        } else if least_of_s(LATE_COMPARED) > MAX_LATE_S {
            Agreement::Late(least_of_s(LATE_COMPARED))
        } else {
            Agreement::Agrees
        };
        base_text.or_else(|| self.agreement_text())
    }

    /// Chooses the frames' clock, again where a later frame has the system's after all.
    fn choose_base(&mut self, newest_s: f64, epoch: Epoch, now: Now) -> Option<String> {
        let is_dated = self.is_live && epoch == Epoch::Unix;
        let has_system_clock = is_dated && (now.system_s - newest_s).abs() <= SAME_CLOCK_S;
        match self.base {
            None if has_system_clock => {
                self.base = Some(Base::System);
                None
            }
            None => {
                self.base = Some(Base::FirstFrame);
                self.ahead_s = newest_s - now.link_s;
                let age_s = now.system_s - newest_s;
                let side = if age_s < 0.0 { "newer" } else { "older" };
                is_dated.then(|| {
                    format!(
                        "the newest photo is {:.0} s {side} than this computer's clock says: the flight is taken for a recorded one that \
                         is played again. If it is not, set the clocks or their time zones, or give --clock-offset {age_s:.1}",
                        age_s.abs()
                    )
                })
            }
            Some(Base::FirstFrame) if has_system_clock => {
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
                 until they agree. Set the clocks, or give --clock-offset -{by_s:.1}"
            ),
            Agreement::Late(by_s) if is_system => format!(
                "the photos are {by_s:.1} s old when they come: their clock is behind this computer's, or they come too late. No \
                 position is given until that changes. Set the clocks, or give --clock-offset {by_s:.1}"
            ),
            Agreement::Early(by_s) => format!(
                "the photos come {by_s:.1} s earlier than the times since the first one say, so that positions would be wrong: none is \
                 given until they agree. Does --fps, or the photos' clock, fit?"
            ),
            Agreement::Late(by_s) => format!(
                "the photos come {by_s:.1} s later than the times since the first one say: they are processed more slowly than they \
                 were taken, or --fps or the photos' clock does not fit. No position is given until that changes"
            ),
        })
    }
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
            let mut clock = FrameClock::new(true);
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
        let mut clock = FrameClock::new(true);
        assert!(fly(&mut clock, 0..1, 40.0).is_empty());
        assert!(!clock.agrees(), "an old photo gives no position");
        assert!(fly(&mut clock, 1..20, 0.2).is_empty());
        assert!(fly(&mut clock, 20..24, 6.0).is_empty());
        assert!(clock.agrees());
        assert_eq!(clock.ahead_s(), 0.0);
    }

    #[test]
    fn an_old_photo_does_not_set_the_clock() {
        // The newest photo that is there has the system's clock.
        let mut clock = FrameClock::new(true);
        let newest_s = Some(BEGAN_S - 0.3);
        let lines = clock.frame(BEGAN_S - 180.0, Epoch::Unix, newest_s, at(BEGAN_S));
        assert_eq!((lines, clock.ahead_s()), (None, 0.0));
        // The old one is alone.
        let mut clock = FrameClock::new(true);
        let lines = clock.frame(BEGAN_S - 180.0, Epoch::Unix, None, at(BEGAN_S));
        assert!(lines.unwrap().contains("180 s older"));
        assert_eq!(clock.ahead_s(), -180.0);
        let lines = fly(&mut clock, 1..30, 0.2);
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains("from now on"), "{lines:?}");
        assert_eq!(clock.ahead_s(), 0.0);
        assert!(clock.agrees());
    }

    #[test]
    fn the_systems_clock_may_be_set_during_the_flight() {
        let mut clock = FrameClock::new(true);
        fly(&mut clock, 0..5, 0.2);
        let now = Now {
            link_s: BEGAN_S + 5.0,
            system_s: BEGAN_S + 1000.0,
        };
        let lines = clock.frame(BEGAN_S + 999.8, Epoch::Unix, None, now);
        assert_eq!((lines, clock.ahead_s()), (None, 995.0));
        assert!(clock.agrees());
    }

    #[test]
    fn seconds_since_the_first_frame_that_drift_are_reported() {
        // One frame a second, with times that go twice as fast, or half as fast.
        for (speed, expected) in [(2.0, "earlier than"), (0.5, "later than")] {
            let mut clock = FrameClock::new(true);
            let lines: Vec<String> = (0..60)
                .filter_map(|second| {
                    let now = at(BEGAN_S + f64::from(second));
                    clock.frame(speed * f64::from(second), Epoch::Start, None, now)
                })
                .collect();
            assert_eq!(lines.len(), 1, "{lines:?}");
            assert!(lines[0].contains(expected), "{lines:?}");
            assert!(!clock.agrees());
        }
    }

    #[test]
    fn a_first_frame_that_waited_is_no_other_clock() {
        let mut clock = FrameClock::new(true);
        for (time_s, came_s) in [(0.0, 2.0), (0.5, 2.1), (1.0, 2.2), (1.5, 2.3), (2.0, 2.4)] {
            let lines = clock.frame(time_s, Epoch::Start, None, at(came_s));
            assert_eq!(lines, None);
            assert!(clock.agrees());
        }
        assert!((clock.ahead_s() + 0.4).abs() < 1e-9, "{}", clock.ahead_s());
    }

    #[test]
    fn recorded_photos_begin_now_however_young_they_are() {
        let mut clock = FrameClock::new(false);
        let lines = clock.frame(BEGAN_S - 30.0, Epoch::Unix, None, at(BEGAN_S));
        assert_eq!((lines, clock.ahead_s()), (None, -30.0));
    }
}
