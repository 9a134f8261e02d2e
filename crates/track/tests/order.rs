//! Inputs that come late, swapped or twice give the same state, bit for bit, as in order. Nothing that comes in panics.

use grimnet_geo::{LonLat, destination_en_m};
use grimnet_track::{
    Attitude, Height, Input, InputError, Miss, PositionFix, RelativeMotion, Taken, TrackOptions,
    Tracker, Velocity,
};
use proptest::prelude::*;

const START: LonLat = LonLat::new(120.7, 24.2);

fn fix(time_s: f64, east_m: f64, north_m: f64, confidence: f64) -> Input {
    Input::Fix(PositionFix {
        time_s,
        lonlat: destination_en_m(START, east_m, north_m),
        covariance_en_m2: [2.0, 0.3, 1.5],
        map_error_m: 1.0,
        heading_deg: Some(40.0),
        gsd_m: 0.05,
        confidence,
    })
}

/// A flight of 25 s with every kind of input, some fixes elsewhere.
fn flight(elsewhere: &[bool], times_s: &[f64]) -> Vec<Input> {
    let mut inputs = Vec::new();
    for (index, (&wrong, &time_s)) in elsewhere.iter().zip(times_s).enumerate() {
        let (east_m, north_m) = (8.0 * time_s, 3.0 * time_s);
        let off_m = if wrong {
            400.0
        } else {
            0.3 * (index as f64).sin()
        };
        inputs.push(fix(time_s, east_m + off_m, north_m, 0.9));
        if index % 2 == 0 {
            inputs.push(Input::Attitude(Attitude {
                time_s,
                yaw_deg: 40.0 + time_s,
                pitch_deg: 3.0,
                roll_deg: -2.0,
            }));
        }
        if index % 3 == 0 {
            inputs.push(Input::Height(Height {
                time_s,
                agl_m: 120.0,
                amsl_m: Some(300.0),
            }));
            inputs.push(Input::Velocity(Velocity {
                time_s: time_s + 0.05,
                east_m_s: 8.1,
                north_m_s: 2.9,
                sigma_m_s: 0.3,
            }));
        }
        inputs.push(Input::Motion(RelativeMotion {
            from_time_s: time_s - 0.5,
            time_s,
            forward_px: 70.0,
            right_px: 40.0,
            turn_deg: 1.0,
            sigma_px: 1.0,
            surface_sigma_px: [Some(0.0), Some(4.0), None][index % 3],
        }));
        if index % 7 == 0 {
            inputs.push(Input::Miss(Miss { time_s }));
        }
    }
    inputs
}

