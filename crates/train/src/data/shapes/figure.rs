//! Figures with known corners (DeTone et al. 2018, section 4.1 and figure 4), each drawn inside a disc.

use super::canvas::Canvas;
use crate::data::homography::{apply, from_corners};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

/// Least difference of brightness between the areas at a corner.
const LEAST_CONTRAST: f32 = 0.2;
/// Least side of a checkerboard's square or width of a stripe, pixels.
const LEAST_CELL_PX: f64 = 13.0;
/// Thickness of lines, pixels.
const LINE_PX: [f64; 2] = [2.0, 4.5];

/// A kind of figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Figure {
    /// Three corners.
    Triangle,
    /// Four.
    Quad,
    /// A line, with a corner at each end.
    Line,
    /// Lines from one point: corners at the point and at the ends.
    Star,
    /// Squares in perspective: corners where they meet, the outer edge included.
    Checkerboard,
    /// Bars side by side, in perspective: corners at their ends.
    Stripes,
    /// Three faces of a box: seven corners.
    Cube,
    /// An ellipse, which has no corner.
    Ellipse,
}

impl Figure {
    /// All kinds.
    pub(super) const ALL: [Self; 8] = [
        Self::Triangle,
        Self::Quad,
        Self::Line,
        Self::Star,
        Self::Checkerboard,
        Self::Stripes,
        Self::Cube,
        Self::Ellipse,
    ];

    /// Draws a random figure into a disc and returns its corners.
    pub(super) fn draw(self, canvas: &mut Canvas, brush: &mut Brush<'_>) -> Vec<[f64; 2]> {
        match self {
            Self::Triangle => brush.polygon(canvas, 3),
            Self::Quad => brush.polygon(canvas, 4),
            Self::Line => brush.line(canvas),
            Self::Star => brush.star(canvas),
            Self::Checkerboard => brush.checkerboard(canvas),
            Self::Stripes => brush.stripes(canvas),
            Self::Cube => brush.cube(canvas),
            Self::Ellipse => brush.ellipse(canvas),
        }
    }
}

/// The disc and the colours of a figure.
pub(super) struct Brush<'a> {
    /// Centre of the disc.
    pub(super) centre: [f64; 2],
    /// Radius of the disc, pixels.
    pub(super) radius_px: f64,
    /// Brightness of the background, 0 to 1.
    pub(super) ground: f32,
    pub(super) random: &'a mut ChaCha8Rng,
}

