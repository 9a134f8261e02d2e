//! Maps of 100,000 x 100,000 pixels, and of thousands of samples a pixel: sparse files, read by windows, in bounded memory.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use grimnet_geo::{MapOptions, Raster, WindowPx, open_map};
use support::{Tag, geo_tags, long, long8, rgb_tags, short, write_at, write_bigtiff};

const SIDE: u64 = 100_000;

/// Peak resident memory of this process, MiB.
fn peak_mib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? / 1024)
}

fn tags(blocks: Vec<Tag>) -> Vec<Tag> {
    let mut tags = rgb_tags(SIDE as u32, SIDE as u32);
    tags.extend(geo_tags(32651));
    tags.extend(blocks);
    tags
}

/// Reads windows along a row of blocks, at full and at reduced resolution, and looks for the one
/// coloured pixel at (70,000, 50,000).
fn sweep(map: &dyn Raster) {
    assert_eq!(map.size_px(), (SIDE, SIDE));
    for column in 0..40 {
        let window = WindowPx::new(f64::from(column) * 2500.0, 49_900.0, 1024.0, 1024.0);
        let patch = map.read(window, 1024, 1024).unwrap();
        let bright = patch.rgb.pixels().filter(|p| p.0 != [0, 0, 0]).count();
        assert_eq!(bright, usize::from(column == 28), "window {column}");
        if column == 28 {
            assert_eq!(patch.rgb.get_pixel(0, 100).0, [200, 100, 50]);
        }
    }
    let window = WindowPx::new(69_990.0, 49_990.0, 20.0, 20.0);
    let patch = map.read(window, 10, 10).unwrap();
    assert!(patch.rgb.pixels().any(|p| p.0 != [0, 0, 0]));
    // Eight times reduced, and partly outside.
    let window = WindowPx::new(98_000.0, 98_000.0, 4096.0, 4096.0);
    let patch = map.read(window, 512, 512).unwrap();
    assert_eq!(patch.valid.get_pixel(511, 511).0, [0]);
}

#[test]
fn striped_and_tiled_maps_are_read_in_bounded_memory() {
    let folder = tempfile::tempdir().unwrap();

    // Uncompressed strips of one row: 30 GB on paper.
    let striped = folder.path().join("striped.tif");
    let (row_bytes, data_at) = (SIDE * 3, 4 << 20);
    let offsets: Vec<u64> = (0..SIDE).map(|row| data_at + row * row_bytes).collect();
    let blocks = vec![
        long8(273, &offsets),
        long(278, &[1]),
        long8(279, &vec![row_bytes; SIDE as usize]),
    ];
    assert!(write_bigtiff(&striped, tags(blocks), data_at + SIDE * row_bytes) < data_at);
    write_at(
        &striped,
        data_at + 50_000 * row_bytes + 70_000 * 3,
        &[200, 100, 50],
    );

    // Tiles of 512, all but one never written (GDAL's SPARSE_OK).
    let tiled = folder.path().join("tiled.tif");
    let columns = SIDE.div_ceil(512);
    let mut offsets = vec![0_u64; (columns * columns) as usize];
    let mut counts = vec![0_u64; offsets.len()];
    let (column, row) = (70_000 / 512, 50_000 / 512);
    let index = (row * columns + column) as usize;
    (offsets[index], counts[index]) = (4 << 20, 512 * 512 * 3);
    let blocks = vec![
        long(322, &[512]),
        long(323, &[512]),
        long8(324, &offsets),
        long8(325, &counts),
    ];
    write_bigtiff(&tiled, tags(blocks), (4 << 20) + 512 * 512 * 3);
    let in_tile = (50_000 - row * 512) * 512 + (70_000 - column * 512);
    write_at(&tiled, (4 << 20) + in_tile * 3, &[200, 100, 50]);

    // Uncompressed strips of 8,000 samples a pixel: 2 GB within 512 x 512 pixels.
    let deep = folder.path().join("deep.tif");
    let samples: u16 = 8000;
    let mut blocks = rgb_tags(512, 512);
    blocks.retain(|tag| !matches!(tag.0, 258 | 262 | 277));
    blocks.extend([
        short(258, &vec![8; usize::from(samples)]),
        short(262, &[1]),
        short(277, &[samples]),
        long8(273, &[1 << 20]),
        long(278, &[512]),
        long8(279, &[512 * 512 * u64::from(samples)]),
    ]);
    blocks.extend(geo_tags(32651));
    write_bigtiff(&deep, blocks, (1 << 20) + 512 * 512 * u64::from(samples));

    let before = peak_mib();
    for file in [&striped, &tiled] {
        let map = open_map(file, &MapOptions::default()).unwrap();
        sweep(map.as_ref());
    }
    let map = open_map(&deep, &MapOptions::default()).unwrap();
    let patch = map
        .read(WindowPx::new(250.0, 250.0, 8.0, 8.0), 8, 8)
        .unwrap();
    assert!(patch.valid.iter().all(|&v| v == 255));
    // Where a tile was never written, there is no data.
    let map = open_map(&tiled, &MapOptions::default()).unwrap();
    let patch = map
        .read(WindowPx::new(0.0, 0.0, 512.0, 512.0), 512, 512)
        .unwrap();
    assert!(patch.valid.iter().all(|&v| v == 0));
    if let (Some(before), Some(after)) = (before, peak_mib()) {
        assert!(
            after - before < 400,
            "{before} MiB before, {after} MiB after"
        );
    }
}
