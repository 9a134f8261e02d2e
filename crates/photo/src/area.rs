//! Reducing pictures by averaging over areas, which avoids aliasing.

use image::RgbImage;
use rayon::prelude::*;

/// A rectangle of a picture, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Crop {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

impl Crop {
    /// The whole picture.
    pub(crate) fn whole((width, height): (u32, u32)) -> Self {
        Self {
            x: 0,
            y: 0,
            width,
            height,
        }
    }
}

/// The picture itself if its long side is within the limit, else a smaller one of the same aspect.
pub(crate) fn limit_long_side(image: RgbImage, limit_px: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    let long = width.max(height);
    let limit_px = limit_px.max(1);
    if long <= limit_px {
        return image;
    }
    let side = |px: u32| {
        let scaled = f64::from(px) * f64::from(limit_px) / f64::from(long);
        (scaled.round() as u32).max(1)
    };
    reduce(
        &image,
        Crop::whole((width, height)),
        side(width),
        side(height),
    )
}

/// Averages a rectangle of `image` down to `width` x `height` px: each output pixel is the mean over exactly its area,
/// source pixels on its edge counting by their share (OpenCV's `INTER_AREA`). The sides must not exceed the crop's.
pub(crate) fn reduce(image: &RgbImage, crop: Crop, width: u32, height: u32) -> RgbImage {
    let mut reduced = RgbImage::new(width, height);
    let columns = spans(crop.width, width);
    let rows = spans(crop.height, height);
    let row_bytes = 3 * image.width() as usize;
    let first_byte = 3 * crop.x as usize;
    let crop_bytes = 3 * crop.width as usize;
    let source_row = |y: usize| {
        let start = (crop.y as usize + y) * row_bytes + first_byte;
        &image.as_raw()[start..start + crop_bytes]
    };
    let out_bytes = 3 * width as usize;
    if out_bytes == 0 {
        return reduced;
    }
    // Columns first: whole rows are added, which the compiler vectorises.
    reduced
        .par_chunks_exact_mut(out_bytes)
        .zip(rows.par_iter())
        .with_min_len(8)
        .for_each_init(
            || vec![0.0f32; crop_bytes],
            |sums, (out, span)| {
                for (index, weight) in span.weights().enumerate() {
                    let source = source_row(span.first + index);
                    if index == 0 {
                        for (sum, &sample) in sums.iter_mut().zip(source) {
                            *sum = weight * f32::from(sample);
                        }
                    } else {
                        for (sum, &sample) in sums.iter_mut().zip(source) {
                            *sum += weight * f32::from(sample);
                        }
                    }
                }
                let (pixels, _) = sums.as_chunks::<3>();
                let (out, _) = out.as_chunks_mut::<3>();
                for (out, span) in out.iter_mut().zip(&columns) {
                    let mut mean = [0.5f32; 3];
                    let mut add = |pixel: &[f32; 3], weight: f32| {
                        for (mean, &sum) in mean.iter_mut().zip(pixel) {
                            *mean += weight * sum;
                        }
                    };
                    // As `Span::weights` has them, without a choice for each pixel.
                    if let Some((first, rest)) =
                        pixels[span.first..span.first + span.count].split_first()
                    {
                        add(first, span.first_weight);
                        if let Some((last, inner)) = rest.split_last() {
                            inner.iter().for_each(|pixel| add(pixel, span.inner_weight));
                            add(last, span.last_weight);
                        }
                    }
                    // `as` saturates at 0 and 255.
                    *out = mean.map(|mean| mean as u8);
                }
            },
        );
    reduced
}

/// The source pixels under one output pixel along one axis, and their shares of it.
#[derive(Debug, Clone, Copy)]
struct Span {
    first: usize,
    count: usize,
    first_weight: f32,
    inner_weight: f32,
    last_weight: f32,
}

impl Span {
    fn weights(self) -> impl Iterator<Item = f32> {
        (0..self.count).map(move |index| {
            if index == 0 {
                self.first_weight
            } else if index + 1 == self.count {
                self.last_weight
            } else {
                self.inner_weight
            }
        })
    }
}

/// Spans of `to` output pixels over `from` source pixels. Edges are computed as fractions of integers, so that
/// rounding errors do not reach beyond the last pixel.
fn spans(from: u32, to: u32) -> Vec<Span> {
    let (from, to) = (u64::from(from), u64::from(to));
    (0..to)
        .map(|index| {
            // In units of 1/to source pixels.
            let (start, end) = (index * from, (index + 1) * from);
            let (first, last) = (start / to, (end - 1) / to);
            let share = |units: u64| units as f32 / from as f32;
            let first_end = ((first + 1) * to).min(end);
            Span {
                first: first as usize,
                count: (last - first + 1) as usize,
                first_weight: share(first_end - start),
                inner_weight: share(to),
                last_weight: share(end - last * to),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean over each output pixel's area, sample by sample of a common refinement.
    fn reference(image: &RgbImage, crop: Crop, width: u32, height: u32) -> Vec<f64> {
        let mut means = Vec::new();
        for y in 0..height {
            for x in 0..width {
                for channel in 0..3 {
                    let mut sum = 0.0;
                    // A refinement of width x height parts per source pixel makes every edge a whole number.
                    for v in y * crop.height..(y + 1) * crop.height {
                        for u in x * crop.width..(x + 1) * crop.width {
                            let pixel = image.get_pixel(crop.x + u / width, crop.y + v / height);
                            sum += f64::from(pixel.0[channel]);
                        }
                    }
                    means.push(sum / f64::from(crop.width * crop.height));
                }
            }
        }
        means
    }

    #[test]
    fn each_pixel_is_the_mean_over_its_area() {
        let image = RgbImage::from_fn(23, 17, |x, y| {
            image::Rgb([(x * 37 + y * 91) as u8, (x * y) as u8, (255 - x * 11) as u8])
        });
        for (crop, width, height) in [
            (Crop::whole((23, 17)), 7, 5),
            (Crop::whole((23, 17)), 23, 17),
            (Crop::whole((23, 17)), 1, 1),
            (Crop::whole((23, 17)), 22, 3),
            (
                Crop {
                    x: 2,
                    y: 5,
                    width: 20,
                    height: 12,
                },
                10,
                4,
            ),
        ] {
            let reduced = reduce(&image, crop, width, height);
            assert_eq!(reduced.dimensions(), (width, height));
            for (got, want) in reduced
                .as_raw()
                .iter()
                .zip(reference(&image, crop, width, height))
            {
                assert!((f64::from(*got) - want).abs() <= 0.501, "{got} {want}");
            }
        }
    }

    #[test]
    fn the_aspect_is_kept_and_nothing_is_enlarged() {
        let image = RgbImage::new(400, 225);
        assert_eq!(limit_long_side(image.clone(), 200).dimensions(), (200, 113));
        assert_eq!(limit_long_side(image, 800).dimensions(), (400, 225));
        assert_eq!(
            limit_long_side(RgbImage::new(30, 90), 45).dimensions(),
            (15, 45)
        );
    }
}
