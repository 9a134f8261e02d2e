//! `grim eval --elsewhere`: photos that are not on the map must get no fix.

use std::collections::HashSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{ArgGroup, Args};
use grimnet_eval::elsewhere::{self, ElsewhereTrial, Source};
use grimnet_eval::elsewhere_summary::{ElsewhereSummary, Group};
use grimnet_geo::Raster;
use grimnet_locate::Localizer;
use grimnet_net::Precision;
use grimnet_output::OutputFolder;
use grimnet_pack::Mode;
use grimnet_photo::PhotoLimits;
use grimnet_photo::pictures::{file_name, picture_files_below};
use serde::Serialize;

use crate::exit::Exit;
use crate::standard_output::StandardOutput;
use crate::{progress, values};

/// Files in the folder of results.
pub const FILES: [&str; 2] = ["elsewhere.json", "elsewhere.csv"];

/// Heading of these options in the help.
const ELSEWHERE: &str = "Photos that are not on the map";

/// Group of the options that name folders of pictures: other options need one of them, or cannot be used with them.
pub const ELSEWHERE_FOLDERS: &str = "elsewhere_folders";

/// Which pictures are localised on a map that does not show them.
#[derive(Debug, Clone, Args)]
#[command(group = ArgGroup::new(ELSEWHERE_FOLDERS).args(["elsewhere", "elsewhere_trained"]).multiple(true))]
pub struct ElsewhereOptions {
    /// Localise the pictures in these folders, which must not show any place of the map, and count fixes
    ///
    /// Ground widths are drawn log-uniformly from a tenth of the map's width to twice its width; photos with a ground width in
    /// their metadata are also tried with that. Half of the trials have an unknown heading. The map is that of FOLDER, or --map.
    #[arg(long, value_name = "FOLDER", num_args = 1.., help_heading = ELSEWHERE)]
    pub elsewhere: Vec<PathBuf>,

    /// The same for folders of pictures that the model was trained on; they are counted apart
    #[arg(long, value_name = "FOLDER", num_args = 1.., help_heading = ELSEWHERE)]
    pub elsewhere_trained: Vec<PathBuf>,

    /// Trials per folder
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = values::count, requires = ELSEWHERE_FOLDERS, help_heading = ELSEWHERE)]
    pub elsewhere_trials: usize,

    /// Give neither a ground width nor a heading, and ignore the pictures' metadata: the hardest search, and the slowest
    #[arg(long, requires = ELSEWHERE_FOLDERS, help_heading = ELSEWHERE)]
    pub elsewhere_nothing_given: bool,

    /// Seed of ground widths and headings
    #[arg(long, value_name = "N", default_value_t = 1, requires = ELSEWHERE_FOLDERS, help_heading = ELSEWHERE)]
    pub elsewhere_seed: u64,
}

impl ElsewhereOptions {
    /// Returns whether any folder was given.
    pub fn is_asked(&self) -> bool {
        !(self.elsewhere.is_empty() && self.elsewhere_trained.is_empty())
    }

    /// The pictures of each folder.
    ///
    /// # Errors
    /// As [`sources`].
    pub fn sources(&self) -> Result<Vec<Source>> {
        let untrained = self.elsewhere.iter().map(|folder| (folder, false));
        let trained = self.elsewhere_trained.iter().map(|folder| (folder, true));
        sources(&untrained.chain(trained).collect::<Vec<_>>())
    }
}

/// The pictures of folders, each with whether the model was trained on them. Folders are named by their last part, those that share it
/// by their whole path.
///
/// # Errors
/// As [`pictures`], or a folder is given more than once: its pictures would count as so many others.
pub fn sources(folders: &[(&PathBuf, bool)]) -> Result<Vec<Source>> {
    let mut places = HashSet::new();
    for (folder, _) in folders {
        // One that cannot be read is named where its pictures are looked for.
        let place = fs_err::canonicalize(folder).unwrap_or_else(|_| (*folder).clone());
        if !places.insert(place) {
            bail!("{}: given more than once", folder.display());
        }
    }
    let names: Vec<String> = folders.iter().map(|(path, _)| file_name(path)).collect();
    let is_alone = |name: &String| names.iter().filter(|other| *other == name).count() == 1;
    let source = |(&(folder, trained_on), name): (&(&PathBuf, bool), &String)| {
        let name = if is_alone(name) {
            name.clone()
        } else {
            folder.display().to_string()
        };
        Ok(Source {
            name,
            folder: folder.clone(),
            pictures: pictures(folder)?,
            trained_on,
        })
    };
    folders.iter().zip(&names).map(source).collect()
}

/// The pictures in a folder and below it.
///
/// # Errors
/// The folder cannot be read or has no pictures.
pub fn pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    let pictures = picture_files_below(folder)?;
    if pictures.is_empty() {
        bail!("{}: no pictures", folder.display());
    }
    Ok(pictures)
}

