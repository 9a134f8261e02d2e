//! Shifts between a datum and WGS 84: which of the list of definitions are replaced, and how good they are.

/// Shifts of the list of definitions, and those that take their place, as position vector transformations (`+towgs84`). Each shift of
/// the list belongs to one datum. The replacements are those of the EPSG registry that PROJ uses without grids.
const REPLACED: [(&str, &str); 4] = [
    // S-JTSK: 10 m off; S-JTSK to WGS 84 (5), 1 m.
    (
        "+towgs84=589,76,480,0,0,0,0",
        "+towgs84=572.213,85.334,461.94,4.9732,1.529,5.2484,3.5378",
    ),
    // EPSG:3844, Stereo 70 of Romania: Pulkovo 1942(58) to WGS 84 (19), whose rotations are those of a coordinate frame; the
    // list leaves their signs, 38 m off.
    (
        "+towgs84=2.329,-147.042,-92.08,0.309,-0.325,-0.497,5.69",
        "+towgs84=2.329,-147.042,-92.08,-0.309,0.325,0.497,5.69",
    ),
    // Israel 1993: 10 m off; Israel 1993 to WGS 84 (2), 0.5 m.
    (
        "+towgs84=-48,55,52,0,0,0,0",
        "+towgs84=23.772,17.49,17.859,-0.3132,-1.85274,1.67299,-5.4262",
    ),
    // UCS-2000 of Ukraine: 10 m off; UCS-2000 to WGS 84 (2), 1 m.
    (
        "+towgs84=25,-141,-78.5,0,0.35,0.736,0",
        "+towgs84=24,-121,-76,0,0,0,0",
    ),
];

/// Shifts without rotation that are good to 2 m all the same: CH1903 and CH1903+, HD72, NTF, UCS-2000 (accuracies of the EPSG
/// registry).
const GOOD_WITHOUT_ROTATION: [&str; 4] = [
    "674.374,15.056,405.346",
    "52.17,-71.82,-14.9",
    "-168,-60,320",
    "24,-121,-76",
];

/// A definition of the list with the best shift that is known here.
pub(crate) fn with_better_shift(proj_string: &str) -> String {
    let replaced = REPLACED
        .iter()
        .find(|(listed, _)| proj_string.split_whitespace().any(|part| part == *listed));
    match replaced {
        Some((listed, better)) => proj_string.replace(listed, better),
        None => proj_string.to_string(),
    }
}

/// A warning about the accuracy of a definition.
pub(crate) fn caveat_of(proj_string: &str) -> Option<String> {
    let has = |key: &str| proj_string.contains(key);
    let value = |key: &str| {
        let mut parts = proj_string.split_whitespace();
        parts.find_map(|part| part.strip_prefix(key))
    };
    let shift = value("+towgs84=");
    let shift_known = has("+datum=") || shift.is_some() || has("+nadgrids=@null");
    // GRS 80 without a shift: a plate-fixed frame, within one or two metres of WGS 84. Files give its numbers too.
    let is_grs80 = value("+a=").and_then(|a| a.parse().ok()) == Some(6_378_137.0)
        && value("+rf=")
            .and_then(|rf| rf.parse::<f64>().ok())
            .is_some_and(|rf| (rf - 298.2572).abs() < 1e-4);
    if !shift_known && !is_grs80 && !has("+ellps=GRS80") && !has("+ellps=WGS84") {
        return Some(
            "its definition has no shift to WGS 84: positions can be off by hundreds of metres"
                .to_string(),
        );
    }
    shift.filter(|shift| is_coarse(shift)).map(|_| {
        "its shift to WGS 84 has three parameters only: positions can be off by tens of metres; reproject the map with a better \
         one: gdalwarp -t_srs EPSG:4326 IN OUT"
            .to_string()
    })
}

/// Whether a shift moves without rotating: one such shift for a whole country or continent is good to 5 to 50 m (accuracies of
/// the EPSG registry).
fn is_coarse(shift: &str) -> bool {
    let is_zero = |part: &&str| part.parse() == Ok(0.0);
    let parts: Vec<&str> = shift.split(',').collect();
    let (moves, rotations) = parts.split_at(parts.len().min(3));
    !moves.iter().all(is_zero)
        && rotations.iter().all(is_zero)
        && !GOOD_WITHOUT_ROTATION.contains(&moves.join(",").as_str())
}
