//! Mosaics of pictures whose corners a table holds.

use super::*;

#[test]
fn tables_are_checked_line_by_line() {
    let dir = folder();
    picture(&dir.path().join("a.png"), 147, 127);
    let head = "filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon\n";
    let right = "a.png,60.403962,22.460441,60.402409,22.464059\n";
    assert!(open(&table(dir.path(), &format!("{head}{right}"))).is_ok());

    let swapped = "a.png,22.464059,60.402409,22.460441,60.403962\n";
    let path = table(dir.path(), &format!("{head}{right}{swapped}"));
    let error = refused(open(&path), &path, &["line 3"]);
    assert!(matches!(error, GeoError::SwappedLonLat { .. }));

    for (rows, word) in [
        ("", "no pictures"),
        ("a.png,60.4,22.4,sixty,22.5\n", "'sixty'"),
        ("a.png,60.4,22.4\n", "3 values"),
        (",60.4,22.4,60.3,22.5\n", "file name"),
    ] {
        let path = table(dir.path(), &format!("{head}{rows}"));
        let error = refused(open(&path), &path, &[word]);
        assert!(matches!(error, GeoError::BadTable { .. }), "{error}");
    }
    let path = table(dir.path(), "filename,top_left_lat\na.png,60.4\n");
    assert!(matches!(
        refused(open(&path), &path, &["corner"]),
        GeoError::BadTable { .. }
    ));
    let path = table(dir.path(), "x,y\n1,2\n");
    assert!(matches!(
        refused(open(&path), &path, &["filename"]),
        GeoError::BadTable { .. }
    ));
    let path = table(
        dir.path(),
        &format!("{head}b.png,60.403962,22.460441,60.402409,22.464059\n"),
    );
    let error = refused(open(&path), &path, &["b.png, which does not exist"]);
    assert!(matches!(error, GeoError::MissingMember { .. }));
    let path = dir.path().join("list.txt");
    std::fs::write(&path, "gone.tif\n").unwrap();
    refused(open(&path), &path, &["gone.tif, which does not exist"]);
}

#[test]
fn a_table_takes_no_other_place() {
    let dir = folder();
    picture(&dir.path().join("a.png"), 147, 127);
    let path = table(
        dir.path(),
        "filename,LL_lon,LL_lat,UR_lon,UR_lat\na.png,22.460441,60.402409,22.464059,60.403962\n",
    );
    refused(with_crs(&path, "EPSG:4230"), &path, &["WGS 84"]);
    let corners = [22.460441, 60.402409, 22.464059, 60.403962];
    refused(
        with_corners(&path, corners),
        &path,
        &["already has corners"],
    );
}

#[test]
fn tables_in_the_papers_words_are_read_too() {
    let dir = folder();
    picture(&dir.path().join("a.png"), 147, 127);
    let path = table(
        dir.path(),
        "Filename, LL_lon, LL_lat, UR_lon, UR_lat\na.png, 22.460441, 60.402409, 22.464059, 60.403962\n",
    );
    let map = open(&path).unwrap();
    assert_eq!(map.size_px(), (147, 127));
    let description = map.describe();
    for part in [
        "map.csv",
        "147 x 127 pixels",
        "EPSG:4326",
        "m per pixel",
        "table of 1 picture",
    ] {
        assert!(description.contains(part), "{part}: {description}");
    }
    let corner = map
        .georeference()
        .lonlat_from_map_px(MapPx::new(0.0, 0.0))
        .unwrap();
    assert!(distance_m(corner, LonLat::new(22.460441, 60.403962)) < 1e-6);
    let patch = map
        .read(WindowPx::new(10.0, 20.0, 30.0, 30.0), 30, 30)
        .unwrap();
    assert!(patch.valid.iter().all(|&v| v == 255));
    assert_eq!(patch.rgb.get_pixel(3, 4).0, colours(13, 24));
}

#[test]
fn a_mosaic_joins_its_pictures_and_leaves_holes_without_data() {
    let dir = folder();
    for (name, shade) in [("a.png", 50), ("b.png", 200)] {
        RgbImage::from_pixel(100, 100, Rgb([shade; 3]))
            .save(dir.path().join(name))
            .unwrap();
    }
    // b lies to the right of a, half as far up, and overlaps it by ten pixels.
    let path = table(
        dir.path(),
        "filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon\n\
         a.png,0.0100,10.0000,0.0000,10.0100\n\
         b.png,0.0050,10.0090,-0.0050,10.0190\n",
    );
    let map = open(&path).unwrap();
    let (w, h) = map.size_px();
    assert!(
        (190..=191).contains(&w) && (150..=151).contains(&h),
        "{w} x {h}"
    );
    let patch = map
        .read(WindowPx::new(0.0, 0.0, 190.0, 150.0), 190, 150)
        .unwrap();
    let at = |x, y| {
        (
            patch.rgb.get_pixel(x, y).0[0],
            patch.valid.get_pixel(x, y).0[0],
        )
    };
    assert_eq!(at(50, 50), (50, 255));
    assert_eq!(
        at(95, 75),
        (50, 255),
        "the first picture shows where both are"
    );
    assert_eq!(at(150, 100), (200, 255));
    assert_eq!(at(95, 120), (200, 255));
    assert_eq!(at(150, 20), (0, 0));
    assert_eq!(at(20, 130), (0, 0));
}

#[test]
fn geotiffs_in_a_table_are_sent_to_a_list() {
    let dir = folder();
    write_map(
        &dir.path().join("a.tif"),
        (20, 10),
        geo_tags(32632),
        colours,
    );
    let head = "filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon\n";
    let row = "a.tif,60.403962,22.460441,60.402409,22.464059\n";
    let path = table(dir.path(), &format!("{head}{row}"));
    let error = refused(open(&path), &path, &["line 2", "a.tif", "PNG", ".txt"]);
    assert!(matches!(error, GeoError::BadTable { .. }), "{error}");
}

#[test]
fn lists_may_have_quotation_marks_and_must_be_utf_8() {
    let dir = folder();
    write_map(
        &dir.path().join("a map.tif"),
        (20, 10),
        geo_tags(32632),
        colours,
    );
    let list = dir.path().join("list.txt");
    std::fs::write(&list, "\u{feff}\"a map.tif\"\r\n").unwrap();
    assert_eq!(open(&list).unwrap().size_px(), (20, 10));
    let utf_16: Vec<u8> = "\u{feff}a map.tif\r\n"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    std::fs::write(&list, utf_16).unwrap();
    refused(open(&list), &list, &["save it as UTF-8"]);
}
