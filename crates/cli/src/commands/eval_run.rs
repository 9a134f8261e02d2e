//! One run of the evaluation loop under a progress bar.

use grimnet_eval::evaluation::{Method, Trial, evaluate};
use grimnet_eval::metrics::{Frame, Summary};
use grimnet_eval::report::Run;
use grimnet_eval::scene::{HeadingMode, Shot};

use crate::progress;
use grimnet_answer::Answer;

/// Localises every photo: the figures, and what was found for each. A photo that cannot be localised has no fix, with the error as
/// its reason.
pub fn evaluate_all(
    method: &dyn Method,
    shots: &[Shot],
    heading: HeadingMode,
    name: &str,
) -> (Run, Vec<Trial>) {
    let bar = progress::bar(shots.len() as u64, name, "photos");
    let trials = evaluate(method, shots, heading, &mut |_| bar.inc(1));
    bar.finish_and_clear();
    let frames: Vec<Frame> = trials.iter().map(|trial| trial.frame.clone()).collect();
    let run = Run {
        name: name.to_owned(),
        summary: Summary::of(&frames),
        frames,
    };
    (run, trials)
}

/// The answers as they are written out.
pub fn answers(trials: &[Trial]) -> Vec<Answer> {
    trials
        .iter()
        .map(|trial| {
            let photo = &trial.frame.photo;
            match trial.found.as_ref().ok().and_then(|f| f.outcome.as_ref()) {
                Some(outcome) => Answer::of(photo, outcome),
                None => Answer::no_fix(photo, trial.frame.reason.as_deref().unwrap_or("no fix")),
            }
        })
        .collect()
}
