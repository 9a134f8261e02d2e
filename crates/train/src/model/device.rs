//! The training device: the CPU, or a GPU if the build supports one.

use crate::error::TrainError;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// The device that computes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Accelerator {
    /// The CPU, with the kernels of `grimnet-kernels`.
    #[default]
    Cpu,
    /// The best GPU that has a Vulkan driver; needs the feature `vulkan`.
    Vulkan,
    /// The first NVIDIA GPU; needs the feature `cuda`.
    Cuda,
}

impl FromStr for Accelerator {
    type Err = TrainError;

    fn from_str(name: &str) -> Result<Self, TrainError> {
        match name {
            "cpu" => Ok(Self::Cpu),
            "vulkan" => Ok(Self::Vulkan),
            "cuda" => Ok(Self::Cuda),
            other => Err(TrainError::Config {
                reason: format!("unknown device `{other}`; use cpu, vulkan or cuda"),
            }),
        }
    }
}

impl Accelerator {
    /// The device.
    ///
    /// # Errors
    /// [`TrainError::Config`] if the build does not support the device, or there is no such GPU.
    pub fn device(self) -> Result<Device, TrainError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => self.found(|| Device::vulkan(burn::tensor::DeviceKind::DefaultDevice)),
            #[cfg(feature = "cuda")]
            Self::Cuda => self.found(|| Device::cuda(0)),
            #[cfg(not(all(feature = "vulkan", feature = "cuda")))]
            other => Err(TrainError::Config {
                reason: format!(
                    "this build does not support `device = \"{name}\"`; build with the cargo feature `{name}`",
                    name = format!("{other:?}").to_lowercase()
                ),
            }),
        }
    }

    /// A GPU that passes a test computation; burn panics if there is none.
    #[cfg(any(feature = "vulkan", feature = "cuda"))]
    fn found(self, open: impl FnOnce() -> Device) -> Result<Device, TrainError> {
        let probed = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let device = open();
            let two = burn::tensor::Tensor::<1>::ones([1], &device) + 1.0;
            crate::model::parameters::host(two).map(|values| (device, values))
        }));
        match probed {
            Ok(Ok((device, values))) if values == [2.0] => Ok(device),
            _ => Err(TrainError::Config {
                reason: format!(
                    "no GPU found with {self:?}; install what it needs (TRAINING.md, \"On a GPU\"), or set `device = \"cpu\"`"
                ),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_what_is_missing_is_named() {
        assert_eq!("cpu".parse::<Accelerator>().unwrap(), Accelerator::Cpu);
        assert!(
            "tpu"
                .parse::<Accelerator>()
                .unwrap_err()
                .to_string()
                .contains("cuda")
        );
        assert!(Accelerator::Cpu.device().is_ok());
        #[cfg(not(feature = "cuda"))]
        assert!(
            Accelerator::Cuda
                .device()
                .unwrap_err()
                .to_string()
                .contains("feature `cuda`")
        );
    }
}
