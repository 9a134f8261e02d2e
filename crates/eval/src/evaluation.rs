//! The evaluation loop: every photo of a scene is opened, localised and compared with its truth.

use std::collections::BTreeMap;
use std::time::Instant;

use grimnet_locate::{Localizer, Outcome, Prior, TimeMs, Trace};
use grimnet_photo::{Metadata, Photo, PhotoError, QUERY_LONG_SIDE_PX};

use crate::metrics::{Frame, ScoredFix, rounded};
use crate::scene::{HeadingMode, Shot};

/// Error of a method that localises.
pub type MethodError = Box<dyn std::error::Error + Send + Sync>;

/// A way to localise photos: the localiser, or something that it is compared with.
pub trait Method {
    /// Localises one photo.
    ///
    /// # Errors
    /// Returns an error if the photo or what is known of it is refused.
    fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError>;

    /// The least long side, px, of a photo with these metadata and this full size as displayed, px, that the method can use.
    fn needed_long_side_px(
        &self,
        _metadata: &Metadata,
        _full_size_px: (u32, u32),
        _prior: &Prior,
    ) -> u32 {
        QUERY_LONG_SIDE_PX
    }
}

/// What a method found.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// The fix, if there is one.
    pub fix: Option<ScoredFix>,
    /// Why there is no fix.
    pub reason: Option<String>,
    /// Stated probability that the fix is right.
    pub confidence: Option<f64>,
    /// Matches that are consistent with the answer.
    pub inliers: Option<usize>,
    /// Ground metres per pixel of the photo at full size, by the fix.
    pub gsd_m: Option<f64>,
    /// Time by stage and in `total`, milliseconds; empty if the method does not measure it.
    pub stage_ms: BTreeMap<String, f64>,
    /// The localiser's answer; `None` for other methods.
    pub outcome: Option<Outcome>,
    /// The localiser's search; `None` for other methods.
    pub trace: Option<Trace>,
}

impl Found {
    /// An answer of the localiser.
    #[must_use]
    pub fn of(outcome: Outcome, trace: Trace) -> Self {
        let found = match &outcome {
            Outcome::Fix(fix) => Self {
                fix: Some(ScoredFix::of(fix)),
                confidence: fix.confidence.map(|value| rounded(value, 6)),
                inliers: Some(fix.inliers),
                gsd_m: Some(fix.gsd_m),
                stage_ms: stage_ms(&fix.time_ms),
                ..Self::default()
            },
            Outcome::NoFix(no_fix) => Self {
                reason: Some(no_fix.reason.to_string()),
                inliers: Some(no_fix.inliers),
                stage_ms: stage_ms(&no_fix.time_ms),
                ..Self::default()
            },
        };
        Self {
            outcome: Some(outcome),
            trace: Some(trace),
            ..found
        }
    }
}

fn stage_ms(time_ms: &TimeMs) -> BTreeMap<String, f64> {
    time_ms
        .stages()
        .map(|(name, ms)| (name.to_owned(), rounded(ms, 3)))
        .into()
}

impl Method for Localizer {
    fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
        let (outcome, trace) = self.locate_traced(photo, prior)?;
        Ok(Found::of(outcome, trace))
    }

    fn needed_long_side_px(
        &self,
        metadata: &Metadata,
        full_size_px: (u32, u32),
        prior: &Prior,
    ) -> u32 {
        let needed = self.needed_pixels(prior);
        needed.long_side_px(metadata, full_size_px)
    }
}

/// Why a photo could not be localised at all.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrialError {
    /// The photo cannot be read.
    #[error(transparent)]
    Photo(Box<PhotoError>),
    /// The method refuses it.
    #[error(transparent)]
    Method(MethodError),
}

impl From<PhotoError> for TrialError {
    fn from(error: PhotoError) -> Self {
        Self::Photo(Box::new(error))
    }
}

/// One photo, localised and compared with its truth.
#[derive(Debug)]
pub struct Trial {
    /// The comparison; a photo that could not be localised counts as one without a fix.
    pub frame: Frame,
    /// What the method found.
    pub found: Result<Found, TrialError>,
}

