//! Truth files and `.npz` archives put together at random: each is read, or gives an error.
//!
//! `PROPTEST_CASES` sets the number of inputs of each test (CONTRIBUTING.md, "Fuzzing").

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_eval::datasets::truth;
use proptest::collection::vec;
use proptest::prelude::*;

/// Inputs of each test in a normal run.
const CASES: u32 = 128;

fn cell() -> impl Strategy<Value = String> {
    prop_oneof![
        (-400.0..400.0f64).prop_map(|v| v.to_string()),
        Just("NaN".to_owned()),
        Just("inf".to_owned()),
        Just("-1e999".to_owned()),
        Just(String::new()),
        Just("a.jpg".to_owned()),
        Just("\"a,b.jpg\"".to_owned()),
        "\\PC{0,8}",
    ]
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn truth_files(
        columns in proptest::sample::subsequence(
            vec!["photo", "lat_deg", "lon_deg", "centre_lat", "centre_lon", "gps_lat", "gps_lon", "heading_deg",
                 "height_agl_m", "footprint_w_m", "tilt_deg", "truth_err_m", "flat_frac", "place"],
            0..14,
        ),
        rows in vec(vec(cell(), 0..16), 0..6),
        tail in vec(any::<u8>(), 0..8),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.csv");
        let mut text = columns.join(",") + "\n";
        for row in rows {
            text += &(row.join(",") + "\n");
        }
        std::fs::write(&path, [text.as_bytes(), &tail].concat()).unwrap();
        match truth::read_rows(&path) {
            Ok((frames, _)) => for frame in frames {
                if let Some(place) = frame.position() {
                    prop_assert!(place.lat_deg.abs() <= 90.0 && place.lon_deg.abs() <= 180.0);
                }
                prop_assert!(frame.heading_deg.is_none_or(f64::is_finite));
                prop_assert!(frame.footprint_width_m.is_none_or(|m| m > 0.0 && m.is_finite()));
            },
            Err(error) => prop_assert!(error.to_string().contains("truth"), "{error}"),
        }
    }
}

#[cfg(feature = "anyvisloc")]
mod npz {
    use super::*;
    use grimnet_eval::datasets::npz::Npz;
    use std::io::Write as _;

    /// What an array may take here.
    const MAX_BYTES: u64 = 1 << 20;

    fn description() -> impl Strategy<Value = String> {
        prop_oneof![
            // Well-formed, with sizes that fit or not.
            (
                prop_oneof![
                    Just("<f4"),
                    Just("<f8"),
                    Just("|u1"),
                    Just(">f4"),
                    Just("<i8"),
                    Just("|O")
                ],
                any::<bool>(),
                vec(prop_oneof![0..9u64, any::<u64>()], 0..5),
            )
                .prop_map(|(kind, fortran, shape)| {
                    let shape: String = shape.iter().map(|side| format!("{side}, ")).collect();
                    let order = if fortran { "True" } else { "False" };
                    format!(
                        "{{'descr': '{kind}', 'fortran_order': {order}, 'shape': ({shape}), }}\n"
                    )
                }),
            "[{}()\\[\\]':, a-z0-9<|]{0,80}",
        ]
    }

    proptest! {
        #![proptest_config(grimnet_fuzz::config(CASES))]

        #[test]
        fn npz_arrays(
            description in description(),
            version in prop_oneof![4 => Just(1u8), 1 => any::<u8>()],
            error in prop_oneof![4 => Just(0i32), 1 => -3..70_000i32],
            data in vec(any::<u8>(), 0..300),
            is_deflated in any::<bool>(),
            flipped in prop_oneof![4 => Just(None), 1 => (0.0..1.0f64, any::<u8>()).prop_map(Some)],
        ) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("x.npz");
            let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
            let method = if is_deflated { zip::CompressionMethod::Deflated } else { zip::CompressionMethod::Stored };
            let options = zip::write::SimpleFileOptions::default().compression_method(method);
            writer.start_file("a.npy", options).unwrap();
            let length = (description.len() as i32 + error).max(0) as u32;
            let mut array = vec![0x93, b'N', b'U', b'M', b'P', b'Y', version, 0];
            if version == 1 {
                array.extend((length as u16).to_le_bytes());
            } else {
                array.extend(length.to_le_bytes());
            }
            array.extend(description.as_bytes());
            array.extend(data);
            writer.write_all(&array).unwrap();
            let mut bytes = writer.finish().unwrap().into_inner();
            if let Some((at, value)) = flipped {
                let at = (at * bytes.len() as f64) as usize;
                bytes[at] ^= value;
            }
            std::fs::write(&path, bytes).unwrap();
            let Ok(npz) = Npz::open(&path) else {
                return Ok(());
            };
            let mut npz = npz.with_max_array_bytes(MAX_BYTES);
            if let Ok(read) = npz.floats("a") {
                prop_assert_eq!(read.values.len(), read.shape.iter().product::<usize>());
                prop_assert!(read.values.len() as u64 <= MAX_BYTES);
            }
            let _ = npz.bytes("a");
        }
    }
}
