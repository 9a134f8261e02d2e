//! A network with its numbers.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use grimnet_kernels::Isa;
use half::f16;
use half::slice::HalfFloatSliceExt;
use half::vec::HalfFloatVecExt;
use serde::{Deserialize, Serialize};

use crate::whitening::whiten;
use crate::{Calibration, Domain, NetError, NetSpec, VladSum};

/// How a parameter's numbers are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// IEEE half: convolution weights and the whitening projection.
    F16,
    /// IEEE single: everything else.
    F32,
}

impl Precision {
    /// The precision in which a parameter is written: half for the large ones, single for the rest.
    pub(crate) fn of(name: &str, shape: &[usize]) -> Self {
        if shape.len() == 4 || name == "whitening.projection" {
            Precision::F16
        } else {
            Precision::F32
        }
    }
}

/// Numbers as stored.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Values {
    F16(Vec<f16>),
    F32(Vec<f32>),
}

impl Values {
    pub(crate) fn bytes(&self) -> &[u8] {
        match self {
            Values::F16(values) => bytemuck::cast_slice(values),
            Values::F32(values) => bytemuck::cast_slice(values),
        }
    }

    fn len(&self) -> usize {
        match self {
            Values::F16(values) => values.len(),
            Values::F32(values) => values.len(),
        }
    }

    fn is_finite(&self) -> bool {
        match self {
            Values::F16(values) => values.iter().all(|v| v.is_finite()),
            Values::F32(values) => values.iter().all(|v| v.is_finite()),
        }
    }
}

/// One tensor of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    pub(crate) shape: Vec<usize>,
    pub(crate) values: Values,
}

impl Parameter {
    /// Its shape; row-major, last axis fastest.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// How it is stored.
    pub fn precision(&self) -> Precision {
        match self.values {
            Values::F16(_) => Precision::F16,
            Values::F32(_) => Precision::F32,
        }
    }

    /// Its numbers.
    pub fn to_f32(&self) -> Vec<f32> {
        match &self.values {
            Values::F16(values) => values.to_f32_vec(),
            Values::F32(values) => values.clone(),
        }
    }
}

/// Where a model comes from and what it may be used for; written into the model file.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Card {
    /// Name for people.
    pub name: String,
    /// What it was trained on.
    pub training_data: String,
    /// Number of optimisation steps.
    pub steps: u64,
    /// Licence of the numbers.
    pub licence: String,
    /// Anything else a user should know.
    pub notes: String,
    /// Whether the numbers are random, so that the model can localise nothing.
    pub random: bool,
}

/// Identity of a model: BLAKE3 over its description and tensors (not its card). Shown in hexadecimal.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct ModelHash([u8; 32]);

impl ModelHash {
    /// The 32 bytes.
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// From its 32 bytes.
    pub fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }
}

impl fmt::Display for ModelHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for ModelHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ModelHash({self})")
    }
}

/// A network description with its numbers. Cheap to clone; immutable.
#[derive(Clone)]
pub struct Model {
    inner: Arc<Inner>,
}

#[derive(Clone)]
struct Inner {
    spec: NetSpec,
    card: Card,
    calibration: Calibration,
    parameters: BTreeMap<String, Parameter>,
    hash: ModelHash,
    isa: Isa,
}

impl Model {
    /// Puts a model together from its numbers, as a trainer has them: for each name of [`NetSpec::parameters`], the values in
    /// that shape's row-major order. Convolution weights are rounded to half precision.
    ///
    /// # Errors
    /// [`NetError::Spec`] for a network that cannot be built; [`NetError::Parameters`] where a tensor is missing, unknown, of
    /// another size, or not finite (in half precision, where that is its storage).
    pub fn from_values(
        spec: NetSpec,
        card: Card,
        values: impl IntoIterator<Item = (String, Vec<f32>)>,
    ) -> Result<Self, NetError> {
        spec.validate()?;
        let shapes: BTreeMap<String, Vec<usize>> = spec.parameters().into_iter().collect();
        let mut parameters = BTreeMap::new();
        for (name, values) in values {
            let Some(shape) = shapes.get(&name).cloned() else {
                return Err(NetError::Parameters {
                    reason: format!("`{name}` is no tensor of `{}`", spec.preset),
                });
            };
            let values = match Precision::of(&name, &shape) {
                Precision::F16 => Values::F16(Vec::from_f32_slice(&values)),
                Precision::F32 => Values::F32(values),
            };
            parameters.insert(name, Parameter { shape, values });
        }
        Self::from_parameters(spec, card, parameters)
    }

