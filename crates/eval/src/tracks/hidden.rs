//! Photos of a real flight in order of time: one to four fixes in a row are hidden from the filter and predicted from the motion
//! between the photos.

use grimnet_flight::position_fix;
use grimnet_geo::{LonLat, distance_m};
use grimnet_locate::{FrameFeatures, FramePair, Localizer, LocateError, Outcome, Prior};
use grimnet_photo::Photo;
use grimnet_track::measure::Instant;
use grimnet_track::{
    Input, Miss, OptionsError, PositionFix, RelativeMotion, TrackOptions, TrackPoint, Tracker,
};
use serde::Serialize;

use crate::scene::{HeadingMode, Shot};

/// The most fixes that are hidden in a row.
pub const MOST_HIDDEN: usize = 4;
/// Fixes before the first one that is hidden: the filter must have found itself.
const FIXES_BEFORE: usize = 5;

/// Why a flight cannot be evaluated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HiddenError {
    /// A photo cannot be searched.
    #[error(transparent)]
    Locate(#[from] LocateError),
    /// The filter's options.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// A photo has no time.
    #[error(
        "{photo}: no time in its EXIF (DateTimeOriginal); photos must have one to be put in order"
    )]
    NoTime {
        /// Name of the photo.
        photo: String,
    },
    /// Too few photos.
    #[error("{found} photos; at least {needed} are needed to hide fixes of a flight")]
    TooFew {
        /// Photos.
        found: usize,
        /// The least number.
        needed: usize,
    },
}

/// A photo of the flight, its place and when it was taken.
#[derive(Debug, Clone)]
pub struct TimedShot {
    /// Name.
    pub name: String,
    /// Exposure time, seconds since 1970-01-01.
    pub time_s: f64,
    /// True image centre.
    pub truth: LonLat,
    /// What is known of the view.
    pub known: Prior,
}

impl TimedShot {
    /// A photo of a scene, whose heading is given.
    ///
    /// # Errors
    /// [`HiddenError::NoTime`].
    pub fn new(shot: &Shot, photo: &Photo) -> Result<Self, HiddenError> {
        let exposed = photo.metadata.exposure_time;
        let exposed = exposed.ok_or_else(|| HiddenError::NoTime {
            photo: shot.name.clone(),
        })?;
        Ok(Self {
            name: shot.name.clone(),
            time_s: exposed.unix_s,
            truth: shot.truth.position,
            known: shot.prior(HeadingMode::Known, photo.full_size_px),
        })
    }
}

/// A photo that was searched, and the motion from the one before.
#[derive(Debug, Clone)]
struct Searched {
    time_s: f64,
    truth: LonLat,
    fix: Option<PositionFix>,
    motion: Option<RelativeMotion>,
}

/// A prediction of a hidden fix.
#[derive(Debug, Clone, Serialize)]
pub struct Prediction {
    /// The photo whose fix is predicted.
    pub photo: String,
    /// Fixes hidden up to it, its own included.
    pub hidden: usize,
    /// Time since the last fix that was not hidden, seconds.
    pub since_fix_s: f64,
    /// Distance flown since, metres, as the straight line between the true places.
    pub distance_m: f64,
    /// Whether all photos since were joined by motion between them.
    pub joined: bool,
    /// Error of the filter, metres; `None` where it gives no usable position.
    pub filter_m: Option<f64>,
    /// Its stated 95 % radius, metres.
    pub radius95_m: Option<f64>,
    /// Squared normalised error.
    #[serde(skip)]
    pub(super) nees: Option<f64>,
    /// Error of the last fix held, metres.
    pub last_fix_m: Option<f64>,
    /// Error of the motion added up from the true place of the last fix that was not hidden, metres; `None` where a photo was not joined.
    pub motion_only_m: Option<f64>,
}

