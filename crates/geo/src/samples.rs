//! From the samples of a file to 8-bit RGB.

use tiff_reader::RasterLayout;

/// Low end of the stretch of samples that are not 8-bit: this share of the map is darker.
const STRETCH_LOW: f64 = 0.02;
/// High end: this share is darker.
const STRETCH_HIGH: f64 = 0.98;

/// How a number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SampleKind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl SampleKind {
    pub fn of(layout: &RasterLayout) -> Option<Self> {
        match (layout.sample_format, layout.bytes_per_sample) {
            (1, 1) => Some(Self::U8),
            (2, 1) => Some(Self::I8),
            (1, 2) => Some(Self::U16),
            (2, 2) => Some(Self::I16),
            (1, 4) => Some(Self::U32),
            (2, 4) => Some(Self::I32),
            (1, 8) => Some(Self::U64),
            (2, 8) => Some(Self::I64),
            (3, 4) => Some(Self::F32),
            (3, 8) => Some(Self::F64),
            _ => None,
        }
    }

    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    pub fn is_unsigned(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32 | Self::U64)
    }

    /// Name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "8-bit",
            Self::I8 => "signed 8-bit",
            Self::U16 => "16-bit",
            Self::I16 => "signed 16-bit",
            Self::U32 => "32-bit",
            Self::I32 => "signed 32-bit",
            Self::U64 => "64-bit",
            Self::I64 => "signed 64-bit",
            Self::F32 => "32-bit float",
            Self::F64 => "64-bit float",
        }
    }

    /// A sample from native-endian bytes; 0 if there are too few.
    pub fn value(self, bytes: &[u8]) -> f64 {
        fn take<const N: usize>(bytes: &[u8]) -> [u8; N] {
            let mut out = [0; N];
            if let Some(b) = bytes.get(..N) {
                out.copy_from_slice(b);
            }
            out
        }
        match self {
            Self::U8 => f64::from(bytes[0]),
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U16 => f64::from(u16::from_ne_bytes(take(bytes))),
            Self::I16 => f64::from(i16::from_ne_bytes(take(bytes))),
            Self::U32 => f64::from(u32::from_ne_bytes(take(bytes))),
            Self::I32 => f64::from(i32::from_ne_bytes(take(bytes))),
            Self::U64 => u64::from_ne_bytes(take(bytes)) as f64,
            Self::I64 => i64::from_ne_bytes(take(bytes)) as f64,
            Self::F32 => f64::from(f32::from_ne_bytes(take(bytes))),
            Self::F64 => f64::from_ne_bytes(take(bytes)),
        }
    }
}

/// Which samples of a pixel make its colour and its validity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Bands {
    /// Samples of a pixel.
    pub count: usize,
    /// Red, green and blue; three times the same for grey.
    pub rgb: [usize; 3],
    /// The alpha band.
    pub alpha: Option<usize>,
    /// Small values are bright (MinIsWhite).
    pub inverted: bool,
}

impl Bands {
    /// Grey from the first band, or colour from the first three.
    pub fn first(count: usize, color_bands: usize, alpha: Option<usize>) -> Self {
        let rgb = if color_bands >= 3 {
            [0, 1, 2]
        } else {
            [0, 0, 0]
        };
        Self {
            count,
            rgb,
            alpha,
            inverted: false,
        }
    }

    pub fn is_grey(&self) -> bool {
        self.rgb == [0, 0, 0]
    }
}

/// Linear stretch of each colour band to 8 bits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stretch {
    /// Sample that becomes 0.
    pub low: [f64; 3],
    /// Sample that becomes 255.
    pub high: [f64; 3],
}

impl Stretch {
    /// No stretch: 8-bit samples.
    pub const IDENTITY: Self = Self {
        low: [0.0; 3],
        high: [255.0; 3],
    };

    /// From samples of the map, one list for each colour band: the 2nd to the 98th percentile, as
    /// GIS programs show such files. Bands without samples are left as they are.
    pub fn from_samples(mut samples: [Vec<f64>; 3]) -> Self {
        let mut stretch = Self::IDENTITY;
        for (band, values) in samples.iter_mut().enumerate() {
            if values.is_empty() {
                continue;
            }
            values.sort_by(f64::total_cmp);
            let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
            let (low, high) = (at(STRETCH_LOW), at(STRETCH_HIGH));
            stretch.low[band] = low;
            // A map of one value is shown black rather than divided by zero.
            stretch.high[band] = if high > low { high } else { low + 1.0 };
        }
        stretch
    }

    fn apply(&self, band: usize, value: f64) -> u8 {
        let (low, high) = (self.low[band], self.high[band]);
        // `as` clamps, and turns NaN into 0.
        (255.0 * (value - low) / (high - low)).round() as u8
    }
}

/// Interleaved samples of a piece of a map.
pub(crate) struct Samples<'a> {
    pub bytes: &'a [u8],
    pub kind: SampleKind,
    pub bands: Bands,
}

