//! The smooth, area-preserving warp from the straight-lined layout to the world.

use nalgebra::Vector2;

use crate::random::Stream;

type V2 = Vector2<f32>;

const NODE_STEP_M: f32 = 8.0;

/// Displacement `layout = world + d(world)`, a sum of transverse waves (so divergence-free: areas
/// and thus road widths are nearly kept), tabulated on nodes 8 m apart.
#[derive(Debug)]
pub(crate) struct Warp {
    origin: f32,
    side: usize,
    nodes: Vec<V2>,
}

impl Warp {
    /// Covers the square from `low` to `high` along both axes, in metres. `strength` is about the
    /// largest bend in radians of one wave.
    pub(crate) fn new(low: f32, high: f32, strength: f32, random: &mut Stream) -> Self {
        let waves: Vec<(V2, V2, f32)> = [220.0, 330.0, 480.0, 700.0, 1000.0]
            .iter()
            .map(|&base| {
                let wavelength = base * random.range(0.85, 1.2);
                let angle = random.range(0.0, std::f32::consts::TAU);
                let k = V2::new(angle.cos(), angle.sin()) * (std::f32::consts::TAU / wavelength);
                let amplitude = strength * random.range(0.5, 1.0) / k.norm();
                let across = V2::new(-angle.sin(), angle.cos()) * amplitude;
                (k, across, random.range(0.0, std::f32::consts::TAU))
            })
            .collect();
        let side = ((high - low) / NODE_STEP_M).ceil() as usize + 2;
        let mut nodes = Vec::with_capacity(side * side);
        for y in 0..side {
            for x in 0..side {
                let p = V2::new(low + x as f32 * NODE_STEP_M, low + y as f32 * NODE_STEP_M);
                let d = waves.iter().fold(V2::zeros(), |sum, (k, across, phase)| {
                    sum + across * (k.dot(&p) + phase).sin()
                });
                nodes.push(d);
            }
        }
        Self {
            origin: low,
            side,
            nodes,
        }
    }

    fn displacement(&self, p: V2) -> V2 {
        let last = (self.side - 2) as f32;
        let gx = ((p.x - self.origin) * (1.0 / NODE_STEP_M)).clamp(0.0, last);
        let gy = ((p.y - self.origin) * (1.0 / NODE_STEP_M)).clamp(0.0, last);
        let (ix, iy) = (gx as usize, gy as usize);
        let (u, v) = (gx - ix as f32, gy - iy as f32);
        let i = iy * self.side + ix;
        let n = &self.nodes;
        let top = n[i] + (n[i + 1] - n[i]) * u;
        let bottom = n[i + self.side] + (n[i + self.side + 1] - n[i + self.side]) * u;
        top + (bottom - top) * v
    }

    #[inline]
    pub(crate) fn layout_from_world(&self, p: V2) -> V2 {
        p + self.displacement(p)
    }

    /// Inverse by fixed-point iteration; converges since the displacement's gradient is below 1.
    pub(crate) fn world_from_layout(&self, q: V2) -> V2 {
        let mut p = q;
        for _ in 0..24 {
            p = q - self.displacement(p);
        }
        p
    }

    /// The world direction (unit) of the layout direction `dir` at layout point `q`.
    pub(crate) fn world_direction(&self, q: V2, dir: V2) -> V2 {
        let step = dir * 2.0;
        (self.world_from_layout(q + step) - self.world_from_layout(q - step)).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes_the_warp() {
        let warp = Warp::new(-100.0, 900.0, 0.12, &mut Stream::new(3));
        for i in 0..200 {
            let p = V2::new((i * 37 % 800) as f32, (i * 91 % 800) as f32 + 0.3);
            let back = warp.world_from_layout(warp.layout_from_world(p));
            assert!((back - p).norm() < 0.01, "{p} {back}");
        }
    }
}
