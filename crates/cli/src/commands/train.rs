//! `grim train`: only in builds with the trainer.

mod arguments;
#[cfg(feature = "train")]
mod flight_log;
#[cfg(feature = "train")]
mod labels;
#[cfg(feature = "train")]
mod session;
#[cfg(feature = "train")]
mod share_bar;
#[cfg(feature = "train")]
mod validation_log;

pub use arguments::TrainArgs;

/// Runs the command.
///
/// # Errors
/// Returns an error if the configuration, the data or a checkpoint cannot be used, or a loss is not finite.
#[cfg(feature = "train")]
pub fn run(arguments: &TrainArgs) -> anyhow::Result<crate::exit::Exit> {
    use anyhow::Context as _;
    use grimnet_train::{TrainConfig, TrainError};

    let path = arguments.config.as_deref().context(
        "a configuration file is missing, as in: grim train training.toml (see TRAINING.md)",
    )?;
    crate::inputs::check_regular(path)?;
    let mut config = TrainConfig::open(path)?;
    config.photo_limits = arguments.limits.photo();
    if arguments.labels {
        return labels::run(path, &config);
    }
    session::run(path, &config, arguments).map_err(|error| {
        match error.downcast::<TrainError>() {
            // As such it gets the hint of all outputs.
            Ok(TrainError::Output(error)) => error.into(),
            Ok(error @ TrainError::Labels { .. }) => anyhow::Error::from(error).context(format!(
                "label the pictures with: grim train {} --labels",
                path.display()
            )),
            Ok(error @ TrainError::EarlierRun { .. }) => {
                anyhow::Error::from(error).context(format!(
                    "resume with: grim train {} --resume; or replace that run with --overwrite",
                    path.display()
                ))
            }
            Ok(error) => error.into(),
            Err(error) => error,
        }
    })
}

/// Says how to get the trainer.
///
/// # Errors
/// Always: this build has none.
#[cfg(not(feature = "train"))]
pub fn run(_: &TrainArgs) -> anyhow::Result<crate::exit::Exit> {
    anyhow::bail!(super::absent::message("grim train", "train"))
}
