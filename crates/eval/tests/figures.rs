//! Figures of errors show every frame where it belongs (figures 7a and 7b of the paper).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_eval::metrics::Frame;
use grimnet_eval::report::plot::{error_per_frame, runs_compared};

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
fn every_frame_of_every_run_is_drawn() {
    let (ours, theirs) = (
        frames(&[Some(1.0), None, Some(2.0), Some(900.0)]),
        frames(&[Some(40.0), Some(50.0), Some(60.0)]),
    );
    let svg = runs_compared(&[("ours", &ours), ("theirs", &theirs)]).unwrap();
    assert_eq!(circles_px(&svg).len(), 6);
    assert!(svg.contains("ours") && svg.contains("theirs"));
}
