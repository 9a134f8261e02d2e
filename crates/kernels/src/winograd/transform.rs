//! The linear maps of Winograd's F(4x4, 3x3) on vectors of channels.
//!
//! The construction is that of Lavin & Gray (2016), with the points 0, ±1/√2, ±√2 and ∞ instead of 0, ±1, ±2 and ∞: the
//! coefficients are of similar magnitude, so fewer digits are lost at the same cost.

use crate::simd::Simd;

/// Side of an output tile.
pub(crate) const TILE: usize = 4;
/// Side of the input window that a tile depends on.
pub(crate) const WINDOW: usize = TILE + 2;
/// Points of the transformed tile: the number of matrix products.
pub(crate) const POINTS: usize = WINDOW * WINDOW;

/// The two pairs of points, `±A` and `±B`.
const A: f32 = std::f32::consts::FRAC_1_SQRT_2;
const B: f32 = std::f32::consts::SQRT_2;

/// `B^T d`
#[inline(always)]
fn input_line<S: Simd>(s: S, d: [S::V; 6]) -> [S::V; 6] {
    let (a, b) = (s.splat(A), s.splat(B));
    let (half, two, middle) = (s.splat(0.5), s.splat(2.0), s.splat(2.5));
    let (even_a, odd_a) = (
        s.neg_mul_add(two, d[2], d[4]),
        s.neg_mul_add(two, d[1], d[3]),
    );
    let (even_b, odd_b) = (
        s.neg_mul_add(half, d[2], d[4]),
        s.neg_mul_add(half, d[1], d[3]),
    );
    [
        s.add(d[0], s.neg_mul_add(middle, d[2], d[4])),
        s.mul_add(a, odd_a, even_a),
        s.neg_mul_add(a, odd_a, even_a),
        s.mul_add(b, odd_b, even_b),
        s.neg_mul_add(b, odd_b, even_b),
        s.add(d[1], s.neg_mul_add(middle, d[3], d[5])),
    ]
}

/// `A^T m`
#[inline(always)]
fn output_line<S: Simd>(s: S, m: [S::V; 6]) -> [S::V; 4] {
    let (sum_a, difference_a) = (s.add(m[1], m[2]), s.sub(m[1], m[2]));
    let (sum_b, difference_b) = (s.add(m[3], m[4]), s.sub(m[3], m[4]));
    [
        s.add(m[0], s.add(sum_a, sum_b)),
        s.mul_add(s.splat(A), difference_a, s.mul(s.splat(B), difference_b)),
        s.mul_add(s.splat(0.5), sum_a, s.mul(s.splat(2.0), sum_b)),
        s.mul_add(
            s.splat(0.5 * A),
            difference_a,
            s.mul_add(s.splat(2.0 * B), difference_b, m[5]),
        ),
    ]
}

/// `A y`, the transpose of [`output_line`].
#[inline(always)]
fn output_gradient_line<S: Simd>(s: S, y: [S::V; 4]) -> [S::V; 6] {
    let (a, b, half, two) = (s.splat(A), s.splat(B), s.splat(0.5), s.splat(2.0));
    let (even_a, odd_a) = (s.mul_add(half, y[2], y[0]), s.mul_add(half, y[3], y[1]));
    let (even_b, odd_b) = (s.mul_add(two, y[2], y[0]), s.mul_add(two, y[3], y[1]));
    [
        y[0],
        s.mul_add(a, odd_a, even_a),
        s.neg_mul_add(a, odd_a, even_a),
        s.mul_add(b, odd_b, even_b),
        s.neg_mul_add(b, odd_b, even_b),
        y[3],
    ]
}

/// `G g`
#[inline(always)]
fn weight_line<S: Simd>(s: S, g: [S::V; 3]) -> [S::V; 6] {
    let (third, sixth) = (s.splat(1.0 / 3.0), s.splat(1.0 / 6.0));
    let even_a = s.mul(s.splat(-2.0 / 3.0), s.mul_add(s.splat(0.5), g[2], g[0]));
    let even_b = s.mul_add(third, g[2], s.mul(sixth, g[0]));
    let (odd_a, odd_b) = (s.splat(2.0 / 3.0 * A), s.splat(B / 6.0));
    [
        g[0],
        s.neg_mul_add(odd_a, g[1], even_a),
        s.mul_add(odd_a, g[1], even_a),
        s.mul_add(odd_b, g[1], even_b),
        s.neg_mul_add(odd_b, g[1], even_b),
        g[2],
    ]
}

