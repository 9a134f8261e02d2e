//! Maps of tiles and of several pictures put together at random: each gives a map that can be read, or an error that names a
//! file of it.
//!
//! `PROPTEST_CASES` sets the number of inputs of each test (CONTRIBUTING.md, "Fuzzing").

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use std::io::{Cursor, Write};
use std::path::Path;

use grimnet_geo::{MapOptions, MapPx, open_map};
use image::{ImageFormat, Rgb, RgbImage};
use proptest::collection::vec;
use proptest::prelude::*;
use support::usable::assert_usable;
use support::{geo_tags, write_map};

/// Inputs of each test in a normal run.
const CASES: u32 = 64;

/// Opens a map and uses it. Its centre is on Earth, and nothing in its folder changes.
fn check(folder: &Path, path: &Path) {
    let before = names(folder);
    match open_map(path, &MapOptions::default()) {
        Ok(map) => {
            assert_usable(&*map);
            let (width, height) = map.size_px();
            let centre = MapPx::new(width as f64 / 2.0, height as f64 / 2.0);
            map.georeference().lonlat_from_map_px(centre).unwrap();
        }
        Err(error) => {
            let text = error.to_string();
            let file = folder.display().to_string();
            // The list names it.
            let other = "/dev/null";
            assert!(
                text.contains(&file) || text.contains(other),
                "names no file: {text}"
            );
        }
    }
    assert_eq!(before, names(folder), "a file was written");
}

fn names(folder: &Path) -> Vec<std::ffi::OsString> {
    let mut names: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    names.sort();
    names
}

/// A tile: pictures of several sizes and formats, whole and cut off, and other bytes.
fn tile() -> impl Strategy<Value = Vec<u8>> {
    let picture = (
        prop_oneof![6 => Just(64u32), 1 => Just(128), 1 => 1..70u32],
        prop_oneof![
            Just(ImageFormat::Png),
            Just(ImageFormat::Jpeg),
            Just(ImageFormat::WebP)
        ],
        any::<u8>(),
    )
        .prop_map(|(side, format, colour)| {
            let mut bytes = Vec::new();
            RgbImage::from_pixel(side, side, Rgb([colour, 99, 3]))
                .write_to(&mut Cursor::new(&mut bytes), format)
                .unwrap();
            bytes
        });
    prop_oneof![
        8 => picture.clone(),
        1 => (picture.clone(), 0..200usize).prop_map(|(mut bytes, length)| {
            bytes.truncate(length);
            bytes
        }),
        1 => (picture, any::<prop::sample::Index>(), any::<u8>()).prop_map(|(mut bytes, at, value)| {
            let at = at.index(bytes.len());
            bytes[at] = value;
            bytes
        }),
        1 => vec(any::<u8>(), 0..40),
    ]
}

