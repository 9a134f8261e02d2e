//! The bank of hypotheses and their weights: a Gaussian-sum filter.
//!
//! D. L. Alspach and H. W. Sorenson, "Nonlinear Bayesian Estimation Using Gaussian Sum Approximations", IEEE Trans. Automatic
//! Control 17(4) (1972). A fix is right with a probability c and then normal around what a hypothesis predicts, or it is wrong
//! and then anywhere in the area that is searched, or where an earlier wrong one was: places that look alike lie at the same
//! offset from frame to frame. Besides the hypotheses there is the case that none of them is right; from it new hypotheses are
//! founded.

use nalgebra::{Matrix2, Vector2};

use crate::{
    alias_rate::AliasRate,
    confidence::ConfidenceOdds,
    hypothesis::Hypothesis,
    input::PositionFix,
    observation::Innovation,
    options::TrackOptions,
    sensors::{Sensors, View},
};

/// The most hypotheses that are kept.
pub(crate) const MOST_HYPOTHESES: usize = 8;
/// Hypotheses lighter than this are dropped.
const LEAST_WEIGHT: f64 = 1e-10;
/// A hypothesis lighter than this is not split.
const LEAST_WEIGHT_TO_SPLIT: f64 = 0.05;
/// A hypothesis is split by a fix that makes it this much more certain (ratio of determinants, so 2.2 in sigma): after a gap
/// a wrong fix may lie within the gate.
const SPLIT_DETERMINANT_RATIO: f64 = 25.0;
/// Share of wrong fixes that lie within the gate of a hypothesis that is split, anywhere in it.
const ALIAS_WITHIN_GATE: f64 = 0.4;
/// How fast a leader that no fix supports may turn out to be wrong, per second.
const JUMP_RATE_WHILE_COASTING: f64 = 1e-5;
/// Share of wrong fixes after a wrong one that lie where another hypothesis sees them.
const ALIAS_REPEATS: f64 = 0.95;
/// Two hypotheses with a squared Mahalanobis distance below this are of one place: chi-square with two degrees of freedom,
/// 99.9 %.
const ONE_PLACE_CHI2: f64 = 13.8;

/// Hypotheses, and the weight of the case that none of them is right. The weights sum to one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bank {
    pub hypotheses: Vec<Hypothesis>,
    pub elsewhere: f64,
    next_id: u64,
}

/// What is usual of fixes.
pub(crate) struct Usual<'a> {
    pub rate: &'a AliasRate,
    pub confidence: &'a ConfidenceOdds,
}

/// What a fix did to the hypotheses.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FixEffect {
    /// Whether the hypothesis that led before the fix accepted it. `None` without a hypothesis.
    pub leader_accepted: Option<bool>,
    /// Whether it leads no more.
    pub leader_changed: bool,
}

/// The leading hypothesis and those of the same place.
#[derive(Debug, Clone)]
pub(crate) struct Place<'a> {
    pub leader: &'a Hypothesis,
    pub members: Vec<&'a Hypothesis>,
    /// Weight of all of them.
    pub weight: f64,
    pub position_m: Vector2<f64>,
    pub covariance_m2: Matrix2<f64>,
}

fn is_one_place(a: &Hypothesis, b: &Hypothesis) -> bool {
    let apart = a.position_m() - b.position_m();
    (a.position_covariance_m2() + b.position_covariance_m2())
        .try_inverse()
        .is_some_and(|inverse| (apart.transpose() * inverse * apart)[(0, 0)] < ONE_PLACE_CHI2)
}

/// One hypothesis and what a fix says of it.
struct Judged {
    hypothesis: Hypothesis,
    innovation: Option<Innovation>,
    /// Density of the fix where it is within the gate.
    density_m2: Option<f64>,
}

impl Bank {
    pub fn new() -> Self {
        Self {
            hypotheses: Vec::with_capacity(MOST_HYPOTHESES + 1),
            elsewhere: 1.0,
            next_id: 0,
        }
    }

    /// A number that no hypothesis of the bank had before.
    pub fn new_id(&mut self) -> u64 {
        self.next_id += 1;
        self.next_id
    }

    /// The heaviest hypothesis.
    pub fn leader(&self) -> Option<&Hypothesis> {
        self.hypotheses.iter().reduce(|best, other| {
            if other.weight > best.weight {
                other
            } else {
                best
            }
        })
    }

