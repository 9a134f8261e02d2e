//! Heights, focal lengths and what follows for the ground: which are believed.

use super::*;

#[rstest]
#[case::on_the_ground("0.0")]
#[case::below("-12.5")]
#[case::in_orbit("90000")]
fn an_implausible_height_is_set_aside(#[case] value: &str) {
    let view = resolve(&read_xmp(&dji_elements(&[
        ("RelativeAltitude", value),
        ("CalibratedFocalLength", "3000"),
    ])));
    assert!(view.footprint.is_none() && view.height_agl_m.is_none());
    assert!(aside(
        &view,
        "RelativeAltitude",
        "out of range: a height above ground"
    ));
    assert!(view.hfov_deg.is_some());
}

/// It had no effect on where and how large the photo was searched.
#[test]
fn a_height_without_a_field_of_view_is_not_stated_as_used() {
    let height = [("RelativeAltitude", "104.0")];
    let view = resolve(&read_xmp(&dji_elements(&height)));
    assert!(view.footprint.is_none() && view.height_agl_m == Some(104.0));
    assert!(!used(&view, "RelativeAltitude"));
    assert!(aside(&view, "RelativeAltitude", "without a field of view"));
    let with_focal = [height[0], ("CalibratedFocalLength", "3000")];
    let view = resolve(&read_xmp(&dji_elements(&with_focal)));
    assert!(view.footprint.is_some() && used(&view, "RelativeAltitude"));
}

#[test]
fn height_above_the_sea_is_never_height_above_ground() {
    let mut fields = gps([24, 15, 4367], [120, 43, 1274], "N", "W");
    fields.extend([
        (Tag::GPSAltitudeRef, Value::Byte(vec![0])),
        (Tag::GPSAltitude, rationals(&[(375_616, 1000)])),
        (Tag::FocalLengthIn35mmFilm, short(24)),
    ]);
    let metadata = read_exif(&fields);
    assert_eq!(metadata.gps_altitude_m, Some(375.616));
    let position = metadata.position.unwrap();
    assert!((position.lat_deg - (24.0 + 15.0 / 60.0 + 43.67 / 3600.0)).abs() < 1e-9);
    assert!((position.lon_deg + (120.0 + 43.0 / 60.0 + 12.74 / 3600.0)).abs() < 1e-9);
    let view = resolve(&metadata);
    assert!(view.footprint.is_none() && view.height_agl_m.is_none());
    assert!(aside(&view, "GPS altitude", "above sea level"));
}

#[test]
fn focal_lengths_that_are_none_are_unknown() {
    let metadata = read_exif(&[
        (Tag::FocalLengthIn35mmFilm, short(0)),
        (Tag::FocalLength, rationals(&[(0, 0)])),
        (Tag::DigitalZoomRatio, rationals(&[(0, 0)])),
    ]);
    assert_eq!(metadata.focal_35mm, None);
    assert_eq!(metadata.focal_length_mm, None);
    assert_eq!(metadata.digital_zoom, None);
    assert!(
        metadata
            .notes
            .iter()
            .any(|n| n.field.contains("FocalLength"))
    );
    assert!(resolve(&metadata).hfov_deg.is_none());
}

#[test]
fn a_calibrated_focal_length_that_contradicts_the_equivalent_is_set_aside() {
    let mut metadata = read_xmp(&dji_elements(&[
        ("CalibratedFocalLength", "9000"),
        ("RelativeAltitude", "100"),
    ]));
    metadata.focal_35mm = Some(24.0);
    let view = resolve(&metadata);
    assert!(aside(
        &view,
        "CalibratedFocalLength",
        "differs from the 35 mm equivalent"
    ));
    assert!((view.hfov_deg.unwrap() - 71.6).abs() < 0.1);
}

#[test]
fn a_calibrated_focal_length_is_of_the_full_picture() {
    let mut metadata = read_xmp(&dji_elements(&[("CalibratedFocalLength", "3000")]));
    let full = resolve(&metadata).hfov_deg.unwrap();
    metadata.original_size_px = Some((4000, 3000));
    let of = |size| View::resolve(&metadata, size, &ViewPrior::default());
    // A file at half size sees as much, a cropped one does not say how much.
    assert!((of((2000, 1500)).hfov_deg.unwrap() - full).abs() < 1e-9);
    let cropped = of((3000, 3000));
    assert!(cropped.hfov_deg.is_none() && aside(&cropped, "CalibratedFocalLength", "cropped"));
}

#[test]
fn digital_zoom_makes_the_field_of_view_unknown() {
    let metadata = read_exif(&[
        (Tag::FocalLengthIn35mmFilm, short(24)),
        (Tag::DigitalZoomRatio, rationals(&[(2, 1)])),
    ]);
    let view = resolve(&metadata);
    assert!(view.hfov_deg.is_none() && aside(&view, "DigitalZoomRatio", "digital zoom"));
    assert!(aside(&view, "FocalLengthIn35mmFilm", "digital zoom"));
}

#[test]
fn a_tilt_lengthens_the_way_to_the_ground() {
    let view = resolve(&read_xmp(&dji_elements(&[
        ("GimbalYawDegree", "10"),
        ("GimbalPitchDegree", "-60"),
        ("RelativeAltitude", "100"),
        ("CalibratedFocalLength", "4000"),
    ])));
    let tilt = view.tilt.unwrap();
    assert_eq!(tilt.pitch_from_nadir_deg, 30.0);
    let slant = 100.0 / 30f64.to_radians().cos();
    assert!((view.footprint.unwrap().width_m - slant).abs() < 1e-9);
}

/// 13.2 mm for 5472 px, stated for the inch or for a millimetre without saying so.
#[rstest]
#[case::per_centimetre(Some(3), (41_455, 10), true)]
#[case::per_millimetre_without_unit(None, (41_455, 100), false)]
fn a_pixel_density_of_another_unit_is_implausible(
    #[case] unit: Option<u16>,
    #[case] per_unit: (u32, u32),
    #[case] is_plausible: bool,
) {
    let mut fields = vec![
        (Tag::FocalLength, rationals(&[(88, 10)])),
        (Tag::FocalPlaneXResolution, rationals(&[per_unit])),
    ];
    fields.extend(unit.map(|unit| (Tag::FocalPlaneResolutionUnit, short(unit))));
    let view = View::resolve(&read_exif(&fields), (5472, 3648), &ViewPrior::default());
    assert_eq!(used(&view, "FocalPlaneXResolution"), is_plausible);
    assert_eq!(view.hfov_deg.is_some(), is_plausible);
    assert!(is_plausible || aside(&view, "FocalPlaneXResolution", "implausible"));
}

#[test]
fn what_the_caller_overrides_is_set_aside() {
    let mut metadata = read_xmp(&dji_elements(&[
        ("RelativeAltitude", "100"),
        ("CalibratedFocalLength", "4000"),
    ]));
    metadata.above_ground_m = Some(95.0);
    let with = |prior| View::resolve(&metadata, (4000, 3000), &prior);
    let view = with(ViewPrior {
        gsd_m: Some(0.05),
        height_agl_m: Some(90.0),
        ..ViewPrior::default()
    });
    for field in [
        "height above ground",
        "AboveGroundAltitude",
        "RelativeAltitude",
    ] {
        assert!(aside(&view, field, "ground resolution"), "{field}");
    }
    let view = with(ViewPrior {
        hfov_deg: Some(60.0),
        ..ViewPrior::default()
    });
    assert!(aside(&view, "CalibratedFocalLength", "overridden"));
}
