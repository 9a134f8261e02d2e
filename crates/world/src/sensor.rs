//! From radiance to the stored picture: point spread, tones, local contrast, noise, JPEG.

use image::{ExtendedColorType, RgbImage};

use crate::colour::Rgb;
use crate::look::SensorModel;
use crate::random::{hash_cell, hash2, unit};

/// A piece of a picture in linear colours.
#[derive(Clone, Debug)]
pub(crate) struct Linear {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<Rgb>,
}

fn gaussian(sigma: f32) -> Vec<f32> {
    let reach = (sigma * 2.6).ceil() as i32;
    let raw: Vec<f32> = (-reach..=reach)
        .map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp())
        .collect();
    let sum: f32 = raw.iter().sum();
    raw.into_iter().map(|w| w / sum).collect()
}

impl Linear {
    /// Separable Gaussian; the border is repeated.
    pub(crate) fn blurred(&self, sigma: f32) -> Self {
        if sigma < 0.2 {
            return self.clone();
        }
        let kernel = gaussian(sigma);
        let reach = kernel.len() / 2;
        let (w, h) = (self.width, self.height);
        let mut rows = vec![Rgb::default(); w * h];
        for y in 0..h {
            let line = &self.pixels[y * w..(y + 1) * w];
            for x in 0..w {
                let mut sum = Rgb::default();
                for (k, weight) in kernel.iter().enumerate() {
                    let i = (x + k).saturating_sub(reach).min(w - 1);
                    sum += line[i] * *weight;
                }
                rows[y * w + x] = sum;
            }
        }
        let mut out = vec![Rgb::default(); w * h];
        for y in 0..h {
            let target = &mut out[y * w..(y + 1) * w];
            for (k, weight) in kernel.iter().enumerate() {
                let i = (y + k).saturating_sub(reach).min(h - 1);
                for (t, s) in target.iter_mut().zip(&rows[i * w..(i + 1) * w]) {
                    *t += *s * *weight;
                }
            }
        }
        Self {
            width: w,
            height: h,
            pixels: out,
        }
    }

    /// The sensor's point spread and sharpening.
    pub(crate) fn through_optics(&self, sensor: &SensorModel) -> Self {
        let mut soft = self.blurred(sensor.blur_px);
        if sensor.sharpen > 0.01 {
            let softer = soft.blurred(1.0);
            for (a, b) in soft.pixels.iter_mut().zip(&softer.pixels) {
                *a = Rgb([0, 1, 2].map(|i| (a.0[i] + sensor.sharpen * (a.0[i] - b.0[i])).max(0.0)));
            }
        }
        soft
    }
}

/// Pixels around a piece that its optics need.
pub(crate) fn halo_px(sensor: &SensorModel) -> usize {
    let blur = if sensor.blur_px < 0.2 {
        0
    } else {
        (sensor.blur_px * 2.6).ceil() as usize
    };
    blur + if sensor.sharpen > 0.01 { 3 } else { 0 }
}

/// Local mean and deviation of display luminance on a coarse grid, for equalisation.
#[derive(Clone, Debug)]
pub(crate) struct LocalTones {
    /// Picture position of node (0, 0) and distance between nodes, pixels.
    origin_px: [f32; 2],
    step_px: f32,
    width: usize,
    height: usize,
    nodes: Vec<[f32; 2]>,
}

impl LocalTones {
    /// From luminances sampled at the nodes (row-major); each node gathers `reach` nodes each way.
    pub(crate) fn new(
        origin_px: [f32; 2],
        step_px: f32,
        width: usize,
        height: usize,
        luminance: &[f32],
        reach: usize,
    ) -> Self {
        let box_sum = |values: &[f32]| -> Vec<f32> {
            let mut rows = vec![0.0; width * height];
            for y in 0..height {
                for x in 0..width {
                    let (a, b) = (x.saturating_sub(reach), (x + reach).min(width - 1));
                    rows[y * width + x] = values[y * width + a..=y * width + b].iter().sum::<f32>();
                }
            }
            let mut out = vec![0.0; width * height];
            for y in 0..height {
                let (a, b) = (y.saturating_sub(reach), (y + reach).min(height - 1));
                for x in 0..width {
                    out[y * width + x] = (a..=b).map(|r| rows[r * width + x]).sum();
                }
            }
            out
        };
        let ones = box_sum(&vec![1.0; width * height]);
        let sums = box_sum(luminance);
        let squares = box_sum(&luminance.iter().map(|v| v * v).collect::<Vec<_>>());
        let nodes = (0..width * height)
            .map(|i| {
                let mean = sums[i] / ones[i];
                [mean, (squares[i] / ones[i] - mean * mean).max(0.0).sqrt()]
            })
            .collect();
        Self {
            origin_px,
            step_px,
            width,
            height,
            nodes,
        }
    }

    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        let gx =
            ((x - self.origin_px[0]) / self.step_px).clamp(0.0, (self.width - 1) as f32 - 1e-3);
        let gy =
            ((y - self.origin_px[1]) / self.step_px).clamp(0.0, (self.height - 1) as f32 - 1e-3);
        let (ix, iy) = (gx as usize, gy as usize);
        let (u, v) = (gx - ix as f32, gy - iy as f32);
        let n = |dx: usize, dy: usize| self.nodes[(iy + dy) * self.width + ix + dx];
        let (a, b, c, d) = (n(0, 0), n(1, 0), n(0, 1), n(1, 1));
        [0, 1].map(|i| {
            let top = a[i] + (b[i] - a[i]) * u;
            let bottom = c[i] + (d[i] - c[i]) * u;
            top + (bottom - top) * v
        })
    }
}

