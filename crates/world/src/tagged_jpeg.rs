//! JPEG photos with the metadata of a DJI drone: EXIF (CIPA DC-008) and XMP.

use std::path::Path;

use grimnet_output::write_bytes_atomic;
use image::{ExtendedColorType, RgbImage};
use img_parts::jpeg::{Jpeg, JpegSegment, markers};

use crate::camera::{Camera, Pose};
use crate::error::WorldError;
use crate::placement::Placement;

/// The metadata of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoTags {
    /// GPS latitude of the camera, degrees north.
    pub lat_deg: f64,
    /// GPS longitude of the camera, degrees east.
    pub lon_deg: f64,
    /// GPS altitude above the sea, metres.
    pub gps_altitude_m: f64,
    /// Height above the take-off point, metres.
    pub relative_altitude_m: f64,
    /// Where the top of a nadir photo points before its roll, degrees clockwise from true north, -180 to 180.
    pub gimbal_yaw_deg: f64,
    /// -90 is straight down.
    pub gimbal_pitch_deg: f64,
    /// Turn about the optical axis; positive: the right side of a camera that looks ahead is down.
    pub gimbal_roll_deg: f64,
    /// Direction of the aircraft's nose, degrees clockwise from true north, -180 to 180.
    pub flight_yaw_deg: f64,
    /// Focal length of the lens, millimetres.
    pub focal_length_mm: f64,
    /// Focal length with the same field of view on 36 x 24 mm film, millimetres.
    pub focal_35mm: f64,
    /// Focal length in pixels of this picture.
    pub calibrated_focal_px: f64,
    /// Manufacturer of the camera.
    pub make: String,
    /// Model of the camera.
    pub model: String,
    /// Local time, `YYYY:MM:DD HH:MM:SS`, with a fraction of a second if it has one: `YYYY:MM:DD HH:MM:SS.25`.
    pub taken: String,
}

/// -180 (included) to 180.
fn signed_deg(angle_deg: f64) -> f64 {
    (angle_deg + 180.0).rem_euclid(360.0) - 180.0
}

/// Yaw from the heading, pitch and roll of a gimbal, degrees, that holds the camera at a pose.
///
/// A gimbal tilts the camera along its own yaw and then turns it about the optical axis; [`Pose::roll_deg`] tilts it to the side.
fn gimbal_deg(pose: &Pose) -> [f64; 3] {
    let (sin_pitch, cos_pitch) = pose.pitch_off_nadir_deg.to_radians().sin_cos();
    let (sin_roll, cos_roll) = pose.roll_deg.to_radians().sin_cos();
    // The optical axis: ahead, to the right, and down.
    let (ahead, right) = (sin_pitch * cos_roll, sin_roll);
    let down = cos_pitch * cos_roll;
    // Of the two tilts along one line the one that looks ahead if the pose does, so that without roll nothing changes.
    let sign = if ahead < 0.0 { -1.0 } else { 1.0 };
    let tilt = sign * ahead.hypot(right).atan2(down);
    let yaw = (sign * right).atan2(sign * ahead);
    // The picture's top, along the right and the top of the camera that is tilted and not turned about its axis.
    let (sin_tilt, cos_tilt) = tilt.sin_cos();
    let along_right = -cos_pitch * yaw.sin();
    let along_top = cos_pitch * yaw.cos() * cos_tilt + sin_pitch * sin_tilt;
    // No negative zero, which would be written with its sign.
    let turn = along_right.atan2(along_top) + 0.0;
    [yaw, tilt - std::f64::consts::FRAC_PI_2, turn].map(f64::to_degrees)
}

