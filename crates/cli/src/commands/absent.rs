//! What a build leaves out.

/// How to get a command that this build does not have: the cargo feature that holds it.
pub fn message(command: &str, feature: &str) -> String {
    format!(
        "this grim was built without `{command}`; install it with: cargo install --locked --path crates/cli --features {feature}"
    )
}
