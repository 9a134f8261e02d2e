//! Hypotheses over heading and scale: what a photo may look like in the frame of the map.

use grimnet_pack::Pack;
use grimnet_photo::View;

use crate::{options::Options, prior::HeadingPrior, prior::Prior};

/// One way in which the photo may lie on the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis {
    /// Level of the pack.
    pub level: usize,
    /// Ground width across the photo's centre, metres.
    pub width_m: f64,
    /// Bearing of the photo's top, degrees clockwise from true north.
    pub heading_deg: f64,
    /// How far the true heading may be off, degrees.
    pub heading_reach_deg: f64,
}

/// Hypotheses tried together. Later rounds are tried where earlier ones gave no clear fix.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// They differ in heading only.
    pub hypotheses: Vec<Hypothesis>,
    /// What sets this round apart, for the answer's evidence.
    pub about: String,
}

/// Twice the sigma plus this is how far a heading is allowed to be off, degrees: descriptors bear about so much.
const HEADING_MARGIN_DEG: f64 = 15.0;
/// Above this sigma a heading is searched around if it does not give a clear fix, degrees.
const DOUBTFUL_HEADING_DEG: f64 = 8.0;
/// Ground width that a photo of unknown scale is first taken for, metres: 120 m above ground (the legal ceiling in most
/// countries) through 70 degrees.
const TYPICAL_WIDTH_M: f64 = 165.0;

/// The rounds for a photo whose view is believed to be `view`.
pub fn rounds(view: &View, prior: &Prior, pack: &Pack, options: &Options) -> Vec<Round> {
    let known = view.heading.map(|heading| {
        let sigma_deg = match prior.heading {
            HeadingPrior::Known { sigma_deg, .. } if sigma_deg.is_finite() => sigma_deg.abs(),
            _ => heading.sigma_deg,
        };
        (heading.heading_deg, sigma_deg)
    });
    let widths = widths(view, pack, options);
    let mut rounds = Vec::new();
    for &(level, width_m, ref about) in &widths {
        let hypotheses = match known {
            Some((heading_deg, sigma_deg)) => {
                let heading_reach_deg = (2.0 * sigma_deg + HEADING_MARGIN_DEG).min(180.0);
                vec![Hypothesis {
                    level,
                    width_m,
                    heading_deg,
                    heading_reach_deg,
                }]
            }
            None => turned(level, width_m, options.headings, 0.0),
        };
        rounds.push(Round {
            hypotheses,
            about: about.clone(),
        });
    }
    if let Some((heading_deg, _)) = known.filter(|&(_, sigma_deg)| sigma_deg > DOUBTFUL_HEADING_DEG)
        && let Some(&(level, width_m, _)) = widths.first()
    {
        let others = turned(level, width_m, options.headings, heading_deg).split_off(1);
        if !others.is_empty() {
            rounds.push(Round {
                hypotheses: others,
                about: "other headings than the doubtful one".into(),
            });
        }
    }
    rounds
}

/// `count` headings around the circle, the first at `first_deg`.
fn turned(level: usize, width_m: f64, count: usize, first_deg: f64) -> Vec<Hypothesis> {
    let count = count.max(1);
    let step_deg = 360.0 / count as f64;
    (0..count)
        .map(|i| Hypothesis {
            level,
            width_m,
            heading_deg: (first_deg + i as f64 * step_deg).rem_euclid(360.0),
            heading_reach_deg: (step_deg / 2.0 + HEADING_MARGIN_DEG).min(180.0),
        })
        .collect()
}

/// Level and ground width of each round, likeliest first.
fn widths(view: &View, pack: &Pack, options: &Options) -> Vec<(usize, f64, String)> {
    let level_for = |width_m: f64| pack.nearest_level(width_m / options.query_width_px);
    if let Some(footprint) = view.footprint {
        let mut all = vec![(
            level_for(footprint.width_m),
            footprint.width_m,
            String::from("the believed scale"),
        )];
        if footprint.is_doubtful() {
            all.extend(options.doubtful_scales.iter().map(|&factor| {
                let width_m = footprint.width_m * factor;
                (
                    level_for(width_m),
                    width_m,
                    format!("{factor} times the doubtful ground width"),
                )
            }));
        }
        return all;
    }
    let levels = pack
        .levels()
        .iter()
        .enumerate()
        .filter(|(_, level)| level.tile_count() > 0);
    let mut all: Vec<_> = levels
        .flat_map(|(index, level)| {
            let widths = options
                .unknown_scales
                .iter()
                .map(|&factor| factor * level.tile_m());
            widths.map(move |width_m| {
                (
                    index,
                    width_m,
                    format!("a ground width of {width_m:.0} m, for none is known"),
                )
            })
        })
        .collect();
    let oddness = |width_m: f64| (width_m / TYPICAL_WIDTH_M).ln().abs();
    all.sort_by(|a, b| oddness(a.1).total_cmp(&oddness(b.1)));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_go_round_the_circle() {
        let all = turned(0, 100.0, 12, 350.0);
        assert_eq!(all.len(), 12);
        assert_eq!(all[0].heading_deg, 350.0);
        assert_eq!(all[1].heading_deg, 20.0);
        assert!(
            all.iter()
                .all(|hypothesis| hypothesis.heading_reach_deg >= 15.0)
        );
        assert_eq!(turned(0, 100.0, 0, 7.0).len(), 1);
    }
}
