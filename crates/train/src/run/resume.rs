//! The checkpoint that a run goes on from: it must be one of the same run.

use crate::config::{Changes, Stage, TrainConfig};
use crate::data::Sources;
use crate::error::TrainError;
use crate::model::parameters::Parameters;
use crate::run::checkpoint::{CHECKPOINT, Checkpoint};
use burn::tensor::Device;
use grimnet_net::Model;
use std::path::PathBuf;

/// The checkpoint file of a run.
pub fn checkpoint_path(config: &TrainConfig) -> PathBuf {
    config.out.join(CHECKPOINT)
}

/// The last checkpoint of the run of a configuration. A changed schedule is reported as a warning and recorded in the result, as are
/// settings without effect on the parameters. Checkpoints of versions that did not record their settings are not compared.
///
/// # Errors
/// [`TrainError::Checkpoint`] if there is none, or it is of another network, another stage or a run with other settings.
pub fn last_checkpoint(
    config: &TrainConfig,
    sources: &Sources,
    device: &Device,
) -> Result<Checkpoint, TrainError> {
    let scenes = scenes_of(config, sources)?;
    let path = checkpoint_path(config);
    let mut state = Checkpoint::open(&path, device)?;
    let wanted = Parameters::of_model(&Model::random(&config.spec()?, 0)?, device);
    let other = |reason: String| Err(TrainError::Checkpoint { path, reason });
    if state.parameters.spec() != wanted.spec() {
        let network = &config.network;
        return other(format!(
            "it contains another network than `{network}`; set another `out` folder"
        ));
    }
    let (theirs, ours) = (state.position.stage, config.stage);
    if theirs != ours {
        return other(format!(
            "it belongs to the stage `{theirs}`, not `{ours}`; use one `out` folder for each stage, and this file as `start_from` of the next stage"
        ));
    }
    let known = state.parameters.scenes();
    if known != scenes {
        return other(format!(
            "it has {known} scene classes, and the data have {scenes}; use the original data, or start a new run"
        ));
    }
    match &state.config {
        None => tracing::warn!(
            "the checkpoint is of an earlier version, without settings: make sure that the configuration is that of its run"
        ),
        Some(earlier) => {
            let changes = Changes::between(earlier, config)?;
            if !changes.others.is_empty() {
                return other(format!(
                    "it belongs to a run with other settings: {}; restore them, or start a new run in another `out` folder, with this file as `start_from`",
                    changes.others.join("; ")
                ));
            }
            for change in changes.schedule {
                tracing::warn!("the schedule changes: {change}");
            }
        }
    }
    state.config = Some(config.clone());
    Ok(state)
}

/// Number of scene classes.
///
/// # Errors
/// [`TrainError::Config`] if scenes are to be trained, and the data have none.
pub(super) fn scenes_of(config: &TrainConfig, sources: &Sources) -> Result<usize, TrainError> {
    if config.stage != Stage::Scenes {
        return Ok(0);
    }
    let counts = sources.iter().map(|one| one.source.scenes());
    match counts.max() {
        Some(count) if count > 1 => Ok(count),
        _ => Err(TrainError::Config {
            reason: "`stage = \"scenes\"` needs a `[[data]]` folder with `layout = \"classes\"`"
                .into(),
        }),
    }
}
