//! Queries: the photo resampled and rotated for each hypothesis, with its features.

use std::{sync::Arc, time::Instant};

use grimnet_geo::turn_deg;
use grimnet_net::Purpose;
use grimnet_pack::{DescriptorType, Level};
use grimnet_photo::{Photo, QueryMaker, QueryOptions, View};
use rayon::prelude::*;

use crate::{
    context::Context,
    dense_query::DenseQuery,
    error::Result,
    outcome::{TimeMs, elapsed_ms},
    pipeline::tile_frame::{query_gsd_m, up_bearing_deg},
    query_features::QueryFeatures,
    search::hypotheses::Hypothesis,
};

/// The largest query side for these hypotheses, pixels: smaller if several headings are tried.
pub(crate) fn side_px(context: Context<'_>, hypotheses: &[Hypothesis]) -> u32 {
    if hypotheses.len() > 1 {
        context.options.hypothesis_side_px
    } else {
        context.options.query_side_px
    }
}

/// What the network made of a photo under some hypotheses.
#[derive(Debug, Default)]
pub(crate) struct Queries {
    /// The features of each hypothesis.
    pub features: Arc<[QueryFeatures]>,
    /// The network's output for a single hypothesis. It takes more memory than all else: that of many is not kept.
    pub dense: Option<Arc<DenseQuery>>,
    /// Wall time by stage.
    pub time_ms: TimeMs,
}

/// What the queries of one photo depend on. The levels of a map differ in ground resolution: where a ground width is assumed from the
/// width of a tile, the photo is as many pixels wide on every level, and its queries are the same.
#[derive(Debug)]
pub(crate) struct QueryKey {
    /// Width of the photo in query pixels.
    width_px: f64,
    /// Bearing of the photo's top from each query's up, degrees clockwise.
    up_deg: Vec<f64>,
    descriptor_type: DescriptorType,
    purpose: Purpose,
}

impl QueryKey {
    /// Widths that differ by less than this share are the same.
    const SAME_WIDTH: f64 = 1e-6;
    /// Directions that differ by less than this are the same, degrees.
    const SAME_DIRECTION_DEG: f64 = 0.01;

    /// Of these hypotheses, which differ in heading only, on `level`.
    pub fn new(level: &Level, hypotheses: &[Hypothesis], purpose: Purpose) -> Result<Self> {
        let (gsd_m, up_bearing_deg) = (query_gsd_m(level), up_bearing_deg(level)?);
        let wanted = (level.descriptor_type(), purpose);
        Ok(Self::of(hypotheses, gsd_m, up_bearing_deg, wanted))
    }

    /// At `gsd_m` metres per query pixel, where each query's up has this bearing.
    fn of(
        hypotheses: &[Hypothesis],
        gsd_m: f64,
        up_bearing_deg: f64,
        (descriptor_type, purpose): (DescriptorType, Purpose),
    ) -> Self {
        let up_deg = |hypothesis: &Hypothesis| hypothesis.heading_deg - up_bearing_deg;
        Self {
            width_px: hypotheses.first().map_or(0.0, |first| first.width_m) / gsd_m,
            up_deg: hypotheses.iter().map(up_deg).collect(),
            descriptor_type,
            purpose,
        }
    }

    /// Whether the photo gives the same queries.
    pub fn is_same(&self, other: &Self) -> bool {
        (self.descriptor_type, self.purpose) == (other.descriptor_type, other.purpose)
            && (self.width_px / other.width_px - 1.0).abs() < Self::SAME_WIDTH
            && self.up_deg.len() == other.up_deg.len()
            && (self.up_deg.iter().zip(&other.up_deg))
                .all(|(&a, &b)| turn_deg(a, b).abs() < Self::SAME_DIRECTION_DEG)
    }
}

