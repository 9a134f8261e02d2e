//! How often pictures kept aside are given their scene class.

use crate::TrainError;
use crate::batch::{Norms, input_of};
use crate::data::Pair;
use crate::network::{Network, Statistics};
use crate::parameters::{Parameters, host};

/// Pairs that go through the network together.
const TOGETHER: usize = 16;

/// The share of views, of both domains, whose class is the likeliest of its data set's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneAccuracy {
    /// Views whose scene is known.
    pub views: usize,
    /// Share of them that is told right, 0 to 1.
    pub share: f64,
}

/// Classifies both views of pairs, normalised by the running statistics.
///
/// # Errors
/// Where the parameters have no classifier, or the device does not give values back.
pub fn scene_accuracy(
    parameters: &Parameters,
    pairs: &[Pair],
    norms: Norms,
) -> Result<SceneAccuracy, TrainError> {
    let device = parameters.device()?;
    let (mut views, mut right) = (0usize, 0usize);
    for pairs in pairs.chunks(TOGETHER) {
        let input = input_of(pairs, parameters.spec(), norms, &device);
        let logits = Network::new(parameters, Statistics::Running).scenes(&input)?;
        let [_, classes] = logits.dims();
        let logits = host(logits)?;
        for (view, scores) in logits.chunks_exact(classes).enumerate() {
            let Some(scene) = &pairs[view % pairs.len()].scene else {
                continue;
            };
            let score = |class: &usize| scores[*class];
            let told = scene
                .among
                .clone()
                .max_by(|a, b| score(a).total_cmp(&score(b)));
            views += 1;
            right += usize::from(told == Some(scene.class));
        }
    }
    Ok(SceneAccuracy {
        views,
        share: right as f64 / views.max(1) as f64,
    })
}