fn answers(tracker: &Tracker) -> String {
    let mut text = String::new();
    for tenth in 0..300 {
        // Debug prints the shortest text that reads back to the same number, so equal texts are equal bits.
        text += &format!("{:?}\n", tracker.point_at(f64::from(tenth) * 0.1));
    }
    text
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_order_within_the_lag_is_the_same(
        elsewhere in prop::collection::vec(prop::bool::weighted(0.3), 40),
        jitter in prop::collection::vec(0.0..0.5f64, 40),
        order in prop::collection::vec(any::<u32>(), 400),
        twice in prop::collection::vec(any::<bool>(), 400),
    ) {
        let times_s: Vec<f64> = jitter.iter().enumerate().map(|(i, j)| 0.6 * i as f64 + j).collect();
        let inputs = flight(&elsewhere, &times_s);
        let mut in_order = inputs.clone();
        in_order.sort_by(|a, b| a.time_s().total_cmp(&b.time_s()));
        let mut straight = Tracker::new(TrackOptions::default()).unwrap();
        for input in &in_order {
            straight.push(*input).unwrap();
        }
        let mut shuffled: Vec<(u32, Input)> = order.iter().copied().zip(inputs).collect();
        shuffled.sort_by_key(|(key, _)| *key);
        let mut swapped = Tracker::new(TrackOptions::default()).unwrap();
        for (&(_, input), &again) in shuffled.iter().zip(&twice) {
            swapped.push(input).unwrap();
            if again {
                prop_assert_eq!(swapped.push(input).unwrap(), Taken::Duplicate);
            }
        }
        prop_assert_eq!(answers(&straight), answers(&swapped));
        let (a, b) = (straight.counts(), swapped.counts());
        prop_assert_eq!(a.in_order + a.late, b.in_order + b.late);
    }

    #[test]
    fn late_by_less_than_the_lag_in_a_long_flight(
        delays_s in prop::collection::vec(0.0..5.0f64, 300),
    ) {
        let inputs: Vec<Input> = (0..300)
            .map(f64::from)
            .map(|i| fix(0.5 * i, 4.0 * i, if i as i32 % 11 == 3 { 500.0 } else { 0.0 }, 0.8))
            .collect();
        let mut straight = Tracker::new(TrackOptions::default()).unwrap();
        for input in &inputs {
            straight.push(*input).unwrap();
        }
        let mut by_arrival: Vec<(f64, Input)> =
            delays_s.iter().zip(inputs).map(|(delay_s, input)| (input.time_s() + delay_s, input)).collect();
        by_arrival.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut late = Tracker::new(TrackOptions::default()).unwrap();
        for (_, input) in by_arrival {
            late.push(input).unwrap();
        }
        for time_s in [125.0, 149.5, 151.0] {
            prop_assert_eq!(straight.point_at(time_s), late.point_at(time_s));
        }
    }

    #[test]
    fn nothing_panics(
        numbers in prop::collection::vec(
            prop_oneof![
                Just(f64::NAN), Just(f64::INFINITY), Just(0.0), Just(-0.0), Just(1e300), Just(-1e300), Just(f64::MIN_POSITIVE),
                -400.0..400.0f64, 0.0..1.0f64, 0.0..1e6f64,
            ],
            12 * 30,
        ),
    ) {
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        for (index, n) in numbers.chunks(12).enumerate() {
            let time_s = if index % 5 == 0 { n[0] } else { index as f64 };
            let inputs = [
                Input::Attitude(Attitude { time_s, yaw_deg: n[1], pitch_deg: n[2], roll_deg: n[3] }),
                Input::Height(Height { time_s, agl_m: n[4], amsl_m: Some(n[5]) }),
                Input::Velocity(Velocity { time_s, east_m_s: n[1], north_m_s: n[2], sigma_m_s: n[3] }),
                Input::Motion(RelativeMotion {
                    from_time_s: time_s - n[6],
                    time_s,
                    forward_px: n[7],
                    right_px: n[8],
                    turn_deg: n[9],
                    sigma_px: n[10],
                    surface_sigma_px: Some(n[11]),
                }),
                Input::Fix(PositionFix {
                    time_s,
                    lonlat: LonLat::new(n[1], n[2]),
                    covariance_en_m2: [n[3], n[4], n[5]],
                    map_error_m: n[6],
                    heading_deg: Some(n[7]),
                    gsd_m: n[8],
                    confidence: n[11],
                }),
                Input::Miss(Miss { time_s }),
            ];
            for input in inputs {
                let _ = tracker.push(input);
            }
            let _ = tracker.point_at(n[0]);
            let _ = tracker.point_at(index as f64 + 1.0);
        }
    }
}

#[test]
fn what_is_too_late_or_far_ahead_is_refused_and_changes_nothing() {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    for second in 0..60 {
        tracker.push(fix(f64::from(second), 0.0, 0.0, 0.9)).unwrap();
    }
    let before = tracker.point_at(60.0);
    assert!(matches!(
        tracker.push(fix(20.0, 0.0, 0.0, 0.9)),
        Err(InputError::TooLate { .. })
    ));
    assert!(matches!(
        tracker.push(fix(5000.0, 0.0, 0.0, 0.9)),
        Err(InputError::ClockJump { .. })
    ));
    assert!(matches!(
        tracker.push(fix(f64::NAN, 0.0, 0.0, 0.9)),
        Err(InputError::Invalid {
            field: "time_s",
            ..
        })
    ));
    assert_eq!(tracker.point_at(60.0), before);
    let counts = tracker.counts();
    assert_eq!(
        (counts.too_late, counts.clock_jumps, counts.invalid),
        (1, 1, 1)
    );
}

#[test]
fn a_clock_that_was_set_for_good_starts_the_filter_again() {
    for jump_s in [86_400.0, -86_400.0, -100.0] {
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        for second in 0..60 {
            tracker.push(fix(f64::from(second), 0.0, 0.0, 0.9)).unwrap();
        }
        let mut restarted = 0;
        for second in 60..100 {
            let taken = tracker.push(fix(f64::from(second) + jump_s, 0.0, 0.0, 0.9));
            restarted += u64::from(taken == Ok(Taken::Restarted));
        }
        assert_eq!(restarted, 1);
        assert_eq!(tracker.counts().restarts, 1);
        let point = tracker.point_at(99.5 + jump_s).unwrap();
        assert!(point.state.is_usable(), "{point:?}");
    }
}

fn velocity(time_s: f64) -> Input {
    Input::Velocity(Velocity {
        time_s,
        east_m_s: 8.0,
        north_m_s: 0.0,
        sigma_m_s: 0.3,
    })
}

