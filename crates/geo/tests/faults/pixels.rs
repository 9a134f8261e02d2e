//! Files that are damaged, cut off, too large or of an unusual kind, and windows that cannot be read.

use super::*;

#[test]
fn a_map_smaller_than_a_tile_is_read_and_padded() {
    let dir = folder();
    let path = dir.path().join("small.tif");
    write_map(&path, (20, 10), geo_tags(32651), colours);
    let map = open(&path).unwrap();
    let patch = map
        .read(WindowPx::new(-246.0, -251.0, 512.0, 512.0), 512, 512)
        .unwrap();
    assert_eq!(patch.valid.iter().filter(|&&v| v == 255).count(), 200);
    assert_eq!(patch.rgb.get_pixel(246 + 7, 251 + 3).0, colours(7, 3));
    assert_eq!(patch.rgb.get_pixel(0, 0).0, [0, 0, 0]);
    let outside = map
        .read(WindowPx::new(1e6, -1e6, 64.0, 64.0), 32, 32)
        .unwrap();
    assert!(outside.valid.iter().all(|&v| v == 0));
}

/// What is read of a map of one row with these samples and tags.
fn row_read(width_px: u32, own: Vec<Tag>, row: &[u8]) -> RasterPatch {
    let dir = folder();
    let path = dir.path().join("map.tif");
    let at = 400_000;
    let mut tags = vec![
        long(256, &[width_px]),
        long(257, &[1]),
        short(259, &[1]),
        short(277, &[1]),
        long8(273, &[at]),
        long(278, &[1]),
        long8(279, &[row.len() as u64]),
    ];
    tags.extend(own);
    tags.extend(geo_tags(32651));
    assert!(write_bigtiff(&path, tags, at + row.len() as u64) <= at);
    write_at(&path, at, row);
    let window = WindowPx::new(0.0, 0.0, f64::from(width_px), 1.0);
    open(&path).unwrap().read(window, width_px, 1).unwrap()
}

#[test]
fn nodata_is_a_sample_as_it_is_stored() {
    let row_seen = |mut own: Vec<Tag>, nodata: &str, row: &[u8]| -> Vec<u8> {
        own.push(ascii(42113, nodata));
        row_read(4, own, row).valid.into_raw()
    };
    // An index of 16 bits into a palette.
    let palette = vec![
        short(258, &[16]),
        short(262, &[3]),
        short(320, &vec![0x8000; 3 << 16]),
    ];
    let row = [0_u16, 0, 256, 256].map(u16::to_le_bytes).concat();
    assert_eq!(row_seen(palette, "0", &row), [0, 0, 255, 255]);
    // Grey of 4 bits, decoded to 8.
    let grey = vec![short(258, &[4]), short(262, &[1])];
    assert_eq!(row_seen(grey, "15", &[0xff, 0x12]), [0, 0, 255, 255]);
}

/// Writers store 8-bit colours times 257, times 256 or as they are (GDAL's open option `COLOR_TABLE_MULTIPLIER`).
#[test]
fn colours_of_a_palette_are_shown_as_they_are() {
    let row: Vec<u8> = (0..=255).collect();
    // From 40 to 167: a stretch would change them.
    let colour = |index: u16, band: u16| 40 + (index + 50 * band) % 128;
    for factor in [257, 256, 1] {
        let entries = (0..3).flat_map(|band| (0..256).map(move |index| colour(index, band)));
        let palette: Vec<u16> = entries.map(|entry| entry * factor).collect();
        let own = vec![short(258, &[8]), short(262, &[3]), short(320, &palette)];
        let patch = row_read(256, own, &row);
        for (index, pixel) in (0..).zip(patch.rgb.pixels()) {
            let expected = [0, 1, 2].map(|band| colour(index, band) as u8);
            assert_eq!(pixel.0, expected, "{factor}: {index}");
        }
    }
}

