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
    MavHeader, SigningConfig, SigningData,
    dialects::common::{
        HEARTBEAT_DATA, MavAutopilot, MavCmd, MavFrame, MavMessage, MavParamType, MavType,
    },
    write_v2_msg_signed,
};
#[cfg(target_os = "linux")]
use serial2::SerialPort;

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

/// The last positions that were sent, at most `count`.
fn latest_odometry(seen: &Seen, count: usize) -> Vec<mavlink::dialects::common::ODOMETRY_DATA> {
    let seen = seen.lock().unwrap();
    let latest = seen.iter().rev().filter_map(|message| match message {
        MavMessage::ODOMETRY(data) => Some(data.clone()),
        _ => None,
    });
    let mut row: Vec<_> = latest.take(count).collect();
    row.reverse();
    row
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
fn odometry_for_px4_has_its_frame_rate_and_covariance() {
    let (socket, address) = udp();
    let mut stand_in = StandIn::ardupilot(Wire::Udp(socket));
    stand_in.autopilot = MavAutopilot::MAV_AUTOPILOT_PX4;
    stand_in.version = [1, 17, 0];
    let stand_in = stand_in.start();
    let clock = LinkClock::unix();
    let link = Link::start(LinkOptions::new(address), clock, tracking()).unwrap();
    // 30 in a row for the times of 30 Hz, however busy this machine is.
    let row = wait_for("30 Hz", || {
        let row = latest_odometry(&stand_in.seen, 31);
        let span_us = row.last()?.time_usec - row.first()?.time_usec;
        (row.len() == 31 && (950_000..1_050_000).contains(&span_us)).then_some(row)
    });
    let status = link.status();
    assert_eq!(status.autopilot.unwrap().kind, AutopilotKind::Px4);
    assert_eq!(status.sending, Some(Output::Odometry));
    for data in &row {
        // LOCAL_FRD would be a frame of unknown heading.
        assert_eq!(data.frame_id, MavFrame::MAV_FRAME_LOCAL_NED);
        assert_eq!(data.child_frame_id, MavFrame::MAV_FRAME_BODY_FRD);
        // 0.0015 degrees from the origin, on PX4's sphere.
        assert!((data.x - 166.792).abs() < 0.01, "{}", data.x);
        assert!((data.y - 152.070).abs() < 0.01, "{}", data.y);
        // Variances as they are, square metres.
        assert_eq!(
            (data.pose_covariance[0], data.pose_covariance[6]),
            (4.0, 4.0)
        );
        assert!(data.pose_covariance.iter().all(|value| value.is_finite()));
        // The attitude that the autopilot told: a yaw of 90 degrees.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        for (found, expected) in data.q.iter().zip([half, 0.0, 0.0, half]) {
            assert!((found - expected).abs() < 1e-5, "{:?}", data.q);
        }
        assert_eq!(data.quality, 100);
        assert_eq!(data.reset_counter, row[0].reset_counter);
        let sent_s = data.time_usec as f64 * 1e-6;
        assert!((sent_s - clock.now_s()).abs() < PATIENCE.as_secs_f64());
    }
}

