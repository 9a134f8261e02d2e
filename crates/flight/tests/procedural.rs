//! A short flight over a procedural town: truth is known exactly.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

use grimnet_flight::{Flight, FlightOptions, FrameAnswer, Known, Searched, Warning};
use grimnet_geo::{LonLat, MapOptions, distance_m, open_map, turn_deg};
use grimnet_locate::{Localizer, Options, Outcome};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Levels, Pack, build};
use grimnet_photo::{Metadata, Photo};
use grimnet_track::{
    Attitude, Height, Input, InputError, PositionOf, Start, TrackOptions, TrackState, Velocity,
};
use grimnet_world::{
    Camera, Look, Placement, Pose, RegionM, Season, World, WorldConfig, write_geotiff,
};
use image::RgbImage;

const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 800,
    height_px: 600,
};
const MAP_GSD_M: f64 = 0.3;
/// Metres per second to the east, and frames per second.
const SPEED_M_S: f64 = 12.0;
const FRAMES_PER_S: f64 = 2.0;
/// After so many frames a flight is followed.
const UNTIL_TRACKED: usize = 8;

struct Scene {
    world: World,
    placement: Placement,
    localizer: Arc<Localizer>,
    _folder: tempfile::TempDir,
}

fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let world = World::new(WorldConfig {
            seed: 5,
            size_m: 620.0,
            urban: 0.8,
            ..WorldConfig::default()
        });
        let placement = Placement::at(3.0, 1.0).unwrap();
        let size_m = world.size_m();
        let whole = RegionM {
            x_min_m: 0.0,
            y_min_m: 0.0,
            width_m: size_m,
            height_m: size_m,
        };
        let picture = world.render_map(whole, MAP_GSD_M, &Look::satellite(Season::Summer));
        let map = folder.path().join("map.tif");
        let north_west_m = placement.utm_from_world([0.0, size_m]);
        write_geotiff(&map, &picture, MAP_GSD_M, north_west_m, placement.epsg()).unwrap();
        let pack = folder.path().join("area.grim");
        let options = BuildOptions {
            levels: Levels::Gsd(vec![MAP_GSD_M]),
            ..BuildOptions::standard()
        };
        let raster = open_map(&map, &MapOptions::default()).unwrap();
        let model = Model::bundled().unwrap();
        build(raster.as_ref(), &model, &options, &pack, &mut |_| ()).unwrap();
        let localizer = Localizer::new(model, Pack::open(&pack).unwrap())
            .unwrap()
            .with_options(Options {
                // The map is drawn from the town itself.
                map_error_m: 0.3,
                ..Options::default()
            });
        Scene {
            world,
            placement,
            localizer: Arc::new(localizer),
            _folder: folder,
        }
    })
}

/// A camera that looks a few degrees ahead and to the left.
fn pose(x_m: f64, y_m: f64) -> Pose {
    Pose {
        x_m,
        y_m,
        height_agl_m: 110.0,
        heading_deg: 90.0,
        pitch_off_nadir_deg: 6.0,
        roll_deg: -3.0,
    }
}

/// Several flights go along one path: each of its photos is rendered once.
fn photo(pose: &Pose) -> Photo {
    static RENDERED: Mutex<BTreeMap<String, Photo>> = Mutex::new(BTreeMap::new());
    let key = format!("{pose:?}");
    if let Some(photo) = RENDERED.lock().unwrap().get(&key) {
        return photo.clone();
    }
    let picture = scene()
        .world
        .render_photo(pose, &CAMERA, &Look::drone(Season::Summer));
    let photo = Photo::from_image(picture, Metadata::default());
    RENDERED.lock().unwrap().insert(key, photo.clone());
    photo
}

fn lonlat(pose: &Pose) -> LonLat {
    let [lon_deg, lat_deg] = scene()
        .placement
        .lonlat_from_world([pose.x_m, pose.y_m])
        .unwrap();
    LonLat::new(lon_deg, lat_deg)
}