    /// The heaviest hypothesis and all of the same place, as one normal distribution. The hypotheses must be at one time.
    pub fn leading_place(&self) -> Option<Place<'_>> {
        let leader = self.leader()?;
        let members: Vec<&Hypothesis> = self
            .hypotheses
            .iter()
            .filter(|other| other.id == leader.id || is_one_place(leader, other))
            .collect();
        let weight: f64 = members.iter().map(|member| member.weight).sum();
        if weight <= 0.0 {
            return None;
        }
        let position_m: Vector2<f64> = members
            .iter()
            .map(|member| member.position_m() * (member.weight / weight))
            .sum();
        let covariance_m2 = members
            .iter()
            .map(|member| {
                let apart = member.position_m() - position_m;
                (member.position_covariance_m2() + apart * apart.transpose())
                    * (member.weight / weight)
            })
            .sum();
        Some(Place {
            leader,
            members,
            weight,
            position_m,
            covariance_m2,
        })
    }

    /// Carries all hypotheses to a later time.
    pub fn propagate(&mut self, time_s: f64, options: &TrackOptions) {
        for hypothesis in &mut self.hypotheses {
            hypothesis.propagate(time_s, options);
        }
    }

    /// Takes in a fix.
    pub fn fix(
        &mut self,
        fix: &PositionFix,
        measured_m: Vector2<f64>,
        usual: &Usual<'_>,
        sensors: &Sensors,
        options: &TrackOptions,
    ) -> FixEffect {
        self.propagate(fix.time_s, options);
        let view = sensors.view_of(fix, options);
        let leader = self.leader().map(|leader| leader.id);
        let judged = self.judge(fix, measured_m, view, options);
        let leader_accepted = judged
            .iter()
            .find(|j| Some(j.hypothesis.id) == leader)
            .map(|j| j.density_m2.is_some());
        let anywhere_m2 = 1.0 / options.search_area_m2;
        // Density of a wrong fix: anywhere, or where another hypothesis sees it, which then repeats an offset.
        let alias_m2 = |but: Option<u64>, repeats: f64| {
            let repeated_m2 = judged
                .iter()
                .filter(|j| Some(j.hypothesis.id) != but)
                .filter_map(|j| j.density_m2)
                .fold(0.0, f64::max);
            (1.0 - repeats) * anywhere_m2 + repeats * repeated_m2
        };
        // Probability that the fix is wrong and its density then, for each hypothesis.
        let wrong: Vec<(f64, f64)> = judged
            .iter()
            .map(|j| {
                let after_wrong = j.hypothesis.last_was_wrong;
                let repeats = if after_wrong {
                    ALIAS_REPEATS
                } else {
                    options.alias_persistence
                };
                (
                    usual.rate.wrong(after_wrong),
                    alias_m2(Some(j.hypothesis.id), repeats),
                )
            })
            .collect();
        let wrong_elsewhere = usual.rate.wrong(true);
        let log_odds = usual
            .confidence
            .log_ratio(fix.confidence, options.full_confidence);
        let elsewhere_before = self.elsewhere;
        let repeats = if judged.is_empty() {
            0.0
        } else {
            ALIAS_REPEATS
        };
        self.elsewhere *= wrong_elsewhere * alias_m2(None, repeats);
        let founds_one = judged.iter().all(|j| j.density_m2.is_none());
        for (judged, (wrong, alias_m2)) in judged.into_iter().zip(wrong) {
            self.weigh(judged, fix, wrong, alias_m2, log_odds, options);
        }
        if founds_one {
            let id = self.new_id();
            let mut new = Hypothesis::from_fix(id, fix, measured_m, sensors, options);
            new.weight = elsewhere_before
                * (1.0 - wrong_elsewhere)
                * anywhere_m2
                * new.support.add(log_odds).exp();
            self.hypotheses.push(new);
        }
        self.tidy();
        FixEffect {
            leader_accepted,
            leader_changed: self.leader().map(|new| new.id) != leader,
        }
    }

    /// Takes a hypothesis back in, with the weight that the fix gives it: `wrong` is the probability that the fix is wrong and
    /// `alias_m2` its density then. A hypothesis that would become much more certain is split into one with and one without the
    /// fix.
    fn weigh(
        &mut self,
        mut judged: Judged,
        fix: &PositionFix,
        wrong: f64,
        alias_m2: f64,
        log_odds: f64,
        options: &TrackOptions,
    ) {
        let before = judged.hypothesis.weight;
        let (Some(innovation), Some(density_m2)) = (judged.innovation, judged.density_m2) else {
            judged.hypothesis.weight = before * wrong * alias_m2;
            judged.hypothesis.see(false);
            self.hypotheses.push(judged.hypothesis);
            return;
        };
        let right = (1.0 - wrong) * density_m2 * judged.hypothesis.support.add(log_odds).exp();
        let much_more_certain =
            innovation.determinant_m4() > SPLIT_DETERMINANT_RATIO * innovation.own_determinant_m4;
        if much_more_certain && before > LEAST_WEIGHT_TO_SPLIT {
            let mut without = judged.hypothesis.clone();
            without.id = self.new_id();
            without.see(false);
            let gate_m2 =
                std::f64::consts::PI * options.gate_chi2 * innovation.determinant_m4().sqrt();
            without.weight = before * wrong * alias_m2.max(ALIAS_WITHIN_GATE / gate_m2);
            self.hypotheses.push(without);
            judged.hypothesis.weight = before * right;
        } else {
            judged.hypothesis.weight = before * (right + wrong * alias_m2);
        }
        judged.hypothesis.see(true);
        judged.hypothesis.accept(fix, &innovation, options);
        self.hypotheses.push(judged.hypothesis);
    }

    /// Takes all hypotheses out and compares them with the fix.
    fn judge(
        &mut self,
        fix: &PositionFix,
        measured_m: Vector2<f64>,
        view: View,
        options: &TrackOptions,
    ) -> Vec<Judged> {
        self.hypotheses
            .drain(..)
            .map(|mut hypothesis| {
                hypothesis.know_map_error(fix);
                hypothesis.look(view);
                let innovation = hypothesis.innovation(fix, measured_m, view, options);
                if let Some(innovation) = &innovation {
                    hypothesis.test_ratio = innovation.chi2 / options.gate_chi2;
                }
                let density_m2 = innovation
                    .filter(|innovation| innovation.chi2 <= options.gate_chi2)
                    .map(|innovation| innovation.density_m2);
                Judged {
                    hypothesis,
                    innovation,
                    density_m2,
                }
            })
            .collect()
    }

    /// The case that no hypothesis is right keeps at least this weight; the leader's age without a fix raises it.
    pub fn keep_open(&mut self, time_s: f64, options: &TrackOptions) {
        let age_s = self
            .leader()
            .and_then(|leader| leader.last_fix_s)
            .map_or(0.0, |fix_s| time_s - fix_s);
        self.at_least_elsewhere(options.jump_probability + JUMP_RATE_WHILE_COASTING * age_s);
    }

    /// Raises the weight of the case that no hypothesis is right.
    pub fn at_least_elsewhere(&mut self, weight: f64) {
        let weight = weight.min(0.5);
        if self.elsewhere < weight {
            let scale = (1.0 - weight) / (1.0 - self.elsewhere);
            for hypothesis in &mut self.hypotheses {
                hypothesis.weight *= scale;
            }
            self.elsewhere = weight;
        }
    }

    /// Merges what says the same, drops what has no weight and makes the weights sum to one.
    fn tidy(&mut self) {
        self.normalise();
        // Heaviest first; ids make the order one order.
        self.hypotheses
            .sort_by(|a, b| b.weight.total_cmp(&a.weight).then(a.id.cmp(&b.id)));
        let mut kept: Vec<Hypothesis> = Vec::with_capacity(MOST_HYPOTHESES + 1);
        for hypothesis in self.hypotheses.drain(..) {
            if hypothesis.weight < LEAST_WEIGHT {
                continue;
            }
            match kept.iter().position(|other| other.agrees_with(&hypothesis)) {
                Some(same) => kept[same].absorb(hypothesis),
                None if kept.len() < MOST_HYPOTHESES => kept.push(hypothesis),
                None => {}
            }
        }
        self.hypotheses = kept;
        self.normalise();
    }

    fn normalise(&mut self) {
        let sum: f64 = self.elsewhere + self.hypotheses.iter().map(|h| h.weight).sum::<f64>();
        if sum > 0.0 && sum.is_finite() {
            self.elsewhere /= sum;
            for hypothesis in &mut self.hypotheses {
                hypothesis.weight /= sum;
            }
        } else {
            // Densities underflowed: nothing that was believed explains what is seen.
            self.hypotheses.clear();
            self.elsewhere = 1.0;
        }
    }
}
