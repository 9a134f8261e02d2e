//! The identity of a model.

use std::collections::BTreeMap;
use std::fmt;

use crate::error::SpecError;
use crate::parameter::Parameter;
use crate::{NetError, NetSpec};

/// Identity of a model: BLAKE3 hash of its network description and tensors, without card and calibration. Displayed in
/// hexadecimal.
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

/// BLAKE3 of the description, then of every tensor's name, shape, data type and bytes in the order of names. Each part is
/// preceded by its length.
pub(crate) fn hash(
    spec: &NetSpec,
    parameters: &BTreeMap<String, Parameter>,
) -> Result<ModelHash, NetError> {
    let mut hasher = blake3::Hasher::new();
    let mut add = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    let spec =
        serde_json::to_vec(spec).map_err(|e| NetError::Spec(SpecError::Json(e.to_string())))?;
    add(&spec);
    for (name, parameter) in parameters {
        add(name.as_bytes());
        add(format!("{}{:?}", parameter.data_type().name(), parameter.shape).as_bytes());
        let (values, scales) = parameter.values.bytes();
        add(values);
        scales.into_iter().for_each(&mut add);
    }
    Ok(ModelHash(*hasher.finalize().as_bytes()))
}
