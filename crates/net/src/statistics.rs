//! Normalisation statistics of a domain, computed without labels from its own images.

use crate::error::StatisticsError;
use crate::{Domain, Model, ModelHash, NetError};

const MAGIC: &[u8; 8] = b"GRIMSTA1";

/// Moments of the outputs of one layer's convolution.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerStatistics {
    /// The layer's name, as in its tensors' names.
    pub name: String,
    /// Mean of each channel.
    pub mean: Vec<f32>,
    /// Biased variance of each channel.
    pub var: Vec<f32>,
}

/// Mean and variance of every normalised layer of one model, for one domain: what DA-BN (paper, eq. 3) subtracts and divides
/// by. Recomputing them over the blocks of a map, or over a photo, adapts the network without labels.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    model: ModelHash,
    layers: Vec<LayerStatistics>,
}

impl Statistics {
    pub(crate) fn new(model: ModelHash, layers: Vec<LayerStatistics>) -> Self {
        Self { model, layers }
    }

    /// The statistics stored in a model.
    ///
    /// # Errors
    /// [`NetError::Parameters`] if a tensor is missing, which a model that was opened excludes.
    pub fn of_model(model: &Model, domain: Domain) -> Result<Self, NetError> {
        let layer = |norm: crate::parameter_names::NormSpec| {
            let (mean, var) = model.norm_moments(&norm.name, domain)?;
            Ok(LayerStatistics {
                name: norm.name,
                mean,
                var,
            })
        };
        Ok(Self {
            model: model.hash(),
            layers: model
                .spec()
                .norms()
                .into_iter()
                .map(layer)
                .collect::<Result<_, NetError>>()?,
        })
    }

    /// The layers, in the order of [`crate::NetSpec::parameters`].
    pub fn layers(&self) -> &[LayerStatistics] {
        &self.layers
    }

    /// The model to which they belong.
    pub fn model(&self) -> ModelHash {
        self.model
    }

    /// The statistics of several images together, each with the same weight: the mean of the means, and the variance within
    /// images plus the variance between them.
    ///
    /// # Errors
    /// [`NetError::Statistics`] if there are none, or they belong to different models.
    pub fn mean_of(all: &[Statistics]) -> Result<Self, NetError> {
        let weight = 1.0 / all.len().max(1) as f64;
        Self::mixture(
            &all.iter()
                .map(|statistics| (statistics, weight))
                .collect::<Vec<_>>(),
        )
    }

    /// A mixture of these statistics and `other`, of the same model: `share` 0 gives these, 1 the other.
    ///
    /// # Errors
    /// [`NetError::Statistics`] if they belong to different models, or the share is outside 0 to 1.
    pub fn blend(&self, other: &Statistics, share: f64) -> Result<Self, NetError> {
        if !(0.0..=1.0).contains(&share) {
            return Err(NetError::Statistics(StatisticsError::Share(share)));
        }
        Self::mixture(&[(self, 1.0 - share), (other, share)])
    }

    /// Moments of a mixture of images whose weights sum to one.
    fn mixture(all: &[(&Statistics, f64)]) -> Result<Self, NetError> {
        let (first, _) = all
            .first()
            .ok_or(NetError::Statistics(StatisticsError::Empty))?;
        if all.iter().any(|(other, _)| !first.same_layers(other)) {
            return Err(NetError::Statistics(StatisticsError::OtherModel));
        }
        let layer = |index: usize, like: &LayerStatistics| {
            let moments = |channel: usize| {
                let parts = all.iter().map(|(s, weight)| {
                    let layer = &s.layers[index];
                    (
                        *weight,
                        f64::from(layer.mean[channel]),
                        f64::from(layer.var[channel]),
                    )
                });
                let mean: f64 = parts.clone().map(|(weight, mean, _)| weight * mean).sum();
                let var: f64 = parts
                    .map(|(weight, m, var)| weight * (var + (m - mean).powi(2)))
                    .sum();
                (mean as f32, var as f32)
            };
            let (mean, var) = (0..like.mean.len()).map(moments).unzip();
            LayerStatistics {
                name: like.name.clone(),
                mean,
                var,
            }
        };
        let layers = first
            .layers
            .iter()
            .enumerate()
            .map(|(i, like)| layer(i, like))
            .collect();
        Ok(Self {
            model: first.model,
            layers,
        })
    }

    pub(crate) fn same_layers(&self, other: &Self) -> bool {
        let alike = |(a, b): (&LayerStatistics, &LayerStatistics)| {
            a.name == b.name && a.mean.len() == b.mean.len()
        };
        self.model == other.model
            && self.layers.len() == other.layers.len()
            && self.layers.iter().zip(&other.layers).all(alike)
    }

