//! Maps of several pictures, and what lies beside a picture.

use std::path::{Path, PathBuf};

use grimnet_geo::{MapOptions, WindowPx, open_map};

use crate::gdal::{check, open, path_of, refused};

/// A folder with the four GeoTIFFs of a mosaic.
fn parts() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for part in 0..4 {
        let name = format!("part_{part}.tif");
        std::fs::copy(path_of(&name), dir.path().join(name)).unwrap();
    }
    dir
}

#[test]
fn vrts_are_what_gdal_reads() {
    for name in ["parts.vrt", "nodata.vrt", "cut.vrt"] {
        check(name, open(name).as_ref(), name);
    }
}

#[test]
fn lists_and_folders_of_geotiffs_are_the_vrt_of_them() {
    check("parts.txt", open("parts.txt").as_ref(), "parts.vrt");
    let dir = parts();
    let map = open_map(dir.path(), &MapOptions::default()).unwrap();
    check("folder", map.as_ref(), "parts.vrt");
    // What macOS leaves on disks of other systems.
    std::fs::write(dir.path().join("._part_0.tif"), b"\0\x05\x16\x07").unwrap();
    let map = open_map(dir.path(), &MapOptions::default()).unwrap();
    check("folder with AppleDouble", map.as_ref(), "parts.vrt");
    // The order matters, and each file's bytes.
    let hash = |path: &Path| {
        let map = open_map(path, &MapOptions::default()).unwrap();
        map.content_hash().unwrap()
    };
    let before = hash(dir.path());
    std::fs::rename(dir.path().join("part_0.tif"), dir.path().join("part_9.tif")).unwrap();
    assert_ne!(before, hash(dir.path()));
}

#[test]
fn seams_of_reduced_mosaics_have_no_holes() {
    // Pictures whose edges lie on no even pixel.
    let map = open("parts.txt");
    for side in [37, 52, 110] {
        let inner = WindowPx::new(30.0, 30.0, 160.0, 80.0);
        let patch = map.read(inner, side, side / 2).unwrap();
        let holes = patch.valid.pixels().filter(|p| p.0[0] == 0).count();
        assert_eq!(holes, 0, "{side}");
    }
}

#[test]
fn what_a_vrt_does_beyond_putting_pictures_together_is_refused() {
    let error = refused(&path_of("warped.vrt")).to_string();
    assert!(
        error.contains("VRTWarpedDataset") && error.contains("gdal_translate"),
        "{error}"
    );
    let text = std::fs::read_to_string(path_of("parts.vrt")).unwrap();
    let dir = parts();
    let path = dir.path().join("changed.vrt");
    let changed = |from: &str, to: &str| {
        assert!(text.contains(from));
        std::fs::write(&path, text.replace(from, to)).unwrap();
        refused(&path).to_string()
    };
    for (from, to, words) in [
        (
            "SimpleSource",
            "KernelFilteredSource",
            "KernelFilteredSource",
        ),
        ("<NODATA>0</NODATA>", "<LUT>0:0,255:9</LUT>", "LUT"),
        (
            "<NODATA>0</NODATA>",
            "<NODATA>x</NODATA>",
            "'x' is no number",
        ),
        ("<SourceBand>2<", "<SourceBand>1<", "band 2"),
        (">part_0.tif<", ">/vsicurl/http://a/b.tif<", "not a file"),
        (">part_0.tif<", ">missing.tif<", "missing.tif"),
        (">part_0.tif<", ">.<", "not a file"),
        ("xSize=\"120\"", "xSize=\"1200\"", "takes more of"),
        ("xSize=\"120\"", "xSize=\"nan\"", "SrcRect"),
        ("rasterXSize=\"220\"", "rasterXSize=\"0\"", "rasterXSize"),
        ("</VRTDataset>", "", "damaged"),
        ("VRTDataset", "Other", "not a VRT"),
    ] {
        let error = changed(from, to);
        assert!(error.contains(words), "{from} -> {to}: {error}");
    }
}

