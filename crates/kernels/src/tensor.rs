//! Activations of one image.

use rayon::prelude::*;

use crate::buffer::AlignedBuffer;

/// Channels are padded to this many floats (one AVX-512 vector, one cache line).
pub(crate) const CHANNEL_BLOCK: usize = 16;
/// Images of up to this many channels are padded to this many only.
const NARROW_CHANNELS: usize = 4;

/// Floats from one pixel to the next for `channels` channels.
pub(crate) fn channel_stride(channels: usize) -> usize {
    if channels <= NARROW_CHANNELS {
        NARROW_CHANNELS
    } else {
        channels.next_multiple_of(CHANNEL_BLOCK)
    }
}

/// Elements of an image of `pitch` elements per pixel with its halo. What a tensor has room for is known from here on: kernels write
/// through pointers.
///
/// # Panics
/// If the number does not fit `usize`.
#[track_caller]
pub(crate) fn elements_with_halo(height: usize, width: usize, pitch: usize) -> usize {
    let pixels = height.checked_add(2).zip(width.checked_add(2));
    let pixels = pixels.and_then(|(height, width)| height.checked_mul(width));
    match pixels.and_then(|pixels| pixels.checked_mul(pitch)) {
        Some(elements) => elements,
        None => panic!(
            "an image of {height} x {width} px with {pitch} elements each does not fit the address space"
        ),
    }
}

/// Activations of one image: height x width x channels of `f32`, channels innermost (NHWC).
///
/// Around the image lies a halo of one pixel, always zero, so that 3x3 convolutions need no edge cases. Channels are
/// padded (to a multiple of 16; up to four channels to four), and the padding is always zero too.
#[derive(Clone)]
pub struct Tensor {
    height: usize,
    width: usize,
    channels: usize,
    data: AlignedBuffer,
}

impl std::fmt::Debug for Tensor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "Tensor({} x {} x {})",
            self.height, self.width, self.channels
        )
    }
}

impl Default for Tensor {
    /// An empty tensor. The kernel that writes it will reshape it.
    fn default() -> Self {
        Self::new(0, 0, 0)
    }
}

impl Tensor {
    /// A tensor of zeros.
    #[must_use]
    pub fn new(height: usize, width: usize, channels: usize) -> Self {
        let floats = elements_with_halo(height, width, channel_stride(channels));
        Self {
            height,
            width,
            channels,
            data: AlignedBuffer::zeroed(floats),
        }
    }

    /// Changes the shape; the allocation is kept if it is large enough. Halo and padding channels are zero afterwards; the
    /// pixels are arbitrary.
    pub fn reshape(&mut self, height: usize, width: usize, channels: usize) {
        if (self.height, self.width, self.channels) == (height, width, channels) {
            return;
        }
        let floats = elements_with_halo(height, width, channel_stride(channels));
        (self.height, self.width, self.channels) = (height, width, channels);
        let (row, stride) = (self.row_stride(), self.channel_stride());
        self.data.grow(floats);
        let data = &mut self.data.as_mut_slice()[..floats];
        if stride != channels {
            data.fill(0.0);
            return;
        }
        data[..row].fill(0.0);
        data[floats - row..].fill(0.0);
        for line in data.chunks_exact_mut(row) {
            line[..stride].fill(0.0);
            line[row - stride..].fill(0.0);
        }
    }

    /// From `channels x height x width` floats (one image of an NCHW batch).
    ///
    /// # Panics
    /// If `data` does not have that many elements.
    #[must_use]
    pub fn from_chw(data: &[f32], channels: usize, height: usize, width: usize) -> Self {
        assert_eq!(
            data.len(),
            channels * height * width,
            "elements of a {channels} x {height} x {width} image"
        );
        let mut tensor = Self::new(height, width, channels);
        for (c, plane) in data.chunks_exact((height * width).max(1)).enumerate() {
            for y in 0..height {
                for x in 0..width {
                    tensor.pixel_mut(y, x)[c] = plane[y * width + x];
                }
            }
        }
        tensor
    }