/// Localises one photo and compares the answer with its truth.
#[must_use]
pub fn evaluate_one(method: &dyn Method, shot: &Shot, heading: HeadingMode) -> Trial {
    let needed = |metadata: &Metadata, full_size_px| {
        let prior = shot.prior(heading, full_size_px);
        method.needed_long_side_px(metadata, full_size_px, &prior)
    };
    let photo = match shot.photo.open_as_needed(needed) {
        Ok(photo) => photo,
        Err(error) => {
            return Trial {
                frame: frame(shot, &Err(error.to_string())),
                found: Err(error.into()),
            };
        }
    };
    let prior = shot.prior(heading, photo.full_size_px);
    let since = Instant::now();
    let found = method.locate(&photo, &prior);
    let elapsed_ms = since.elapsed().as_secs_f64() * 1e3;
    let mut scored = frame(shot, &found.as_ref().map_err(|error| chain(error.as_ref())));
    scored.time_ms.get_or_insert(elapsed_ms);
    scored.shown_width_m = shown_width_m(&photo, &prior, found.as_ref().ok());
    Trial {
        frame: scored,
        found: found.map_err(TrialError::Method),
    }
}

/// Localises all photos, one after the other; `on_trial` is called after each.
pub fn evaluate(
    method: &dyn Method,
    shots: &[Shot],
    heading: HeadingMode,
    on_trial: &mut dyn FnMut(&Trial),
) -> Vec<Trial> {
    shots
        .iter()
        .map(|shot| {
            let trial = evaluate_one(method, shot, heading);
            on_trial(&trial);
            trial
        })
        .collect()
}

/// Ground width of a photo by what is given, by its metadata or by its fix, metres.
fn shown_width_m(photo: &Photo, prior: &Prior, found: Option<&Found>) -> Option<f64> {
    let known = photo.view(&prior.view).footprint;
    let by_fix = || Some(found?.gsd_m? * f64::from(photo.full_size_px.0));
    known.map(|footprint| footprint.width_m).or_else(by_fix)
}

/// An error and its causes in one line; a cause that its error repeats is left out.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        let message = next.to_string();
        if !text.contains(&message) {
            text = format!("{text}: {message}");
        }
        cause = next.source();
    }
    text
}

