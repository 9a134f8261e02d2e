//! Shifts between a datum and WGS 84: which of the list of definitions are replaced, and how good they are.

/// Shifts of the list of definitions, and those that take their place, as position vector transformations (`+towgs84`). Each shift of
/// the list, with its meridian, belongs to one datum. The replacements are those of the EPSG registry that PROJ uses without grids.
const REPLACED: [(&str, &str); 12] = [
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
    // New Zealand Geodetic Datum 1949: a grid, which is not built in; NZGD49 to WGS 84 (2), 4 m, which the list has beside it.
    (
        "+towgs84=59.47,-5.04,187.44,0.47,-0.1,1.024,-4.5993 +nadgrids=nzgd2kgrid0005.gsb",
        "+towgs84=59.47,-5.04,187.44,0.47,-0.1,1.024,-4.5993",
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
    // MGI (Ferro) in the projections of Austria: 299 m off, as the shift is that of Yugoslavia's MGI 1901; MGI to WGS 84 (3), 1.5 m.
    (
        "+towgs84=682,-203,480,0,0,0,0 +pm=ferro",
        "+towgs84=577.326,90.129,463.919,5.137,1.474,5.297,2.4232 +pm=ferro",
    ),
    // French Polynesia: shifts whose rotations have the signs of a coordinate frame. Fatu Iva 72: 4737 m off; Fatu Iva 72 to WGS 84 (2),
    // 2 m. IGN63 Hiva Oa: 6 m off; IGN63 Hiva Oa to WGS 84 (3), 2 m. Moorea 87: 7 m off; Moorea 87 to WGS 84 (2), 1 m.
    (
        "+towgs84=347.103,1078.125,2623.922,-33.8875,70.6773,-9.3943,186.074",
        "+towgs84=347.175,1077.618,2623.677,33.9058,-70.6776,9.4013,186.0647",
    ),
    (
        "+towgs84=410.721,55.049,80.746,2.5779,2.3514,0.6664,17.3311",
        "+towgs84=410.793,54.542,80.501,-2.5596,-2.3517,-0.6594,17.3218",
    ),
    (
        "+towgs84=215.525,149.593,176.229,-3.2624,-1.692,-1.1571,10.4773",
        "+towgs84=218.769,150.75,176.75,3.5231,2.0037,1.288,10.9817",
    ),
    // Pampa del Castillo: 257 m off; Pampa del Castillo to WGS 84 (2), 2.5 m around the Golfo San Jorge. West and south of it, where
    // much of the area of these codes lies, PROJ takes no shift at all: 250 to 276 m from here.
    (
        "+towgs84=27.5,14,186.4,0,0,0,0",
        "+towgs84=-233.43,6.65,173.64,0,0,0,0",
    ),
    // Nord Sahara 1959: up to 12 m off; Nord Sahara 1959 to WGS 84 (11), 1 m.
    (
        "+towgs84=-209.3622,-87.8162,404.6198,0.0046,3.4784,0.5805,-1.4547",
        "+towgs84=-267.407,-47.068,446.357,-0.179423,5.577661,-1.27762,1.204866",
    ),
    // Fahud: 9 m off; Fahud to WGS 84 (3), 7 m.
    (
        "+towgs84=-333.102,-11.02,230.69,0,0,0.554,0.219",
        "+towgs84=-345,3,223,0,0,0,0",
    ),
];

/// Shifts without rotation that are good to 2.5 m all the same, in all of their country: CH1903 and CH1903+, HD72, NTF, UCS-2000
/// (accuracies and areas of the EPSG registry).
const GOOD_WITHOUT_ROTATION: [&str; 4] = [
    "674.374,15.056,405.346",
    "52.17,-71.82,-14.9",
    "-168,-60,320",
    "24,-121,-76",
];

/// A definition of the list with the best shift that is known here.
pub(crate) fn with_better_shift(proj_string: &str) -> String {
    // Whole parts only.
    let padded = format!("{proj_string} ");
    let replaced = REPLACED
        .iter()
        .find(|(listed, _)| padded.contains(&format!("{listed} ")));
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