    /// From `height x width x channels` floats.
    ///
    /// # Panics
    /// If `data` does not have that many elements.
    #[must_use]
    pub fn from_hwc(data: &[f32], height: usize, width: usize, channels: usize) -> Self {
        assert_eq!(
            data.len(),
            channels * height * width,
            "elements of a {height} x {width} x {channels} image"
        );
        let mut tensor = Self::new(height, width, channels);
        for (i, pixel) in data.chunks_exact(channels.max(1)).enumerate() {
            tensor
                .pixel_mut(i / width, i % width)
                .copy_from_slice(pixel);
        }
        tensor
    }

    /// The pixels as `channels x height x width` floats.
    #[must_use]
    pub fn to_chw(&self) -> Vec<f32> {
        let mut planes = vec![0.0; self.channels * self.height * self.width];
        for y in 0..self.height {
            for x in 0..self.width {
                for (c, &value) in self.pixel(y, x).iter().enumerate() {
                    planes[(c * self.height + y) * self.width + x] = value;
                }
            }
        }
        planes
    }

    /// The pixels as `height x width x channels` floats.
    #[must_use]
    pub fn to_hwc(&self) -> Vec<f32> {
        let mut pixels = Vec::with_capacity(self.channels * self.height * self.width);
        for y in 0..self.height {
            for x in 0..self.width {
                pixels.extend_from_slice(self.pixel(y, x));
            }
        }
        pixels
    }

    /// Sets every channel of every pixel to `value`.
    pub fn fill(&mut self, value: f32) {
        for y in 0..self.height {
            for x in 0..self.width {
                self.pixel_mut(y, x).fill(value);
            }
        }
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

    /// The channels of the pixel in row `y`, column `x`.
    ///
    /// # Panics
    /// If there is no such pixel.
    #[must_use]
    pub fn pixel(&self, y: usize, x: usize) -> &[f32] {
        assert!(
            y < self.height && x < self.width,
            "pixel ({y}, {x}) of {self:?}"
        );
        &self.data.as_slice()[self.offset(y + 1, x + 1)..][..self.channels]
    }

    /// The channels of the pixel in row `y`, column `x`, writable.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn pixel_mut(&mut self, y: usize, x: usize) -> &mut [f32] {
        assert!(
            y < self.height && x < self.width,
            "pixel ({y}, {x}) of {self:?}"
        );
        let (offset, channels) = (self.offset(y + 1, x + 1), self.channels);
        &mut self.data.as_mut_slice()[offset..][..channels]
    }

    /// Floats from one pixel to the next in [`Tensor::row`]: the channels and their padding.
    #[must_use]
    pub fn pixel_pitch(&self) -> usize {
        self.channel_stride()
    }

