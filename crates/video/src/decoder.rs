//! One decoder for both codings: coded frames in, pictures out.

use std::panic::{AssertUnwindSafe, catch_unwind};

use image::RgbImage;
use rusty_h264_decoder::DecodeError;

use crate::colour::ColourDescription;
use crate::error::Fault;
use crate::fields::Fields;
use crate::picture::Picture;
use crate::pixel_aspect::PixelAspect;
use crate::sample_entry::Codec;
use crate::stream_size::StreamSize;
use crate::{h264, h265};

/// A decoded picture, with the number of the sample that it was coded in.
pub(crate) struct Decoded {
    pub sample: usize,
    pub picture: Picture,
}

/// What decoding starts with.
#[derive(Debug, Clone)]
pub(crate) struct DecoderSettings {
    pub codec: Codec,
    /// SPS, PPS and VPS outside of the samples.
    pub parameter_sets: Vec<Vec<u8>>,
    /// Bytes of the length before each NAL unit.
    pub nal_length_bytes: usize,
    /// Stated by the container; what the stream states counts more.
    pub colour: Option<ColourDescription>,
    /// Stated by the container, which counts more than the stream here, as in ffmpeg.
    pub aspect: Option<PixelAspect>,
    /// Memory that decoding may take.
    pub limit_bytes: u64,
}

enum Inner {
    H264(Box<rusty_h264_decoder::Decoder>),
    H265(Box<rusty_h265::Decoder>),
}

/// See the module.
pub(crate) struct Decoder {
    inner: Inner,
    settings: DecoderSettings,
    size: Option<StreamSize>,
    has_layers: bool,
}

impl Decoder {
    /// A decoder that begins at a sample which decoding can start at.
    pub(crate) fn new(settings: DecoderSettings) -> Result<Self, Fault> {
        let inner = match settings.codec {
            Codec::H264 => Inner::H264(Box::default()),
            Codec::H265 => Inner::H265(Box::default()),
        };
        let sets = settings.parameter_sets.clone();
        let mut decoder = Self {
            inner,
            settings,
            size: None,
            has_layers: false,
        };
        let sets: Vec<&[u8]> = sets.iter().map(Vec::as_slice).collect();
        decoder.check_sizes(&sets)?;
        decoder.decode_safely(0, &sets, &mut Vec::new())?;
        Ok(decoder)
    }

    /// Takes in a sample. Pictures that are finished by it come into `out`: not those of samples that are not `wanted` and that no
    /// other picture needs.
    pub(crate) fn feed(
        &mut self,
        sample: usize,
        bytes: &[u8],
        is_wanted: bool,
        out: &mut Vec<Decoded>,
    ) -> Result<(), Fault> {
        let units = nal_units(bytes, self.settings.nal_length_bytes)?;
        self.check_sizes(&units)?;
        if !is_wanted && self.is_unreferenced(&units) {
            return Ok(());
        }
        if self.size.is_none() {
            return Err(Fault::damaged(
                "the parameter sets (SPS), without which nothing can be decoded, are missing",
            ));
        }
        let before = out.len();
        self.decode_safely(sample, &units, out)?;
        let is_h264 = matches!(self.inner, Inner::H264(_));
        if is_h264 && is_wanted && out.len() == before {
            return Err(Fault::damaged("the coded frame is incomplete"));
        }
        Ok(())
    }

    /// Finishes the pictures that wait for others.
    pub(crate) fn flush(&mut self, out: &mut Vec<Decoded>) {
        if let Inner::H265(decoder) = &mut self.inner {
            // Pictures that came before a panic are kept.
            let _ = catch_unwind(AssertUnwindSafe(|| {
                decoder.flush();
                take_finished(decoder, out);
            }));
        }
    }

    /// Whether decoding can start at a sample.
    pub(crate) fn is_start(&self, bytes: &[u8]) -> bool {
        let is_start = match self.settings.codec {
            Codec::H264 => h264::is_start,
            Codec::H265 => h265::is_start,
        };
        nal_units(bytes, self.settings.nal_length_bytes)
            .is_ok_and(|units| units.into_iter().any(is_start))
    }

    /// Width and height as coded, px.
    pub(crate) fn coded_size_px(&self) -> Option<(u64, u64)> {
        self.size.map(|size| (size.width, size.height))
    }

    /// How wide the pixels are, if they are no squares.
    pub(crate) fn aspect(&self) -> Option<PixelAspect> {
        let of_stream = self.size.and_then(|size| size.aspect);
        let stated = self.settings.aspect.or(of_stream);
        stated.filter(|aspect| !aspect.is_square())
    }

    /// The part of a picture that is shown, as RGB with square pixels.
    pub(crate) fn rgb(&self, picture: &Picture) -> Result<RgbImage, Fault> {
        let rgb = picture.to_rgb(self.colour())?;
        Ok(match self.aspect() {
            Some(aspect) => aspect.squared(&rgb),
            None => rgb,
        })
    }

    /// How colours are coded.
    fn colour(&self) -> ColourDescription {
        let known = |colour: Option<ColourDescription>| {
            colour
                .and_then(|colour| colour.matrix)
                // 2: unspecified.
                .filter(|&matrix| matrix != 2)
        };
        let stream = self.size.and_then(|size| size.colour);
        let container = self.settings.colour;
        ColourDescription {
            matrix: known(stream).or(known(container)),
            is_full_range: stream
                .or(container)
                .is_some_and(|colour| colour.is_full_range),
        }
    }

