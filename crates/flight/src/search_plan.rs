//! From what the track knows to the priors of the searches of one frame.

use grimnet_geo::{LonLat, destination_en_m, offset_en_m, turn_deg};
use grimnet_locate::{Near, Prior};
use grimnet_photo::{HeadingPrior, View};
use grimnet_track::{Search, SearchWindow};

use crate::frame::Searched;

/// A window's heading reaches so many standard deviations ([`SearchWindow::heading_deg`]).
const WINDOW_HEADING_SIGMAS: f64 = 3.0;
/// If the position is uncertain, so is the heading that comes with it: from this 1-sigma on, the localiser tries other headings
/// after it, degrees.
const UNCERTAIN_HEADING_SIGMA_DEG: f64 = 9.0;
/// A ground resolution is given to the localiser if it is known to this factor: matching tolerates it.
const LARGEST_GSD_FACTOR: f64 = 1.35;
/// Two windows of one heading: their ranges may differ by this, degrees.
const SAME_HEADING_DEG: f64 = 10.0;

/// One search: what the localiser is given, and where that makes it look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlannedSearch {
    pub prior: Prior,
    pub searched: Searched,
}

/// What steers the searches of a frame, besides the track's windows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Steering<'a> {
    /// What the caller knows.
    pub known: Prior,
    /// The photo's view according to that and to its metadata.
    pub view: &'a View,
    /// Bearing of the photo's top by the telemetry's yaw at the exposure and its 1-sigma, degrees.
    pub top_deg: Option<(f64, f64)>,
    /// Whether fixes confirmed that yaw before a gap and none since: it may have been reset.
    pub yaw_is_in_doubt: bool,
    /// Whether the whole map is searched under every heading, too, in case that yaw is wrong.
    pub tests_yaw: bool,
    /// Whether the whole map is searched at every scale, too, in case that height is wrong.
    pub tests_height: bool,
    /// Height above ground of the telemetry, metres, for photos that nothing else tells the scale of.
    pub height_agl_m: Option<f64>,
    /// Metres that a photo pixel covers straight below at that height. `None` if the focal length or the height is not known.
    pub gsd_of_height_m: Option<f64>,
    /// Whether the whole map is searched after the windows. Without windows it is in any case.
    pub whole_map: bool,
    /// Photo pixels for one pixel of the focal length that the track's ground resolutions refer to.
    pub px_per_reference_px: f64,
}

/// The searches of a frame, in this order, until one gives a fix.
pub(crate) fn plan(search: &Search, steering: &Steering<'_>) -> Vec<PlannedSearch> {
    let mut searches = Vec::new();
    if let Some(window) = joined(&search.windows) {
        let as_tracked = in_window(&window, steering);
        searches.push(as_tracked);
        searches.extend(at_reported_height(as_tracked, steering));
    }
    if searches.is_empty() || steering.whole_map {
        let as_steered = on_whole_map(search.windows.first(), steering);
        searches.push(as_steered);
        let yaw_is_reported =
            steering.top_deg.is_some() && steering.known.view.heading == HeadingPrior::FromMetadata;
        let mut freed = as_steered;
        if yaw_is_reported && steering.tests_yaw {
            freed.prior.view.heading = HeadingPrior::Unknown;
            searches.push(freed);
        }
        let height_is_reported = as_steered.prior.view.height_agl_m.is_some()
            && steering.known.view.height_agl_m.is_none();
        if height_is_reported && steering.tests_height {
            freed.prior.view.height_agl_m = None;
            searches.push(freed);
        }
    }
    searches
}

fn in_window(window: &SearchWindow, steering: &Steering<'_>) -> PlannedSearch {
    let near = Near {
        centre: window.centre,
        radius_m: window.radius_m,
    };
    let mut prior = Prior {
        near: Some(near),
        ..steering.known
    };
    set_heading(&mut prior, steering, window.heading_deg, 0.0);
    set_gsd(&mut prior, steering, window.gsd_m);
    PlannedSearch {
        prior,
        searched: Searched::Window {
            centre: near.centre,
            radius_m: near.radius_m,
        },
    }
}

/// The same search with the height of the telemetry, if that contradicts the track's ground resolution: the ground may have fallen away
/// below the aircraft.
fn at_reported_height(as_tracked: PlannedSearch, steering: &Steering<'_>) -> Option<PlannedSearch> {
    if steering.known.view.gsd_m.is_some() || steering.view.footprint.is_some() {
        return None;
    }
    let of_track_m = as_tracked.prior.view.gsd_m?;
    let factor = steering.gsd_of_height_m? / of_track_m;
    let mut search = as_tracked;
    search.prior.view.gsd_m = None;
    search.prior.view.height_agl_m = steering.height_agl_m;
    (factor.ln().abs() > LARGEST_GSD_FACTOR.ln()).then_some(search)
}

