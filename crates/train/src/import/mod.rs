//! Weights of other programs: torchvision's VGG-16, as PyTorch or safetensors files hold it.

mod archive;
mod pickle;
mod torch_file;
mod vgg16;

pub use torch_file::{NamedTensor, read_tensors};
pub use vgg16::encoder_from_torchvision;
