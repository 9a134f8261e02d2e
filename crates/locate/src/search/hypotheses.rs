//! Hypotheses of heading and scale: how a photo may lie on the map.

use grimnet_net::Purpose;
use grimnet_pack::Pack;
use grimnet_photo::{Footprint, View};

use crate::{geometry::scale_prior::ScalePrior, options::Options};

/// A heading and a ground width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hypothesis {
    /// Level of the pack.
    pub level: usize,
    /// Ground width across the photo's centre, metres.
    pub width_m: f64,
    /// Bearing of the photo's top, degrees clockwise from true north.
    pub heading_deg: f64,
    /// Largest difference to the true heading, degrees.
    pub heading_reach_deg: f64,
    /// The ground width that prior or metadata state, if they do; `width_m` may be another.
    pub stated: Option<Footprint>,
    /// Whether the width is one of several that are tried because none is stated, or an uncertain one gave no clear answer.
    pub is_width_searched: bool,
}

impl Hypothesis {
    /// How probable the scales of transforms of a query of this width are.
    pub fn scale_prior(&self) -> Option<ScalePrior> {
        self.stated.map(|stated| ScalePrior {
            scale: stated.width_m / self.width_m,
            relative_sigma: stated.relative_sigma,
        })
    }
}

/// Hypotheses that are tried together. A later round is tried if the rounds before it give no clear fix.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Round {
    /// They differ in heading only.
    pub hypotheses: Vec<Hypothesis>,
    /// What this round assumes, for the answer's evidence.
    pub assumption: String,
    /// What its queries are for: to search, where they are so many that most must be wrong, or to answer.
    pub purpose: Purpose,
}

/// Up to so many rounds are searched stage by stage. More of them differ in ground width, of which one at most is right: after a few
/// candidates of each, they are searched together.
pub(crate) const MAX_STAGED_ROUNDS: usize = 3;

/// A heading may be wrong by twice its sigma plus this, degrees: descriptors tolerate about that much.
const HEADING_MARGIN_DEG: f64 = 15.0;
/// If the sigma of a heading is above this, other headings are tried after it, degrees.
const UNCERTAIN_HEADING_DEG: f64 = 8.0;
/// Ground widths near this one are tried first if none is stated, metres: 120 m above ground (the legal ceiling in most countries)
/// with a field of view of 70 degrees.
const TYPICAL_WIDTH_M: f64 = 165.0;

/// A level of the pack with the ground width that is assumed.
struct AssumedWidth {
    level: usize,
    width_m: f64,
    is_searched: bool,
    assumption: String,
}

/// The rounds for a photo with this view, the most probable first.
pub(crate) fn rounds(view: &View, pack: &Pack, options: &Options) -> Vec<Round> {
    let widths = assumed_widths(view, pack, options);
    let purpose_of = |assumed: &AssumedWidth, headings: usize| {
        if assumed.is_searched {
            purpose(widths.len(), headings)
        } else {
            Purpose::Answer
        }
    };
    let round = |assumed: &AssumedWidth| {
        let &AssumedWidth {
            level,
            width_m,
            is_searched,
            ..
        } = assumed;
        let hypotheses = match view.heading {
            Some(heading) => vec![Hypothesis {
                level,
                width_m,
                heading_deg: heading.heading_deg,
                heading_reach_deg: (2.0 * heading.sigma_deg + HEADING_MARGIN_DEG).min(180.0),
                stated: view.footprint,
                is_width_searched: is_searched,
            }],
            None => around_circle(assumed, view, options.headings, 0.0),
        };
        Round {
            purpose: purpose_of(assumed, hypotheses.len()),
            hypotheses,
            assumption: assumed.assumption.clone(),
        }
    };
    let mut rounds: Vec<Round> = widths.iter().map(round).collect();
    let uncertain = view
        .heading
        .filter(|heading| heading.sigma_deg > UNCERTAIN_HEADING_DEG);
    if let Some(heading) = uncertain {
        // Where no ground width is stated the first is not more than a guess.
        let count = if view.footprint.is_some() {
            1
        } else {
            widths.len()
        };
        let others = |assumed: &AssumedWidth| {
            let mut hypotheses =
                around_circle(assumed, view, options.headings, heading.heading_deg);
            let others = hypotheses.split_off(1);
            (!others.is_empty()).then(|| Round {
                purpose: purpose_of(assumed, others.len()),
                hypotheses: others,
                assumption: format!(
                    "{}; other headings than the uncertain one",
                    assumed.assumption
                ),
            })
        };
        rounds.extend(widths.iter().take(count).filter_map(others));
    }
    rounds
}

