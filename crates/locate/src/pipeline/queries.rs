//! Queries: the photo resampled and rotated for each hypothesis, with its features.

use std::time::Instant;

use grimnet_net::Purpose;
use grimnet_photo::{Photo, QueryMaker, QueryOptions, View};
use rayon::prelude::*;

use crate::{
    context::Context,
    dense_query::DenseQuery,
    error::Result,
    outcome::{TimeMs, elapsed_ms},
    pipeline::tile_frame::level_px_per_query_px,
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
    pub features: Vec<QueryFeatures>,
    /// The network's output for a single hypothesis. It takes more memory than all else: that of many is not kept.
    pub dense: Option<DenseQuery>,
    /// Wall time by stage.
    pub time_ms: TimeMs,
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
    let georeference = level.georeference();
    let up_bearing_deg = georeference.up_bearing_deg(georeference.centre_px())?;
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
    let (features, dense): (Vec<_>, Vec<_>) = made.into_iter().unzip();
    Ok(Queries {
        features,
        dense: dense.into_iter().flatten().next(),
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
    let level = context.level(hypothesis.level);
    let gsd_m = level.gsd_m() * level_px_per_query_px(level);
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