/// Zoom, column and row: neighbours at a few zooms, and anything.
fn address() -> impl Strategy<Value = (i64, i64, i64)> {
    prop_oneof![
        8 => (2..5i64, 0..4i64, 0..4i64),
        1 => (-1..40i64, -1..1_000_000i64, -1..1_000_000i64),
        1 => any::<(i64, i64, i64)>(),
    ]
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn varint(mut value: u64, to: &mut Vec<u8>) {
    while value >= 0x80 {
        to.push(value as u8 | 0x80);
        value >>= 7;
    }
    to.push(value as u8);
}

/// An entry of a directory: step of the tile number, run length, length, offset + 1.
type Entry = (u64, u64, u64, u64);

fn directory(entries: &[Entry], stated: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    varint(stated, &mut bytes);
    for column in 0..4 {
        for entry in entries {
            varint([entry.0, entry.1, entry.2, entry.3][column], &mut bytes);
        }
    }
    bytes
}

fn entry() -> impl Strategy<Value = Entry> {
    (
        prop_oneof![6 => 0..6u64, 1 => any::<u64>()],
        prop_oneof![4 => Just(1u64), 2 => Just(0), 2 => 0..9u64, 1 => any::<u64>()],
        prop_oneof![6 => 0..300u64, 1 => any::<u64>()],
        prop_oneof![6 => 0..400u64, 1 => any::<u64>()],
    )
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn tile_folders(
        tiles in vec((address(), tile(), prop_oneof![4 => Just("png"), 2 => Just("jpg"), 1 => Just("txt"), 1 => Just("webp")]), 0..9),
        description in prop_oneof![5 => Just(None), 1 => Just(Some("mercator".to_owned())), 1 => "\\PC{0,20}".prop_map(Some)],
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("map");
        std::fs::create_dir(&path).unwrap();
        for ((zoom, column, row), bytes, ending) in tiles {
            let folder = path.join(zoom.to_string()).join(column.to_string());
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join(format!("{row}.{ending}")), bytes).unwrap();
        }
        if let Some(text) = description {
            std::fs::write(path.join("tilemapresource.xml"), text).unwrap();
        }
        check(dir.path(), &path);
    }

    #[test]
    fn pmtiles(
        root in vec(entry(), 0..6),
        leaves in vec(vec(entry(), 0..5), 0..3),
        tiles in vec(tile(), 0..3),
        count_off in prop_oneof![8 => Just(0u64), 1 => any::<u64>()],
        compression in prop_oneof![4 => Just((1u8, 1u8)), 4 => Just((2, 1)), 1 => Just((2, 2)), 1 => any::<(u8, u8)>()],
        tile_type in prop_oneof![6 => 2..5u8, 1 => any::<u8>()],
        version in prop_oneof![9 => Just(3u8), 1 => any::<u8>()],
        lie in prop_oneof![6 => Just(None), 1 => (0..12usize, any::<u64>()).prop_map(Some)],
        cut in prop_oneof![6 => Just(None), 1 => (0..400usize).prop_map(Some)],
        circle in any::<bool>(),
    ) {
        let pack = |bytes: Vec<u8>| if compression.0 == 2 { gzip(&bytes) } else { bytes };
        let leaf_bytes: Vec<Vec<u8>> = leaves.iter().map(|l| pack(directory(l, l.len() as u64))).collect();
        let leaf_section = leaf_bytes.concat();
        let mut root = root;
        let mut at = 0;
        for leaf in &leaf_bytes {
            root.push((1, 0, leaf.len() as u64, at + 1));
            at += leaf.len() as u64;
        }
        let data = tiles.concat();
        let mut start = 0;
        for tile in &tiles {
            root.push((1, 1, tile.len() as u64, start + 1));
            start += tile.len() as u64;
        }
        let root_bytes = pack(directory(&root, (root.len() as u64).wrapping_add(count_off)));
        let root_at = 127;
        let leaves_at = root_at + root_bytes.len() as u64;
        let data_at = leaves_at + leaf_section.len() as u64;
        let leaf_place = if circle {
            // The section of leaves is the root: its pointers lead back to it.
            (root_at, root_bytes.len() as u64)
        } else {
            (leaves_at, leaf_section.len() as u64)
        };
        let mut numbers = [
            root_at, root_bytes.len() as u64, leaves_at, 0, leaf_place.0, leaf_place.1, data_at, data.len() as u64, 1, 1, 1, 0,
        ];
        if let Some((which, value)) = lie {
            numbers[which] = value;
        }
        let mut bytes = b"PMTiles".to_vec();
        bytes.push(version);
        bytes.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
        // 96: clustered, 97: compression of directories, 98: of tiles, 99: type.
        bytes.truncate(96);
        bytes.extend([0, compression.0, compression.1, tile_type]);
        bytes.resize(127, 0);
        for part in [&root_bytes, &leaf_section, &data] {
            bytes.extend(part);
        }
        if let Some(length) = cut {
            bytes.truncate(length);
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("map.pmtiles");
        std::fs::write(&path, bytes).unwrap();
        check(dir.path(), &path);
    }

    #[test]
    fn vrts_and_lists(
        rectangles in vec((-20.0..60.0f64, -20.0..60.0f64, 1.0..40.0f64, 1.0..40.0f64), 1..4),
        number in prop_oneof![6 => Just(None), 1 => any::<f64>().prop_map(|v| Some(v.to_string())), 1 => "\\PC{0,8}".prop_map(Some)],
        name in prop_oneof![6 => Just("map.0.tif".to_owned()), 1 => Just("../map.1.tif".to_owned()), 1 => Just("map.vrt".to_owned()), 1 => "[^/\\pC]{0,9}"],
        element in prop_oneof![6 => Just("SimpleSource"), 2 => Just("ComplexSource"), 1 => Just("AveragedSource")],
        extra in prop_oneof![5 => Just(String::new()), 1 => Just("<NODATA>0</NODATA>".to_owned()), 1 => Just("<a>".repeat(90)), 1 => "[<>/a-z&;\"=! ]{0,30}"],
        size in prop_oneof![6 => Just((60u64, 50u64)), 1 => any::<(u64, u64)>()],
        crs in prop_oneof![4 => Just("EPSG:32632".to_owned()), 1 => Just(String::new()), 1 => "[A-Z\\[\\],\"0-9]{0,40}", 1 => Just("PROJCS[&quot;x&quot;]".to_owned())],
        list in vec(prop_oneof![3 => Just("map.0.tif"), 1 => Just("map.1.tif"), 1 => Just("# no"), 1 => Just("map.vrt"), 1 => Just("/dev/null")], 0..4),
    ) {
        let dir = tempfile::tempdir().unwrap();
        for part in 0..2 {
            let path = dir.path().join(format!("map.{part}.tif"));
            write_map(&path, (24, 20), geo_tags(32632), |x, y| [x as u8, y as u8, 9 * part]);
        }
        let mut bands = String::new();
        for band in 1..=3 {
            bands += &format!("<VRTRasterBand dataType=\"Byte\" band=\"{band}\">");
            for (x, y, w, h) in &rectangles {
                let x = number.clone().unwrap_or_else(|| x.to_string());
                bands += &format!(
                    "<{element}><SourceFilename relativeToVRT=\"1\">{name}</SourceFilename><SourceBand>{band}</SourceBand>\
                     <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"24\" ySize=\"20\"/>\
                     <DstRect xOff=\"{x}\" yOff=\"{y}\" xSize=\"{w}\" ySize=\"{h}\"/>{extra}</{element}>"
                );
            }
            bands += "</VRTRasterBand>";
        }
        let (width, height) = size;
        let text = format!(
            "<VRTDataset rasterXSize=\"{width}\" rasterYSize=\"{height}\"><SRS>{crs}</SRS>\
             <GeoTransform>500000, 0.5, 0, 5200000, 0, -0.5</GeoTransform>{bands}</VRTDataset>"
        );
        let path = dir.path().join("map.vrt");
        std::fs::write(&path, text).unwrap();
        check(dir.path(), &path);
        let path = dir.path().join("map.txt");
        std::fs::write(&path, list.join("\n")).unwrap();
        check(dir.path(), &path);
    }
}

#[cfg(feature = "mbtiles")]
mod mbtiles {
    use super::*;
    use rusqlite::types::Value;

    /// A value of a column, usually of the right type.
    fn value(number: i64) -> impl Strategy<Value = Value> {
        prop_oneof![
            16 => Just(Value::Integer(number)),
            1 => Just(Value::Null),
            1 => Just(Value::Text(number.to_string())),
            1 => Just(Value::Real(number as f64 + 0.5)),
        ]
    }

    fn row() -> impl Strategy<Value = ([Value; 3], Value)> {
        let data = prop_oneof![
            12 => tile().prop_map(Value::Blob),
            1 => Just(Value::Null),
            1 => "\\PC{0,9}".prop_map(Value::Text),
            1 => any::<i64>().prop_map(Value::Integer),
        ];
        (address(), data).prop_flat_map(|((zoom, column, row), data)| {
            (value(zoom), value(column), value(row), Just(data))
                .prop_map(|(zoom, column, row, data)| ([zoom, column, row], data))
        })
    }

    proptest! {
        #![proptest_config(grimnet_fuzz::config(CASES))]

        #[test]
        fn databases(
            rows in vec(row(), 0..8),
            metadata in vec((prop_oneof![Just("format"), Just("bounds"), Just("crs"), Just("name")], "\\PC{0,20}"), 0..4),
            table in prop_oneof![
                8 => Just("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)"),
                1 => Just("CREATE TABLE tiles (zoom_level, tile_column)"),
                1 => Just("CREATE TABLE other (zoom_level, tile_column, tile_row, tile_data)"),
                1 => Just("CREATE VIEW tiles AS SELECT * FROM missing"),
            ],
            has_metadata in prop_oneof![4 => Just(true), 1 => Just(false)],
            flips in vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
            damage in prop_oneof![2 => Just(false), 1 => Just(true)],
            cut in prop_oneof![6 => Just(None), 1 => (16..9000usize).prop_map(Some)],
        ) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("map.mbtiles");
            let base = rusqlite::Connection::open(&path).unwrap();
            base.execute_batch("PRAGMA page_size = 1024; PRAGMA journal_mode = OFF").unwrap();
            base.execute_batch(table).unwrap();
            if has_metadata {
                base.execute_batch("CREATE TABLE metadata (name TEXT, value TEXT)").unwrap();
                for (name, value) in &metadata {
                    base.execute("INSERT INTO metadata VALUES (?1, ?2)", (name, value)).unwrap();
                }
            }
            if table.starts_with("CREATE TABLE tiles (zoom_level, tile_column, tile_row") {
                for ([zoom, column, row], data) in &rows {
                    base.execute("INSERT INTO tiles VALUES (?1, ?2, ?3, ?4)", (zoom, column, row, data)).unwrap();
                }
            }
            drop(base);
            let mut bytes = std::fs::read(&path).unwrap();
            if damage {
                for (at, value) in &flips {
                    // What the file begins with says that it is a database.
                    let at = 16 + at.index(bytes.len() - 16);
                    bytes[at] = *value;
                }
            }
            if let Some(length) = cut {
                bytes.truncate(length);
            }
            std::fs::write(&path, bytes).unwrap();
            check(dir.path(), &path);
        }
    }
}
