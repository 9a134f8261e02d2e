//! The network's parameters on the training device, by the tensor names of the model file.

use crate::error::TrainError;
use burn::tensor::{Device, Tensor, TensorData};
use grimnet_net::{Card, Model, NetSpec};
use std::collections::BTreeMap;

/// All tensors of a network, flat, by name. Optimiser, checkpoints and model files use the same names.
#[derive(Clone, Debug)]
pub struct Parameters {
    spec: NetSpec,
    values: BTreeMap<String, Entry>,
}

#[derive(Clone, Debug)]
struct Entry {
    shape: Vec<usize>,
    value: Tensor<1>,
    trained: bool,
}

/// The scene classifier: `[scenes, width of the deepest features]` and `[scenes]`. It is not part of the model file.
const CLASSIFIER: [&str; 2] = ["classifier.weight", "classifier.bias"];

/// Whether the optimiser updates a tensor; statistics and whitening are estimated instead.
fn is_trained(name: &str) -> bool {
    !(name.ends_with(".mean") || name.ends_with(".var") || name.starts_with("whitening."))
}

/// Copies a tensor from the device.
pub(crate) fn host<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>, TrainError> {
    tensor
        .try_into_vec_as::<f32>()
        .map_err(|error| TrainError::Device {
            reason: error.to_string(),
        })
}

impl Parameters {
    /// The parameters of a model without its whitening; training uses the unwhitened descriptor.
    pub fn of_model(model: &Model, device: &Device) -> Self {
        let spec = NetSpec {
            global_dim: 0,
            ..model.spec().clone()
        };
        let mut values = BTreeMap::new();
        for (name, parameter) in model.parameters() {
            if name.starts_with("whitening.") {
                continue;
            }
            let numbers = parameter.to_f32();
            let length = numbers.len();
            let value = Tensor::from_data(
                TensorData::new(numbers, [length]),
                &device.clone().without_autodiff(),
            );
            values.insert(
                name.to_owned(),
                Entry {
                    shape: parameter.shape().to_vec(),
                    value,
                    trained: is_trained(name),
                },
            );
        }
        Self { spec, values }
    }

    /// The description of the network, without whitening.
    pub fn spec(&self) -> &NetSpec {
        &self.spec
    }

    /// The same with a scene classifier initialised to 0, or without one if `scenes` is 0.
    #[must_use]
    pub fn with_classifier(mut self, scenes: usize, device: &Device) -> Self {
        self.values
            .retain(|name, _| !CLASSIFIER.contains(&name.as_str()));
        if scenes > 0 {
            let width = self.spec.stage_width(self.spec.stages.len() - 1);
            for (name, shape) in CLASSIFIER
                .into_iter()
                .zip([vec![scenes, width], vec![scenes]])
            {
                let length: usize = shape.iter().product();
                let value = Tensor::zeros([length], &device.clone().without_autodiff());
                let entry = Entry {
                    shape,
                    value,
                    trained: true,
                };
                self.values.insert(name.to_owned(), entry);
            }
        }
        self
    }

    /// Number of classes of the scene classifier; 0 if there is none.
    pub fn scenes(&self) -> usize {
        let bias = self.values.get(CLASSIFIER[1]);
        bias.map_or(0, |entry| entry.shape.iter().product())
    }

    /// The device of the parameters, without autodiff.
    ///
    /// # Errors
    /// Returns an error if there are no parameters.
    pub fn device(&self) -> Result<Device, TrainError> {
        Ok(self.flat("descriptor.bias")?.device().without_autodiff())
    }

    /// Names of all tensors, sorted.
    pub fn names(&self) -> Vec<String> {
        self.values.keys().cloned().collect()
    }

    /// Names of the tensors that the optimiser updates, sorted.
    pub fn trained_names(&self) -> Vec<String> {
        self.values
            .iter()
            .filter(|(_, entry)| entry.trained)
            .map(|(name, _)| name.clone())
            .collect()
    }

    fn entry(&self, name: &str) -> Result<&Entry, TrainError> {
        self.values.get(name).ok_or_else(|| TrainError::Config {
            reason: format!("the network has no tensor `{name}`"),
        })
    }

    /// A tensor, flat; part of the autodiff graph after [`Parameters::tracked`].
    ///
    /// # Errors
    /// Returns an error if the network has no such tensor.
    pub fn flat(&self, name: &str) -> Result<Tensor<1>, TrainError> {
        Ok(self.entry(name)?.value.clone())
    }

    /// A tensor in its own shape.
    ///
    /// # Errors
    /// Returns an error if the network has no such tensor, or its rank is not `D`.
    pub fn shaped<const D: usize>(&self, name: &str) -> Result<Tensor<D>, TrainError> {
        let entry = self.entry(name)?;
        let shape: [usize; D] =
            entry
                .shape
                .clone()
                .try_into()
                .map_err(|shape| TrainError::Config {
                    reason: format!("`{name}` has shape {shape:?}; expected {D} axes"),
                })?;
        Ok(entry.value.clone().reshape(shape))
    }

    /// Replaces the values of a tensor.
    ///
    /// # Errors
    /// Returns an error if the network has no such tensor, or the number of values differs.
    pub fn set(&mut self, name: &str, value: Tensor<1>) -> Result<(), TrainError> {
        let length: usize = self.entry(name)?.shape.iter().product();
        if value.dims()[0] != length {
            return Err(TrainError::Config {
                reason: format!("`{name}` has {length} values; got {}", value.dims()[0]),
            });
        }
        if let Some(entry) = self.values.get_mut(name) {
            entry.value = value.without_autodiff();
        }
        Ok(())
    }

    /// Replaces the values of a tensor by values from the host.
    ///
    /// # Errors
    /// As [`Parameters::set`].
    pub fn set_from_host(&mut self, name: &str, values: Vec<f32>) -> Result<(), TrainError> {
        let length = values.len();
        let device = self.flat(name)?.device().without_autodiff();
        self.set(
            name,
            Tensor::from_data(TensorData::new(values, [length]), &device),
        )
    }

    /// The same values as leaves of a new autodiff graph.
    #[must_use]
    pub fn tracked(&self) -> Self {
        let mut out = self.clone();
        for entry in out.values.values_mut() {
            entry.value = entry.value.clone().autodiff();
            if entry.trained {
                entry.value = entry.value.clone().require_grad();
            }
        }
        out
    }

    /// Copies all values from the device.
    ///
    /// # Errors
    /// Returns an error if values cannot be read from the device.
    pub fn to_host(&self) -> Result<Vec<(String, Vec<f32>)>, TrainError> {
        self.values
            .iter()
            .map(|(name, entry)| Ok((name.clone(), host(entry.value.clone())?)))
            .collect()
    }

    /// The model with the current values, without whitening and classifier.
    ///
    /// # Errors
    /// Returns an error if values cannot be read from the device or are not finite.
    pub fn to_model(&self, card: Card) -> Result<Model, TrainError> {
        let mut values = self.to_host()?;
        values.retain(|(name, _)| !CLASSIFIER.contains(&name.as_str()));
        Ok(Model::from_values(self.spec.clone(), card, values)?)
    }
}
