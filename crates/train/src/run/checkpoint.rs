//! Checkpoints: everything needed to resume training, in one safetensors file that is replaced atomically.

use crate::config::{Stage, TrainConfig};
use crate::error::TrainError;
use crate::model::input::Norms;
use crate::model::normalisation::share_norms;
use crate::model::parameters::{Parameters, host};
use crate::run::optimiser::{Adam, Moments};
use burn::tensor::{Device, Tensor, TensorData};
use grimnet_net::{Card, Model, NetSpec};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::io::Read as _;
use std::path::Path;

/// The file of the checkpoint in the folder of a run.
pub const CHECKPOINT: &str = "checkpoint.safetensors";

/// Progress of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// Number of steps done.
    pub step: u64,
    /// Training time of all runs together, seconds.
    pub elapsed_s: f64,
    /// Whether NetVLAD has been initialised.
    pub centres_started: bool,
    /// The stage that the run trains.
    #[serde(default)]
    pub stage: Stage,
}

/// A training state.
pub struct Checkpoint {
    /// The network's parameters.
    pub parameters: Parameters,
    /// Their moving average, which is exported.
    pub average: Parameters,
    /// The optimiser's state.
    pub adam: Adam,
    /// Progress.
    pub position: Position,
    /// The configuration of the run; `None` in checkpoints of versions that did not record it.
    pub config: Option<TrainConfig>,
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn values_of(bytes: &[u8]) -> Vec<f32> {
    bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect()
}

/// The values of a tensor, of which there must be `expected`; else what is wrong.
fn stored(tensors: &SafeTensors<'_>, name: &str, expected: usize) -> Result<Vec<f32>, String> {
    let view = tensors
        .tensor(name)
        .map_err(|_| format!("`{name}` is missing"))?;
    let values = values_of(view.data());
    let length = values.len();
    if length == expected {
        Ok(values)
    } else {
        Err(format!(
            "`{name}` has {length} values; its network has {expected}"
        ))
    }
}

/// Largest header that safetensors allows, bytes.
const LONGEST_HEADER: u64 = 100_000_000;

impl Checkpoint {
    /// Which views shared normalisations in training.
    pub fn norms(&self) -> Norms {
        let config = self.config.as_ref();
        config.map_or(Norms::default(), |config| config.norms)
    }

    /// The network that was trained so far: the averaged parameters. Where one normalisation serves both domains, the photos have that of
    /// the maps, for their own was not trained.
    ///
    /// # Errors
    /// Returns an error if values cannot be read from the device.
    pub fn network(&self) -> Result<Parameters, TrainError> {
        let mut parameters = self.average.clone();
        share_norms(&mut parameters, self.norms())?;
        Ok(parameters)
    }