    /// Row `y`: `width` pixels of [`Tensor::pixel_pitch`] floats each.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub fn row(&self, y: usize) -> &[f32] {
        assert!(y < self.height, "row {y} of {self:?}");
        &self.as_slice()[self.offset(y + 1, 1)..][..self.width * self.channel_stride()]
    }

    /// All rows, each laid out as [`Tensor::row`], for writing in parallel. Write only the channels of each pixel: the
    /// kernels need the padding to be zero.
    pub fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        let (height, pixel, row) = (self.height, self.channel_stride(), self.row_stride());
        let rows = self
            .as_mut_slice()
            .par_chunks_exact_mut(row)
            .skip(1)
            .take(height);
        rows.map(move |line| &mut line[pixel..row - pixel])
    }

    /// Floats from one pixel to the next, padding channels included.
    pub(crate) fn channel_stride(&self) -> usize {
        channel_stride(self.channels)
    }

    /// Floats from one row to the next, halo included.
    pub(crate) fn row_stride(&self) -> usize {
        (self.width + 2) * self.channel_stride()
    }

    /// Offset of the pixel at row `y`, column `x` of the image *with its halo*: `(1, 1)` is the first pixel of the image.
    pub(crate) fn offset(&self, y: usize, x: usize) -> usize {
        y * self.row_stride() + x * self.channel_stride()
    }

    /// All floats, halo and padding included.
    pub(crate) fn as_slice(&self) -> &[f32] {
        &self.data.as_slice()[..self.floats()]
    }

    /// All floats, halo and padding included, which must stay zero.
    pub(crate) fn as_mut_slice(&mut self) -> &mut [f32] {
        let floats = self.floats();
        &mut self.data.as_mut_slice()[..floats]
    }

    fn floats(&self) -> usize {
        (self.height + 2) * self.row_stride()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_beyond_the_address_space_are_refused() {
        let side = 1 << (usize::BITS / 2);
        for channels in [1, 16] {
            assert!(
                std::panic::catch_unwind(|| Tensor::new(side - 2, side - 2, channels)).is_err()
            );
            let mut tensor = Tensor::new(4, 4, 1);
            let reshape = std::panic::AssertUnwindSafe(|| tensor.reshape(side, side, channels));
            assert!(std::panic::catch_unwind(reshape).is_err());
            assert_eq!((tensor.height(), tensor.width()), (4, 4));
        }
    }

    fn halo_and_padding_are_zero(t: &Tensor) -> bool {
        let stride = t.channel_stride();
        t.as_slice()
            .chunks_exact(stride)
            .enumerate()
            .all(|(i, pixel)| {
                let (y, x) = (i / (t.width + 2), i % (t.width + 2));
                let inside = (1..=t.height).contains(&y) && (1..=t.width).contains(&x);
                let from = if inside { t.channels } else { 0 };
                pixel[from..].iter().all(|&v| v == 0.0)
            })
    }

    #[test]
    fn layouts_round_trip() {
        let (c, h, w) = (3, 4, 5);
        let chw: Vec<f32> = (0..c * h * w).map(|i| i as f32).collect();
        let tensor = Tensor::from_chw(&chw, c, h, w);
        assert_eq!(tensor.pixel(2, 1), &[11.0, 31.0, 51.0]);
        assert_eq!(tensor.to_chw(), chw);
        assert_eq!(Tensor::from_hwc(&tensor.to_hwc(), h, w, c).to_chw(), chw);
    }

    #[test]
    fn reshape_clears_halo_and_padding_and_keeps_the_allocation() {
        let mut tensor = Tensor::new(9, 9, 32);
        tensor.fill(7.0);
        let address = tensor.as_slice().as_ptr();
        for (h, w, c) in [(7, 5, 32), (3, 20, 16), (8, 8, 17), (9, 9, 3), (1, 1, 1)] {
            tensor.reshape(h, w, c);
            assert!(halo_and_padding_are_zero(&tensor), "{tensor:?}");
            tensor.fill(7.0);
            assert!(halo_and_padding_are_zero(&tensor), "{tensor:?}");
        }
        assert_eq!(tensor.as_slice().as_ptr(), address);
    }

    #[test]
    fn rows_hold_the_pixels() {
        for channels in [3, 16, 17] {
            let mut tensor = Tensor::new(4, 5, channels);
            let pitch = tensor.pixel_pitch();
            tensor.par_rows_mut().enumerate().for_each(|(y, row)| {
                assert_eq!(row.len(), 5 * pitch);
                for (x, pixel) in row.chunks_exact_mut(pitch).enumerate() {
                    pixel[..channels].fill((10 * y + x) as f32);
                }
            });
            assert!(halo_and_padding_are_zero(&tensor));
            for (y, x) in [(0, 0), (3, 4), (2, 1)] {
                assert_eq!(tensor.pixel(y, x), vec![(10 * y + x) as f32; channels]);
                assert_eq!(&tensor.row(y)[x * pitch..][..channels], tensor.pixel(y, x));
            }
        }
    }

    #[test]
    fn memory_starts_on_a_cache_line() {
        assert_eq!(Tensor::new(3, 3, 16).as_slice().as_ptr() as usize % 64, 0);
    }
}
