//! Metadata as drones write them: what is read, what is believed, and why the rest is not.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests, outside of test functions"
)]

mod angles;
#[path = "../photo_files/mod.rs"]
mod photo_files;
mod scale;
mod spellings;

use exif::{Tag, Value};
use grimnet_photo::{HeadingPrior, Metadata, View, ViewPrior};
use image::ImageFormat;
use photo_files::{
    ascii, encoded, exif_app1, exif_block, gps, gradient, jpeg, rationals, short, with_app1,
    xmp_app1,
};
use rstest::rstest;

/// A DJI Mini 2's packet: properties as attributes.
fn dji_attributes(properties: &str) -> String {
    format!(
        r#"<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?>
<x:xmpmeta xmlns:x="adobe:ns:meta/">
 <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
  <rdf:Description rdf:about="DJI Meta Data"
    xmlns:tiff="http://ns.adobe.com/tiff/1.0/"
    xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"
   tiff:Make="DJI"
   {properties}>
  </rdf:Description>
 </rdf:RDF>
</x:xmpmeta>                    "#
    )
}

/// The other serialisation of the same: properties as elements.
fn dji_elements(properties: &[(&str, &str)]) -> String {
    let elements: String = properties
        .iter()
        .map(|(name, value)| format!("   <drone-dji:{name}>{value}</drone-dji:{name}>\n"))
        .collect();
    format!(
        r#"<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
  <rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/">
{elements}  </rdf:Description></rdf:RDF></x:xmpmeta>"#
    )
}

fn read_xmp(packet: &str) -> Metadata {
    Metadata::from_bytes(&with_app1(&jpeg(&gradient(32, 24)), &[xmp_app1(packet)]))
}

fn read_exif(fields: &[(Tag, Value)]) -> Metadata {
    Metadata::from_bytes(&with_app1(&jpeg(&gradient(32, 24)), &[exif_app1(fields)]))
}

fn resolve(metadata: &Metadata) -> View {
    View::resolve(metadata, (4000, 3000), &ViewPrior::default())
}

/// Whether `field` was set aside for a reason that contains `words`.
fn aside(view: &View, field: &str, words: &str) -> bool {
    view.set_aside
        .iter()
        .any(|e| e.field.contains(field) && e.reason.contains(words))
}

fn used(view: &View, field: &str) -> bool {
    view.used.iter().any(|e| e.field.contains(field))
}

const FULL: [(&str, &str); 11] = [
    ("AbsoluteAltitude", "+198.61"),
    ("RelativeAltitude", "+40.10"),
    ("GimbalRollDegree", "+0.00"),
    ("GimbalYawDegree", "-44.20"),
    ("GimbalPitchDegree", "-89.90"),
    ("FlightRollDegree", "+1.10"),
    ("FlightYawDegree", "-42.80"),
    ("FlightPitchDegree", "+0.90"),
    ("CalibratedFocalLength", "3666.666504"),
    ("GpsLatitude", "46.8426"),
    ("GpsLongtitude", "-91.9944"),
];

#[test]
fn positions_that_are_none_are_noted() {
    let zero = read_exif(&gps([0, 0, 0], [0, 0, 0], "N", "E"));
    assert!(zero.position.is_none() && zero.notes[0].reason.contains("without a fix"));
    let far = read_exif(&gps([95, 0, 0], [10, 0, 0], "N", "E"));
    assert!(far.position.is_none() && far.notes[0].reason.contains("out of range"));
    let mut over_zero = gps([24, 0, 0], [10, 0, 0], "N", "E");
    over_zero[1].1 = rationals(&[(24, 0), (0, 1), (0, 1)]);
    let metadata = read_exif(&over_zero);
    assert!(metadata.position.is_none() && metadata.notes.len() == 1);
}

#[test]
fn a_picture_displayed_upright_keeps_its_focal_length_and_turns_its_heading() {
    let mut metadata = read_xmp(&dji_elements(&[
        ("GimbalYawDegree", "10"),
        ("GimbalPitchDegree", "-90"),
        ("RelativeAltitude", "100"),
        ("CalibratedFocalLength", "3000"),
    ]));
    metadata.orientation = 6;
    // Stored 4000 x 3000, displayed 3000 x 4000 with the stored left edge on top.
    let view = View::resolve(&metadata, (3000, 4000), &ViewPrior::default());
    assert!((view.footprint.unwrap().width_m - 100.0).abs() < 1e-9);
    let heading = view.heading.unwrap();
    assert_eq!((heading.heading_deg, heading.sigma_deg), (280.0, 10.0));
}

#[test]
fn prior_values_override_metadata() {
    let metadata = read_xmp(&dji_elements(&FULL));
    let with = |overrides: ViewPrior| View::resolve(&metadata, (4000, 3000), &overrides);
    let view = with(ViewPrior {
        heading: HeadingPrior::Known {
            heading_deg: -90.0,
            sigma_deg: 7.5,
        },
        pitch_deg: None,
        roll_deg: None,
        height_agl_m: Some(50.0),
        hfov_deg: Some(90.0),
        gsd_m: None,
    });
    let heading = view.heading.unwrap();
    // The sigma that is given is the sigma that is used.
    assert_eq!((heading.heading_deg, heading.sigma_deg), (270.0, 7.5));
    let footprint = view.footprint.unwrap();
    assert!((footprint.width_m - 100.0).abs() < 1e-9 && !footprint.is_uncertain());
    assert!(aside(&view, "RelativeAltitude", "better"));
    let view = with(ViewPrior {
        heading: HeadingPrior::Unknown,
        gsd_m: Some(0.025),
        ..ViewPrior::default()
    });
    assert!(view.heading.is_none() && aside(&view, "gimbal yaw", "the caller asked"));
    assert!((view.footprint.unwrap().width_m - 100.0).abs() < 1e-9);
    // Invalid values are not used.
    let view = with(ViewPrior {
        heading: HeadingPrior::Known {
            heading_deg: f64::NAN,
            sigma_deg: 3.0,
        },
        pitch_deg: None,
        roll_deg: None,
        height_agl_m: Some(-3.0),
        hfov_deg: Some(f64::INFINITY),
        gsd_m: Some(0.0),
    });
    assert!(view.heading.is_none());
    for field in ["heading", "height above ground", "hfov", "gsd"] {
        assert!(aside(&view, field, ""), "{field}");
    }
    assert_eq!(view.height_agl_m, Some(40.1));
}