    /// Checks names, shapes and values, and takes the hash.
    pub(crate) fn from_parameters(
        spec: NetSpec,
        card: Card,
        parameters: BTreeMap<String, Parameter>,
    ) -> Result<Self, NetError> {
        spec.validate()?;
        let wrong = |reason: String| Err(NetError::Parameters { reason });
        let wanted = spec.parameters();
        for (name, shape) in &wanted {
            let Some(parameter) = parameters.get(name) else {
                return wrong(format!("`{name}` is missing"));
            };
            if parameter.shape != *shape
                || parameter.values.len() != shape.iter().product::<usize>()
            {
                return wrong(format!(
                    "`{name}` has shape {:?} ({} values) where {shape:?} is needed",
                    parameter.shape,
                    parameter.values.len()
                ));
            }
            if !parameter.values.is_finite() {
                return wrong(format!(
                    "`{name}` holds a value that is not a finite number"
                ));
            }
            if name.ends_with(".var") && parameter.to_f32().iter().any(|&v| v < 0.0) {
                return wrong(format!("`{name}` holds a negative variance"));
            }
        }
        if let Some(name) = parameters
            .keys()
            .find(|name| !wanted.iter().any(|(wanted, _)| wanted == *name))
        {
            return wrong(format!("`{name}` is no tensor of `{}`", spec.preset));
        }
        let hash = hash(&spec, &parameters)?;
        Ok(Self {
            inner: Arc::new(Inner {
                spec,
                card,
                calibration: Calibration::default(),
                parameters,
                hash,
                isa: Isa::detect(),
            }),
        })
    }

    /// Its description.
    pub fn spec(&self) -> &NetSpec {
        &self.inner.spec
    }

    /// Where it comes from.
    pub fn card(&self) -> &Card {
        &self.inner.card
    }

    /// The same numbers under another card.
    pub fn with_card(&self, card: Card) -> Self {
        let inner = Inner {
            card,
            ..(*self.inner).clone()
        };
        Self {
            inner: Arc::new(inner),
        }
    }

    /// How far its answers may be off.
    pub fn calibration(&self) -> &Calibration {
        &self.inner.calibration
    }

    /// The same numbers with another calibration. The identity stays: packs remain valid.
    pub fn with_calibration(&self, calibration: Calibration) -> Self {
        let inner = Inner {
            calibration,
            ..(*self.inner).clone()
        };
        Self {
            inner: Arc::new(inner),
        }
    }

    /// Its identity. Packs record it, so that features of two models are never compared.
    pub fn hash(&self) -> ModelHash {
        self.inner.hash
    }

    /// Whether its numbers are random, so that it can localise nothing.
    pub fn is_random(&self) -> bool {
        self.inner.card.random
    }

    /// A tensor by its name in [`NetSpec::parameters`].
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.inner.parameters.get(name)
    }

    /// All tensors by name.
    pub fn parameters(&self) -> impl Iterator<Item = (&str, &Parameter)> {
        self.inner
            .parameters
            .iter()
            .map(|(name, parameter)| (name.as_str(), parameter))
    }

    /// The numbers of a tensor that a validated model has.
    pub(crate) fn values(&self, name: &str) -> Result<Vec<f32>, NetError> {
        let missing = || NetError::Parameters {
            reason: format!("`{name}` is missing"),
        };
        Ok(self.parameter(name).ok_or_else(missing)?.to_f32())
    }

    /// Stored DA-BN mean and variance of one layer.
    pub(crate) fn norm_moments(
        &self,
        layer: &str,
        domain: Domain,
    ) -> Result<(Vec<f32>, Vec<f32>), NetError> {
        let part = |part: &str| self.values(&domain.norm_name(layer, part));
        Ok((part("mean")?, part("var")?))
    }

    /// The global descriptor of a VLAD sum (paper, eq. 7 and 8): each cluster's residual to unit length, all to unit length,
    /// and, where the network has whitening, projection and unit length again. All zeros where nothing was seen.
    ///
    /// The sum must come from this model; of one with another length, the missing part counts as zero.
    pub fn global_descriptor(&self, sum: &VladSum) -> Vec<f32> {
        self.global_descriptors(std::slice::from_ref(sum))
    }

    /// [`Model::global_descriptor`] of many sums at once, which reads the projection once for several: the rows of an n x
    /// [`NetSpec::global_len`] matrix.
    pub fn global_descriptors(&self, sums: &[VladSum]) -> Vec<f32> {
        let spec = &self.inner.spec;
        let dim = spec.vlad_dim();
        let mut rows = vec![0.0; sums.len() * spec.vlad_len()];
        for (row, sum) in rows.chunks_exact_mut(spec.vlad_len()).zip(sums) {
            sum.normalise_into(dim, row);
        }
        self.whitened(rows)
    }

    /// Global descriptors from VLAD vectors of unit length (n x [`NetSpec::vlad_len`]): projected and of unit length again
    /// (paper, eq. 8) where the network has whitening, else the vectors themselves. Zeros stay zeros.
    pub fn whitened(&self, vectors: Vec<f32>) -> Vec<f32> {
        let whitening = (
            self.parameter("whitening.mean"),
            self.parameter("whitening.projection"),
        );
        match whitening {
            (Some(mean), Some(projection)) => {
                whiten(self.inner.isa, &vectors, &mean.to_f32(), projection)
            }
            _ => vectors,
        }
    }
}

