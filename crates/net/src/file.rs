//! The model file: safetensors, with the description and the card as JSON in its metadata.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use half::f16;
use safetensors::{Dtype, SafeTensors};
use serde_json::{Map, Value, json};

use crate::model::{Parameter, Values};
use crate::{Calibration, Card, Model, NetError, NetSpec};

/// Version of the layout of names and metadata; readers refuse others.
const VERSION: &str = "1";
const VERSION_KEY: &str = "grimnet_model_version";
/// Only in models that were calibrated.
const CALIBRATION_KEY: &str = "calibration";

impl Model {
    /// Reads a model file.
    ///
    /// # Errors
    /// [`NetError::Io`] where it cannot be read, [`NetError::ModelFile`] where it is not a model, is damaged, or does not fit
    /// its own description.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, NetError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|source| NetError::Io {
            path: path.into(),
            source,
        })?;
        Self::from_bytes(&bytes).map_err(|reason| NetError::ModelFile {
            path: path.into(),
            reason,
        })
    }

    /// Reads a model from the bytes of its file; the error says what is wrong with them.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let (_, header) = SafeTensors::read_metadata(bytes)
            .map_err(|e| format!("not a safetensors file ({e})"))?;
        let metadata = header.metadata().as_ref().ok_or("it has no metadata")?;
        let entry = |key: &str| {
            metadata
                .get(key)
                .ok_or(format!("its metadata has no `{key}`"))
        };
        let version = entry(VERSION_KEY)?;
        if version != VERSION {
            return Err(format!(
                "its format version is `{version}`, this program reads `{VERSION}`"
            ));
        }
        let spec: NetSpec = serde_json::from_str(entry("spec")?)
            .map_err(|e| format!("its network description cannot be read ({e})"))?;
        let card: Card = serde_json::from_str(entry("card")?)
            .map_err(|e| format!("its card cannot be read ({e})"))?;
        let calibration: Option<Calibration> = metadata
            .get(CALIBRATION_KEY)
            .map(|text| serde_json::from_str(text))
            .transpose()
            .map_err(|e| format!("its calibration cannot be read ({e})"))?;
        let file = SafeTensors::deserialize(bytes).map_err(|e| format!("damaged ({e})"))?;
        let mut parameters = BTreeMap::new();
        for (name, tensor) in file.iter() {
            let data = tensor.data();
            let values = match tensor.dtype() {
                Dtype::F16 => Values::F16(
                    data.chunks_exact(2)
                        .map(|b| f16::from_le_bytes([b[0], b[1]]))
                        .collect(),
                ),
                Dtype::F32 => Values::F32(
                    data.chunks_exact(4)
                        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                        .collect(),
                ),
                other => {
                    return Err(format!(
                        "`{name}` is stored as {other:?}; F16 and F32 are understood"
                    ));
                }
            };
            parameters.insert(
                name.to_owned(),
                Parameter {
                    shape: tensor.shape().to_vec(),
                    values,
                },
            );
        }
        let model = Self::from_parameters(spec, card, parameters).map_err(|e| e.to_string())?;
        Ok(match calibration {
            Some(calibration) => model.with_calibration(calibration),
            None => model,
        })
    }

    /// Writes the model file: aside, flushed to disk, then renamed into place. The same model gives the same bytes.
    ///
    /// # Errors
    /// [`NetError::Io`] where it cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), NetError> {
        let path = path.as_ref();
        let io = |source: std::io::Error| NetError::Io {
            path: path.into(),
            source,
        };
        let header = self.header().map_err(|e| io(e.into()))?;
        let folder = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        let mut file = readable_by_all(&mut tempfile::Builder::new())
            .tempfile_in(folder)
            .map_err(io)?;
        let write = |file: &mut tempfile::NamedTempFile| {
            let mut out = std::io::BufWriter::new(file.as_file_mut());
            out.write_all(&(header.len() as u64).to_le_bytes())?;
            out.write_all(&header)?;
            for (_, parameter) in self.parameters() {
                write_little_endian(&mut out, &parameter.values)?;
            }
            out.flush()
        };
        write(&mut file).map_err(io)?;
        file.as_file().sync_all().map_err(io)?;
        file.persist(path).map_err(|e| io(e.error))?;
        Ok(())
    }

    /// The JSON header, padded to a multiple of eight bytes. Written here and not by the `safetensors` crate because that
    /// puts the metadata in an order that changes from run to run.
    fn header(&self) -> Result<Vec<u8>, serde_json::Error> {
        let mut metadata = json!({
            VERSION_KEY: VERSION,
            "spec": serde_json::to_string(self.spec())?,
            "card": serde_json::to_string(self.card())?,
        });
        if self.calibration().fitted_on.is_some() {
            metadata[CALIBRATION_KEY] = serde_json::to_string(self.calibration())?.into();
        }
        let mut header = Map::from_iter([("__metadata__".to_owned(), metadata)]);
        let mut start = 0;
        for (name, parameter) in self.parameters() {
            let end = start + parameter.values.bytes().len();
            let dtype = match parameter.values {
                Values::F16(_) => "F16",
                Values::F32(_) => "F32",
            };
            header.insert(
                name.to_owned(),
                json!({ "dtype": dtype, "shape": parameter.shape, "data_offsets": [start, end] }),
            );
            start = end;
        }
        let mut bytes = serde_json::to_vec(&Value::Object(header))?;
        bytes.resize(bytes.len().next_multiple_of(8), b' ');
        Ok(bytes)
    }
}

