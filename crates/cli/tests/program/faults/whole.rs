//! Whether a file is a whole one of its kind.

use std::path::Path;

use grimnet_net::Model;
use grimnet_pack::Pack;

/// Whether the program's working files, which a kill may leave, have such a name.
pub fn is_working_file(name: &Path) -> bool {
    let name = name.file_name().unwrap().to_string_lossy();
    name.starts_with('.') || name.contains(".partial") || name.contains(".assembling")
}

/// Panics if the file is cut off or damaged.
pub fn assert_whole(path: &Path) {
    let name = path.display();
    let text = || std::fs::read_to_string(path).unwrap();
    match path.extension().unwrap_or_default().to_str().unwrap() {
        "grim" => Pack::open(path).unwrap().verify(&mut |_| ()).unwrap(),
        "safetensors" if name.to_string().contains("checkpoint") => {
            let bytes = std::fs::read(path).unwrap();
            let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
            let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + header]).unwrap();
            let data: u64 = header
                .as_object()
                .unwrap()
                .values()
                .filter_map(|tensor| tensor["data_offsets"][1].as_u64())
                .max()
                .unwrap();
            let length = 8 + header_length(&bytes) + data as usize;
            assert_eq!(bytes.len(), length, "{name}");
        }
        "safetensors" => drop(Model::open(path).unwrap()),
        "jpg" | "png" => drop(image::open(path).unwrap()),
        "tif" => {
            let options = grimnet_geo::MapOptions::default();
            let map = grimnet_geo::open_map(path, &options).unwrap();
            let (width, height) = map.size_px();
            let window = grimnet_geo::WindowPx::new(0.0, 0.0, width as f64, height as f64);
            map.read(window, 64, 64).unwrap();
        }
        "json" => drop(serde_json::from_str::<serde_json::Value>(&text()).unwrap()),
        "jsonl" => {
            assert!(text().is_empty() || text().ends_with('\n'), "{name}");
            for line in text().lines() {
                serde_json::from_str::<serde_json::Value>(line).unwrap();
            }
        }
        "csv" => {
            let commas = |line: &str| line.matches(',').count();
            let text = text();
            let columns = commas(text.lines().next().unwrap());
            assert!(text.ends_with('\n'), "{name}");
            // Reasons are quoted, with commas in them.
            assert!(text.lines().all(|line| commas(line) >= columns), "{name}");
        }
        "html" | "svg" | "gpx" | "kml" => {
            assert!(text().trim_end().ends_with('>'), "{name}");
            assert!(text().contains("</"), "{name}");
        }
        "nmea" => {
            let text = text();
            assert!(text.is_empty() || text.ends_with("\r\n"), "{name}");
            for sentence in text.lines() {
                let (body, checksum) = sentence[1..].split_once('*').unwrap();
                let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
                assert_eq!(format!("{sum:02X}"), checksum, "{name}: {sentence}");
            }
        }
        "1" => assert!(text().contains(".SH NAME"), "{name}"),
        other => panic!("{name}: no check of files that end in `{other}`"),
    }
}

fn header_length(bytes: &[u8]) -> usize {
    u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize
}
