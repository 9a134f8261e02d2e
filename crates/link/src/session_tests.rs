//! Conversations with an autopilot, message by message.

use grimnet_track::{Estimate, Input, PositionOf, Source, TrackPoint, TrackState};
use mavlink::{
    MavHeader,
    dialects::common::{
        ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA,
        GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, GLOBAL_POSITION_INT_DATA, GPS_GLOBAL_ORIGIN_DATA,
        GimbalDeviceFlags, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavCmd, MavFrame,
        MavMessage, MavModeFlag, MavParamType, MavResult, MavType, ODOMETRY_DATA, PARAM_VALUE_DATA,
        TIMESYNC_DATA,
    },
    types::CharArray,
};
use nalgebra::UnitQuaternion;

use crate::{
    autopilot::AutopilotKind,
    event::{LinkEvent, NotSending},
    golden_tests::estimate,
    options::LinkOptions,
    output::Output,
    session::Session,
    telemetry::camera_mount::CameraMount,
};

const HEADER: MavHeader = MavHeader {
    system_id: 3,
    component_id: 1,
    sequence: 0,
};
/// The autopilot starts at this time of the link's clock.
const START_S: f64 = 900.0;

struct Flight {
    session: Session,
    now_s: f64,
    /// The autopilot's clock is this far from [`START_S`].
    restarted_s: f64,
    /// What the autopilot says of its version, if it does.
    version: Option<(u32, u32)>,
    mode: MavModeFlag,
    sent: Vec<MavMessage>,
    events: Vec<LinkEvent>,
    point: Option<TrackPoint>,
}

impl Flight {
    fn new(change: impl FnOnce(&mut LinkOptions)) -> Self {
        let mut options = LinkOptions::new("udpin:127.0.0.1:14550".parse().unwrap());
        change(&mut options);
        Self {
            session: Session::new(options, 1000.0),
            now_s: 1000.0,
            restarted_s: START_S,
            version: Some((4, 6)),
            mode: MavModeFlag::empty(),
            sent: Vec::new(),
            events: Vec::new(),
            point: Some(TrackPoint {
                time_s: 0.0,
                state: TrackState::Tracking,
                estimate: Some(estimate()),
            }),
        }
    }

    fn says(&mut self, message: &MavMessage) {
        self.session.receive(&HEADER, message, self.now_s);
    }

    /// A second, in which the autopilot says its heartbeat, its version and 20 attitudes, 20 ms late.
    fn second(&mut self, autopilot: MavAutopilot) {
        self.says(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot,
            mavtype: MavType::MAV_TYPE_FIXED_WING,
            base_mode: self.mode,
            ..HEARTBEAT_DATA::default()
        }));
        if let Some((major, minor)) = self.version {
            self.says(&MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
                flight_sw_version: major << 24 | minor << 16 | 255,
                ..AUTOPILOT_VERSION_DATA::default()
            }));
        }
        for _ in 0..20 {
            let boot_s = self.now_s - 0.02 - self.restarted_s;
            self.says(&MavMessage::ATTITUDE(ATTITUDE_DATA {
                time_boot_ms: (boot_s * 1e3).round() as u32,
                yaw: -0.5,
                ..ATTITUDE_DATA::default()
            }));
            self.step(0.05);
        }
    }

    fn step(&mut self, by_s: f64) {
        self.now_s += by_s;
        let point = self.point;
        let messages = self.session.poll(self.now_s, &|time_s| {
            point.map(|p| TrackPoint { time_s, ..p })
        });
        self.sent.extend(messages);
        self.events.append(&mut self.session.events);
    }

    fn says_origin(&mut self) {
        self.says(&MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
            latitude: 242_500_000,
            longitude: 1_207_000_000,
            ..GPS_GLOBAL_ORIGIN_DATA::default()
        }));
    }

    fn says_quality_min(&mut self, percent: f32) {
        self.says(&MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: percent,
            param_count: 1,
            param_index: 0,
            param_id: CharArray::from("VISO_QUAL_MIN"),
            param_type: MavParamType::MAV_PARAM_TYPE_INT8,
        }));
    }

    fn answers(&mut self, command: MavCmd, result: MavResult) {
        self.says(&MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            ..COMMAND_ACK_DATA::default()
        }));
    }

    /// What the autopilot says of an aircraft at an altitude, 100 m above where it started, that flies north.
    fn says_global_position(&mut self, lat: i32, alt_mm: i32, north_cm_s: i16) {
        let boot_s = self.now_s - self.restarted_s;
        self.says(&MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: (boot_s * 1e3) as u32,
            lat,
            alt: alt_mm,
            relative_alt: 100_000,
            vx: north_cm_s,
            ..GLOBAL_POSITION_INT_DATA::default()
        }));
    }

    /// The yaws of the camera that are taken in when a component reports a gimbal that looks down, turned so far from north.
    fn gimbal_yaws_deg(&mut self, component_id: u8, number: u8, yaw_deg: f32) -> Vec<f64> {
        let yaw = f64::from(yaw_deg).to_radians();
        let attitude = UnitQuaternion::from_euler_angles(0.0, -std::f64::consts::FRAC_PI_2, yaw);
        self.session.inputs.clear();
        let header = MavHeader {
            component_id,
            ..HEADER
        };
        let status =
            MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
                time_boot_ms: (self.now_s * 1e3) as u32 % 1_000_000,
                q: [attitude.w, attitude.i, attitude.j, attitude.k].map(|value| value as f32),
                flags: GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME,
                gimbal_device_id: number,
                ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
            });
        self.session.receive(&header, &status, self.now_s);
        self.yaws_deg()
    }

    /// The yaws of the camera that were taken in since the inputs were cleared, to the degree.
    fn yaws_deg(&self) -> Vec<f64> {
        let yaw_deg = |input: &Input| match input {
            Input::Attitude(attitude) => Some(attitude.yaw_deg.round()),
            _ => None,
        };
        self.session.inputs.iter().filter_map(yaw_deg).collect()
    }

    fn set_state(&mut self, state: TrackState) {
        self.point = self.point.map(|point| TrackPoint { state, ..point });
    }

    /// The positions that were sent since the last call.
    fn odometry(&mut self) -> Vec<ODOMETRY_DATA> {
        std::mem::take(&mut self.sent)
            .into_iter()
            .filter_map(|message| match message {
                MavMessage::ODOMETRY(data) => Some(data),
                _ => None,
            })
            .collect()
    }
}

