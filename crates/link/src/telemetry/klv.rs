//! MISB ST 0601: metadata of a UAS in KLV packets.

use grimnet_track::{Attitude, HEIGHT_AGL_RANGE_M, Height, Input, Velocity};
use nalgebra::UnitQuaternion;

use super::mpeg_ts::Unit;
use super::{
    klv_value::{ber_length, ber_oid, scaled_signed, scaled_unsigned, unsigned},
    recorded::{Telemetry, TelemetryClock, VELOCITY_SIGMA_M_S},
};

/// Universal key of the UAS Datalink Local Set (ST 0601, section 6.2).
const KEY: [u8; 16] = [
    0x06, 0x0e, 0x2b, 0x34, 0x02, 0x0b, 0x01, 0x01, 0x0e, 0x01, 0x03, 0x01, 0x01, 0x00, 0x00, 0x00,
];
/// A packet is looked for in so many bytes at the beginning of a file.
const HEAD_BYTES: usize = 1 << 16;
/// A packet is not longer, bytes: what one that is wrong spans is read again from each key in it.
const MOST_PACKET_BYTES: usize = 1 << 16;

/// Whether the bytes hold packets.
pub(super) fn is_klv(bytes: &[u8]) -> bool {
    next_key(&bytes[..bytes.len().min(HEAD_BYTES)]).is_some()
}

/// Reads all packets whose checksum is right.
pub(super) fn parse(bytes: &[u8]) -> Telemetry {
    let mut telemetry = Telemetry::new(TelemetryClock::Unix);
    add_packets(bytes, None, &mut telemetry);
    telemetry.sorted()
}

/// Reads the packets of a transport stream: with the times of its video, or without a video with their own.
pub(super) fn of_transport_stream(units: &[Unit]) -> Telemetry {
    let has_video = units.iter().any(|unit| unit.time_s.is_some());
    let mut telemetry = Telemetry::new(if has_video {
        TelemetryClock::Video
    } else {
        TelemetryClock::Unix
    });
    for unit in units {
        match unit.time_s {
            None if has_video => telemetry.leave_out(|| "a packet before the video".to_owned()),
            time_s => add_packets(&unit.bytes, time_s, &mut telemetry),
        }
    }
    telemetry.sorted()
}

/// Adds what packets say: at `time_s` if it is given, else at the time that each states.
fn add_packets(bytes: &[u8], time_s: Option<f64>, telemetry: &mut Telemetry) {
    let mut rest = bytes;
    while let Some(at) = next_key(rest) {
        let packet = &rest[at..];
        match Packet::read(packet) {
            Ok((values, length)) => {
                match time_s.or(values.time_s) {
                    Some(time_s) => values.push_inputs(time_s, &mut telemetry.inputs),
                    None => telemetry.leave_out(|| "a packet without a time".to_owned()),
                }
                rest = &packet[length..];
            }
            Err(problem) => {
                telemetry.leave_out(|| problem.to_owned());
                rest = &packet[KEY.len()..];
            }
        }
    }
}

fn next_key(bytes: &[u8]) -> Option<usize> {
    bytes.windows(KEY.len()).position(|window| window == KEY)
}

/// What a packet says, angles in degrees.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Packet {
    time_s: Option<f64>,
    heading_deg: Option<f64>,
    pitch_deg: Option<f64>,
    roll_deg: Option<f64>,
    /// Of the sensor relative to the platform.
    azimuth_deg: Option<f64>,
    elevation_deg: Option<f64>,
    sensor_roll_deg: Option<f64>,
    altitude_amsl_m: Option<f64>,
    ground_amsl_m: Option<f64>,
    velocity_north_m_s: Option<f64>,
    velocity_east_m_s: Option<f64>,
}

