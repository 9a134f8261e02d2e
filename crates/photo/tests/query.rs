//! The geometry of queries, against rays intersected one by one.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "helpers of tests, outside of test functions"
)]

use grimnet_photo::{Metadata, Photo, PhotoError, Query, QueryOptions, QueryPx, Tilt, focal_px};
use image::{Rgb, RgbImage};
use nalgebra::{Rotation3, Unit, Vector3};
use proptest::prelude::*;

fn photo(width: u32, height: u32) -> Photo {
    let image = RgbImage::from_fn(width, height, |x, y| {
        Rgb([
            (x * 255 / width) as u8,
            (y * 255 / height) as u8,
            100 + ((x / 8 + y / 8) % 2 * 60) as u8,
        ])
    });
    Photo::from_image(image, Metadata::default())
}

/// Ground position (metres right and up of the query, relative to the photo's centre) of a photo pixel, by turning
/// a camera as aerial attitudes are defined and intersecting one ray with the ground.
fn ground_of(
    photo_px: [f64; 2],
    size: (u32, u32),
    footprint_width_m: f64,
    tilt: Tilt,
    up_deg: f64,
) -> Option<[f64; 2]> {
    let focal = focal_px(f64::from(size.0), tilt.hfov_deg);
    // Axes north, east, down; yaw about down, then pitch about right, then roll about forward.
    let attitude = |yaw_deg: f64| {
        Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_deg.to_radians())
            * Rotation3::from_axis_angle(
                &Vector3::y_axis(),
                (tilt.pitch_from_nadir_deg - 90.0).to_radians(),
            )
            * Rotation3::from_axis_angle(
                &Unit::new_normalize(Vector3::x()),
                tilt.roll_deg.to_radians(),
            )
    };
    let distance_m = footprint_width_m * focal / f64::from(size.0);
    let height_m = distance_m * tilt.pitch_from_nadir_deg.to_radians().cos();
    let hit = |yaw_deg: f64, [x, y]: [f64; 2]| {
        // Camera axes: forward, right, down.
        let ray = attitude(yaw_deg)
            * Vector3::new(
                focal,
                x - f64::from(size.0) / 2.0,
                y - f64::from(size.1) / 2.0,
            );
        (ray.z > 1e-9).then(|| ray * (height_m / ray.z))
    };
    let centre_px = [f64::from(size.0) / 2.0, f64::from(size.1) / 2.0];
    // The yaw that lets the picture's top point to up_deg at the centre.
    let above = [centre_px[0], centre_px[1] - 1e-4];
    let top = hit(0.0, above)? - hit(0.0, centre_px)?;
    let yaw_deg = up_deg - top.y.atan2(top.x).to_degrees();
    let ground = hit(yaw_deg, photo_px)? - hit(yaw_deg, centre_px)?;
    Some([ground.y, ground.x])
}

fn query_px(query: &Query, ground_m: [f64; 2]) -> QueryPx {
    let centre = query.centre_px();
    QueryPx::new(
        centre.x + ground_m[0] / query.gsd_m,
        centre.y - ground_m[1] / query.gsd_m,
    )
}