const ARDUPILOT: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
const PX4: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_PX4;

#[test]
fn positions_are_for_the_time_of_sending_at_the_rate_of_the_autopilot() {
    for (autopilot, version, rate, frame) in [
        (ARDUPILOT, (4, 6), 10, MavFrame::MAV_FRAME_LOCAL_FRD),
        (PX4, (1, 17), 20, MavFrame::MAV_FRAME_LOCAL_NED),
    ] {
        let mut flight = Flight::new(|_| {});
        flight.version = Some(version);
        flight.second(autopilot);
        assert!(
            flight
                .events
                .contains(&LinkEvent::NotSending(NotSending::NoOrigin))
        );
        assert!(flight.odometry().is_empty());
        flight.says_origin();
        flight.second(autopilot);
        flight.odometry();
        let began_s = flight.now_s;
        flight.second(autopilot);
        flight.second(autopilot);
        let sent = flight.odometry();
        // The steps of this flight allow no more than 20 a second.
        assert!(sent.len().abs_diff(2 * rate) <= 1, "{}", sent.len());
        for data in &sent {
            assert_eq!(data.frame_id, frame);
            let time_s = data.time_usec as f64 * 1e-6;
            assert!(time_s > began_s && time_s <= flight.now_s + 1e-6);
            // The attitude is the autopilot's own.
            assert!((data.q[3] - (-0.25f32).sin()).abs() < 1e-6, "{:?}", data.q);
        }
    }
}

#[test]
fn nothing_is_sent_without_a_position_that_may_be_used() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    flight.says_origin();
    flight.second(ARDUPILOT);
    let first = flight.odometry().pop().unwrap();
    for state in [
        TrackState::Searching,
        TrackState::Ambiguous,
        TrackState::Lost,
    ] {
        flight.set_state(state);
        flight.second(ARDUPILOT);
        assert!(flight.odometry().is_empty(), "{state:?}");
    }
    // The filter of the autopilot is to begin again, but not with a position that no recent fix supports.
    for (state, jumps) in [(TrackState::Coasting, 0), (TrackState::Tracking, 1)] {
        flight.set_state(state);
        flight.second(ARDUPILOT);
        let sent = flight.odometry();
        assert!(
            sent.iter()
                .all(|data| data.reset_counter == first.reset_counter + jumps)
        );
        let is_worse = sent[0].quality < first.quality;
        assert!(sent[0].quality > 0 && is_worse == (state == TrackState::Coasting));
    }
    for change in [
        |estimate: &mut Estimate| estimate.radius95_m = 151.0,
        |estimate: &mut Estimate| estimate.radius95_m = f64::NAN,
        |estimate: &mut Estimate| estimate.position_of = PositionOf::ImageCentre,
    ] {
        let good = flight.point;
        change(flight.point.as_mut().unwrap().estimate.as_mut().unwrap());
        flight.second(ARDUPILOT);
        assert!(flight.odometry().is_empty());
        flight.point = good;
    }
    assert!(
        flight
            .events
            .contains(&LinkEvent::NotSending(NotSending::ImageCentre))
    );
    flight.point = None;
    flight.second(ARDUPILOT);
    assert!(flight.odometry().is_empty());
}

