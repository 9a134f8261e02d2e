//! A link and a check against a stand-in autopilot on loopback.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

#[path = "stand_in/autopilot.rs"]
mod autopilot;

use std::{
    collections::BTreeMap,
    net::{TcpListener, UdpSocket},
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use autopilot::{Seen, StandIn, Wire};
use grimnet_link::{
    Address, AutopilotKind, CheckOptions, Link, LinkClock, LinkEvent, LinkOptions, NmeaOutput,
    Output, PointAt, SigningKey, check,
};
use grimnet_track::{Estimate, Input, PositionOf, Source, TrackPoint, TrackState};
use mavlink::{
    SigningConfig, SigningData,
    dialects::common::{MavAutopilot, MavMessage, MavParamType},
};

/// Nothing here takes longer unless it is broken.
const PATIENCE: Duration = Duration::from_secs(60);

fn point(time_s: f64, state: TrackState) -> TrackPoint {
    TrackPoint {
        time_s,
        state,
        estimate: Some(Estimate {
            lat_deg: 24.2515,
            lon_deg: 120.7015,
            altitude_amsl_m: None,
            height_agl_m: Some(100.0),
            velocity_east_m_s: 0.0,
            velocity_north_m_s: 0.0,
            velocity_sigma_m_s: 0.3,
            heading_deg: None,
            heading_sigma_deg: None,
            covariance_en_m2: [4.0, 0.0, 4.0],
            radius95_m: 4.9,
            age_of_last_fix_s: Some(0.1),
            distance_since_fix_m: 0.0,
            test_ratio: 0.1,
            weight: 1.0,
            source: Source::Fix,
            position_of: PositionOf::Aircraft,
        }),
    }
}

fn tracking() -> PointAt {
    Arc::new(|time_s| Some(point(time_s, TrackState::Tracking)))
}

/// Waits until `done` gives something.
fn wait_for<T>(what: &str, mut done: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(value) = done() {
            return value;
        }
        assert!(began.elapsed() < PATIENCE, "waited in vain for {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

/// A UDP socket of the stand-in, and the address at which it is to be reached.
fn udp() -> (UdpSocket, Address) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = socket.local_addr().unwrap().port();
    (socket, format!("udpout:127.0.0.1:{port}").parse().unwrap())
}

fn first_odometry(seen: &Seen) -> Option<mavlink::dialects::common::ODOMETRY_DATA> {
    seen.lock()
        .unwrap()
        .iter()
        .find_map(|message| match message {
            MavMessage::ODOMETRY(data) => Some(data.clone()),
            _ => None,
        })
}

#[test]
fn positions_go_and_telemetry_comes_on_one_connection() {
    let (socket, address) = udp();
    let stand_in = StandIn::ardupilot(Wire::Udp(socket)).start();
    let clock = LinkClock::unix();
    let link = Link::start(LinkOptions::new(address), clock, tracking()).unwrap();
    let data = wait_for("ODOMETRY", || first_odometry(&stand_in.seen));
    // 0.0015 degrees in ArduPilot's metres.
    assert!((data.x - 166.978).abs() < 0.01, "{}", data.x);
    assert!((data.y - 152.24).abs() < 0.01, "{}", data.y);
    let sent_s = data.time_usec as f64 * 1e-6;
    assert!((sent_s - clock.now_s()).abs() < PATIENCE.as_secs_f64());
    let mut kinds = [false; 3];
    wait_for("telemetry", || {
        for input in link.inputs() {
            let now_s = clock.now_s();
            assert!(input.time_s() <= now_s && input.time_s() > now_s - PATIENCE.as_secs_f64());
            match input {
                Input::Attitude(attitude) => {
                    assert!((attitude.yaw_deg - 90.0).abs() < 1e-3);
                    kinds[0] = true;
                }
                Input::Height(height) => {
                    assert_eq!((height.agl_m, height.amsl_m), (100.0, Some(150.0)));
                    kinds[1] = true;
                }
                Input::Velocity(velocity) => {
                    assert_eq!((velocity.north_m_s, velocity.east_m_s), (7.0, 8.0));
                    kinds[2] = true;
                }
                other => panic!("{other:?}"),
            }
        }
        (kinds == [true; 3]).then_some(())
    });
    wait_for("status", || (link.status().sent > 3).then_some(()));
    let status = link.status();
    assert_eq!(status.sending, Some(Output::Odometry));
    assert_eq!(status.autopilot.unwrap().kind, AutopilotKind::ArduPilot);
    assert!(stand_in.heartbeats_of_an_onboard_computer() > 0);
    assert!(stand_in.answered_time_requests() > 0);
}

#[test]
fn nothing_is_sent_while_the_track_is_lost() {
    let (socket, address) = udp();
    let stand_in = StandIn::ardupilot(Wire::Udp(socket)).start();
    let state = Arc::new(Mutex::new(TrackState::Searching));
    let shared = Arc::clone(&state);
    let point_at: PointAt = Arc::new(move |time_s| Some(point(time_s, *shared.lock().unwrap())));
    let link = Link::start(LinkOptions::new(address), LinkClock::unix(), point_at).unwrap();
    wait_for("our answers", || {
        (stand_in.answered_time_requests() > 5).then_some(())
    });
    assert!(first_odometry(&stand_in.seen).is_none());
    *state.lock().unwrap() = TrackState::Tracking;
    wait_for("ODOMETRY", || first_odometry(&stand_in.seen));
    *state.lock().unwrap() = TrackState::Lost;
    wait_for("the end of it", || {
        link.status().sending.is_none().then_some(())
    });
    let sent = link.status().sent;
    let answered = stand_in.answered_time_requests();
    wait_for("more answers", || {
        (stand_in.answered_time_requests() > answered + 5).then_some(())
    });
    assert_eq!(link.status().sent, sent);
}

#[test]
fn a_tcp_connection_that_breaks_is_opened_again() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let address = format!("tcp:127.0.0.1:{port}").parse().unwrap();
    let link = Link::start(LinkOptions::new(address), LinkClock::unix(), tracking()).unwrap();
    for _ in 0..2 {
        let (stream, _) = listener.accept().unwrap();
        let stand_in = StandIn::ardupilot(Wire::Tcp(stream)).start();
        wait_for("ODOMETRY", || first_odometry(&stand_in.seen));
    }
    drop(listener);
    let lost = wait_for("the loss", || {
        link.events()
            .find(|event| matches!(event, LinkEvent::CannotOpen { .. }))
    });
    assert!(
        lost.to_string().contains(&format!("tcp:127.0.0.1:{port}")),
        "{lost}"
    );
}

#[test]
fn messages_are_signed_and_unsigned_ones_are_not_taken() {
    let key = [7; 32];
    let signing = || SigningData::from_config(SigningConfig::new(key, 1, true, false));
    let (socket, address) = udp();
    let mut options = LinkOptions::new(address);
    options.signing = Some(SigningKey::from_bytes(key));
    let unsigned = StandIn::ardupilot(Wire::Udp(socket.try_clone().unwrap())).start();
    let link = Link::start(options, LinkClock::unix(), tracking()).unwrap();
    wait_for("our heartbeat", || {
        (unsigned.heartbeats_of_an_onboard_computer() > 2).then_some(())
    });
    assert_eq!(link.status().autopilot, None);
    drop(unsigned);
    let signed = StandIn::ardupilot(Wire::Udp(socket))
        .signed(signing())
        .start();
    wait_for("signed ODOMETRY", || first_odometry(&signed.seen));
    assert_eq!(link.status().autopilot.unwrap().system_id, 1);
}

#[test]
fn sentences_arrive() {
    let (socket, address) = udp();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let _output = NmeaOutput::start(address, 100.0, LinkClock::unix(), tracking()).unwrap();
    let mut buffer = [0; 500];
    let length = socket.recv(&mut buffer).unwrap();
    let text = std::str::from_utf8(&buffer[..length]).unwrap();
    assert!(
        text.starts_with("$GPGGA,") && text.contains("\r\n$GPRMC,"),
        "{text}"
    );
    assert!(text.contains(",2415.09000,N,12042.09000,E,"), "{text}");
}

fn checked(stand_in: StandIn, address: Address) -> grimnet_link::CheckReport {
    let _running = stand_in.start();
    let options = CheckOptions {
        address,
        output: None,
        system_id: None,
        signing: None,
        within_s: PATIENCE.as_secs_f64(),
    };
    check(&options, &mut |_| {}).unwrap()
}

fn floats(values: &[(&'static str, f32)]) -> BTreeMap<&'static str, (f32, MavParamType)> {
    let kind = MavParamType::MAV_PARAM_TYPE_REAL32;
    values
        .iter()
        .map(|(name, value)| (*name, (*value, kind)))
        .collect()
}

#[test]
fn parameters_of_ardupilot_are_checked() {
    let (socket, address) = udp();
    let mut stand_in = StandIn::ardupilot(Wire::Udp(socket));
    stand_in.parameters = floats(&[
        ("AHRS_EKF_TYPE", 3.0),
        ("EK3_ENABLE", 1.0),
        ("VISO_TYPE", 3.0),
        ("VISO_DELAY_MS", 10.0),
        ("VISO_SCALE", 1.0),
        ("EK3_SRC1_POSXY", 3.0),
        ("EK3_SRC2_POSXY", 0.0),
        ("EK3_SRC2_VELXY", 0.0),
        ("EK3_SRC2_POSZ", 1.0),
        ("EK3_SRC2_VELZ", 0.0),
        ("EK3_SRC2_YAW", 1.0),
    ]);
    let report = checked(stand_in, address);
    assert_eq!(report.output, Output::Odometry);
    assert_eq!(report.autopilot.version.unwrap().to_string(), "4.6.3");
    assert!(!report.is_ready());
    let wrong: Vec<_> = report
        .findings
        .iter()
        .filter(|finding| finding.must_change())
        .map(|finding| (finding.parameter, finding.found, finding.set_to))
        .collect();
    assert_eq!(
        wrong,
        [
            ("VISO_TYPE", Some(3.0), 1.0),
            ("EK3_SRC2_POSXY", Some(0.0), 6.0)
        ]
    );
}

#[test]
fn integers_of_px4_are_read_from_their_bytes() {
    let integer = |value: i32| {
        let bits = f32::from_bits(u32::from_ne_bytes(value.to_ne_bytes()));
        (bits, MavParamType::MAV_PARAM_TYPE_INT32)
    };
    let mut parameters = floats(&[
        ("EKF2_AGP2_DELAY", 20.0),
        ("EKF2_AGP2_NOISE", 1.0),
        ("EKF2_AGP2_GATE", 3.0),
    ]);
    parameters.extend([
        ("EKF2_AGP0_ID", integer(0)),
        ("EKF2_AGP2_ID", integer(1)),
        ("EKF2_AGP2_CTRL", integer(1)),
    ]);
    let (socket, address) = udp();
    let mut stand_in = StandIn::ardupilot(Wire::Udp(socket));
    stand_in.autopilot = MavAutopilot::MAV_AUTOPILOT_PX4;
    stand_in.version = [1, 18, 0];
    stand_in.parameters = parameters;
    let report = checked(stand_in, address);
    assert_eq!(report.output, Output::GlobalPositionSensor);
    assert_eq!(report.findings.len(), 5);
    assert!(report.is_ready(), "{report:?}");
}

#[test]
fn an_autopilot_that_is_not_there_is_said() {
    let options = CheckOptions {
        address: "serial:/no/such/port:57600".parse().unwrap(),
        output: None,
        system_id: None,
        signing: None,
        within_s: 0.1,
    };
    let mut events = Vec::new();
    let error = check(&options, &mut |event| events.push(event.to_string())).unwrap_err();
    assert!(
        error.to_string().contains("serial:/no/such/port:57600"),
        "{error}"
    );
    assert!(error.to_string().contains("No such file"), "{error}");
    assert_eq!(events.len(), 1, "{events:?}");
}
