//! Whether fixes confirm a value of the telemetry, and when searches go without it to test it.

/// A value that no fix has confirmed is tested after so many searches of the whole map in a row without a fix.
const TESTED_AFTER: u32 = 3;
/// A confirmation expires after so many, which the first 16 frames of a gap have ([`crate::whole_map`]): water and fields give no fix
/// either, but a compass or a height that was reset in flight leaves all searches without a fix for good.
const EXPIRES_AFTER: u32 = 4;
/// A value whose confirmation expired is tested at one of so many searches of the whole map, which is one of 32 frames: a search under
/// every heading or at every scale takes several times as long, and most gaps are of the ground.
const ONE_OF: u32 = 4;

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Confirmation {
    /// No fix has confirmed the value yet.
    #[default]
    None,
    /// A fix confirmed it.
    Holds,
    /// A fix confirmed it before a gap in the fixes.
    Expired,
}

impl Confirmation {
    /// The whole map was searched so often in a row without a fix.
    pub fn searched_without_fix(&mut self, searches_without_fix: u32) {
        if *self == Self::Holds && searches_without_fix >= EXPIRES_AFTER {
            *self = Self::Expired;
        }
    }

    /// Whether the next search of the whole map is to go without the value as well, after so many without a fix.
    pub fn is_tested(self, searches_without_fix: u32) -> bool {
        match self {
            Self::None => searches_without_fix >= TESTED_AFTER,
            Self::Holds => false,
            Self::Expired => {
                searches_without_fix > 0 && searches_without_fix.is_multiple_of(ONE_OF)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers of searches without a fix after which a value is tested, of twenty.
    fn tested_after(mut confirmation: Confirmation) -> Vec<u32> {
        (0..20)
            .filter(|searches_without_fix| {
                confirmation.searched_without_fix(*searches_without_fix);
                confirmation.is_tested(*searches_without_fix)
            })
            .collect()
    }

    #[test]
    fn what_no_fix_confirmed_is_tested_at_each_search_from_the_third_on() {
        let expected: Vec<u32> = (3..20).collect();
        assert_eq!(tested_after(Confirmation::None), expected);
    }

    #[test]
    fn a_confirmation_expires_and_is_then_tested_now_and_then() {
        assert_eq!(tested_after(Confirmation::Holds), [4, 8, 12, 16]);
    }
}