#[test]
fn a_jump_is_told() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    flight.says_origin();
    flight.second(ARDUPILOT);
    let before = flight.odometry().last().unwrap().reset_counter;
    // 5 m/s for 2 s and the error of a fix are no jump; 111 m are.
    for (d_lat_deg, expected) in [(5e-5, before), (1e-3, before + 1), (0.0, before + 1)] {
        let estimate = flight.point.as_mut().unwrap().estimate.as_mut().unwrap();
        estimate.lat_deg += d_lat_deg;
        flight.second(ARDUPILOT);
        let sent = flight.odometry();
        assert!(
            sent.iter().all(|data| data.reset_counter == expected),
            "{d_lat_deg}"
        );
    }
}

#[test]
fn px4_from_1_18_is_sent_its_own_message() {
    let mut flight = Flight::new(|_| {});
    flight.version = Some((1, 18));
    flight.second(PX4);
    assert!(
        flight
            .events
            .contains(&LinkEvent::Sending(Output::GlobalPositionSensor))
    );
    let mut sent = flight.sent.iter().filter_map(|message| match message {
        MavMessage::GLOBAL_POSITION_SENSOR(data) => Some(data),
        _ => None,
    });
    let data = sent.next_back().unwrap();
    assert_eq!((data.lat, data.lon), (242_634_567, 1_207_212_345));
    assert!(data.flags.is_empty());
}

#[test]
fn an_autopilot_that_goes_and_starts_again_is_followed() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    flight.says_origin();
    flight.second(ARDUPILOT);
    assert!(!flight.odometry().is_empty());
    for _ in 0..140 {
        flight.step(0.05);
    }
    assert!(
        flight
            .events
            .iter()
            .any(|event| matches!(event, LinkEvent::AutopilotSilent { .. }))
    );
    flight.odometry();
    flight.step(0.2);
    assert!(flight.odometry().is_empty());
    // It comes back with a new clock and without an origin.
    flight.restarted_s = flight.now_s - 1.0;
    flight.second(ARDUPILOT);
    assert!(flight.events.contains(&LinkEvent::AutopilotRestarted));
    assert!(flight.odometry().is_empty());
    flight.says_origin();
    flight.session.inputs.clear();
    flight.second(ARDUPILOT);
    assert!(!flight.odometry().is_empty());
    for input in &flight.session.inputs {
        let late_s = flight.now_s - input.time_s();
        assert!((0.0..1.1).contains(&late_s), "{late_s}");
    }
}

/// It may be the first message after it.
#[test]
fn a_quaternion_tells_a_restart() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    flight.session.inputs.clear();
    let came_s = flight.now_s;
    flight.says(&MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
        time_boot_ms: 500,
        q1: 1.0,
        ..ATTITUDE_QUATERNION_DATA::default()
    }));
    flight.step(0.05);
    assert!(flight.events.contains(&LinkEvent::AutopilotRestarted));
    let times_s: Vec<f64> = flight.session.inputs.iter().map(Input::time_s).collect();
    assert_eq!(times_s, [came_s]);
}

#[test]
fn telemetry_has_the_time_at_which_it_was_true() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    for _ in 0..3 {
        let asked_ns = loop {
            flight.sent.clear();
            flight.step(0.05);
            let asked = |message: &MavMessage| match message {
                MavMessage::TIMESYNC(data) if data.tc1 == 0 => Some(data.ts1),
                _ => None,
            };
            if let Some(asked_ns) = flight.sent.iter().find_map(asked) {
                break asked_ns;
            }
        };
        let sent_s = flight.now_s;
        flight.now_s += 0.004;
        // The answer to our request comes 4 ms after it and was made in the middle; one to somebody else, whose clock is 1 ms before
        // ours, is handed on.
        for (ts1, late_s) in [(asked_ns, 0.0), (asked_ns + 3_000_000, 0.5)] {
            flight.says(&MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: ((sent_s + 0.002 - START_S + late_s) * 1e9) as i64,
                ts1,
                ..TIMESYNC_DATA::default()
            }));
        }
    }
    flight.session.inputs.clear();
    let true_s = flight.now_s - 0.02;
    flight.second(ARDUPILOT);
    let Some(Input::Attitude(attitude)) = flight.session.inputs.first() else {
        panic!("{:?}", flight.session.inputs);
    };
    assert!(
        (attitude.time_s - true_s).abs() < 1e-3,
        "{} {true_s}",
        attitude.time_s
    );
    assert!((attitude.yaw_deg - (360.0 - 0.5f64.to_degrees())).abs() < 1e-5);
    // Its own request is answered with our time.
    flight.sent.clear();
    flight.says(&MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: 0,
        ts1: 12_345,
        ..TIMESYNC_DATA::default()
    }));
    let asked_s = flight.now_s;
    flight.step(0.01);
    let answers: Vec<_> = flight
        .sent
        .iter()
        .filter_map(|message| match message {
            MavMessage::TIMESYNC(data) if data.tc1 != 0 => Some((data.ts1, data.tc1)),
            _ => None,
        })
        .collect();
    assert_eq!(answers, [(12_345, (asked_s * 1e9) as i64)]);
}