#[test]
fn an_autopilot_that_restarts_is_told_once_and_followed_on_its_new_clock() {
    let (socket, address) = udp();
    let start = |uptime_s| {
        let mut stand_in = StandIn::ardupilot(Wire::Udp(socket.try_clone().unwrap()));
        stand_in.uptime = Duration::from_secs(uptime_s);
        stand_in.start()
    };
    let before = start(600);
    let clock = LinkClock::unix();
    let link = Link::start(LinkOptions::new(address), clock, tracking()).unwrap();
    wait_for("ODOMETRY", || first_odometry(&before.seen));
    // It stops: no heartbeat, and no position goes to it.
    drop(before);
    let mut events = Vec::new();
    wait_for("silence", || {
        events.extend(link.events());
        let is_silent = |event: &LinkEvent| matches!(event, LinkEvent::AutopilotSilent { .. });
        events.iter().any(is_silent).then_some(())
    });
    let is_restart = |event: &LinkEvent| *event == LinkEvent::AutopilotRestarted;
    assert!(!events.iter().any(is_restart), "{events:?}");
    wait_for("no position", || {
        link.status().sending.is_none().then_some(())
    });
    link.inputs().for_each(drop);
    let after = start(0);
    // Positions go again, and what it tells has times on our clock: by its old one they would be ten minutes old.
    wait_for("ODOMETRY", || first_odometry(&after.seen));
    let mut inputs = 0;
    wait_for("telemetry", || {
        for input in link.inputs() {
            let late_s = clock.now_s() - input.time_s();
            assert!((0.0..PATIENCE.as_secs_f64()).contains(&late_s), "{late_s}");
            inputs += 1;
        }
        (inputs > 100).then_some(())
    });
    events.extend(link.events());
    let restarts = events.iter().filter(|event| is_restart(event)).count();
    assert_eq!(restarts, 1, "{events:?}");
    assert_eq!(link.status().sending, Some(Output::Odometry));
}

/// Puts a pseudo-terminal at `path`, at whose other end an autopilot stands. The path is there as long as the second one.
#[cfg(target_os = "linux")]
fn plugged_in(path: &std::path::Path) -> (autopilot::Running, SerialPort) {
    use std::os::fd::AsRawFd as _;
    let (theirs, ours) = SerialPort::pair().unwrap();
    let device = std::fs::read_link(format!("/proc/self/fd/{}", ours.as_raw_fd())).unwrap();
    std::os::unix::fs::symlink(device, path).unwrap();
    (StandIn::ardupilot(Wire::Serial(theirs)).start(), ours)
}

#[cfg(target_os = "linux")]
#[test]
fn a_serial_port_that_vanishes_is_told_and_opened_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ttyUSB0");
    let address = format!("serial:{}:57600", path.display());
    let (stand_in, port) = plugged_in(&path);
    let options = LinkOptions::new(address.parse().unwrap());
    let link = Link::start(options, LinkClock::unix(), tracking()).unwrap();
    wait_for("ODOMETRY", || first_odometry(&stand_in.seen));
    // Pulled out.
    std::fs::remove_file(&path).unwrap();
    drop((stand_in, port));
    let mut events = Vec::new();
    wait_for("the loss", || {
        events.extend(link.events());
        let is_loss = |event: &LinkEvent| matches!(event, LinkEvent::CannotOpen { .. });
        events.iter().any(is_loss).then_some(())
    });
    let (stand_in, _port) = plugged_in(&path);
    wait_for("ODOMETRY", || first_odometry(&stand_in.seen));
    events.extend(link.events());
    let of_port: Vec<String> = events
        .iter()
        .map(ToString::to_string)
        .filter(|line| line.starts_with(&address))
        .collect();
    // Each once, in this order.
    let expected = ["open", "connection lost (", "cannot be opened (", "open"];
    assert_eq!(of_port.len(), expected.len(), "{of_port:?}");
    for (line, expected) in of_port.iter().zip(expected) {
        assert!(
            line[address.len()..].starts_with(&format!(": {expected}")),
            "{line}"
        );
    }
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

#[test]
fn a_port_for_sentences_that_is_not_there_shows_before_there_is_a_position() {
    let nowhere: PointAt = Arc::new(|_| None);
    let address = "serial:/no/such/port:9600".parse().unwrap();
    let output = NmeaOutput::start(address, 100.0, LinkClock::unix(), nowhere).unwrap();
    wait_for("the failure", || {
        output
            .events()
            .find(|event| matches!(event, LinkEvent::CannotOpen { .. }))
    });
}