    fn is_unreferenced(&self, units: &[&[u8]]) -> bool {
        type Test = fn(&[u8]) -> bool;
        let (is_slice, is_unreferenced): (Test, Test) = match self.settings.codec {
            Codec::H264 => (h264::is_slice, h264::is_unreferenced_slice),
            Codec::H265 => (h265::is_slice, h265::is_unreferenced_slice),
        };
        let mut slices = units.iter().filter(|unit| is_slice(unit)).peekable();
        !self.has_layers && slices.peek().is_some() && slices.all(|unit| is_unreferenced(unit))
    }

    /// Compares the sizes in parameter sets with the limit.
    fn check_sizes(&mut self, units: &[&[u8]]) -> Result<(), Fault> {
        for unit in units {
            let size = match self.settings.codec {
                Codec::H264 if h264::is_parameter_set(unit) => {
                    h264::stream_size(unit).map_err(|_| damaged_parameters())?
                }
                Codec::H265 if h265::is_parameter_set(unit) => {
                    let (size, has_layers) =
                        h265::stream_size(unit).map_err(|_| damaged_parameters())?;
                    self.has_layers = has_layers;
                    size
                }
                _ => continue,
            };
            let mut stretch = 1.0;
            if let Some(aspect) = self.settings.aspect.or(size.aspect) {
                aspect.check()?;
                stretch = aspect.stretch().0 * aspect.stretch().1;
            }
            let needed_bytes = size.memory_bytes(stretch);
            if needed_bytes > self.settings.limit_bytes {
                let (width, height) = (size.width, size.height);
                return Err(Fault::TooLarge {
                    what: format!("decoding pictures of {width} x {height} px"),
                    needed_bytes,
                });
            }
            self.size = Some(size);
        }
        Ok(())
    }

    /// As [`Self::decode`]. The decoders are young: what they did not expect must not end a flight.
    fn decode_safely(
        &mut self,
        sample: usize,
        units: &[&[u8]],
        out: &mut Vec<Decoded>,
    ) -> Result<(), Fault> {
        catch_unwind(AssertUnwindSafe(|| self.decode(sample, units, out)))
            .unwrap_or_else(|_| Err(Fault::damaged("the decoder failed")))
    }

    fn decode(
        &mut self,
        sample: usize,
        units: &[&[u8]],
        out: &mut Vec<Decoded>,
    ) -> Result<(), Fault> {
        match &mut self.inner {
            Inner::H264(decoder) => {
                let mut stream = Vec::new();
                for unit in units {
                    stream.extend([0, 0, 0, 1]);
                    stream.extend(*unit);
                }
                if let Some(frame) = decoder.decode(&stream).map_err(h264_fault)? {
                    let hidden_px = self.size.map(|size| size.hidden_px);
                    out.push(Decoded {
                        sample,
                        picture: Picture::H264 {
                            hidden_px: hidden_px.unwrap_or_default(),
                            width: frame.width,
                            height: frame.height,
                            luma: frame.y,
                            blue: frame.u,
                            red: frame.v,
                        },
                    });
                }
            }
            Inner::H265(decoder) => {
                let generated = decoder.stats.generated_refs;
                let mut number = i64::try_from(sample).ok();
                for unit in units {
                    decoder.push_nal(unit, number.take()).map_err(h265_fault)?;
                }
                if decoder.stats.generated_refs > generated {
                    return Err(Fault::damaged(
                        "a frame that it is predicted from is missing",
                    ));
                }
                take_finished(decoder, out);
            }
        }
        Ok(())
    }
}

fn take_finished(decoder: &mut rusty_h265::Decoder, out: &mut Vec<Decoded>) {
    while let Ok(frame) = decoder.next_frame() {
        if let Some(sample) = frame.pts.and_then(|pts| usize::try_from(pts).ok()) {
            out.push(Decoded {
                sample,
                picture: Picture::H265(frame),
            });
        }
    }
}

/// NAL units with their lengths before them (ISO/IEC 14496-15, 5.3.2).
fn nal_units(sample: &[u8], length_bytes: usize) -> Result<Vec<&[u8]>, Fault> {
    let mut fields = Fields(sample);
    let mut units = Vec::new();
    while !fields.0.is_empty() {
        let unit = fields.take(length_bytes).and_then(|length| {
            let length = length
                .iter()
                .fold(0, |sum, &byte| sum << 8 | usize::from(byte));
            fields.take(length)
        });
        let unit = unit.ok_or_else(|| Fault::damaged("the coded frame is damaged"))?;
        if !unit.is_empty() {
            units.push(unit);
        }
    }
    Ok(units)
}

fn damaged_parameters() -> Fault {
    Fault::damaged("its parameter sets (SPS) are damaged")
}

fn h264_fault(error: DecodeError) -> Fault {
    match error {
        DecodeError::Unsupported(what) => Fault::Unsupported(format!("H.264 with {what}")),
        other => Fault::damaged(other.to_string()),
    }
}

fn h265_fault(error: rusty_h265::Error) -> Fault {
    match error {
        rusty_h265::Error::Unsupported(what) => Fault::Unsupported(format!("H.265 with {what}")),
        other => Fault::damaged(other.to_string()),
    }
}