#[test]
#[allow(deprecated, reason = "SET_GPS_GLOBAL_ORIGIN is what autopilots read")]
fn an_autopilot_without_an_origin_is_told_one_by_a_position_that_fixes_support() {
    let told = |flight: &Flight| {
        flight
            .sent
            .iter()
            .any(|message| matches!(message, MavMessage::SET_GPS_GLOBAL_ORIGIN(_)))
    };
    // It grants the requests, and has none to tell.
    let seconds = |flight: &mut Flight| {
        for _ in 0..10 {
            flight.second(ARDUPILOT);
            let granted = MavResult::MAV_RESULT_ACCEPTED;
            flight.answers(MavCmd::MAV_CMD_REQUEST_MESSAGE, granted);
        }
    };
    let mut flight = Flight::new(|_| {});
    flight.set_state(TrackState::Coasting);
    seconds(&mut flight);
    assert!(!told(&flight));
    flight.set_state(TrackState::Tracking);
    flight.second(ARDUPILOT);
    assert!(told(&flight));
    let mut never = Flight::new(|options| options.set_origin = false);
    seconds(&mut never);
    assert!(!told(&never));
}

#[test]
#[allow(deprecated, reason = "SET_GPS_GLOBAL_ORIGIN is what autopilots read")]
fn no_origin_is_told_while_the_requests_for_it_are_lost() {
    let origins = |flight: &Flight| {
        let is_origin =
            |message: &&MavMessage| matches!(message, MavMessage::SET_GPS_GLOBAL_ORIGIN(_));
        flight.sent.iter().filter(is_origin).count()
    };
    let denied = MavResult::MAV_RESULT_DENIED;
    let mut flight = Flight::new(|_| {});
    for _ in 0..30 {
        flight.second(ARDUPILOT);
        // What it answers to others, and to other requests, says nothing of ours.
        flight.answers(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, denied);
        flight.says(&MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
            target_system: 255,
            target_component: 190,
            ..COMMAND_ACK_DATA::default()
        }));
    }
    assert_eq!(origins(&flight), 0);
    for _ in 0..4 {
        // Twice for one request counts once.
        flight.answers(MavCmd::MAV_CMD_REQUEST_MESSAGE, denied);
        flight.answers(MavCmd::MAV_CMD_REQUEST_MESSAGE, denied);
        flight.second(ARDUPILOT);
    }
    assert_eq!(origins(&flight), 0);
    flight.answers(MavCmd::MAV_CMD_REQUEST_MESSAGE, denied);
    flight.second(ARDUPILOT);
    assert_eq!(origins(&flight), 1);
}

#[test]
#[allow(deprecated, reason = "SET_GPS_GLOBAL_ORIGIN is what autopilots read")]
fn the_origin_is_on_the_ground_and_never_below_an_altitude_that_is_not_known() {
    // Latitude and altitude that the autopilot states: an altitude alone, both, neither.
    for (lat, alt_mm, expected_mm) in [
        (0, 150_000, 0),
        (242_600_000, 150_000, 30_000),
        (242_600_000, 0, 0),
        (0, 0, 0),
    ] {
        let mut flight = Flight::new(|_| {});
        let estimate = flight.point.as_mut().unwrap().estimate.as_mut().unwrap();
        estimate.altitude_amsl_m = None;
        for _ in 0..8 {
            flight.second(ARDUPILOT);
            flight.says_global_position(lat, alt_mm, 0);
            flight.step(0.01);
            flight.answers(
                MavCmd::MAV_CMD_REQUEST_MESSAGE,
                MavResult::MAV_RESULT_ACCEPTED,
            );
        }
        let altitudes: Vec<i32> = flight
            .sent
            .iter()
            .filter_map(|message| match message {
                MavMessage::SET_GPS_GLOBAL_ORIGIN(data) => Some(data.altitude),
                _ => None,
            })
            .collect();
        assert_eq!(altitudes, [expected_mm], "{lat} {alt_mm}");
        let amsl_m: Vec<Option<f64>> = flight
            .session
            .inputs
            .iter()
            .filter_map(|input| match input {
                Input::Height(height) => Some(height.amsl_m),
                _ => None,
            })
            .collect();
        let known = (expected_mm != 0).then_some(150.0);
        assert!(!amsl_m.is_empty() && amsl_m.iter().all(|value| *value == known));
    }
}