/// Temporary files belong to their maker alone unless asked otherwise; a model is a file like any other (umask applies).
#[cfg(unix)]
fn readable_by_all<'a, 'b>(
    builder: &'b mut tempfile::Builder<'a, 'a>,
) -> &'b mut tempfile::Builder<'a, 'a> {
    use std::os::unix::fs::PermissionsExt;
    builder.permissions(std::fs::Permissions::from_mode(0o666))
}

#[cfg(not(unix))]
fn readable_by_all<'a, 'b>(
    builder: &'b mut tempfile::Builder<'a, 'a>,
) -> &'b mut tempfile::Builder<'a, 'a> {
    builder
}

fn write_little_endian(out: &mut impl Write, values: &Values) -> std::io::Result<()> {
    if cfg!(target_endian = "little") {
        return out.write_all(values.bytes());
    }
    match values {
        Values::F16(values) => values
            .iter()
            .try_for_each(|v| out.write_all(&v.to_le_bytes())),
        Values::F32(values) => values
            .iter()
            .try_for_each(|v| out.write_all(&v.to_le_bytes())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> Model {
        Model::random(&crate::random::tiny_compact(), 3).unwrap()
    }

    #[test]
    fn what_is_written_is_read_and_bytes_are_the_same_each_time() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (
            folder.path().join("a.safetensors"),
            folder.path().join("b.safetensors"),
        );
        let model = small();
        model.save(&a).unwrap();
        let read = Model::open(&a).unwrap();
        read.save(&b).unwrap();
        assert_eq!(read.hash(), model.hash());
        assert_eq!((read.spec(), read.card()), (model.spec(), model.card()));
        assert!(model.parameters().eq(read.parameters()));
        assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
        let bytes = std::fs::read(&a).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(
            file.tensor("encoder.0.0.weight").unwrap().dtype(),
            Dtype::F16
        );
        assert_eq!(file.tensor("netvlad.centres").unwrap().dtype(), Dtype::F32);
    }

    #[test]
    fn a_calibration_is_kept_and_changes_no_identity() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        let calibration = Calibration {
            position: crate::PositionError {
                inlier_factor: 2.5,
                shared_px: 1.25,
            },
            fitted_on: Some(crate::FittedOn {
                data: "ten towns".into(),
                ..crate::FittedOn::default()
            }),
            ..Calibration::default()
        };
        small()
            .with_calibration(calibration.clone())
            .save(&path)
            .unwrap();
        let read = Model::open(&path).unwrap();
        assert_eq!(*read.calibration(), calibration);
        assert_eq!(read.hash(), small().hash());
        small().save(&path).unwrap();
        let plain = Model::open(&path).unwrap();
        assert_eq!(*plain.calibration(), Calibration::default());
    }

    #[test]
    fn damaged_files_are_refused_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        small().save(&path).unwrap();
        let good = std::fs::read(&path).unwrap();
        let refuse = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let error = Model::open(&path).unwrap_err().to_string();
            assert!(error.contains("model.safetensors"), "{error}");
            error
        };
        assert!(refuse(b"").contains("not a safetensors file"));
        refuse(&good[..good.len() / 2]);
        refuse(&good[..good.len() - 1]);
        refuse(&[&good[..], b"more"].concat());
        let patch = |from: &str, to: &str| {
            assert_eq!(from.len(), to.len());
            let at = good
                .windows(from.len())
                .position(|w| w == from.as_bytes())
                .unwrap();
            let mut bytes = good.clone();
            bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
            bytes
        };
        assert!(
            refuse(&patch(
                "grimnet_model_version\":\"1\"",
                "grimnet_model_version\":\"9\""
            ))
            .contains("format version")
        );
        assert!(
            refuse(&patch("encoder.0.0.weight", "encoder.9.0.weight"))
                .contains("encoder.0.0.weight")
        );
        assert!(
            refuse(&patch("grimnet_model_version", "grimnet_model_wersion"))
                .contains("grimnet_model_version")
        );
        let mut not_finite = good.clone();
        let last = not_finite.len() - 2;
        not_finite[last..].copy_from_slice(&[0xff, 0x7f]);
        refuse(&not_finite);
        assert!(matches!(
            Model::open(folder.path().join("absent")),
            Err(NetError::Io { .. })
        ));
    }
}
