//! Makes the observations of a calibration until they are complete, an error, or Ctrl-C.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use grimnet_eval::calibration::observation::Observation;
use grimnet_eval::calibration::observer::ObserveError;
use grimnet_eval::calibration::observer::Observer;

use super::kept::Kept;
use crate::formats::stopped;
use crate::progress;

/// Makes observations so that a run which is stopped can go on.
pub struct Observing<'a> {
    pub out: &'a Path,
    /// Where they are kept, if they are.
    pub kept_path: Option<PathBuf>,
    /// What they depend on, in words.
    pub conditions: String,
    /// How many there will be, for the progress bar.
    pub count: usize,
    /// Set by Ctrl-C.
    pub stop: Arc<AtomicBool>,
}

impl Observing<'_> {
    /// Makes the observations that an earlier run did not make, until the last one or Ctrl-C: `None` then.
    ///
    /// # Errors
    /// Those of `observe`, and a file that cannot be written.
    pub fn run(
        self,
        observe: &mut dyn FnMut(&mut Observer<'_>) -> Result<(), ObserveError>,
    ) -> Result<Option<(Vec<Observation>, Option<Kept>)>> {
        let opened = self
            .kept_path
            .as_ref()
            .map(|path| Kept::open(path, self.out, &self.conditions))
            .transpose()?;
        let (mut kept, earlier) =
            opened.map_or((None, Vec::new()), |(kept, earlier)| (Some(kept), earlier));
        let bar = progress::bar(self.count as u64, "localising", "photos");
        if !earlier.is_empty() {
            tracing::info!("going on after {} of {} photos", earlier.len(), self.count);
            progress::go_on_from(&bar, earlier.len() as u64, self.count as u64);
        }
        let mut on_new = |observation: &Observation| {
            bar.inc(1);
            kept.as_mut().map_or(Ok(()), |kept| kept.add(observation))
        };
        let mut observer = Observer::new(earlier, &self.stop, &mut on_new);
        let ended = observe(&mut observer);
        let observations = observer.into_observations();
        bar.finish_and_clear();
        // A file that keeps nothing is only in the way.
        let kept_path = match kept.take_if(|kept| ended.is_err() && kept.count() == 0) {
            Some(empty) => empty.remove().map(|()| None)?,
            None => self.kept_path,
        };
        match ended {
            Ok(()) => Ok(Some((observations, kept))),
            Err(ObserveError::Stopped) => {
                let done = format!(
                    "interrupted after {} of {} photos",
                    observations.len(),
                    self.count
                );
                match kept_path {
                    Some(path) => tracing::warn!(
                        "{done}, which are kept in {}; the same command goes on from there",
                        path.display()
                    ),
                    None => tracing::warn!("{done}; nothing is kept"),
                }
                Ok(None)
            }
            Err(error) => Err(stopped(
                error.into(),
                "the same command goes on from the observations in",
                kept_path,
            )),
        }
    }
}
