//! `grim calibrate`: fit the stated radius and confidence of a model.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use grimnet_eval::calibration::confidence::ELSEWHERE_ANSWERED;
use grimnet_eval::calibration::{self, observation, scenes, trial};
use grimnet_net::Model;

use super::ModelChoice;
use crate::exit::Exit;
use crate::outputs::OverwriteChoice;
use crate::{progress, values};

/// Arguments of `grim calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    #[command(flatten)]
    model: ModelChoice,

    /// Write the model with its calibration to this file
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    /// Procedural worlds to fly over
    #[arg(long, value_name = "N", default_value_t = 10)]
    worlds: usize,

    /// Photos of each world or folder
    #[arg(long, value_name = "N", default_value_t = 24)]
    photos: usize,

    /// Seed of the first world
    #[arg(long, default_value_t = 1000)]
    seed: u64,

    /// Folders of nadir pictures from which photos are cut, such as pictures that the model was trained on
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pictures: Vec<PathBuf>,

    /// Assumed ground resolution of the pictures, metres per pixel
    #[arg(long, value_name = "M", default_value_t = 0.15, value_parser = values::gsd_m, allow_hyphen_values = true)]
    pictures_gsd: f64,

    /// Share of photos taken elsewhere that may get a fix; a smaller share costs right fixes
    #[arg(long, value_name = "SHARE", default_value_t = ELSEWHERE_ANSWERED, value_parser = values::inner_share, allow_hyphen_values = true)]
    elsewhere_answered: f64,

    /// Also write the observations, one line per photo
    #[arg(long, value_name = "FILE.csv")]
    observations: Option<PathBuf>,

    /// Fit to the observations of an earlier run with the same model
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["observations", "pictures"])]
    observed: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Unreadable model or pictures, too few right answers to fit anything, a file that cannot be written.
pub fn run(arguments: &CalibrateArgs) -> Result<Exit> {
    let policy = arguments
        .overwrite
        .policy()
        .protect_all(&arguments.model.model)
        .protect_all(&arguments.observed);
    policy.check_file(&arguments.out, &[])?;
    if let Some(path) = &arguments.observations {
        policy.check_file(path, &[])?;
    }
    let model = arguments.model.open()?;
    let (observations, data) = match &arguments.observed {
        Some(path) => (
            observation::read(path).with_context(|| format!("cannot read {}", path.display()))?,
            format!("observations of an earlier run ({})", path.display()),
        ),
        None => observe(arguments, &model)?,
    };
    if let Some(path) = &arguments.observations {
        observation::write(path, &observations)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    let calibration = calibration::fit(&observations, &data, arguments.elsewhere_answered)?;
    model
        .with_calibration(calibration.clone())?
        .save(&arguments.out)?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{}", serde_json::to_string_pretty(&calibration)?)?;
    writeln!(
        out,
        "{}: written; the identity of the model does not change and its packs stay valid",
        arguments.out.display()
    )?;
    Ok(Exit::Done)
}

/// Makes the scenes and localises their photos.
fn observe(
    arguments: &CalibrateArgs,
    model: &Model,
) -> Result<(Vec<observation::Observation>, String)> {
    if arguments.worlds + arguments.pictures.len() < 2 {
        bail!(
            "at least two worlds or folders of pictures are required: photos of one are localised on the map of the other"
        );
    }
    let folder = tempfile::tempdir()?;
    let bar = progress::bar(
        (arguments.worlds + arguments.pictures.len()) as u64,
        "drawing maps and photos",
        "scenes",
    );
    let mut made = Vec::new();
    for seed in (arguments.seed..).take(arguments.worlds) {
        made.push(scenes::world(seed, arguments.photos, folder.path())?);
        bar.inc(1);
    }
    for (seed, pictures) in (0..).zip(&arguments.pictures) {
        made.push(scenes::pictures(
            pictures,
            arguments.pictures_gsd,
            arguments.photos,
            seed,
            folder.path(),
        )?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let bar = progress::bar(trial::count(&made) as u64, "localising", "photos");
    let observations = trial::observe(model, &made, folder.path(), &mut || bar.inc(1))?;
    bar.finish_and_clear();
    let names: Vec<&str> = made.iter().map(|scene| scene.name.as_str()).collect();
    let data = format!(
        "{} photos each of: {}; every photo also localised on the map of another",
        arguments.photos,
        names.join(", ")
    );
    Ok((observations, data))
}
