//! Folders of tiles and PMTiles.

use std::path::Path;

use grimnet_geo::{MapOptions, WindowPx, open_map};

use crate::gdal::{check, copy_of, open, path_of, refused};

#[test]
fn tiles_are_what_gdal_reads() {
    for name in ["town_xyz", "town_tms", "town.pmtiles"] {
        check(name, open(name).as_ref(), "town.mbtiles");
    }
}

#[test]
fn coarser_zooms_are_overviews() {
    let map = open("town_xyz");
    // A quarter of the size: 24 squares of GDAL's averages instead of the finest zoom.
    let quarter = map
        .read(WindowPx::new(0.0, 0.0, 768.0, 768.0), 192, 192)
        .unwrap();
    let (_dir, only_finest) = copy_of("town_xyz");
    for zoom in ["15", "16"] {
        std::fs::remove_dir_all(only_finest.join(zoom)).unwrap();
    }
    let finest = open_map(&only_finest, &MapOptions::default()).unwrap();
    assert!(map.describe().contains("2 overviews"), "{}", map.describe());
    assert!(finest.describe().contains("0 overviews"));
    let averaged = finest
        .read(WindowPx::new(0.0, 0.0, 768.0, 768.0), 192, 192)
        .unwrap();
    // Grey values that the two differ by, on average, if one is shifted.
    let difference = |right: u32, down: u32| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (x, y) in (0..191).flat_map(|y| (0..191).map(move |x| (x, y))) {
            let (other_x, other_y) = (x + right, y + down);
            if quarter.valid.get_pixel(x, y).0[0] == 0
                || averaged.valid.get_pixel(other_x, other_y).0[0] == 0
            {
                continue;
            }
            let ours = quarter.rgb.get_pixel(x, y).0;
            let other = averaged.rgb.get_pixel(other_x, other_y).0;
            sum += (0..3)
                .map(|i| f64::from(ours[i].abs_diff(other[i])))
                .sum::<f64>();
            count += 3.0;
        }
        sum / count
    };
    // Box and triangle filters differ at the edges of squares.
    let in_place = difference(0, 0);
    for shifted in [difference(1, 0), difference(0, 1)] {
        assert!(in_place < 0.5 * shifted, "{in_place} {shifted}");
    }
}

#[test]
fn a_zoom_that_covers_less_than_its_overview_says_has_fewer_levels() {
    let (_dir, path) = copy_of("town_xyz");
    let column = std::fs::read_dir(path.join("16")).unwrap().next().unwrap();
    std::fs::remove_dir_all(column.unwrap().path()).unwrap();
    let map = open_map(&path, &MapOptions::default()).unwrap();
    assert!(map.describe().contains("0 overviews"), "{}", map.describe());
}

#[test]
fn a_zoom_can_be_chosen() {
    let at = |zoom| {
        let options = MapOptions {
            zoom: Some(zoom),
            ..MapOptions::default()
        };
        open_map(&path_of("town_xyz"), &options)
    };
    let coarse = at(16).unwrap();
    let fine = open("town_xyz");
    let centre = coarse.georeference().centre_px();
    let (x_m, y_m) = coarse.georeference().ground_resolution_m(centre).unwrap();
    // 156543.03 m * cos(latitude) / 2^zoom on the sphere; the ellipsoid differs by less than 0.7 %.
    let lat = coarse
        .georeference()
        .lonlat_from_map_px(centre)
        .unwrap()
        .lat_deg;
    let sphere_m = 156_543.033_928 * lat.to_radians().cos() / f64::from(1 << 16);
    assert!((x_m / sphere_m - 1.0).abs() < 7e-3, "{x_m} {sphere_m}");
    assert!((y_m / sphere_m - 1.0).abs() < 7e-3, "{y_m} {sphere_m}");
    assert_ne!(coarse.content_hash().unwrap(), fine.content_hash().unwrap());
    let error = at(12).err().unwrap().to_string();
    assert!(error.contains("zooms 15, 16, 17"), "{error}");
}

#[test]
fn half_as_many_pixels_a_tile_are_twice_as_large_on_the_ground() {
    let dir = tempfile::tempdir().unwrap();
    let resolution_m = |px: u32| {
        let folder = dir.path().join(px.to_string()).join("17/69541");
        std::fs::create_dir_all(&folder).unwrap();
        image::RgbImage::from_pixel(px, px, image::Rgb([9, 9, 9]))
            .save(folder.join("46101.png"))
            .unwrap();
        let map = open_map(&dir.path().join(px.to_string()), &MapOptions::default()).unwrap();
        let georeference = map.georeference();
        let (x_m, _) = georeference
            .ground_resolution_m(georeference.centre_px())
            .unwrap();
        x_m
    };
    let (small_m, large_m) = (resolution_m(256), resolution_m(512));
    assert!(
        (small_m / large_m - 2.0).abs() < 1e-6,
        "{small_m} {large_m}"
    );
}

#[test]
fn the_hash_changes_with_each_tile_and_its_place() {
    let (_dir, path) = copy_of("town_xyz");
    let hash = |path: &Path| {
        let map = open_map(path, &MapOptions::default()).unwrap();
        map.content_hash().unwrap()
    };
    let first = hash(&path);
    assert_eq!(
        first,
        hash(&path_of("town_xyz")),
        "of the tiles alone, not of their folder"
    );
    // Files that are no tiles do not count.
    std::fs::write(path.join("readme.txt"), "x").unwrap();
    assert_eq!(first, hash(&path));
    let column = path.join("17/69541");
    std::fs::rename(column.join("46101.png"), column.join("46100.png")).unwrap();
    assert_ne!(first, hash(&path));
    let pmtiles = open("town.pmtiles").content_hash().unwrap();
    let bytes = std::fs::read(path_of("town.pmtiles")).unwrap();
    assert_eq!(pmtiles, *blake3::hash(&bytes).as_bytes());
}