/// Hides fixes and predicts them. `open` reads a photo; `done` is called after each.
///
/// # Errors
/// [`HiddenError`], or what `open` returns.
pub fn predict_hidden<E: From<HiddenError>>(
    localizer: &Localizer,
    shots: &[TimedShot],
    options: &TrackOptions,
    open: &mut dyn FnMut(usize) -> Result<Photo, E>,
) -> Result<Vec<Prediction>, E> {
    let needed = FIXES_BEFORE + MOST_HIDDEN;
    if shots.len() < needed {
        let found = shots.len();
        return Err(HiddenError::TooFew { found, needed }.into());
    }
    let mut searched: Vec<Searched> = Vec::with_capacity(shots.len());
    let mut before: Option<FrameFeatures> = None;
    for (index, shot) in shots.iter().enumerate() {
        let photo = open(index)?;
        let last_s = searched.last().map(|last| last.time_s);
        let (found, features) = search(localizer, shot, &photo, before.as_ref().zip(last_s))
            .map_err(HiddenError::from)?;
        before = features;
        searched.push(found);
    }
    let mut predictions = Vec::new();
    for first in FIXES_BEFORE..shots.len() {
        for hidden in 1..=MOST_HIDDEN.min(shots.len() - first) {
            let prediction = predict(
                &searched,
                first,
                hidden,
                &shots[first + hidden - 1],
                options,
            )
            .map_err(HiddenError::from)?;
            predictions.extend(prediction);
        }
    }
    Ok(predictions)
}

/// Searches a photo and measures the motion from the one before.
fn search(
    localizer: &Localizer,
    shot: &TimedShot,
    photo: &Photo,
    before: Option<(&FrameFeatures, f64)>,
) -> Result<(Searched, Option<FrameFeatures>), LocateError> {
    let (outcome, mut features) = localizer.locate_with_features(photo, &shot.known)?;
    // Neither attitude nor height is given, so places are those of image centres, and the motion is that of the centres: it needs
    // no focal length.
    let pair = FramePair {
        focal_length_px: f64::from(photo.full_size_px.0),
        tilts: None,
        tilt_change_sigma_deg: 0.0,
    };
    let motion = match (before, &mut features) {
        (Some((before, from_time_s)), Some(features)) => localizer
            .motion_between(before, features, &pair)?
            .filter(|_| from_time_s < shot.time_s)
            .map(|motion| RelativeMotion {
                from_time_s,
                time_s: shot.time_s,
                forward_px: motion.forward_px,
                right_px: motion.right_px,
                turn_deg: motion.turn_deg,
                sigma_px: motion.sigma_px(),
                surface_sigma_px: motion.surface_sigma_px,
            }),
        _ => None,
    };
    let map_error_m = localizer.options().map_error_m;
    let fix = match outcome {
        Outcome::Fix(fix) => Some(position_fix(&fix, shot.time_s, map_error_m)),
        Outcome::NoFix(_) => None,
    };
    let searched = Searched {
        time_s: shot.time_s,
        truth: shot.truth,
        fix,
        motion,
    };
    Ok((searched, features))
}

/// Predicts the fix of photo `first + hidden - 1` from all photos, without the fixes from `first` on. `None` if the photo before
/// has no fix itself.
fn predict(
    searched: &[Searched],
    first: usize,
    hidden: usize,
    shot: &TimedShot,
    options: &TrackOptions,
) -> Result<Option<Prediction>, OptionsError> {
    let Some(last) = searched[first - 1].fix else {
        return Ok(None);
    };
    let mut tracker = Tracker::new(options.clone())?;
    let until = first + hidden;
    for (index, photo) in searched[..until].iter().enumerate() {
        let fix = photo.fix.filter(|_| index < first);
        let inputs = [
            photo.motion.map(Input::Motion),
            Some(match fix {
                Some(fix) => Input::Fix(fix),
                None => Input::Miss(Miss {
                    time_s: photo.time_s,
                }),
            }),
        ];
        for input in inputs.into_iter().flatten() {
            // What is refused is counted by the tracker.
            let _ = tracker.push(input);
        }
    }
    let at = &searched[until - 1];
    let point: Option<TrackPoint> = tracker.point_at(at.time_s);
    let answer = Instant::of(point.as_ref(), at.time_s, at.truth).answer;
    let path = &searched[first..until];
    Ok(Some(Prediction {
        photo: shot.name.clone(),
        hidden,
        since_fix_s: at.time_s - last.time_s,
        distance_m: distance_m(searched[first - 1].truth, at.truth),
        joined: path.iter().all(|photo| photo.motion.is_some()),
        filter_m: answer.map(|answer| answer.error_m()),
        radius95_m: answer.map(|answer| answer.radius95_m),
        nees: answer.and_then(|answer| answer.nees()),
        last_fix_m: Some(distance_m(last.lonlat, at.truth)),
        motion_only_m: motion_only(&last, searched[first - 1].truth, path)
            .map(|place| distance_m(place, at.truth)),
    }))
}

