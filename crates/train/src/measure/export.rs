//! From a checkpoint to a model file: normalisation statistics are those of the parameters, whitening is fitted, and figures on
//! held-out pairs decide which whitening is kept.

use crate::config::{ExportOptions, TrainConfig, WhiteningChoice};
use crate::data::{Pair, PairOptions, Task, batch_of};
use crate::error::TrainError;
use crate::measure::card::{card_of, notes};
use crate::measure::statistics::with_export_statistics;
use crate::measure::validation::{
    PairOutputs, Validation, Validations, extractors_of, features_of, pairs_of, validation_options,
};
use crate::measure::whitening::{PrincipalAxes, WhiteningKind};
use crate::model::parameters::Parameters;
use crate::run::checkpoint::Checkpoint;
use crate::run::data::Data;
use crate::run::resume::checkpoint_path;
use burn::tensor::Device;
use grimnet_net::{Card, DataType, ExtractOptions, Model, NetSpec};

/// Seed of the held-out pairs.
const HELD_OUT_SEED: u64 = 11;
/// Changes the run's seed for the distractors, and for the pairs that the whitening is fitted to.
const DISTRACTOR_SEED: u64 = 12;
const WHITENING_SEED: u64 = 13;

/// An exported model.
#[derive(Clone, Debug)]
pub struct Exported {
    /// The model.
    pub model: Model,
    /// Its figures, by held-out source.
    pub validation: Validations,
    /// The whitening that was kept; `None` if the model is better without.
    pub whitening: Option<WhiteningKind>,
    /// Figures with each kind of whitening, starting with none.
    pub candidates: Vec<(Option<WhiteningKind>, Validations)>,
}

/// A model with its whitening and figures.
type Candidate = (Option<WhiteningKind>, Model, Validations);

/// VLAD vectors of both views of the pairs: all map views first, then all photos.
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

/// Held-out pairs of each source, with the outputs of the model without whitening.
struct HeldOutPairs<'a> {
    sources: Vec<(&'a str, Vec<Pair>)>,
    outputs: Vec<PairOutputs>,
    /// VLAD vectors of the distractors.
    distractors: Vec<f32>,
}

impl HeldOutPairs<'_> {
    /// Figures of a model that differs from the one that was run in its whitening only.
    fn measure(&self, model: &Model) -> Validations {
        let distractors = model.whitened(self.distractors.clone());
        let figures = |((name, pairs), outputs): (&(&str, Vec<Pair>), &PairOutputs)| {
            let validation = outputs.whitened(model).validation(pairs, &distractors);
            ((*name).to_owned(), validation)
        };
        self.sources
            .iter()
            .zip(&self.outputs)
            .map(figures)
            .collect()
    }
}

/// Makes the model of a checkpoint, measures it without whitening and with each kind, and keeps the one that
/// [`ExportOptions::whitening`] asks for: the one with the highest recall, or PCA. `on_progress` gets the share of the work that is done.
///
/// # Errors
/// [`TrainError::Checkpoint`] if NetVLAD was not initialised yet; an error if values cannot be read from the device, or the network
/// cannot be run.
pub fn export(
    checkpoint: &Checkpoint,
    config: &TrainConfig,
    data: &Data,
    device: &Device,
    on_progress: &mut dyn FnMut(f64),
) -> Result<Exported, TrainError> {
    if !checkpoint.position.centres_started {
        return Err(TrainError::Checkpoint {
            path: checkpoint_path(config),
            reason: format!(
                "after {} steps NetVLAD is still random: it is initialised when the share `global_from` = {} of the run is over; resume the run, with more `steps` or `minutes` if it has ended",
                checkpoint.position.step, config.global_from
            ),
        });
    }
    let options = &config.export;
    let parameters = with_export_statistics(&checkpoint.average, &data.training, config, device)?;
    let card = card_of(checkpoint, config);
    let plain = parameters.to_model(card.clone())?;
    let views = validation_options(&config.pairs);
    let held_out = held_out_pairs(data, options, &views);
    let others = options.distractors.div_ceil(2);
    let whitened = config.spec()?.global_len();
    let fitting_pairs = if parameters.spec().vlad_len() > whitened {
        options.whitening_pairs
    } else {
        0
    };
    let measured = held_out.iter().map(|(_, pairs)| pairs.len()).sum::<usize>();
    let all = measured + others + fitting_pairs;
    let mut done = 0;
    let mut on_pair = || {
        done += 1;
        on_progress(done as f64 / all as f64);
    };
    // The network runs once on each view; the kinds of whitening only transform its descriptors.
    let distractors = training_pairs(data, others, &views, config.seed ^ DISTRACTOR_SEED);
    let distractors = vectors_of(&plain, distractors, &mut on_pair)?;
    let outputs = held_out
        .iter()
        .map(|(_, pairs)| PairOutputs::of(&plain, pairs, &mut on_pair))
        .collect::<Result<Vec<_>, _>>()?;
    let held_out = HeldOutPairs {
        sources: held_out,
        outputs,
        distractors,
    };
    let mut candidates = vec![(None, plain.clone(), held_out.measure(&plain))];
    let kinds: &[WhiteningKind] = match options.whitening {
        WhiteningChoice::Measured => &[WhiteningKind::Pca, WhiteningKind::Pairs],
        WhiteningChoice::Pca => &[WhiteningKind::Pca],
    };
    if fitting_pairs > 0 {
        let fitting = training_pairs(data, fitting_pairs, &views, config.seed ^ WHITENING_SEED);
        let vectors = vectors_of(&plain, fitting, &mut on_pair)?;
        let precision = options.whitening_precision;
        let models = whitened_models(&parameters, &card, vectors, whitened, kinds, precision)?;
        for (kind, model) in models {
            let figures = held_out.measure(&model);
            candidates.push((Some(kind), model, figures));
        }
    }
    Ok(chosen(candidates, checkpoint, config, &card))
}

