//! A network description with its weights.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use grimnet_kernels::Isa;

use crate::card::Card;
use crate::error::ParameterError;
use crate::model_hash::{ModelHash, hash};
use crate::parameter::{DataType, Parameter, Values, WHITENING_MEAN, WHITENING_PROJECTION};
use crate::whitening::whiten;
use crate::{Calibration, Domain, NetError, NetSpec, Precision, VladSum};

/// A network description with its weights, model card and calibration. Cheap to clone; immutable.
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
    precision: Precision,
}

impl Model {
    /// Builds a model from a trainer's values: for each name of [`NetSpec::parameters`], the values of that shape in
    /// row-major order. Convolution weights and the whitening projection are rounded to half precision.
    ///
    /// # Errors
    /// [`NetError::Spec`] if the network cannot be built; [`NetError::Parameters`] if a tensor is missing, unknown, of
    /// another size, or not finite (after rounding).
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
                return Err(NetError::Parameters(ParameterError::Unknown {
                    name,
                    preset: spec.preset,
                }));
            };
            let rows = shape.first().copied().unwrap_or(1);
            let values = Values::from_f32(values, rows, DataType::of(&name, &shape));
            parameters.insert(name, Parameter { shape, values });
        }
        Self::from_parameters(spec, card, parameters)
    }

    /// Checks names, shapes and values, and computes the hash.
    pub(crate) fn from_parameters(
        spec: NetSpec,
        card: Card,
        parameters: BTreeMap<String, Parameter>,
    ) -> Result<Self, NetError> {
        spec.validate()?;
        check(&spec, &parameters).map_err(NetError::Parameters)?;
        let hash = hash(&spec, &parameters)?;
        let isa = Isa::detect();
        let precision = Precision::usual(&spec, isa);
        Ok(Self {
            inner: Arc::new(Inner {
                spec,
                card,
                calibration: Calibration::default(),
                parameters,
                hash,
                isa,
                precision,
            }),
        })
    }

    /// The network description.
    pub fn spec(&self) -> &NetSpec {
        &self.inner.spec
    }

    /// The model card.
    pub fn card(&self) -> &Card {
        &self.inner.card
    }

    /// The same model with another card.
    pub fn with_card(&self, card: Card) -> Self {
        self.changed(|inner| inner.card = card)
    }

    /// A copy with something changed that the identity does not depend on.
    fn changed(&self, change: impl FnOnce(&mut Inner)) -> Self {
        let mut inner = (*self.inner).clone();
        change(&mut inner);
        Self {
            inner: Arc::new(inner),
        }
    }

    /// The calibration of covariance and confidence.
    pub fn calibration(&self) -> &Calibration {
        &self.inner.calibration
    }

    /// The same model with another calibration. The identity stays the same, so packs remain valid.
    ///
    /// # Errors
    /// [`NetError::Calibration`] if a value is NaN, infinite, or out of range ([`Calibration::validate`]).
    pub fn with_calibration(&self, calibration: Calibration) -> Result<Self, NetError> {
        calibration.validate().map_err(NetError::Calibration)?;
        Ok(self.changed(|inner| inner.calibration = calibration))
    }

    /// The same model with the whitening projection in another precision. This changes the identity: packs that were
    /// built with the other precision must be built again.
    ///
    /// Int8 halves the size of the file against half precision. On the bundled model each global descriptor then differs
    /// by about 1 % of its length.
    ///
    /// # Errors
    /// [`NetError::NoWhitening`] if the network has no whitening; [`NetError::Parameters`] if a value exceeds the range
    /// of the precision.
    pub fn with_whitening_precision(&self, precision: DataType) -> Result<Self, NetError> {
        let mut parameters = self.inner.parameters.clone();
        let projection = parameters
            .get_mut(WHITENING_PROJECTION)
            .ok_or(NetError::NoWhitening)?;
        *projection = projection.converted(precision);
        let model =
            Self::from_parameters(self.inner.spec.clone(), self.inner.card.clone(), parameters)?;
        model
            .with_calibration(self.inner.calibration.clone())?
            .with_precision(self.inner.precision)
    }

    /// The precision in which its network is computed.
    pub fn precision(&self) -> Precision {
        self.inner.precision
    }

    /// The same model computed in another precision. The identity stays the same: features of all precisions can be compared with
    /// each other.
    ///
    /// # Errors
    /// [`NetError::UnsupportedPrecision`] if the network cannot be computed in it.
    pub fn with_precision(&self, precision: Precision) -> Result<Self, NetError> {
        if !precision.supports(self.spec()) {
            return Err(NetError::UnsupportedPrecision {
                preset: self.spec().preset.clone(),
                precision,
            });
        }
        Ok(self.changed(|inner| inner.precision = precision))
    }

    /// The model in this precision, or as it is without one.
    ///
    /// # Errors
    /// As [`Model::with_precision`].
    pub fn with_precision_if_given(self, precision: Option<Precision>) -> Result<Self, NetError> {
        match precision {
            Some(precision) => self.with_precision(precision),
            None => Ok(self),
        }
    }

    /// The identity of the model. Packs record it, so that features of different models are never compared.
    pub fn hash(&self) -> ModelHash {
        self.inner.hash
    }

    /// Whether the weights are random, so that the model cannot localise.
    pub fn is_random(&self) -> bool {
        self.inner.card.random
    }

    /// The tensor of that name ([`NetSpec::parameters`]), `None` if the network has none.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.inner.parameters.get(name)
    }

    /// All tensors, in the order of their names.
    pub fn parameters(&self) -> impl Iterator<Item = (&str, &Parameter)> {
        self.inner
            .parameters
            .iter()
            .map(|(name, parameter)| (name.as_str(), parameter))
    }

    /// The values of a tensor, which a validated model always has.
    pub(crate) fn values(&self, name: &str) -> Result<Vec<f32>, NetError> {
        let missing = || NetError::Parameters(ParameterError::Missing(name.to_owned()));
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

    /// The global descriptor of a VLAD sum (paper, eq. 7 and 8), [`NetSpec::global_len`] values: each cluster's residual is
    /// scaled to unit length, then the whole vector; if the network has whitening, it is projected and scaled to unit
    /// length again. All zeros if no position was visible.
    ///
    /// The sum must come from this model; if it is too short, the missing values count as zero.
    pub fn global_descriptor(&self, sum: &VladSum) -> Vec<f32> {
        self.global_descriptors(std::slice::from_ref(sum))
    }

    /// [`Model::global_descriptor`] of several sums at once: the rows of an n x [`NetSpec::global_len`] matrix. The
    /// projection is read from memory only once.
    pub fn global_descriptors(&self, sums: &[VladSum]) -> Vec<f32> {
        let spec = &self.inner.spec;
        let dim = spec.vlad_dim();
        let mut rows = vec![0.0; sums.len() * spec.vlad_len()];
        for (row, sum) in rows.chunks_exact_mut(spec.vlad_len()).zip(sums) {
            sum.normalise_into(dim, row);
        }
        self.whitened(rows)
    }

    /// Global descriptors of VLAD vectors of unit length (n x [`NetSpec::vlad_len`]): projected and scaled to unit length
    /// again (paper, eq. 8) if the network has whitening, else the vectors themselves. Rows of zeros stay zeros.
    pub fn whitened(&self, vectors: Vec<f32>) -> Vec<f32> {
        let whitening = (
            self.parameter(WHITENING_MEAN),
            self.parameter(WHITENING_PROJECTION),
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

/// Checks that the tensors are those of the network, of its shapes, and hold valid values.
fn check(spec: &NetSpec, parameters: &BTreeMap<String, Parameter>) -> Result<(), ParameterError> {
    let shapes: BTreeMap<String, Vec<usize>> = spec.parameters().into_iter().collect();
    for (name, expected) in &shapes {
        let parameter = parameters
            .get(name)
            .ok_or_else(|| ParameterError::Missing(name.clone()))?;
        let values = parameter.values.len();
        if parameter.shape != *expected || values != expected.iter().product::<usize>() {
            return Err(ParameterError::Shape {
                name: name.clone(),
                found: parameter.shape.clone(),
                values,
                expected: expected.clone(),
            });
        }
        if !parameter.values.is_finite() {
            return Err(ParameterError::NotFinite(name.clone()));
        }
        if name.ends_with(".var") && parameter.to_f32().iter().any(|&v| v < 0.0) {
            return Err(ParameterError::NegativeVariance(name.clone()));
        }
    }
    match parameters.keys().find(|name| !shapes.contains_key(*name)) {
        Some(name) => Err(ParameterError::Unknown {
            name: name.clone(),
            preset: spec.preset.clone(),
        }),
        None => Ok(()),
    }
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
        assert!(refuse(&|v| v.push(("extra".into(), vec![]))).contains("no tensor `extra`"));
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

    #[test]
    fn int8_whitening_changes_the_identity_and_hardly_the_descriptor() {
        let model = Model::random(&crate::random::tiny_compact(), 3).unwrap();
        let model = model
            .with_calibration(Calibration {
                position: crate::PositionError {
                    inlier_factor: 2.0,
                    shared_px: 1.5,
                },
                ..Calibration::default()
            })
            .unwrap();
        let int8 = model.with_whitening_precision(DataType::I8).unwrap();
        assert_eq!(
            int8.parameter(WHITENING_PROJECTION).unwrap().data_type(),
            DataType::I8
        );
        assert_ne!(int8.hash(), model.hash());
        assert_eq!(int8.calibration(), model.calibration());
        let sum = VladSum::from_vec(
            (0..model.spec().vlad_len())
                .map(|i| (i as f32 * 0.37).sin())
                .collect(),
        );
        let (a, b) = (model.global_descriptor(&sum), int8.global_descriptor(&sum));
        let cosine: f32 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
        assert!(cosine > 0.999 && a != b, "{cosine}");
        let plain = NetSpec {
            global_dim: 0,
            ..model.spec().clone()
        };
        assert!(matches!(
            Model::random(&plain, 3)
                .unwrap()
                .with_whitening_precision(DataType::I8),
            Err(NetError::NoWhitening)
        ));
    }
}
