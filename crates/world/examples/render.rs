//! Renders a map and some photos of one place as PNG files, to be looked at.
//!
//! `cargo run --release -p grimnet-world --example render -- [SEED] [OUT_DIR]`
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

use std::path::PathBuf;
use std::time::Instant;

use grimnet_world::{
    Camera, Flight, Look, MapFrame, PhotoTags, Placement, Pose, RegionM, Season, TruthRow, World,
    WorldConfig, write_geotiff, write_jpeg_with_exif, write_truth_csv,
};

fn main() {
    let mut args = std::env::args().skip(1);
    let seed = args
        .next()
        .map_or(1, |s| s.parse().expect("SEED is a number"));
    let out = PathBuf::from(args.next().unwrap_or_else(|| "demo/render".into()));
    std::fs::create_dir_all(&out).expect("output folder");

    let started = Instant::now();
    let world = World::new(WorldConfig {
        seed,
        ..WorldConfig::default()
    });
    println!(
        "world {:?}, objects {:?}",
        started.elapsed(),
        world.object_counts()
    );

    let whole = RegionM {
        x_min_m: 0.0,
        y_min_m: 0.0,
        width_m: world.size_m(),
        height_m: world.size_m(),
    };
    for (name, look) in [
        ("map_summer", Look::satellite(Season::Summer)),
        ("map_winter", Look::satellite(Season::Winter)),
    ] {
        let started = Instant::now();
        let map = world.render_map(whole, 1.0, &look);
        map.save(out.join(format!("{name}.png"))).expect("write");
        println!("{name} 1.0 m/px {:?}", started.elapsed());
    }
    let camera = Camera {
        hfov_deg: 70.0,
        width_px: 1024,
        height_px: 768,
    };
    for (i, (fx, fy)) in [(0.5, 0.5), (0.3, 0.6), (0.75, 0.3), (0.15, 0.15)]
        .into_iter()
        .enumerate()
    {
        let pose = Pose {
            x_m: world.size_m() * fx,
            y_m: world.size_m() * fy,
            height_agl_m: 115.0,
            heading_deg: 0.0,
            ..Pose::default()
        };
        for season in [Season::Summer, Season::Winter] {
            let started = Instant::now();
            let photo = world.render_photo(&pose, &camera, &Look::drone(season));
            println!("photo {i} {season:?} {:?}", started.elapsed());
            photo
                .save(out.join(format!("photo{i}_{season:?}.png")))
                .expect("write");
        }
        let region = RegionM {
            x_min_m: pose.x_m - 80.0,
            y_min_m: pose.y_m - 60.0,
            width_m: 160.0,
            height_m: 120.0,
        };
        let started = Instant::now();
        let crop = world.render_map(region, 0.2, &Look::satellite(Season::Summer));
        println!("crop {i} {:?}", started.elapsed());
        crop.save(out.join(format!("photo{i}_map.png")))
            .expect("write");
    }
    files(&world, whole, &out);
}

/// A georeferenced map and four photos of a flight with their metadata.
fn files(world: &World, whole: RegionM, out: &std::path::Path) {
    let placement = Placement::at(15.2, 47.8).expect("a place in Styria");
    let started = Instant::now();
    let map = world.render_map(whole, 0.5, &Look::satellite(Season::Summer));
    let frame = MapFrame::new(whole, 0.5);
    let corner = placement.utm_from_world(frame.world_from_map_px([0.0, 0.0]));
    write_geotiff(&out.join("map.tif"), &map, 0.5, corner, placement.epsg()).expect("map.tif");
    println!("map.tif {:?}", started.elapsed());
    let camera = Camera {
        hfov_deg: 70.0,
        width_px: 1200,
        height_px: 900,
    };
    let mut rows = Vec::new();
    for (i, frame) in Flight::plan(world, 40, 1)
        .frames
        .iter()
        .step_by(10)
        .enumerate()
    {
        let name = format!("photo_{i:03}.jpg");
        let photo = world.render_photo(&frame.pose, &camera, &Look::drone(Season::Autumn));
        let tags = PhotoTags::for_pose(&frame.reported, &camera, &placement, 430.0).expect("tags");
        write_jpeg_with_exif(&out.join(&name), &photo, 92, &tags).expect("jpeg");
        rows.push(TruthRow::new(&name, &frame.pose, &camera, &placement).expect("truth"));
    }
    write_truth_csv(&out.join("truth.csv"), &rows).expect("truth.csv");
}
