//! Anti-aliased convex polygons and ellipses on a colour picture.

use image::RgbImage;

/// A square picture under construction; colours from 0 to 1, pixel centres at integers.
pub(super) struct Canvas {
    side: usize,
    pixels: Vec<[f32; 3]>,
}

impl Canvas {
    /// A picture of `side` x `side` pixels whose colours are a function of the position.
    pub(super) fn new(side: usize, colour: impl Fn([f32; 2]) -> [f32; 3]) -> Self {
        let at = |i: usize| colour([(i % side) as f32, (i / side) as f32]);
        Self {
            side,
            pixels: (0..side * side).map(at).collect(),
        }
    }

    /// Fills a convex polygon, given by its vertices in order, with an edge one pixel wide.
    pub(super) fn fill_convex(&mut self, vertices: &[[f64; 2]], colour: [f32; 3]) {
        let edges: Vec<([f64; 2], [f64; 2])> = vertices
            .iter()
            .copied()
            .zip(vertices.iter().copied().cycle().skip(1))
            .collect();
        let area: f64 = edges.iter().map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
        // A line's unit normal, away from the inside, and its distance from the origin.
        let lines: Vec<[f64; 3]> = edges
            .iter()
            .map(|(a, b)| {
                let along = [b[0] - a[0], b[1] - a[1]];
                let length = along[0].hypot(along[1]).max(1e-9) * area.signum();
                let normal = [along[1] / length, -along[0] / length];
                [normal[0], normal[1], normal[0] * a[0] + normal[1] * a[1]]
            })
            .collect();
        self.fill(bounds(vertices), colour, |[x, y]| {
            lines
                .iter()
                .map(|[nx, ny, d]| nx * x + ny * y - d)
                .fold(f64::MIN, f64::max)
        });
    }

    /// Fills an ellipse with half axes `axes`, turned by `angle` radians.
    pub(super) fn fill_ellipse(
        &mut self,
        centre: [f64; 2],
        axes: [f64; 2],
        angle: f64,
        colour: [f32; 3],
    ) {
        let reach = axes[0].max(axes[1]);
        let (sin, cos) = angle.sin_cos();
        let corners = [-reach, reach].map(|r| [centre[0] + r, centre[1] + r]);
        self.fill(bounds(&corners), colour, |[x, y]| {
            let (dx, dy) = (x - centre[0], y - centre[1]);
            let (u, v) = (
                (cos * dx + sin * dy) / axes[0],
                (cos * dy - sin * dx) / axes[1],
            );
            // The distance to first order: the level set's excess over its gradient.
            let radius = u.hypot(v);
            let gradient = (u / axes[0]).hypot(v / axes[1]).max(1e-9);
            radius * (radius - 1.0) / gradient
        });
    }

    /// Blends in a colour where `outside_px`, the signed distance from the shape (negative inside), is below half a pixel.
    fn fill(
        &mut self,
        [x0, y0, x1, y1]: [f64; 4],
        colour: [f32; 3],
        outside_px: impl Fn([f64; 2]) -> f64,
    ) {
        let last = self.side as f64 - 1.0;
        let range = |low: f64, high: f64| {
            (low - 1.0).clamp(0.0, last) as usize..=(high + 1.0).clamp(0.0, last) as usize
        };
        for y in range(y0, y1) {
            for x in range(x0, x1) {
                let share = (0.5 - outside_px([x as f64, y as f64])).clamp(0.0, 1.0) as f32;
                if share > 0.0 {
                    let pixel = &mut self.pixels[y * self.side + x];
                    for (value, new) in pixel.iter_mut().zip(colour) {
                        *value += share * (new - *value);
                    }
                }
            }
        }
    }

    /// The picture, rounded to bytes.
    pub(super) fn into_image(self) -> RgbImage {
        let bytes = self
            .pixels
            .as_flattened()
            .iter()
            .map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
            .collect();
        RgbImage::from_raw(self.side as u32, self.side as u32, bytes).unwrap_or_default()
    }
}

/// Left, top, right and bottom of some points.
fn bounds(points: &[[f64; 2]]) -> [f64; 4] {
    let start = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    points.iter().fold(start, |[x0, y0, x1, y1], [x, y]| {
        [x0.min(*x), y0.min(*y), x1.max(*x), y1.max(*y)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mass(canvas: &Canvas) -> f64 {
        canvas.pixels.iter().map(|p| f64::from(p[0])).sum()
    }

    #[test]
    fn shapes_cover_their_area_and_nothing_else() {
        let blank = || Canvas::new(60, |_| [0.0; 3]);
        let mut square = blank();
        let vertices = [[10.3, 12.0], [40.3, 16.0], [36.3, 46.0], [6.3, 42.0]];
        square.fill_convex(&vertices, [1.0; 3]);
        assert!((mass(&square) - 916.0).abs() < 4.0, "{}", mass(&square));
        let mut other_way = blank();
        let reversed: Vec<_> = vertices.into_iter().rev().collect();
        other_way.fill_convex(&reversed, [1.0; 3]);
        assert_eq!(square.pixels, other_way.pixels);
        let mut ellipse = blank();
        ellipse.fill_ellipse([30.0, 28.0], [20.0, 9.0], 0.7, [1.0; 3]);
        let area = std::f64::consts::PI * 20.0 * 9.0;
        assert!(
            (mass(&ellipse) / area - 1.0).abs() < 0.02,
            "{}",
            mass(&ellipse)
        );
    }
}
