//! Figures of errors show every frame where it belongs (figures 7a and 7b of the paper).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_eval::metrics::Frame;
use grimnet_eval::report::plot::{error_per_frame, risk_coverage, runs_compared};

fn frames(errors_m: &[Option<f64>]) -> Vec<Frame> {
    errors_m
        .iter()
        .map(|&error_m| Frame {
            error_m,
            ..Frame::default()
        })
        .collect()
}

/// Heights of the circles, pixels from the top.
fn circles_px(svg: &str) -> Vec<f64> {
    svg.split("<circle")
        .skip(1)
        .map(|circle| {
            let from = circle.split("cy=\"").nth(1).unwrap();
            from.split('"').next().unwrap().parse().unwrap()
        })
        .collect()
}

#[test]
fn an_error_of_hundreds_of_metres_is_drawn_where_it_belongs() {
    let svg = error_per_frame(&frames(&[Some(3.0), Some(250.0), None, Some(500.0)])).unwrap();
    let [near, half, far] = circles_px(&svg)[..] else {
        panic!("three errors: {svg}");
    };
    assert!((half - (near * 250.0 + far * 247.0) / 497.0).abs() < 2.0);
    assert!(near - far > 100.0, "{near} and {far} px from the top");
}

#[test]
fn errors_of_a_good_flight_fill_the_figure() {
    let svg = error_per_frame(&frames(&[Some(0.5), Some(4.5)])).unwrap();
    let [near, far] = circles_px(&svg)[..] else {
        panic!("two errors: {svg}");
    };
    assert!(near - far > 150.0, "{near} and {far} px from the top");
}

#[test]
fn every_frame_of_every_run_is_drawn() {
    let (ours, theirs) = (
        frames(&[Some(1.0), None, Some(2.0), Some(900.0)]),
        frames(&[Some(40.0), Some(50.0), Some(60.0)]),
    );
    let svg = runs_compared(&[("ours", &ours), ("theirs", &theirs)]).unwrap();
    assert_eq!(circles_px(&svg).len(), 6);
    assert!(svg.contains("ours") && svg.contains("theirs"));
}

#[test]
fn a_share_of_failures_above_a_fifth_is_drawn_where_it_belongs() {
    let all = frames(&[Some(50.0), Some(60.0)]);
    let half = frames(&[Some(1.0), Some(50.0)]);
    let svg = risk_coverage(&[("all", &all), ("half", &half)]).unwrap();
    let ends_px: Vec<f64> = svg
        .split("<polyline")
        .filter(|line| line.contains("stroke-width=\"2\""))
        .filter_map(|line| line.split("points=\"").nth(1)?.split('"').next())
        .filter_map(|points| points.split_whitespace().last()?.split(',').nth(1))
        .filter_map(|y| y.parse().ok())
        .collect();
    let [all_px, half_px] = ends_px[..] else {
        panic!("two lines: {svg}");
    };
    assert!(
        half_px - all_px > 100.0,
        "{all_px} and {half_px} px from the top"
    );
}