#[test]
fn windows_that_cannot_be_read_are_refused() {
    let dir = folder();
    let path = dir.path().join("map.tif");
    write_map(&path, (20, 10), geo_tags(32651), colours);
    let map = open(&path).unwrap();
    for (window, w, h) in [
        (WindowPx::new(f64::NAN, 0.0, 5.0, 5.0), 5, 5),
        (WindowPx::new(0.0, 0.0, 0.0, 5.0), 5, 5),
        (WindowPx::new(0.0, 0.0, -5.0, 5.0), 5, 5),
        (WindowPx::new(0.0, 0.0, 5.0, 5.0), 0, 5),
        (WindowPx::new(0.0, 0.0, 5.0, 5.0), 100_000, 100_000),
        (WindowPx::new(1e300, 0.0, 5.0, 5.0), 5, 5),
        // The filter would take hours to evaluate.
        (WindowPx::new(-1e9, -1e9, 2e9, 2e9), 5, 5),
        (WindowPx::new(0.0, 0.0, 5.0, 9e11), 640, 640),
    ] {
        let error = map.read(window, w, h).unwrap_err();
        assert!(matches!(error, GeoError::BadWindow { .. }), "{error}");
    }
}

#[test]
fn truncated_files_are_refused_when_they_are_opened() {
    let dir = folder();
    for name in [
        "tiled_jpeg_ycbcr.tif",
        "striped_lzw_one_row.tif",
        "cog.tif",
        "packbits_bigtiff.tif",
    ] {
        let bytes = std::fs::read(golden_map(name)).unwrap();
        let path = dir.path().join(name);
        for share in [0.03, 0.3, 0.6, 0.98] {
            std::fs::write(&path, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
            let error = refused(open(&path), &path, &[]);
            assert!(
                matches!(error, GeoError::Truncated { .. } | GeoError::Damaged { .. }),
                "{name} {share}: {error:?}"
            );
            assert!(
                error.to_string().contains("copy or download it again"),
                "{error}"
            );
        }
    }
    // Pictures are decoded when they are read.
    for name in ["map.png", "map.jpg"] {
        let path = dir.path().join(name);
        picture(&path, 200, 200);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
        let map = with_corners(&path, [120.0, 24.0, 120.002, 24.0018]).unwrap();
        let error = map
            .read(WindowPx::new(0.0, 0.0, 9.0, 9.0), 9, 9)
            .unwrap_err();
        assert!(matches!(error, GeoError::Damaged { .. }), "{error:?}");
        assert!(error.to_string().contains(name), "{error}");
    }
}

/// As many programs write maps.
#[test]
fn a_truncated_map_of_one_uncompressed_strip_is_refused_when_it_is_opened() {
    let dir = folder();
    let path = dir.path().join("map.tif");
    write_map(&path, (80, 60), geo_tags(32651), colours);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    let error = refused(open(&path), &path, &[]);
    assert!(matches!(error, GeoError::Truncated { .. }), "{error:?}");
    // Two strips are declared full, of which the second holds 20 rows of 40.
    let mut tags = rgb_tags(80, 60);
    tags.extend(geo_tags(32651));
    tags.extend([
        long8(273, &[4096, 4096 + 40 * 240]),
        long(278, &[40]),
        long8(279, &[40 * 240, 40 * 240]),
    ]);
    write_bigtiff(&path, tags, 4096 + 60 * 240);
    open(&path).unwrap();
}

#[test]
fn damaged_blocks_are_an_error_that_names_the_file() {
    let dir = folder();
    let mut bytes = std::fs::read(golden_map("tiled_deflate_predictor.tif")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 1000].fill(0xAA);
    let path = dir.path().join("damaged.tif");
    std::fs::write(&path, bytes).unwrap();
    let error = match open(&path) {
        Err(error) => error,
        Ok(map) => map
            .read(WindowPx::new(0.0, 0.0, 96.0, 80.0), 96, 80)
            .unwrap_err(),
    };
    assert!(error.to_string().contains("damaged.tif"), "{error}");
}

#[test]
fn what_is_not_a_picture_is_refused() {
    let dir = folder();
    for (name, bytes) in [
        ("text.tif", &b"hello, this is not a map"[..]),
        ("empty.tif", &b""[..]),
        ("short.jpg", &b"\xFF\xD8"[..]),
        ("page.png", &b"<html></html>"[..]),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = refused(open(&path), &path, &[]);
        assert!(
            matches!(error, GeoError::NotAMap { .. } | GeoError::Damaged { .. }),
            "{error:?}"
        );
    }
    let path = dir.path().join("absent.tif");
    assert!(matches!(
        refused(open(&path), &path, &[]),
        GeoError::Io { .. }
    ));
    let path = dir.path().join("nothing");
    std::fs::create_dir(&path).unwrap();
    let error = refused(open(&path), &path, &[]);
    assert!(matches!(error, GeoError::NotAMap { .. }), "{error:?}");
}

#[test]
fn what_is_no_picture_is_called_what_it_is() {
    let dir = folder();
    for (name, start, words) in [
        ("page.tif", "\n<!DOCTYPE html><html>", "web page"),
        ("page.jpg", "<html><body>404", "web page"),
        (
            "pointer.tif",
            "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\n",
            "git lfs pull",
        ),
        ("pack.tif", "GRIMPACK\u{3}", "grimnet pack"),
        (
            "other.tif",
            "nothing of the kind",
            "does not begin as a TIFF",
        ),
        ("other.png", "nothing of the kind", "known format"),
        ("other.jp2", "\0\0\0\u{c}jP  ", "gdal_translate"),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, start).unwrap();
        let error = refused(open(&path), &path, &[words]);
        assert!(matches!(error, GeoError::NotAMap { .. }), "{error}");
        assert!(!error.to_string().contains("not supported"), "{error}");
    }
}