/// Tone mapping of a picture.
pub(crate) struct Development<'a> {
    pub(crate) sensor: &'a SensorModel,
    pub(crate) size_px: [f32; 2],
    /// Added to pixel indices when drawing noise, so that crops of a map agree.
    pub(crate) noise_origin: [i32; 2],
    pub(crate) noise_seed: u32,
    pub(crate) tones: Option<LocalTones>,
}

impl Development<'_> {
    /// Display luminance before equalisation, 0-1.
    pub(crate) fn plain_luminance(&self, rgb: Rgb) -> f32 {
        let c = self.display(rgb, 1.0);
        0.3 * c[0] + 0.59 * c[1] + 0.11 * c[2]
    }

    fn display(&self, rgb: Rgb, exposure: f32) -> [f32; 3] {
        let s = self.sensor;
        const AIR: [f32; 3] = [0.36, 0.42, 0.50];
        let lit = [0, 1, 2].map(|i| {
            let v = rgb.0[i] * s.gain_rgb[i] * exposure;
            // Soft shoulder: highlights roll off instead of clipping.
            let v = v * (1.0 - s.haze) + AIR[i] * s.haze;
            (v * 1.12 / (1.0 + 0.12 * v * v)).max(0.0).sqrt()
        });
        let grey = 0.3 * lit[0] + 0.59 * lit[1] + 0.11 * lit[2];
        lit.map(|v| {
            let coloured = grey + (v - grey) * s.saturation;
            0.42 + (coloured - 0.42) * s.contrast
        })
    }

    /// Stored colour of a pixel.
    pub(crate) fn pixel(&self, x: u32, y: u32, rgb: Rgb) -> [u8; 3] {
        let s = self.sensor;
        let (fx, fy) = (x as f32 + 0.5, y as f32 + 0.5);
        let exposure = if s.vignette > 0.0 {
            let (dx, dy) = (fx / self.size_px[0] - 0.5, fy / self.size_px[1] - 0.5);
            let r2 = (dx * dx * 0.64 + dy * dy * 0.36) * 4.0;
            1.0 - s.vignette * r2 * (0.4 + 0.6 * r2)
        } else {
            1.0
        };
        let mut c = self.display(rgb, exposure);
        if let Some(tones) = &self.tones {
            let [mean, deviation] = tones.at(fx, fy);
            let l = 0.3 * c[0] + 0.59 * c[1] + 0.11 * c[2];
            let wanted = 0.46 + (l - mean) * (0.19 / deviation.max(0.05)).min(2.6);
            let new = l + (wanted - l) * s.equalisation;
            let k = (new / l.max(0.04)).clamp(0.2, 3.0);
            c = c.map(|v| v * (0.75 * k) + 0.25 * (v + new - l));
        }
        let (ix, iy) = (
            x as i32 + self.noise_origin[0],
            y as i32 + self.noise_origin[1],
        );
        let h = hash_cell(self.noise_seed, ix, iy);
        let shared = triangular(h);
        [0, 1, 2].map(|i| {
            let own = triangular(hash2(h, i as u32 + 1));
            // Noise grows in the dark, where the tone curve is steep.
            let strength = s.noise * (1.25 - 0.5 * c[i].clamp(0.0, 1.0));
            (c[i] * 255.0 + strength * (0.75 * shared + 0.65 * own) + 0.5).clamp(0.0, 255.0) as u8
        })
    }
}

/// Mean 0, deviation 1.
fn triangular(h: u32) -> f32 {
    (unit(h) + unit(h.rotate_left(12)) - 1.0) * 2.449
}

/// The picture after JPEG compression; unchanged if the codec fails.
pub(crate) fn through_jpeg(picture: RgbImage, quality: u8) -> RgbImage {
    let mut bytes = Vec::new();
    let (w, h) = picture.dimensions();
    let written =
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100))
            .encode(&picture, w, h, ExtendedColorType::Rgb8);
    match written
        .and_then(|()| image::load_from_memory_with_format(&bytes, image::ImageFormat::Jpeg))
    {
        Ok(back) => back.into_rgb8(),
        Err(error) => {
            tracing::warn!("JPEG compression failed and is skipped: {error}");
            picture
        }
    }
}
