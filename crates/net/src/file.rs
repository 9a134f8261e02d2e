//! The model file: safetensors, with the network description, the model card, the calibration and a checksum in its
//! metadata.
//!
//! Format version 2 has a BLAKE3 checksum of the whole file, computed with the checksum's own digits set to `0`. A file
//! of version 1, which earlier versions of this program wrote, has none and is read with a warning.
//!
//! An int8 tensor `NAME` (only `whitening.projection`) has the scales of its rows in a tensor `NAME.scale`.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Write};
use std::path::Path;

use half::f16;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde_json::{Map, Value, json};

use crate::error::{ModelFileError, ParameterError};
use crate::parameter::{DataType, Parameter, Values, WHITENING_PROJECTION};
use crate::{Calibration, Card, Model, NetError, NetSpec};

/// Version of the layout of names and metadata that is written.
const VERSION: &str = "2";
/// Version without a checksum, read with a warning.
const VERSION_WITHOUT_CHECKSUM: &str = "1";
const VERSION_KEY: &str = "grimnet_model_version";
/// Only in models that were calibrated.
const CALIBRATION_KEY: &str = "calibration";
const CHECKSUM_KEY: &str = "checksum";
/// What stands before the checksum in the header. Quotation marks within JSON strings are escaped, so it cannot occur
/// elsewhere.
const CHECKSUM_PREFIX: &[u8] = b"\"checksum\":\"";
/// Hexadecimal digits of the checksum.
const CHECKSUM_LEN: usize = 64;
/// Bytes of the header's length, with which a safetensors file begins.
const LENGTH_BYTES: usize = 8;
/// Largest file that is read, bytes: ten times `vgg16` in single precision. A limit against files that are no models.
const MOST_BYTES: u64 = 2 << 30;
/// Ending of the name of the tensor with an int8 tensor's scales.
const SCALE_SUFFIX: &str = ".scale";

impl Model {
    /// Reads a model file.
    ///
    /// # Errors
    /// [`NetError::Io`] if it cannot be read, [`NetError::ModelFile`] if it is not a model, is above 2 GiB (which is checked before
    /// it is read), is damaged, or does not fit its own description.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, NetError> {
        let path = path.as_ref();
        let io = |source| NetError::Io {
            path: path.into(),
            source,
        };
        let file = File::open(path).map_err(io)?;
        let found = file.metadata().map_err(io)?.len();
        if found > MOST_BYTES {
            return Err(NetError::ModelFile {
                path: path.into(),
                reason: ModelFileError::TooLarge {
                    found,
                    limit: MOST_BYTES,
                },
            });
        }
        let mut bytes = Vec::with_capacity(found as usize);
        // A device has no length, and may never end.
        file.take(MOST_BYTES).read_to_end(&mut bytes).map_err(io)?;
        Self::from_bytes(&bytes, path)
    }

    /// Reads a model from the bytes of its file. `path` is only named in errors and warnings.
    pub(crate) fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self, NetError> {
        let (model, checked) = parse(bytes).map_err(|reason| NetError::ModelFile {
            path: path.into(),
            reason,
        })?;
        if !checked {
            tracing::warn!(
                "{}: this model file has no checksum (format version {VERSION_WITHOUT_CHECKSUM}), so damage cannot be \
                 detected; export or calibrate the model again to add one",
                path.display()
            );
        }
        Ok(model)
    }

    /// Writes the model file: as a whole or not at all, over whatever file is there. The same model gives the same bytes. A program
    /// that must not replace files of others passes a file of its `grimnet_output::OutputPolicy` to [`Model::write`].
    ///
    /// # Errors
    /// [`NetError::Output`] if it cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), NetError> {
        Ok(grimnet_output::write_atomic(path, |file| self.write(file))?)
    }

    /// Writes the bytes of the model file.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut impl Write) -> std::io::Result<()> {
        self.write_parts(&self.header()?, out)
    }

    fn write_parts(&self, header: &[u8], out: &mut impl Write) -> std::io::Result<()> {
        out.write_all(&(header.len() as u64).to_le_bytes())?;
        out.write_all(header)?;
        for (_, parameter) in self.parameters() {
            write_little_endian(out, &parameter.values)?;
        }
        Ok(())
    }

    /// The JSON header with the checksum, padded to a multiple of eight bytes. Not written by the `safetensors` crate,
    /// which puts the metadata in an order that changes from run to run.
    fn header(&self) -> Result<Vec<u8>, serde_json::Error> {
        let mut metadata = json!({
            VERSION_KEY: VERSION,
            "spec": serde_json::to_string(self.spec())?,
            "card": serde_json::to_string(self.card())?,
            CHECKSUM_KEY: "0".repeat(CHECKSUM_LEN),
        });
        if self.calibration().fitted_on.is_some() {
            metadata[CALIBRATION_KEY] = serde_json::to_string(self.calibration())?.into();
        }
        let mut header = Map::from_iter([("__metadata__".to_owned(), metadata)]);
        let mut start = 0;
        let mut add = |name: String, dtype: &str, shape: &[usize], len: usize| {
            header.insert(
                name,
                json!({ "dtype": dtype, "shape": shape, "data_offsets": [start, start + len] }),
            );
            start += len;
        };
        for (name, parameter) in self.parameters() {
            let (values, scales) = parameter.values.bytes();
            let (dtype, shape) = (parameter.data_type().name(), parameter.shape());
            add(name.to_owned(), dtype, shape, values.len());
            if let Some(scales) = scales {
                let dtype = DataType::F32.name();
                add(
                    format!("{name}{SCALE_SUFFIX}"),
                    dtype,
                    &shape[..1],
                    scales.len(),
                );
            }
        }
        let mut bytes = serde_json::to_vec(&Value::Object(header))?;
        bytes.resize(bytes.len().next_multiple_of(LENGTH_BYTES), b' ');

        let mut hasher = blake3::Hasher::new();
        self.write_parts(&bytes, &mut hasher)
            .map_err(serde_json::Error::io)?;
        if let Some(at) = checksum_position(&bytes) {
            bytes[at..][..CHECKSUM_LEN].copy_from_slice(hasher.finalize().to_hex().as_bytes());
        }
        Ok(bytes)
    }
}