/// The comparison of what was found with the truth.
fn frame(shot: &Shot, found: &Result<&Found, String>) -> Frame {
    let truth = &shot.truth;
    let scored = match found {
        Ok(Found { fix: Some(fix), .. }) => {
            let mut scored = Frame::score(&shot.name, fix, truth.position);
            if let Some(sigma_m) = truth.error_m {
                scored = scored.with_truth_error(fix, sigma_m);
            }
            if let Some(receiver) = truth.receiver {
                scored = scored.with_gps(fix, receiver);
            }
            scored
        }
        Ok(found) => Frame::missed(&shot.name, found.reason.as_deref().unwrap_or("no fix")),
        Err(reason) => Frame::missed(&shot.name, reason),
    };
    let found = found.as_ref().ok();
    Frame {
        truth: Some(truth.position),
        has_receiver: truth.receiver.is_some(),
        footprint_width_m: shot.footprint_width_m,
        truth_error_m: truth.error_m,
        place: truth.place.clone(),
        answerable: truth.featureless_share.map(|_| truth.is_answerable()),
        tilt_deg: truth.tilt_deg,
        confidence: found.and_then(|found| found.confidence),
        inliers: found.and_then(|found| found.inliers),
        time_ms: found.and_then(|found| found.stage_ms.get("total").copied()),
        stage_ms: found
            .map(|found| found.stage_ms.clone())
            .unwrap_or_default(),
        ..scored
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use grimnet_geo::{LonLat, destination_en_m};
    use grimnet_photo::Metadata;
    use image::RgbImage;

    use super::*;
    use crate::scene::{PhotoSource, Truth};

    /// Answers ten metres east of zero if the heading is given, refuses dark photos.
    struct Fixed;

    impl Method for Fixed {
        fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
            if photo.image.get_pixel(0, 0).0 == [0, 0, 0] {
                return Err("too dark".into());
            }
            let position = destination_en_m(
                LonLat {
                    lon_deg: 0.0,
                    lat_deg: 0.0,
                },
                10.0,
                0.0,
            );
            let is_given = *prior != Prior::none().with_unknown_heading();
            Ok(Found {
                fix: is_given.then_some(ScoredFix {
                    position,
                    covariance_en_m2: [4.0, 0.0, 4.0],
                    radius95_m: 5.0,
                }),
                confidence: Some(0.9),
                gsd_m: is_given.then_some(3.0),
                ..Found::default()
            })
        }
    }

    fn shot(name: &str, tone: u8) -> Shot {
        let image = RgbImage::from_pixel(64, 48, image::Rgb([tone; 3]));
        let truth = LonLat {
            lon_deg: 0.0,
            lat_deg: 0.0,
        };
        Shot {
            name: name.into(),
            photo: PhotoSource::Memory(Arc::new(Photo::from_image(image, Metadata::default()))),
            truth: Truth {
                error_m: Some(1.5),
                place: Some("field".into()),
                featureless_share: Some(0.7),
                receiver: Some(truth),
                ..Truth::at(truth)
            },
            known: Prior::none().with_heading(10.0, 5.0),
            footprint_width_m: None,
        }
    }

    #[test]
    fn fixes_misses_and_refusals_are_compared_with_the_truth() {
        let gone = Shot {
            photo: PhotoSource::File {
                path: "no/such.jpg".into(),
                limits: grimnet_photo::PhotoLimits::DEFAULT,
            },
            ..shot("gone", 9)
        };
        let shots = [shot("bright", 200), shot("dark", 0), gone];
        let mut seen = 0;
        let trials = evaluate(&Fixed, &shots, HeadingMode::Known, &mut |_| seen += 1);
        assert_eq!(seen, 3);
        let frame = &trials[0].frame;
        assert!((frame.error_m.unwrap() - 10.0).abs() < 1e-3);
        assert!((frame.gps_error_m.unwrap() - 10.0).abs() < 1e-3);
        assert_eq!(
            (frame.place.as_deref(), frame.answerable),
            (Some("field"), Some(false))
        );
        assert_eq!(
            (frame.confidence, frame.truth_error_m),
            (Some(0.9), Some(1.5))
        );
        assert!(frame.radius95_with_truth_m.unwrap() > 5.0);
        assert_eq!(trials[1].frame.reason.as_deref(), Some("too dark"));
        assert!(matches!(trials[1].found, Err(TrialError::Method(_))));
        assert!(
            trials[2]
                .frame
                .reason
                .as_ref()
                .unwrap()
                .contains("such.jpg")
        );
        assert!(matches!(trials[2].found, Err(TrialError::Photo(_))));
        let unknown = evaluate_one(&Fixed, &shots[0], HeadingMode::Unknown);
        assert!(!unknown.frame.fixed && unknown.found.is_ok());
    }

    #[test]
    fn the_ground_of_a_photo_is_as_wide_as_given_or_as_its_metadata_or_its_fix_say() {
        let width_m =
            |shot: &Shot, heading| evaluate_one(&Fixed, shot, heading).frame.shown_width_m;
        let plain = shot("a", 9);
        assert_eq!(width_m(&plain, HeadingMode::Known), Some(3.0 * 64.0));
        assert_eq!(width_m(&plain, HeadingMode::Unknown), None, "no fix");
        let metadata = Metadata {
            gimbal_pitch_deg: Some(-90.0),
            relative_altitude_m: Some(100.0),
            calibrated_focal_px: Some(50.0),
            orientation: 1,
            ..Metadata::default()
        };
        let image = RgbImage::from_pixel(64, 48, image::Rgb([9; 3]));
        let tagged = Shot {
            photo: PhotoSource::Memory(Arc::new(Photo::from_image(image, metadata))),
            ..plain
        };
        let by_metadata = width_m(&tagged, HeadingMode::Unknown).unwrap();
        assert!((by_metadata - 128.0).abs() < 1.0, "{by_metadata}");
        let given = Shot {
            footprint_width_m: Some(300.0),
            ..tagged
        };
        assert_eq!(width_m(&given, HeadingMode::Known), Some(300.0));
    }

    #[test]
    fn a_footprint_gives_the_ground_resolution_of_the_full_size_photo() {
        let shot = Shot {
            footprint_width_m: Some(128.0),
            ..shot("a", 9)
        };
        let photo = shot.photo.open().unwrap();
        assert_eq!(
            shot.prior(HeadingMode::Unknown, photo.full_size_px)
                .view
                .gsd_m,
            Some(2.0)
        );
        assert_eq!(
            shot.prior(HeadingMode::FromPhoto, photo.full_size_px)
                .view
                .heading,
            Prior::none().view.heading
        );
    }
}
