//! Whether fixes confirm a value of the telemetry, and when searches go without it to test it.

/// A value that no fix has confirmed is tested after so many searches of the whole map in a row without a fix.
const VAIN_SEARCHES: u32 = 3;
/// A confirmation expires after so many, which the first 16 frames of a gap have ([`crate::whole_map`]): water and fields give no fix
/// either, but a compass or a height that was reset in flight makes all searches vain for good.
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
    pub fn searched_in_vain(&mut self, vain_searches: u32) {
        if *self == Self::Holds && vain_searches >= EXPIRES_AFTER {
            *self = Self::Expired;
        }
    }

    /// Whether the next search of the whole map is to go without the value as well, after so many in vain.
    pub fn is_tested(self, vain_searches: u32) -> bool {
        match self {
            Self::None => vain_searches >= VAIN_SEARCHES,
            Self::Holds => false,
            Self::Expired => vain_searches > 0 && vain_searches.is_multiple_of(ONE_OF),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers of vain searches after which a value is tested, of twenty.
    fn tested_after(mut confirmation: Confirmation) -> Vec<u32> {
        (0..20)
            .filter(|vain_searches| {
                confirmation.searched_in_vain(*vain_searches);
                confirmation.is_tested(*vain_searches)
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
