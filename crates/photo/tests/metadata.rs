//! Metadata as drones write them: what is read, what is believed, and why the rest is not.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests, outside of test functions"
)]

mod photo_files;

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
fn dji_attributes_and_elements_read_alike() {
    let attributes: String = FULL
        .iter()
        .map(|(name, value)| format!("drone-dji:{name}=\"{value}\"\n"))
        .collect();
    let metadata = read_xmp(&dji_attributes(&attributes));
    assert_eq!(metadata, read_xmp(&dji_elements(&FULL)));
    assert_eq!(metadata.gimbal_yaw_deg, Some(-44.2));
    assert_eq!(metadata.gimbal_pitch_deg, Some(-89.9));
    assert_eq!(metadata.gimbal_roll_deg, Some(0.0));
    assert_eq!(metadata.flight_yaw_deg, Some(-42.8));
    assert_eq!(metadata.relative_altitude_m, Some(40.1));
    assert_eq!(metadata.gps_altitude_m, Some(198.61));
    assert_eq!(metadata.calibrated_focal_px, Some(3666.666504));
    let position = metadata.position.unwrap();
    assert_eq!((position.lat_deg, position.lon_deg), (46.8426, -91.9944));
    assert_eq!(metadata.notes, []);
}

#[test]
fn the_right_spelling_of_longitude_is_read_too() {
    let metadata = read_xmp(&dji_elements(&[
        ("GpsLatitude", "24.5"),
        ("GpsLongitude", "120.7"),
    ]));
    assert_eq!(metadata.position.unwrap().lon_deg, 120.7);
}

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
    assert!(footprint.is_doubtful() && footprint.relative_sigma < 0.16);
    assert!(aside(&view, "GPS altitude", "above sea level"));
}

#[test]
fn parrot_attributes_under_its_own_names() {
    // An Anafi's packet.
    let metadata = read_xmp(
        r#"<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
        <rdf:Description rdf:about="" xmlns:drone-parrot="http://www.parrot.com/drone-parrot/1.0/"
         drone-parrot:CameraRollDegree="0.25" drone-parrot:CameraPitchDegree="-75.0" drone-parrot:CameraYawDegree="101.5"
         drone-parrot:DroneRollDegree="-2.0" drone-parrot:DronePitchDegree="-3.5" drone-parrot:DroneYawDegree="100.9"/>
        </rdf:RDF></x:xmpmeta>"#,
    );
    assert_eq!(metadata.gimbal_yaw_deg, Some(101.5));
    assert_eq!(metadata.flight_yaw_deg, Some(100.9));
    let overrides = ViewPrior {
        hfov_deg: Some(70.0),
        ..ViewPrior::default()
    };
    let view = View::resolve(&metadata, (4000, 3000), &overrides);
    let tilt = view.tilt.unwrap();
    assert_eq!((tilt.pitch_from_nadir_deg, tilt.hfov_deg), (15.0, 70.0));
    // A roll of a quarter degree turns the top by about as much.
    assert!((view.heading.unwrap().heading_deg - 101.74).abs() < 0.01);
}