    /// [`Checkpoint::network`] as a model without card, whitening and classifier.
    ///
    /// # Errors
    /// Returns an error if values cannot be read from the device or are not finite.
    pub fn model(&self) -> Result<Model, TrainError> {
        self.network()?.to_model(Card::default())
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// An error if values cannot be read from the device.
    pub fn to_bytes(&self) -> Result<Vec<u8>, TrainError> {
        let mut buffers: Vec<(String, Vec<u8>)> = Vec::new();
        for (prefix, parameters) in [("value/", &self.parameters), ("average/", &self.average)] {
            for (name, values) in parameters.to_host()? {
                buffers.push((format!("{prefix}{name}"), bytes_of(&values)));
            }
        }
        let mut updates_of = BTreeMap::new();
        for (name, kept) in &self.adam.moments {
            for (moment, values) in [("first", &kept.first), ("second", &kept.second)] {
                let values = host(values.clone())?;
                buffers.push((format!("{moment}/{name}"), bytes_of(&values)));
            }
            updates_of.insert(name, kept.updates);
        }
        let wrong = |reason: String| TrainError::Checkpoint {
            path: CHECKPOINT.into(),
            reason,
        };
        let json = |error: serde_json::Error| wrong(error.to_string());
        let mut metadata = HashMap::from([
            (
                "spec".to_owned(),
                serde_json::to_string(self.parameters.spec()).map_err(json)?,
            ),
            (
                "position".to_owned(),
                serde_json::to_string(&self.position).map_err(json)?,
            ),
            ("updates".to_owned(), self.adam.updates.to_string()),
            (
                "updates_of".to_owned(),
                serde_json::to_string(&updates_of).map_err(json)?,
            ),
            ("scenes".to_owned(), self.parameters.scenes().to_string()),
        ]);
        if let Some(config) = &self.config {
            // TOML and not JSON, which has no infinite numbers.
            metadata.insert("config".to_owned(), config.to_table()?.to_string());
        }
        let views: Vec<(&str, TensorView<'_>)> = buffers
            .iter()
            .map(|(name, bytes)| {
                Ok((
                    name.as_str(),
                    TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes)?,
                ))
            })
            .collect::<Result<_, safetensors::SafeTensorError>>()
            .map_err(|error| wrong(error.to_string()))?;
        safetensors::serialize(views, Some(metadata)).map_err(|error| wrong(error.to_string()))
    }

    /// Whether the header of a file is that of a checkpoint. The tensors are not read, so that the file may be damaged.
    ///
    /// # Errors
    /// [`TrainError::Io`].
    pub fn is_checkpoint(path: &Path) -> Result<bool, TrainError> {
        Ok(Self::position_in(path)?.is_some())
    }

    /// The progress of the checkpoint in a file, by its header as [`Checkpoint::is_checkpoint`]; `None` if it is no checkpoint.
    ///
    /// # Errors
    /// [`TrainError::Io`].
    pub fn position_in(path: &Path) -> Result<Option<Position>, TrainError> {
        let mut file = fs_err::File::open(path)?;
        let mut length = [0; 8];
        if file.read_exact(&mut length).is_err() {
            return Ok(None);
        }
        // The library reads headers of whole files only.
        let mut header = Vec::new();
        let most = u64::from_le_bytes(length).min(LONGEST_HEADER);
        file.take(most).read_to_end(&mut header)?;
        let described: Option<serde_json::Value> = serde_json::from_slice(&header).ok();
        Ok(described.and_then(|header| {
            let position = header["__metadata__"]["position"].as_str()?;
            serde_json::from_str(position).ok()
        }))
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`TrainError::Checkpoint`] if the file is missing, damaged, or does not fit its description.
    pub fn open(path: &Path, device: &Device) -> Result<Self, TrainError> {
        let wrong = |reason: String| TrainError::Checkpoint {
            path: path.to_owned(),
            reason,
        };
        if !path.exists() {
            return Err(wrong(
                "the file does not exist; start the run without resuming".into(),
            ));
        }
        let bytes = fs_err::read(path)?;
        let (_, header) =
            SafeTensors::read_metadata(&bytes).map_err(|error| wrong(error.to_string()))?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(|error| wrong(error.to_string()))?;
        let metadata = header.metadata().clone().unwrap_or_default();
        let field = |name: &str| {
            metadata
                .get(name)
                .ok_or_else(|| wrong(format!("not a checkpoint: `{name}` is missing")))
        };
        let spec: NetSpec =
            serde_json::from_str(field("spec")?).map_err(|error| wrong(error.to_string()))?;
        let position: Position =
            serde_json::from_str(field("position")?).map_err(|error| wrong(error.to_string()))?;
        let updates = field("updates")?
            .parse()
            .map_err(|_| wrong("`updates` is not a number".into()))?;
        // Checkpoints of earlier versions count the updates of all tensors together.
        let updates_of: BTreeMap<String, u64> = match metadata.get("updates_of") {
            Some(text) => serde_json::from_str(text).map_err(|error| wrong(error.to_string()))?,
            None => BTreeMap::new(),
        };
        let config = metadata.get("config").map(|text| toml::from_str(text));
        let config = config
            .transpose()
            .map_err(|error| wrong(format!("the configuration in it cannot be read: {error}")))?;
        let scenes = metadata.get("scenes").map_or(Ok(0), |n| n.parse());
        let scenes = scenes.map_err(|_| wrong("`scenes` is not a number".into()))?;
        let model = Model::random(&spec, 0).map_err(|error| wrong(error.to_string()))?;
        let model = model.with_card(Card::default());
        let blank = Parameters::of_model(&model, device).with_classifier(scenes, device);
        let (mut parameters, mut average) = (blank.clone(), blank.clone());
        let mut adam = Adam {
            updates,
            ..Adam::default()
        };
        let inner = device.clone().without_autodiff();
        let read = |kind: &str, name: &str| -> Result<Tensor<1>, TrainError> {
            let expected = blank.flat(name)?.dims()[0];
            let values = stored(&tensors, &format!("{kind}/{name}"), expected).map_err(wrong)?;
            Ok(Tensor::from_data(
                TensorData::new(values, [expected]),
                &inner,
            ))
        };
        for name in blank.names() {
            parameters.set(&name, read("value", &name)?)?;
            average.set(&name, read("average", &name)?)?;
            if tensors.tensor(&format!("first/{name}")).is_ok() {
                adam.moments.insert(
                    name.clone(),
                    Moments {
                        updates: updates_of.get(&name).copied().unwrap_or(updates),
                        first: read("first", &name)?,
                        second: read("second", &name)?,
                    },
                );
            }
        }
        Ok(Self {
            parameters,
            average,
            adam,
            position,
            config,
        })
    }
}
