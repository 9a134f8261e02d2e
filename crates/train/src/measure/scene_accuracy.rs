//! Accuracy of the scene classifier.

use crate::data::Pair;
use crate::error::TrainError;
use crate::model::input::{Norms, input_of};
use crate::model::network::Network;
use crate::model::normalisation::Statistics;
use crate::model::parameters::{Parameters, host};

/// Pairs in a batch.
const TOGETHER: usize = 16;

/// Accuracy over the views of both domains, among the classes of their data set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneAccuracy {
    /// Number of views with a known class.
    pub views: usize,
    /// Share classified correctly, 0 to 1.
    pub share: f64,
}

/// Classifies both views of pairs, normalised by the running statistics.
///
/// # Errors
/// Returns an error if the parameters have no classifier, or values cannot be read from the device.
pub fn scene_accuracy(
    parameters: &Parameters,
    pairs: &[Pair],
    norms: Norms,
) -> Result<SceneAccuracy, TrainError> {
    let device = parameters.device()?;
    let (mut views, mut correct) = (0usize, 0usize);
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
            let predicted = scene
                .among
                .clone()
                .max_by(|a, b| score(a).total_cmp(&score(b)));
            views += 1;
            correct += usize::from(predicted == Some(scene.class));
        }
    }
    Ok(SceneAccuracy {
        views,
        share: correct as f64 / views.max(1) as f64,
    })
}