#[test]
fn compressions_that_are_not_read_are_refused_with_what_to_do() {
    let dir = folder();
    // Numbers of tag 259 in libtiff's tiff.h; 52546 is that of DNG 1.7.
    for (number, samples, words) in [
        (50002, 3, "JPEG XL (50002)"),
        (52546, 3, "JPEG XL (52546)"),
        (34712, 3, "JPEG 2000"),
        (4, 3, "CCITT"),
        (60000, 3, "compression 60000"),
        (50001, 4, "WebP with alpha inside TIFF"),
        (34887, 4, "LERC with 8-bit alpha inside TIFF"),
        (34887, 2, "LERC with 8-bit alpha inside TIFF"),
        (7, 2, "JPEG of grey with alpha inside TIFF"),
    ] {
        let path = dir.path().join("rare.tif");
        let mut tags = rgb_tags(64, 64);
        tags[2] = short(258, &vec![8; samples]);
        tags[3] = short(259, &[number]);
        tags[5] = short(277, &[samples as u16]);
        if samples != 3 {
            tags[4] = short(262, &[if samples == 4 { 2 } else { 1 }]);
            tags.push(short(338, &[2]));
        }
        tags.extend(geo_tags(32651));
        tags.extend([long8(273, &[4096]), long(278, &[64]), long8(279, &[100])]);
        write_bigtiff(&path, tags, 8192);
        let error = refused(open(&path), &path, &[words, "gdal_translate"]);
        assert!(matches!(error, GeoError::Unsupported { .. }), "{error:?}");
    }
}

/// GDAL has no JPEG of these, so that advice to make one would be of no use.
#[test]
fn samples_of_many_bits_are_refused_with_a_command_that_takes_them() {
    let dir = folder();
    let path = dir.path().join("deep.tif");
    // LZMA of integers, and floats of 16 bits.
    for (compression, format, words) in [
        (34925, 1, "gdal_translate -of COG -co COMPRESS=DEFLATE"),
        (1, 3, "-ot Float32 -of COG -co COMPRESS=DEFLATE"),
    ] {
        let mut tags = rgb_tags(64, 64);
        tags[2] = short(258, &[16; 3]);
        tags[3] = short(259, &[compression]);
        tags.push(short(339, &[format; 3]));
        tags.extend(geo_tags(32651));
        tags.extend([long8(273, &[4096]), long(278, &[64]), long8(279, &[100])]);
        write_bigtiff(&path, tags, 65_536);
        refused(open(&path), &path, &[words]);
    }
}

