//! `truth.csv`: the true position of each photo.

use std::path::Path;

use grimnet_output::write_bytes_atomic;
use serde::{Deserialize, Serialize};

use crate::camera::{Camera, Pose, View};
use crate::error::WorldError;
use crate::placement::Placement;

/// A row of `truth.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthRow {
    /// File name of the photo.
    pub photo: String,
    /// Latitude of the ground point in the middle of the picture, degrees north.
    pub lat_deg: f64,
    /// Longitude of the ground point in the middle of the picture, degrees east.
    pub lon_deg: f64,
    /// Where the top of the photo points, degrees clockwise from true north, 0 to 360.
    pub heading_deg: f64,
    /// Camera height above the ground, metres.
    pub height_agl_m: f64,
}

impl TruthRow {
    /// The truth of a photo taken at `pose`.
    ///
    /// # Errors
    /// [`WorldError::Place`] if the middle of the picture is above the horizon or outside the projection.
    pub fn new(
        photo: &str,
        pose: &Pose,
        camera: &Camera,
        placement: &Placement,
    ) -> Result<Self, WorldError> {
        let middle = [
            f64::from(camera.width_px) * 0.5,
            f64::from(camera.height_px) * 0.5,
        ];
        let ground = View::new(pose, camera)
            .plane_from_photo_px(middle, 0.0)
            .ok_or_else(|| WorldError::Place {
                lon_deg: f64::NAN,
                lat_deg: f64::NAN,
                reason: format!("the middle of {photo} is above the horizon"),
            })?;
        let [lon_deg, lat_deg] = placement.lonlat_from_world(ground)?;
        let heading_deg = (pose.heading_deg + placement.grid_north_deg(ground)?).rem_euclid(360.0);
        Ok(Self {
            photo: photo.to_owned(),
            lat_deg,
            lon_deg,
            heading_deg,
            height_agl_m: pose.height_agl_m,
        })
    }
}

/// Writes `photo,lat_deg,lon_deg,heading_deg,height_agl_m`.
///
/// # Errors
/// [`WorldError::Output`] or [`WorldError::Encode`], naming the file.
pub fn write_truth_csv(path: &Path, rows: &[TruthRow]) -> Result<(), WorldError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer
            .write_record([
                row.photo.clone(),
                format!("{:.9}", row.lat_deg),
                format!("{:.9}", row.lon_deg),
                format!("{:.4}", row.heading_deg),
                format!("{:.3}", row.height_agl_m),
            ])
            .map_err(|e| WorldError::encode(path, e))?;
    }
    let body = writer
        .into_inner()
        .map_err(|e| WorldError::encode(path, e))?;
    let mut bytes = b"photo,lat_deg,lon_deg,heading_deg,height_agl_m\n".to_vec();
    bytes.extend(body);
    Ok(write_bytes_atomic(path, &bytes)?)
}