/// What is known of the camera.
fn known(pose: &Pose) -> Known {
    Known {
        prior: grimnet_locate::Prior::none().with_hfov_deg(CAMERA.hfov_deg),
        attitude: Some(Attitude {
            time_s: 0.0,
            yaw_deg: pose.heading_deg + 2.0,
            pitch_deg: pose.pitch_off_nadir_deg,
            // Right side down looks to the left.
            roll_deg: -pose.roll_deg,
        }),
    }
}

fn flight(start: Option<Start>) -> Flight {
    let track = TrackOptions {
        start,
        ..TrackOptions::default()
    };
    let options = FlightOptions {
        track,
        ..FlightOptions::default()
    };
    Flight::new(Arc::clone(&scene().localizer), options).unwrap()
}

/// Flies to the east from `x_m` on; gives each frame's answer with the aircraft's true position.
fn fly(
    flight: &mut Flight,
    from_frame: usize,
    x_m: f64,
    y_m: f64,
    frames: usize,
) -> Vec<(FrameAnswer, LonLat)> {
    let path = |flown_s| pose(x_m + SPEED_M_S * flown_s, y_m);
    fly_along(flight, from_frame, frames, path, known)
}

/// Flies along `path`, by the seconds since it began; gives each frame's answer with the aircraft's true position.
fn fly_along(
    flight: &mut Flight,
    from_frame: usize,
    frames: usize,
    path: impl Fn(f64) -> Pose,
    known: impl Fn(&Pose) -> Known,
) -> Vec<(FrameAnswer, LonLat)> {
    (0..frames)
        .map(|number| {
            let time_s = (from_frame + number) as f64 / FRAMES_PER_S;
            let pose = path(number as f64 / FRAMES_PER_S);
            let answer = flight.frame(&photo(&pose), time_s, &known(&pose));
            (answer, lonlat(&pose))
        })
        .collect()
}

fn error_m((answer, truth): &(FrameAnswer, LonLat)) -> Option<f64> {
    let point = answer.point?;
    let estimate = point.estimate.filter(|_| point.state.is_usable())?;
    let place = LonLat::new(estimate.lon_deg, estimate.lat_deg);
    Some(distance_m(place, *truth))
}

#[test]
fn a_flight_is_found_followed_and_searched_in_small_windows() {
    let mut flight = flight(None);
    let answers = fly(&mut flight, 0, 180.0, 320.0, 14);
    assert_eq!(answers[0].0.searched, Searched::WholeMap);
    let tracked: Vec<_> = answers.iter().skip(UNTIL_TRACKED).collect();
    for frame in &tracked {
        let (answer, _) = frame;
        let point = answer.point.unwrap();
        assert_eq!(point.state, TrackState::Tracking, "{point:?}");
        assert_eq!(point.estimate.unwrap().position_of, PositionOf::Aircraft);
        let error_m = error_m(frame).unwrap();
        assert!(error_m < 5.0, "{error_m} m: {point:?}");
        let Searched::Window { radius_m, .. } = answer.searched else {
            panic!("{answer:?}");
        };
        assert!(radius_m < 200.0, "{radius_m}");
        assert_eq!(answer.searches, 1);
    }
    // The image centre is 12 m away from the aircraft; its tilt is known.
    let velocity_m_s = tracked.last().unwrap().0.point.unwrap().estimate.unwrap();
    assert!((velocity_m_s.velocity_east_m_s - SPEED_M_S).abs() < 2.0);
    let focal_px = flight.tracker().options().focal_length_px.unwrap();
    assert!((focal_px - CAMERA.focal_px()).abs() < 1.0);
}

