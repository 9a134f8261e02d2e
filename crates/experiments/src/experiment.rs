//! The names of the experiments.

/// The experiments that need no training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Experiment {
    /// Table 2: processing resolution.
    Resolution,
    /// Table 4: combinations of modules.
    Modules,
    /// Table 5: recall for K candidates.
    TopKRecall,
    /// Table 6: error and time for K candidates.
    TopK,
    /// Table 7: changes of light.
    Photometry,
    /// Table 8: methods compared.
    Methods,
    /// Table 9: success.
    Success,
    /// Table 10: domain-adaptive normalisation.
    DaBn,
}

impl Experiment {
    /// All of them; those that cost little come first.
    pub const ALL: [Self; 8] = [
        Self::Success,
        Self::Methods,
        Self::TopKRecall,
        Self::TopK,
        Self::Photometry,
        Self::DaBn,
        Self::Modules,
        Self::Resolution,
    ];

    /// Its name, also that of its table.
    #[must_use]
    pub fn id(self) -> &'static str {
        match self {
            Self::Resolution => "resolution",
            Self::Modules => "modules",
            Self::TopKRecall => "top-k-recall",
            Self::TopK => "top-k",
            Self::Photometry => "photometry",
            Self::Methods => "methods",
            Self::Success => "success",
            Self::DaBn => "da-bn",
        }
    }

    /// What it compares, in words.
    #[must_use]
    pub fn help(self) -> &'static str {
        match self {
            Self::Resolution => "Processing resolution (table 2)",
            Self::Modules => "Combinations of modules (table 4)",
            Self::TopKRecall => "Recall for K candidates (table 5)",
            Self::TopK => "Error and time for K candidates (table 6)",
            Self::Photometry => "Brightness and contrast of the photos (table 7)",
            Self::Methods => "Methods (table 8)",
            Self::Success => "Success rate (table 9)",
            Self::DaBn => "Normalisation by domain (table 10)",
        }
    }
}