/// Held-out pairs of each source, `options.validation_pairs` together.
fn held_out_pairs<'a>(
    data: &'a Data,
    options: &ExportOptions,
    views: &PairOptions,
) -> Vec<(&'a str, Vec<Pair>)> {
    let count = options
        .validation_pairs
        .div_ceil(data.held_out.len().max(1));
    data.held_out
        .iter()
        .map(|(name, source)| {
            let pairs = pairs_of(source.as_ref(), count, views, HELD_OUT_SEED);
            (*name, pairs)
        })
        .collect()
}

/// The model with each kind of whitening, fitted to VLAD vectors as [`vectors_of`] gives them.
fn whitened_models(
    parameters: &Parameters,
    card: &Card,
    vectors: Vec<f32>,
    whitened: usize,
    kinds: &[WhiteningKind],
    precision: DataType,
) -> Result<Vec<(WhiteningKind, Model)>, TrainError> {
    let axes = PrincipalAxes::of(vectors, parameters.spec().vlad_len(), whitened)?;
    let mut out = Vec::new();
    for &kind in kinds {
        let projection = axes.whitening(whitened, kind)?;
        let spec = NetSpec {
            global_dim: whitened,
            ..parameters.spec().clone()
        };
        let mut values = parameters.to_host()?;
        values.push(("whitening.mean".into(), projection.mean));
        values.push(("whitening.projection".into(), projection.rows));
        let model =
            Model::from_values(spec, card.clone(), values)?.with_whitening_precision(precision)?;
        out.push((kind, model));
    }
    Ok(out)
}

/// The candidate with the highest recall, the first of equals; or the one with PCA whitening, if that is what the options ask for.
fn chosen(
    candidates: Vec<Candidate>,
    checkpoint: &Checkpoint,
    config: &TrainConfig,
    card: &Card,
) -> Exported {
    let score = |all: &[(String, Validation)]| -> f64 {
        all.iter().map(|(_, v)| v.recall[0] + v.recall[1]).sum()
    };
    let measured: usize = candidates[0].2.iter().map(|(_, v)| v.pairs).sum();
    let mut best = 0;
    if measured == 0 && candidates.len() > 1 {
        best = 1;
        tracing::warn!(
            "no picture is held out, so that the kinds of whitening cannot be compared: the model is whitened by principal components"
        );
    }
    for (i, (_, _, validation)) in candidates.iter().enumerate() {
        let is_better = match config.export.whitening {
            WhiteningChoice::Measured => score(validation) > score(&candidates[best].2),
            WhiteningChoice::Pca => candidates[i].0 == Some(WhiteningKind::Pca),
        };
        if is_better {
            best = i;
        }
    }
    let (whitening, model, validation) = candidates[best].clone();
    let card = Card {
        notes: notes(checkpoint, config, &validation, whitening),
        ..card.clone()
    };
    Exported {
        model: model.with_card(card),
        validation,
        whitening,
        candidates: candidates
            .into_iter()
            .map(|(kind, _, validation)| (kind, validation))
            .collect(),
    }
}

/// Training pairs with the options of validation, made one group at a time.
fn training_pairs<'a>(
    data: &'a Data,
    count: usize,
    views: &'a PairOptions,
    seed: u64,
) -> impl Iterator<Item = Pair> + 'a {
    (0..count.div_ceil(views.group) as u64)
        .flat_map(move |i| {
            batch_of(
                &data.training,
                Some(Task::Retrieval),
                views,
                views.group,
                seed,
                i,
            )
        })
        .take(count)
}
