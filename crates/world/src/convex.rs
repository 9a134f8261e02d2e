//! Convex polygons whose edges know the road that runs along them.

use nalgebra::Vector2;

type V2 = Vector2<f32>;

#[inline]
pub(crate) fn cross(a: V2, b: V2) -> f32 {
    a.x * b.y - a.y * b.x
}

/// The direction turned left by a quarter.
#[inline]
pub(crate) fn left_of(d: V2) -> V2 {
    V2::new(-d.y, d.x)
}

/// Counter-clockwise convex polygon. `edge_half_width_m[i]` belongs to the edge from point i to
/// i + 1: half the width of the road whose centre line it is, pavements included; 0 for none.
#[derive(Clone, Debug)]
pub(crate) struct Convex {
    pub(crate) points: Vec<V2>,
    pub(crate) edge_half_width_m: Vec<f32>,
}

/// Axis-aligned size of a polygon in a rotated frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// Unit vector of the long side.
    pub(crate) along: V2,
    pub(crate) centre: V2,
    pub(crate) length_m: f32,
    pub(crate) width_m: f32,
}

impl Convex {
    pub(crate) fn rectangle(low: V2, high: V2) -> Self {
        Self {
            points: vec![low, V2::new(high.x, low.y), high, V2::new(low.x, high.y)],
            edge_half_width_m: vec![0.0; 4],
        }
    }

    /// Keeps the part left of the line through `origin` along `dir`; the new edge gets
    /// `half_width_m`. `None` if nothing is left.
    pub(crate) fn clip_left(&self, origin: V2, dir: V2, half_width_m: f32) -> Option<Self> {
        let n = self.points.len();
        let mut points = Vec::with_capacity(n + 1);
        let mut widths = Vec::with_capacity(n + 1);
        for i in 0..n {
            let (a, b) = (self.points[i], self.points[(i + 1) % n]);
            let (da, db) = (cross(dir, a - origin), cross(dir, b - origin));
            if da >= 0.0 {
                points.push(a);
                widths.push(self.edge_half_width_m[i]);
                if db < 0.0 {
                    points.push(a + (b - a) * (da / (da - db)));
                    widths.push(half_width_m);
                }
            } else if db >= 0.0 {
                points.push(a + (b - a) * (da / (da - db)));
                widths.push(self.edge_half_width_m[i]);
            }
        }
        let out = Self {
            points,
            edge_half_width_m: widths,
        };
        (out.points.len() >= 3 && out.area_m2() > 1e-3).then_some(out)
    }

    /// Where the line through `origin` along `dir` enters and leaves, with the half widths of the
    /// roads met there.
    pub(crate) fn chord(&self, origin: V2, dir: V2) -> Option<[(V2, f32); 2]> {
        let n = self.points.len();
        let mut enter: Option<(f32, f32)> = None;
        let mut leave: Option<(f32, f32)> = None;
        for i in 0..n {
            let (a, b) = (self.points[i], self.points[(i + 1) % n]);
            let (da, db) = (cross(dir, a - origin), cross(dir, b - origin));
            if (da >= 0.0) == (db >= 0.0) {
                continue;
            }
            let t = dir.dot(&(a + (b - a) * (da / (da - db)) - origin));
            let end = (t, self.edge_half_width_m[i]);
            if enter.is_none_or(|e| t < e.0) {
                enter = Some(end);
            }
            if leave.is_none_or(|l| t > l.0) {
                leave = Some(end);
            }
        }
        let ((t0, w0), (t1, w1)) = (enter?, leave?);
        (t1 - t0 > 1.0).then(|| [(origin + dir * t0, w0), (origin + dir * t1, w1)])
    }

    /// Moves each edge inwards by its road's half width plus `extra_m`.
    pub(crate) fn inset(&self, extra_m: f32) -> Option<Self> {
        let n = self.points.len();
        let mut out = self.clone();
        for i in 0..n {
            let (a, b) = (self.points[i], self.points[(i + 1) % n]);
            let Some(dir) = (b - a).try_normalize(1e-4) else {
                continue;
            };
            let width = self.edge_half_width_m[i];
            out = out.clip_left(a + left_of(dir) * (width + extra_m), dir, width)?;
        }
        Some(out)
    }

    pub(crate) fn area_m2(&self) -> f32 {
        let n = self.points.len();
        (0..n)
            .map(|i| cross(self.points[i], self.points[(i + 1) % n]))
            .sum::<f32>()
            * 0.5
    }

    /// Least distance to an edge, negative outside.
    pub(crate) fn depth(&self, p: V2) -> f32 {
        let n = self.points.len();
        let mut least = f32::INFINITY;
        for i in 0..n {
            let (a, b) = (
                self.points[i],
                self.points[if i + 1 == n { 0 } else { i + 1 }],
            );
            let e = b - a;
            least = least.min(cross(e, p - a) / e.norm());
        }
        least
    }

