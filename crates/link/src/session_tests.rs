//! Conversations with an autopilot, message by message.

use grimnet_track::{Estimate, Input, PositionOf, TrackPoint, TrackState};
use mavlink::{
    MavHeader,
    dialects::common::{
        ATTITUDE_DATA, AUTOPILOT_VERSION_DATA, GIMBAL_DEVICE_ATTITUDE_STATUS_DATA,
        GPS_GLOBAL_ORIGIN_DATA, GimbalDeviceFlags, HEARTBEAT_DATA, MavAutopilot, MavFrame,
        MavMessage, MavType, ODOMETRY_DATA, TIMESYNC_DATA,
    },
};

use crate::{
    autopilot::AutopilotKind,
    event::{LinkEvent, NotSending},
    golden_tests::estimate,
    options::LinkOptions,
    output::Output,
    session::Session,
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

    /// A second, in which the autopilot says its heartbeat and 20 attitudes, 20 ms late.
    fn second(&mut self, autopilot: MavAutopilot) {
        self.says(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot,
            mavtype: MavType::MAV_TYPE_FIXED_WING,
            ..HEARTBEAT_DATA::default()
        }));
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

    fn says_version(&mut self, major: u32, minor: u32) {
        self.says(&MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            flight_sw_version: major << 24 | minor << 16 | 255,
            ..AUTOPILOT_VERSION_DATA::default()
        }));
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
        flight.second(autopilot);
        assert!(
            flight
                .events
                .contains(&LinkEvent::NotSending(NotSending::NoOrigin))
        );
        assert!(flight.odometry().is_empty());
        flight.says_origin();
        flight.says_version(version.0, version.1);
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
    flight.set_state(TrackState::Coasting);
    flight.second(ARDUPILOT);
    let sent = flight.odometry();
    // The filter of the autopilot is to begin again.
    assert!(
        sent.iter()
            .all(|data| data.reset_counter == first.reset_counter + 1)
    );
    assert!(sent[0].quality > 0 && sent[0].quality < first.quality);
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
    flight.second(PX4);
    flight.says_version(1, 18);
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

#[test]
fn telemetry_has_the_time_at_which_it_was_true() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    // The answer to our request comes 4 ms after it and was made in the middle.
    for _ in 0..3 {
        let sent_s = flight.now_s;
        flight.now_s += 0.004;
        flight.says(&MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: ((sent_s + 0.002 - START_S) * 1e9) as i64,
            ts1: (sent_s * 1e9) as i64,
            ..TIMESYNC_DATA::default()
        }));
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
    let mut flight = Flight::new(|_| {});
    flight.set_state(TrackState::Coasting);
    (0..10).for_each(|_| flight.second(ARDUPILOT));
    assert!(!told(&flight));
    flight.set_state(TrackState::Tracking);
    flight.second(ARDUPILOT);
    assert!(told(&flight));
    let mut never = Flight::new(|options| options.set_origin = false);
    (0..10).for_each(|_| never.second(ARDUPILOT));
    assert!(!told(&never));
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
    // The first autopilot that is heard takes the place of the assumed one.
    flight.second(PX4);
    let heard = flight.session.autopilot().unwrap();
    assert_eq!((heard.system_id, heard.kind), (3, AutopilotKind::Px4));
    assert!(flight.events.contains(&LinkEvent::Autopilot(heard)));
}

#[test]
fn a_gimbal_with_a_clock_of_its_own_counts_by_its_arrival() {
    let mut flight = Flight::new(|_| {});
    flight.second(ARDUPILOT);
    for (component_id, is_own) in [(1, true), (154, false)] {
        flight.session.inputs.clear();
        let header = MavHeader {
            component_id,
            ..HEADER
        };
        let status =
            MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
                time_boot_ms: 50_000,
                q: [1.0, 0.0, 0.0, 0.0],
                flags: GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME,
                ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::default()
            });
        flight.session.receive(&header, &status, flight.now_s);
        let [Input::Attitude(attitude)] = flight.session.inputs[..] else {
            panic!("{:?}", flight.session.inputs);
        };
        let expected_s = if is_own {
            START_S + 50.0 + 0.02
        } else {
            flight.now_s
        };
        assert!(
            (attitude.time_s - expected_s).abs() < 1e-3,
            "{component_id}: {} {expected_s}",
            attitude.time_s
        );
    }
}