#[test]
fn a_vrt_of_one_band_takes_grey_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("map.vrt");
    let write_vrt_of = |picture: &str| {
        let text = format!(
            "<VRTDataset rasterXSize=\"20\" rasterYSize=\"10\"><SRS>EPSG:32632</SRS>\
             <GeoTransform>300000, 0.5, 0, 2700000, 0, -0.5</GeoTransform>\
             <VRTRasterBand dataType=\"Byte\" band=\"1\"><ColorInterp>Gray</ColorInterp><SimpleSource>\
             <SourceFilename relativeToVRT=\"1\">{picture}</SourceFilename><SourceBand>1</SourceBand>\
             <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"20\" ySize=\"10\"/>\
             <DstRect xOff=\"0\" yOff=\"0\" xSize=\"20\" ySize=\"10\"/>\
             </SimpleSource></VRTRasterBand></VRTDataset>"
        );
        std::fs::write(&path, text).unwrap();
    };
    let grey = image::GrayImage::from_fn(20, 10, |x, y| image::Luma([(100 + x + y) as u8]));
    for name in ["grey.png", "grey.jpg"] {
        grey.save(dir.path().join(name)).unwrap();
        write_vrt_of(name);
        let map = open_map(&path, &MapOptions::default()).unwrap();
        let patch = map
            .read(WindowPx::new(0.0, 0.0, 20.0, 10.0), 20, 10)
            .unwrap();
        for (x, y, pixel) in patch.rgb.enumerate_pixels() {
            let [value] = grey.get_pixel(x, y).0;
            // JPEG changes values a little.
            let is_near = pixel.0.iter().all(|&seen| seen.abs_diff(value) < 8);
            assert!(is_near, "{name} {x} {y}: {pixel:?}");
        }
    }
    let colours = image::RgbImage::from_fn(20, 10, |x, _| image::Rgb([200, x as u8, 0]));
    colours.save(dir.path().join("colours.png")).unwrap();
    write_vrt_of("colours.png");
    let error = refused(&path).to_string();
    assert!(error.contains("one band of the colours"), "{error}");
}

#[test]
fn a_vrt_lies_where_its_own_coordinate_system_says() {
    let text = std::fs::read_to_string(path_of("parts.vrt")).unwrap();
    let dir = parts();
    let path = dir.path().join("changed.vrt");
    let write = |changes: &[(&str, &str)]| {
        let mut text = text.clone();
        for (from, to) in changes {
            assert!(text.contains(from), "{from}");
            text = text.replace(from, to);
        }
        std::fs::write(&path, text).unwrap();
    };
    let open = || open_map(&path, &MapOptions::default()).unwrap();
    let no_code = ("AUTHORITY[\"EPSG\",\"32632\"]", "EXTENSION[\"x\",\"y\"]");
    // The parameters say it.
    write(&[no_code]);
    check("changed.vrt", open().as_ref(), "parts.vrt");
    write(&[
        no_code,
        (
            "PARAMETER[\"central_meridian\",9]",
            "PARAMETER[\"central_meridian\",15]",
        ),
    ]);
    let centre = |map: &dyn grimnet_geo::Raster| {
        let place = map.georeference();
        place.lonlat_from_map_px(place.centre_px()).unwrap()
    };
    let east_deg = centre(open().as_ref()).lon_deg
        - centre(
            open_map(&path_of("parts.vrt"), &MapOptions::default())
                .unwrap()
                .as_ref(),
        )
        .lon_deg;
    assert!((east_deg - 6.0).abs() < 1e-6, "{east_deg}");
    // One that is not read is not that of the pictures.
    write(&[no_code, ("\"Transverse_Mercator\"", "\"Other\"")]);
    let error = refused(&path).to_string();
    assert!(
        error.contains("changed.vrt") && error.contains("UTM zone 32N") && error.contains("other"),
        "{error}"
    );
    let with_crs = MapOptions {
        crs: Some("EPSG:32632".to_string()),
        ..MapOptions::default()
    };
    check(
        "changed.vrt",
        open_map(&path, &with_crs).unwrap().as_ref(),
        "parts.vrt",
    );
}

