//! Made-up observations for `grim calibrate --observed`: right answers with many inliers, those from elsewhere with few.

use std::fmt::Write as _;
use std::path::Path;

/// Writes observations of so many photos, each also of one taken elsewhere.
pub fn write(path: &Path, photos: usize) {
    let mut state = 1_u64;
    let mut uniform = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    };
    // Box & Muller 1958.
    let normal = |sigma: f64, uniform: &mut dyn FnMut() -> f64| {
        sigma * (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
    };
    let mut text = "scene,elsewhere,heading_known,real,error_east_m,error_north_m,level_gsd_m,inliers,places,matches,\
                    runner_up_inliers,spread,inlier_ee_m2,inlier_en_m2,inlier_nn_m2,expected_inliers,held_back_points,\
                    held_back_excess,on_map\n"
        .to_owned();
    for photo in 0..photos {
        let sigma_m = 0.05 + 0.45 * uniform();
        let variance_m2 = sigma_m * sigma_m;
        let right_m = (6.0 * variance_m2 + 0.0576).sqrt();
        let chance = 6 + (-2.0 * uniform().ln()) as usize;
        let inliers = 25 + (60.0 * uniform()) as usize;
        for (elsewhere, inliers, runner_up, error_m) in [
            (false, inliers, 7, right_m),
            (true, chance, chance - 1, 300.0),
        ] {
            let scene = photo % 6;
            let (east_m, north_m) = (normal(error_m, &mut uniform), normal(error_m, &mut uniform));
            let spread = 0.2 + 0.3 * uniform();
            writeln!(
                text,
                "{scene},{elsewhere},true,false,{east_m},{north_m},0.3,{inliers},{inliers},150,{runner_up},{spread},\
                 {variance_m2},0,{variance_m2},0.5,100,0,1"
            )
            .unwrap();
        }
    }
    std::fs::write(path, text).unwrap();
}
