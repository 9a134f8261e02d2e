//! Makes EVALUATION.md from the stored figures: `cargo run -p grimnet-experiments --example evaluation`.

use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let page = grimnet_experiments::claims::page(&root.join("evaluation"))?;
    fs_err::write(root.join("EVALUATION.md"), page)?;
    Ok(())
}