/// What queries under so many ground widths and headings are for.
fn purpose(widths: usize, headings: usize) -> Purpose {
    if widths > MAX_STAGED_ROUNDS && headings > 1 {
        Purpose::Search
    } else {
        Purpose::Answer
    }
}

/// `count` evenly spaced headings, the first at `first_deg`.
fn around_circle(
    assumed: &AssumedWidth,
    view: &View,
    count: usize,
    first_deg: f64,
) -> Vec<Hypothesis> {
    let count = count.max(1);
    let step_deg = 360.0 / count as f64;
    (0..count)
        .map(|i| Hypothesis {
            level: assumed.level,
            width_m: assumed.width_m,
            heading_deg: (first_deg + i as f64 * step_deg).rem_euclid(360.0),
            heading_reach_deg: (step_deg / 2.0 + HEADING_MARGIN_DEG).min(180.0),
            stated: view.footprint,
            is_width_searched: assumed.is_searched,
        })
        .collect()
}

/// Level and ground width of each round, the most probable first.
fn assumed_widths(view: &View, pack: &Pack, options: &Options) -> Vec<AssumedWidth> {
    let stated = view
        .footprint
        .map(|Footprint { width_m, .. }| AssumedWidth {
            level: pack.nearest_level(width_m / options.query_width_px),
            width_m,
            is_searched: false,
            assumption: "ground width from prior or metadata".into(),
        });
    if view.footprint.is_some_and(|stated| !stated.is_uncertain()) {
        return stated.into_iter().collect();
    }
    let (likely_width_m, reason) = match &stated {
        Some(stated) => (stated.width_m, "the stated one is uncertain"),
        None => (TYPICAL_WIDTH_M, "none given"),
    };
    let levels = pack
        .levels()
        .iter()
        .enumerate()
        .filter(|(_, level)| level.tile_count() > 0);
    let mut searched: Vec<AssumedWidth> = levels
        .flat_map(|(index, level)| {
            options.unknown_scales.iter().map(move |&factor| {
                let width_m = factor * level.tile_m();
                AssumedWidth {
                    level: index,
                    width_m,
                    is_searched: true,
                    assumption: format!("assumed ground width {width_m:.0} m ({reason})"),
                }
            })
        })
        .collect();
    let distance = |assumed: &AssumedWidth| (assumed.width_m / likely_width_m).ln().abs();
    searched.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    stated.into_iter().chain(searched).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_queries_of_many_widths_and_headings_search() {
        assert_eq!(purpose(8, 12), Purpose::Search);
        // A known ground width; few levels; a known heading.
        for (widths, headings) in [(1, 12), (3, 12), (8, 1), (1, 1)] {
            assert_eq!(purpose(widths, headings), Purpose::Answer);
        }
    }

    #[test]
    fn headings_are_evenly_spaced() {
        let assumed = AssumedWidth {
            level: 0,
            width_m: 100.0,
            is_searched: false,
            assumption: String::new(),
        };
        let view = View::default();
        let all = around_circle(&assumed, &view, 12, 350.0);
        assert_eq!(all.len(), 12);
        assert_eq!(all[0].heading_deg, 350.0);
        assert_eq!(all[1].heading_deg, 20.0);
        assert!(
            all.iter()
                .all(|hypothesis| hypothesis.heading_reach_deg >= 15.0)
        );
        assert_eq!(around_circle(&assumed, &view, 0, 7.0).len(), 1);
    }
}
