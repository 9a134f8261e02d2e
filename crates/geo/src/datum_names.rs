//! Datums that a file names without their shift to WGS 84: well-known text by a name, GeoKeys by a code.

use crate::Crs;

/// In each line the EPSG code of a geographic system counted from Greenwich, and the codes and names of its datum
/// (`epsg/make_datums.py`).
const NAMES: &str = include_str!("../epsg/datums.txt");

/// MGI, which is Austria's datum, and MGI 1901. Maps of the former Yugoslavia often state the first and have the second, 305 m away.
const MGI: u32 = 4312;
const MGI_1901: u32 = 3906;
/// Central meridians of the former Yugoslavia, degrees; Austria has others.
const YUGOSLAV_MERIDIANS_DEG: [f64; 4] = [15.0, 18.0, 21.0, 24.0];

/// Metres by which the axes of an ellipsoid may differ between a file and the definition of its datum.
const SAME_AXIS_M: f64 = 1.0;

/// Ellipsoid and shift of a datum as parts of a PROJ string, without the prime meridian: by its name or EPSG code, its axes in metres
/// where the file has them, and the central meridian of its projection in degrees if it has one. `None` if no shift is known, or if the
/// file has another ellipsoid under that name.
pub(crate) fn known_datum(
    name: &str,
    axes_m: Option<(f64, f64)>,
    lon_0_deg: Option<f64>,
) -> Option<String> {
    let code = epsg_of_datum(name)?;
    let known = Crs::from_epsg(epsg_under_projection(code, lon_0_deg)).ok()?;
    let (known_a_m, known_b_m) = known.axes_m();
    let is_same = axes_m.is_none_or(|(a_m, b_m)| {
        (a_m - known_a_m).abs() < SAME_AXIS_M && (b_m - known_b_m).abs() < SAME_AXIS_M
    });
    is_same.then(|| known.datum())
}

/// The EPSG code of the geographic system that a file means by a code under a projection with this central meridian in degrees.
pub(crate) fn epsg_under_projection(code: u32, lon_0_deg: Option<f64>) -> u32 {
    let is_yugoslav = lon_0_deg.is_some_and(|lon_0| YUGOSLAV_MERIDIANS_DEG.contains(&lon_0));
    if code == MGI && is_yugoslav {
        MGI_1901
    } else {
        code
    }
}

/// The EPSG code of a geographic system whose definition has the ellipsoid and the shift of a datum, by a name of ESRI (`D_...`), of
/// GDAL or of the EPSG registry, or by the code of the datum. `None` for datums without a shift.
fn epsg_of_datum(name: &str) -> Option<u32> {
    let wanted = comparable(name);
    let mut lines = NAMES.lines().filter_map(|line| line.split_once(' '));
    let (code, _) = lines.find(|(code, names)| {
        *code != "#" && names.split(' ').any(|listed| comparable(listed) == wanted)
    })?;
    code.parse().ok()
}

/// A name without the prefix, capitals and separators, in which programs differ. `+` tells CH1903+ from CH1903.
fn comparable(name: &str) -> String {
    let name = name.to_ascii_lowercase();
    name.strip_prefix("d_")
        .unwrap_or(&name)
        .chars()
        .filter(|c| c.is_ascii_alphanumeric() || *c == '+')
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_all_programs_are_known() {
        for (name, code) in [
            ("D_OSGB_1936", Some(4277)),
            ("OSGB_1936", Some(4277)),
            ("Ordnance Survey of Great Britain 1936", Some(4277)),
            ("D_MGI", Some(4312)),
            ("Militar-Geographische_Institut", Some(4312)),
            ("Militar_Geographische_Institute", Some(4312)),
            ("D_CH1903", Some(4149)),
            ("D_CH1903+", Some(4150)),
            ("Nouvelle_Triangulation_Francaise_(Paris)", Some(4275)),
            ("D_NTF", Some(4275)),
            ("6277", Some(4277)),
            ("6807", Some(4275)),
            ("IG05_Intermediate_Datum", Some(6983)),
            ("IG05(2012)_Intermediate_Datum", Some(6990)),
            ("1144", Some(6990)),
            // A grid, one in two places, none, and nothing.
            ("D_North_American_1927", None),
            ("Militar-Geographische_Institut_(Ferro)", None),
            ("D_Unknown", None),
            ("EPSG", None),
            ("", None),
        ] {
            assert_eq!(epsg_of_datum(name), code, "{name}");
        }
    }

    #[test]
    fn each_code_has_a_shift_from_greenwich() {
        for line in NAMES.lines().skip(1) {
            let (code, _) = line.split_once(' ').unwrap();
            let crs = Crs::from_epsg(code.parse().unwrap()).unwrap();
            let datum = crs.datum();
            let has_shift = datum.contains("+towgs84=") || datum.contains("+datum=");
            assert!(has_shift && !datum.contains("+pm="), "{line}: {datum}");
        }
    }
}
