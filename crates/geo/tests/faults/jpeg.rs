//! Maps whose JPEG data are damaged: what follows the damage is shifted, and decoders say nothing.

use super::*;

/// A picture with texture everywhere: plain blocks take too few bytes to be hit.
fn textured(path: &Path, side: u32) {
    let mut state = 1_u32;
    RgbImage::from_fn(side, side, |x, y| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let [red, green, blue] = colours(x, y);
        Rgb([red ^ (state >> 27) as u8, green ^ (state >> 28) as u8, blue])
    })
    .save(path)
    .unwrap();
}

/// Zeros in the middle of each scan of a file, so that its length and all offsets stay. Returns how many scans were damaged.
fn damage_scans(path: &Path, share: f64) -> usize {
    let mut bytes = std::fs::read(path).unwrap();
    let headers: Vec<usize> = (0..bytes.len() - 1)
        .filter(|&at| bytes[at..].starts_with(&[0xFF, 0xDA, 0, 12]))
        .collect();
    let mut damaged = 0;
    for header in headers {
        let data = header + 14;
        let end = (data..bytes.len())
            .find(|&at| bytes[at..].starts_with(&[0xFF, 0xD9]))
            .unwrap();
        let at = data + ((end - data) as f64 * share) as usize;
        let stop = end.min(at + 60);
        if stop > at + 30 {
            bytes[at..stop].fill(0);
            damaged += 1;
        }
    }
    std::fs::write(path, bytes).unwrap();
    damaged
}

/// Reads the whole map.
fn read_all(map: &dyn Raster) -> Result<(), GeoError> {
    let (width, height) = map.size_px();
    let window = WindowPx::new(0.0, 0.0, width as f64, height as f64);
    map.read(window, width as u32, height as u32).map(drop)
}

fn assert_damaged(result: Result<(), GeoError>, name: &str) {
    let error = result.unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, GeoError::Damaged { .. }), "{error:?}");
    for word in [name, "JPEG data", "copy or download it again"] {
        assert!(text.contains(word), "{word}: {text}");
    }
}

#[test]
fn a_damaged_jpeg_picture_is_no_map() {
    let dir = folder();
    for share in [0.1, 0.5, 0.9] {
        let path = dir.path().join("map.jpg");
        textured(&path, 300);
        let corners = [120.0, 24.0, 120.003, 24.0027];
        read_all(with_corners(&path, corners).unwrap().as_ref()).unwrap();
        assert_eq!(damage_scans(&path, share), 1);
        let map = with_corners(&path, corners).unwrap();
        assert_damaged(read_all(map.as_ref()), "map.jpg");
    }
}

#[test]
fn a_damaged_tile_of_a_map_of_tiles_is_named() {
    let dir = folder();
    let column = dir.path().join("17/109_000".replace('_', ""));
    std::fs::create_dir_all(&column).unwrap();
    for row in [56_000, 56_001] {
        textured(&column.join(format!("{row}.jpg")), 256);
    }
    read_all(open(dir.path()).unwrap().as_ref()).unwrap();
    assert_eq!(damage_scans(&column.join("56001.jpg"), 0.4), 1);
    let error = read_all(open(dir.path()).unwrap().as_ref());
    assert_damaged(error, "17/109000/56001");
}

#[test]
fn damaged_jpeg_blocks_of_a_geotiff_are_named() {
    let dir = folder();
    // Tables in a tag of the file, subsampled chrominance; strips in RGB; tiles beside those of a mask.
    for name in [
        "tiled_jpeg_ycbcr.tif",
        "striped_jpeg_rgb.tif",
        "jpeg_internal_mask.tif",
    ] {
        let path = dir.path().join(name);
        std::fs::copy(golden_map(name), &path).unwrap();
        read_all(open(&path).unwrap().as_ref()).unwrap();
        assert!(damage_scans(&path, 0.5) > 0, "{name}");
        assert_damaged(read_all(open(&path).unwrap().as_ref()), name);
    }
}
