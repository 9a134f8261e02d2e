//! Metadata under the names that makers give them, in every container.

use super::*;

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
    // The roll is about the picture's top: it tilts the camera, and hardly turns the picture.
    assert!((resolve(&metadata).heading.unwrap().heading_deg - 180.6).abs() < 0.1);
    let zeros = read_xmp(&packet("0", "0", "0.0"));
    assert_eq!(zeros.gimbal_yaw_deg, None);
    let view = resolve(&zeros);
    assert!(view.heading.is_none() && aside(&view, "Camera:Yaw", "not recorded"));
    // A pitch of 90 is straight down to some makers and the horizon to others, and one of -45 looks behind or ahead.
    for pitch in ["-90", "90", "-45"] {
        let ambiguous = read_xmp(&packet("12", pitch, "3"));
        assert_eq!(ambiguous.gimbal_pitch_deg, None);
        let view = resolve(&ambiguous);
        assert!(aside(&view, "Camera:Pitch", "convention") && view.attitude.is_none());
        assert_eq!(view.heading.unwrap().heading_deg, 12.0);
    }
}

/// A fixed-wing aircraft that banks: its camera looks down and is fixed to it.
#[test]
fn a_bank_under_pix4d_names_tilts_the_camera_and_does_not_turn_the_picture() {
    let metadata = read_xmp(
        r#"<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
        <rdf:Description xmlns:Camera="http://ns.sensefly.com/Camera/1.0/" Camera:Yaw="100" Camera:Pitch="3" Camera:Roll="15"/>
        </rdf:RDF>"#,
    );
    let view = resolve(&metadata);
    assert!((view.heading.unwrap().heading_deg - 99.2).abs() < 0.1);
    // The angle between the optical axis and straight down, by the spherical law of cosines.
    let from_nadir_deg = (3f64.to_radians().cos() * 15f64.to_radians().cos())
        .acos()
        .to_degrees();
    let attitude = view.attitude.unwrap();
    assert!((attitude.pitch_from_nadir_deg - from_nadir_deg).abs() < 1e-9);
    // Without a field of view nothing is rectified.
    assert!(view.tilt.is_none() && !used(&view, "gimbal pitch"));
    assert!(aside(
        &view,
        "gimbal pitch",
        "15.3 degrees from nadir; not rectified"
    ));
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
    for (kind, body) in [
        (b"zTXt", &b"Raw profile type xmp\0\0..."[..]),
        (b"iTXt", &b"XML:com.adobe.xmp\0\x01\0\0\0..."[..]),
    ] {
        let unread = [&png[..33], &chunk(kind, body), &png[33..]].concat();
        let notes = Metadata::from_bytes(&unread).notes;
        assert!(notes.len() == 1 && notes[0].reason.contains("not read"));
    }

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

#[rstest]
#[case::first_directory(exif::Context::Tiff)]
#[case::sub_directory(exif::Context::Exif)]
fn xmp_in_exif_is_read_where_the_file_has_none_of_its_own(#[case] directory: exif::Context) {
    let plain = jpeg(&gradient(32, 24));
    let in_exif = exif_app1(&[
        (Tag::Make, ascii("DJI")),
        (
            Tag(directory, 700),
            Value::Byte(dji_elements(&FULL).into_bytes()),
        ),
    ]);
    let metadata = Metadata::from_bytes(&with_app1(&plain, std::slice::from_ref(&in_exif)));
    assert_eq!(metadata.gimbal_yaw_deg, Some(-44.2));
    assert_eq!(metadata.relative_altitude_m, Some(40.1));
    // The file's own packet says one of them.
    let own = xmp_app1(&dji_elements(&[("GimbalYawDegree", "+12.5")]));
    for bodies in [[own.clone(), in_exif.clone()], [in_exif, own]] {
        let metadata = Metadata::from_bytes(&with_app1(&plain, &bodies));
        assert_eq!(metadata.gimbal_yaw_deg, Some(12.5));
        assert_eq!(metadata.relative_altitude_m, Some(40.1));
    }
}