/// Where the checksum's digits begin in a header.
fn checksum_position(header: &[u8]) -> Option<usize> {
    let at = header
        .windows(CHECKSUM_PREFIX.len())
        .position(|bytes| bytes == CHECKSUM_PREFIX)?
        + CHECKSUM_PREFIX.len();
    (at + CHECKSUM_LEN <= header.len()).then_some(at)
}

/// Compares the checksum in the file, if it has one, with that of its bytes. `header_len` does not count the eight bytes
/// of the length before the header.
fn check_checksum(bytes: &[u8], header_len: usize) -> Result<bool, ModelFileError> {
    let header = &bytes[LENGTH_BYTES..][..header_len];
    let Some(at) = checksum_position(header).map(|at| at + LENGTH_BYTES) else {
        return Ok(false);
    };
    let (before, rest) = bytes.split_at(at);
    let (digits, after) = rest.split_at(CHECKSUM_LEN);
    let mut hasher = blake3::Hasher::new();
    hasher.update(before);
    hasher.update(&[b'0'; CHECKSUM_LEN]);
    hasher.update(after);
    let computed = hasher.finalize().to_hex();
    if digits == computed.as_bytes() {
        return Ok(true);
    }
    Err(ModelFileError::Checksum {
        expected: String::from_utf8_lossy(digits).into_owned(),
        computed: computed.to_string(),
    })
}

/// The model in a file's bytes, and whether they have a (valid) checksum.
fn parse(bytes: &[u8]) -> Result<(Model, bool), ModelFileError> {
    let not_safetensors =
        |e: safetensors::SafeTensorError| ModelFileError::NotSafetensors(e.to_string());
    let (header_len, header) = SafeTensors::read_metadata(bytes).map_err(not_safetensors)?;
    let metadata = header
        .metadata()
        .as_ref()
        .ok_or(ModelFileError::MissingMetadata(VERSION_KEY))?;
    let entry = |key: &'static str| {
        metadata
            .get(key)
            .ok_or(ModelFileError::MissingMetadata(key))
    };
    let version = entry(VERSION_KEY)?;
    if version != VERSION && version != VERSION_WITHOUT_CHECKSUM {
        return Err(ModelFileError::Version {
            found: version.clone(),
        });
    }
    let checked = check_checksum(bytes, header_len)?;
    if !checked && version == VERSION {
        return Err(ModelFileError::MissingMetadata(CHECKSUM_KEY));
    }
    let unreadable = |entry| {
        move |e: serde_json::Error| ModelFileError::Metadata {
            entry,
            reason: e.to_string(),
        }
    };
    let spec: NetSpec = serde_json::from_str(entry("spec")?).map_err(unreadable("spec"))?;
    let card: Card = serde_json::from_str(entry("card")?).map_err(unreadable("card"))?;
    let calibration: Option<Calibration> = metadata
        .get(CALIBRATION_KEY)
        .map(|text| serde_json::from_str(text))
        .transpose()
        .map_err(unreadable(CALIBRATION_KEY))?;
    let file = SafeTensors::deserialize(bytes).map_err(not_safetensors)?;
    let refused = |e: NetError| match e {
        NetError::Parameters(e) => ModelFileError::Parameters(e),
        NetError::Spec(e) => ModelFileError::Spec(e),
        NetError::Calibration(e) => ModelFileError::Calibration(e),
        other => ModelFileError::NotSafetensors(other.to_string()),
    };
    let model = Model::from_parameters(spec, card, parameters(&file)?).map_err(refused)?;
    let model = match calibration {
        Some(calibration) => model.with_calibration(calibration).map_err(refused)?,
        None => model,
    };
    Ok((model, checked))
}