fn tilts() -> impl Strategy<Value = Option<Tilt>> {
    prop_oneof![
        Just(None),
        (-50.0..50.0f64, -180.0..180.0f64, 20.0..100.0f64).prop_map(|(pitch, roll, hfov_deg)| {
            Some(Tilt {
                pitch_from_nadir_deg: pitch,
                roll_deg: roll,
                hfov_deg,
            })
        })
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn query_pixels_map_to_the_photo_pixels_that_rays_give(
        tilt in tilts(),
        up_deg in -360.0..720.0f64,
        gsd_m in 0.2..2.0f64,
        footprint_width_m in 40.0..200.0f64,
        share in (0.1..0.9f64, 0.1..0.9f64),
    ) {
        let photo = photo(120, 80);
        let query = photo.query(gsd_m, footprint_width_m, up_deg, tilt).unwrap();
        prop_assert_eq!(query.image.width() % 32, 0);
        prop_assert_eq!(query.image.height() % 32, 0);
        prop_assert_eq!(query.mask.dimensions(), query.image.dimensions());
        // The centre stays the centre.
        let centre = query.photo_px(query.centre_px()).unwrap();
        prop_assert!((centre.x - 60.0).abs() < 1e-9 && (centre.y - 40.0).abs() < 1e-9);
        // Any other photo pixel, out over the ground and back through the query's matrix.
        let photo_px = [share.0 * 120.0, share.1 * 80.0];
        let straight = Tilt { pitch_from_nadir_deg: 0.0, roll_deg: 0.0, hfov_deg: 60.0 };
        let ground = ground_of(photo_px, (120, 80), footprint_width_m, tilt.unwrap_or(straight), up_deg);
        if let Some(ground) = ground {
            let back = query.photo_px(query_px(&query, ground)).unwrap();
            prop_assert!(
                (back.x - photo_px[0]).abs() < 1e-3 && (back.y - photo_px[1]).abs() < 1e-3,
                "{:?} came back as {:?}", photo_px, back
            );
        }
    }

    #[test]
    fn what_the_mask_shows_is_what_the_photo_shows(
        up_deg in 0.0..360.0f64,
        gsd_m in 0.5..1.5f64,
    ) {
        let photo = photo(200, 150);
        // Two photo pixels to a metre.
        let query = photo.query(gsd_m, 100.0, up_deg, None).unwrap();
        let mut worst = 0.0f64;
        for (x, y, seen) in query.mask.enumerate_pixels() {
            let at = query.photo_px(QueryPx::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
            let inside = (0.0..=200.0).contains(&at.x) && (0.0..=150.0).contains(&at.y);
            prop_assert_eq!(seen.0[0] == 255, inside);
            let pixel = query.image.get_pixel(x, y).0;
            if !inside {
                prop_assert_eq!(pixel, [0, 0, 0]);
            } else if (5.0..195.0).contains(&at.x) && (5.0..145.0).contains(&at.y) {
                worst = worst.max((f64::from(pixel[0]) - (at.x - 0.5) * 255.0 / 200.0).abs());
                worst = worst.max((f64::from(pixel[1]) - (at.y - 0.5) * 255.0 / 150.0).abs());
            }
        }
        prop_assert!(worst < 1.8, "{}", worst);
    }
}

#[test]
fn a_photo_that_heads_east_shows_its_top_to_the_right() {
    // Red grows to the photo's right, green downwards. Heading 90: the photo's right is south, its top east.
    let query = photo(128, 64).query(1.0, 128.0, 90.0, None).unwrap();
    assert_eq!(query.image.dimensions(), (64, 128));
    let [north, south] = [
        query.image.get_pixel(32, 8).0,
        query.image.get_pixel(32, 120).0,
    ];
    assert!(north[0] < 40 && south[0] > 215, "{north:?} {south:?}");
    let [east, west] = [
        query.image.get_pixel(60, 64).0,
        query.image.get_pixel(4, 64).0,
    ];
    assert!(east[1] < 40 && west[1] > 215, "{east:?} {west:?}");
}

#[test]
fn large_queries_are_cropped_about_the_centre() {
    let photo = photo(400, 300);
    let options = QueryOptions {
        max_side_px: 100,
        ..QueryOptions::new(0.25, 100.0)
    };
    let maker = photo.query_maker(&options).unwrap();
    for up_deg in [0.0, 30.0, 77.0] {
        let query = maker.make(up_deg);
        assert_eq!(query.image.dimensions(), (96, 96));
        assert!(query.mask.pixels().all(|seen| seen.0 == [255]));
        let centre = query.photo_px(query.centre_px()).unwrap();
        assert!((centre.x - 200.0).abs() < 1e-9 && (centre.y - 150.0).abs() < 1e-9);
        // The same pixels as from the whole photo.
        let whole = photo.query(0.25, 100.0, up_deg, None).unwrap();
        let offset = [
            (whole.image.width() - 96) / 2,
            (whole.image.height() - 96) / 2,
        ];
        for (x, y, pixel) in query.image.enumerate_pixels() {
            let same = whole.image.get_pixel(x + offset[0], y + offset[1]);
            for (a, b) in pixel.0.into_iter().zip(same.0) {
                assert!(a.abs_diff(b) <= 1);
            }
        }
    }
}

#[test]
fn buffers_are_reused_and_give_the_same_query() {
    let photo = photo(300, 200);
    let maker = photo.query_maker(&QueryOptions::new(0.5, 90.0)).unwrap();
    let mut reused = Query::default();
    for up_deg in [0.0, 45.0, 123.0, 270.0, 10.0] {
        maker.make_into(up_deg, &mut reused);
        let fresh = maker.make(up_deg);
        assert_eq!(reused.image, fresh.image);
        assert_eq!(reused.mask, fresh.mask);
        assert_eq!(reused.photo_px_from_query_px, fresh.photo_px_from_query_px);
    }
}

#[test]
fn a_tilted_query_cuts_off_what_is_far() {
    let photo = photo(160, 120);
    let tilt = Tilt {
        pitch_from_nadir_deg: 60.0,
        roll_deg: 0.0,
        hfov_deg: 80.0,
    };
    let query = photo.query(1.0, 100.0, 0.0, Some(tilt)).unwrap();
    let seen = query.mask.pixels().filter(|seen| seen.0 == [255]).count();
    assert!(seen > 1000);
    let focal = focal_px(160.0, 80.0);
    let distance_m = 100.0 * focal / 160.0;
    for (x, y, seen) in query.mask.enumerate_pixels() {
        // Depth along the optical axis of ground `ahead` metres beyond the centre.
        let ahead = query.centre_px().y - (f64::from(y) + 0.5);
        let depth = 1.0 + ahead * 60f64.to_radians().sin() / distance_m;
        if seen.0 == [255] {
            assert!(depth <= 2.5 + 1e-9, "{x},{y}");
        }
    }
}

#[test]
fn numbers_that_make_no_query_are_refused() {
    let photo = photo(64, 64);
    let bad = |result: Result<Query, PhotoError>| {
        assert!(
            matches!(result, Err(PhotoError::BadRequest { .. })),
            "{result:?}"
        );
    };
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        bad(photo.query(value, 100.0, 0.0, None));
        bad(photo.query(0.3, value, 0.0, None));
    }
    bad(photo.query(0.3, 100.0, f64::NAN, None));
    // A camera's frame that never came.
    for (width, height) in [(0, 0), (0, 64), (64, 0)] {
        let empty = Photo::from_image(RgbImage::new(width, height), Metadata::default());
        bad(empty.query(0.3, 100.0, 0.0, None));
    }
    let tilt = |pitch_from_nadir_deg, hfov_deg| {
        Some(Tilt {
            pitch_from_nadir_deg,
            roll_deg: 0.0,
            hfov_deg,
        })
    };
    bad(photo.query(0.3, 100.0, 0.0, tilt(10.0, 0.0)));
    bad(photo.query(0.3, 100.0, 0.0, tilt(10.0, f64::NAN)));
    for pitch in [80.0, 90.0, f64::NAN] {
        assert!(matches!(
            photo.query(0.3, 100.0, 0.0, tilt(pitch, 60.0)),
            Err(PhotoError::Horizon { .. })
        ));
    }
}
