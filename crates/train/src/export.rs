//! From a checkpoint to a model file: statistics taken anew, whitening fitted and kept where it helps, a card with figures.

use crate::TrainError;
use crate::batch::{Norms, input_of};
use crate::checkpoint::Checkpoint;
use crate::config::TrainConfig;
use crate::data::{Data, Pair, PairOptions, Sources, batch_of};
use crate::network::{Network, Statistics};
use crate::parameters::Parameters;
use crate::trainer::enough;
use crate::validation::{
    Sight, Validation, Validations, extractors_of, features_of, pairs_of, validation_options,
};
use crate::whitening::{PrincipalAxes, WhiteningKind};
use burn::tensor::Device;
use grimnet_net::{Card, Domain, ExtractOptions, Model, NetSpec, Precision};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Batches that the statistics are taken from.
const STATISTICS_BATCHES: u64 = 24;

/// What the exported model is fitted and measured with; each view costs a forward pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExportOptions {
    /// Pairs that the whitening is fitted to, more than it gives values; 0 for no whitening.
    pub whitening_pairs: usize,
    /// Held-aside pairs that are measured.
    pub validation_pairs: usize,
    /// Training views that stand in the gallery beside them.
    pub distractors: usize,
    /// Precision in which the whitening projection is stored: `i8` or `f16`.
    pub whitening_precision: Precision,
}

impl Default for ExportOptions {
    fn default() -> Self {
        Self {
            whitening_pairs: 5000,
            validation_pairs: 240,
            distractors: 300,
            whitening_precision: Precision::I8,
        }
    }
}

/// What was exported.
#[derive(Clone, Debug)]
pub struct Exported {
    /// The model.
    pub model: Model,
    /// Figures of the exported model, by what was kept aside.
    pub validation: Validations,
    /// The whitening that was kept, if one helped.
    pub whitening: Option<WhiteningKind>,
    /// Figures by whitening, the one without first.
    pub tried: Vec<(Option<WhiteningKind>, Validations)>,
}

/// The averaged parameters with normalisation statistics of their own, from training pairs.
///
/// # Errors
/// Where the device does not give values back.
pub fn with_fresh_statistics(
    average: &Parameters,
    sources: &Sources,
    config: &TrainConfig,
    device: &Device,
) -> Result<Parameters, TrainError> {
    let mut parameters = average.clone();
    let device = device.clone().without_autodiff();
    for i in 0..STATISTICS_BATCHES {
        let batch = batch_of(
            sources,
            &config.pairs,
            config.pairs_per_step,
            config.seed ^ 0x57a7,
            i,
        );
        let batch = enough(batch, i)?;
        let input = input_of(&batch, parameters.spec(), config.norms, &device);
        let mut network = Network::new(&parameters, Statistics::Batch);
        network.forward(&input, false)?;
        for (name, value) in network.into_running() {
            parameters.set(&name, value)?;
        }
    }
    if config.norms == Norms::Joint {
        share_map_norms(&mut parameters)?;
    }
    Ok(parameters)
}

/// Gives photos the map's statistics and parameters, the only ones that were trained.
fn share_map_norms(parameters: &mut Parameters) -> Result<(), TrainError> {
    for name in parameters.names() {
        if let Some((layer, part)) = Domain::Sat.norm_of(&name) {
            let value = parameters.flat(&name)?;
            parameters.set(&Domain::Uav.norm_name(layer, part), value)?;
        }
    }
    Ok(())
}

/// VLAD vectors of both views of the pairs: all map views', then all photos'.
fn vectors_of(
    model: &Model,
    pairs: impl Iterator<Item = Pair>,
    on_pair: &mut dyn FnMut(),
) -> Result<Vec<f32>, TrainError> {
    let extractors = extractors_of(model)?;
    let options = ExtractOptions {
        max_keypoints: 1,
        ..ExtractOptions::default()
    };
    let (mut sat, mut uav) = (Vec::new(), Vec::new());
    for pair in pairs {
        let [a, b] = features_of(&pair, &extractors, &options)?;
        sat.extend(a.global);
        uav.extend(b.global);
        on_pair();
    }
    sat.extend(uav);
    Ok(sat)
}

