//! A photo of a flight, and what is known of it besides the track.

use grimnet_photo::{HeadingPrior, Photo, View, focal_px};
use grimnet_track::Attitude;

use crate::frame::Known;
use crate::recent::Recent;
use crate::recorded_attitude::{attitude_towards, recorded_attitude};

/// See the module.
pub(crate) struct Exposure<'a> {
    pub photo: &'a Photo,
    pub time_s: f64,
    pub known: &'a Known,
    pub view: &'a View,
    /// Photo pixels for one pixel at the focal length that the track's ground resolutions refer to.
    pub px_per_reference_px: f64,
}

impl Exposure<'_> {
    /// Attitude of the camera: that which the caller knows, else of the telemetry, else of the metadata.
    pub fn attitude(&self, recent: &Recent) -> Option<Attitude> {
        self.measured_attitude(recent)
            .or_else(|| recorded_attitude(self.view, self.time_s))
    }

    /// Attitude of the camera where its pitch alone is known and the photo's top points to `top_deg`, degrees clockwise from true north.
    pub fn attitude_towards(&self, top_deg: f64) -> Option<Attitude> {
        let prior = &self.known.prior.view;
        // Without headings the attitudes of metadata are not used either.
        let is_used = prior.pitch_deg.is_some() || prior.heading != HeadingPrior::Unknown;
        attitude_towards(self.view, top_deg, self.time_s).filter(|_| is_used)
    }

    /// Attitude of the camera that was measured at this time: as [`Self::attitude`], but not that of the metadata.
    pub fn measured_attitude(&self, recent: &Recent) -> Option<Attitude> {
        // It is of this exposure, whatever time it states.
        let known = self.known.attitude.map(|attitude| Attitude {
            time_s: self.time_s,
            ..attitude
        });
        known.or_else(|| recent.attitude_at(self.time_s))
    }

    /// Focal length of the full-size photo, pixels, if it is known.
    pub fn focal_length_px(&self) -> Option<f64> {
        focal_length_px(self.photo, self.view)
    }
}

/// Focal length of a full-size photo, pixels, if it is known.
pub(crate) fn focal_length_px(photo: &Photo, view: &View) -> Option<f64> {
    let hfov_deg = view.hfov_deg?;
    Some(focal_px(f64::from(photo.full_size_px.0), hfov_deg))
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_photo::{Metadata, ViewPrior};
    use image::RgbImage;

    #[test]
    fn an_attitude_that_is_known_is_that_of_the_exposure() {
        let photo = Photo::from_image(RgbImage::new(64, 48), Metadata::default());
        let view = photo.view(&ViewPrior::default());
        let attitude = Attitude {
            time_s: 0.0,
            yaw_deg: 10.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        };
        let known = Known {
            attitude: Some(attitude),
            ..Known::default()
        };
        let exposure = Exposure {
            photo: &photo,
            time_s: 7.0,
            known: &known,
            view: &view,
            px_per_reference_px: 1.0,
        };
        let found = exposure.attitude(&Recent::default()).unwrap();
        assert_eq!((found.time_s, found.yaw_deg), (7.0, 10.0));
    }
}
