//! Cutting blocks into parcels.

use nalgebra::Vector2;

use super::builder::Builder;
use crate::convex::{Convex, left_of};

type V2 = Vector2<f32>;

/// Cuts a block into two rows of parcels back to back, each `frontage_m` wide (varied by `spread`).
pub(super) fn parcels_in_rows(
    builder: &mut Builder,
    outline: &Convex,
    frontage_m: f32,
    spread: f32,
) -> Vec<Convex> {
    let frame = outline.frame();
    let mut rows = Vec::new();
    if frame.width_m > (frontage_m * 1.4).max(27.0) {
        for side in [frame.along, -frame.along] {
            rows.extend(outline.clip_left(frame.centre, side, 0.0));
        }
    } else {
        rows.push(outline.clone());
    }
    let mut parcels = Vec::new();
    for row in rows {
        let f = row.frame_along(frame.along);
        let n = (f.length_m / frontage_m).round().max(1.0);
        let mut rest = row;
        let mut at = -f.length_m * 0.5;
        for i in 0..n as i32 {
            at += f.length_m / n * (1.0 + spread * builder.random.range(-1.0, 1.0));
            if i + 1 < n as i32 {
                let cut = f.centre + f.along * at;
                let dir = left_of(f.along);
                parcels.extend(rest.clip_left(cut, dir, 0.0));
                match rest.clip_left(cut, -dir, 0.0) {
                    Some(r) => rest = r,
                    None => break,
                }
            } else {
                parcels.push(rest.clone());
            }
        }
    }
    parcels
}

/// Middle and inward direction of the parcel's street side.
pub(super) fn front(parcel: &Convex) -> Option<(V2, V2)> {
    let i = parcel.front_edge()?;
    let (a, b) = (
        parcel.points[i],
        parcel.points[(i + 1) % parcel.points.len()],
    );
    Some(((a + b) * 0.5, left_of((b - a).normalize())))
}