#[test]
fn others_on_the_link_are_not_taken_for_the_autopilot() {
    let mut flight = Flight::new(|options| options.system_id = Some(3));
    let heartbeat = |autopilot| {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot,
            ..HEARTBEAT_DATA::default()
        })
    };
    for (system_id, component_id, autopilot) in [
        (255, 190, MavAutopilot::MAV_AUTOPILOT_INVALID),
        (3, 154, MavAutopilot::MAV_AUTOPILOT_INVALID),
        (4, 1, ARDUPILOT),
        (3, 191, ARDUPILOT),
    ] {
        let header = MavHeader {
            system_id,
            component_id,
            sequence: 0,
        };
        flight
            .session
            .receive(&header, &heartbeat(autopilot), flight.now_s);
        assert_eq!(flight.session.autopilot(), None, "{header:?}");
    }
    flight.second(ARDUPILOT);
    assert_eq!(flight.session.autopilot().unwrap().system_id, 3);
}

#[test]
fn positions_never_go_to_another_aircraft_than_the_first() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    flight.says_origin();
    flight.second(ARDUPILOT);
    assert!(!flight.odometry().is_empty());
    // It falls silent, and another aircraft is heard on the same network.
    let other = MavHeader {
        system_id: 4,
        ..HEADER
    };
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        autopilot: ARDUPILOT,
        ..HEARTBEAT_DATA::default()
    });
    let origin = MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA::default());
    for _ in 0..20 {
        flight.step(0.5);
        for message in [&heartbeat, &origin] {
            flight.session.receive(&other, message, flight.now_s);
        }
    }
    assert_eq!(flight.session.autopilot(), None);
    flight.odometry();
    flight.step(0.5);
    assert!(flight.odometry().is_empty());
    assert_eq!(flight.session.system_id(), 3);
    // The first one comes back, with other software too.
    flight.second(PX4);
    let back = flight.session.autopilot().unwrap();
    assert_eq!((back.system_id, back.kind), (3, AutopilotKind::Px4));
}

#[test]
fn a_position_is_set_only_while_fixes_support_it() {
    let mut flight = Flight::new(|options| options.output = Some(Output::PositionEstimate));
    let mut sent_in_three_seconds = |state| {
        flight.set_state(state);
        flight.sent.clear();
        (0..3).for_each(|_| flight.second(ARDUPILOT));
        let is_position = |message: &&MavMessage| matches!(message, MavMessage::COMMAND_INT(_));
        flight.sent.iter().filter(is_position).count()
    };
    assert!(sent_in_three_seconds(TrackState::Tracking) >= 2);
    assert_eq!(sent_in_three_seconds(TrackState::Coasting), 0);
    assert!(sent_in_three_seconds(TrackState::Tracking) >= 2);
    let why = LinkEvent::NotSending(NotSending::NoRecentFix);
    assert!(flight.events.contains(&why));
}

/// For some seconds the autopilot's own velocity may carry a position on; later it would be told what it believes already.
#[test]
fn the_autopilots_own_velocity_is_not_sent_back_for_long() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    flight.says_origin();
    let mut sent = |state, source, age_of_last_fix_s| {
        flight.set_state(state);
        let estimate = flight.point.as_mut().unwrap().estimate.as_mut().unwrap();
        estimate.source = source;
        estimate.age_of_last_fix_s = Some(age_of_last_fix_s);
        flight.second(ARDUPILOT);
        !flight.odometry().is_empty()
    };
    assert!(sent(TrackState::Coasting, Source::Velocity, 9.9));
    assert!(!sent(TrackState::Coasting, Source::Velocity, 10.1));
    // Without positions it gives up its own, and tells no velocity any more.
    assert!(!sent(TrackState::Coasting, Source::Prediction, 20.0));
    assert!(sent(TrackState::Coasting, Source::Motion, 10.1));
    assert!(sent(TrackState::Tracking, Source::Velocity, 10.1));
    // A prediction from fixes, without a velocity of the autopilot.
    assert!(sent(TrackState::Tracking, Source::Prediction, 1.0));
    assert!(sent(TrackState::Coasting, Source::Prediction, 20.0));
    let why = LinkEvent::NotSending(NotSending::OwnVelocity);
    assert!(flight.events.contains(&why));
}

/// Silent for longer than it had run, it may come back with a later time and yet have started again.
#[test]
fn an_autopilot_that_was_silent_is_asked_for_its_origin_again() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    flight.says_origin();
    flight.second(ARDUPILOT);
    assert!(!flight.odometry().is_empty());
    (0..20).for_each(|_| flight.step(0.5));
    flight.odometry();
    flight.second(ARDUPILOT);
    assert!(flight.odometry().is_empty());
    flight.says_origin();
    flight.second(ARDUPILOT);
    assert!(!flight.odometry().is_empty());
}