/// The place after all motions of `path`, from a true place; heading and scale are those of the last fix.
fn motion_only(last: &PositionFix, from: LonLat, path: &[Searched]) -> Option<LonLat> {
    let mut heading_deg = last.heading_deg?;
    let (mut east_m, mut north_m) = (0.0, 0.0);
    for photo in path {
        let motion = photo.motion?;
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        east_m += (motion.forward_px * sin + motion.right_px * cos) * last.gsd_m;
        north_m += (motion.forward_px * cos - motion.right_px * sin) * last.gsd_m;
        heading_deg += motion.turn_deg;
    }
    Some(grimnet_geo::destination_en_m(from, east_m, north_m))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use grimnet_photo::{ExposureTime, Metadata};
    use image::RgbImage;

    use super::*;
    use crate::scene::{PhotoSource, Truth};

    /// Photos every 20 s, 60 m to the north each, joined by exact motions.
    fn photos() -> Vec<Searched> {
        let start = LonLat::new(120.7, 24.2);
        (0..12)
            .map(|index| {
                let time_s = 20.0 * f64::from(index);
                let truth = grimnet_geo::destination_en_m(start, 0.0, 60.0 * f64::from(index));
                Searched {
                    time_s,
                    truth,
                    fix: Some(PositionFix {
                        time_s,
                        lonlat: truth,
                        covariance_en_m2: [0.25, 0.0, 0.25],
                        map_error_m: 1.0,
                        heading_deg: Some(90.0),
                        gsd_m: 0.05,
                        confidence: 0.99,
                    }),
                    // North is to the left of a photo whose top is east: 60 m are 1200 px.
                    motion: (index > 0).then_some(RelativeMotion {
                        from_time_s: time_s - 20.0,
                        time_s,
                        forward_px: 0.0,
                        right_px: -1200.0,
                        turn_deg: 0.0,
                        sigma_px: 2.0,
                        surface_sigma_px: Some(0.0),
                    }),
                }
            })
            .collect()
    }

    #[test]
    fn photos_of_one_second_are_apart_by_its_fractions() {
        let shot = |unix_s: Option<f64>| {
            let metadata = Metadata {
                exposure_time: unix_s.map(|unix_s| ExposureTime {
                    unix_s,
                    has_fraction: true,
                    has_zone: false,
                }),
                orientation: 1,
                ..Metadata::default()
            };
            let photo = Photo::from_image(RgbImage::new(8, 6), metadata);
            let shot = Shot {
                name: "x".into(),
                photo: PhotoSource::Memory(Arc::new(photo.clone())),
                truth: Truth::at(LonLat::new(120.7, 24.2)),
                known: Prior::none(),
                footprint_width_m: None,
            };
            TimedShot::new(&shot, &photo)
        };
        let [first, second] = [7.25, 7.75].map(|unix_s| shot(Some(unix_s)).unwrap().time_s);
        assert_eq!(second - first, 0.5);
        assert!(matches!(shot(None), Err(HiddenError::NoTime { .. })));
    }

    #[test]
    fn hidden_fixes_are_predicted_by_motion() {
        let photos = photos();
        let shot = TimedShot {
            name: "x".into(),
            time_s: 0.0,
            truth: photos[0].truth,
            known: Prior::none(),
        };
        let at = |photos: &[Searched]| {
            predict(photos, 8, 2, &shot, &TrackOptions::default())
                .unwrap()
                .unwrap()
        };
        let predicted = at(&photos);
        assert!(
            predicted.joined && predicted.motion_only_m.unwrap() < 0.1,
            "{predicted:?}"
        );
        assert!(predicted.filter_m.unwrap() < 3.0, "{predicted:?}");
        assert!((predicted.last_fix_m.unwrap() - 120.0).abs() < 0.1);
        assert_eq!(predicted.since_fix_s, 40.0);
        // A photo that could not be joined leaves its step to the filter's velocity, and its radius says so.
        let mut broken = photos;
        broken[9].motion = None;
        let lost = at(&broken);
        assert!(!lost.joined && lost.motion_only_m.is_none());
        assert!(
            lost.radius95_m
                .is_none_or(|radius| radius > 2.0 * predicted.radius95_m.unwrap()),
            "{lost:?}"
        );
    }
}