#[test]
fn parrot_sequoia_elements_under_pix4d_names_with_another_prefix() {
    let packet = |yaw: &str, pitch: &str, roll: &str| {
        format!(
            r#"<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
        <rdf:Description xmlns:cam="http://pix4d.com/camera/1.0">
         <cam:Yaw>{yaw}</cam:Yaw><cam:Pitch>{pitch}</cam:Pitch><cam:Roll>{roll}</cam:Roll>
         <cam:AboveGroundAltitude>815/10</cam:AboveGroundAltitude>
        </rdf:Description></rdf:RDF></x:xmpmeta>"#
        )
    };
    // Pix4D counts the pitch from straight down.
    let metadata = read_xmp(&packet("-179.5", "4.25", "-1.5"));
    assert_eq!(metadata.gimbal_yaw_deg, Some(-179.5));
    assert_eq!(metadata.gimbal_pitch_deg, Some(-85.75));
    assert_eq!(metadata.above_ground_m, Some(81.5));
    assert!((resolve(&metadata).heading.unwrap().heading_deg - 179.0).abs() < 0.1);
    let zeros = read_xmp(&packet("0", "0", "0.0"));
    assert_eq!(zeros.gimbal_yaw_deg, None);
    let view = resolve(&zeros);
    assert!(view.heading.is_none() && aside(&view, "Camera:Yaw", "not recorded"));
    // A pitch of 90 is straight down to some makers and the horizon to others.
    let ambiguous = read_xmp(&packet("12", "-90", "0"));
    assert_eq!(ambiguous.gimbal_pitch_deg, None);
    assert!(aside(&resolve(&ambiguous), "Camera:Pitch", "convention"));
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
        assert!(view.used.iter().any(|e| e.reason.contains("doubtful")));
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

#[test]
fn prior_values_override_metadata() {
    let metadata = read_xmp(&dji_elements(&FULL));
    let with = |overrides: ViewPrior| View::resolve(&metadata, (4000, 3000), &overrides);
    let view = with(ViewPrior {
        heading: HeadingPrior::Known {
            heading_deg: -90.0,
            sigma_deg: 7.5,
        },
        height_agl_m: Some(50.0),
        hfov_deg: Some(90.0),
        gsd_m: None,
    });
    let heading = view.heading.unwrap();
    // The sigma that is given is the sigma that is used.
    assert_eq!((heading.heading_deg, heading.sigma_deg), (270.0, 7.5));
    let footprint = view.footprint.unwrap();
    assert!((footprint.width_m - 100.0).abs() < 1e-9 && !footprint.is_doubtful());
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

#[test]
fn damaged_metadata_are_absent_metadata() {
    let plain = jpeg(&gradient(32, 24));
    for bodies in [
        vec![b"Exif\0\0II*\0\xFF\xFF\xFF\xFF".to_vec()],
        vec![b"Exif\0\0".to_vec()],
        vec![xmp_app1("<x:xmpmeta><rdf:RDF")],
        vec![xmp_app1("&&&&<<<>>>")],
        vec![xmp_app1("")],
        vec![b"http://ns.adobe.com/xap/1.0/\0\xFF\xFE\x00\x80".to_vec()],
    ] {
        let metadata = Metadata::from_bytes(&with_app1(&plain, &bodies));
        assert!(metadata.position.is_none() && metadata.gimbal_yaw_deg.is_none());
        assert!(resolve(&metadata).heading.is_none());
    }
    // What came before the damage counts.
    let packet = dji_elements(&FULL);
    let cut = &packet[..packet.find("<drone-dji:CalibratedFocalLength").unwrap() + 5];
    assert_eq!(read_xmp(cut).gimbal_yaw_deg, Some(-44.2));
    assert!(Metadata::from_bytes(b"").notes.is_empty());
}

#[test]
fn entities_do_not_expand() {
    let bomb = r#"<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
        <rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"
        drone-dji:GimbalYawDegree="&b;"/>"#;
    assert_eq!(read_xmp(bomb).gimbal_yaw_deg, None);
}

#[test]
fn png_webp_and_tiff_carry_the_same_blocks() {
    let exif = exif_block(&[
        (Tag::FocalLengthIn35mmFilm, short(24)),
        (Tag::Make, ascii("DJI")),
    ]);
    let xmp = dji_elements(&FULL);
    let expect = |bytes: &[u8], kind: &str| {
        let metadata = Metadata::from_bytes(bytes);
        assert_eq!(metadata.focal_35mm, Some(24.0), "{kind}");
        assert_eq!(metadata.make.as_deref(), Some("DJI"), "{kind}");
        assert_eq!(metadata.gimbal_yaw_deg, Some(-44.2), "{kind}");
    };

    // PNG chunks behind the header; their checksums are not looked at here.
    let chunk = |kind: &[u8], body: &[u8]| {
        let length = u32::try_from(body.len()).unwrap().to_be_bytes();
        [&length[..], kind, body, &[0; 4]].concat()
    };
    let png = encoded(&gradient(32, 24), ImageFormat::Png);
    let text = [b"XML:com.adobe.xmp\0\0\0\0\0", xmp.as_bytes()].concat();
    let blocks = [chunk(b"eXIf", &exif), chunk(b"iTXt", &text)].concat();
    expect(&[&png[..33], &blocks, &png[33..]].concat(), "png");

    let chunk = |kind: &[u8], body: &[u8]| {
        let length = u32::try_from(body.len()).unwrap().to_le_bytes();
        let padding = vec![0; body.len() % 2];
        [kind, &length[..], body, &padding].concat()
    };
    let webp = encoded(&gradient(32, 24), ImageFormat::WebP);
    let blocks = [chunk(b"EXIF", &exif), chunk(b"XMP ", xmp.as_bytes())].concat();
    expect(&[&webp[..], &blocks].concat(), "webp");

    // A TIFF file is an EXIF structure itself.
    let tiff = exif_block(&[
        (Tag::FocalLengthIn35mmFilm, short(24)),
        (Tag::Make, ascii("DJI")),
        (Tag(exif::Context::Tiff, 700), Value::Byte(xmp.into_bytes())),
    ]);
    expect(&tiff, "tiff");
}
