//! Headings and camera angles: which are believed.

use super::*;

#[test]
fn the_gimbal_is_preferred_to_the_aircraft() {
    let metadata = read_xmp(&dji_elements(&FULL));
    let view = resolve(&metadata);
    let heading = view.heading.unwrap();
    assert!((heading.heading_deg - 315.8).abs() < 1e-9);
    assert_eq!(heading.sigma_deg, 5.0);
    assert!(used(&view, "gimbal yaw") && aside(&view, "flight yaw", "gimbal"));
    // -89.9 is straight down.
    assert!(view.tilt.is_none() && used(&view, "gimbal pitch"));
    // 40.1 m and 4000 px at 3666.67 px.
    let footprint = view.footprint.unwrap();
    assert!((footprint.width_m - 40.1 * 4000.0 / 3666.666504).abs() < 1e-9);
    assert!(footprint.is_uncertain() && footprint.relative_sigma < 0.16);
    assert!(aside(&view, "GPS altitude", "above sea level"));
}

#[rstest]
#[case::gimbal_zero_flight_there("0.00", "+0.00", "152.1", Some(152.1))]
#[case::all_zero("0.00", "0.00", "0.00", None)]
fn angles_that_are_all_zero_were_not_recorded(
    #[case] gimbal_yaw: &str,
    #[case] gimbal_pitch: &str,
    #[case] flight_yaw: &str,
    #[case] heading_deg: Option<f64>,
) {
    let view = resolve(&read_xmp(&dji_elements(&[
        ("GimbalYawDegree", gimbal_yaw),
        ("GimbalPitchDegree", gimbal_pitch),
        ("GimbalRollDegree", "+0.00"),
        ("FlightYawDegree", flight_yaw),
    ])));
    assert_eq!(view.heading.map(|h| h.heading_deg), heading_deg);
    assert!(view.tilt.is_none());
    assert!(aside(&view, "gimbal yaw, pitch, roll", "not recorded"));
    if let Some(heading) = view.heading {
        assert_eq!(heading.sigma_deg, 10.0);
        assert!(view.used.iter().any(|e| e.reason.contains("uncertain")));
    }
}

#[test]
fn a_gimbal_pitch_of_exactly_zero_is_not_a_camera_at_the_horizon() {
    let view = resolve(&read_xmp(&dji_elements(&[
        ("GimbalYawDegree", "33.0"),
        ("GimbalPitchDegree", "0.00"),
        ("GimbalRollDegree", "0.00"),
    ])));
    assert_eq!(view.heading.unwrap().heading_deg, 33.0);
    assert!(view.tilt.is_none() && aside(&view, "gimbal pitch", "not recorded"));
}

#[test]
fn a_camera_that_did_look_at_the_horizon_is_not_rectified() {
    let view = resolve(&read_xmp(&dji_elements(&[
        ("GimbalYawDegree", "33.0"),
        ("GimbalPitchDegree", "-4.30"),
    ])));
    assert!(view.tilt.is_none() && aside(&view, "gimbal pitch", "no usable ground"));
}

#[test]
fn a_flip_by_half_a_turn_makes_the_heading_unknown() {
    let flipped = |roll: &str| {
        resolve(&read_xmp(&dji_elements(&[
            ("GimbalYawDegree", "-130.0"),
            ("GimbalPitchDegree", "-90.0"),
            ("GimbalRollDegree", roll),
            ("FlightYawDegree", "48.0"),
        ])))
    };
    let view = flipped("0.0");
    assert!(view.heading.is_none());
    assert!(aside(&view, "gimbal yaw", "flipped") && aside(&view, "flight yaw", "flipped"));
    // At the pole of the angles a roll of 180 says the same as turning the yaw: nothing contradicts.
    let view = flipped("180.0");
    assert!((view.heading.unwrap().heading_deg - 50.0).abs() < 1e-9);
}

#[rstest]
#[case::not_a_number("NaN")]
#[case::infinite("inf")]
#[case::empty("")]
#[case::words("unknown")]
#[case::out_of_range("9999")]
#[case::over_zero("1/0")]
fn a_yaw_that_is_no_angle_is_unknown_and_said_so(#[case] value: &str) {
    let metadata = read_xmp(&dji_attributes(&format!(
        "drone-dji:GimbalYawDegree=\"{value}\""
    )));
    assert_eq!(metadata.gimbal_yaw_deg, None);
    let view = resolve(&metadata);
    assert!(view.heading.is_none());
    assert!(
        view.set_aside
            .iter()
            .any(|e| e.field.contains("GimbalYawDegree"))
    );
}

#[test]
fn image_direction_is_the_last_resort() {
    let metadata = read_exif(&[
        (Tag::GPSImgDirectionRef, ascii("M")),
        (Tag::GPSImgDirection, rationals(&[(2705, 10)])),
    ]);
    let view = resolve(&metadata);
    assert_eq!(view.heading.unwrap().heading_deg, 270.5);
    assert!(view.used[0].reason.contains("magnetic"));
    let absurd = read_exif(&[(Tag::GPSImgDirection, rationals(&[(4000, 1)]))]);
    assert!(resolve(&absurd).heading.is_none());
}

