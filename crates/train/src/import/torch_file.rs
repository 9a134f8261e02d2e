//! Named tensors of a `.pth` or safetensors file.

use crate::error::TrainError;
use pytorch_reader::{DType, PytorchError, PytorchReader};
use safetensors::tensor::{Dtype, SafeTensors};
use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::Path;

/// First bytes of a ZIP file, which `torch.save` writes since PyTorch 1.6.
const ZIP: &[u8] = b"PK";
/// First byte of a pickle stream, which `torch.save` wrote before; torchvision's VGG files are such.
const PICKLE: u8 = 0x80;
/// Key of the state dictionary in checkpoints that contain more than it.
const STATE_DICT: &str = "state_dict.";

/// A tensor of single-precision numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedTensor {
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its values.
    pub values: Vec<f32>,
}

type Tensors = BTreeMap<String, NamedTensor>;

/// All tensors of single or half precision of a state dictionary, by name. Reads files of `torch.save`, with the state dictionary
/// at the root or under `state_dict`, and safetensors files. Pickled code is never run.
///
/// # Errors
/// [`TrainError::Io`]; [`TrainError::Weights`] if the file is neither, is damaged, or has no such tensors.
pub fn read_tensors(path: &Path) -> Result<Tensors, TrainError> {
    let mut start = Vec::new();
    let file = fs_err::File::open(path)?;
    file.take(ZIP.len() as u64).read_to_end(&mut start)?;
    let found = if start == ZIP || start.first() == Some(&PICKLE) {
        from_pytorch(path)
    } else {
        from_safetensors(&fs_err::read(path)?)
    };
    let found = found.and_then(|tensors| {
        if tensors.is_empty() {
            return Err("no tensors found; save the weights as `model.state_dict()`".to_owned());
        }
        Ok(tensors)
    });
    found.map_err(|reason| TrainError::Weights {
        path: path.to_owned(),
        reason,
    })
}

fn from_pytorch(path: &Path) -> Result<Tensors, String> {
    let wrong = |error: PytorchError| error.to_string();
    let mut reader = PytorchReader::new(path).map_err(wrong)?;
    if reader.is_empty() {
        reader = PytorchReader::with_top_level_key(path, "state_dict").map_err(wrong)?;
    }
    let mut out = Tensors::new();
    for (name, tensor) in reader.into_tensors() {
        let decode: fn(&[u8]) -> Vec<f32> = match tensor.dtype() {
            DType::F32 => from_f32,
            DType::F16 => from_f16,
            _ => continue,
        };
        let bytes = tensor
            .read()
            .map_err(|error| format!("`{name}`: {error}"))?;
        let tensor = NamedTensor {
            shape: tensor.shape().to_vec(),
            values: decode(&bytes),
        };
        let name = name.strip_prefix(STATE_DICT).unwrap_or(&name).to_owned();
        out.insert(name, tensor);
    }
    Ok(out)
}

fn from_safetensors(bytes: &[u8]) -> Result<Tensors, String> {
    let file = SafeTensors::deserialize(bytes)
        .map_err(|error| format!("neither a PyTorch nor a safetensors file ({error})"))?;
    Ok(file
        .tensors()
        .into_iter()
        .filter_map(|(name, view)| {
            let values = match view.dtype() {
                Dtype::F32 => from_f32(view.data()),
                Dtype::F16 => from_f16(view.data()),
                _ => return None,
            };
            let shape = view.shape().to_vec();
            Some((name, NamedTensor { shape, values }))
        })
        .collect())
}

fn from_f32(bytes: &[u8]) -> Vec<f32> {
    let (values, _) = bytes.as_chunks::<4>();
    values.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

fn from_f16(bytes: &[u8]) -> Vec<f32> {
    let (values, _) = bytes.as_chunks::<2>();
    values
        .iter()
        .map(|b| half::f16::from_le_bytes(*b).to_f32())
        .collect()
}
