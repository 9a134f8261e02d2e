//! Output files of the commands: which existing files they may replace.

use grimnet_output::OutputPolicy;

/// First bytes of the files that are known as the program's own by their content: packs.
pub const OWN_MAGICS: &[&[u8]] = &[&grimnet_pack::format::MAGIC];

/// Whether existing files may be replaced; the same option in every command that writes.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct OverwriteChoice {
    /// Replace existing files [default: refuse]
    ///
    /// Packs, and files that grim wrote into a folder of results and nobody changed since, are replaced anyway. Inputs of
    /// the same command are never replaced.
    #[arg(long)]
    pub overwrite: bool,
}

impl OverwriteChoice {
    /// The policy for outputs; the command adds its inputs.
    pub fn policy(self) -> OutputPolicy {
        OutputPolicy::new().overwrite(self.overwrite)
    }
}