#[test]
fn statistics_that_gdal_keeps_in_a_vrt_leave_it_the_same_map() {
    let text = std::fs::read_to_string(path_of("parts.vrt")).unwrap();
    let dir = parts();
    let path = dir.path().join("parts.vrt");
    let hash = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let map = open_map(&path, &MapOptions::default()).unwrap();
        assert!(map.files().contains(&path));
        map.content_hash().unwrap()
    };
    let first = hash(&text);
    let statistics =
        "<Metadata><MDI key=\"STATISTICS_MAXIMUM\">254</MDI></Metadata></VRTRasterBand>";
    assert_eq!(first, hash(&text.replace("</VRTRasterBand>", statistics)));
    for (from, to) in [
        ("rasterXSize=\"220\"", "rasterXSize=\"221\""),
        ("<DstRect xOff=\"0\"", "<DstRect xOff=\"1\""),
        ("<NODATA>0</NODATA>", "<NODATA>1</NODATA>"),
        ("\"32632\"", "\"32633\""),
        ("5.2000000000000000e+06", "5.2000010000000000e+06"),
    ] {
        assert!(text.contains(from), "{from}");
        assert_ne!(first, hash(&text.replace(from, to)), "{from}");
    }
}

#[test]
fn geotiffs_that_do_not_fit_together_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::copy(path_of("part_0.tif"), dir.path().join("a.tif")).unwrap();
    let other = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden/maps");
    for (name, words) in [
        ("striped_lzw_one_row.tif", "coordinate system"),
        ("rotated.tif", ""),
        ("u16_five_bands.tif", "not 8-bit"),
    ] {
        std::fs::copy(other.join(name), dir.path().join("b.tif")).unwrap();
        let error = refused(dir.path()).to_string();
        assert!(
            error.contains(words) && error.contains("b.tif"),
            "{name}: {error}"
        );
    }
    let list = dir.path().join("pictures.txt");
    std::fs::copy(path_of("pam.png"), dir.path().join("c.png")).unwrap();
    std::fs::write(&list, "a.tif\nc.png\n").unwrap();
    let error = refused(&list).to_string();
    assert!(
        error.contains("c.png") && error.contains("no GeoTIFF"),
        "{error}"
    );
    std::fs::write(dir.path().join("empty.txt"), "# nothing\n").unwrap();
    let error = refused(&dir.path().join("empty.txt")).to_string();
    assert!(error.contains("lists no GeoTIFFs"), "{error}");
}

#[test]
fn georeference_and_nodata_beside_the_file_are_used() {
    for name in ["pam.png", "pam_baseline.tif"] {
        check(name, open(name).as_ref(), name);
    }
    // It belongs to the map.
    let dir = tempfile::tempdir().unwrap();
    for name in ["pam.png", "pam.png.aux.xml"] {
        std::fs::copy(path_of(name), dir.path().join(name)).unwrap();
    }
    let path = dir.path().join("pam.png");
    let hash = |path: &Path| {
        let map = open_map(path, &MapOptions::default()).unwrap();
        map.content_hash().unwrap()
    };
    let before = hash(&path);
    let sidecar = dir.path().join("pam.png.aux.xml");
    let text = std::fs::read_to_string(&sidecar).unwrap();
    std::fs::write(
        &sidecar,
        text.replace("5.2000000000000000e+06", "5.2000010000000000e+06"),
    )
    .unwrap();
    assert_ne!(before, hash(&path));
    std::fs::write(
        &sidecar,
        "<PAMDataset><GeoTransform>1, 2</GeoTransform></PAMDataset>",
    )
    .unwrap();
    let error = refused(&path).to_string();
    assert!(
        error.contains("aux.xml") && error.contains("six numbers"),
        "{error}"
    );
}
