//! Sets `grimnet_bundled_model` if a trained model is in the source tree.

fn main() {
    let model = "models/compact.safetensors";
    println!("cargo::rustc-check-cfg=cfg(grimnet_bundled_model)");
    println!("cargo::rerun-if-changed=models");
    if std::path::Path::new(model).exists() {
        println!("cargo::rerun-if-changed={model}");
        println!("cargo::rustc-cfg=grimnet_bundled_model");
    }
}
