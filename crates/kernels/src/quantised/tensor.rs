//! Activations of one image as bytes.

use rayon::prelude::*;

use crate::buffer::AlignedBuffer;
use crate::tensor::elements_with_halo;

/// Bytes of a word: what one lane of a dot-product instruction multiplies.
pub(crate) const WORD: usize = 4;
/// Channels are padded to this many bytes: the largest vector of sums.
pub(crate) const BYTE_BLOCK: usize = 16;

/// Bytes from one pixel to the next for the `channels` channels of a layer's output.
pub(crate) fn byte_pitch(channels: usize) -> usize {
    channels.next_multiple_of(BYTE_BLOCK)
}

/// Activations of one image: height x width x channels of unsigned bytes, channels innermost (NHWC).
///
/// Around the image lies a halo of one pixel of the bytes that stand for zero, so that 3x3 convolutions need no edge cases.
/// Channels are padded to a multiple of 16, those of pictures ([`ByteTensor::reshape_picture`]) to four; the padding is arbitrary.
#[derive(Clone, Default)]
pub struct ByteTensor {
    height: usize,
    width: usize,
    channels: usize,
    pitch: usize,
    /// The bytes of a pixel of the halo.
    zero: Vec<u8>,
    data: AlignedBuffer,
}

impl std::fmt::Debug for ByteTensor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "ByteTensor({} x {} x {})",
            self.height, self.width, self.channels
        )
    }
}

impl ByteTensor {
    /// Changes the shape to as many channels as `zero`, the bytes that stand for zero, has elements. The allocation is kept if
    /// it is large enough. The halo is `zero` afterwards; the pixels are arbitrary.
    pub fn reshape(&mut self, height: usize, width: usize, zero: &[u8]) {
        self.reshape_to(height, width, zero, byte_pitch(zero.len()));
    }

    /// As [`ByteTensor::reshape`] for the three colours of a picture, four bytes a pixel.
    pub fn reshape_picture(&mut self, height: usize, width: usize, zero: [u8; 3]) {
        self.reshape_to(height, width, &zero, WORD);
    }

    fn reshape_to(&mut self, height: usize, width: usize, zero: &[u8], pitch: usize) {
        let shape = (height, width, zero.len(), pitch);
        if (self.height, self.width, self.channels, self.pitch) == shape && self.zero == zero {
            return;
        }
        let len = elements_with_halo(height, width, pitch);
        (self.height, self.width, self.channels, self.pitch) = shape;
        self.zero.clear();
        self.zero.extend_from_slice(zero);
        let row = self.row_stride();
        self.data.grow(len.div_ceil(size_of::<f32>()));
        let zero = std::mem::take(&mut self.zero);
        let fill = |pixels: &mut [u8]| {
            for pixel in pixels.chunks_exact_mut(pitch) {
                pixel[..zero.len()].copy_from_slice(&zero);
            }
        };
        let bytes = self.as_mut_slice();
        fill(&mut bytes[..row]);
        fill(&mut bytes[len - row..]);
        for line in bytes.chunks_exact_mut(row) {
            fill(&mut line[..pitch]);
            fill(&mut line[row - pitch..]);
        }
        self.zero = zero;
    }

    /// From `height x width x channels` bytes; `zero` has the bytes that stand for zero.
    ///
    /// # Panics
    /// If `data` does not have that many elements.
    #[must_use]
    pub fn from_hwc(data: &[u8], height: usize, width: usize, zero: &[u8]) -> Self {
        let channels = zero.len();
        assert_eq!(
            data.len(),
            channels * height * width,
            "elements of a {height} x {width} x {channels} image"
        );
        let mut tensor = Self::default();
        tensor.reshape(height, width, zero);
        let pitch = tensor.pitch;
        for (y, line) in data.chunks_exact((width * channels).max(1)).enumerate() {
            let row = tensor.row_mut(y);
            for (to, from) in row.chunks_exact_mut(pitch).zip(line.chunks_exact(channels)) {
                to[..channels].copy_from_slice(from);
            }
        }
        tensor
    }