/// Likewise: what it says then has the times of its new start.
#[test]
fn an_autopilot_that_was_silent_may_have_another_clock() {
    let mut flight = Flight::new(|_| {});
    flight.restarted_s = 990.0;
    flight.second(ARDUPILOT);
    (0..80).for_each(|_| flight.step(0.5));
    flight.restarted_s = 1015.0;
    flight.session.inputs.clear();
    let began_s = flight.now_s;
    flight.second(ARDUPILOT);
    let first_s = flight.session.inputs.first().unwrap().time_s();
    assert!((first_s - began_s).abs() < 0.1, "{first_s} {began_s}");
}

#[test]
fn a_dry_run_tells_and_sends_nothing() {
    let mut flight = Flight::new(|options| options.dry_run = true);
    for _ in 0..100 {
        flight.step(0.05);
    }
    assert!(flight.sent.is_empty());
    let told: Vec<String> = flight.events.iter().map(ToString::to_string).collect();
    assert!(
        told.iter()
            .any(|line| line.starts_with("would send ODOMETRY x 0.00 y 0.00")),
        "{told:?}"
    );
    assert!(
        told.contains(&"autopilot: none heard; assumed: ArduPilot, system 1".to_owned()),
        "{told:?}"
    );
    // A message that PX4 alone reads is shown as for PX4.
    let mut px4 = Flight::new(|options| {
        options.dry_run = true;
        options.output = Some(Output::GlobalPositionSensor);
    });
    (0..100).for_each(|_| px4.step(0.05));
    let shown = |event: &LinkEvent| event.to_string().starts_with("would send GLOBAL_POSITION");
    assert!(px4.events.iter().any(shown), "{:?}", px4.events);
    // The first autopilot that is heard takes the place of the assumed one.
    flight.second(PX4);
    let heard = flight.session.autopilot().unwrap();
    assert_eq!((heard.system_id, heard.kind), (3, AutopilotKind::Px4));
    assert!(flight.events.contains(&LinkEvent::Autopilot(heard)));
}

#[test]
fn a_message_that_the_autopilot_does_not_read_is_not_sent_and_why_is_told() {
    for (autopilot, version, output, reads) in [
        (PX4, (1, 17), Output::GpsInput, false),
        (PX4, (1, 17), Output::GlobalPositionSensor, false),
        (PX4, (1, 18), Output::GlobalPositionSensor, true),
        (ARDUPILOT, (4, 6), Output::GlobalPositionSensor, false),
        (ARDUPILOT, (4, 4), Output::PositionEstimate, false),
        (ARDUPILOT, (4, 6), Output::GpsInput, true),
    ] {
        let mut flight = Flight::new(|options| options.output = Some(output));
        flight.version = Some(version);
        (0..2).for_each(|_| flight.second(autopilot));
        let is_refusal =
            |event: &LinkEvent| matches!(event, LinkEvent::NotSending(NotSending::NotRead(_)));
        let refused = flight.events.iter().any(is_refusal);
        let sends = flight.events.contains(&LinkEvent::Sending(output));
        assert_eq!((refused, sends), (!reads, reads), "{:?}", flight.events);
        assert_eq!(flight.session.sent() > 0, reads, "{output}");
    }
    // Whether software that is not known reads it cannot be told.
    let mut flight = Flight::new(|options| options.output = Some(Output::GpsInput));
    flight.second(MavAutopilot::MAV_AUTOPILOT_GENERIC);
    let event = LinkEvent::SendingToUnknown(Output::GpsInput);
    assert!(flight.events.contains(&event), "{:?}", flight.events);
    assert!(flight.session.sent() > 0);
}

#[test]
fn gimbal_messages_that_come_together_keep_their_times() {
    for (component_id, gimbal_start_s) in [(1, START_S), (154, 700.0)] {
        let mut flight = Flight::new(|_| {});
        flight.second(ARDUPILOT);
        flight.session.inputs.clear();
        let header = MavHeader {
            component_id,
            ..HEADER
        };
        let first_s = flight.now_s;
        for step in 0..20 {
            let true_s = first_s + f64::from(step) * 0.05;
            let status =
                MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
                    time_boot_ms: ((true_s - gimbal_start_s) * 1e3).round() as u32,
                    q: [1.0, 0.0, 0.0, 0.0],
                    flags: GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME,
                    ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
                });
            // Read two by two, 20 ms late.
            let now_s = first_s + f64::from(step / 2 * 2 + 1) * 0.05 + 0.02;
            flight.session.receive(&header, &status, now_s);
        }
        let times: Vec<f64> = flight.session.inputs.iter().map(Input::time_s).collect();
        assert_eq!(times.len(), 20);
        for (step, time_s) in times.iter().enumerate().skip(2) {
            let expected_s = first_s + step as f64 * 0.05 + 0.02;
            assert!((time_s - expected_s).abs() < 1e-3, "{time_s} {expected_s}");
        }
    }
}

