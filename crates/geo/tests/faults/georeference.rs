//! Maps that do not say, or say wrongly, where they lie.

use super::*;

#[test]
fn a_picture_without_georeference_is_refused() {
    let dir = folder();
    for name in ["map.png", "map.jpg"] {
        let path = dir.path().join(name);
        picture(&path, 20, 10);
        let error = refused(open(&path), &path, &["corners", "coordinate system"]);
        assert!(matches!(error, GeoError::NoGeoreference { .. }));
    }
    // A CRS alone is not a place.
    let path = dir.path().join("map.png");
    let error = refused(with_crs(&path, "EPSG:32651"), &path, &["corners"]);
    assert!(matches!(error, GeoError::NoGeoreference { .. }));
}

#[test]
fn a_tiff_without_georeference_is_refused() {
    let dir = folder();
    let path = dir.path().join("plain.tif");
    write_map(&path, (20, 10), vec![], colours);
    let error = refused(open(&path), &path, &["corners"]);
    assert!(matches!(error, GeoError::NoGeoreference { .. }));
    let map = with_corners(&path, [120.0, 24.0, 120.002, 24.001]).unwrap();
    let centre = map
        .georeference()
        .lonlat_from_map_px(MapPx::new(10.0, 5.0))
        .unwrap();
    assert!(distance_m(centre, LonLat::new(120.001, 24.0005)) < 1e-6);
}

#[test]
fn ground_control_points_alone_are_refused_with_advice() {
    let dir = folder();
    let path = dir.path().join("gcp.tif");
    let points: Vec<f64> = (0..4)
        .flat_map(|i| [f64::from(i), 0.0, 0.0, 1.0, 2.0, 0.0])
        .collect();
    write_map(&path, (20, 10), vec![double(33922, &points)], colours);
    let error = refused(open(&path), &path, &["gdalwarp"]);
    assert!(matches!(error, GeoError::NoGeoreference { .. }));
}

#[test]
fn a_transform_without_crs_is_refused_until_it_is_given() {
    let dir = folder();
    let path = dir.path().join("nocrs.tif");
    let mut tags = geo_tags(32651);
    tags.pop();
    write_map(&path, (20, 10), tags, colours);
    let error = refused(open(&path), &path, &["coordinate system"]);
    assert!(matches!(error, GeoError::MissingCrs { .. }));
    let map = with_crs(&path, "EPSG:32651").unwrap();
    assert_eq!(map.georeference().crs().definition(), "EPSG:32651");

    let png = dir.path().join("world.png");
    picture(&png, 20, 10);
    std::fs::write(
        dir.path().join("world.pgw"),
        "0.5\n0\n0\n-0.5\n300000.25\n2699999.75\n",
    )
    .unwrap();
    let error = refused(open(&png), &png, &["coordinate system"]);
    assert!(matches!(error, GeoError::MissingCrs { .. }));
    let map = with_crs(&png, "32651").unwrap();
    assert_eq!(
        map.georeference().affine().to_gdal(),
        [300000.0, 0.5, 0.0, 2700000.0, 0.0, -0.5]
    );
}

#[test]
fn an_unknown_crs_is_refused() {
    let dir = folder();
    let path = dir.path().join("unknown.tif");
    write_map(&path, (20, 10), geo_tags(9999), colours);
    let error = refused(open(&path), &path, &["EPSG:9999", "EPSG:CODE", "gdalwarp"]);
    assert!(matches!(error, GeoError::UnsupportedCrs { .. }));
    // NAD 27, whose shift is a grid: no other code is right.
    write_map(&path, (20, 10), geo_tags(26711), colours);
    let text = refused(open(&path), &path, &["EPSG:26711", "gdalwarp"]).to_string();
    assert!(!text.contains("EPSG:CODE"), "{text}");
    assert_eq!(text.matches("gdalwarp").count(), 1, "{text}");
    for crs in [
        "EPSG:9999",
        "EPSG:999999",
        "mars",
        "",
        "+proj=nosuch",
        "ESRI:4326",
        // The parser of PROJ strings cuts them between bytes.
        "+proj=tmerc +lat_0=4\u{fffd}9\"",
        "+proj=tmerc +lat_0=4\u{b0}30'",
    ] {
        let error = match with_crs(&path, crs) {
            Err(error) => error,
            Ok(map) => panic!("{crs}: {}", map.describe()),
        };
        assert!(
            matches!(error, GeoError::UnknownCrs { .. }),
            "{crs}: {error}"
        );
        assert!(error.to_string().contains("EPSG:32651"), "{error}");
    }
}

