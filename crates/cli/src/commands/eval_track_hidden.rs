//! `grim eval --track FOLDER`: hidden fixes of a real flight.

use std::io::Write;

use anyhow::Result;
use grimnet_eval::metrics::statistics::percentile;
use grimnet_eval::scene::Scene;
use grimnet_eval::tracks::about::TrackAbout;
use grimnet_eval::tracks::hidden::{TimedShot, predict_hidden};
use grimnet_eval::tracks::hidden_figures::figures;
use grimnet_eval::tracks::hidden_results::{HIDDEN_FILES, hidden_files};
use grimnet_locate::Localizer;
use grimnet_output::OutputFolder;
use grimnet_photo::Photo;
use grimnet_track::TrackOptions;

use super::results::print_report_path;
use crate::exit::Exit;
use crate::progress;
use crate::standard_output::StandardOutput;

/// Hides fixes of a real flight and predicts them.
///
/// # Errors
/// A photo cannot be read or has no time, or results cannot be written.
pub fn hide(
    scene: &Scene,
    localizer: &Localizer,
    folder: &OutputFolder,
    about: TrackAbout,
) -> Result<Exit> {
    let mut shots = Vec::new();
    for (index, shot) in scene.shots.iter().enumerate() {
        let photo = shot.photo.open()?;
        let timed = TimedShot::new(shot, photo.as_ref())?;
        shots.push((index, timed));
    }
    shots.sort_by(|(_, a), (_, b)| a.time_s.total_cmp(&b.time_s));
    let (order, shots): (Vec<usize>, Vec<TimedShot>) = shots.into_iter().unzip();
    let gaps_s: Vec<f64> = shots
        .windows(2)
        .map(|pair| pair[1].time_s - pair[0].time_s)
        .collect();
    let bar = progress::bar(shots.len() as u64, "searching", "photos");
    let mut open = |at: usize| -> Result<Photo> {
        bar.inc(1);
        let photo = scene.shots[order[at]].photo.open()?;
        Ok(photo.as_ref().clone())
    };
    let predictions = predict_hidden(localizer, &shots, &TrackOptions::default(), &mut open)?;
    bar.finish_and_clear();
    let figures = figures(&predictions);
    for (name, content) in hidden_files(&about, &figures, &predictions)? {
        folder.write_bytes(name, &content)?;
    }
    let mut out = StandardOutput;
    let metres = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"));
    writeln!(
        out,
        "{} photos, {:.1} s apart (median)",
        shots.len(),
        percentile(&gaps_s, 0.5).unwrap_or(0.0)
    )?;
    writeln!(
        out,
        "hidden  predictions  joined  with position  distance  fixes only  motion only    filter  joined  stated radius"
    )?;
    for f in &figures {
        writeln!(
            out,
            "{:>6}{:>13}{:>8}{:>15}{:>10}{:>12}{:>13}{:>10}{:>8}{:>15}",
            f.hidden,
            f.predictions,
            f.joined,
            (f.answered * f.predictions as f64).round(),
            metres(f.distance_median_m),
            metres(f.fixes_only_median_m),
            metres(f.motion_only_median_m),
            metres(f.filter_median_m),
            metres(f.filter_joined_median_m),
            metres(f.radius95_median_m),
        )?;
    }
    print_report_path(folder, &HIDDEN_FILES)?;
    Ok(Exit::Done)
}
