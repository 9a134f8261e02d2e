//! Motion between frames of a procedural town: a known motion is measured, with the error that is stated, and none over water.

#![allow(clippy::unwrap_used)]

use std::sync::OnceLock;

use grimnet_geo::{MapOptions, open_map, turn_deg};
use grimnet_locate::{FrameFeatures, FrameMotion, FramePair, FrameTilt, Localizer, Prior};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Pack, build};
use grimnet_photo::{Metadata, Photo};
use grimnet_world::{
    Camera, Look, Placement, Pose, RegionM, Season, World, WorldConfig, write_geotiff,
};
use image::{Rgb, RgbImage};
use nalgebra::{Matrix2, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SIZE_M: f64 = 500.0;
const MAP_GSD_M: f64 = 0.3;
const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 640,
    height_px: 480,
};
const HEIGHT_M: f64 = 110.0;

struct Town {
    world: World,
    placement: Placement,
    localizer: Localizer,
    _folder: tempfile::TempDir,
}

fn town() -> &'static Town {
    static TOWN: OnceLock<Town> = OnceLock::new();
    TOWN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let world = World::new(WorldConfig {
            seed: 11,
            size_m: SIZE_M,
            ..WorldConfig::default()
        });
        let placement = Placement::at(15.2, 47.8).unwrap();
        let whole = RegionM {
            x_min_m: 0.0,
            y_min_m: 0.0,
            width_m: SIZE_M,
            height_m: SIZE_M,
        };
        let picture = world.render_map(whole, MAP_GSD_M, &Look::satellite(Season::Summer));
        let map_path = folder.path().join("map.tif");
        let north_west_m = placement.utm_from_world([0.0, SIZE_M]);
        write_geotiff(
            &map_path,
            &picture,
            MAP_GSD_M,
            north_west_m,
            placement.epsg(),
        )
        .unwrap();
        let map = open_map(&map_path, &MapOptions::default()).unwrap();
        let pack_path = folder.path().join("area.grim");
        let model = Model::bundled().unwrap();
        let standard = BuildOptions::standard();
        build(map.as_ref(), &model, &standard, &pack_path, &mut |_| ()).unwrap();
        Town {
            world,
            placement,
            localizer: Localizer::new(model, Pack::open(&pack_path).unwrap()).unwrap(),
            _folder: folder,
        }
    })
}

/// Features of a photo from `pose`, whose heading is given to the localiser, and whether it found the photo.
fn frame(pose: &Pose) -> (FrameFeatures, bool) {
    let town = town();
    let image = town
        .world
        .render_photo(pose, &CAMERA, &Look::drone(Season::Autumn));
    let north_deg = town.placement.grid_north_deg([pose.x_m, pose.y_m]).unwrap();
    let prior = Prior::none()
        .with_heading(pose.heading_deg + north_deg, 3.0)
        .with_hfov_deg(CAMERA.hfov_deg)
        .with_height_agl_m(pose.height_agl_m);
    let photo = Photo::from_image(image, Metadata::default());
    let (outcome, features) = town.localizer.locate_with_features(&photo, &prior).unwrap();
    (features.unwrap(), outcome.fix().is_some())
}

fn tilt_of(pose: &Pose) -> FrameTilt {
    FrameTilt {
        pitch_deg: pose.pitch_off_nadir_deg,
        roll_deg: -pose.roll_deg,
    }
}

/// Displacement from `first` to `second` towards the top and the right of the first photo, pixels.
fn true_motion_px(first: &Pose, second: &Pose) -> Vector2<f64> {
    let (sin, cos) = first.heading_deg.to_radians().sin_cos();
    let (east_m, north_m) = (second.x_m - first.x_m, second.y_m - first.y_m);
    Vector2::new(east_m * sin + north_m * cos, east_m * cos - north_m * sin)
        * (CAMERA.focal_px() / first.height_agl_m)
}

fn error_px(motion: &FrameMotion, first: &Pose, second: &Pose) -> Vector2<f64> {
    Vector2::new(motion.forward_px, motion.right_px) - true_motion_px(first, second)
}

fn turn_error_deg(motion: &FrameMotion, first: &Pose, second: &Pose) -> f64 {
    turn_deg(second.heading_deg - first.heading_deg, motion.turn_deg)
}

fn between(first: &Pose, second: &Pose, tilts: [FrameTilt; 2], sigma_deg: f64) -> FrameMotion {
    let pair = FramePair {
        focal_length_px: CAMERA.focal_px(),
        tilts: Some(tilts),
        tilt_change_sigma_deg: sigma_deg,
    };
    let (first, mut second) = (frame(first).0, frame(second).0);
    let found = town().localizer.motion_between(&first, &mut second, &pair);
    found.unwrap().unwrap()
}