/// Keys as ArcGIS and GDAL write them: a Mercator projection, and in words that it is Web Mercator. Read as degrees or as a
/// projection of the ellipsoid, it would lie 20 km away or nowhere.
#[test]
fn web_mercator_in_words_is_web_mercator() {
    let dir = folder();
    let path = dir.path().join("words.tif");
    let write = |model: u16, citation: u16, words: &str, lon_0: f64| {
        let length = words.len() as u16 + 1;
        let keys = [
            [1024, 0, 1, model],
            [1025, 0, 1, 1],
            [2048, 0, 1, 4326],
            [3072, 0, 1, 32767],
            [3074, 0, 1, 32767],
            [3075, 0, 1, 7],
            [3076, 0, 1, 9001],
            [3080, 34736, 1, 0],
        ];
        let mut keys = [&keys[..], &[[citation, 34737, length, 0]]].concat();
        keys.sort_unstable();
        let head = [1, 1, 0, keys.len() as u16];
        let tags = vec![
            double(33550, &[0.5, 0.5, 0.0]),
            double(33922, &[0.0, 0.0, 0.0, 1e6, 6e6, 0.0]),
            short(34735, &[&head[..], &keys.concat()].concat()),
            double(34736, &[lon_0]),
            ascii(34737, &format!("{words}|")),
        ];
        write_map(&path, (20, 10), tags, colours);
        let map = open(&path).unwrap();
        (map.georeference().crs().definition().to_owned(), map)
    };
    let expected = grimnet_geo::Crs::from_epsg(3857)
        .unwrap()
        .lonlat_from_xy(1e6, 6e6)
        .unwrap();
    let pe = "ESRI PE String = PROJCS[\"WGS_1984_Web_Mercator_Auxiliary_Sphere\",GEOGCS[]]";
    for (model, citation, words) in [
        (32767, 3073, pe),
        (1, 1026, "WGS_1984_Web_Mercator"),
        (1, 1026, "WGS 84 / Pseudo-Mercator"),
    ] {
        let (definition, map) = write(model, citation, words, 0.0);
        assert_eq!(definition, "EPSG:3857", "{words}");
        let georeference = map.georeference();
        let corner = georeference
            .lonlat_from_map_px(MapPx::new(0.0, 0.0))
            .unwrap();
        assert!(distance_m(corner, expected) < 1e-3, "{words}: {corner:?}");
    }
    // Other projections keep theirs, also where the model type is not stated.
    for (words, lon_0) in [("My Mercator", 0.0), ("WGS 84 / Pseudo-Mercator", 12.0)] {
        let (definition, _) = write(32767, 1026, words, lon_0);
        assert!(
            definition.starts_with("+proj=merc"),
            "{words}: {definition}"
        );
    }
}

/// Keys as GDAL writes them of a projection that GeoTIFF lacks. Near its origin, metres could pass for degrees.
#[test]
fn a_projection_in_words_only_is_not_taken_for_degrees() {
    let dir = folder();
    let path = dir.path().join("mollweide.tif");
    let words = "ESRI PE String = PROJCS[\"World_Mollweide\",GEOGCS[]]|";
    let length = words.len() as u16;
    let keys = [
        [1, 1, 0, 5],
        [1024, 0, 1, 32767],
        [1025, 0, 1, 1],
        [2048, 0, 1, 4326],
        [3073, 34737, length, 0],
        [3076, 0, 1, 9001],
    ];
    let tags = vec![
        double(33550, &[0.5, 0.5, 0.0]),
        double(33922, &[0.0, 0.0, 0.0, 10.0, 20.0, 0.0]),
        short(34735, &keys.concat()),
        ascii(34737, words),
    ];
    write_map(&path, (20, 10), tags, colours);
    let error = refused(open(&path), &path, &["World_Mollweide", "EPSG:CODE"]);
    assert!(matches!(error, GeoError::UnsupportedCrs { .. }));
}

#[test]
fn a_crs_that_does_not_fit_is_refused() {
    let dir = folder();
    let path = dir.path().join("utm.tif");
    write_map(&path, (20, 10), geo_tags(32651), colours);
    // Metres taken for degrees.
    let error = refused(
        with_crs(&path, "EPSG:4326"),
        &path,
        &["EPSG:4326' cannot be used", "EPSG:CODE"],
    );
    assert!(matches!(error, GeoError::UnsupportedCrs { .. }));
}