impl Packet {
    /// Reads the packet at the beginning, which is a key, and gives its length in bytes.
    fn read(bytes: &[u8]) -> Result<(Self, usize), &'static str> {
        let truncated = "a truncated packet";
        let (length, body) = ber_length(&bytes[KEY.len()..]).ok_or(truncated)?;
        if length > MOST_PACKET_BYTES {
            return Err("a packet that states more bytes than any has");
        }
        let items = body.get(..length).ok_or(truncated)?;
        let whole = bytes.len() - body.len() + length;
        let mut packet = Self::default();
        let mut rest = items;
        let mut checked = false;
        while !rest.is_empty() {
            let (tag, after_tag) = ber_oid(rest).ok_or(truncated)?;
            let (length, after_length) = ber_length(after_tag).ok_or(truncated)?;
            let value = after_length.get(..length).ok_or(truncated)?;
            rest = &after_length[length..];
            if tag == 1 {
                // The checksum is the last item and counts all bytes before its value.
                let before = whole - rest.len() - length;
                checked = unsigned(value) == Some(u64::from(checksum(&bytes[..before])));
                break;
            }
            packet.set(tag, value);
        }
        if checked && rest.is_empty() {
            Ok((packet, whole))
        } else {
            Err("a packet whose checksum is wrong")
        }
    }

    fn set(&mut self, tag: u32, value: &[u8]) {
        match tag {
            2 if value.len() == 8 => self.time_s = unsigned(value).map(|us| us as f64 * 1e-6),
            5 => self.heading_deg = scaled_unsigned(value, 2, 0.0, 360.0),
            6 => self.pitch_deg = self.pitch_deg.or(scaled_signed(value, 2, 20.0)),
            7 => self.roll_deg = self.roll_deg.or(scaled_signed(value, 2, 50.0)),
            // The same angles with a wider range.
            90 => self.pitch_deg = scaled_signed(value, 4, 90.0).or(self.pitch_deg),
            91 => self.roll_deg = scaled_signed(value, 4, 90.0).or(self.roll_deg),
            15 => self.altitude_amsl_m = scaled_unsigned(value, 2, -900.0, 19_000.0),
            18 => self.azimuth_deg = scaled_unsigned(value, 4, 0.0, 360.0),
            19 => self.elevation_deg = scaled_signed(value, 4, 180.0),
            20 => self.sensor_roll_deg = scaled_unsigned(value, 4, 0.0, 360.0),
            25 => self.ground_amsl_m = scaled_unsigned(value, 2, -900.0, 19_000.0),
            79 => self.velocity_north_m_s = scaled_signed(value, 2, 327.0),
            80 => self.velocity_east_m_s = scaled_signed(value, 2, 327.0),
            _ => {}
        }
    }

    fn push_inputs(&self, time_s: f64, inputs: &mut Vec<Input>) {
        if let (Some(heading), Some(pitch), Some(roll), Some(azimuth), Some(elevation)) = (
            self.heading_deg,
            self.pitch_deg,
            self.roll_deg,
            self.azimuth_deg,
            self.elevation_deg,
        ) {
            let platform = rotation(heading, pitch, roll);
            let sensor = rotation(azimuth, elevation, self.sensor_roll_deg.unwrap_or(0.0));
            inputs.push(Input::Attitude(Attitude::of_camera(
                time_s,
                &(platform * sensor),
            )));
        }
        if let (Some(amsl_m), Some(ground_m)) = (self.altitude_amsl_m, self.ground_amsl_m)
            && HEIGHT_AGL_RANGE_M.contains(&(amsl_m - ground_m))
        {
            inputs.push(Input::Height(Height {
                time_s,
                agl_m: amsl_m - ground_m,
                amsl_m: Some(amsl_m),
            }));
        }
        if let (Some(north_m_s), Some(east_m_s)) = (self.velocity_north_m_s, self.velocity_east_m_s)
        {
            inputs.push(Input::Velocity(Velocity {
                time_s,
                east_m_s,
                north_m_s,
                sigma_m_s: VELOCITY_SIGMA_M_S,
            }));
        }
    }
}

/// Yaw, pitch and roll in this order, degrees.
fn rotation(yaw_deg: f64, pitch_deg: f64, roll_deg: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(
        roll_deg.to_radians(),
        pitch_deg.to_radians(),
        yaw_deg.to_radians(),
    )
}