fn on_whole_map(leading: Option<&SearchWindow>, steering: &Steering<'_>) -> PlannedSearch {
    let mut prior = steering.known;
    let heading_deg = leading.and_then(|window| window.heading_deg);
    // What was measured at this frame stays true wherever it was taken; what comes from earlier frames may not.
    if prior.view.heading == HeadingPrior::FromMetadata
        && let Some((heading_deg, sigma_deg)) = steering.top_deg
    {
        prior = prior.with_heading(heading_deg, sigma_deg);
    } else if steering.view.heading.is_none() {
        set_heading(
            &mut prior,
            steering,
            heading_deg,
            UNCERTAIN_HEADING_SIGMA_DEG,
        );
    }
    set_gsd(
        &mut prior,
        steering,
        leading.and_then(|window| window.gsd_m),
    );
    PlannedSearch {
        prior,
        searched: Searched::WholeMap,
    }
}

/// The heading of the track, else of the telemetry, unless the caller states one.
fn set_heading(
    prior: &mut Prior,
    steering: &Steering<'_>,
    of_track_deg: Option<(f64, f64)>,
    least_sigma_deg: f64,
) {
    if matches!(prior.view.heading, HeadingPrior::Known { .. }) {
        return;
    }
    let of_track_deg =
        of_track_deg.map(|(heading_deg, side_deg)| (heading_deg, side_deg / WINDOW_HEADING_SIGMAS));
    // Windows of different headings tell none; of a yaw in doubt, the fix that contradicts it may be right.
    let top_deg = steering.top_deg.filter(|_| !steering.yaw_is_in_doubt);
    if let Some((heading_deg, sigma_deg)) = of_track_deg.or(top_deg) {
        *prior = prior.with_heading(heading_deg, sigma_deg.max(least_sigma_deg));
    }
}

/// The ground resolution of the track, unless the caller states one or it is too uncertain; else the height of the telemetry.
fn set_gsd(prior: &mut Prior, steering: &Steering<'_>, range_m: Option<(f64, f64)>) {
    let view = &mut prior.view;
    if view.gsd_m.is_some() || view.height_agl_m.is_some() {
        return;
    }
    if let Some((low_m, high_m)) = range_m
        && low_m > 0.0
        && high_m / low_m <= LARGEST_GSD_FACTOR * LARGEST_GSD_FACTOR
    {
        view.gsd_m = Some((low_m * high_m).sqrt() / steering.px_per_reference_px);
    } else if steering.view.footprint.is_none() {
        view.height_agl_m = steering.height_agl_m;
    }
}

/// All windows as one, so that the places that they stand for compete in one search: the smallest circles that hold two after
/// two, with the heading and ground resolution of the likeliest if the others agree with them.
fn joined(windows: &[SearchWindow]) -> Option<SearchWindow> {
    let (first, others) = windows.split_first()?;
    Some(others.iter().fold(*first, |all, window| {
        let (centre, radius_m) =
            circle_around((all.centre, all.radius_m), (window.centre, window.radius_m));
        let heading_deg = all
            .heading_deg
            .zip(window.heading_deg)
            .filter(|((a, _), (b, _))| turn_deg(*a, *b).abs() < SAME_HEADING_DEG)
            .map(|((a, side_a), (_, side_b))| (a, side_a.max(side_b)));
        let gsd_m = all
            .gsd_m
            .zip(window.gsd_m)
            .map(|((low_a, high_a), (low_b, high_b))| (low_a.min(low_b), high_a.max(high_b)));
        SearchWindow {
            centre,
            radius_m,
            heading_deg,
            gsd_m,
            weight: all.weight + window.weight,
        }
    }))
}

