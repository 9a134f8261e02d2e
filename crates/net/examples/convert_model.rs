//! Converts a model file: stores the whitening projection in another precision, and adds the checksum that older files
//! lack.
//!
//! ```text
//! cargo run --release -p grimnet-net --example convert_model -- MODEL.safetensors OUT.safetensors [i8|f16|f32]
//! ```
//!
//! Without a precision the weights stay as they are. With another one the model's identity changes, and packs must be
//! built again. The calibration is kept.

use std::error::Error;

use grimnet_net::{DataType, Model};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, precision @ ..] = &arguments[..] else {
        return Err("usage: convert_model MODEL.safetensors OUT.safetensors [i8|f16|f32]".into());
    };
    let model = Model::open(input)?;
    let model = match precision {
        [] => model,
        [precision] => {
            let precision = match precision.as_str() {
                "i8" => DataType::I8,
                "f16" => DataType::F16,
                "f32" => DataType::F32,
                other => return Err(format!("precision '{other}': expected i8, f16 or f32").into()),
            };
            model.with_whitening_precision(precision)?
        }
        _ => return Err("expected at most three arguments".into()),
    };
    model.save(output)?;
    Ok(())
}
