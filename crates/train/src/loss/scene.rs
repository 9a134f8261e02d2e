//! Cross-entropy over scene classes, for pre-training the encoder.

use super::{MASKED, constant};
use crate::data::Scene;
use burn::tensor::activation::log_softmax;
use burn::tensor::{Int, Tensor, TensorData};

/// Mean of `-log p[class]` over the pictures with a known class, where `p` is the softmax over the classes of the picture's data
/// set; 0 if no class is known.
///
/// # Shapes
/// `logits` `[pictures, classes]`; `scenes` of `pictures` values. A scalar.
pub fn scene_cross_entropy(logits: Tensor<2>, scenes: &[Option<&Scene>]) -> Tensor<1> {
    let device = logits.device();
    let [pictures, classes] = logits.dims();
    let known = scenes.iter().flatten().count().max(1) as f32;
    let barred = scenes.iter().flat_map(|scene| {
        let open = scene.map_or(0..classes, |scene| scene.among.clone());
        (0..classes).map(move |class| if open.contains(&class) { 0.0 } else { MASKED })
    });
    let barred = constant(barred.collect(), [pictures, classes], &device);
    let labels = scenes
        .iter()
        .map(|scene| scene.map_or(0, |scene| i32::try_from(scene.class).unwrap_or(i32::MAX)));
    let labels = TensorData::new(labels.collect(), [pictures, 1]);
    let weights = scenes
        .iter()
        .map(|scene| scene.map_or(0.0, |_| -1.0 / known));
    let weights = constant(weights.collect(), [pictures, 1], &device);
    let picked =
        log_softmax(logits + barred, 1).gather(1, Tensor::<2, Int>::from_data(labels, &device));
    (picked * weights).sum()
}
