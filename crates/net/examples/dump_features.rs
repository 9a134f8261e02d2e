//! Writes the network's outputs for an image to a safetensors file, for comparison with another implementation.
//!
//! ```text
//! cargo run --release -p grimnet-net --example dump_features -- MODEL.safetensors IMAGE sat|uav OUT.safetensors
//! ```
//!
//! The image is cropped at its centre to multiples of 32 px, at most 544. `image` is the crop (H x W x 3 bytes), then
//! `heatmap` (H x W), `descriptors` (H/8 x W/8 x D) and `global`, all f32.

use std::error::Error;

use grimnet_net::{Domain, Extractor, Model};
use safetensors::tensor::{Dtype, TensorView};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, picture, domain, output] = &arguments[..] else {
        return Err("usage: dump_features MODEL.safetensors IMAGE sat|uav OUT.safetensors".into());
    };
    let domain = if domain == "sat" {
        Domain::Sat
    } else {
        Domain::Uav
    };
    let picture = image::open(picture)?.to_rgb8();
    let side = |v: u32| (v / 32 * 32).min(544);
    let (width, height) = (side(picture.width()), side(picture.height()));
    let (x, y) = (
        (picture.width() - width) / 2,
        (picture.height() - height) / 2,
    );
    let crop = image::imageops::crop_imm(&picture, x, y, width, height).to_image();

    let model = Model::open(model)?;
    let dense = Extractor::new(&model, domain)?.dense(&crop, None)?;
    let global = model.global_descriptor(&dense.vlad([0, 0, width, height], None));
    let descriptors = dense.descriptors().to_hwc();
    let (w, h) = (width as usize, height as usize);
    let floats =
        |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let all = [
        ("image", Dtype::U8, vec![h, w, 3], crop.into_raw()),
        ("heatmap", Dtype::F32, vec![h, w], floats(dense.heatmap())),
        (
            "descriptors",
            Dtype::F32,
            vec![h / 8, w / 8, model.spec().descriptor_dim],
            floats(&descriptors),
        ),
        ("global", Dtype::F32, vec![global.len()], floats(&global)),
    ];
    let views = all.iter().map(|(name, dtype, shape, bytes)| {
        Ok((*name, TensorView::new(*dtype, shape.clone(), bytes)?))
    });
    let views = views.collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
    safetensors::serialize_to_file(views, None, output.as_ref())?;
    Ok(())
}
