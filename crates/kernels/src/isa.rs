//! The instruction sets that the kernels are written for, and which of them to use.

use std::fmt;
use std::str::FromStr;

/// Environment variable that overrides [`Isa::detect`]: `portable`, `avx2`, `avx512` or `neon`.
pub const ISA_VARIABLE: &str = "GRIMNET_ISA";

/// An instruction set that the kernels can use.
///
/// Every kernel takes one and gives the same result to within rounding for each of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Isa {
    /// Plain Rust that any processor runs.
    Portable,
    /// x86-64 with AVX2 and FMA (Haswell, Zen and later).
    Avx2,
    /// x86-64 with AVX-512 F, BW, DQ and VL (Skylake-X, Zen 4 and later). VNNI is used where the processor has it.
    Avx512,
    /// 64-bit Arm with NEON, which all of them have.
    Neon,
}

impl Isa {
    /// The instruction sets that this processor can run, slowest first; always begins with [`Isa::Portable`].
    #[must_use]
    pub fn available() -> Vec<Isa> {
        [Isa::Portable, Isa::Neon, Isa::Avx2, Isa::Avx512]
            .into_iter()
            .filter(|isa| isa.is_available())
            .collect()
    }

    /// Whether this processor can run it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Isa::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
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

    /// The fastest instruction set of this processor, or the one named by the environment variable [`ISA_VARIABLE`]
    /// (ignored with a warning where it is unknown or the processor lacks it).
    #[must_use]
    pub fn detect() -> Isa {
        let best = Isa::available().last().copied().unwrap_or(Isa::Portable);
        let Ok(wanted) = std::env::var(ISA_VARIABLE) else {
            return best;
        };
        match wanted.parse::<Isa>() {
            Ok(isa) if isa.is_available() => isa,
            Ok(isa) => {
                tracing::warn!("{ISA_VARIABLE}={isa}: this processor lacks it, using {best}");
                best
            }
            Err(UnknownIsa(name)) => {
                tracing::warn!(
                    "{ISA_VARIABLE}={name}: not one of portable, avx2, avx512, neon; using {best}"
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

/// The name is none of `portable`, `avx2`, `avx512`, `neon`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown instruction set '{0}': use portable, avx2, avx512 or neon")]
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
    fn portable_is_always_there_and_detect_is_available() {
        assert_eq!(Isa::available()[0], Isa::Portable);
        assert!(Isa::detect().is_available());
    }
}
