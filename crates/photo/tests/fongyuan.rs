//! Real photos from a data folder beside the checkout. Run with `cargo test -p grimnet-photo --test fongyuan -- --ignored`.

use std::path::PathBuf;

use grimnet_photo::{Photo, ViewPrior};

fn data(file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/data")
        .join(file)
}

#[test]
#[ignore = "needs shared data: photos of fongyuan in ../shared/data"]
fn gimbal_of_zeros_is_set_aside_and_the_scale_is_uncertain() {
    for file in [
        "fongyuan/photos/DJI_001.jpg",
        "fongyuan/originals/DJI_001.jpg",
    ] {
        let photo = Photo::open_reduced(data(file), 1000).unwrap();
        assert_eq!(photo.image.width(), 1000);
        let view = photo.view(&ViewPrior::default());
        let heading = view.heading.unwrap();
        assert!((heading.heading_deg - 152.1).abs() < 1e-9);
        assert!(heading.sigma_deg >= 10.0);
        let footprint = view.footprint.unwrap();
        assert!(
            (footprint.width_m - 172.6).abs() < 0.5,
            "{}",
            footprint.width_m
        );
        assert!(footprint.is_uncertain());
        // The true footprint is 157 m.
        assert!((footprint.width_m - 157.0).abs() < footprint.relative_sigma * footprint.width_m);
        assert!(view.tilt.is_none());
        let aside = |word: &str| view.set_aside.iter().any(|e| e.field.contains(word));
        assert!(aside("gimbal") && aside("GPS altitude"));
        assert!(photo.metadata.position.is_some());
    }
}

#[test]
#[ignore = "needs shared data: photos of brighton in ../shared/data"]
fn a_gimbal_that_looks_down_is_used() {
    let photo = Photo::open_reduced(data("brighton/DJI_0020.JPG"), 800).unwrap();
    let view = photo.view(&ViewPrior::default());
    assert!((view.heading.unwrap().heading_deg - 44.2).abs() < 1e-9);
    assert!(view.tilt.is_none());
    // 20 mm by diagonals of a 4:3 frame: 81.7 degrees across, at 40.1 m.
    assert!((view.hfov_deg.unwrap() - 81.7).abs() < 0.2);
    assert!((view.footprint.unwrap().width_m - 69.4).abs() < 0.3);
}
