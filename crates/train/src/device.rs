//! What computes: the CPU, or a GPU that this build knows.

use crate::TrainError;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Where training runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Accelerator {
    /// The processor, with the trainer's own kernels.
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
                reason: format!("`{other}` is no device; write cpu, vulkan or cuda"),
            }),
        }
    }
}

impl Accelerator {
    /// The device.
    ///
    /// # Errors
    /// [`TrainError::Config`] where this build does not know it, or no such GPU answers.
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
                    "this program was built without {other:?}; build it with `--features {}`",
                    format!("{other:?}").to_lowercase()
                ),
            }),
        }
    }

    /// A GPU, if there is one that computes: burn panics where there is none.
    #[cfg(any(feature = "vulkan", feature = "cuda"))]
    fn found(self, open: impl FnOnce() -> Device) -> Result<Device, TrainError> {
        let probed = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let device = open();
            let two = burn::tensor::Tensor::<1>::ones([1], &device) + 1.0;
            crate::parameters::host(two).map(|values| (device, values))
        }));
        match probed {
            Ok(Ok((device, values))) if values == [2.0] => Ok(device),
            _ => Err(TrainError::Config {
                reason: format!(
                    "no GPU answers through {self:?}: install its driver, or write `device = \"cpu\"`"
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
                .contains("--features cuda")
        );
    }
}