/// The tensors of a file by their names.
fn parameters(file: &SafeTensors) -> Result<BTreeMap<String, Parameter>, ModelFileError> {
    let scale_name = format!("{WHITENING_PROJECTION}{SCALE_SUFFIX}");
    let mut tensors: BTreeMap<&str, TensorView> = file.iter().collect();
    let mut scales = tensors.remove(scale_name.as_str());
    let mut parameters = BTreeMap::new();
    for (name, tensor) in tensors {
        let wrong = |name: &str, dtype: Dtype, expected| ModelFileError::DataType {
            name: name.to_owned(),
            found: format!("{dtype:?}"),
            expected,
        };
        let values = match (tensor.dtype(), name) {
            (Dtype::I8, WHITENING_PROJECTION) => {
                let scales = scales.take().ok_or_else(|| missing(&scale_name))?;
                if scales.dtype() != Dtype::F32 {
                    return Err(wrong(&scale_name, scales.dtype(), "F32"));
                }
                // A tensor without axes is one value, and has no rows.
                let rows = tensor.shape().first().copied().unwrap_or(0);
                if scales.shape() != [rows] {
                    return Err(ModelFileError::Parameters(ParameterError::Shape {
                        name: scale_name,
                        found: scales.shape().to_vec(),
                        values: scales.data().len() / size_of::<f32>(),
                        expected: vec![rows],
                    }));
                }
                Values::I8 {
                    values: tensor.data().iter().map(|&v| v as i8).collect(),
                    scales: floats(scales.data()),
                }
            }
            (Dtype::F16, _) => {
                let (halves, _) = tensor.data().as_chunks::<2>();
                Values::F16(halves.iter().map(|&b| f16::from_le_bytes(b)).collect())
            }
            (Dtype::F32, _) => Values::F32(floats(tensor.data())),
            (other, WHITENING_PROJECTION) => return Err(wrong(name, other, "I8, F16 or F32")),
            (other, _) => return Err(wrong(name, other, "F16 or F32")),
        };
        let shape = tensor.shape().to_vec();
        parameters.insert(name.to_owned(), Parameter { shape, values });
    }
    Ok(parameters)
}

fn missing(name: &str) -> ModelFileError {
    ModelFileError::Parameters(ParameterError::Missing(name.to_owned()))
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    let (values, _) = bytes.as_chunks::<4>();
    values.iter().map(|&b| f32::from_le_bytes(b)).collect()
}

fn write_little_endian(out: &mut impl Write, values: &Values) -> std::io::Result<()> {
    if cfg!(target_endian = "little") {
        let (values, scales) = values.bytes();
        out.write_all(values)?;
        return scales.map_or(Ok(()), |scales| out.write_all(scales));
    }
    let singles = |out: &mut dyn Write, values: &[f32]| {
        values
            .iter()
            .try_for_each(|v| out.write_all(&v.to_le_bytes()))
    };
    match values {
        Values::I8 { values, scales } => {
            out.write_all(bytemuck::cast_slice(values))?;
            singles(out, scales)
        }
        Values::F16(values) => values
            .iter()
            .try_for_each(|v| out.write_all(&v.to_le_bytes())),
        Values::F32(values) => singles(out, values),
    }
}

#[cfg(test)]
mod tests;
