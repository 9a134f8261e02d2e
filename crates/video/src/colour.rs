//! From Y'CbCr to RGB (ITU-T H.273, 8.3).

use image::RgbImage;

use crate::error::Fault;

/// What a stream or its container says of its colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ColourDescription {
    /// `MatrixCoefficients` of H.273, table 4; `None` if it is not stated.
    pub matrix: Option<u8>,
    /// Whether black is 0 and white the largest value.
    pub is_full_range: bool,
}

/// Pictures of at least so many rows are BT.709 if they say nothing, as players take them, and BT.601 otherwise.
const HIGH_DEFINITION_ROWS: usize = 720;
/// Fractional bits of the coefficients.
const BITS: u32 = 14;

/// A picture in three planes; chroma has half the width and half the height. Slices begin at the first pixel that is shown.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Planes<'a, T> {
    pub width: usize,
    pub height: usize,
    pub luma: &'a [T],
    pub luma_stride: usize,
    pub blue: &'a [T],
    pub red: &'a [T],
    pub chroma_stride: usize,
    /// Bits of a sample.
    pub luma_bits: u8,
    pub chroma_bits: u8,
}

/// Coefficients with [`BITS`] fractional bits, for samples of given depths.
struct Matrix {
    luma_offset: i32,
    luma: i32,
    chroma_middle: i32,
    red_red: i32,
    green_blue: i32,
    green_red: i32,
    blue_blue: i32,
}

impl Matrix {
    fn new(colour: ColourDescription, rows: usize, luma_bits: u8, chroma_bits: u8) -> Self {
        // Weights of red and blue: H.273, equations 39 ff.
        let (kr, kb) = match colour.matrix {
            Some(1) => (0.2126, 0.0722),
            Some(4) => (0.30, 0.11),
            Some(5 | 6) => (0.299, 0.114),
            Some(7) => (0.212, 0.087),
            Some(9 | 10) => (0.2627, 0.0593),
            _ if rows >= HIGH_DEFINITION_ROWS => (0.2126, 0.0722),
            _ => (0.299, 0.114),
        };
        let depth = |bits: u8| f64::from(1u32 << (bits - 8));
        let largest = |bits: u8| f64::from((1u32 << bits) - 1);
        let (luma_range, chroma_range, black) = if colour.is_full_range {
            (largest(luma_bits), largest(chroma_bits), 0.0)
        } else {
            (
                219.0 * depth(luma_bits),
                224.0 * depth(chroma_bits),
                16.0 * depth(luma_bits),
            )
        };
        let fixed = |value: f64| (value * f64::from(1 << BITS)).round() as i32;
        let chroma = 255.0 / chroma_range;
        let kg = 1.0 - kr - kb;
        Self {
            luma_offset: black as i32,
            luma: fixed(255.0 / luma_range),
            chroma_middle: 1 << (chroma_bits - 1),
            red_red: fixed(2.0 * (1.0 - kr) * chroma),
            green_blue: fixed(2.0 * (1.0 - kb) * kb / kg * chroma),
            green_red: fixed(2.0 * (1.0 - kr) * kr / kg * chroma),
            blue_blue: fixed(2.0 * (1.0 - kb) * chroma),
        }
    }
}

/// Converts a picture, each chroma sample standing for its four pixels.
pub(crate) fn rgb_from_planes<T: Copy + Into<i32>>(
    planes: &Planes<'_, T>,
    colour: ColourDescription,
) -> Result<RgbImage, Fault> {
    let Planes { width, height, .. } = *planes;
    let matrix = Matrix::new(colour, height, planes.luma_bits, planes.chroma_bits);
    let mut pixels = vec![0; 3 * width * height];
    let chroma_width = width.div_ceil(2);
    for (row, out) in pixels.chunks_exact_mut(3 * width.max(1)).enumerate() {
        let lines = (
            line(planes.luma, row * planes.luma_stride, width),
            line(planes.blue, row / 2 * planes.chroma_stride, chroma_width),
            line(planes.red, row / 2 * planes.chroma_stride, chroma_width),
        );
        let (Some(luma), Some(blue), Some(red)) = lines else {
            return Err(Fault::damaged("the decoded picture is incomplete"));
        };
        convert_row(&matrix, luma, blue, red, out);
    }
    let size = (u32::try_from(width), u32::try_from(height));
    match size {
        (Ok(width), Ok(height)) => RgbImage::from_raw(width, height, pixels),
        _ => None,
    }
    .ok_or_else(|| Fault::damaged("the decoded picture is incomplete"))
}