#[test]
fn a_pitch_alone_tells_where_the_aircraft_is() {
    let mut flight = flight(None);
    let path = |flown_s| Pose {
        pitch_off_nadir_deg: 30.0,
        roll_deg: 0.0,
        ..pose(150.0 + SPEED_M_S * flown_s, 320.0)
    };
    let known = |_: &Pose| Known {
        prior: grimnet_locate::Prior::none()
            .with_hfov_deg(CAMERA.hfov_deg)
            .with_pitch_deg(-60.0),
        attitude: None,
    };
    let answers = fly_along(&mut flight, 0, 14, path, known);
    // The image centre is 64 m ahead.
    let last = answers.last().unwrap();
    let estimate = last.0.point.unwrap().estimate.unwrap();
    assert_eq!(estimate.position_of, PositionOf::Aircraft);
    let error_m = error_m(last).unwrap();
    assert!(error_m < 5.0, "{error_m} m: {estimate:?}");
}

/// Of a camera that is mounted so, in a turn: 30 degrees ahead and 20 to the side.
#[test]
fn photos_are_levelled_by_the_attitude() {
    let mut flight = flight(None);
    let path = |flown_s| Pose {
        pitch_off_nadir_deg: 30.0,
        roll_deg: 20.0,
        ..pose(150.0 + SPEED_M_S * flown_s, 320.0)
    };
    let answers = fly_along(&mut flight, 0, 10, path, known);
    let is_fix =
        |(answer, _): &&(FrameAnswer, LonLat)| matches!(answer.outcome, Ok(Outcome::Fix(_)));
    let fixes = answers.iter().filter(is_fix).count();
    assert!(fixes >= 9, "{fixes}");
    let error_m = error_m(answers.last().unwrap()).unwrap();
    assert!(error_m < 8.0, "{error_m} m");
    // It was searched under the bearing of the picture's top on the ground, 11 degrees from the yaw, which is off by 2.
    let Ok(Outcome::Fix(fix)) = &answers[0].0.outcome else {
        panic!("{:?}", answers[0].0);
    };
    let used = &fix.evidence.used;
    let heading = used.iter().find(|used| used.field == "heading").unwrap();
    let (stated_deg, _) = heading.value.split_once(' ').unwrap();
    let off_deg = turn_deg(fix.heading_deg.unwrap(), stated_deg.parse().unwrap());
    assert!(off_deg.abs() < 4.0, "{off_deg}");
}

#[test]
fn a_start_is_searched_first() {
    let first = pose(300.0, 300.0);
    let start = Start {
        lonlat: lonlat(&first),
        radius95_m: 60.0,
    };
    let answer = flight(Some(start)).frame(&photo(&first), 0.0, &known(&first));
    assert!(
        matches!(answer.searched, Searched::Window { .. }),
        "{answer:?}"
    );
    assert!(matches!(answer.outcome, Ok(Outcome::Fix(_))), "{answer:?}");
}

#[test]
fn one_bad_frame_stops_nothing_and_a_gap_is_bridged_by_the_velocity() {
    let mut flight = flight(None);
    let path = |time_s: f64| pose(150.0 + SPEED_M_S * time_s, 320.0);
    fly(&mut flight, 0, 150.0, 320.0, 10);
    let black = Photo::from_image(RgbImage::new(800, 600), Metadata::default());
    for number in 10..15 {
        let time_s = f64::from(number) / FRAMES_PER_S;
        flight
            .push(Input::Velocity(Velocity {
                time_s,
                east_m_s: SPEED_M_S,
                north_m_s: 0.0,
                sigma_m_s: 0.3,
            }))
            .unwrap();
        let answer = flight.frame(&black, time_s, &known(&pose(0.0, 0.0)));
        assert!(matches!(answer.outcome, Ok(Outcome::NoFix(_))));
        assert!(answer.refused.is_empty());
        let truth = lonlat(&path(time_s));
        let error_m = error_m(&(answer, truth)).unwrap();
        assert!(error_m < 8.0, "{error_m}");
    }
    let unplaced = flight.frame(&photo(&path(7.5)), f64::NAN, &Known::default());
    assert!(matches!(unplaced.refused[0], InputError::Invalid { .. }));
    assert!(unplaced.point.is_none());
    let after = fly(&mut flight, 15, path(7.5).x_m, 320.0, 2);
    assert!(error_m(&after[1]).unwrap() < 5.0);
}