/// Whatever takes its place.
#[rstest]
#[case::the_caller(HeadingPrior::Known { heading_deg: 80.0, sigma_deg: 5.0 }, "overridden")]
#[case::a_search(HeadingPrior::Unknown, "treat the heading as unknown")]
#[case::a_yaw(HeadingPrior::FromMetadata, "a yaw is recorded")]
fn an_image_direction_that_is_not_used_is_set_aside(
    #[case] heading: HeadingPrior,
    #[case] words: &str,
) {
    let mut metadata = read_exif(&[(Tag::GPSImgDirection, rationals(&[(850, 10)]))]);
    metadata.flight_yaw_deg = Some(84.0);
    let prior = ViewPrior {
        heading,
        ..ViewPrior::default()
    };
    let view = View::resolve(&metadata, (4000, 3000), &prior);
    assert!(!used(&view, "GPSImgDirection") && aside(&view, "GPSImgDirection", words));
    assert!(used(&view, "flight yaw") == (heading == HeadingPrior::FromMetadata));
}

/// A telephone held upright: its orientation makes the direction it looks in up, however the sensor's rows are stored.
#[rstest]
fn the_image_direction_does_not_turn_with_the_stored_picture(
    #[values(1, 3, 6, 8)] orientation: u16,
) {
    let metadata = read_exif(&[
        (Tag::Orientation, short(orientation)),
        (Tag::GPSImgDirection, rationals(&[(850, 10)])),
    ]);
    assert_eq!(resolve(&metadata).heading.unwrap().heading_deg, 85.0);
}

/// Where an edge of the stored picture that comes to the top in the displayed one lies: on the other side if it is stored mirrored.
#[rstest]
#[case(1, 10.0)]
#[case(2, 10.0)]
#[case(3, 190.0)]
#[case(4, 190.0)]
#[case(5, 100.0)]
#[case(6, 280.0)]
#[case(7, 280.0)]
#[case(8, 100.0)]
fn a_yaw_turns_with_the_stored_picture(#[case] orientation: u8, #[case] heading_deg: f64) {
    let gimbal = [("GimbalYawDegree", "10"), ("GimbalPitchDegree", "-90")];
    let aircraft = [("FlightYawDegree", "10")];
    for properties in [&gimbal[..], &aircraft[..]] {
        let mut metadata = read_xmp(&dji_elements(properties));
        metadata.orientation = orientation;
        let view = resolve(&metadata);
        assert_eq!(view.heading.unwrap().heading_deg, heading_deg);
        let mut reasons = view.used.iter().map(|e| &e.reason);
        let is_said = reasons.any(|reason| reason.contains("rotated with the image"));
        assert_eq!(is_said, heading_deg != 10.0);
    }
}

/// Metadata that a program puts together for a picture in memory.
#[test]
fn metadata_without_an_orientation_keep_their_tilt() {
    let metadata = Metadata {
        gimbal_pitch_deg: Some(-60.0),
        calibrated_focal_px: Some(4000.0),
        ..Metadata::default()
    };
    let view = resolve(&metadata);
    assert!(used(&view, "gimbal pitch"));
    assert_eq!(view.tilt.unwrap().pitch_from_nadir_deg, 30.0);
}

/// A program turned the pixels by a quarter and left the metadata: the heading of the top is not the yaw, and the field of view is
/// still known.
#[test]
fn a_picture_turned_after_it_was_taken_has_no_heading() {
    let mut metadata = read_xmp(&dji_elements(&[
        ("GimbalYawDegree", "10"),
        ("GimbalPitchDegree", "-60"),
        ("FlightYawDegree", "11"),
        ("RelativeAltitude", "100"),
        ("CalibratedFocalLength", "4000"),
    ]));
    metadata.original_size_px = Some((4000, 3000));
    let of = |size| View::resolve(&metadata, size, &ViewPrior::default());
    let turned = of((1500, 2000));
    assert!(turned.heading.is_none() && turned.attitude.is_none());
    for field in ["gimbal yaw", "flight yaw", "gimbal pitch"] {
        assert!(aside(&turned, field, "turned"), "{field}");
    }
    // 3000 px at 4000 px.
    assert!((turned.footprint.unwrap().width_m - 75.0).abs() < 1e-9);
    assert!(of((2000, 1500)).heading.is_some());
}

#[test]
fn a_pitch_that_is_given_overrides_the_recorded_one() {
    let with = |metadata: &Metadata, pitch_deg, hfov_deg| {
        let prior = ViewPrior {
            pitch_deg: Some(pitch_deg),
            hfov_deg,
            ..ViewPrior::default()
        };
        View::resolve(metadata, (4000, 3000), &prior)
    };
    let silent = Metadata::default();
    let view = with(&silent, -60.0, Some(70.0));
    let tilt = view.tilt.unwrap();
    assert_eq!((tilt.pitch_from_nadir_deg, tilt.roll_deg), (30.0, 0.0));
    assert!(used(&view, "pitch"));
    let view = with(&silent, -60.0, None);
    assert!(view.tilt.is_none() && aside(&view, "pitch", "not rectified"));
    for beyond in [30.0, -14.0, f64::NAN] {
        let view = with(&silent, beyond, Some(70.0));
        assert!(view.attitude.is_none() && aside(&view, "pitch", "from -165 to -15"));
    }
    // The yaw is still that of the gimbal, without the turn of a roll that the recorded pitch belonged to.
    let recorded = read_xmp(&dji_elements(&[
        ("GimbalYawDegree", "10"),
        ("GimbalPitchDegree", "-45"),
        ("GimbalRollDegree", "20"),
    ]));
    let view = with(&recorded, -90.0, Some(70.0));
    assert!(view.tilt.is_none() && used(&view, "pitch"));
    assert!(aside(&view, "gimbal pitch", "overridden"));
    assert_eq!(view.heading.unwrap().heading_deg, 10.0);
    // Not even one of which it is not known which side is the far one.
    let turned = Metadata {
        orientation: 6,
        ..recorded
    };
    let view = with(&turned, -60.0, Some(70.0));
    assert_eq!(view.tilt.unwrap().pitch_from_nadir_deg, 30.0);
}
