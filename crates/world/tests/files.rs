//! The files written are read back by independent readers.

use std::io::BufReader;

use grimnet_world::{
    Camera, PhotoTags, Placement, Pose, TruthRow, write_geotiff, write_jpeg_with_exif,
    write_truth_csv,
};
use image::RgbImage;

fn gradient(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([x as u8, y as u8, (x / 3 + y / 5) as u8])
    })
}

const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 400,
    height_px: 300,
};

#[test]
fn exif_is_read_back_by_kamadak() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photo.jpg");
    let placement = Placement::at(-13.4, -47.8).unwrap();
    let pose = Pose {
        x_m: 400.0,
        y_m: 250.5,
        heading_deg: 200.0,
        ..Pose::default()
    };
    let tags = PhotoTags::for_pose(&pose, &CAMERA, &placement, 431.0).unwrap();
    write_jpeg_with_exif(&path, &gradient(400, 300), 90, &tags).unwrap();

    let file = std::fs::File::open(&path).unwrap();
    let exif = exif::Reader::new()
        .read_from_container(&mut BufReader::new(file))
        .unwrap();
    let field = |tag| exif.get_field(tag, exif::In::PRIMARY).unwrap();
    let angle = |tag| match &field(tag).value {
        exif::Value::Rational(v) => v[0].to_f64() + v[1].to_f64() / 60.0 + v[2].to_f64() / 3600.0,
        other => panic!("{other:?}"),
    };
    assert!((angle(exif::Tag::GPSLatitude) + tags.lat_deg).abs() < 1e-9);
    assert!((angle(exif::Tag::GPSLongitude) + tags.lon_deg).abs() < 1e-9);
    assert_eq!(
        field(exif::Tag::GPSLatitudeRef).display_value().to_string(),
        "S"
    );
    assert_eq!(
        field(exif::Tag::GPSLongitudeRef)
            .display_value()
            .to_string(),
        "W"
    );
    assert_eq!(
        field(exif::Tag::PixelXDimension).value.get_uint(0),
        Some(400)
    );
    assert_eq!(
        field(exif::Tag::FocalLengthIn35mmFilm).value.get_uint(0),
        Some(26)
    );
    match &field(exif::Tag::GPSAltitude).value {
        exif::Value::Rational(v) => assert!((v[0].to_f64() - 551.0).abs() < 1e-3),
        other => panic!("{other:?}"),
    }
    let bytes = std::fs::read(&path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    let yaw = format!("GimbalYawDegree=\"{:+.2}\"", tags.gimbal_yaw_deg);
    assert!(text.contains(&yaw) && text.contains("RelativeAltitude=\"+120.00\""));
    assert!(tags.gimbal_yaw_deg < -150.0 && tags.gimbal_yaw_deg > -170.0);
    let picture = image::open(&path).unwrap();
    assert_eq!((picture.width(), picture.height()), (400, 300));
}

#[test]
fn geotiff_keeps_pixels_and_carries_its_place() {
    use tiff::tags::Tag;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.tif");
    let picture = gradient(300, 270);
    write_geotiff(&path, &picture, 0.25, [500_100.0, 5_300_200.0], 32633).unwrap();
    assert_eq!(image::open(&path).unwrap().into_rgb8(), picture);
    let file = std::fs::File::open(&path).unwrap();
    let mut decoder = tiff::decoder::Decoder::new(BufReader::new(file)).unwrap();
    let tie = decoder.get_tag_f64_vec(Tag::Unknown(33922)).unwrap();
    assert_eq!(&tie[3..5], &[500_100.0, 5_300_200.0]);
    assert_eq!(
        decoder.get_tag_f64_vec(Tag::Unknown(33550)).unwrap()[0],
        0.25
    );
    let keys = decoder.get_tag_u16_vec(Tag::Unknown(34735)).unwrap();
    assert!(keys.chunks(4).any(|k| k == [3072, 0, 1, 32633]));
}

#[test]
fn truth_names_the_ground_under_the_picture_centre() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("truth.csv");
    let placement = Placement::at(15.0, 47.8).unwrap();
    let pose = Pose {
        x_m: 300.0,
        y_m: 300.0,
        pitch_off_nadir_deg: 10.0,
        ..Pose::default()
    };
    let row = TruthRow::new("a.jpg", &pose, &CAMERA, &placement).unwrap();
    let ground = placement
        .world_from_lonlat([row.lon_deg, row.lat_deg])
        .unwrap();
    let ahead = 120.0 * 10.0_f64.to_radians().tan();
    assert!((ground[0] - 300.0).abs() < 1e-4 && (ground[1] - 300.0 - ahead).abs() < 1e-4);
    write_truth_csv(&path, std::slice::from_ref(&row)).unwrap();
    let mut reader = csv::Reader::from_path(&path).unwrap();
    let back: Vec<TruthRow> = reader.deserialize().collect::<Result<_, _>>().unwrap();
    assert_eq!(back.len(), 1);
    assert!((back[0].lat_deg - row.lat_deg).abs() < 1e-9);
    let missing = write_truth_csv(&folder.path().join("no/such/truth.csv"), &[row]);
    assert!(missing.unwrap_err().to_string().contains("truth.csv"));
}
