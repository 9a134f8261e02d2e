//! Weights of other programs: torchvision's VGG-16, from PyTorch and safetensors files.

mod torch_file;
mod vgg16;

pub use torch_file::{NamedTensor, read_tensors};
pub use vgg16::{TorchvisionEncoder, encoder_from_torchvision};