/// Runs the trials on a map, writes `elsewhere.json` and `elsewhere.csv` and prints the figures.
///
/// # Errors
/// No picture can be read; results that cannot be written.
pub fn run(
    options: &ElsewhereOptions,
    sources: &[Source],
    map: &dyn Raster,
    localizer: &Localizer,
    folder: &OutputFolder,
    photo_limits: PhotoLimits,
) -> Result<Exit> {
    let total = options.elsewhere_trials * sources.len();
    let bar = progress::bar(total as u64, "localising", "trials");
    let settings = elsewhere::ElsewhereOptions {
        trials: options.elsewhere_trials,
        seed: options.elsewhere_seed,
        map_width_m: width_m(map)?,
        nothing_given: options.elsewhere_nothing_given,
        photo_limits,
    };
    let trials = elsewhere::run(localizer, sources, &settings, &mut |_| bar.inc(1));
    bar.finish_and_clear();
    // No fix among no trials says nothing of the map.
    if trials.is_empty() {
        bail!("none of the pictures that are not on the map can be read");
    }
    let summary = ElsewhereSummary::of(&trials);
    let [json, csv] = FILES;
    let results = Results {
        about: about(&settings, localizer),
        summary: &summary,
    };
    let text = serde_json::to_string_pretty(&results)? + "\n";
    folder.write_bytes(json, text.as_bytes())?;
    folder.write_bytes(csv, &trials_csv(&trials)?)?;
    print(&summary)?;
    Ok(Exit::Done)
}

/// What `elsewhere.json` holds.
#[derive(Serialize)]
struct Results<'a> {
    about: About,
    #[serde(flatten)]
    summary: &'a ElsewhereSummary,
}

/// Conditions of the trials.
#[derive(Serialize)]
struct About {
    /// What the map is.
    map: String,
    map_width_m: f64,
    mode: Mode,
    model_hash: String,
    precision: Precision,
    /// Least confidence of a fix, if given; otherwise that of the model's calibration.
    min_confidence: Option<f64>,
    seed: u64,
    trials_of_each_folder: usize,
    /// Whether neither heading nor ground width was given.
    nothing_given: bool,
    version: &'static str,
}

fn about(settings: &elsewhere::ElsewhereOptions, localizer: &Localizer) -> About {
    let (manifest, model) = (localizer.pack().manifest(), localizer.model());
    let options = localizer.options();
    About {
        map: manifest.map.description.clone(),
        map_width_m: settings.map_width_m,
        mode: options.mode,
        model_hash: model.hash().to_string(),
        // Not that of the pack, which may have been built in another.
        precision: model.precision(),
        min_confidence: options.gates.and_then(|gates| gates.min_confidence),
        seed: settings.seed,
        trials_of_each_folder: settings.trials,
        nothing_given: settings.nothing_given,
        version: env!("CARGO_PKG_VERSION"),
    }
}

/// Width of a map, metres, from the ground resolution in its middle.
pub fn width_m(map: &dyn Raster) -> Result<f64> {
    let georeference = map.georeference();
    let (x_m, _) = georeference.ground_resolution_m(georeference.centre_px())?;
    Ok(map.size_px().0 as f64 * x_m)
}

fn trials_csv(trials: &[ElsewhereTrial]) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for trial in trials {
        writer.serialize(trial)?;
    }
    Ok(writer.into_inner()?)
}

fn print(summary: &ElsewhereSummary) -> Result<()> {
    let mut out = StandardOutput;
    writeln!(
        out,
        "{:<78}{:>8}{:>10}{:>8}{:>12}{:>18}",
        "photos that are not on the map", "trials", "pictures", "fixes", "share", "95 % interval"
    )?;
    let groups = [
        &summary.by_training,
        &summary.by_setting,
        &summary.by_source,
    ];
    for group in std::iter::once(&summary.all).chain(groups.into_iter().flatten()) {
        writeln!(out, "{}", line(group))?;
    }
    writeln!(out, "\nreasons of trials without a fix")?;
    for (reason, count) in &summary.reasons {
        writeln!(out, "{count:>8}  {reason}")?;
    }
    Ok(())
}

fn line(group: &Group) -> String {
    let [low, high] = group.share_interval.map(|share| 100.0 * share);
    format!(
        "{:<78}{:>8}{:>10}{:>8}{:>12}{:>18}",
        group.name,
        group.trials,
        group.pictures,
        group.fixes,
        format!("{:.2} %", 100.0 * group.share),
        format!("{low:.2}-{high:.2} %")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_one_name_are_told_apart_by_their_paths() {
        let root = tempfile::tempdir().unwrap();
        let folders = ["a/photos", "b/photos", "c/coast"].map(|name| root.path().join(name));
        for folder in &folders {
            fs_err::create_dir_all(folder).unwrap();
            fs_err::write(folder.join("DJI_0001.jpg"), "").unwrap();
        }
        let given: Vec<(&PathBuf, bool)> = folders.iter().map(|folder| (folder, false)).collect();
        let names: Vec<String> = sources(&given)
            .unwrap()
            .into_iter()
            .map(|s| s.name)
            .collect();
        let [a, b, _] = folders.map(|folder| folder.display().to_string());
        assert_eq!(names, [a, b, "coast".to_owned()]);
    }

    #[test]
    fn a_folder_counts_once() {
        let root = tempfile::tempdir().unwrap();
        let coast = root.path().join("coast");
        fs_err::create_dir(&coast).unwrap();
        fs_err::write(coast.join("DJI_0001.jpg"), "").unwrap();
        let again = root.path().join("coast/../coast");
        let error = sources(&[(&coast, false), (&again, true)]).unwrap_err();
        assert!(error.to_string().contains("more than once"), "{error}");
    }
}
