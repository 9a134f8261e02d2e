//! Which layer of a small encoder each layer of a larger one starts from.

use grimnet_net::{Downsample, NetSpec};

/// Initial weights of a convolution of the large encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Start {
    /// Those of a convolution of the small encoder, (stage, layer).
    Copied(usize, usize),
    /// The identity.
    PassedOn,
}

/// A convolution of the large encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layer {
    pub(super) start: Start,
    /// Numbers of input and output channels that have the values of the small encoder.
    pub(super) known: [usize; 2],
    /// Number of all input channels.
    pub(super) inputs: usize,
}

/// For each stage of `large` the initial weights of its convolutions; `None` if `small` does not fit into it.
///
/// Layers keep their resolution. If the small encoder downsamples by stride and the large one by max pooling at the end of
/// a stage, a stage takes the small encoder's layers after the previous downsampling and then the layer that downsamples.
/// The small encoder's layers after its last downsampling are dropped then.
pub(super) fn plan(small: &NetSpec, large: &NetSpec) -> Option<Vec<Vec<Layer>>> {
    let (mut known, mut inputs) = (3, 3);
    // Layers after a downsampling, which have the resolution of the next stage.
    let mut after = Vec::new();
    let mut out = Vec::new();
    for (s, (from, to)) in small.stages.iter().zip(&large.stages).enumerate() {
        let mut own = (0..from.widths.len()).map(|layer| Start::Copied(s, layer));
        let mut starts = std::mem::take(&mut after);
        match (from.downsample, to.downsample) {
            (Downsample::StrideFirst, Downsample::MaxPoolLast) => {
                starts.extend(own.next());
                after = own.collect();
            }
            (from_halves, to_halves) if from_halves == to_halves => starts.extend(own),
            _ => return None,
        }
        if starts.len() > to.widths.len() {
            return None;
        }
        starts.resize(to.widths.len(), Start::PassedOn);
        let mut layers = Vec::new();
        for (start, &width) in starts.into_iter().zip(&to.widths) {
            let outputs = match start {
                Start::Copied(stage, layer) => small.stages[stage].widths[layer],
                Start::PassedOn => known,
            };
            if outputs > width {
                return None;
            }
            layers.push(Layer {
                start,
                known: [known, outputs],
                inputs,
            });
            (known, inputs) = (outputs, width);
        }
        out.push(layers);
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vgg16_has_room_for_compact_and_compact_none_for_vgg16() {
        let plan_of = plan(&NetSpec::compact(), &NetSpec::vgg16()).unwrap();
        let starts = |stage: usize| plan_of[stage].iter().map(|layer| layer.start);
        use Start::{Copied, PassedOn};
        assert!(starts(0).eq([Copied(0, 0), PassedOn]));
        assert!(starts(1).eq([Copied(0, 1), Copied(1, 0)]));
        assert!(starts(2).eq([Copied(1, 1), Copied(2, 0), PassedOn]));
        assert!(starts(4).eq([Copied(3, 1), Copied(4, 0), PassedOn]));
        assert_eq!(plan_of[2][0].known, [48, 48]);
        assert_eq!(plan_of[2][0].inputs, 128);
        assert_eq!(plan(&NetSpec::vgg16(), &NetSpec::compact()), None);
        assert!(plan(&NetSpec::vgg16_lateral(), &NetSpec::vgg16()).is_some());
    }
}