/// The sum of all bytes as 16-bit words, most significant byte first (ST 0601, tag 1).
fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().enumerate().fold(0, |sum: u16, (at, byte)| {
        sum.wrapping_add(u16::from(*byte) << (8 * (1 - at % 2)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A packet, and what klvdata (PyPI, 0.0.3) reads in it: `make_golden.py`.
    const GOLDEN: &str = include_str!("../../tests/golden/klv.txt");

    fn golden() -> (Vec<u8>, Vec<(String, f64)>) {
        let (hex, values) = GOLDEN.split_once('\n').unwrap();
        let bytes = (0..hex.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
            .collect();
        let values = values
            .lines()
            .map(|line| {
                let (name, value) = line.split_once(' ').unwrap();
                (name.to_owned(), value.parse().unwrap())
            })
            .collect();
        (bytes, values)
    }

    #[test]
    fn a_packet_is_read_as_klvdata_reads_it() {
        let (bytes, values) = golden();
        assert!(values.len() >= 10);
        let (packet, length) = Packet::read(&bytes).unwrap();
        assert_eq!(length, bytes.len());
        for (name, expected) in values {
            let found = match name.as_str() {
                "time_s" => packet.time_s,
                "heading_deg" => packet.heading_deg,
                "pitch_deg" => packet.pitch_deg,
                "roll_deg" => packet.roll_deg,
                "azimuth_deg" => packet.azimuth_deg,
                "elevation_deg" => packet.elevation_deg,
                "sensor_roll_deg" => packet.sensor_roll_deg,
                "altitude_amsl_m" => packet.altitude_amsl_m,
                "ground_amsl_m" => packet.ground_amsl_m,
                "velocity_north_m_s" => packet.velocity_north_m_s,
                "velocity_east_m_s" => packet.velocity_east_m_s,
                other => panic!("{other}"),
            };
            let found = found.unwrap_or_else(|| panic!("{name}"));
            assert!(
                (found - expected).abs() < 1e-5 * expected.abs().max(1.0),
                "{name} {found} {expected}"
            );
        }
        let telemetry = parse(&[b"noise", bytes.as_slice(), bytes.as_slice()].concat());
        assert_eq!((telemetry.inputs.len(), telemetry.left_out), (6, 0));
    }

    /// As many packets within each other as a file has room for would take hours.
    #[test]
    fn a_packet_is_no_longer_than_packets_are() {
        let with_filler = |filler: usize| {
            let mut packet = KEY.to_vec();
            // Time, a tag that is not read, and the checksum.
            let length = u32::try_from(10 + 6 + filler + 4).unwrap();
            packet.push(0x84);
            packet.extend_from_slice(&length.to_be_bytes());
            packet.extend_from_slice(&[2, 8, 0, 0, 0, 0, 0, 0, 0, 1]);
            packet.extend_from_slice(&[3, 0x84]);
            packet.extend_from_slice(&u32::try_from(filler).unwrap().to_be_bytes());
            packet.resize(packet.len() + filler, b'x');
            packet.extend_from_slice(&[1, 2]);
            let sum = checksum(&packet);
            packet.extend_from_slice(&sum.to_be_bytes());
            Packet::read(&packet).map(|(packet, _)| packet.time_s)
        };
        let most = MOST_PACKET_BYTES - 20;
        assert_eq!(with_filler(most), Ok(Some(1e-6)));
        assert!(with_filler(most + 1).is_err());
    }

    proptest! {
        #[test]
        fn a_packet_that_was_altered_is_left_out(at in 0usize..1000, change in 1u8..) {
            let (mut bytes, _) = golden();
            let at = at % bytes.len();
            bytes[at] ^= change;
            let telemetry = parse(&bytes);
            prop_assert!(telemetry.inputs.is_empty());
        }

        #[test]
        fn a_packet_that_was_cut_is_left_out(keep in 0usize..1000) {
            let (bytes, _) = golden();
            let telemetry = parse(&bytes[..keep % bytes.len()]);
            prop_assert!(telemetry.inputs.is_empty());
        }
    }
}
