//! A method on changed photos, of which it is given no more than a setup says.

use std::borrow::Cow;

use grimnet_eval::evaluation::{Found, Method, MethodError};
use grimnet_locate::Prior;
use grimnet_photo::{HeadingPrior, Metadata, Photo, ViewPrior};

use crate::given::Given;
use crate::photometry::Photometry;

/// A change of photos, and how much of what is known of them is given.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Change {
    /// The change of their pixels.
    pub photometry: Photometry,
    /// What is given.
    pub given: Given,
}

impl Change {
    /// The photo and what is known of it, as a method gets them.
    pub fn of<'p>(self, photo: &'p Photo, prior: &Prior) -> (Cow<'p, Photo>, Prior) {
        let mut prior = *prior;
        let mut metadata = photo.metadata.clone();
        if matches!(self.given, Given::Nothing | Given::Heading) {
            // The heading may be known from the metadata.
            let heading = match (self.given, photo.view(&prior.view).heading) {
                (Given::Heading, Some(heading)) => HeadingPrior::Known {
                    heading_deg: heading.heading_deg,
                    sigma_deg: heading.sigma_deg,
                },
                _ => HeadingPrior::Unknown,
            };
            prior.view = ViewPrior {
                heading,
                ..ViewPrior::default()
            };
            metadata = Metadata {
                orientation: metadata.orientation,
                ..Metadata::default()
            };
        } else if self.photometry == Photometry::Original {
            return (Cow::Borrowed(photo), prior);
        }
        let image = self.photometry.apply(&photo.image);
        let changed = Photo {
            image,
            metadata,
            ..photo.clone()
        };
        (Cow::Owned(changed), prior)
    }
}

/// A method on changed photos.
pub(crate) struct Changed<'a> {
    /// The method.
    pub method: &'a dyn Method,
    /// The change.
    pub change: Change,
}

impl Method for Changed<'_> {
    fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
        let (photo, prior) = self.change.of(photo, prior);
        self.method.locate(&photo, &prior)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    fn view(given: Given) -> (Option<f64>, Option<f64>) {
        let metadata = Metadata {
            gimbal_yaw_deg: Some(40.0),
            gimbal_pitch_deg: Some(-90.0),
            relative_altitude_m: Some(100.0),
            calibrated_focal_px: Some(700.0),
            orientation: 1,
            ..Metadata::default()
        };
        let photo = Photo::from_image(RgbImage::new(800, 600), metadata);
        let change = Change {
            photometry: Photometry::Original,
            given,
        };
        let (photo, prior) = change.of(&photo, &Prior::none());
        let view = photo.view(&prior.view);
        (
            view.heading.map(|heading| heading.heading_deg),
            view.footprint.map(|footprint| footprint.width_m.round()),
        )
    }

    #[test]
    fn nothing_else_is_known_than_is_given() {
        assert_eq!(view(Given::HeadingAndScale), (Some(40.0), Some(114.0)));
        assert_eq!(view(Given::Heading), (Some(40.0), None));
        assert_eq!(view(Given::Nothing), (None, None));
    }
}