#[test]
fn put_elsewhere_it_is_found_again() {
    let mut flight = flight(None);
    fly(&mut flight, 0, 330.0, 180.0, 10);
    let elsewhere = fly(&mut flight, 10, 160.0, 470.0, 14);
    // The old place is carried on for a moment. From the first fixes that disagree on, it is no longer given as certain.
    let first_fix = elsewhere
        .iter()
        .position(|(answer, _)| matches!(answer.outcome, Ok(Outcome::Fix(_))))
        .unwrap();
    for frame in &elsewhere[first_fix + 2..] {
        assert!(
            error_m(frame).is_none_or(|error_m| error_m < 5.0),
            "{:?}",
            frame.0
        );
    }
    assert!(
        error_m(&elsewhere[13]).unwrap() < 5.0,
        "{:?}",
        elsewhere[13].0
    );
}

#[test]
fn telemetry_that_turns_later_than_the_photos_is_noticed() {
    // To the right and to the left in turns: in a steady turn a delay is the same as a compass that is off.
    let pose_at = |time_s: f64| {
        let phase = 0.35 * time_s;
        let [east_m_s, north_m_s] = [9.0f64, 14.0 * phase.cos()];
        Pose {
            x_m: 180.0 + east_m_s * time_s,
            y_m: 310.0 + 40.0 * phase.sin(),
            heading_deg: east_m_s.atan2(north_m_s).to_degrees(),
            pitch_off_nadir_deg: 0.0,
            roll_deg: 0.0,
            ..pose(0.0, 0.0)
        }
    };
    let late_s = 2.0;
    let mut flight = flight(None);
    let mut ticks = 0;
    for number in 0..38 {
        let time_s = f64::from(number) / FRAMES_PER_S;
        while f64::from(ticks) * 0.1 <= time_s {
            let tick_s = f64::from(ticks) * 0.1;
            let attitude = Attitude {
                time_s: tick_s,
                yaw_deg: pose_at(tick_s - late_s).heading_deg,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            };
            flight.push(Input::Attitude(attitude)).unwrap();
            ticks += 1;
        }
        let known = Known {
            attitude: None,
            ..known(&pose(0.0, 0.0))
        };
        flight.frame(&photo(&pose_at(time_s)), time_s, &known);
    }
    let warnings: Vec<Warning> = flight.warnings().collect();
    let [Warning::Delay(warning)] = warnings[..] else {
        panic!("{warnings:?}");
    };
    assert!((warning.delay_s - late_s).abs() <= 0.5, "{warning:?}");
}

#[test]
fn one_exposure_given_again_and_again_is_no_more_evidence() {
    let mut flight = flight(None);
    let place = pose(300.0, 300.0);
    for number in 0..6 {
        let answer = flight.frame(&photo(&place), 0.0, &known(&place));
        assert!(matches!(answer.outcome, Ok(Outcome::Fix(_))), "{answer:?}");
        assert_eq!(answer.inputs.is_empty(), number > 0, "{answer:?}");
        let state = answer.point.unwrap().state;
        assert!(
            !state.is_usable(),
            "a single fix is not believed: {state:?}"
        );
    }
}