/// Queries of the photo under each hypothesis, for this purpose. The hypotheses differ in heading only.
pub(crate) fn extract_queries(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    (hypotheses, purpose): (&[Hypothesis], Purpose),
    max_side_px: u32,
) -> Result<Queries> {
    let mut time_ms = TimeMs::default();
    let Some(first) = hypotheses.first() else {
        return Ok(Queries::default());
    };
    let since = Instant::now();
    let maker = query_maker(context, photo, view, first, max_side_px)?;
    let level = context.level(first.level);
    let up_bearing_deg = up_bearing_deg(level)?;
    let made: Vec<_> = hypotheses
        .par_iter()
        .map(|hypothesis| maker.make(hypothesis.heading_deg - up_bearing_deg))
        .collect();
    time_ms.query = elapsed_ms(since);
    let since = Instant::now();
    let is_single = made.len() == 1;
    let made: Vec<(QueryFeatures, Option<DenseQuery>)> = made
        .into_par_iter()
        .map(|query| {
            let (features, dense) = QueryFeatures::extract(
                (context.extractor, purpose),
                &query.image,
                Some(&query.mask),
                query.photo_px_from_query_px,
                level.descriptor_type(),
                context.options,
            )?;
            let mask = query.mask;
            Ok((features, is_single.then_some(DenseQuery { dense, mask })))
        })
        .collect::<Result<_>>()?;
    time_ms.features = elapsed_ms(since);
    let (features, dense): (Vec<QueryFeatures>, Vec<_>) = made.into_iter().unzip();
    Ok(Queries {
        features: features.into(),
        dense: dense.into_iter().flatten().next().map(Arc::new),
        time_ms,
    })
}

/// Prepares queries at the resolution of the hypothesis' level.
pub(crate) fn query_maker(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    hypothesis: &Hypothesis,
    max_side_px: u32,
) -> Result<QueryMaker> {
    let gsd_m = query_gsd_m(context.level(hypothesis.level));
    let options = QueryOptions {
        tilt: view.tilt,
        ..QueryOptions::new(gsd_m, hypothesis.width_m)
    };
    let options = QueryOptions {
        max_side_px: options.max_side_px.min(max_side_px),
        ..options
    };
    Ok(photo.query_maker(&options)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hypotheses(width_m: f64, headings_deg: &[f64]) -> Vec<Hypothesis> {
        let hypothesis = |&heading_deg: &f64| Hypothesis {
            level: 0,
            width_m,
            heading_deg,
            heading_reach_deg: 30.0,
            stated: None,
            is_width_searched: false,
        };
        headings_deg.iter().map(hypothesis).collect()
    }

    #[test]
    fn photos_as_many_pixels_wide_and_turned_alike_give_the_same_queries() {
        let drawn = |width_m, headings_deg: &[f64], gsd_m, up_bearing_deg| {
            let wanted = (DescriptorType::Int8, Purpose::Answer);
            let hypotheses = hypotheses(width_m, headings_deg);
            QueryKey::of(&hypotheses, gsd_m, up_bearing_deg, wanted)
        };
        let first = drawn(80.0, &[0.0, 180.0], 0.2, 0.0);
        // A coarser level; one whose up lies just west of north.
        assert!(first.is_same(&drawn(160.0, &[0.0, 180.0], 0.4, 0.0)));
        assert!(first.is_same(&drawn(80.0, &[0.0, 180.0], 0.2, 359.995)));
        // Another width, other directions, more of them.
        assert!(!first.is_same(&drawn(160.0, &[0.0, 180.0], 0.2, 0.0)));
        assert!(!first.is_same(&drawn(80.0, &[0.0, 170.0], 0.2, 0.0)));
        assert!(!first.is_same(&drawn(80.0, &[0.0, 180.0], 0.2, 1.0)));
        assert!(!first.is_same(&drawn(80.0, &[0.0, 90.0, 180.0], 0.2, 0.0)));
        // Another purpose.
        let search = QueryKey {
            purpose: Purpose::Search,
            ..drawn(80.0, &[0.0, 180.0], 0.2, 0.0)
        };
        assert!(!first.is_same(&search));
    }
}