impl PhotoTags {
    /// The metadata for a reported `pose` (which may differ from the true one) over ground at `ground_altitude_m` above sea
    /// level.
    ///
    /// # Errors
    /// As [`Placement::lonlat_from_world`].
    pub fn for_pose(
        pose: &Pose,
        camera: &Camera,
        placement: &Placement,
        ground_altitude_m: f64,
    ) -> Result<Self, WorldError> {
        let at = [pose.x_m, pose.y_m];
        let [lon_deg, lat_deg] = placement.lonlat_from_world(at)?;
        let heading_deg = pose.heading_deg + placement.grid_north_deg(at)?;
        let [yaw_deg, gimbal_pitch_deg, gimbal_roll_deg] = gimbal_deg(pose);
        // A 1/2.3 inch sensor, 6.3 mm wide.
        const SENSOR_WIDTH_MM: f64 = 6.3;
        Ok(Self {
            lat_deg,
            lon_deg,
            gps_altitude_m: ground_altitude_m + pose.height_agl_m,
            relative_altitude_m: pose.height_agl_m,
            gimbal_yaw_deg: signed_deg(heading_deg + yaw_deg),
            gimbal_pitch_deg,
            gimbal_roll_deg,
            flight_yaw_deg: signed_deg(heading_deg),
            focal_length_mm: camera.focal_35mm() * SENSOR_WIDTH_MM / 36.0,
            focal_35mm: camera.focal_35mm(),
            calibrated_focal_px: camera.focal_px(),
            make: "grimnet".into(),
            model: "Procedural".into(),
            taken: "2026:06:21 10:00:00".into(),
        })
    }
}

/// An EXIF directory: entries, followed by the values that do not fit into them.
#[derive(Default)]
struct Directory {
    entries: Vec<(u16, u16, u32, Vec<u8>)>,
}

/// Longest content of a JPEG segment, whose two length bytes count themselves.
const MOST_SEGMENT_BYTES: usize = 65_533;

const ASCII: u16 = 2;
const SHORT: u16 = 3;
const LONG: u16 = 4;
const RATIONAL: u16 = 5;

impl Directory {
    fn ascii(&mut self, tag: u16, text: &str) {
        let mut bytes: Vec<u8> = text.bytes().filter(u8::is_ascii).collect();
        bytes.push(0);
        self.entries.push((tag, ASCII, bytes.len() as u32, bytes));
    }

    fn byte(&mut self, tag: u16, values: &[u8]) {
        self.entries
            .push((tag, 1, values.len() as u32, values.to_vec()));
    }

    fn short(&mut self, tag: u16, value: u16) {
        self.entries
            .push((tag, SHORT, 1, value.to_le_bytes().to_vec()));
    }

    fn long(&mut self, tag: u16, value: u32) {
        self.entries
            .push((tag, LONG, 1, value.to_le_bytes().to_vec()));
    }

    fn rationals(&mut self, tag: u16, values: &[(f64, u32)]) {
        let bytes = values
            .iter()
            .flat_map(|&(value, unit)| {
                let top = (value.max(0.0) * f64::from(unit)).round() as u32;
                [top.to_le_bytes(), unit.to_le_bytes()].concat()
            })
            .collect();
        self.entries
            .push((tag, RATIONAL, values.len() as u32, bytes));
    }

    fn size(&self) -> u32 {
        let extra: usize = self
            .entries
            .iter()
            .filter(|e| e.3.len() > 4)
            .map(|e| e.3.len().next_multiple_of(2))
            .sum();
        (2 + 12 * self.entries.len() + 4 + extra) as u32
    }

    /// Bytes of the directory at `offset` of the TIFF block.
    fn bytes(mut self, offset: u32) -> Vec<u8> {
        self.entries.sort_by_key(|e| e.0);
        let mut out = (self.entries.len() as u16).to_le_bytes().to_vec();
        let mut extra = Vec::new();
        let extra_at = offset + (2 + 12 * self.entries.len() + 4) as u32;
        for (tag, kind, count, value) in &self.entries {
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend(count.to_le_bytes());
            if value.len() <= 4 {
                let mut field = value.clone();
                field.resize(4, 0);
                out.extend(field);
            } else {
                out.extend((extra_at + extra.len() as u32).to_le_bytes());
                extra.extend(value);
                if extra.len() % 2 == 1 {
                    extra.push(0);
                }
            }
        }
        out.extend([0; 4]);
        out.extend(extra);
        out
    }
}

fn degrees_minutes_seconds(degrees: f64) -> [(f64, u32); 3] {
    let d = degrees.abs();
    let minutes = d.fract() * 60.0;
    // Whole parts first, so that rounding the seconds cannot reach 60 unnoticed by more than 1e-6.
    [
        (d.floor(), 1),
        (minutes.floor(), 1),
        (minutes.fract() * 60.0, 1_000_000),
    ]
}

