//! A program that behaves like an autopilot as far as the link can see.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::{
    collections::BTreeMap,
    io::{ErrorKind, Read as _, Write as _},
    net::{SocketAddr, TcpStream, UdpSocket},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use mavlink::{
    MavHeader, MavlinkReader, SigningData,
    dialects::common::{
        ATTITUDE_DATA, AUTOPILOT_VERSION_DATA, GLOBAL_POSITION_INT_DATA, GPS_GLOBAL_ORIGIN_DATA,
        HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavCmd, MavMessage, MavParamType,
        MavType, PARAM_VALUE_DATA, TIMESYNC_DATA,
    },
    types::CharArray,
    write_v2_msg_signed,
};

/// What the stand-in was sent.
pub type Seen = Arc<Mutex<Vec<MavMessage>>>;

/// What it talks over.
pub enum Wire {
    Udp(UdpSocket),
    Tcp(TcpStream),
    /// The other end of a serial port.
    #[cfg(target_os = "linux")]
    Serial(serial2::SerialPort),
}

/// How it answers.
pub struct StandIn {
    pub autopilot: MavAutopilot,
    pub version: [u8; 3],
    pub parameters: BTreeMap<&'static str, (f32, MavParamType)>,
    /// Since when it runs when it is started.
    pub uptime: Duration,
    wire: Wire,
    signing: Option<SigningData>,
}

/// A stand-in at work; dropped, it is gone.
pub struct Running {
    pub seen: Seen,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    pub fn heartbeats_of_an_onboard_computer(&self) -> usize {
        let onboard = MavType::MAV_TYPE_ONBOARD_CONTROLLER;
        self.count(
            |message| matches!(message, MavMessage::HEARTBEAT(data) if data.mavtype == onboard),
        )
    }

    pub fn answered_time_requests(&self) -> usize {
        self.count(|message| matches!(message, MavMessage::TIMESYNC(data) if data.tc1 != 0))
    }

