//! The `grim` program.
fn main() {}
