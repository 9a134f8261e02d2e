//! Telemetry files put together at random, those of KLV with right checksums: each gives inputs with finite times and values, or an
//! error that names the file.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_link::read_telemetry;
use grimnet_track::Input;
use proptest::collection::vec;
use proptest::prelude::*;

/// Inputs of each test in a normal run.
const CASES: u32 = 96;

/// Universal key of the UAS Datalink Local Set (MISB ST 0601, section 6.2).
const KEY: [u8; 16] = [
    0x06, 0x0e, 0x2b, 0x34, 0x02, 0x0b, 0x01, 0x01, 0x0e, 0x01, 0x03, 0x01, 0x01, 0x00, 0x00, 0x00,
];

/// Reads the file as the program does.
fn check(bytes: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight_0042");
    std::fs::write(&path, bytes).unwrap();
    match read_telemetry(&path) {
        Ok(telemetry) => telemetry.inputs.iter().for_each(check_input),
        Err(error) => assert!(error.to_string().contains("flight_0042"), "{error}"),
    }
}

/// What the filter is given: it refuses values out of range, but times bring them into order.
fn check_input(input: &Input) {
    assert!(input.time_s().is_finite(), "{input:?}");
}

/// A number as programs write it, or what is none.
fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        4 => (-1e4..1e4f64).prop_map(|v| format!("{v:.3}")),
        1 => any::<f64>().prop_map(|v| format!("{v:e}")),
        1 => Just("NaN".to_owned()),
        1 => Just("-inf".to_owned()),
        1 => Just(String::new()),
        1 => "[-+0-9.eE:TZ]{0,16}",
    ]
}

/// BER lengths (ST 0107): short, long, and such as state more than there is.
fn ber_length(length: usize, form: u8) -> Vec<u8> {
    match form {
        0 if length < 128 => vec![length as u8],
        1 => vec![0x81, length as u8],
        2 => vec![0x88, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff],
        _ => [&[0x82][..], &(length as u16).to_be_bytes()].concat(),
    }
}

/// A packet of these tags with its checksum, the sum of its 16-bit words (ST 0601, section 6.8).
fn packet(tags: &[(u8, Vec<u8>, u8)], form: u8) -> Vec<u8> {
    let mut body = Vec::new();
    for (tag, value, form) in tags {
        body.push(*tag);
        body.extend(ber_length(value.len(), *form));
        body.extend(value);
    }
    body.extend([1, 2]);
    let mut bytes = KEY.to_vec();
    bytes.extend(ber_length(body.len() + 2, form));
    bytes.extend(body);
    let sum = bytes.iter().enumerate().fold(0u16, |sum, (at, &byte)| {
        let shift = 8 * ((at + 1) % 2);
        sum.wrapping_add(u16::from(byte) << shift)
    });
    bytes.extend(sum.to_be_bytes());
    bytes
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn tables(
        columns in proptest::sample::subsequence(vec![
            "time", "yaw_deg", "pitch_deg", "roll_deg", "gimbal_yaw_deg", "gimbal_pitch_deg", "gimbal_roll_deg", "height_agl_m",
            "altitude_amsl_m", "velocity_east_m_s", "velocity_north_m_s", "velocity_sigma_m_s", "other",
        ], 1..13).prop_shuffle(),
        rows in vec(vec(number(), 0..14), 0..8),
        noise in vec((0.0..1.0f64, any::<u8>()), 0..3),
    ) {
        let mut text = columns.join(",") + "\n";
        for row in rows {
            text += &(row.join(",") + "\n");
        }
        let mut bytes = text.into_bytes();
        for (at, value) in noise {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = value;
        }
        check(&bytes);
    }

    #[test]
    fn subtitles(
        entries in vec((number(), vec((prop_oneof![
            Just("rel_alt: "), Just("abs_alt: "), Just("gb_yaw: "), Just("gb_pitch: "), Just("G.PRY ("), Just("BAROMETER:"), Just("H "),
            Just("<font size=\"28\">"), Just("["), Just("°, "),
        ], number()), 0..8), "[0-9:,.]{0,14}"), 0..6),
    ) {
        let mut text = String::new();
        for (number, (begin, words, end)) in entries.iter().enumerate() {
            text += &format!("{number}\n{begin} --> {end}\n");
            for (key, value) in words {
                text += key;
                text += value;
            }
            text += "]\n\n";
        }
        check(text.as_bytes());
    }

    #[test]
    fn klv_packets(
        packets in vec((vec((0..100u8, vec(any::<u8>(), 0..12), 0..4u8), 0..12), 0..4u8), 1..4),
        time in vec(any::<u8>(), 8),
        cut in prop_oneof![4 => Just(1.0), 1 => 0.0..1.0f64],
    ) {
        let mut bytes = Vec::new();
        for (tags, form) in packets {
            let mut with_time = vec![(2, time.clone(), 0)];
            with_time.extend(tags);
            bytes.extend(packet(&with_time, form));
        }
        bytes.truncate((cut * bytes.len() as f64) as usize);
        check(&bytes);
    }
}
