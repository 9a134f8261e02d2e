//! How the blocks of a scan's MCUs lie, and what a reduced picture needs to decode them.

use crate::bits::Bits;
use crate::block::{ac_coefficients, dc_difference};
use crate::damage::{Checked, Damage};
use crate::huffman::Table;
use crate::reduced::Reduction;
use crate::reduced::basis::Basis;
use crate::structure::Frame;
use crate::tables::Tables;

/// One component of the scan.
pub(crate) struct Component<'t> {
    dc: &'t Table,
    ac: &'t Table,
    /// What its coefficients add to the samples.
    pub basis: Basis,
    /// Step of the DC coefficient.
    pub dc_step: i32,
    /// Blocks of an MCU, horizontally and vertically.
    pub blocks: (usize, usize),
}

/// The components of a scan that holds the whole picture.
pub(crate) struct Layout<'t> {
    pub components: Vec<Component<'t>>,
    /// MCUs of a row of them, and of all.
    pub mcus_in_row: usize,
    pub mcus: usize,
    /// Samples of an MCU, each component's blocks one after the other.
    pub samples_of_mcu: usize,
    /// Blocks of an MCU.
    pub blocks_of_mcu: usize,
    /// MCUs between restart markers; 0 for no markers.
    pub restart_interval: u32,
}

/// DC coefficients of the last block of each component, from which the next one differs.
pub(crate) type Predicted = [i32; 3];

/// Samples and DC coefficients of MCUs, one after the other.
#[derive(Debug, Default)]
pub(crate) struct McuData {
    /// What the AC coefficients add up to, in units of 1/16.
    pub samples: Vec<i16>,
    /// DC coefficients, before multiplication with their step.
    pub dcs: Vec<i32>,
}

impl<'t> Layout<'t> {
    /// The layout of a scan with this header; `None` if it does not hold the whole picture as grey or YCbCr in a sampling that can be
    /// reduced.
    pub(crate) fn new(
        frame: &Frame,
        tables: &'t Tables,
        header: &[u8],
        reduction: Reduction,
    ) -> Checked<Option<Self>> {
        let count = usize::from(*header.first().ok_or(Damage::ScanHeader)?);
        let selectors = header.get(1..1 + 2 * count).ok_or(Damage::ScanHeader)?;
        let selectors = selectors.as_chunks::<2>().0;
        let listed = &frame.components;
        let are_in_order = || selectors.iter().zip(listed).all(|(s, c)| s[0] == c.id);
        if !matches!(count, 1 | 3) || count != listed.len() || !are_in_order() {
            return Ok(None);
        }
        let is_grey = count == 1;
        let (h_max, v_max) = if is_grey {
            (1, 1)
        } else {
            frame.max_sampling()
        };
        let mut components = Vec::with_capacity(count);
        for (of_frame, &[_, selector]) in listed.iter().zip(selectors) {
            // The blocks of a single component come one by one, whatever its sampling factors (A.2.2).
            let (h, v) = if is_grey {
                (1, 1)
            } else {
                (of_frame.h, of_frame.v)
            };
            let samples = |largest: u64, factor: u32| {
                let px = u64::from(reduction.px_of_block()) * largest;
                let samples = px / u64::from(factor);
                let fits = px.is_multiple_of(u64::from(factor)) && matches!(samples, 1 | 2 | 4 | 8);
                fits.then_some(samples as usize)
            };
            let (Some(width), Some(height)) = (samples(h_max, h), samples(v_max, v)) else {
                return Ok(None);
            };
            let Some(steps) = tables.quantisation(of_frame.quantisation) else {
                return Ok(None);
            };
            let (dc, ac) = tables.huffman(selector)?;
            components.push(Component {
                dc,
                ac,
                basis: Basis::new((width, height), steps),
                dc_step: i32::from(steps[0]),
                blocks: (h as usize, v as usize),
            });
        }
        let blocks = |component: &Component<'_>| component.blocks.0 * component.blocks.1;
        let (width_px, height_px) = frame.size_px;
        let mcus_in_row = u64::from(width_px).div_ceil(8 * h_max) as usize;
        let mcu_rows = u64::from(height_px).div_ceil(8 * v_max) as usize;
        Ok(Some(Self {
            mcus_in_row,
            mcus: mcus_in_row * mcu_rows,
            samples_of_mcu: components
                .iter()
                .map(|c| blocks(c) * c.basis.samples())
                .sum(),
            blocks_of_mcu: components.iter().map(blocks).sum(),
            components,
            restart_interval: tables.restart_interval,
        }))
    }