#[test]
fn the_tilt_of_an_aircraft_in_which_the_camera_is_mounted_turned_is_left_out() {
    let mut flight = flight(None);
    let mut answers = Vec::new();
    for number in 0..20 {
        let pose = Pose {
            pitch_off_nadir_deg: 9.0,
            ..pose(160.0 + 6.0 * f64::from(number), 320.0)
        };
        let mut known = known(&pose);
        // The picture's top is to the right wing, and the attitude is that of the aircraft.
        known.attitude = Some(Attitude {
            time_s: 0.0,
            yaw_deg: pose.heading_deg - 90.0,
            pitch_deg: -pose.roll_deg,
            roll_deg: -pose.pitch_off_nadir_deg,
        });
        let answer = flight.frame(&photo(&pose), f64::from(number) / FRAMES_PER_S, &known);
        answers.push((answer, lonlat(&pose)));
    }
    assert!(matches!(
        flight.warnings().collect::<Vec<_>>()[..],
        [Warning::Yaw(_)]
    ));
    for frame in &answers {
        let Some(error_m) = error_m(frame) else {
            continue;
        };
        let estimate = frame.0.point.unwrap().estimate.unwrap();
        assert!(
            error_m < 1.5 * estimate.radius95_m,
            "{error_m} m: {estimate:?}"
        );
    }
    let last = answers[19].0.point.unwrap();
    assert!(last.state.is_usable(), "{last:?}");
    let position_of = last.estimate.unwrap().position_of;
    assert_eq!(position_of, PositionOf::AircraftWithoutAttitude);
}

#[test]
fn velocities_that_become_wrong_in_flight_are_left_out() {
    let mut flight = flight(None);
    let mut answers = Vec::new();
    for number in 0..22 {
        let time_s = f64::from(number);
        let north_m_s = if number < 8 { 0.0 } else { 8.0 };
        for velocity in velocities(time_s, [8.0, north_m_s], 0.3) {
            flight.push(velocity).unwrap();
        }
        let pose = pose(160.0 + 8.0 * time_s, 320.0);
        let answer = flight.frame(&photo(&pose), time_s, &known(&pose));
        answers.push((answer, lonlat(&pose)));
    }
    let warnings: Vec<Warning> = flight.warnings().collect();
    assert!(
        matches!(warnings[..], [Warning::Velocity(_)]),
        "{warnings:?}"
    );
    let restarts: Vec<usize> = (0..22)
        .filter(|number| answers[*number].0.after_restart)
        .collect();
    let [restart] = restarts[..] else {
        panic!("{restarts:?}");
    };
    assert!((10..16).contains(&restart), "{restart}");
    for frame in &answers[restart..] {
        assert!(
            error_m(frame).is_none_or(|error_m| error_m < 5.0),
            "{frame:?}"
        );
    }
    assert!(error_m(&answers[21]).is_some());
}

/// A slow flight whose attitude is turned by so many degrees from the tenth on. Before each frame a height is reported.
/// Gives its warnings, and its answers from the step on.
fn with_step(
    frames: usize,
    yaw_step_deg: f64,
    agl_m: impl Fn(usize) -> f64,
) -> (Vec<Warning>, Vec<(FrameAnswer, LonLat)>) {
    let mut flight = flight(None);
    let mut answers = Vec::new();
    for number in 0..frames {
        let time_s = number as f64 / FRAMES_PER_S;
        let pose = pose(180.0 + 5.0 * number as f64, 320.0);
        let mut known = known(&pose);
        if let Some(attitude) = known.attitude.as_mut().filter(|_| number >= 10) {
            attitude.yaw_deg += yaw_step_deg;
        }
        let height = Height {
            time_s,
            agl_m: agl_m(number),
            amsl_m: None,
        };
        // Left out once fixes contradict it.
        let _ = flight.push(Input::Height(height)).unwrap();
        let answer = flight.frame(&photo(&pose), time_s, &known);
        answers.push((answer, lonlat(&pose)));
    }
    (flight.warnings().collect(), answers.split_off(10))
}

/// Checks a flight that found its place again: with small errors where it says that they are small.
fn assert_recovered(answers: &[(FrameAnswer, LonLat)]) {
    for frame in answers {
        let Some(error_m) = error_m(frame) else {
            continue;
        };
        let radius_m = frame.0.point.unwrap().estimate.unwrap().radius95_m;
        assert!(error_m < radius_m.max(5.0), "{error_m} m: {:?}", frame.0);
    }
    assert!(error_m(answers.last().unwrap()).is_some_and(|error_m| error_m < 20.0));
}