    /// Serialises the statistics, to be stored with a map or a flight.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(self.model.as_bytes());
        bytes.extend((self.layers.len() as u32).to_le_bytes());
        for layer in &self.layers {
            bytes.extend((layer.name.len() as u32).to_le_bytes());
            bytes.extend(layer.name.as_bytes());
            bytes.extend((layer.mean.len() as u32).to_le_bytes());
            bytes.extend(
                layer
                    .mean
                    .iter()
                    .chain(&layer.var)
                    .flat_map(|v| v.to_le_bytes()),
            );
        }
        bytes
    }

    /// Reads the bytes of [`Statistics::to_bytes`].
    ///
    /// # Errors
    /// [`NetError::Statistics`] if the bytes have another format, end too early, or hold invalid values.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, NetError> {
        let mut reader = Reader(bytes);
        let wrong = |what| NetError::Statistics(StatisticsError::Format(what));
        let statistics = Self::read(&mut reader).map_err(wrong)?;
        if reader.0.is_empty() {
            Ok(statistics)
        } else {
            Err(wrong("there are bytes after the last layer"))
        }
    }

    fn read(reader: &mut Reader) -> Result<Self, &'static str> {
        const CUT: &str = "they end too early";
        if reader.take(MAGIC.len()).ok_or(CUT)? != MAGIC {
            return Err("they do not begin with the format's magic number");
        }
        let hash = reader.take(32).and_then(|hash| hash.try_into().ok());
        let layers = reader.u32();
        let mut statistics = Self {
            model: ModelHash::from_bytes(hash.ok_or(CUT)?),
            layers: Vec::new(),
        };
        for _ in 0..layers.ok_or(CUT)? {
            let layer = reader.layer().ok_or(CUT)?;
            let LayerStatistics { mean, var, .. } = &layer;
            if !mean.iter().chain(var).all(|v| v.is_finite()) || var.iter().any(|&v| v < 0.0) {
                return Err("a value is not finite, or a variance is negative");
            }
            statistics.layers.push(layer);
        }
        Ok(statistics)
    }
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(head)
    }

    fn u32(&mut self) -> Option<usize> {
        Some(u32::from_le_bytes(self.take(4)?.try_into().ok()?) as usize)
    }

    /// The next layer; `None` if the bytes end before it does, or its name is not UTF-8.
    fn layer(&mut self) -> Option<LayerStatistics> {
        let len = self.u32()?;
        let name = std::str::from_utf8(self.take(len)?).ok()?.to_owned();
        let channels = self.u32()?;
        Some(LayerStatistics {
            name,
            mean: self.floats(channels)?,
            var: self.floats(channels)?,
        })
    }

    fn floats(&mut self, len: usize) -> Option<Vec<f32>> {
        let bytes = self.take(len.checked_mul(4)?)?;
        Some(
            bytes
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                .collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn statistics(mean: f32, var: f32) -> Statistics {
        let layer = LayerStatistics {
            name: "fuse".into(),
            mean: vec![mean; 3],
            var: vec![var; 3],
        };
        Statistics::new(ModelHash::from_bytes([7; 32]), vec![layer])
    }

    #[test]
    fn the_mean_has_the_moments_of_all_images_together() {
        let mean = Statistics::mean_of(&[statistics(1.0, 2.0), statistics(3.0, 4.0)]).unwrap();
        assert_eq!(mean, statistics(2.0, 4.0), "3 within, 1 between");
        assert_eq!(
            statistics(1.0, 2.0)
                .blend(&statistics(3.0, 4.0), 0.0)
                .unwrap(),
            statistics(1.0, 2.0)
        );
        assert!(Statistics::mean_of(&[]).is_err());
        let mut other = statistics(1.0, 2.0);
        other.model = ModelHash::from_bytes([8; 32]);
        assert!(Statistics::mean_of(&[statistics(1.0, 2.0), other]).is_err());
        assert!(
            statistics(1.0, 2.0)
                .blend(&statistics(3.0, 4.0), f64::NAN)
                .is_err()
        );
    }

    #[test]
    fn bytes_round_trip_and_damage_is_seen() {
        let good = statistics(1.5, 2.5);
        let bytes = good.to_bytes();
        assert_eq!(Statistics::from_bytes(&bytes).unwrap(), good);
        for cut in 0..bytes.len() {
            assert!(Statistics::from_bytes(&bytes[..cut]).is_err());
        }
        assert!(Statistics::from_bytes(&[&bytes[..], &[0]].concat()).is_err());
        assert!(Statistics::from_bytes(&statistics(f32::NAN, 1.0).to_bytes()).is_err());
        assert!(Statistics::from_bytes(&statistics(0.0, -1.0).to_bytes()).is_err());
        let mut huge = bytes.clone();
        huge[40..44].fill(0xff);
        assert!(Statistics::from_bytes(&huge).is_err());
    }
}