/// A block of the reader holds several of these strips, of which a sparse file has some.
#[test]
fn strips_that_were_never_written_have_no_data() {
    let dir = folder();
    let path = dir.path().join("sparse.tif");
    // Strips of 8 rows: the second of four has pixels, all 7.
    let mut tags = rgb_tags(64, 32);
    tags.extend(geo_tags(32651));
    tags.push(ascii(42113, "255"));
    tags.extend([
        long8(273, &[0, 4096, 0, 0]),
        long(278, &[8]),
        long8(279, &[0, 64 * 8 * 3, 0, 0]),
    ]);
    write_bigtiff(&path, tags, 8192);
    write_at(&path, 4096, &[7; 64 * 8 * 3]);
    let map = open(&path).unwrap();
    let patch = map
        .read(WindowPx::new(0.0, 0.0, 64.0, 32.0), 64, 32)
        .unwrap();
    for (_, y, seen) in patch.valid.enumerate_pixels() {
        assert_eq!(seen.0[0] == 255, (8..16).contains(&y), "row {y}");
    }
    assert_eq!(patch.rgb.get_pixel(63, 15).0, [7; 3]);
}

/// `gdaladdo -ro` writes an overview without mask beside a file that has its mask in itself.
#[test]
fn an_overview_without_the_mask_of_the_map_is_left_out() {
    let dir = folder();
    let path = dir.path().join("masked.tif");
    let whole = WindowPx::new(0.0, 0.0, 96.0, 80.0);
    let quartered = || open(&path).unwrap().read(whole, 24, 20).unwrap();
    std::fs::copy(golden_map("jpeg_internal_mask.tif"), &path).unwrap();
    let alone = quartered();
    assert!(alone.valid.contains(&0));
    write_map(
        &dir.path().join("masked.tif.ovr"),
        (24, 20),
        Vec::new(),
        |_, _| [200; 3],
    );
    assert_eq!(quartered(), alone);
}

/// libtiff states the places of sub-images with the type IFD.
#[test]
fn overviews_in_sub_images_of_libtiff_are_read() {
    let dir = folder();
    let [path, overview] = ["map.tif", "overview.tif"].map(|name| dir.path().join(name));
    let (pixels_at, sub_image_at) = (6000, 8192);
    let mut tags = rgb_tags(10, 5);
    tags.extend([
        long(254, &[1]),
        long8(273, &[pixels_at]),
        long(278, &[5]),
        long8(279, &[150]),
    ]);
    write_bigtiff(&overview, tags, 0);
    // Its values are all in the entries, which can therefore lie anywhere.
    let sub_image = std::fs::read(&overview).unwrap()[16..].to_vec();
    // In the entry itself, and beside it.
    for count in [1, 3] {
        let places = [u32::to_le_bytes(sub_image_at); 3].concat();
        let mut tags = geo_tags(32651);
        let places = places[..4 * count].to_vec();
        tags.push(Tag(330, 13, count as u64, places));
        write_map(&path, (20, 10), tags, colours);
        write_at(&path, pixels_at, &[200; 150]);
        write_at(&path, u64::from(sub_image_at), &sub_image);
        let map = open(&path).unwrap();
        assert!(map.describe().contains("1 overviews"), "{}", map.describe());
        let whole = WindowPx::new(0.0, 0.0, 20.0, 10.0);
        let quarter = map.read(whole, 5, 2).unwrap();
        assert_eq!(quarter.rgb.get_pixel(2, 1).0, [200; 3], "{count}");
    }
}

#[test]
fn decompression_bombs_are_refused_before_they_are_decoded() {
    let dir = folder();
    // A PNG header that promises 10^9 pixels a side.
    let path = dir.path().join("bomb.png");
    picture(&path, 2, 2);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[16..24].copy_from_slice(&[0x3B, 0x9A, 0xCA, 0, 0x3B, 0x9A, 0xCA, 0]);
    std::fs::write(&path, bytes).unwrap();
    refused(with_corners(&path, [120.0, 24.0, 120.1, 24.1]), &path, &[]);
    // A TIFF whose one compressed strip would be 7 GB.
    let path = dir.path().join("bomb.tif");
    let mut tags = rgb_tags(50_000, 50_000);
    tags[3] = short(259, &[8]);
    tags.extend(geo_tags(32651));
    tags.extend([
        long8(273, &[4096]),
        long(278, &[50_000]),
        long8(279, &[1000]),
    ]);
    write_bigtiff(&path, tags, 8192);
    let map = open(&path).unwrap();
    let error = map
        .read(WindowPx::new(0.0, 0.0, 9.0, 9.0), 9, 9)
        .unwrap_err();
    assert!(matches!(error, GeoError::Unsupported { .. }), "{error:?}");
    assert!(error.to_string().contains("gdal_translate"), "{error}");
    // No pixels at all.
    let path = dir.path().join("nothing.tif");
    let mut tags = rgb_tags(0, 0);
    tags.extend(geo_tags(32651));
    tags.extend([long8(273, &[4096]), long(278, &[1]), long8(279, &[0])]);
    write_bigtiff(&path, tags, 8192);
    refused(open(&path), &path, &[]);
}