#[test]
fn a_yaw_that_is_reset_in_flight_is_noticed_and_left_out() {
    let (warnings, answers) = with_step(42, 120.0, |_| 110.0);
    let [Warning::Yaw(warning)] = warnings[..] else {
        panic!("{warnings:?}");
    };
    assert!(
        warning
            .off_deg
            .iter()
            .all(|off_deg| (off_deg - 122.0).abs() < 10.0)
    );
    assert_recovered(&answers);
    // Other headings were searched now and then, not at each frame.
    let wide = answers
        .iter()
        .filter(|(answer, _)| answer.searches > 2)
        .count();
    assert!((1..=3).contains(&wide), "{wide}");
}

#[test]
fn a_height_that_gets_another_reference_in_flight_is_noticed_and_costs_a_few_frames() {
    let (warnings, answers) = with_step(24, 0.0, |number| if number < 10 { 110.0 } else { 58.0 });
    let [Warning::Height(warning)] = warnings[..] else {
        panic!("{warnings:?}");
    };
    assert!((warning.factor - 58.0 / 110.0).abs() < 0.05, "{warning:?}");
    assert_recovered(&answers);
    let fixes = answers
        .iter()
        .filter(|(answer, _)| matches!(answer.outcome, Ok(Outcome::Fix(_))));
    assert!(fixes.count() >= 12);
}

/// The plateau below ends at a cliff, and the rangefinder says so.
#[test]
fn a_height_that_steps_because_the_ground_does_costs_no_frame() {
    let mut flight = flight(None);
    for number in 0..20 {
        let time_s = number as f64 / FRAMES_PER_S;
        let pose = Pose {
            height_agl_m: if number < 10 { 70.0 } else { 125.0 },
            ..pose(180.0 + 5.0 * number as f64, 320.0)
        };
        let height = Height {
            time_s,
            agl_m: pose.height_agl_m,
            amsl_m: None,
        };
        flight.push(Input::Height(height)).unwrap();
        let answer = flight.frame(&photo(&pose), time_s, &known(&pose));
        let has_fix = matches!(answer.outcome, Ok(Outcome::Fix(_)));
        assert!(has_fix || number < 10, "{number}: {answer:?}");
        // The first fix after the step tells the scale.
        let most_searches = if number == 10 { 2 } else { 1 };
        assert!(answer.searches <= most_searches, "{number}: {answer:?}");
        let frame = (answer, lonlat(&pose));
        if number >= UNTIL_TRACKED {
            assert!(
                error_m(&frame).is_some_and(|error_m| error_m < 5.0),
                "{frame:?}"
            );
        }
    }
    assert_eq!(flight.warnings().count(), 0);
}

/// The velocities of the second before a frame, ten a second.
fn velocities(
    time_s: f64,
    [east_m_s, north_m_s]: [f64; 2],
    sigma_m_s: f64,
) -> impl Iterator<Item = Input> {
    (0..10).map(move |tick| {
        Input::Velocity(Velocity {
            time_s: time_s - 0.9 + 0.1 * f64::from(tick),
            east_m_s,
            north_m_s,
            sigma_m_s,
        })
    })
}

/// Gives the velocities of the second before a frame.
fn push_velocities(flight: &mut Flight, time_s: f64, velocity_en_m_s: [f64; 2]) {
    for velocity in velocities(time_s, velocity_en_m_s, 0.5) {
        // Refused while a clock is being set.
        let _ = flight.push(velocity);
    }
}