/// A flight of three minutes at 8 m/s to the east with a frame every second and velocities ten times a second. The clocks of camera
/// and telemetry are set by so many seconds after a minute. Gives the tracker, the seconds after that until the track could be used
/// again, and the largest error of a position that could be used, at the time of a frame, metres.
fn with_clocks_set(
    mut tracker: Tracker,
    camera_s: f64,
    telemetry_s: f64,
) -> (Tracker, Option<u32>, f64) {
    let (mut again, mut worst_m) = (None, 0.0f64);
    for second in 0..180u32 {
        let is_set = second >= 60;
        let clock_s = |by_s: f64| if is_set { by_s } else { 0.0 };
        for tenth in 0..10 {
            let now_s = f64::from(second) - 0.9 + 0.1 * f64::from(tenth);
            let _ = tracker.push(velocity(now_s + clock_s(telemetry_s)));
        }
        let frame_s = f64::from(second) + clock_s(camera_s);
        let east_m = 8.0 * f64::from(second);
        let _ = tracker.push(fix(frame_s, east_m, 0.0, 0.99));
        let point = tracker.point_at(frame_s);
        let usable = point.filter(|point| point.state.is_usable());
        let Some(estimate) = usable.and_then(|point| point.estimate) else {
            continue;
        };
        let place = LonLat::new(estimate.lon_deg, estimate.lat_deg);
        let truth = destination_en_m(START, east_m, 0.0);
        worst_m = worst_m.max(grimnet_geo::distance_m(place, truth));
        if is_set {
            again.get_or_insert(second - 60);
        }
    }
    (tracker, again, worst_m)
}

#[test]
fn both_clocks_set_back_or_ahead_cost_some_frames_and_no_wrong_position() {
    for by_s in [-45.0, -100.0, -290.0, 400.0] {
        let (tracker, again, worst_m) =
            with_clocks_set(Tracker::new(TrackOptions::default()).unwrap(), by_s, by_s);
        assert_eq!(tracker.counts().restarts, 1, "{by_s}");
        let step_s = tracker.clock_step_s().unwrap();
        assert!((step_s - by_s).abs() < 1.5, "{by_s}: {step_s}");
        assert!(
            again.is_some_and(|seconds| seconds <= 4),
            "{by_s}: {again:?}"
        );
        assert!(worst_m < 6.0, "{by_s}: {worst_m} m");
    }
}

#[test]
fn a_cameras_clock_that_is_set_alone_leads_and_the_telemetry_is_left_out() {
    for by_s in [-45.0, -100.0, -290.0] {
        let (tracker, again, worst_m) =
            with_clocks_set(Tracker::new(TrackOptions::default()).unwrap(), by_s, 0.0);
        assert_eq!(tracker.counts().restarts, 1, "{by_s}");
        assert!(
            again.is_some_and(|seconds| seconds <= 5),
            "{by_s}: {again:?}"
        );
        assert!(worst_m < 6.0, "{by_s}: {worst_m} m");
    }
    // Set ahead by as much, the frames may come after a pause: the track goes on with them alone.
    let (tracker, again, worst_m) =
        with_clocks_set(Tracker::new(TrackOptions::default()).unwrap(), 100.0, 0.0);
    assert!(again.is_some_and(|seconds| seconds <= 8), "{again:?}");
    assert!(worst_m < 6.0, "{worst_m} m");
    assert_eq!(tracker.counts().restarts, 0);
}

#[test]
fn a_clock_of_the_telemetry_that_is_set_alone_moves_no_frame() {
    for by_s in [-45.0, -100.0, -290.0, 400.0] {
        let (tracker, again, worst_m) =
            with_clocks_set(Tracker::new(TrackOptions::default()).unwrap(), 0.0, by_s);
        assert_eq!(tracker.counts().restarts, 0, "{by_s}");
        assert_eq!(again, Some(0), "{by_s}");
        assert!(worst_m < 6.0, "{by_s}: {worst_m} m");
    }
    // Ahead by less than a jump it is like a pause of the frames, until several of these tell otherwise.
    let (tracker, again, worst_m) =
        with_clocks_set(Tracker::new(TrackOptions::default()).unwrap(), 0.0, 100.0);
    assert_eq!(tracker.counts().restarts, 1);
    assert!(again.is_some_and(|seconds| seconds <= 5), "{again:?}");
    assert!(worst_m < 6.0, "{worst_m} m");
}

#[test]
fn late_inputs_by_themselves_set_no_clock() {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    for second in 0..200 {
        let now_s = f64::from(second);
        tracker.push(velocity(now_s)).unwrap();
        tracker.push(fix(now_s, 8.0 * now_s, 0.0, 0.99)).unwrap();
        if second > 50 {
            // Each of them of a delayed stream, which goes on as well.
            let late = fix(now_s - 40.0, 0.0, 0.0, 0.9);
            assert!(matches!(
                tracker.push(late),
                Err(InputError::TooLate { .. })
            ));
            assert!(tracker.push(velocity(now_s - 35.0)).is_err());
        }
    }
    assert_eq!(tracker.counts().restarts, 0);
    assert_eq!(tracker.clock_step_s(), None);
}