fn pose(x_m: f64, y_m: f64, heading_deg: f64) -> Pose {
    Pose {
        x_m,
        y_m,
        height_agl_m: HEIGHT_M,
        heading_deg,
        ..Pose::default()
    }
}

#[test]
fn translation_and_turns_are_measured() {
    let first = pose(230.0, 240.0, 20.0);
    let others = [
        pose(250.0, 250.0, 20.0),
        pose(215.0, 262.0, 65.0),
        pose(235.0, 236.0, 190.0),
    ];
    for second in others {
        let level = [FrameTilt::default(); 2];
        let motion = between(&first, &second, level, 0.0);
        let off_px = error_px(&motion, &first, &second).norm();
        // A tenth of the distance is what buildings may do; 2 px are 0.4 m.
        let length_px = true_motion_px(&first, &second).norm();
        assert!(off_px < 0.06 * length_px + 2.0, "{motion:?} {off_px}");
        assert!(
            turn_error_deg(&motion, &first, &second).abs() < 0.7,
            "{motion:?}"
        );
        assert!((motion.height_ratio - 1.0).abs() < 0.03, "{motion:?}");
    }
}

#[test]
fn a_stated_tilt_is_taken_out_of_the_motion() {
    let first = Pose {
        pitch_off_nadir_deg: 9.0,
        ..pose(230.0, 240.0, 20.0)
    };
    let second = Pose {
        pitch_off_nadir_deg: 5.0,
        roll_deg: -14.0,
        ..pose(246.0, 256.0, 40.0)
    };
    let stated = between(&first, &second, [tilt_of(&first), tilt_of(&second)], 0.0);
    let ignored = between(&first, &second, [FrameTilt::default(); 2], 0.0);
    let length_px = true_motion_px(&first, &second).norm();
    let off_px = |motion| error_px(motion, &first, &second).norm();
    assert!(off_px(&stated) < 0.06 * length_px + 2.0, "{stated:?}");
    // 14 degrees at 110 m are 27 m: more than the motion itself.
    assert!(off_px(&ignored) > 0.5 * length_px, "{ignored:?}");
}

#[test]
fn the_stated_error_covers_the_true_one() {
    const TRIALS: usize = 24;
    const ATTITUDE_SIGMA_DEG: f64 = 0.5;
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut inside, mut shares) = (0, Vec::new());
    for _ in 0..TRIALS {
        let mut random = |most: f64| rng.random_range(-most..most);
        let first = Pose {
            pitch_off_nadir_deg: random(8.0),
            roll_deg: random(8.0),
            ..pose(250.0 + random(60.0), 250.0 + random(60.0), random(180.0))
        };
        let second = Pose {
            x_m: first.x_m + random(25.0),
            y_m: first.y_m + random(25.0),
            heading_deg: first.heading_deg + random(40.0),
            pitch_off_nadir_deg: random(8.0),
            roll_deg: random(8.0),
            ..first
        };
        // A sum of three uniform numbers is close enough to a normal one with the deviation of one of them.
        let mut noise = || (0..3).map(|_| random(1.0)).sum::<f64>() * ATTITUDE_SIGMA_DEG;
        let tilts = [first, second].map(|pose| {
            let tilt = tilt_of(&pose);
            FrameTilt {
                pitch_deg: tilt.pitch_deg + noise(),
                roll_deg: tilt.roll_deg + noise(),
            }
        });
        let motion = between(&first, &second, tilts, 2f64.sqrt() * ATTITUDE_SIGMA_DEG);
        let length_px = true_motion_px(&first, &second).norm();
        let error = error_px(&motion, &first, &second);
        // What is relative to the distance is stated by whoever uses the motion: 5 % for relief.
        let [ff, fr, rr] = motion.covariance_px2;
        let covariance =
            Matrix2::new(ff, fr, fr, rr) + Matrix2::identity() * (0.05 * length_px).powi(2);
        let chi2 = (error.transpose() * covariance.try_inverse().unwrap() * error)[(0, 0)];
        inside += usize::from(chi2 < 5.991);
        shares.push(chi2);
    }
    shares.sort_by(f64::total_cmp);
    // 95 % of 24 are 22.8; 19 or fewer have a probability of 2 % if the covariance is right.
    assert!(inside >= 20, "{inside} of {TRIALS}: {shares:.2?}");
    // A covariance that is far too large would have a median far below the 1.39 of chi-square with two degrees of freedom.
    assert!(shares[TRIALS / 2] > 0.35, "{shares:.2?}");
}

