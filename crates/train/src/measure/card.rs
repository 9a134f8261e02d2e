//! The card of an exported model.

use crate::config::TrainConfig;
use crate::measure::validation::Validations;
use crate::measure::whitening::WhiteningKind;
use crate::run::checkpoint::Checkpoint;
use grimnet_net::Card;
use std::path::Path;

/// The card without notes.
pub(super) fn card_of(checkpoint: &Checkpoint, config: &TrainConfig) -> Card {
    let name_of = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    let folders = config.data.iter().map(|folder| name_of(&folder.path));
    let worlds = (config.world_share > 0.0).then(|| "procedural world".to_owned());
    Card {
        name: format!("grimnet {}", config.network),
        training_data: folders.chain(worlds).collect::<Vec<_>>().join(", "),
        steps: checkpoint.position.step,
        licence: config.export.licence.clone(),
        notes: String::new(),
        random: false,
    }
}

/// How the model was trained, its figures on held-out pairs, and its whitening.
pub(super) fn notes(
    checkpoint: &Checkpoint,
    config: &TrainConfig,
    measured: &Validations,
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
        // Checkpoints all have the same name, so the folder is named, too.
        let folder = path.parent().and_then(Path::file_name).unwrap_or_default();
        let name = Path::new(folder).join(path.file_name().unwrap_or_default());
        out.push_str(&format!(" Started from {}.", name.display()));
    }
    if config.labels.is_some() {
        out.push_str(" Keypoint labels by homographic adaptation.");
    }
    for (name, v) in measured {
        out.push_str(&format!(
            " On {} held-out pairs ({name}; made like the training pairs):",
            v.pairs
        ));
        if let Some(m) = &v.matching {
            out.push_str(&format!(
                " repeatability {} %, matching score {} %, correct matches {} %, homography within 1/3/5 px {}/{}/{} %,",
                percent(m.repeatability),
                percent(m.matching_score),
                percent(m.match_precision),
                percent(m.homography_accuracy[0]),
                percent(m.homography_accuracy[1]),
                percent(m.homography_accuracy[2]),
            ));
        }
        out.push_str(&format!(
            " recall@1/@5 among {} views {}/{} %.",
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
    // Looks are all that the configuration says of these.
    let snow = if config.pairs.look.snow > 0.0 {
        ""
    } else {
        "snow, "
    };
    out.push_str(&format!(
        " Trained on nadir pictures; not trained on oblique views, {snow}night or thermal cameras."
    ));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::parameters::Parameters;
    use crate::run::checkpoint::Position;
    use crate::run::optimiser::Adam;
    use burn::tensor::Device;
    use grimnet_net::{Model, NetSpec};

    fn untrained() -> Checkpoint {
        let model = Model::random(&NetSpec::compact(), 1).unwrap();
        let parameters = Parameters::of_model(&model, &Device::flex());
        Checkpoint {
            average: parameters.clone(),
            parameters,
            adam: Adam::default(),
            position: Position::default(),
            config: None,
        }
    }

    #[test]
    fn the_licence_is_that_of_the_configuration() {
        let mut config = TrainConfig::default();
        let licence = |config: &TrainConfig| card_of(&untrained(), config).licence;
        assert_eq!(licence(&config), "not stated");
        config.export.licence = "CC-BY-4.0".to_owned();
        assert_eq!(licence(&config), "CC-BY-4.0");
    }

    #[test]
    fn a_network_that_was_trained_under_snow_does_not_deny_it() {
        let state = untrained();
        let mut config = TrainConfig::default();
        let of = |config: &TrainConfig| notes(&state, config, &Validations::new(), None);
        assert!(of(&config).contains("not trained on oblique views, snow, night"));
        config.pairs.look.snow = 0.08;
        assert!(of(&config).contains("not trained on oblique views, night"));
    }
}