#[test]
fn vector_pmtiles_are_refused() {
    let error = refused(&path_of("vector.pmtiles")).to_string();
    assert!(error.contains("vector tiles"), "{error}");
}

#[test]
fn what_is_wrong_with_a_tile_is_said() {
    let replace = |bytes: &[u8]| {
        let (_dir, path) = copy_of("town_xyz");
        std::fs::write(path.join("17/69542/46102.png"), bytes).unwrap();
        let map = open_map(&path, &MapOptions::default()).unwrap();
        map.read(WindowPx::new(0.0, 0.0, 768.0, 768.0), 768, 768)
            .unwrap_err()
            .to_string()
    };
    let mut small = Vec::new();
    image::RgbImage::new(128, 128)
        .write_to(
            &mut std::io::Cursor::new(&mut small),
            image::ImageFormat::Png,
        )
        .unwrap();
    for (bytes, words) in [
        (&b""[..], "it is empty"),
        (b"<html>429 Too Many Requests</html>", "error page"),
        (&small, "128 x 128 pixels, where others have 256 x 256"),
    ] {
        let error = replace(bytes);
        assert!(
            error.contains(words) && error.contains("17/69542/46102"),
            "{error}"
        );
    }
}

#[test]
fn folders_of_other_things_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let error = refused(dir.path()).to_string();
    assert!(error.contains("neither tiles"), "{error}");
    let tile = dir.path().join("17/3/200000.png");
    std::fs::create_dir_all(tile.parent().unwrap()).unwrap();
    std::fs::copy(path_of("town_xyz/17/69541/46101.png"), tile).unwrap();
    let error = refused(dir.path()).to_string();
    assert!(error.contains("no tile at column 3, row 200000"), "{error}");
}

#[test]
fn years_are_not_zooms() {
    let dir = tempfile::tempdir().unwrap();
    let year = dir.path().join("2023");
    std::fs::create_dir_all(year.join("05")).unwrap();
    std::fs::create_dir(year.join("6")).unwrap();
    std::fs::write(year.join("6/flight.txt"), "x").unwrap();
    std::fs::copy(path_of("part_0.tif"), year.join("town.tif")).unwrap();
    let error = refused(dir.path()).to_string();
    assert!(
        error.contains("neither tiles") && error.contains(&year.display().to_string()),
        "{error}"
    );
    std::fs::copy(path_of("part_0.tif"), dir.path().join("town.tif")).unwrap();
    let map = open_map(dir.path(), &MapOptions::default()).unwrap();
    assert!(map.describe().contains("1 GeoTIFFs"), "{}", map.describe());
}

#[test]
fn a_tile_in_two_formats_is_refused() {
    let (_dir, path) = copy_of("town_xyz");
    let column = path.join("17/69541");
    std::fs::copy(column.join("46101.png"), column.join("46101.jpg")).unwrap();
    let error = refused(&path).to_string();
    assert!(error.contains("two pictures"), "{error}");
}

#[test]
fn endings_in_capital_letters_are_tiles() {
    let (_dir, path) = copy_of("town_xyz");
    // All of one column, and one tile of another.
    for tile in ["69541/46101", "69541/46102", "69541/46103", "69542/46101"] {
        let tile = path.join("17").join(tile);
        std::fs::rename(tile.with_extension("png"), tile.with_extension("PNG")).unwrap();
    }
    let map = open_map(&path, &MapOptions::default()).unwrap();
    check("town_xyz", map.as_ref(), "town.mbtiles");
    let plain = open("town_xyz");
    assert_eq!(map.content_hash().unwrap(), plain.content_hash().unwrap());
    let tile = path.join("17/69541/46101");
    std::fs::copy(tile.with_extension("PNG"), tile.with_extension("JPG")).unwrap();
    let error = refused(&path).to_string();
    assert!(error.contains("two pictures"), "{error}");
}

#[cfg(unix)]
#[test]
fn links_in_circles_end() {
    let (_dir, path) = copy_of("town_xyz");
    std::os::unix::fs::symlink(&path, path.join("18")).unwrap();
    std::os::unix::fs::symlink(path.join("17"), path.join("17/69541/46104.png")).unwrap();
    // Zoom 18 has the columns 15 to 18, whose files are no tiles.
    let map = open_map(&path, &MapOptions::default()).unwrap();
    assert!(map.describe().contains("zoom 17"), "{}", map.describe());
}

#[test]
fn a_finest_zoom_of_a_small_part_is_said() {
    let (_dir, path) = copy_of("town_xyz");
    // Zoom 17 over an area of 32 x 32 of its tiles, zoom 18 in one of them.
    let tile = path.join("17/69541/46101.png");
    for column in 69541..69573 {
        let folder = path.join(format!("17/{column}"));
        std::fs::create_dir_all(&folder).unwrap();
        for row in 46101..46133 {
            if !folder.join(format!("{row}.png")).exists() {
                std::fs::hard_link(&tile, folder.join(format!("{row}.png"))).unwrap();
            }
        }
    }
    assert!(
        open_map(&path, &MapOptions::default())
            .unwrap()
            .caveats()
            .is_empty()
    );
    let finer = path.join("18/139082");
    std::fs::create_dir_all(&finer).unwrap();
    std::fs::copy(&tile, finer.join("92202.png")).unwrap();
    let map = open_map(&path, &MapOptions::default()).unwrap();
    let caveats = map.caveats().join("\n");
    assert!(caveats.contains("choose zoom 17"), "{caveats}");
}