/// What a check finds, which changes nothing of the autopilot: parameters and versions are asked for, and nothing else.
fn checked(stand_in: StandIn, address: Address) -> grimnet_link::CheckReport {
    let running = stand_in.start();
    let options = CheckOptions {
        address,
        output: None,
        system_id: None,
        signing: None,
        within_s: PATIENCE.as_secs_f64(),
    };
    let report = check(&options, &mut |_| {}).unwrap();
    for message in running.seen.lock().unwrap().iter() {
        let only_reads = match message {
            MavMessage::COMMAND_LONG(data) => data.command == MavCmd::MAV_CMD_REQUEST_MESSAGE,
            MavMessage::HEARTBEAT(_) | MavMessage::TIMESYNC(_) => true,
            MavMessage::PARAM_REQUEST_READ(_) => true,
            _ => false,
        };
        assert!(only_reads, "{message:?}");
    }
    report
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

#[test]
fn a_system_that_was_awaited_in_vain_is_named() {
    let (socket, address) = udp();
    let _other = StandIn::ardupilot(Wire::Udp(socket)).start();
    let options = CheckOptions {
        address,
        output: None,
        system_id: Some(9),
        signing: None,
        within_s: 0.5,
    };
    let error = check(&options, &mut |_| {}).unwrap_err();
    assert!(
        error.to_string().contains("system 9 was awaited"),
        "{error}"
    );
}

#[test]
fn an_autopilot_that_is_not_taken_in_is_told_from_silence() {
    let (socket, address) = udp();
    let options = CheckOptions {
        address,
        output: None,
        system_id: None,
        signing: Some(SigningKey::from_bytes([7; 32])),
        within_s: 0.5,
    };
    let error = || check(&options, &mut |_| {}).unwrap_err().to_string();
    let silence = error();
    assert!(!silence.contains("bytes came"), "{silence}");
    let _unsigned = StandIn::ardupilot(Wire::Udp(socket)).start();
    let unsigned = error();
    assert!(
        unsigned.contains("the signing key may be another"),
        "{unsigned}"
    );
}

#[test]
fn of_several_senders_to_a_port_the_one_that_is_awaited_is_heard() {
    // The first one sends what holds no message.
    let mut senders = vec![(udp().0, b"$GPGGA,,,,,,0,,,,,,,,*66\r\n".to_vec())];
    senders.extend([1, 2].map(|system_id| {
        let header = MavHeader {
            system_id,
            component_id: 1,
            sequence: 0,
        };
        let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_FIXED_WING,
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            ..HEARTBEAT_DATA::default()
        });
        let mut bytes = Vec::new();
        write_v2_msg_signed(&mut bytes, header, &heartbeat, None).unwrap();
        (udp().0, bytes)
    }));
    let port = udp().0.local_addr().unwrap().port();
    let address: Address = format!("udpin:127.0.0.1:{port}").parse().unwrap();
    let options = LinkOptions {
        system_id: Some(2),
        ..LinkOptions::new(address)
    };
    let link = Link::start(options, LinkClock::unix(), tracking()).unwrap();
    wait_for("the port", || {
        link.events()
            .find(|event| matches!(event, LinkEvent::Opened(_)))
    });
    let autopilot = wait_for("system 2", || {
        for (socket, bytes) in &senders {
            socket.send_to(bytes, ("127.0.0.1", port)).unwrap();
        }
        link.status().autopilot
    });
    assert_eq!(autopilot.system_id, 2);
}

/// As an autopilot does whose signatures are taken for old ones until it has set its clock by ours.
#[test]
fn a_sender_that_is_not_understood_hears_us() {
    let (sender, _) = udp();
    let wait = Some(Duration::from_millis(20));
    sender.set_read_timeout(wait).unwrap();
    let port = udp().0.local_addr().unwrap().port();
    let address = format!("udpin:127.0.0.1:{port}").parse().unwrap();
    let _link = Link::start(LinkOptions::new(address), LinkClock::unix(), tracking()).unwrap();
    let mut buffer = [0; 300];
    wait_for("our heartbeat", || {
        let _ = sender.send_to(b"not understood", ("127.0.0.1", port));
        sender.recv(&mut buffer).ok()
    });
    // MAVLink 2, and the number of HEARTBEAT.
    assert_eq!((buffer[0], buffer[7]), (0xFD, 0));
}