#[test]
fn a_singular_transform_is_refused() {
    let dir = folder();
    let path = dir.path().join("flat.tif");
    let mut tags = geo_tags(32651);
    tags[0] = double(33550, &[0.0, 0.5, 0.0]);
    write_map(&path, (20, 10), tags, colours);
    let error = refused(open(&path), &path, &["no inverse"]);
    assert!(matches!(error, GeoError::SingularTransform { .. }));

    let png = dir.path().join("bad.png");
    picture(&png, 20, 10);
    for text in ["1 2 3", "0 0 0 0 0 0", "a b c d e f", "1 0 0 -1 nan 5"] {
        std::fs::write(dir.path().join("bad.pgw"), text).unwrap();
        let error = match with_crs(&png, "EPSG:32651") {
            Err(error) => error,
            Ok(map) => panic!("{text}: {}", map.describe()),
        };
        assert!(matches!(error, GeoError::BadWorldFile { .. }), "{error}");
        assert!(error.to_string().contains("bad.pgw"), "{error}");
    }
}

#[test]
fn a_mirrored_map_is_refused() {
    let dir = folder();
    let png = dir.path().join("map.png");
    picture(&png, 20, 10);
    // x and y of a step to the right, then of a step down: all turns by 90 degrees, as they are and mirrored.
    for (right, down, is_mirrored) in [
        ([0.5, 0.0], [0.0, -0.5], false),
        ([0.0, 0.5], [0.5, 0.0], false),
        ([-0.5, 0.0], [0.0, 0.5], false),
        ([0.0, -0.5], [-0.5, 0.0], false),
        // Rows from south to north; columns from east to west.
        ([0.5, 0.0], [0.0, 0.5], true),
        ([-0.5, 0.0], [0.0, -0.5], true),
        ([0.0, 0.5], [-0.5, 0.0], true),
        ([0.0, -0.5], [0.5, 0.0], true),
    ] {
        let text = format!(
            "{}\n{}\n{}\n{}\n300000\n2700000\n",
            right[0], right[1], down[0], down[1]
        );
        std::fs::write(dir.path().join("map.pgw"), text).unwrap();
        let opened = with_crs(&png, "EPSG:32651");
        if is_mirrored {
            let error = refused(opened, &png, &["mirrored", "gdalwarp IN OUT.tif"]);
            assert!(matches!(error, GeoError::Mirrored { .. }), "{error}");
        } else if let Err(error) = opened {
            panic!("{right:?} {down:?}: {error}");
        }
    }
    let path = dir.path().join("south_up.tif");
    let mut tags = geo_tags(32651);
    // Model transformation in place of scale and tie point.
    tags.drain(..2);
    let transform = [
        [0.5, 0.0, 0.0, 300_000.0],
        [0.0, 0.5, 0.0, 2_700_000.0],
        [0.0; 4],
        [0.0, 0.0, 0.0, 1.0],
    ];
    tags.push(double(34264, transform.as_flattened()));
    write_map(&path, (20, 10), tags, colours);
    let error = refused(open(&path), &path, &["mirrored"]);
    assert!(matches!(error, GeoError::Mirrored { .. }), "{error}");
}

/// As GDAL reads them.
#[test]
fn scale_and_tie_point_come_before_a_matrix() {
    let dir = folder();
    let path = dir.path().join("map.tif");
    let matrix = |left: f64, pixel: f64| {
        let rows = [
            [pixel, 0.0, 0.0, left],
            [0.0, -pixel, 0.0, 2_700_000.0],
            [0.0; 4],
            [0.0, 0.0, 0.0, 1.0],
        ];
        double(34264, rows.as_flattened())
    };
    let left = |tags: Vec<Tag>| {
        write_map(&path, (20, 10), tags, colours);
        open(&path).unwrap().georeference().affine().to_gdal()[0]
    };
    for pixel in [0.5, 0.0] {
        let mut tags = geo_tags(32651);
        tags.push(matrix(310_000.0, pixel));
        assert_eq!(left(tags), 300_000.0, "{pixel}");
    }
    let mut tags = geo_tags(32651);
    tags[0] = double(33550, &[0.0, 0.0, 0.0]);
    tags.push(matrix(310_000.0, 0.5));
    assert_eq!(left(tags), 310_000.0);
}

