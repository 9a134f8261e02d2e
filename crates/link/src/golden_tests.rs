//! Messages and sentences against pymavlink and pynmea2 (`tests/golden/make_golden.py`).

use grimnet_track::{Estimate, PositionOf, Source, TrackPoint, TrackState};
use mavlink::{
    MAVLinkV2MessageRaw, MavHeader, MavlinkReader, Message as _, dialects::common::MavMessage,
};
use nalgebra::UnitQuaternion;

use crate::{
    autopilot::{Autopilot, AutopilotKind, Version},
    connection::OWN_COMPONENT,
    messages::{OwnState, Position},
    nmea::nmea_sentences,
    projection::Projection,
};

const TIME_S: f64 = 1_790_000_000.25;

/// A position that may be used, the one of `make_golden.py`.
pub(crate) fn estimate() -> Estimate {
    Estimate {
        lat_deg: 24.263_456_7,
        lon_deg: 120.721_234_5,
        altitude_amsl_m: Some(151.25),
        height_agl_m: Some(120.0),
        velocity_east_m_s: 4.0,
        velocity_north_m_s: -3.0,
        velocity_sigma_m_s: 0.25,
        heading_deg: Some(30.0),
        heading_sigma_deg: Some(1.0),
        covariance_en_m2: [2.0, 0.5, 3.0],
        radius95_m: 4.0,
        age_of_last_fix_s: Some(0.2),
        distance_since_fix_m: 1.0,
        test_ratio: 0.1,
        weight: 0.98,
        source: Source::Motion,
        position_of: PositionOf::Aircraft,
    }
}

pub(crate) fn autopilot(kind: AutopilotKind, major: u8, minor: u8) -> Autopilot {
    Autopilot {
        system_id: 7,
        component_id: 1,
        kind,
        version: Some(Version {
            major,
            minor,
            patch: 0,
        }),
    }
}

fn message(name: &str) -> MavMessage {
    let position = Position {
        time_s: TIME_S,
        state: TrackState::Tracking,
        estimate: estimate(),
        own: OwnState {
            attitude: Some(UnitQuaternion::from_euler_angles(0.1, -0.05, 0.55)),
            down_m: Some(-120.5),
            velocity_down_m_s: Some(0.5),
            altitude_amsl_m: Some(151.25),
        },
    };
    let odometry = |autopilot: &Autopilot| {
        let origin = Projection {
            lat_deg: 24.25,
            lon_deg: 120.70,
            kind: autopilot.kind,
        };
        MavMessage::ODOMETRY(position.odometry(autopilot, &origin, 3))
    };
    let px4 = autopilot(AutopilotKind::Px4, 1, 18);
    match name {
        "odometry_ardupilot_4_7" => odometry(&autopilot(AutopilotKind::ArduPilot, 4, 7)),
        "odometry_ardupilot_4_6" => odometry(&autopilot(AutopilotKind::ArduPilot, 4, 6)),
        "odometry_px4_1_17" => odometry(&autopilot(AutopilotKind::Px4, 1, 17)),
        "global_position_sensor" => {
            MavMessage::GLOBAL_POSITION_SENSOR(position.global_position_sensor(&px4))
        }
        "position_estimate" => MavMessage::COMMAND_INT(position.position_estimate(&px4)),
        "gps_input" => MavMessage::GPS_INPUT(position.gps_input(2)),
        other => panic!("{other}"),
    }
}

fn bytes_from_hex(hex: &str) -> Vec<u8> {
    (0..hex.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
        .collect()
}

#[test]
fn messages_are_those_of_pymavlink() {
    let header = MavHeader {
        system_id: 7,
        component_id: OWN_COMPONENT,
        sequence: 5,
    };
    let golden = include_str!("../tests/golden/mavlink.txt");
    assert_eq!(golden.lines().count(), 6);
    for line in golden.lines() {
        let (name, hex) = line.split_once(' ').unwrap();
        let expected = bytes_from_hex(hex);
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message(header, &message(name));
        let ours = frame.raw_bytes();
        if ours == expected {
            continue;
        }
        // Angles and metres may differ in the last bit of a float: then all bytes but those of the floats agree, and the
        // floats within 1e-6.
        let (_, theirs) = MavlinkReader::new(expected.as_slice())
            .read_any_message::<MavMessage>()
            .unwrap();
        assert_eq!(ours.len(), expected.len(), "{name}");
        assert_same_odometry(name, &message(name), &theirs);
    }
}

fn assert_same_odometry(name: &str, ours: &MavMessage, theirs: &MavMessage) {
    let (MavMessage::ODOMETRY(a), MavMessage::ODOMETRY(b)) = (ours, theirs) else {
        panic!("{name}: {ours:?} {theirs:?}");
    };
    assert_eq!(ours.message_id(), theirs.message_id());
    assert_eq!(a.time_usec, b.time_usec, "{name}");
    assert_eq!(
        (a.frame_id, a.child_frame_id),
        (b.frame_id, b.child_frame_id)
    );
    assert_eq!((a.reset_counter, a.quality), (b.reset_counter, b.quality));
    assert_eq!(a.estimator_type, b.estimator_type);
    let floats = |data: &mavlink::dialects::common::ODOMETRY_DATA| {
        let mut all = vec![data.x, data.y, data.z, data.vx, data.vy, data.vz];
        all.extend(data.q);
        all.extend(data.pose_covariance);
        all.extend(data.velocity_covariance);
        all
    };
    for (a, b) in floats(a).iter().zip(floats(b)) {
        assert!((a - b).abs() <= 1e-6 * b.abs().max(1.0), "{name}: {a} {b}");
    }
    for rate in [a.rollspeed, a.pitchspeed, a.yawspeed] {
        assert!(rate.is_nan(), "{name}");
    }
}

#[test]
fn sentences_are_those_of_pynmea2() {
    let tracking = TrackPoint {
        time_s: TIME_S,
        state: TrackState::Tracking,
        estimate: Some(estimate()),
    };
    let coasting = TrackPoint {
        state: TrackState::Coasting,
        estimate: Some(Estimate {
            lat_deg: -33.999_999_99,
            lon_deg: 359.5,
            altitude_amsl_m: None,
            ..estimate()
        }),
        ..tracking
    };
    let golden = include_str!("../tests/golden/nmea.txt");
    for (name, point) in [("tracking", tracking), ("coasting", coasting)] {
        let expected: String = golden
            .lines()
            .filter_map(|line| line.strip_prefix(name)?.strip_prefix(' '))
            .map(|sentence| format!("{sentence}\r\n"))
            .collect();
        assert_eq!(nmea_sentences(&point, 100.0).unwrap(), expected);
        assert!(expected.lines().all(|line| line.len() <= 80), "{expected}");
    }
    for state in [
        TrackState::Searching,
        TrackState::Ambiguous,
        TrackState::Lost,
    ] {
        assert_eq!(
            nmea_sentences(&TrackPoint { state, ..tracking }, 100.0),
            None
        );
    }
    assert_eq!(nmea_sentences(&tracking, 3.9), None);
}
