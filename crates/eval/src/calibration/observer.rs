//! Observations in the order in which they are made, the first of which an earlier run may have made.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

use grimnet_locate::LocateError;
use grimnet_pack::PackError;

use super::observation::Observation;
use crate::evaluation::TrialError;

/// Why observations cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ObserveError {
    /// The pack cannot be built.
    #[error(transparent)]
    Pack(PackError),
    /// The localiser refuses the model or the pack.
    #[error(transparent)]
    Locate(Box<LocateError>),
    /// A photo cannot be localised.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// An observation cannot be kept.
    #[error(transparent)]
    Keep(io::Error),
    /// The caller stopped the run.
    #[error("stopped")]
    Stopped,
}

impl From<PackError> for ObserveError {
    fn from(error: PackError) -> Self {
        match error {
            PackError::Stopped { .. } => Self::Stopped,
            error => Self::Pack(error),
        }
    }
}

impl From<LocateError> for ObserveError {
    fn from(error: LocateError) -> Self {
        Self::Locate(Box::new(error))
    }
}

/// Collects observations. The same inputs and settings give the same ones in the same order, so those that an earlier run made are
/// not made again.
pub struct Observer<'a> {
    observations: Vec<Observation>,
    /// How many of them were asked for in this run: those behind are of the earlier run.
    asked: usize,
    stop: &'a AtomicBool,
    on_new: &'a mut dyn FnMut(&Observation) -> io::Result<()>,
}

impl<'a> Observer<'a> {
    /// An observer that has the observations of an earlier run, and ends with [`ObserveError::Stopped`] when `stop` is set. `on_new`
    /// is called with each observation that this run makes.
    pub fn new(
        earlier: Vec<Observation>,
        stop: &'a AtomicBool,
        on_new: &'a mut dyn FnMut(&Observation) -> io::Result<()>,
    ) -> Self {
        Self {
            observations: earlier,
            asked: 0,
            stop,
            on_new,
        }
    }

    /// Has the next observation, which is made unless the earlier run made it.
    ///
    /// # Errors
    /// That of `make` or of `on_new`, and [`ObserveError::Stopped`].
    pub fn next(
        &mut self,
        make: impl FnOnce() -> Result<Observation, ObserveError>,
    ) -> Result<(), ObserveError> {
        self.asked += 1;
        if self.asked <= self.observations.len() {
            return Ok(());
        }
        if self.stop.load(Ordering::Relaxed) {
            return Err(ObserveError::Stopped);
        }
        let made = make()?;
        (self.on_new)(&made).map_err(ObserveError::Keep)?;
        self.observations.push(made);
        Ok(())
    }

    /// The switch that ends the run.
    #[must_use]
    pub fn stop(&self) -> &'a AtomicBool {
        self.stop
    }

    /// All observations that were asked for.
    #[must_use]
    pub fn into_observations(mut self) -> Vec<Observation> {
        self.observations.truncate(self.asked);
        self.observations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_scene(scene: usize) -> Observation {
        Observation {
            scene,
            elsewhere: false,
            heading_known: true,
            real: false,
            answer: None,
        }
    }

    #[test]
    fn a_stopped_run_goes_on_where_it_was() {
        let stop = AtomicBool::new(false);
        let mut kept = Vec::new();
        let mut keep = |observation: &Observation| {
            kept.push(observation.clone());
            stop.store(kept.len() == 3, Ordering::Relaxed);
            Ok(())
        };
        let mut observer = Observer::new(Vec::new(), &stop, &mut keep);
        let mut scenes = 0..5;
        let ended = scenes.try_for_each(|scene| observer.next(|| Ok(of_scene(scene))));
        assert!(matches!(ended, Err(ObserveError::Stopped)));
        assert_eq!(kept.len(), 3);

        stop.store(false, Ordering::Relaxed);
        let mut new = Vec::new();
        let mut keep = |observation: &Observation| {
            new.push(observation.scene);
            Ok(())
        };
        let mut observer = Observer::new(kept, &stop, &mut keep);
        for scene in 0..5 {
            observer.next(|| Ok(of_scene(scene))).unwrap();
        }
        assert_eq!(observer.into_observations(), [0, 1, 2, 3, 4].map(of_scene));
        assert_eq!(new, [3, 4]);
    }

    #[test]
    fn what_cannot_be_kept_ends_the_run() {
        let stop = AtomicBool::new(false);
        let mut keep = |_: &Observation| Err(io::ErrorKind::StorageFull.into());
        let mut observer = Observer::new(Vec::new(), &stop, &mut keep);
        let ended = observer.next(|| Ok(of_scene(0)));
        assert!(matches!(ended, Err(ObserveError::Keep(_))));
    }
}
