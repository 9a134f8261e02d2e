//! What a configuration trains on, and what it keeps aside.

use super::label_cache::LabelCache;
use super::pair::Source;
use super::pictures::{Aside, Fold, Pictures};
use super::shapes::Shapes;
use super::stream::Sources;
use super::worlds::Worlds;
use crate::TrainError;
use crate::config::{Stage, TrainConfig};
use crate::detector::Detector;
use burn::tensor::Device;
use std::sync::Arc;

/// The data of a run.
#[derive(Clone)]
pub struct Data {
    /// What pairs to train on are drawn from.
    pub training: Sources,
    /// What pairs to measure on are drawn from: pictures and worlds that training never sees, by name.
    pub aside: Vec<(&'static str, Arc<dyn Source>)>,
    /// Pictures to train on.
    pub pictures: usize,
    /// Files that look like pictures and cannot be used.
    pub unreadable: usize,
}

impl Data {
    /// Looks for a configuration's pictures, and plans its worlds.
    ///
    /// # Errors
    /// Folders that cannot be read, too few pictures.
    pub fn open(config: &TrainConfig) -> Result<Self, TrainError> {
        let mut out = Self {
            training: Vec::new(),
            aside: Vec::new(),
            pictures: 0,
            unreadable: 0,
        };
        if config.stage == Stage::Shapes {
            out.training.push((1.0, Arc::new(Shapes)));
            out.aside.push(("shapes", Arc::new(Shapes)));
            return Ok(out);
        }
        if !config.data.is_empty() {
            let mut pictures = Pictures::scan(&config.data, config.least_picture_px())?;
            if let Some(options) = config
                .labels
                .as_ref()
                .filter(|_| config.stage == Stage::Joint)
            {
                let detector = Detector::open(options.detector.as_deref(), &Device::flex())?;
                pictures = pictures.with_labels(&LabelCache::new(options, detector.hash())?)?;
            }
            let pictures = Arc::new(pictures);
            out.pictures = pictures.training_count();
            out.unreadable = pictures.unreadable();
            if !pictures.fold(Fold::Validation).is_empty() {
                out.aside
                    .push(("pictures", Arc::new(Aside(pictures.clone()))));
            }
            out.training.push((1.0 - config.world_share, pictures));
        }
        if config.world_share > 0.0 {
            let worlds = |fold| Arc::new(Worlds::new(&config.world, fold, config.seed));
            out.training
                .push((config.world_share, worlds(Fold::Training)));
            out.aside
                .push(("procedural worlds", worlds(Fold::Validation)));
        }
        tracing::info!(
            pictures = out.pictures,
            unreadable = out.unreadable,
            "to train on"
        );
        Ok(out)
    }
}
