//! Commands and options that this build leaves out: they are accepted and answered with how to get them.

/// Arguments of a command that this build leaves out, whatever they are.
#[cfg(not(feature = "experiments"))]
#[derive(Debug, clap::Args)]
#[command(disable_help_flag = true)]
pub struct AbsentArgs {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    arguments: Vec<std::ffi::OsString>,
}

/// What to tell a user who asks for `what`, which needs the cargo feature `feature`.
pub fn message(what: &str, feature: &str) -> String {
    format!(
        "{what}: not part of this build of grim; build it with: cargo build --release -p {} --features {feature}",
        env!("CARGO_PKG_NAME")
    )
}