    /// The pixels as `height x width x channels` bytes.
    #[must_use]
    pub fn to_hwc(&self) -> Vec<u8> {
        (0..self.height)
            .flat_map(|y| self.row(y).chunks_exact(self.pitch))
            .flat_map(|pixel| &pixel[..self.channels])
            .copied()
            .collect()
    }

    /// Height in pixels.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Width in pixels.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Bytes from one pixel to the next.
    #[must_use]
    pub fn pixel_pitch(&self) -> usize {
        self.pitch
    }

    /// Row `y`: `width` pixels of [`ByteTensor::pixel_pitch`] bytes each.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub fn row(&self, y: usize) -> &[u8] {
        assert!(y < self.height, "row {y} of {self:?}");
        &self.as_slice()[self.offset(y + 1, 1)..][..self.width * self.pitch]
    }

    fn row_mut(&mut self, y: usize) -> &mut [u8] {
        let (start, len) = (self.offset(y + 1, 1), self.width * self.pitch);
        &mut self.as_mut_slice()[start..][..len]
    }

    /// All rows, each laid out as [`ByteTensor::row`], for writing in parallel.
    pub fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [u8]> {
        let (height, pitch, row) = (self.height, self.pitch, self.row_stride());
        let rows = self
            .as_mut_slice()
            .par_chunks_exact_mut(row.max(1))
            .skip(1)
            .take(height);
        rows.map(move |line| &mut line[pitch..row - pitch])
    }

    /// Bytes from one row to the next, halo included.
    pub(crate) fn row_stride(&self) -> usize {
        (self.width + 2) * self.pitch
    }

    /// Offset of the pixel at row `y`, column `x` of the image *with its halo*: `(1, 1)` is the first pixel of the image.
    pub(crate) fn offset(&self, y: usize, x: usize) -> usize {
        y * self.row_stride() + x * self.pitch
    }

    /// All bytes, halo and padding included.
    pub(crate) fn as_slice(&self) -> &[u8] {
        &bytemuck::cast_slice(self.data.as_slice())[..self.len()]
    }

    /// All bytes, halo and padding included; the halo must stay zero.
    pub(crate) fn as_mut_slice(&mut self) -> &mut [u8] {
        let len = self.len();
        &mut bytemuck::cast_slice_mut(self.data.as_mut_slice())[..len]
    }

    fn len(&self) -> usize {
        (self.height + 2) * self.row_stride()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_halo_is_zero_after_every_change_of_shape() {
        let mut tensor = ByteTensor::default();
        for (h, w, zero) in [
            (3, 4, vec![7; 20]),
            (3, 4, vec![9; 20]),
            (5, 2, vec![1, 2, 3]),
            (1, 1, vec![0; 16]),
        ] {
            tensor.reshape(h, w, &zero);
            tensor.par_rows_mut().for_each(|row| row.fill(200));
            for (i, pixel) in tensor.as_slice().chunks_exact(tensor.pitch).enumerate() {
                let (y, x) = (i / (w + 2), i % (w + 2));
                let inside = (1..=h).contains(&y) && (1..=w).contains(&x);
                assert_eq!(pixel[..zero.len()] == zero, !inside, "{tensor:?} {y} {x}");
            }
            assert_eq!(tensor.to_hwc(), vec![200; h * w * zero.len()]);
        }
        tensor.reshape_picture(2, 2, [4, 5, 6]);
        assert_eq!(tensor.pixel_pitch(), 4);
        assert_eq!(tensor.as_slice()[..3], [4, 5, 6]);
    }

    #[test]
    fn pixels_round_trip() {
        let data: Vec<u8> = (0..2 * 3 * 5).collect();
        assert_eq!(ByteTensor::from_hwc(&data, 2, 3, &[128; 5]).to_hwc(), data);
    }
}
