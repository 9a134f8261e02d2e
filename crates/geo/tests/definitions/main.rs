//! Definitions of EPSG codes, against PROJ without grids (`make_golden.py`): each is where PROJ puts it, or says how far off it may be.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_geo::{Crs, LonLat, distance_m};

/// Rows in which the list is right and PROJ's registry is not.
const PROJ_IS_OFF: [(u32, &str); 7] = [
    (
        2170,
        "deprecated: MGI is Austria's datum, 305 m from MGI 1901 of Slovenia, which its successor EPSG:3911 has",
    ),
    (
        4240,
        "Indian 1975 to WGS 84 (4) turns the wrong way: 188 m from all others of that datum",
    ),
    (24047, "Indian 1975 too"),
    (
        6200,
        "latitude of origin 45 deg 27' in place of the 44 deg 47' of Michigan North",
    ),
    (
        6996,
        "deprecated: its scale is a millionth of that of its successor EPSG:7131",
    ),
    (6997, "deprecated: as EPSG:6996"),
    (
        26591,
        "deprecated: its longitude of origin is that from Greenwich, not from Rome",
    ),
];

/// Metres that a definition may be off, by what it says of itself.
fn promised_m(caveat: Option<&str>) -> f64 {
    match caveat {
        None => 5.0,
        Some(text) if text.contains("tens of metres") => 100.0,
        Some(text) if text.contains("hundreds of metres") => 1000.0,
        Some(other) => panic!("{other}"),
    }
}

#[test]
fn definitions_are_where_proj_puts_them_or_warn() {
    let mut wrong = Vec::new();
    let mut checked = 0;
    for line in include_str!("golden.csv").lines().skip(1) {
        let (code, numbers) = line.split_once(',').unwrap();
        let code: u32 = code.parse().unwrap();
        let numbers: Vec<f64> = numbers.split(',').map(|n| n.parse().unwrap()).collect();
        let &[x, y, lon_deg, lat_deg] = numbers.as_slice() else {
            panic!("{line}");
        };
        if PROJ_IS_OFF.iter().any(|(off, _)| *off == code) {
            continue;
        }
        let crs = match Crs::from_epsg(code) {
            Ok(crs) => crs,
            Err(refused) => {
                let text = refused.to_string();
                let says_why = text.contains("gdalwarp") || text.contains("rojection");
                assert!(says_why, "EPSG:{code}: {text}");
                continue;
            }
        };
        let off_m = crs.lonlat_from_xy(x, y).map_or(f64::INFINITY, |found| {
            distance_m(found, LonLat::new(lon_deg, lat_deg))
        });
        let promised_m = promised_m(crs.caveat());
        if off_m > promised_m {
            wrong.push(format!(
                "EPSG:{code}: {off_m:.1} m, and it says {promised_m}"
            ));
        }
        checked += 1;
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(checked > 900, "{checked}");
}

/// The middle of the area of a world-wide system is its origin, where projections of the sphere and of the ellipsoid agree. Places by
/// PROJ, for x = 1000 km and y = 5000 km.
#[test]
fn world_wide_systems_are_where_proj_puts_them_off_the_equator() {
    for (code, lon_deg, lat_deg) in [
        (3975, 10.384_459_72, 42.817_181_45),
        (6871, 8.983_152_84, 40.916_274_47),
    ] {
        let crs = Crs::from_epsg(code).unwrap();
        let found = crs.lonlat_from_xy(1e6, 5e6).unwrap();
        let off_m = distance_m(found, LonLat::new(lon_deg, lat_deg));
        assert!(off_m < 0.01, "EPSG:{code}: {off_m} m");
    }
}

#[test]
fn the_added_definitions_can_be_used() {
    let lines = include_str!("../../epsg/definitions.txt").lines().skip(1);
    let codes = lines.map(|line| line.split_once(' ').unwrap().0.parse().unwrap());
    let unusable: Vec<String> = codes
        .filter_map(|code| Crs::from_epsg(code).err())
        .map(|error| error.to_string())
        .collect();
    assert!(unusable.is_empty(), "{}", unusable.join("\n"));
    // The national grid of Colombia, and the local one of Lviv.
    for code in [9377, 9851] {
        assert_eq!(Crs::from_epsg(code).unwrap().caveat(), None, "EPSG:{code}");
    }
}

#[test]
fn codes_whose_coordinates_are_ambiguous_are_refused() {
    for (code, words) in [
        (7400, "grads"),
        (2065, "south and west"),
        (5513, "south and west"),
        (8044, "south and west"),
        (8045, "south and west"),
        (4805, "former Yugoslavia"),
    ] {
        let error = Crs::from_epsg(code).unwrap_err().to_string();
        assert!(
            error.contains(words) && error.contains("gdalwarp"),
            "EPSG:{code}: {error}"
        );
    }
    // West and south in one meaning only: Lo 19 of South Africa, as PROJ has it.
    let lo19 = Crs::from_epsg(2048).unwrap();
    let place = lo19.lonlat_from_xy(-9345.0, 3_652_752.0).unwrap();
    assert!(
        distance_m(place, LonLat::new(19.1, -33.0)) < 10.0,
        "{place:?}"
    );
}
