//! The instruction sets for which the kernels are written, and the choice among them.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

/// Environment variable that overrides [`Isa::detect`]: `portable`, `avx2`, `avx512` or `neon`. It is read once.
pub const ISA_VARIABLE: &str = "GRIMNET_ISA";

/// The instruction set of this process, once it is decided.
static SELECTED: OnceLock<Isa> = OnceLock::new();

/// An instruction set that the kernels can use.
///
/// Every kernel takes one as an argument; the results are equal to within rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Isa {
    /// Plain Rust, on every processor.
    Portable,
    /// x86-64 with AVX2, FMA and F16C (Haswell, Zen and later).
    Avx2,
    /// x86-64 with AVX-512 F, BW, DQ and VL (Skylake-X, Zen 4 and later). VNNI is used if the processor has it.
    Avx512,
    /// 64-bit Arm with NEON, which every such processor has.
    Neon,
}

impl Isa {
    /// The instruction sets that this processor supports, slowest first. The first is always [`Isa::Portable`].
    #[must_use]
    pub fn available() -> Vec<Isa> {
        [Isa::Portable, Isa::Neon, Isa::Avx2, Isa::Avx512]
            .into_iter()
            .filter(|isa| isa.is_available())
            .collect()
    }

    /// Whether this processor supports it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Isa::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("fma")
                    && is_x86_feature_detected!("f16c")
            }
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => {
                Isa::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => true,
            #[allow(unreachable_patterns)]
            _ => false,
        }
    }

    /// The instruction set that this process uses. It is decided at the first call and does not change afterwards: the one
    /// given to [`Isa::select`], else the one named by the environment variable [`ISA_VARIABLE`] (ignored with a warning if
    /// it is unknown or the processor does not support it), else the fastest that the processor supports.
    #[must_use]
    pub fn detect() -> Isa {
        *SELECTED.get_or_init(|| {
            let name = std::env::var(ISA_VARIABLE).ok();
            Isa::from_name_or_best(name.as_deref())
        })
    }

    /// Whether convolutions of bytes are faster than those of floats: with AVX-512 VNNI, AVX-VNNI or Arm's `sdot`. Without them they take
    /// longer.
    #[must_use]
    pub fn has_byte_products(self) -> bool {
        crate::quantised::has_byte_products(self)
    }

    /// Makes this the instruction set of the process, for tests and benchmarks. Call it before anything else of this crate.
    ///
    /// # Errors
    /// [`SelectIsaError::NotAvailable`] if the processor does not support it, [`SelectIsaError::AlreadyDecided`] if the
    /// process already uses another one.
    pub fn select(self) -> Result<(), SelectIsaError> {
        if !self.is_available() {
            return Err(SelectIsaError::NotAvailable(self));
        }
        match *SELECTED.get_or_init(|| self) {
            used if used == self => Ok(()),
            used => Err(SelectIsaError::AlreadyDecided { used, wanted: self }),
        }
    }

    /// The instruction set of that name, or the fastest one.
    fn from_name_or_best(name: Option<&str>) -> Isa {
        let best = Isa::available().last().copied().unwrap_or(Isa::Portable);
        let Some(name) = name else {
            return best;
        };
        match name.parse::<Isa>() {
            Ok(isa) if isa.is_available() => isa,
            Ok(isa) => {
                tracing::warn!(
                    "{ISA_VARIABLE}={isa}: this processor does not support it; using {best}"
                );
                best
            }
            Err(UnknownIsa(name)) => {
                tracing::warn!(
                    "{ISA_VARIABLE}={name}: unknown instruction set, expected portable, avx2, avx512 or neon; using {best}"
                );
                best
            }
        }
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Isa::Portable => "portable",
            Isa::Avx2 => "avx2",
            Isa::Avx512 => "avx512",
            Isa::Neon => "neon",
        })
    }
}

/// Why an instruction set could not be selected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SelectIsaError {
    /// The processor does not support it.
    #[error("this processor does not support the instruction set {0}")]
    NotAvailable(Isa),
    /// The process already uses another one.
    #[error("the instruction set {wanted} was selected too late: {used} is in use already")]
    AlreadyDecided {
        /// In use.
        used: Isa,
        /// To be selected.
        wanted: Isa,
    },
}

/// The name is not `portable`, `avx2`, `avx512` or `neon`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown instruction set '{0}', expected portable, avx2, avx512 or neon")]
pub struct UnknownIsa(pub String);

impl FromStr for Isa {
    type Err = UnknownIsa;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        match name.to_ascii_lowercase().as_str() {
            "portable" => Ok(Isa::Portable),
            "avx2" => Ok(Isa::Avx2),
            "avx512" => Ok(Isa::Avx512),
            "neon" => Ok(Isa::Neon),
            _ => Err(UnknownIsa(name.to_owned())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512, Isa::Neon] {
            assert_eq!(isa.to_string().parse(), Ok(isa));
        }
        assert_eq!("sse".parse::<Isa>(), Err(UnknownIsa("sse".into())));
    }

    #[test]
    fn the_choice_is_available_and_does_not_change() {
        assert_eq!(Isa::available()[0], Isa::Portable);
        let used = Isa::detect();
        assert!(used.is_available());
        assert_eq!(used.select(), Ok(()));
        for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512, Isa::Neon] {
            if isa != used {
                assert!(isa.select().is_err(), "{isa}");
            }
        }
        assert_eq!(Isa::detect(), used);
    }

    #[test]
    fn the_environment_names_an_instruction_set_that_the_processor_has() {
        let best = Isa::available().last().copied().unwrap_or(Isa::Portable);
        assert_eq!(Isa::from_name_or_best(None), best);
        assert_eq!(Isa::from_name_or_best(Some("Portable")), Isa::Portable);
        assert_eq!(Isa::from_name_or_best(Some("sse")), best);
        for isa in [Isa::Avx2, Isa::Neon] {
            let found = Isa::from_name_or_best(Some(&isa.to_string()));
            assert_eq!(found, if isa.is_available() { isa } else { best });
        }
    }
}