    fn count(&self, is: impl Fn(&MavMessage) -> bool) -> usize {
        self.seen
            .lock()
            .unwrap()
            .iter()
            .filter(|message| is(message))
            .count()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

impl StandIn {
    pub fn ardupilot(wire: Wire) -> Self {
        Self {
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            version: [4, 6, 3],
            parameters: BTreeMap::new(),
            uptime: Duration::ZERO,
            wire,
            signing: None,
        }
    }

    pub fn signed(mut self, signing: SigningData) -> Self {
        self.signing = Some(signing);
        self
    }

    pub fn start(self) -> Running {
        let seen = Seen::default();
        let stop = Arc::new(AtomicBool::new(false));
        let (ours, stopped) = (Arc::clone(&seen), Arc::clone(&stop));
        let thread = thread::spawn(move || self.run(&ours, &stopped));
        Running {
            seen,
            stop,
            thread: Some(thread),
        }
    }

    fn run(mut self, seen: &Seen, stop: &AtomicBool) {
        let began = Instant::now();
        let uptime = self.uptime;
        let since_boot = || uptime + began.elapsed();
        let mut peer = None;
        let mut next = began;
        while !stop.load(Ordering::Relaxed) {
            let bytes = self.receive(&mut peer);
            let mut reader = MavlinkReader::new(bytes.as_slice());
            while let Ok((_, message)) =
                reader.read_any_message_signed::<MavMessage>(self.signing.as_ref())
            {
                for answer in self.answers(&message, since_boot()) {
                    self.send(&answer, peer);
                }
                seen.lock().unwrap().push(message);
            }
            if Instant::now() >= next {
                next = Instant::now() + Duration::from_millis(50);
                for message in self.telemetry(since_boot()) {
                    self.send(&message, peer);
                }
            }
        }
    }

    fn receive(&mut self, peer: &mut Option<SocketAddr>) -> Vec<u8> {
        let wait = Some(Duration::from_millis(5));
        let mut buffer = vec![0; 4096];
        let read = match &mut self.wire {
            Wire::Udp(socket) => {
                socket.set_read_timeout(wait).unwrap();
                socket.recv_from(&mut buffer).map(|(length, from)| {
                    *peer = Some(from);
                    length
                })
            }
            Wire::Tcp(stream) => {
                stream.set_read_timeout(wait).unwrap();
                stream.read(&mut buffer)
            }
            #[cfg(target_os = "linux")]
            Wire::Serial(port) => {
                port.set_read_timeout(Duration::from_millis(5)).unwrap();
                port.read(&mut buffer)
            }
        };
        let length = match read {
            Ok(length) => length,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => 0,
            Err(error) => panic!("{error}"),
        };
        buffer.truncate(length);
        buffer
    }

    fn send(&mut self, message: &MavMessage, peer: Option<SocketAddr>) {
        let header = MavHeader {
            system_id: 1,
            component_id: 1,
            sequence: 0,
        };
        let mut bytes = Vec::new();
        write_v2_msg_signed(&mut bytes, header, message, self.signing.as_ref()).unwrap();
        match (&mut self.wire, peer) {
            (Wire::Udp(socket), Some(peer)) => {
                // The other end may be gone already.
                let _ = socket.send_to(&bytes, peer);
            }
            (Wire::Udp(_), None) => {}
            (Wire::Tcp(stream), _) => stream.write_all(&bytes).unwrap(),
            #[cfg(target_os = "linux")]
            (Wire::Serial(port), _) => {
                // What nobody reads does not fit in the end.
                let _ = port.write_all(&bytes);
            }
        }
    }

    fn telemetry(&self, since_boot: Duration) -> Vec<MavMessage> {
        let time_boot_ms = u32::try_from(since_boot.as_millis()).unwrap();
        vec![
            MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_FIXED_WING,
                autopilot: self.autopilot,
                ..HEARTBEAT_DATA::default()
            }),
            MavMessage::ATTITUDE(ATTITUDE_DATA {
                time_boot_ms,
                yaw: std::f32::consts::FRAC_PI_2,
                ..ATTITUDE_DATA::default()
            }),
            MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
                time_boot_ms,
                lat: 242_500_000,
                lon: 1_207_000_000,
                alt: 150_000,
                relative_alt: 100_000,
                ..GLOBAL_POSITION_INT_DATA::default()
            }),
            MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                time_boot_ms,
                z: -100.0,
                vx: 7.0,
                vy: 8.0,
                ..LOCAL_POSITION_NED_DATA::default()
            }),
            // A request for the companion's time.
            MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: 0,
                ts1: i64::from(time_boot_ms) * 1_000_000,
                ..TIMESYNC_DATA::default()
            }),
        ]
    }

    fn answers(&self, message: &MavMessage, since_boot: Duration) -> Vec<MavMessage> {
        match message {
            MavMessage::TIMESYNC(data) if data.tc1 == 0 => {
                let tc1 = i64::try_from(since_boot.as_nanos()).unwrap();
                vec![MavMessage::TIMESYNC(TIMESYNC_DATA {
                    tc1,
                    ts1: data.ts1,
                    ..TIMESYNC_DATA::default()
                })]
            }
            MavMessage::COMMAND_LONG(data) if data.command == MavCmd::MAV_CMD_REQUEST_MESSAGE => {
                self.requested(data.param1)
            }
            MavMessage::PARAM_REQUEST_READ(data) => {
                let name = data.param_id.to_str().unwrap();
                // As an autopilot: silence about what it does not know.
                let Some((value, kind)) = self.parameters.get(name) else {
                    return Vec::new();
                };
                vec![MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
                    param_value: *value,
                    param_count: 1,
                    param_index: 0,
                    param_id: CharArray::from(name),
                    param_type: *kind,
                })]
            }
            _ => Vec::new(),
        }
    }

    fn requested(&self, message: f32) -> Vec<MavMessage> {
        if message == 148.0 {
            let [major, minor, patch] = self.version;
            vec![MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
                flight_sw_version: u32::from_be_bytes([major, minor, patch, 255]),
                ..AUTOPILOT_VERSION_DATA::default()
            })]
        } else if message == 49.0 {
            vec![MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
                latitude: 242_500_000,
                longitude: 1_207_000_000,
                altitude: 50_000,
                ..GPS_GLOBAL_ORIGIN_DATA::default()
            })]
        } else {
            Vec::new()
        }
    }
}