impl fmt::Debug for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner {
            spec, card, hash, ..
        } = &*self.inner;
        f.debug_struct("Model")
            .field("preset", &spec.preset)
            .field("name", &card.name)
            .field("hash", hash)
            .finish_non_exhaustive()
    }
}

/// BLAKE3 of the description, then of every tensor's name, shape, precision and bytes in the order of names.
fn hash(spec: &NetSpec, parameters: &BTreeMap<String, Parameter>) -> Result<ModelHash, NetError> {
    let mut hasher = blake3::Hasher::new();
    let mut add = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    let spec = serde_json::to_vec(spec).map_err(|e| NetError::Spec {
        reason: e.to_string(),
    })?;
    add(&spec);
    for (name, parameter) in parameters {
        add(name.as_bytes());
        add(format!("{:?}{:?}", parameter.precision(), parameter.shape).as_bytes());
        add(parameter.values.bytes());
    }
    Ok(ModelHash(*hasher.finalize().as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    type NamedValues = Vec<(String, Vec<f32>)>;

    fn values(spec: &NetSpec) -> NamedValues {
        spec.parameters()
            .into_iter()
            .map(|(name, shape)| (name, vec![0.25; shape.iter().product()]))
            .collect()
    }

    #[test]
    fn parameters_that_do_not_fit_are_refused_by_name() {
        let spec = NetSpec::compact();
        let refuse = |change: &dyn Fn(&mut NamedValues)| {
            let mut values = values(&spec);
            change(&mut values);
            Model::from_values(spec.clone(), Card::default(), values)
                .unwrap_err()
                .to_string()
        };
        assert!(refuse(&|v| drop(v.remove(0))).contains("`encoder.0.0.weight` is missing"));
        assert!(refuse(&|v| v[0].1.truncate(5)).contains("encoder.0.0.weight"));
        assert!(
            refuse(&|v| v[0].1[0] = 1e9).contains("not a finite number"),
            "beyond half precision"
        );
        assert!(refuse(&|v| v[1].1[0] = f32::NAN).contains("not a finite number"));
        assert!(refuse(&|v| v.push(("extra".into(), vec![]))).contains("`extra` is no tensor"));
        assert!(
            refuse(&|v| v
                .iter_mut()
                .filter(|(n, _)| n.ends_with("var"))
                .for_each(|(_, v)| v[0] = -1.0))
            .contains("negative variance")
        );
    }

    #[test]
    fn the_hash_sees_numbers_and_description_but_not_the_card() {
        let spec = NetSpec::compact();
        let model = Model::from_values(spec.clone(), Card::default(), values(&spec)).unwrap();
        assert_eq!(
            model
                .with_card(Card {
                    name: "other".into(),
                    ..Card::default()
                })
                .hash(),
            model.hash()
        );
        let mut other = values(&spec);
        other[7].1[3] = 0.5;
        assert_ne!(
            Model::from_values(spec.clone(), Card::default(), other)
                .unwrap()
                .hash(),
            model.hash()
        );
        let renamed = NetSpec {
            preset: "x".into(),
            ..spec.clone()
        };
        assert_ne!(
            Model::from_values(renamed, Card::default(), values(&spec))
                .unwrap()
                .hash(),
            model.hash()
        );
        assert_eq!(model.hash().to_string().len(), 64);
    }
}