#[test]
fn swapped_corners_are_reported() {
    let dir = folder();
    let path = dir.path().join("map.png");
    picture(&path, 200, 100);
    // A latitude of 120 degrees.
    let error = with_corners(&path, [24.0, 120.0, 24.001, 120.002])
        .err()
        .unwrap();
    assert!(matches!(error, GeoError::SwappedLonLat { .. }), "{error}");
    assert!(
        error.to_string().contains("LL_LON,LL_LAT,UR_LON,UR_LAT"),
        "{error}"
    );
    // Both could be latitudes: the shape of the pixels tells. 60.4 N 22.4 E, 0.135 m pixels.
    let size = (147, 127);
    let path = dir.path().join("finland.png");
    picture(&path, size.0, size.1);
    let (w, e, s, n) = (22.460441, 22.464059, 60.402409, 60.403962);
    assert!(with_corners(&path, [w, s, e, n]).is_ok());
    let error = with_corners(&path, [s, w, n, e]).err().unwrap();
    assert!(matches!(error, GeoError::SwappedLonLat { .. }), "{error}");
    // `gdalwarp -t_srs EPSG:4326` makes pixels that are square in degrees.
    let path = dir.path().join("berlin.png");
    picture(&path, 200, 100);
    assert!(with_corners(&path, [13.4, 52.5, 13.402, 52.501]).is_ok());
}

#[test]
fn corners_that_span_nothing_are_refused() {
    let dir = folder();
    let path = dir.path().join("map.png");
    picture(&path, 20, 10);
    for corners in [
        [120.0, 24.0, 119.9, 24.1],
        [120.0, 24.0, 120.1, 23.9],
        [120.0, 24.0, 120.0, 24.0],
        [f64::NAN, 24.0, 120.1, 24.1],
        [120.0, 24.0, f64::INFINITY, 24.1],
        [120.0, -200.0, 120.1, 24.1],
        [1e9, 24.0, 2e9, 24.1],
    ] {
        let error = with_corners(&path, corners).err().unwrap();
        assert!(
            matches!(error, GeoError::BadCorners { .. }),
            "{corners:?}: {error}"
        );
    }
}

#[test]
fn the_antimeridian_is_crossed_the_short_way() {
    let dir = folder();
    let path = dir.path().join("fiji.png");
    picture(&path, 200, 200);
    let map = with_corners(&path, [179.999, -17.001, -179.999, -16.999]).unwrap();
    let check = |map: &dyn Raster, side: f64| {
        let g = map.georeference();
        let (x_m, _) = g.ground_resolution_m(MapPx::new(side / 2.0, 10.0)).unwrap();
        assert!(x_m < 6.0, "{x_m}");
        for x in [0.1, side / 2.0 - 0.1, side / 2.0 + 0.1, side - 0.1] {
            let place = g.lonlat_from_map_px(MapPx::new(x, 10.0)).unwrap();
            assert!((-180.0..180.0).contains(&place.lon_deg));
            let back = g.map_px_from_lonlat(place).unwrap();
            assert!(
                (back.x - x).abs() < 1e-4 && (back.y - 10.0).abs() < 1e-4,
                "{x}: {back:?}"
            );
        }
        let left = g.lonlat_from_map_px(MapPx::new(0.0, 0.0)).unwrap();
        let right = g.lonlat_from_map_px(MapPx::new(side, 0.0)).unwrap();
        assert!(left.lon_deg > 179.9 && right.lon_deg < -179.9);
        assert!(distance_m(left, right) < 600.0);
    };
    check(map.as_ref(), 200.0);
    check(
        open(&golden_map("antimeridian.tif")).unwrap().as_ref(),
        96.0,
    );
    check(
        open(&golden_map("antimeridian_degrees.tif"))
            .unwrap()
            .as_ref(),
        96.0,
    );
    // Web Mercator beyond its edge.
    let path = dir.path().join("mercator.tif");
    let mut tags = geo_tags(3857);
    tags[1] = double(33922, &[0.0, 0.0, 0.0, 20_037_458.0, -1_900_000.0, 0.0]);
    write_map(&path, (200, 20), tags, colours);
    check(open(&path).unwrap().as_ref(), 200.0);
    // A mosaic with a picture on either side.
    for name in ["a.png", "b.png"] {
        picture(&dir.path().join(name), 100, 100);
    }
    let table = table(
        dir.path(),
        "filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon\n\
         a.png,-16.999,179.999,-17.000,180.000\n\
         b.png,-16.999,-180.000,-17.000,-179.999\n",
    );
    let map = open(&table).unwrap();
    assert!(
        (200..=201).contains(&map.size_px().0),
        "{:?}",
        map.size_px()
    );
    check(map.as_ref(), 200.0);
}