/// Makes the model of a checkpoint, measures it without whitening and with each kind, and keeps what finds places best; tells
/// the share that is done.
///
/// # Errors
/// Where the device does not give values back, or the network refuses its numbers.
pub fn export(
    checkpoint: &Checkpoint,
    config: &TrainConfig,
    data: &Data,
    device: &Device,
    on_progress: &mut dyn FnMut(f64),
) -> Result<Exported, TrainError> {
    let options = &config.export;
    let parameters = with_fresh_statistics(&checkpoint.average, &data.training, config, device)?;
    let card = Card {
        name: format!("grimnet {}", config.network),
        training_data: config
            .data
            .iter()
            .map(|folder| {
                folder
                    .path
                    .file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned()
            })
            .chain(
                config
                    .world_share
                    .gt(&0.0)
                    .then(|| "procedural world".to_owned()),
            )
            .collect::<Vec<_>>()
            .join(", "),
        steps: checkpoint.position.step,
        licence: "MIT OR Apache-2.0".into(),
        notes: String::new(),
        random: false,
    };
    let plain = parameters.to_model(card.clone())?;
    let views = validation_options(&config.pairs);
    let share = |count: usize| count.div_ceil(data.aside.len().max(1));
    let held: Vec<(&str, Vec<Pair>)> = data
        .aside
        .iter()
        .map(|(name, source)| {
            let count = share(options.validation_pairs);
            (*name, pairs_of(source.as_ref(), count, &views, 11))
        })
        .collect();
    let others = options.distractors.div_ceil(2);
    let length = parameters.spec().vlad_len();
    let whitened = config.spec()?.global_len();
    let fitting_pairs = if length > whitened {
        options.whitening_pairs
    } else {
        0
    };
    let measured = held.iter().map(|(_, pairs)| pairs.len()).sum::<usize>();
    let all = measured + others + fitting_pairs;
    let mut done = 0;
    let mut on_pair = || {
        done += 1;
        on_progress(done as f64 / all as f64);
    };
    // The network sees each view once: the kinds of whitening differ in what is made of its descriptors.
    let distractors = vectors_of(
        &plain,
        training_pairs(data, others, &views, config.seed ^ 12),
        &mut on_pair,
    )?;
    let sights = held
        .iter()
        .map(|(_, pairs)| Sight::of(&plain, pairs, &mut on_pair))
        .collect::<Result<Vec<_>, _>>()?;
    let measure = |model: &Model| -> Validations {
        let distractors = model.whitened(distractors.clone());
        let figures = |((name, pairs), sight): (&(&str, Vec<Pair>), &Sight)| {
            let validation = sight.whitened(model).validation(pairs, &distractors);
            ((*name).to_owned(), validation)
        };
        held.iter().zip(&sights).map(figures).collect()
    };
    let mut tried = vec![(None, plain.clone(), measure(&plain))];
    if fitting_pairs > 0 {
        let fitting = training_pairs(data, fitting_pairs, &views, config.seed ^ 13);
        let vectors = vectors_of(&plain, fitting, &mut on_pair)?;
        let axes = PrincipalAxes::of(vectors, length, whitened)?;
        for kind in [WhiteningKind::Pca, WhiteningKind::Pairs] {
            let projection = axes.whitening(whitened, kind)?;
            let spec = NetSpec {
                global_dim: whitened,
                ..parameters.spec().clone()
            };
            let mut values = parameters.to_host()?;
            values.push(("whitening.mean".into(), projection.mean));
            values.push(("whitening.projection".into(), projection.rows));
            let model = Model::from_values(spec, card.clone(), values)?
                .with_whitening_precision(options.whitening_precision)?;
            let validation = measure(&model);
            tried.push((Some(kind), model, validation));
        }
    }
    let score = |all: &[(String, Validation)]| -> f64 {
        all.iter().map(|(_, v)| v.recall[0] + v.recall[1]).sum()
    };
    let mut best = 0;
    for (i, (_, _, validation)) in tried.iter().enumerate() {
        if score(validation) > score(&tried[best].2) {
            best = i;
        }
    }
    let (whitening, model, validation) = tried[best].clone();
    let card = Card {
        notes: notes(checkpoint, config, &validation, whitening),
        ..card
    };
    Ok(Exported {
        model: model.with_card(card),
        validation,
        whitening,
        tried: tried
            .into_iter()
            .map(|(kind, _, validation)| (kind, validation))
            .collect(),
    })
}

/// Training pairs as validation's are made, one group at a time.
fn training_pairs<'a>(
    data: &'a Data,
    count: usize,
    views: &'a PairOptions,
    seed: u64,
) -> impl Iterator<Item = Pair> + 'a {
    (0..count.div_ceil(views.group) as u64)
        .flat_map(move |i| batch_of(&data.training, views, views.group, seed, i))
        .take(count)
}

fn notes(
    checkpoint: &Checkpoint,
    config: &TrainConfig,
    measured: &[(String, Validation)],
    whitening: Option<WhiteningKind>,
) -> String {
    let percent = |share: f64| (share * 100.0).round();
    let mut out = format!(
        "{} steps of {} pairs, {:.0} minutes.",
        checkpoint.position.step,
        config.pairs_per_step,
        checkpoint.position.elapsed_s / 60.0,
    );
    if let Some(path) = &config.start_from {
        // A checkpoint's own name tells nothing; its folder's does.
        let folder = path.parent().and_then(Path::file_name).unwrap_or_default();
        let name = Path::new(folder).join(path.file_name().unwrap_or_default());
        out.push_str(&format!(" Started from {}.", name.display()));
    }
    if config.labels.is_some() {
        out.push_str(" Keypoint labels by homographic adaptation.");
    }
    for (name, v) in measured {
        out.push_str(&format!(
            " On {} pairs of held-aside {name} (made like the training pairs): repeatability {} %, matching score {} %, \
             right matches {} %, homography within 1/3/5 px {}/{}/{} %, place found first / among five of {} views {}/{} %.",
            v.pairs,
            percent(v.repeatability),
            percent(v.matching_score),
            percent(v.match_precision),
            percent(v.homography_accuracy[0]),
            percent(v.homography_accuracy[1]),
            percent(v.homography_accuracy[2]),
            v.gallery,
            percent(v.recall[0]),
            percent(v.recall[1]),
        ));
    }
    out.push_str(match whitening {
        None => " Whitening: none.",
        Some(WhiteningKind::Pca) => " Whitening: PCA.",
        Some(WhiteningKind::Pairs) => " Whitening: learned from pairs.",
    });
    out.push_str(
        " Trained on pictures from above; it does not know oblique views, night, snow or thermal cameras.",
    );
    out
}

/// Writes a model, and makes the folder it goes to; a reader never sees half of it ([`Model::save`]).
///
/// # Errors
/// [`TrainError::Io`], [`TrainError::Net`].
pub fn save_model(model: &Model, path: &Path) -> Result<(), TrainError> {
    if let Some(folder) = path.parent() {
        fs_err::create_dir_all(folder)?;
    }
    Ok(model.save(path)?)
}