impl Brush<'_> {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.random.random_range(low..high)
    }

    /// The point of the disc at a share of its radius and an angle.
    fn polar(&self, share: f64, angle: f64) -> [f64; 2] {
        let (sin, cos) = angle.sin_cos();
        let r = share * self.radius_px;
        [self.centre[0] + r * cos, self.centre[1] + r * sin]
    }

    /// `count` colours whose brightness differs from the background and from each other.
    fn colours<const N: usize>(&mut self) -> [[f32; 3]; N] {
        let mut taken = vec![self.ground];
        std::array::from_fn(|_| {
            let mut best = (-1.0, 0.0);
            for _ in 0..30 {
                let tried: f32 = self.random.random();
                let contrast = taken
                    .iter()
                    .map(|v| (v - tried).abs())
                    .fold(1.0f32, f32::min);
                if contrast > best.0 {
                    best = (contrast, tried);
                }
                if contrast >= LEAST_CONTRAST {
                    break;
                }
            }
            let grey = best.1;
            taken.push(grey);
            let [red, blue] = [(); 2].map(|()| self.random.random_range(-0.05f32..0.05));
            [grey + red, grey - red - blue, grey + blue]
        })
    }

    /// A convex polygon of `n` points without very flat or very sharp angles: nearly equally spaced on a circle, which is
    /// scaled along a random axis by `least` to 1.
    fn ring(&mut self, n: usize, least: f64) -> Vec<[f64; 2]> {
        let step = TAU / n as f64;
        let start = self.between(0.0, TAU);
        let squeeze = self.between(least, 1.0);
        let (sin, cos) = self.between(0.0, PI).sin_cos();
        (0..n)
            .map(|i| {
                let angle = start + step * (i as f64 + self.between(-0.2, 0.2));
                let [x, y] = [angle.cos(), angle.sin()];
                let (u, v) = (cos * x + sin * y, squeeze * (cos * y - sin * x));
                [
                    self.centre[0] + self.radius_px * (cos * u - sin * v),
                    self.centre[1] + self.radius_px * (sin * u + cos * v),
                ]
            })
            .collect()
    }

    fn polygon(&mut self, canvas: &mut Canvas, n: usize) -> Vec<[f64; 2]> {
        let vertices = self.ring(n, 0.7);
        let [colour] = self.colours();
        canvas.fill_convex(&vertices, colour);
        vertices
    }

    fn line(&mut self, canvas: &mut Canvas) -> Vec<[f64; 2]> {
        let angle = self.between(0.0, PI);
        let ends = [self.polar(1.0, angle), self.polar(-1.0, angle)];
        let [colour] = self.colours();
        let width = self.between(LINE_PX[0], LINE_PX[1]);
        canvas.fill_convex(&thick_line(ends, width), colour);
        ends.into()
    }

    fn star(&mut self, canvas: &mut Canvas) -> Vec<[f64; 2]> {
        let rays = self.random.random_range(3..6);
        let mut corners = vec![self.centre];
        // Rays at small angles would separate far from the centre.
        corners.extend(self.ring(rays, 0.9));
        let [colour] = self.colours();
        let width = self.between(LINE_PX[0], LINE_PX[1]);
        for tip in &corners[1..] {
            canvas.fill_convex(&thick_line([self.centre, *tip], width), colour);
        }
        corners
    }

    /// The grid points of a random quadrangle, `[row][column]`: one more along each axis than there are squares.
    fn grid(&mut self, columns: &[f64], rows: &[f64]) -> Vec<Vec<[f64; 2]>> {
        let unit = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let ring = self.ring(4, 0.6);
        let Some(into) = from_corners(unit, [ring[0], ring[1], ring[2], ring[3]]) else {
            return Vec::new();
        };
        let row = |y: &f64| columns.iter().map(|x| apply(&into, [*x, *y])).collect();
        rows.iter().map(row).collect()
    }

    fn checkerboard(&mut self, canvas: &mut Canvas) -> Vec<[f64; 2]> {
        // The side of the quadrangle is about this share of the radius, or half of it after scaling.
        let most = ((self.radius_px * 0.8 / LEAST_CELL_PX) as usize).clamp(2, 6);
        let [across, down] = [(); 2].map(|()| self.random.random_range(2..=most));
        let grid = self.grid(&even(across), &even(down));
        let [light, dark] = self.colours();
        fill_outline(canvas, &grid, light);
        for (y, rows) in grid.windows(2).enumerate() {
            for x in (y % 2..across).step_by(2) {
                let square = [rows[0][x], rows[0][x + 1], rows[1][x + 1], rows[1][x]];
                canvas.fill_convex(&square, dark);
            }
        }
        grid.concat()
    }

    fn stripes(&mut self, canvas: &mut Canvas) -> Vec<[f64; 2]> {
        let most = ((self.radius_px * 0.8 / LEAST_CELL_PX) as usize).clamp(2, 7);
        let bars = self.random.random_range(2..=most);
        let step = 1.0 / bars as f64;
        let mut cuts = even(bars);
        for cut in &mut cuts[1..bars] {
            *cut += step * self.between(-0.2, 0.2);
        }
        let grid = self.grid(&cuts, &[0.0, 1.0]);
        let [light, dark] = self.colours();
        fill_outline(canvas, &grid, light);
        if let [top, bottom] = &grid[..] {
            for x in (0..bars).step_by(2) {
                let bar = [top[x], top[x + 1], bottom[x + 1], bottom[x]];
                canvas.fill_convex(&bar, dark);
            }
        }
        grid.concat()
    }

    fn cube(&mut self, canvas: &mut Canvas) -> Vec<[f64; 2]> {
        let start = self.between(0.0, TAU);
        // Both axes together do not exceed the disc.
        let axes: [[f64; 2]; 3] = std::array::from_fn(|i| {
            let angle = start + TAU / 3.0 * (i as f64 + self.between(-0.15, 0.15));
            let share = self.between(0.55, 0.75);
            let [x, y] = self.polar(share, angle);
            [x - self.centre[0], y - self.centre[1]]
        });
        let at = |which: &[usize]| {
            which
                .iter()
                .fold(self.centre, |[x, y], i| [x + axes[*i][0], y + axes[*i][1]])
        };
        let faces =
            [[0, 1], [1, 2], [2, 0]].map(|[a, b]| [at(&[]), at(&[a]), at(&[a, b]), at(&[b])]);
        let colours: [[f32; 3]; 3] = self.colours();
        for (face, colour) in faces.iter().zip(colours) {
            canvas.fill_convex(face, colour);
        }
        let [f, g, h] = faces;
        vec![f[0], f[1], f[2], f[3], g[2], g[3], h[2]]
    }

    fn ellipse(&mut self, canvas: &mut Canvas) -> Vec<[f64; 2]> {
        let axes = [self.radius_px, self.radius_px * self.between(0.4, 1.0)];
        let angle = self.between(0.0, PI);
        let [colour] = self.colours();
        canvas.fill_ellipse(self.centre, axes, angle, colour);
        Vec::new()
    }
}

/// Equally spaced values from 0 to 1.
fn even(steps: usize) -> Vec<f64> {
    (0..=steps).map(|i| i as f64 / steps as f64).collect()
}

/// A line as a quadrangle.
fn thick_line([a, b]: [[f64; 2]; 2], width: f64) -> [[f64; 2]; 4] {
    let along = [b[0] - a[0], b[1] - a[1]];
    let half = width / 2.0 / along[0].hypot(along[1]).max(1e-9);
    let side = [-along[1] * half, along[0] * half];
    [
        [a[0] + side[0], a[1] + side[1]],
        [b[0] + side[0], b[1] + side[1]],
        [b[0] - side[0], b[1] - side[1]],
        [a[0] - side[0], a[1] - side[1]],
    ]
}

/// Fills the quadrangle around a grid, so that no background is visible between its squares.
fn fill_outline(canvas: &mut Canvas, grid: &[Vec<[f64; 2]>], colour: [f32; 3]) {
    if let (Some([a, .., b]), Some([d, .., c])) = (
        grid.first().map(Vec::as_slice),
        grid.last().map(Vec::as_slice),
    ) {
        canvas.fill_convex(&[*a, *b, *c, *d], colour);
    }
}
