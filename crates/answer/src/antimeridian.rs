//! Shapes that cross the antimeridian, in longitude and latitude, degrees.

use crate::rounding::rounded;

/// The meridian where longitudes jump: this, and its negative.
const ANTIMERIDIAN_DEG: f64 = 180.0;

/// A longitude on the same side of the antimeridian as another: with it a shape goes on beyond 180 or -180 degrees.
pub(crate) fn beside(lon_deg: f64, other_deg: f64) -> f64 {
    lon_deg - 360.0 * ((lon_deg - other_deg) / 360.0).round()
}

/// The line cut where it crosses the antimeridian (RFC 7946, 3.1.9), for longitudes from -180 to 180. Pieces without the two points of a
/// line are left out.
pub(crate) fn cut_line(line: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
    let mut pieces = Vec::new();
    let mut piece: Vec<[f64; 2]> = Vec::new();
    for &[lon, lat] in line {
        let [lon_before, lat_before] = piece.last().copied().unwrap_or([lon, lat]);
        let there = beside(lon, lon_before);
        if there.abs() <= ANTIMERIDIAN_DEG {
            piece.push([there, lat]);
            continue;
        }
        let edge = ANTIMERIDIAN_DEG.copysign(there);
        let crossing = crossing([lon_before, lat_before], [there, lat], edge);
        if lon_before != edge {
            piece.push(crossing);
        }
        pieces.push(std::mem::take(&mut piece));
        piece.extend([[-edge, crossing[1]], [lon, lat]]);
    }
    pieces.push(piece);
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

/// A ring (not closed, of convex shape, its longitudes [`beside`] each other) cut at the antimeridian (RFC 7946, 3.1.9): one ring, or two
/// with longitudes from -180 to 180. The order of the points stays.
pub(crate) fn cut_ring(ring: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
    let turned = [0.0, -360.0, 360.0].map(|turn_deg| {
        let turned: Vec<[f64; 2]> = ring
            .iter()
            .map(|&[lon, lat]| [rounded(lon + turn_deg, 8), lat])
            .collect();
        clipped(&clipped(&turned, -ANTIMERIDIAN_DEG), ANTIMERIDIAN_DEG)
    });
    let pieces = turned.into_iter();
    pieces.filter(|piece| piece.len() > 2).collect()
}

/// The part of a ring between a meridian and the prime meridian's side of it (Sutherland and Hodgman 1974). Of a ring that only touches
/// the meridian from beyond, the points that touch it are left.
fn clipped(ring: &[[f64; 2]], meridian_deg: f64) -> Vec<[f64; 2]> {
    let inward = |[lon, _]: [f64; 2]| (meridian_deg - lon) * meridian_deg.signum();
    let mut kept = Vec::with_capacity(ring.len() + 2);
    for (&here, &next) in ring.iter().zip(ring.iter().cycle().skip(1)) {
        if inward(here) >= 0.0 {
            kept.push(here);
        }
        if inward(here) * inward(next) < 0.0 {
            kept.push(crossing(here, next, meridian_deg));
        }
    }
    kept
}

/// Where the line between two points on either side of a meridian crosses it.
fn crossing(from: [f64; 2], to: [f64; 2], meridian_deg: f64) -> [f64; 2] {
    let share = (meridian_deg - from[0]) / (to[0] - from[0]);
    [
        meridian_deg,
        rounded(from[1] + share * (to[1] - from[1]), 8),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_cut_where_they_cross() {
        assert_eq!(
            cut_line(&[[179.0, 1.0], [-178.0, 4.0], [-179.0, 4.0], [179.0, 8.0]]),
            [
                vec![[179.0, 1.0], [180.0, 2.0]],
                vec![[-180.0, 2.0], [-178.0, 4.0], [-179.0, 4.0], [-180.0, 6.0]],
                vec![[180.0, 6.0], [179.0, 8.0]],
            ]
        );
        let whole = [[120.0, 1.0], [-50.0, 2.0], [-120.0, 2.0]];
        assert_eq!(cut_line(&whole), [whole]);
    }

    #[test]
    fn points_on_the_antimeridian_are_the_ends_of_pieces() {
        assert_eq!(
            cut_line(&[[179.0, 1.0], [180.0, 2.0], [-179.0, 3.0]]),
            [[[179.0, 1.0], [180.0, 2.0]], [[-180.0, 2.0], [-179.0, 3.0]]]
        );
        // Its other name, and back: nothing is crossed.
        assert_eq!(
            cut_line(&[[179.0, 1.0], [-180.0, 2.0], [179.0, 3.0]]),
            [[[179.0, 1.0], [180.0, 2.0], [179.0, 3.0]]]
        );
        assert_eq!(
            cut_line(&[[180.0, 1.0], [-179.0, 2.0]]),
            [[[-180.0, 1.0], [-179.0, 2.0]]]
        );
        assert!(cut_line(&[[180.0, 1.0]]).is_empty() && cut_line(&[]).is_empty());
    }

    #[test]
    fn rings_are_cut_in_two() {
        // West of the antimeridian, and east of it.
        for turn_deg in [0.0, -360.0] {
            let ring = [[179.0, 0.0], [181.0, 0.0], [182.0, 3.0], [179.0, 3.0]];
            let pieces = cut_ring(&ring.map(|[lon, lat]| [lon + turn_deg, lat]));
            let west = vec![[179.0, 0.0], [180.0, 0.0], [180.0, 3.0], [179.0, 3.0]];
            let east = vec![[-180.0, 0.0], [-179.0, 0.0], [-178.0, 3.0], [-180.0, 3.0]];
            let expected = if turn_deg == 0.0 {
                [west, east]
            } else {
                [east, west]
            };
            assert_eq!(pieces, expected, "{turn_deg}");
        }
    }

    #[test]
    fn rings_that_do_not_cross_stay_as_they_are() {
        for ring in [
            [[120.0, 0.0], [121.0, 0.0], [121.0, 1.0]],
            [[179.0, 0.0], [180.0, 0.0], [180.0, 1.0]],
            [[-180.0, 0.0], [-179.0, 0.0], [-180.0, 1.0]],
            [[-180.0, 0.0], [-179.0, 0.0], [-179.0, 1.0]],
        ] {
            assert_eq!(cut_ring(&ring), [ring]);
        }
        assert!(cut_ring(&[[1.0, 2.0], [2.0, 2.0]]).is_empty());
    }
}