/// `G^T u`, the transpose of [`weight_line`].
#[inline(always)]
fn weight_gradient_line<S: Simd>(s: S, u: [S::V; 6]) -> [S::V; 3] {
    let (sum_a, difference_a) = (s.add(u[1], u[2]), s.sub(u[2], u[1]));
    let (sum_b, difference_b) = (s.add(u[3], u[4]), s.sub(u[3], u[4]));
    [
        s.neg_mul_add(
            s.splat(2.0 / 3.0),
            sum_a,
            s.mul_add(s.splat(1.0 / 6.0), sum_b, u[0]),
        ),
        s.mul_add(
            s.splat(2.0 / 3.0 * A),
            difference_a,
            s.mul(s.splat(B / 6.0), difference_b),
        ),
        s.mul_add(s.splat(1.0 / 3.0), s.sub(sum_b, sum_a), u[5]),
    ]
}

/// Applies a one-dimensional map to the columns and then to the rows: `load(row, column)` of an `N x N` square,
/// `store(row, column, value)` of an `M x M` square.
macro_rules! both_ways {
    ($line:ident, $n:literal -> $m:literal, $simd:ident, $load:expr, $store:expr) => {{
        let mut half = [[$simd.zero(); $n]; $m];
        for column in 0..$n {
            let line = $line(
                $simd,
                std::array::from_fn::<_, $n, _>(|row| $load(row, column)),
            );
            for row in 0..$m {
                half[row][column] = line[row];
            }
        }
        for (row, half) in half.into_iter().enumerate() {
            for (column, value) in $line($simd, half).into_iter().enumerate() {
                $store(row, column, value);
            }
        }
    }};
}

/// `B^T d B` of a 6x6 window; `store` gets the point and its value.
#[inline(always)]
pub(crate) fn input<S: Simd>(
    s: S,
    load: impl Fn(usize, usize) -> S::V,
    store: impl Fn(usize, S::V),
) {
    both_ways!(input_line, 6 -> 6, s, load, |row, column, value| store(row * WINDOW + column, value));
}

/// `A^T m A`: a 4x4 tile from its points.
#[inline(always)]
pub(crate) fn output<S: Simd>(
    s: S,
    load: impl Fn(usize) -> S::V,
    store: impl Fn(usize, usize, S::V),
) {
    both_ways!(output_line, 6 -> 4, s, |row, column| load(row * WINDOW + column), store);
}

/// `A y A^T`: the gradient at the points from that of a 4x4 tile.
#[inline(always)]
pub(crate) fn output_gradient<S: Simd>(
    s: S,
    load: impl Fn(usize, usize) -> S::V,
    store: impl Fn(usize, S::V),
) {
    both_ways!(output_gradient_line, 4 -> 6, s, load, |row, column, value| store(row * WINDOW + column, value));
}

/// `G g G^T` of a 3x3 kernel; `load` gets the tap.
#[inline(always)]
pub(crate) fn weight<S: Simd>(s: S, load: impl Fn(usize) -> S::V, store: impl Fn(usize, S::V)) {
    both_ways!(weight_line, 3 -> 6, s, |row, column| load(row * 3 + column), |row, column, value| store(
        row * WINDOW + column,
        value
    ));
}

/// `G^T u G`: the gradient of a 3x3 kernel from that of its points.
#[inline(always)]
pub(crate) fn weight_gradient<S: Simd>(
    s: S,
    load: impl Fn(usize) -> S::V,
    store: impl Fn(usize, S::V),
) {
    both_ways!(weight_gradient_line, 6 -> 3, s, |row, column| load(row * WINDOW + column), |row, column, value| store(
        row * 3 + column,
        value
    ));
}