fn line<T>(plane: &[T], start: usize, count: usize) -> Option<&[T]> {
    plane.get(start..start + count)
}

fn convert_row<T: Copy + Into<i32>>(
    matrix: &Matrix,
    luma: &[T],
    blue: &[T],
    red: &[T],
    out: &mut [u8],
) {
    const HALF: i32 = 1 << (BITS - 1);
    let pairs = luma.chunks(2).zip(blue.iter().zip(red));
    for ((luma, (&blue, &red)), out) in pairs.zip(out.chunks_mut(6)) {
        let blue = blue.into() - matrix.chroma_middle;
        let red = red.into() - matrix.chroma_middle;
        let of_chroma = [
            matrix.red_red * red,
            -matrix.green_blue * blue - matrix.green_red * red,
            matrix.blue_blue * blue,
        ];
        for (&luma, out) in luma.iter().zip(out.chunks_exact_mut(3)) {
            let grey = matrix.luma * (luma.into() - matrix.luma_offset) + HALF;
            for (out, of_chroma) in out.iter_mut().zip(of_chroma) {
                *out = ((grey + of_chroma) >> BITS).clamp(0, 255) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One pixel.
    fn rgb(samples: [u16; 3], matrix: Option<u8>, is_full_range: bool, bits: u8) -> [u8; 3] {
        let planes = Planes {
            width: 1,
            height: 1,
            luma: &samples[..1],
            luma_stride: 1,
            blue: &samples[1..2],
            red: &samples[2..],
            chroma_stride: 1,
            luma_bits: bits,
            chroma_bits: bits,
        };
        let colour = ColourDescription {
            matrix,
            is_full_range,
        };
        rgb_from_planes(&planes, colour).unwrap().get_pixel(0, 0).0
    }

    /// BT.709 and BT.601: 75 % colour bars as ITU-R BT.1729 and EBU list them.
    #[test]
    fn black_white_and_bars() {
        for matrix in [Some(1), Some(6), None] {
            assert_eq!(rgb([16, 128, 128], matrix, false, 8), [0; 3]);
            assert_eq!(rgb([235, 128, 128], matrix, false, 8), [255; 3]);
            assert_eq!(rgb([64, 512, 512], matrix, false, 10), [0; 3]);
            assert_eq!(rgb([940, 512, 512], matrix, false, 10), [255; 3]);
            assert_eq!(rgb([0, 128, 128], matrix, true, 8), [0; 3]);
            assert_eq!(rgb([255, 128, 128], matrix, true, 8), [255; 3]);
        }
        let close = |found: [u8; 3], expected: [u8; 3]| {
            let difference = found.iter().zip(expected).map(|(a, b)| a.abs_diff(b));
            assert!(difference.max() <= Some(1), "{found:?} {expected:?}");
        };
        close(rgb([51, 109, 212], Some(1), false, 8), [191, 0, 0]);
        close(rgb([133, 63, 52], Some(1), false, 8), [0, 191, 0]);
        close(rgb([65, 100, 212], Some(6), false, 8), [191, 0, 0]);
        close(rgb([35, 212, 114], Some(6), false, 8), [0, 0, 191]);
        close(rgb([140, 848, 456], Some(6), false, 10), [0, 0, 191]);
    }

    #[test]
    fn a_picture_that_is_too_short_is_refused() {
        let planes = Planes {
            width: 4,
            height: 4,
            luma: &[0u8; 15][..],
            luma_stride: 4,
            blue: &[0; 4],
            red: &[0; 4],
            chroma_stride: 2,
            luma_bits: 8,
            chroma_bits: 8,
        };
        let colour = ColourDescription {
            matrix: None,
            is_full_range: false,
        };
        assert!(rgb_from_planes(&planes, colour).is_err());
    }
}
