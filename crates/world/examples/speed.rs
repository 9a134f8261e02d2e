//! Measures rendering: CPU-bound, so run it alone. `cargo run --release -p grimnet-world --example speed`
#![allow(clippy::print_stdout)]

use std::time::Instant;

use grimnet_world::{Camera, Look, Pose, RegionM, Season, World, WorldConfig};

fn main() {
    let started = Instant::now();
    let world = World::new(WorldConfig::default());
    println!(
        "world: {:?}, objects {:?}",
        started.elapsed(),
        world.object_counts()
    );
    let side = world.size_m();

    let started = Instant::now();
    let n = 36;
    let mut sum = 0_u64;
    for i in 0..n {
        let at = |k: usize| side * (0.05 + 0.8 * (k as f64 / 6.0));
        let region = RegionM {
            x_min_m: at(i % 6),
            y_min_m: at(i / 6),
            width_m: 76.8,
            height_m: 76.8,
        };
        let map = world.render_map(region, 0.3, &Look::satellite(Season::Summer));
        sum += u64::from(map.get_pixel(5, 5)[0]);
    }
    println!(
        "256 x 256 map crop at 0.3 m: {:?}",
        started.elapsed() / n as u32
    );

    let camera = Camera {
        hfov_deg: 70.0,
        width_px: 1024,
        height_px: 576,
    };
    let started = Instant::now();
    for i in 0..n {
        let at = |k: usize| side * (0.1 + 0.8 * (k as f64 / 5.0));
        let pose = Pose {
            x_m: at(i % 6),
            y_m: at(i / 6),
            heading_deg: 17.0 * i as f64,
            ..Pose::default()
        };
        let photo = world.render_photo(&pose, &camera, &Look::drone(Season::Summer));
        sum += u64::from(photo.get_pixel(5, 5)[0]);
    }
    println!(
        "1024 x 576 photo: {:?} (checksum {sum})",
        started.elapsed() / n as u32
    );
}