#[test]
fn water_and_photos_that_do_not_overlap_have_no_motion() {
    let pair = FramePair {
        focal_length_px: CAMERA.focal_px(),
        tilts: None,
        tilt_change_sigma_deg: 0.0,
    };
    let localizer = &town().localizer;
    let here = frame(&pose(150.0, 150.0, 0.0)).0;
    let mut far = frame(&pose(360.0, 350.0, 0.0)).0;
    let found = localizer.motion_between(&here, &mut far, &pair).unwrap();
    assert_eq!(found, None);
    // Waves: each photo has its own.
    let found = localizer.motion_between(&waves(1, 0.0), &mut waves(2, 0.0), &pair);
    assert_eq!(found.unwrap(), None);
    let found = localizer.motion_between(&here, &mut waves(1, 0.0), &pair);
    assert_eq!(found.unwrap(), None);
}

/// Features of a photo of water: glitter that moved to the right by `moved_px`.
fn waves(seed: u64, moved_px: f64) -> FrameFeatures {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let glint: Vec<(f64, f64)> = (0..400)
        .map(|_| (rng.random_range(0.0..640.0), rng.random_range(0.0..480.0)))
        .collect();
    let mut image = RgbImage::from_pixel(640, 480, Rgb([38, 66, 84]));
    for (x, y) in glint {
        for along in 0..rng.random_range(2..9) {
            let at = (
                (x + moved_px + f64::from(along)) as u32,
                (y + f64::from(along) * 0.4) as u32,
            );
            if at.0 < 640 && at.1 < 480 {
                image.put_pixel(at.0, at.1, Rgb([120, 140, 150]));
            }
        }
    }
    let photo = Photo::from_image(image, Metadata::default());
    let prior = Prior::none().with_heading(0.0, 3.0).with_gsd_m(0.24);
    let localizer = &town().localizer;
    let (outcome, features) = localizer.locate_with_features(&photo, &prior).unwrap();
    assert!(outcome.fix().is_none());
    features.unwrap()
}

#[test]
fn water_that_moves_as_a_whole_is_not_taken_for_ground() {
    let pair = FramePair {
        focal_length_px: CAMERA.focal_px(),
        tilts: None,
        tilt_change_sigma_deg: 0.0,
    };
    // A drone that stands still sees the waves move: two photos cannot tell that from motion of the drone.
    let localizer = &town().localizer;
    let found = localizer.motion_between(&waves(1, 0.0), &mut waves(1, 24.0), &pair);
    let motion = found.unwrap().unwrap();
    assert!((motion.right_px + 24.0).abs() < 2.0, "{motion:?}");
    assert_eq!(motion.surface_sigma_px, None, "{motion:?}");
}

#[test]
fn ground_is_followed_from_a_fix_on() {
    let pair = FramePair {
        focal_length_px: CAMERA.focal_px(),
        tilts: None,
        tilt_change_sigma_deg: 0.0,
    };
    let localizer = &town().localizer;
    let [a, mut b, mut c, mut d] =
        [230.0, 240.0, 250.0, 260.0].map(|x_m| frame(&pose(x_m, 240.0, 20.0)).0);
    // Only the first fix counts.
    for features in [&mut b, &mut c, &mut d] {
        features.distrust_fix();
    }
    let unstated = localizer.motion_between(&b, &mut c.clone(), &pair);
    assert_eq!(unstated.unwrap().unwrap().surface_sigma_px, None);
    let surface_px = |first: &FrameFeatures, second: &mut FrameFeatures| {
        let motion = localizer.motion_between(first, second, &pair).unwrap();
        motion.unwrap().surface_sigma_px
    };
    assert_eq!(surface_px(&a, &mut b), Some(0.0));
    let followed_px = surface_px(&b, &mut c).unwrap();
    // Half of 2.5 pixels of the query, of which one is more than a pixel of the photo and less than four.
    assert!((1.25..5.0).contains(&followed_px), "{followed_px}");
    assert_eq!(surface_px(&c, &mut d), Some(followed_px));
}

#[test]
fn the_fix_marks_keypoints_on_the_ground_and_motion_is_reproducible() {
    let (first, second) = (pose(230.0, 240.0, 20.0), pose(245.0, 250.0, 25.0));
    assert!(frame(&first).1 && frame(&second).1);
    let level = [FrameTilt::default(); 2];
    assert_eq!(
        between(&first, &second, level, 0.0),
        between(&first, &second, level, 0.0)
    );
    assert!(!frame(&first).0.is_empty());
}
