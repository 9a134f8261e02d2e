//! What a build leaves out.

/// How to get a command that this build does not have: the cargo feature that holds it.
pub fn message(command: &str, feature: &str) -> String {
    format!(
        "this grim was built without `{command}`; build it with: cargo build --release -p grimnet-cli --features {feature}"
    )
}