#[test]
fn grey_alpha_and_16_bit_pictures_are_read() {
    let dir = folder();
    let corners = [120.0, 24.0, 120.002, 24.0018];
    let path = dir.path().join("grey.png");
    GrayImage::from_fn(20, 20, |x, _| Luma([x as u8 * 10]))
        .save(&path)
        .unwrap();
    let patch = with_corners(&path, corners)
        .unwrap()
        .read(WindowPx::new(0.0, 0.0, 20.0, 20.0), 20, 20)
        .unwrap();
    assert_eq!(patch.rgb.get_pixel(7, 3).0, [70, 70, 70]);

    let path = dir.path().join("alpha.png");
    RgbaImage::from_fn(20, 20, |x, _| Rgba([9, 8, 7, if x < 5 { 0 } else { 255 }]))
        .save(&path)
        .unwrap();
    let patch = with_corners(&path, corners)
        .unwrap()
        .read(WindowPx::new(0.0, 0.0, 20.0, 20.0), 20, 20)
        .unwrap();
    assert_eq!(
        (patch.valid.get_pixel(4, 0).0, patch.valid.get_pixel(5, 0).0),
        ([0], [255])
    );
    assert_eq!(
        (patch.rgb.get_pixel(4, 0).0, patch.rgb.get_pixel(5, 0).0),
        ([0; 3], [9, 8, 7])
    );

    let path = dir.path().join("deep.png");
    image::ImageBuffer::from_fn(20, 20, |x, _| Luma([x as u16 * 257]))
        .save(&path)
        .unwrap();
    let patch = with_corners(&path, corners)
        .unwrap()
        .read(WindowPx::new(0.0, 0.0, 20.0, 20.0), 20, 20)
        .unwrap();
    assert_eq!(patch.rgb.get_pixel(7, 3).0, [7, 7, 7]);
}

#[test]
fn the_hash_is_of_all_files_of_the_map() {
    let dir = folder();
    let path = dir.path().join("map.png");
    picture(&path, 20, 10);
    std::fs::write(dir.path().join("map.pgw"), "1 0 0 -1 300000 2700000").unwrap();
    let hash = |path: &Path| {
        with_crs(path, "EPSG:32651")
            .unwrap()
            .content_hash()
            .unwrap()
    };
    let first = hash(&path);
    assert_eq!(first, hash(&path));
    std::fs::write(dir.path().join("map.pgw"), "1 0 0 -1 300001 2700000").unwrap();
    assert_ne!(first, hash(&path));
    // A file alone has the hash of its bytes.
    let tif = golden_map("grey.tif");
    let bytes = std::fs::read(&tif).unwrap();
    assert_eq!(
        open(&tif).unwrap().content_hash().unwrap(),
        *blake3::hash(&bytes).as_bytes()
    );
}

#[test]
fn reads_are_the_same_on_any_number_of_threads_and_with_any_cache() {
    let read = |threads: usize, cache_bytes: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let options = MapOptions {
                cache_bytes: Some(cache_bytes),
                ..MapOptions::default()
            };
            let map = open_map(&golden_map("u16_five_bands.tif"), &options).unwrap();
            map.read(WindowPx::new(-3.3, 2.7, 88.8, 77.7), 31, 29)
                .unwrap()
        })
    };
    let one = read(1, 0);
    assert_eq!(one, read(4, 0));
    assert_eq!(one, read(3, 1 << 20));
}

#[test]
fn what_a_truncated_map_needs_and_has_are_bytes_of_the_file() {
    let dir = folder();
    let path = dir.path().join("map.tif");
    // Its directory stands behind its pixels, as many programs write it.
    let mut bytes = b"II*\0".to_vec();
    bytes.extend(60_000u32.to_le_bytes());
    bytes.resize(1000, 0);
    std::fs::write(&path, &bytes).unwrap();
    refused(open(&path), &path, &["needs 60002 bytes", "has 1000;"]);
}