#[test]
fn velocities_of_an_aircraft_that_hovers_are_left_out() {
    let mut flight = flight(None);
    let mut answers = Vec::new();
    for number in 0..20 {
        let time_s = f64::from(number);
        let spoofed_m_s = if number < 8 { 0.0 } else { 5.0 };
        push_velocities(&mut flight, time_s, [spoofed_m_s, 0.0]);
        // It sways by half a metre, so that no picture is the same again.
        let (x_m, y_m) = (0.5 * time_s.sin(), 0.5 * (1.3 * time_s).cos());
        let pose = pose(300.0 + x_m, 320.0 + y_m);
        let answer = flight.frame(&photo(&pose), time_s, &known(&pose));
        answers.push((answer, lonlat(&pose)));
    }
    let warnings: Vec<Warning> = flight.warnings().collect();
    let [Warning::Velocity(warning)] = warnings[..] else {
        panic!("{warnings:?}");
    };
    assert_eq!(warning.factor, f64::INFINITY);
    let restart = answers.iter().position(|(answer, _)| answer.after_restart);
    assert!(restart.is_some_and(|number| number < 15), "{restart:?}");
    for frame in &answers[restart.unwrap()..] {
        let error_m = error_m(frame);
        assert!(error_m.is_none_or(|error_m| error_m < 5.0), "{frame:?}");
    }
    assert!(error_m(&answers[19]).is_some());
}

#[test]
fn velocities_of_which_the_track_lags_behind_are_left_out() {
    let mut flight = flight(None);
    let mut answers = Vec::new();
    for number in 0..44 {
        let time_s = f64::from(number) / FRAMES_PER_S;
        let cross_m_s = if number < 14 { 0.0 } else { 5.0 };
        push_velocities(&mut flight, time_s, [8.0, cross_m_s]);
        let pose = pose(160.0 + 8.0 * time_s, 320.0);
        let answer = flight.frame(&photo(&pose), time_s, &known(&pose));
        answers.push((answer, lonlat(&pose)));
    }
    let warnings: Vec<Warning> = flight.warnings().collect();
    assert!(
        matches!(warnings[..], [Warning::Velocity(_)]),
        "{warnings:?}"
    );
    let restart = answers.iter().position(|(answer, _)| answer.after_restart);
    assert!(restart.is_some_and(|number| number < 36), "{restart:?}");
    assert!(error_m(&answers[43]).is_some_and(|error_m| error_m < 5.0));
}

/// A flight whose clock is set after 14 frames. Gives its warnings and its answers from there on.
fn with_clock_set(by_s: f64, frames_per_s: f64) -> (Vec<Warning>, Vec<(FrameAnswer, LonLat)>) {
    let mut flight = flight(None);
    let mut answers = Vec::new();
    for number in 0..26 {
        let flown_s = f64::from(number) / frames_per_s;
        let time_s = 1000.0 + flown_s + if number < 14 { 0.0 } else { by_s };
        let speed_m_s = 6.0 * frames_per_s;
        push_velocities(&mut flight, time_s, [speed_m_s, 0.0]);
        let pose = pose(160.0 + speed_m_s * flown_s, 320.0);
        let answer = flight.frame(&photo(&pose), time_s, &known(&pose));
        answers.push((answer, lonlat(&pose)));
    }
    (flight.warnings().collect(), answers.split_off(14))
}

#[test]
fn a_clock_that_is_set_during_the_flight_costs_a_few_frames() {
    for by_s in [-9.0, -40.0, -250.0, 400.0] {
        let (warnings, answers) = with_clock_set(by_s, 1.0);
        let [Warning::Clock(warning)] = warnings[..] else {
            panic!("{by_s}: {warnings:?}");
        };
        assert!((warning.by_s - by_s).abs() < 2.0, "{by_s}: {warning:?}");
        // Two frames may have come late.
        for frame in &answers[2..] {
            let error_m = error_m(frame);
            assert!(
                error_m.is_none_or(|error_m| error_m < 5.0),
                "{by_s}: {frame:?}"
            );
        }
        assert!(error_m(&answers[7]).is_some(), "{by_s}: {:?}", answers[7]);
    }
}