    /// Pixels of an MCU in the reduced picture, horizontally and vertically.
    pub(crate) fn mcu_px(&self) -> (usize, usize) {
        self.components.first().map_or((1, 1), |first| {
            let (width, height) = first.basis.size;
            (first.blocks.0 * width, first.blocks.1 * height)
        })
    }

    /// Reads an MCU and appends it to `data`, which is left as it was if there is damage.
    pub(crate) fn read_mcu(
        &self,
        bits: &mut Bits<'_>,
        predicted: &mut Predicted,
        data: &mut McuData,
    ) -> Checked<()> {
        let (samples, dcs) = (data.samples.len(), data.dcs.len());
        let result = self.append_mcu(bits, predicted, data);
        if result.is_err() {
            data.samples.truncate(samples);
            data.dcs.truncate(dcs);
        }
        result
    }

    #[inline(always)]
    fn append_mcu(
        &self,
        bits: &mut Bits<'_>,
        predicted: &mut Predicted,
        data: &mut McuData,
    ) -> Checked<()> {
        for (component, predicted) in self.components.iter().zip(predicted) {
            for _ in 0..component.blocks.0 * component.blocks.1 {
                let difference = dc_difference(bits, component.dc)?;
                // Wraps only before damage is found.
                *predicted = predicted.wrapping_add(difference);
                data.dcs.push(*predicted);
                component.append_block(bits, &mut data.samples)?;
            }
        }
        Ok(())
    }
}

impl Component<'_> {
    #[inline(always)]
    fn append_block(&self, bits: &mut Bits<'_>, samples: &mut Vec<i16>) -> Checked<()> {
        match self.basis.samples() {
            2 => self.append_samples::<2>(bits, samples),
            4 => self.append_samples::<4>(bits, samples),
            8 => self.append_samples::<8>(bits, samples),
            16 => self.append_samples::<16>(bits, samples),
            32 => self.append_samples::<32>(bits, samples),
            64 => self.append_samples::<64>(bits, samples),
            _ => {
                // The mean of the block: the DC coefficient alone.
                ac_coefficients(bits, self.ac, |_, _| {})?;
                samples.push(0);
                Ok(())
            }
        }
    }

    #[inline(never)]
    fn append_samples<const N: usize>(
        &self,
        bits: &mut Bits<'_>,
        samples: &mut Vec<i16>,
    ) -> Checked<()> {
        let Some(pictures) = self.basis.pictures::<N>() else {
            return Err(Damage::ScanHeader);
        };
        let mut sums = [0.0f32; N];
        ac_coefficients(bits, self.ac, |index, value| {
            let value = value as f32;
            for (sum, picture) in sums.iter_mut().zip(&pictures[index & 63]) {
                *sum += value * picture;
            }
        })?;
        samples.extend_from_slice(&sums.map(rounded));
        Ok(())
    }
}

/// The nearest whole number, its lowest 16 bits: far faster than a saturating conversion, and samples of undamaged blocks are
/// below 2^15. Adding 1.5 * 2^23 leaves the whole number in the lowest bits of the mantissa.
#[inline(always)]
fn rounded(sample: f32) -> i16 {
    (sample + 12_582_912.0).to_bits() as i16
}
