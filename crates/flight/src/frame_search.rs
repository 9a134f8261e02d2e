//! The searches of one frame.

use grimnet_locate::{FrameFeatures, Localizer, LocateError, Outcome, Prior, Reason};
use grimnet_photo::Photo;

use crate::frame::Searched;
use crate::search_plan::PlannedSearch;

/// What the searches of a frame gave.
pub(crate) struct Found {
    pub outcome: Result<Outcome, LocateError>,
    pub features: Option<FrameFeatures>,
    /// The search that gave the outcome.
    pub searched: Searched,
    /// How many searches the frame took.
    pub searches: u32,
    /// Whether the whole map was searched, or would have been after the windows.
    pub whole_map_was_searched: bool,
}

/// Searches one plan after the other until one gives a fix or no other can. `whole_map_is_due`: the plans end with the whole map.
pub(crate) fn search_frame(
    localizer: &Localizer,
    photo: &Photo,
    searches: &[PlannedSearch],
    whole_map_is_due: bool,
) -> Found {
    let mut count = 0;
    let mut last = None;
    let mut first_features = None;
    for planned in searches {
        count += 1;
        let (outcome, features) = locate(localizer, photo, &planned.prior);
        // Those of the fix, else of the first search, whose heading is the most probable.
        if matches!(outcome, Ok(Outcome::Fix(_))) || first_features.is_none() {
            first_features = features;
        }
        let ends = match &outcome {
            Ok(Outcome::Fix(_)) | Err(_) => true,
            Ok(Outcome::NoFix(no_fix)) => is_without_texture(&no_fix.reason),
        };
        last = Some((outcome, planned.searched));
        if ends {
            break;
        }
    }
    // A plan has one search at least.
    let (outcome, searched) = last.unwrap_or_else(|| {
        let (outcome, features) = locate(localizer, photo, &Prior::none());
        first_features = features;
        (outcome, Searched::WholeMap)
    });
    Found {
        outcome,
        features: first_features,
        searched,
        searches: count,
        whole_map_was_searched: whole_map_is_due || matches!(searched, Searched::WholeMap),
    }
}

fn locate(
    localizer: &Localizer,
    photo: &Photo,
    prior: &Prior,
) -> (Result<Outcome, LocateError>, Option<FrameFeatures>) {
    match localizer.locate_with_features(photo, prior) {
        Ok((outcome, features)) => (Ok(outcome), features),
        Err(error) => (Err(error), None),
    }
}

/// Whether there is nothing in the photo that could be found anywhere.
pub(crate) fn is_without_texture(reason: &Reason) -> bool {
    matches!(reason, Reason::TooFewKeypoints { .. })
}