/// The smallest circle that holds two circles.
fn circle_around(a: (LonLat, f64), b: (LonLat, f64)) -> (LonLat, f64) {
    let (east_m, north_m) = offset_en_m(a.0, b.0);
    let apart_m = east_m.hypot(north_m);
    if apart_m + b.1 <= a.1 {
        return a;
    }
    if apart_m + a.1 <= b.1 {
        return b;
    }
    let radius_m = (apart_m + a.1 + b.1) / 2.0;
    let share = (radius_m - a.1) / apart_m;
    (
        destination_en_m(a.0, share * east_m, share * north_m),
        radius_m,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_geo::distance_m;
    use grimnet_photo::{Heading, ViewPrior};

    const HERE: LonLat = LonLat::new(120.7, 24.2);

    fn window(east_m: f64, heading_deg: f64) -> SearchWindow {
        SearchWindow {
            centre: destination_en_m(HERE, east_m, 0.0),
            radius_m: 80.0,
            heading_deg: Some((heading_deg, 6.0)),
            gsd_m: Some((0.045, 0.055)),
            weight: 0.5,
        }
    }

    fn steering(view: &View) -> Steering<'_> {
        Steering {
            known: Prior::none(),
            view,
            top_deg: None,
            yaw_is_in_doubt: false,
            tests_yaw: false,
            tests_height: false,
            height_agl_m: None,
            gsd_of_height_m: None,
            whole_map: false,
            px_per_reference_px: 1.0,
        }
    }

    #[test]
    fn a_tracked_frame_is_one_search_with_heading_and_scale() {
        let search = Search {
            windows: vec![window(0.0, 90.0)],
            whole_map: false,
        };
        let plan = plan(&search, &steering(&View::default()));
        assert_eq!(plan.len(), 1);
        let prior = plan[0].prior;
        assert_eq!(prior.near.unwrap().radius_m, 80.0);
        assert_eq!(
            prior.view.heading,
            HeadingPrior::Known {
                heading_deg: 90.0,
                sigma_deg: 2.0
            }
        );
        assert!((prior.view.gsd_m.unwrap() - 0.0497).abs() < 1e-3);
    }

    #[test]
    fn a_height_that_contradicts_the_tracks_scale_is_tried_as_well() {
        let view = View::default();
        let search = Search {
            windows: vec![window(0.0, 90.0)],
            whole_map: false,
        };
        let searches = |gsd_of_height_m: Option<f64>| {
            let steering = Steering {
                height_agl_m: Some(100.0),
                gsd_of_height_m,
                ..steering(&view)
            };
            plan(&search, &steering)
        };
        for agrees in [None, Some(0.05), Some(0.06), Some(0.04)] {
            assert_eq!(searches(agrees).len(), 1, "{agrees:?}");
        }
        for contradicts in [0.1, 0.025] {
            let searches = searches(Some(contradicts));
            assert_eq!(searches.len(), 2);
            let [of_track, of_height] = [0, 1].map(|number: usize| searches[number].prior.view);
            assert_eq!((of_track.height_agl_m, of_height.gsd_m), (None, None));
            assert_eq!(of_height.height_agl_m, Some(100.0));
            assert_eq!(searches[0].prior.near, searches[1].prior.near);
        }
    }

    #[test]
    fn what_the_caller_states_stays() {
        let search = Search {
            windows: vec![window(0.0, 90.0)],
            whole_map: true,
        };
        let view = View::default();
        let steering = Steering {
            whole_map: true,
            known: Prior::none().with_heading(200.0, 5.0).with_gsd_m(0.1),
            top_deg: Some((10.0, 8.0)),
            ..steering(&view)
        };
        let searches = plan(&search, &steering);
        assert_eq!(searches.len(), 2);
        for search in searches {
            assert_eq!(search.prior.view, steering.known.view);
        }
    }

    #[test]
    fn nothing_known_is_one_search_of_the_whole_map_as_the_caller_limits_it() {
        let known = Prior::none().near(HERE, 500.0);
        let view = View::default();
        let steering = Steering {
            known,
            ..steering(&view)
        };
        let plan = plan(&Search::default(), &steering);
        assert_eq!(plan.len(), 1);
        assert_eq!(plan[0].prior, known);
        assert_eq!(plan[0].searched, Searched::WholeMap);
    }

    #[test]
    fn a_yaw_that_may_be_wrong_is_tested_on_the_whole_map_under_every_heading() {
        let view = View::default();
        let reported = Steering {
            top_deg: Some((10.0, 8.0)),
            tests_yaw: true,
            ..steering(&view)
        };
        let searches = plan(&Search::default(), &reported);
        assert_eq!(searches.len(), 2);
        assert_eq!(searches[1].prior.view.heading, HeadingPrior::Unknown);
        let stated = Steering {
            known: Prior::none().with_heading(200.0, 5.0),
            ..reported
        };
        assert_eq!(plan(&Search::default(), &stated).len(), 1);
        let without = Steering {
            top_deg: None,
            ..reported
        };
        assert_eq!(plan(&Search::default(), &without).len(), 1);
    }

    #[test]
    fn a_yaw_in_doubt_is_not_used_where_windows_have_different_headings() {
        let view = View::default();
        let search = Search {
            windows: vec![window(0.0, 90.0), window(10.0, 210.0)],
            whole_map: false,
        };
        let heading_of = |yaw_is_in_doubt| {
            let steering = Steering {
                top_deg: Some((210.0, 8.0)),
                yaw_is_in_doubt,
                ..steering(&view)
            };
            plan(&search, &steering)[0].prior.view.heading
        };
        let reported = HeadingPrior::Known {
            heading_deg: 210.0,
            sigma_deg: 8.0,
        };
        assert_eq!(heading_of(false), reported);
        assert_eq!(heading_of(true), HeadingPrior::FromMetadata);
    }

    #[test]
    fn a_height_that_may_be_wrong_is_tested_on_the_whole_map_at_every_scale() {
        let view = View::default();
        let reported = Steering {
            height_agl_m: Some(380.0),
            tests_height: true,
            ..steering(&view)
        };
        let searches = plan(&Search::default(), &reported);
        let heights = searches.iter().map(|search| search.prior.view.height_agl_m);
        assert_eq!(heights.collect::<Vec<_>>(), [Some(380.0), None]);
        let stated = Steering {
            known: Prior {
                view: ViewPrior {
                    height_agl_m: Some(115.0),
                    ..ViewPrior::default()
                },
                ..Prior::none()
            },
            ..reported
        };
        assert_eq!(plan(&Search::default(), &stated).len(), 1);
    }

    #[test]
    fn on_the_whole_map_a_heading_of_this_frame_is_better_than_one_of_the_track() {
        let search = Search {
            windows: vec![window(0.0, 90.0)],
            whole_map: true,
        };
        let heading_of = |steering: &Steering<'_>| {
            let steering = Steering {
                whole_map: true,
                ..*steering
            };
            plan(&search, &steering)[1].prior.view.heading
        };
        let unknown = View::default();
        assert_eq!(
            heading_of(&steering(&unknown)),
            HeadingPrior::Known {
                heading_deg: 90.0,
                sigma_deg: UNCERTAIN_HEADING_SIGMA_DEG
            }
        );
        let recorded = View {
            heading: Some(Heading {
                heading_deg: 30.0,
                sigma_deg: 5.0,
            }),
            ..View::default()
        };
        assert_eq!(heading_of(&steering(&recorded)), HeadingPrior::FromMetadata);
        let reported = Steering {
            top_deg: Some((45.0, 8.0)),
            ..steering(&unknown)
        };
        assert_eq!(
            heading_of(&reported),
            HeadingPrior::Known {
                heading_deg: 45.0,
                sigma_deg: 8.0
            }
        );
    }

    #[test]
    fn windows_of_several_places_are_one_search_that_holds_them() {
        let windows = [window(0.0, 90.0), window(400.0, 92.0), window(0.0, 300.0)];
        let two = joined(&windows[..2]).unwrap();
        assert!((two.radius_m - 280.0).abs() < 1e-6);
        for window in &windows[..2] {
            let reach_m = distance_m(two.centre, window.centre) + window.radius_m;
            assert!(reach_m < two.radius_m + 1e-3);
        }
        assert_eq!(two.heading_deg, Some((90.0, 6.0)));
        let three = joined(&windows).unwrap();
        assert_eq!(three.radius_m, two.radius_m);
        assert_eq!(three.heading_deg, None);
        assert_eq!(joined(&[]), None);
    }

    #[test]
    fn a_scale_that_nothing_measured_for_long_is_not_given() {
        let wide = SearchWindow {
            gsd_m: Some((0.02, 0.1)),
            ..window(0.0, 90.0)
        };
        let search = Search {
            windows: vec![wide],
            whole_map: false,
        };
        let plan = plan(&search, &steering(&View::default()));
        assert_eq!(plan[0].prior.view.gsd_m, None);
    }

    #[test]
    fn without_any_scale_the_height_of_the_telemetry_is_given() {
        let view = View::default();
        let steering = Steering {
            height_agl_m: Some(120.0),
            ..steering(&view)
        };
        let plan = plan(&Search::default(), &steering);
        assert_eq!(plan[0].prior.view.height_agl_m, Some(120.0));
    }
}