fn exif_block(tags: &PhotoTags, width: u32, height: u32) -> Vec<u8> {
    let mut camera = Directory::default();
    let (taken, fraction) = tags.taken.split_once('.').unwrap_or((&tags.taken, ""));
    camera.ascii(0x9003, taken);
    if !fraction.is_empty() {
        camera.ascii(0x9291, fraction);
    }
    camera.byte(0x9000, b"0230");
    camera.rationals(0x829a, &[(0.001, 1_000_000)]);
    camera.rationals(0x829d, &[(2.8, 10)]);
    camera.short(0x8827, 100);
    camera.rationals(0x920a, &[(tags.focal_length_mm, 1000)]);
    camera.short(0xa405, tags.focal_35mm.round().clamp(0.0, 65_535.0) as u16);
    camera.long(0xa002, width);
    camera.long(0xa003, height);
    // ExifVersion is UNDEFINED (7), not BYTE.
    for entry in &mut camera.entries {
        if entry.0 == 0x9000 {
            entry.1 = 7;
        }
    }
    let mut gps = Directory::default();
    gps.byte(0x0000, &[2, 3, 0, 0]);
    gps.ascii(0x0001, if tags.lat_deg < 0.0 { "S" } else { "N" });
    gps.rationals(0x0002, &degrees_minutes_seconds(tags.lat_deg));
    gps.ascii(0x0003, if tags.lon_deg < 0.0 { "W" } else { "E" });
    gps.rationals(0x0004, &degrees_minutes_seconds(tags.lon_deg));
    gps.byte(0x0005, &[u8::from(tags.gps_altitude_m < 0.0)]);
    gps.rationals(0x0006, &[(tags.gps_altitude_m.abs(), 1000)]);

    let mut main = Directory::default();
    main.ascii(0x010f, &tags.make);
    main.ascii(0x0110, &tags.model);
    main.short(0x0112, 1);
    main.ascii(0x0131, "grimnet-world");
    main.ascii(0x0132, taken);
    main.long(0x8769, 0);
    main.long(0x8825, 0);
    let camera_at = 8 + main.size();
    let gps_at = camera_at + camera.size();
    for entry in &mut main.entries {
        match entry.0 {
            0x8769 => entry.3 = camera_at.to_le_bytes().to_vec(),
            0x8825 => entry.3 = gps_at.to_le_bytes().to_vec(),
            _ => {}
        }
    }
    let mut out = b"Exif\0\0II\x2a\0\x08\0\0\0".to_vec();
    out.extend(main.bytes(8));
    out.extend(camera.bytes(camera_at));
    out.extend(gps.bytes(gps_at));
    out
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

fn xmp_block(tags: &PhotoTags) -> Vec<u8> {
    let body = format!(
        "<?xpacket begin=\"\u{feff}\" id=\"W5M0MpCehiHzreSzNTczkc9d\"?>\n\
         <x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\n \
         <rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\n  \
         <rdf:Description rdf:about=\"DJI Meta Data\"\n    \
         xmlns:tiff=\"http://ns.adobe.com/tiff/1.0/\"\n    \
         xmlns:drone-dji=\"http://www.dji.com/drone-dji/1.0/\"\n   \
         tiff:Make=\"{make}\"\n   tiff:Model=\"{model}\"\n   \
         drone-dji:GpsLatitude=\"{lat:+.7}\"\n   drone-dji:GpsLongitude=\"{lon:+.7}\"\n   \
         drone-dji:AbsoluteAltitude=\"{absolute:+.2}\"\n   \
         drone-dji:RelativeAltitude=\"{relative:+.2}\"\n   \
         drone-dji:GimbalRollDegree=\"{roll:+.2}\"\n   \
         drone-dji:GimbalYawDegree=\"{yaw:+.2}\"\n   \
         drone-dji:GimbalPitchDegree=\"{pitch:+.2}\"\n   \
         drone-dji:FlightRollDegree=\"+0.00\"\n   \
         drone-dji:FlightYawDegree=\"{flight:+.2}\"\n   \
         drone-dji:FlightPitchDegree=\"+0.00\"\n   \
         drone-dji:CalibratedFocalLength=\"{focal:.4}\">\n  \
         </rdf:Description>\n </rdf:RDF>\n</x:xmpmeta>\n<?xpacket end=\"w\"?>",
        make = escaped(&tags.make),
        model = escaped(&tags.model),
        lat = tags.lat_deg,
        lon = tags.lon_deg,
        absolute = tags.gps_altitude_m,
        relative = tags.relative_altitude_m,
        roll = tags.gimbal_roll_deg,
        yaw = tags.gimbal_yaw_deg,
        pitch = tags.gimbal_pitch_deg,
        flight = tags.flight_yaw_deg,
        focal = tags.calibrated_focal_px,
    );
    let mut out = b"http://ns.adobe.com/xap/1.0/\0".to_vec();
    out.extend(body.into_bytes());
    out
}

/// Writes a JPEG of the given quality (1-100) that carries `tags` as EXIF and as DJI's XMP.
///
/// # Errors
/// [`WorldError::Output`] or [`WorldError::Encode`], naming the file.
pub fn write_jpeg_with_exif(
    path: &Path,
    image: &RgbImage,
    quality: u8,
    tags: &PhotoTags,
) -> Result<(), WorldError> {
    let mut plain = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut plain, quality.clamp(1, 100))
        .encode(
            image,
            image.width(),
            image.height(),
            ExtendedColorType::Rgb8,
        )
        .map_err(|e| WorldError::encode(path, e))?;
    let mut jpeg =
        Jpeg::from_bytes(plain.into()).map_err(|error| WorldError::encode(path, error))?;
    // Cameras write no JFIF segment.
    jpeg.segments_mut()
        .retain(|segment| segment.marker() != markers::APP0);
    let blocks = [
        exif_block(tags, image.width(), image.height()),
        xmp_block(tags),
    ];
    for (at, block) in blocks.into_iter().enumerate() {
        if block.len() > MOST_SEGMENT_BYTES {
            return Err(WorldError::encode(
                path,
                "the metadata are larger than a JPEG segment (64 KiB)",
            ));
        }
        let segment = JpegSegment::new_with_contents(markers::APP1, block.into());
        jpeg.segments_mut().insert(at, segment);
    }
    Ok(write_bytes_atomic(path, &jpeg.encoder().bytes())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::View;
    use approx::assert_relative_eq;
    use nalgebra::{Rotation3, Vector3};

    /// East, north and up of the rays through the picture's centre and just above it, with the gimbal's rotations one by one.
    #[test]
    fn the_gimbals_angles_give_the_pose() {
        let camera = Camera {
            hfov_deg: 60.0,
            width_px: 400,
            height_px: 300,
        };
        for (pitch, roll) in [
            (0.0, 0.0),
            (10.0, 0.0),
            (-8.0, 0.0),
            (0.0, 5.0),
            (10.0, 5.0),
            (-6.0, -4.0),
        ] {
            let pose = Pose {
                pitch_off_nadir_deg: pitch,
                roll_deg: roll,
                ..Pose::default()
            };
            let [yaw, gimbal_pitch, turn] = gimbal_deg(&pose).map(f64::to_radians);
            if roll == 0.0 {
                assert_relative_eq!(gimbal_pitch.to_degrees(), pitch - 90.0, epsilon = 1e-9);
                assert_relative_eq!(yaw, 0.0, epsilon = 1e-9);
            }
            // Camera axes: right, top, towards the camera's back. Clockwise turns seen from above are negative about `up`.
            let gimbal = Rotation3::from_axis_angle(&Vector3::z_axis(), -yaw)
                * Rotation3::from_axis_angle(
                    &Vector3::x_axis(),
                    gimbal_pitch + std::f64::consts::FRAC_PI_2,
                )
                * Rotation3::from_axis_angle(&Vector3::z_axis(), -turn);
            let view = View::new(&pose, &camera);
            let f = camera.focal_px();
            for (pixel, ray) in [
                ([200.0, 150.0], Vector3::new(0.0, 0.0, -1.0)),
                ([200.0, 100.0], Vector3::new(0.0, 50.0 / f, -1.0)),
            ] {
                let expected = Vector3::from(view.ray(pixel));
                assert!((gimbal * ray - expected).norm() < 1e-9, "{pitch} {roll}");
            }
        }
    }
}