#[test]
fn the_gimbal_of_another_camera_is_not_taken_for_the_cameras() {
    let north_of = |mount| {
        let mut flight = Flight::new(|options| options.telemetry.camera_mount = mount);
        flight.second(ARDUPILOT);
        flight
    };
    // The first one that reports, and no other one afterwards.
    let mut first = north_of(CameraMount::GimbalIfReported);
    assert_eq!(first.gimbal_yaws_deg(154, 0, 40.0), [40.0]);
    assert!(first.gimbal_yaws_deg(171, 0, 90.0).is_empty());
    assert!(first.gimbal_yaws_deg(1, 1, 90.0).is_empty());
    first.step(0.05);
    let told = |flight: &Flight| {
        let is_gimbal = |event: &&LinkEvent| matches!(event, LinkEvent::Gimbal(_));
        flight.events.iter().filter(is_gimbal).cloned().collect()
    };
    let gimbals: Vec<LinkEvent> = told(&first);
    assert_eq!(gimbals, [LinkEvent::Gimbal(154)]);
    // Silent, it still carries the camera: the aircraft's attitude is not the camera's.
    first.session.inputs.clear();
    (0..3).for_each(|_| first.second(ARDUPILOT));
    assert!(first.yaws_deg().is_empty());
    assert_eq!(first.gimbal_yaws_deg(154, 0, 41.0), [41.0]);
    // Named by its component, or by its number at the autopilot.
    let mut named = north_of(CameraMount::Gimbal(2));
    assert!(named.yaws_deg().is_empty());
    assert!(named.gimbal_yaws_deg(1, 1, 90.0).is_empty());
    assert!(named.gimbal_yaws_deg(154, 0, 90.0).is_empty());
    assert_eq!(named.gimbal_yaws_deg(1, 2, 40.0), [40.0]);
    // A fixed camera beside gimbals, and one of which nothing is known.
    for (mount, is_aircrafts) in [(CameraMount::Fixed, true), (CameraMount::Unknown, false)] {
        let mut flight = north_of(mount);
        assert_eq!(!flight.yaws_deg().is_empty(), is_aircrafts);
        assert!(flight.gimbal_yaws_deg(154, 0, 90.0).is_empty());
        flight.session.inputs.clear();
        flight.second(ARDUPILOT);
        assert_eq!(flight.yaws_deg().len(), if is_aircrafts { 20 } else { 0 });
        let gimbals: Vec<LinkEvent> = told(&flight);
        assert_eq!(gimbals, []);
    }
}

#[test]
fn a_fixed_camera_that_is_mounted_turned_has_another_yaw_than_the_aircraft() {
    let yaws_deg = |mount: &str| {
        let mut flight = Flight::new(|options| {
            options.telemetry.camera_mount = CameraMount::Fixed;
            options.telemetry.fixed_mount = mount.parse().unwrap();
        });
        flight.second(ARDUPILOT);
        flight.yaws_deg()
    };
    let of_aircraft = yaws_deg("0");
    assert!(!of_aircraft.is_empty());
    let to_the_right = of_aircraft.iter().map(|yaw_deg| (yaw_deg + 90.0) % 360.0);
    assert_eq!(yaws_deg("90"), to_the_right.collect::<Vec<_>>());
}

#[test]
fn a_velocity_for_which_the_autopilot_does_not_vouch_is_not_taken() {
    let velocities = |flight: &mut Flight| {
        let inputs = std::mem::take(&mut flight.session.inputs);
        let north_m_s = |input: &Input| match input {
            Input::Velocity(velocity) => Some(velocity.north_m_s),
            _ => None,
        };
        inputs.iter().filter_map(north_m_s).collect::<Vec<f64>>()
    };
    let generic = MavAutopilot::MAV_AUTOPILOT_GENERIC;
    for (autopilot, expected) in [(ARDUPILOT, None), (PX4, None), (generic, Some(0.03))] {
        let mut flight = Flight::new(|_| {});
        flight.second(autopilot);
        flight.says(&MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: 101_000,
            vx: 10.0,
            ..LOCAL_POSITION_NED_DATA::default()
        }));
        assert_eq!(velocities(&mut flight), [10.0]);
        // GNSS is lost: what comes further states a velocity near 0.
        (0..3).for_each(|_| flight.second(autopilot));
        flight.says_global_position(242_600_000, 150_000, 3);
        assert_eq!(velocities(&mut flight), Vec::from_iter(expected));
    }
}

