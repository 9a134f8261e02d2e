//! Named tensors of a `.pth` file (both of PyTorch's formats) or a safetensors file.

use super::archive::stored_entries;
use super::pickle::{Reader, Value};
use crate::error::TrainError;
use safetensors::tensor::{Dtype, SafeTensors};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// A tensor of single-precision numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedTensor {
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its numbers.
    pub values: Vec<f32>,
}

/// All floating-point tensors of a state dictionary, by name.
///
/// Reads what `torch.save` writes since 1.6 (a ZIP file) and wrote before (one stream; torchvision's VGG files are such), and
/// safetensors files. Pickled code is never run.
///
/// # Errors
/// [`TrainError::Io`]; [`TrainError::Weights`] where the file is none of these, or cut short.
pub fn read_tensors(path: &Path) -> Result<BTreeMap<String, NamedTensor>, TrainError> {
    let bytes = fs_err::read(path)?;
    let found = if let Some(entries) = stored_entries(&bytes) {
        from_archive(&entries)
    } else if bytes.first() == Some(&0x80) {
        from_stream(&bytes)
    } else {
        from_safetensors(&bytes)
    };
    found.map_err(|reason| TrainError::Weights {
        path: path.to_owned(),
        reason,
    })
}

fn from_archive(entries: &HashMap<String, &[u8]>) -> Result<BTreeMap<String, NamedTensor>, String> {
    let (name, pickle) = entries
        .iter()
        .find(|(name, _)| name.ends_with("data.pkl"))
        .ok_or("it is a ZIP file without data.pkl")?;
    let folder = name.trim_end_matches("data.pkl");
    let state = Reader::new(pickle).value()?;
    tensors_of(&state, &|key| {
        entries.get(&format!("{folder}data/{key}")).copied()
    })
}

/// Magic number, version, machine, state, names of the storages, then each storage: count and numbers.
fn from_stream(bytes: &[u8]) -> Result<BTreeMap<String, NamedTensor>, String> {
    let mut reader = Reader::new(bytes);
    for _ in 0..3 {
        reader.value()?;
    }
    let state = reader.value()?;
    let keys = reader.value()?;
    let mut widths = HashMap::new();
    visit(&state, &mut |_, storage, _, _, _| {
        if let (Some(key), Some(width)) = (storage_key(storage), storage_width(storage)) {
            widths.insert(key.to_owned(), width);
        }
        Ok(())
    })?;
    let mut storages = HashMap::new();
    for key in keys.sequence().unwrap_or_default() {
        let key = key.text().ok_or("its list of storages is damaged")?;
        let count = reader.take(8)?;
        let count = count
            .iter()
            .rev()
            .fold(0usize, |n, b| (n << 8) | usize::from(*b));
        let width = widths
            .get(key)
            .copied()
            .ok_or("it holds a storage of an unknown type")?;
        let length = count
            .checked_mul(width)
            .ok_or("its storages are too long")?;
        storages.insert(key.to_owned(), reader.take(length)?);
    }
    tensors_of(&state, &|key| storages.get(key).copied())
}

fn storage_key(storage: &[Value]) -> Option<&str> {
    storage.get(2)?.text()
}

/// Bytes of a number of a storage.
fn storage_width(storage: &[Value]) -> Option<usize> {
    let Value::Global(name) = storage.get(1)? else {
        return None;
    };
    match name.as_str() {
        "torch FloatStorage" | "torch IntStorage" => Some(4),
        "torch DoubleStorage" | "torch LongStorage" => Some(8),
        "torch HalfStorage" | "torch BFloat16Storage" | "torch ShortStorage" => Some(2),
        "torch ByteStorage" | "torch CharStorage" | "torch BoolStorage" => Some(1),
        _ => None,
    }
}

type Visit<'a> = dyn FnMut(&str, &[Value], i64, &[i64], &[i64]) -> Result<(), String> + 'a;

/// Every tensor of a state dictionary; a checkpoint that keeps it under `state_dict` is opened, too.
fn visit(state: &Value, each: &mut Visit<'_>) -> Result<(), String> {
    let Value::Dict(entries) = state else {
        return Err("it holds no state dictionary (save `model.state_dict()`)".into());
    };
    for (key, value) in entries {
        match value {
            Value::Tensor {
                storage,
                offset,
                shape,
                stride,
            } => each(
                key.text().unwrap_or_default(),
                storage,
                *offset,
                shape,
                stride,
            )?,
            Value::Dict(_) if key.text() == Some("state_dict") => visit(value, each)?,
            _ => {}
        }
    }
    Ok(())
}

fn tensors_of<'a>(
    state: &Value,
    bytes_of: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<BTreeMap<String, NamedTensor>, String> {
    let mut out = BTreeMap::new();
    visit(state, &mut |name, storage, offset, shape, stride| {
        let float = matches!(storage.get(1), Some(Value::Global(t)) if t == "torch FloatStorage");
        if !float {
            return Ok(());
        }
        let key = storage_key(storage).ok_or("a tensor has no storage")?;
        let bytes = bytes_of(key).ok_or_else(|| format!("the storage of `{name}` is missing"))?;
        let shape = lengths(shape).ok_or_else(|| format!("`{name}` has a wrong shape"))?;
        let values = gather(bytes, offset, &shape, stride)
            .ok_or_else(|| format!("`{name}` reaches outside its storage"))?;
        out.insert(name.to_owned(), NamedTensor { shape, values });
        Ok(())
    })?;
    Ok(out)
}

fn lengths(shape: &[i64]) -> Option<Vec<usize>> {
    shape.iter().map(|n| usize::try_from(*n).ok()).collect()
}

/// A strided tensor's numbers in row-major order.
fn gather(bytes: &[u8], offset: i64, shape: &[usize], stride: &[i64]) -> Option<Vec<f32>> {
    let numbers = bytes.as_chunks::<4>().0;
    let count = shape.iter().try_fold(1usize, |n, k| n.checked_mul(*k))?;
    if stride.len() != shape.len() || count > numbers.len() {
        return None;
    }
    (0..count)
        .map(|i| {
            let (mut rest, mut at) = (i, offset);
            for (length, step) in shape.iter().zip(stride).rev() {
                at = at.checked_add(i64::try_from(rest % length).ok()?.checked_mul(*step)?)?;
                rest /= length;
            }
            numbers
                .get(usize::try_from(at).ok()?)
                .map(|b| f32::from_le_bytes(*b))
        })
        .collect()
}

fn from_safetensors(bytes: &[u8]) -> Result<BTreeMap<String, NamedTensor>, String> {
    let file = SafeTensors::deserialize(bytes)
        .map_err(|error| format!("it is neither a PyTorch nor a safetensors file ({error})"))?;
    Ok(file
        .tensors()
        .into_iter()
        .filter_map(|(name, view)| {
            let values = match view.dtype() {
                Dtype::F32 => view
                    .data()
                    .as_chunks::<4>()
                    .0
                    .iter()
                    .map(|b| f32::from_le_bytes(*b))
                    .collect(),
                Dtype::F16 => view
                    .data()
                    .as_chunks::<2>()
                    .0
                    .iter()
                    .map(|b| half::f16::from_le_bytes(*b).to_f32())
                    .collect(),
                _ => return None,
            };
            let shape = view.shape().to_vec();
            Some((name, NamedTensor { shape, values }))
        })
        .collect())
}
