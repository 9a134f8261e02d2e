//! Blur and sharpening of interleaved RGB in 0..1.

/// Separable Gaussian blur; edges repeated.
pub(super) fn gaussian(pixels: &mut [f32], width: usize, height: usize, sigma_px: f32) {
    let radius = (2.5 * sigma_px).ceil() as usize;
    let mut taps: Vec<f32> = (0..=radius)
        .map(|i| (-0.5 * (i as f32 / sigma_px).powi(2)).exp())
        .collect();
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    taps.iter_mut().for_each(|t| *t /= sum);
    let row = width * 3;
    let mut border = vec![0.0f32; row + 6 * radius];
    let mut scratch = vec![0.0f32; pixels.len()];
    for y in 0..height {
        let line = &pixels[y * row..(y + 1) * row];
        for i in 0..radius {
            border[3 * i..3 * i + 3].copy_from_slice(&line[..3]);
            border[row + 3 * (radius + i)..row + 3 * (radius + i) + 3]
                .copy_from_slice(&line[row - 3..]);
        }
        border[3 * radius..3 * radius + row].copy_from_slice(line);
        let out = &mut scratch[y * row..(y + 1) * row];
        out.iter_mut()
            .zip(&border[3 * radius..])
            .for_each(|(o, v)| *o = v * taps[0]);
        for (i, tap) in taps.iter().enumerate().skip(1) {
            let (left, right) = (&border[3 * (radius - i)..], &border[3 * (radius + i)..]);
            for ((o, a), b) in out.iter_mut().zip(left).zip(right) {
                *o += tap * (a + b);
            }
        }
    }
    for y in 0..height {
        let line = |i: isize| {
            let y = (y as isize + i).clamp(0, height as isize - 1) as usize;
            &scratch[y * row..(y + 1) * row]
        };
        let out = &mut pixels[y * row..(y + 1) * row];
        out.iter_mut()
            .zip(line(0))
            .for_each(|(o, v)| *o = v * taps[0]);
        for (i, tap) in taps.iter().enumerate().skip(1) {
            for ((o, a), b) in out
                .iter_mut()
                .zip(line(-(i as isize)))
                .zip(line(i as isize))
            {
                *o += tap * (a + b);
            }
        }
    }
}

/// Unsharp masking.
pub(super) fn sharpen(pixels: &mut [f32], width: usize, height: usize, amount: f32) {
    let before = pixels.to_vec();
    gaussian(pixels, width, height, 1.2);
    for (v, b) in pixels.iter_mut().zip(before) {
        *v = b + amount * (b - *v);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_keeps_the_mean_of_a_constant_and_spreads_a_point() {
        let mut flat = vec![0.5; 20 * 20 * 3];
        gaussian(&mut flat, 20, 20, 1.3);
        assert!(flat.iter().all(|v| (v - 0.5).abs() < 1e-5));
        let mut point = vec![0.0; 21 * 21 * 3];
        point[(10 * 21 + 10) * 3] = 1.0;
        gaussian(&mut point, 21, 21, 1.0);
        assert!((point.iter().sum::<f32>() - 1.0).abs() < 1e-4);
        assert!((point[(10 * 21 + 11) * 3] - point[(11 * 21 + 10) * 3]).abs() < 1e-6);
    }
}
