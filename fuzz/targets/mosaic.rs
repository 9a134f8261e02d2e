//! What places pictures in words: world files with the text of a CRS, CSV mosaics, VRTs and lists of pictures. The first byte says which.
#![no_main]

use std::sync::OnceLock;

use grimnet_fuzz_targets::usable::assert_usable;
use grimnet_fuzz_targets::{file_of, folder};
use grimnet_geo::{MapOptions, open_map};
use libfuzzer_sys::fuzz_target;

const PICTURE: &[u8] = include_bytes!("../../crates/photo/tests/golden/palette.png");
const GEOTIFF: &[u8] = include_bytes!("../corpus/geotiff/grey.tif");

/// Pictures and maps that the words may name.
fn write_pictures() {
    static WRITTEN: OnceLock<()> = OnceLock::new();
    WRITTEN.get_or_init(|| {
        for name in ["map.png", "map.a.png", "map.b.png"] {
            file_of(PICTURE, name);
        }
        for name in ["map.0.tif", "map.1.tif"] {
            file_of(GEOTIFF, name);
        }
    });
}

fuzz_target!(|bytes: &[u8]| {
    write_pictures();
    let Some((&kind, text)) = bytes.split_first() else {
        return;
    };
    let mut options = MapOptions::default();
    let path = match kind {
        // The first line is the CRS, the others are the world file.
        b'w' => {
            let end = text.iter().position(|&byte| byte == b'\n');
            let (crs, lines) = text.split_at(end.map_or(0, |end| end + 1));
            if !crs.is_empty() {
                options.crs = Some(String::from_utf8_lossy(crs).trim_end().to_owned());
            }
            file_of(lines, "map.pgw");
            folder().join("map.png")
        }
        b'c' => file_of(text, "map.csv"),
        b'v' => file_of(text, "map.vrt"),
        b'l' => file_of(text, "map.txt"),
        _ => return,
    };
    match open_map(&path, &options) {
        Ok(map) => assert_usable(&*map),
        // It names the map, a file that the map names, or the CRS.
        Err(error) => assert!(error.to_string().len() > 10, "{error}"),
    }
});
