//! Two numbers to the east and the north.

pub(super) fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn length([east, north]: [f64; 2]) -> f64 {
    east.hypot(north)
}