impl Samples<'_> {
    fn pixel_bytes(&self) -> usize {
        self.bands.count * self.kind.bytes()
    }

    fn value(&self, pixel: &[u8], band: usize) -> f64 {
        self.kind.value(&pixel[band * self.kind.bytes()..])
    }

    /// Clears the mask where all colour bands have the nodata value or are not numbers, and where
    /// alpha is below half (8 bits) or zero: what is opaque in other samples depends on their bits and their writer.
    pub fn mark_missing(&self, nodata: Option<f64>, mask: &mut [u8]) {
        let float = matches!(self.kind, SampleKind::F32 | SampleKind::F64);
        if nodata.is_none() && self.bands.alpha.is_none() && !float {
            return;
        }
        let half = match self.kind {
            SampleKind::F32 | SampleKind::F64 => f64::MIN_POSITIVE,
            SampleKind::U8 => 128.0,
            _ => 1.0,
        };
        // Files state it as decimal text, often with fewer digits than the samples have.
        let nodata = nodata.map(|value| match self.kind {
            SampleKind::F32 => f64::from(value as f32),
            _ => value,
        });
        let colors: &[usize] = if self.bands.is_grey() {
            &[0]
        } else {
            &self.bands.rgb
        };
        for (pixel, seen) in self.bytes.chunks_exact(self.pixel_bytes()).zip(mask) {
            let missing = |band: usize| {
                let value = self.value(pixel, band);
                value.is_nan() || nodata.is_some_and(|n| value == n)
            };
            let transparent = self
                .bands
                .alpha
                .is_some_and(|a| self.value(pixel, a) < half);
            if transparent || colors.iter().all(|&band| missing(band)) {
                *seen = 0;
            }
        }
    }

    /// 8-bit RGB.
    pub fn to_rgb(&self, stretch: &Stretch) -> Vec<u8> {
        let pixel_bytes = self.pixel_bytes();
        let plain = self.kind == SampleKind::U8;
        if plain && self.bands.count == 3 && !self.bands.is_grey() && !self.bands.inverted {
            return self.bytes.to_vec();
        }
        let mut rgb = Vec::with_capacity(self.bytes.len() / pixel_bytes * 3);
        let [r, g, b] = self.bands.rgb;
        for pixel in self.bytes.chunks_exact(pixel_bytes) {
            if plain {
                rgb.extend_from_slice(&[pixel[r], pixel[g], pixel[b]]);
            } else {
                for (band, &sample) in self.bands.rgb.iter().enumerate() {
                    rgb.push(stretch.apply(band, self.value(pixel, sample)));
                }
            }
        }
        if self.bands.inverted {
            rgb.iter_mut().for_each(|v| *v = 255 - *v);
        }
        rgb
    }

    /// Adds every `step`-th pixel that has data to the samples of a stretch.
    pub fn collect(
        &self,
        mask: &[u8],
        step: usize,
        zero_is_missing: bool,
        into: &mut [Vec<f64>; 3],
    ) {
        let pixels = self
            .bytes
            .chunks_exact(self.pixel_bytes())
            .zip(mask)
            .step_by(step.max(1));
        for (pixel, &seen) in pixels {
            let values = self.bands.rgb.map(|band| self.value(pixel, band));
            let empty = zero_is_missing && values.iter().all(|&v| v == 0.0);
            if seen == 0 || empty {
                continue;
            }
            for (list, value) in into.iter_mut().zip(values) {
                if value.is_finite() {
                    list.push(value);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(kind: SampleKind, bytes: &[u8], alpha: Option<usize>, nodata: Option<f64>) -> Vec<u8> {
        let count = 1 + usize::from(alpha.is_some());
        let samples = Samples {
            bytes,
            kind,
            bands: Bands::first(count, 1, alpha),
        };
        let mut mask = vec![255; bytes.len() / (count * kind.bytes())];
        samples.mark_missing(nodata, &mut mask);
        mask
    }

    /// GDAL compares 32-bit samples with the value rounded to 32 bits: the text has 15 digits here.
    #[test]
    fn nodata_of_floats_is_compared_as_a_float() {
        for (text, value) in [("-3.40282346638529e+38", f32::MIN), ("0.1", 0.1_f32)] {
            let bytes = [value.to_ne_bytes(), 5_f32.to_ne_bytes()].concat();
            let nodata = Some(text.parse().unwrap());
            assert_eq!(
                seen(SampleKind::F32, &bytes, None, nodata),
                [0, 255],
                "{text}"
            );
        }
    }

    /// 12 bits in 16: the largest alpha is 4095.
    #[test]
    fn alpha_of_few_bits_is_opaque() {
        let pixel = |alpha: u16| [700_u16.to_ne_bytes(), alpha.to_ne_bytes()].concat();
        let bytes = [pixel(0), pixel(4095), pixel(65535)].concat();
        assert_eq!(seen(SampleKind::U16, &bytes, Some(1), None), [0, 255, 255]);
        assert_eq!(
            seen(SampleKind::U8, &[9, 127, 9, 128], Some(1), None),
            [0, 255]
        );
    }
}