#[test]
fn a_disarmed_ardupilot_that_reads_the_quality_hears_of_the_source_before_there_is_a_position() {
    let asked = |flight: &Flight| {
        let is_request = |message: &MavMessage| {
            matches!(message, MavMessage::PARAM_REQUEST_READ(data)
                if data.param_id.to_str() == Ok("VISO_QUAL_MIN"))
        };
        flight.sent.iter().any(is_request)
    };
    let mut flight = Flight::new(|_| {});
    flight.set_state(TrackState::Searching);
    flight.second(ARDUPILOT);
    assert!(asked(&flight));
    // It may be a version that does not know the quality, and takes what it hears for a position.
    (0..10).for_each(|_| flight.second(ARDUPILOT));
    assert!(flight.odometry().is_empty());
    flight.says_quality_min(-1.0);
    flight.second(ARDUPILOT);
    assert!(flight.odometry().is_empty());
    flight.says_quality_min(0.0);
    for _ in 0..2 {
        flight.second(ARDUPILOT);
        let sent = flight.odometry();
        // At least one in 300 ms, or it is not healthy.
        assert!(sent.len().abs_diff(10) <= 1, "{}", sent.len());
        for data in sent {
            assert_eq!(data.quality, -1);
            assert_eq!(data.frame_id, MavFrame::MAV_FRAME_LOCAL_FRD);
            assert_eq!(data.child_frame_id, MavFrame::MAV_FRAME_BODY_FRD);
            assert!(
                data.q
                    .iter()
                    .chain(&data.pose_covariance)
                    .all(|value| value.is_finite())
            );
        }
    }
    assert!(!asked(&flight));
    assert_eq!((flight.session.sent(), flight.session.sending()), (0, None));
    // In flight the silence says that the source is gone.
    flight.mode = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
    flight.second(ARDUPILOT);
    assert!(flight.odometry().is_empty());
    // A position takes its place.
    flight.mode = MavModeFlag::empty();
    flight.says_origin();
    flight.set_state(TrackState::Tracking);
    flight.second(ARDUPILOT);
    assert!(flight.odometry().iter().all(|data| data.quality > 0));
    assert!(flight.session.sent() > 5);
}

#[test]
fn no_position_is_told_to_autopilots_that_do_not_need_it() {
    for (autopilot, output) in [(PX4, None), (ARDUPILOT, Some(Output::PositionEstimate))] {
        let mut flight = Flight::new(|options| options.output = output);
        flight.version = Some((1, 17));
        flight.set_state(TrackState::Searching);
        flight.second(autopilot);
        flight.says_quality_min(0.0);
        (0..10).for_each(|_| flight.second(autopilot));
        let requests = |message: &MavMessage| matches!(message, MavMessage::PARAM_REQUEST_READ(_));
        assert!(!flight.sent.iter().any(requests));
        assert!(flight.odometry().is_empty());
    }
}

#[test]
fn positions_wait_for_the_version_but_not_forever() {
    let of_version = |version| {
        let mut flight = Flight::new(|_| {});
        flight.version = None;
        flight.second(PX4);
        flight.says_origin();
        flight.second(PX4);
        assert!(flight.odometry().is_empty());
        let why = LinkEvent::NotSending(NotSending::NoVersion);
        assert!(flight.events.contains(&why));
        flight.version = version;
        (0..2).for_each(|_| flight.second(PX4));
        flight.session.sending()
    };
    assert_eq!(of_version(Some((1, 17))), Some(Output::Odometry));
    assert_eq!(
        of_version(Some((1, 18))),
        Some(Output::GlobalPositionSensor)
    );
    assert_eq!(of_version(None), Some(Output::Odometry));
}

#[test]
fn refusals_are_told_when_they_change() {
    let mut flight = Flight::new(|options| options.output = Some(Output::PositionEstimate));
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    let failed = MavResult::MAV_RESULT_FAILED;
    let denied = MavResult::MAV_RESULT_DENIED;
    for result in [accepted, failed, failed, failed, denied, accepted, accepted] {
        flight.second(ARDUPILOT);
        flight.answers(MavCmd::MAV_CMD_EXTERNAL_POSITION_ESTIMATE, result);
    }
    flight.step(0.05);
    let told: Vec<String> = flight
        .events
        .iter()
        .map(ToString::to_string)
        .filter(|line| line.contains("the positions"))
        .collect();
    assert_eq!(
        told,
        [
            "the autopilot refuses the positions: MAV_RESULT_FAILED",
            "the autopilot refuses the positions: MAV_RESULT_DENIED",
            "the autopilot takes the positions",
        ]
    );
}