    /// The edges as half planes, for fast depth.
    pub(crate) fn half_planes(&self) -> HalfPlanes {
        let n = self.points.len();
        let planes = (0..n).filter_map(|i| {
            let a = self.points[i];
            let inward = left_of((self.points[(i + 1) % n] - a).try_normalize(1e-5)?);
            Some([inward.x, inward.y, -inward.dot(&a)])
        });
        HalfPlanes(planes.collect())
    }

    pub(crate) fn bounds(&self) -> (V2, V2) {
        self.points.iter().fold(
            (V2::repeat(f32::INFINITY), V2::repeat(f32::NEG_INFINITY)),
            |(low, high), p| (low.inf(p), high.sup(p)),
        )
    }

    /// The smallest enclosing rectangle with a side along one of the edges.
    pub(crate) fn frame(&self) -> Frame {
        let n = self.points.len();
        let mut best: Option<(f32, Frame)> = None;
        for i in 0..n {
            let Some(dir) = (self.points[(i + 1) % n] - self.points[i]).try_normalize(1e-3) else {
                continue;
            };
            let frame = self.frame_along(dir);
            let area = frame.length_m * frame.width_m;
            if best.as_ref().is_none_or(|(least, _)| area < *least) {
                best = Some((area, frame));
            }
        }
        let frame = best.map_or_else(|| self.frame_along(V2::x()), |(_, f)| f);
        if frame.width_m > frame.length_m {
            Frame {
                along: left_of(frame.along),
                length_m: frame.width_m,
                width_m: frame.length_m,
                ..frame
            }
        } else {
            frame
        }
    }

    /// The enclosing rectangle with `length_m` measured along `dir`.
    pub(crate) fn frame_along(&self, dir: V2) -> Frame {
        let across = left_of(dir);
        let (low, high) = self.points.iter().fold(
            (V2::repeat(f32::INFINITY), V2::repeat(f32::NEG_INFINITY)),
            |(low, high), p| {
                let q = V2::new(p.dot(&dir), p.dot(&across));
                (low.inf(&q), high.sup(&q))
            },
        );
        let mid = (low + high) * 0.5;
        Frame {
            along: dir,
            centre: dir * mid.x + across * mid.y,
            length_m: high.x - low.x,
            width_m: high.y - low.y,
        }
    }

    /// The edge along the widest road (index), if any road touches.
    pub(crate) fn front_edge(&self) -> Option<usize> {
        let n = self.points.len();
        (0..n)
            .filter(|&i| self.edge_half_width_m[i] > 0.0)
            .filter(|&i| (self.points[(i + 1) % n] - self.points[i]).norm() > 3.0)
            .max_by(|&i, &j| self.edge_half_width_m[i].total_cmp(&self.edge_half_width_m[j]))
    }
}

/// A convex polygon as half planes `x a + y b + c >= 0` with unit normals.
#[derive(Clone, Debug)]
pub(crate) struct HalfPlanes(Vec<[f32; 3]>);

impl HalfPlanes {
    /// Least distance to an edge, negative outside.
    #[inline]
    pub(crate) fn depth(&self, p: V2) -> f32 {
        self.0.iter().fold(f32::INFINITY, |least, [a, b, c]| {
            least.min(a * p.x + b * p.y + c)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(side: f32) -> Convex {
        Convex::rectangle(V2::zeros(), V2::repeat(side))
    }

    #[test]
    fn splitting_keeps_the_area() {
        let whole = square(10.0);
        let (origin, dir) = (V2::new(4.0, 5.0), V2::new(0.3, 1.0).normalize());
        let left = whole.clip_left(origin, dir, 2.0).unwrap();
        let right = whole.clip_left(origin, -dir, 2.0).unwrap();
        assert!((left.area_m2() + right.area_m2() - 100.0).abs() < 1e-3);
        assert!(left.edge_half_width_m.contains(&2.0));
        let [a, b] = whole.chord(origin, dir).unwrap();
        assert!((b.0 - a.0).normalize().dot(&dir) > 0.999);
    }

    #[test]
    fn inset_uses_each_edges_road() {
        let mut block = square(20.0);
        block.edge_half_width_m = vec![5.0, 0.0, 0.0, 0.0];
        let inner = block.inset(1.0).unwrap();
        assert!((inner.area_m2() - 18.0 * 13.0).abs() < 1e-3);
        assert!((block.depth(V2::new(10.0, 3.0)) - 3.0).abs() < 1e-5);
        assert!(square(4.0).inset(2.1).is_none());
    }
}
