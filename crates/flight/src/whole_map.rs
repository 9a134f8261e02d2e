//! When the whole map is searched because the windows give nothing that the track believes.

use grimnet_locate::Localizer;

/// Whole-map searches without a fix double the frames until the next one, up to this many times.
const MOST_DOUBLINGS: u32 = 3;

/// Frames that the track did not accept, and what the whole map gave for them.
///
/// After two of them or so the aircraft may be somewhere else, so the whole map is searched as well, at every frame while that
/// gives fixes: a place is believed only after several. Over water and fields it gives none, and is searched less and less often.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct WholeMap {
    misses: u32,
    /// Searches of the whole map in a row that gave no fix.
    empty: u32,
    /// Frames until the next one.
    wait: u32,
}

impl WholeMap {
    /// Whether the whole map is to be searched after the windows: the track asks for it, or so many frames were missed.
    pub fn is_due(&self, asked: bool, after_misses: u32) -> bool {
        self.wait == 0 && (asked || self.misses >= after_misses)
    }

    /// Searches of the whole map in a row that gave no fix.
    pub fn searches_without_fix(&self) -> u32 {
        self.empty
    }

    /// The track accepted a fix.
    pub fn accepted(&mut self) {
        *self = Self::default();
    }

    /// A frame gave a fix that the track did not accept, or none.
    pub fn missed(&mut self, whole_map_was_searched: bool, has_fix: bool) {
        self.misses = self.misses.saturating_add(1);
        if has_fix {
            (self.empty, self.wait) = (0, 0);
        } else if whole_map_was_searched {
            self.empty = self.empty.saturating_add(1);
            self.wait = (1 << self.empty.min(MOST_DOUBLINGS)) - 1;
        } else {
            self.wait = self.wait.saturating_sub(1);
        }
    }
}

/// Area of the map, square metres; `None` for a pack without levels.
pub(crate) fn map_area_m2(localizer: &Localizer) -> Option<f64> {
    let level = localizer.pack().levels().first()?;
    let [width_px, height_px] = level.size_px();
    let area_m2 = width_px as f64 * height_px as f64 * level.gsd_m() * level.gsd_m();
    (area_m2.is_finite() && area_m2 > 0.0).then_some(area_m2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of 30 at which the whole map is searched.
    fn searched(asked: bool, fix_on_whole_map: bool) -> Vec<u32> {
        let mut whole_map = WholeMap::default();
        (0..30)
            .filter(|_| {
                let due = whole_map.is_due(asked, 2);
                whole_map.missed(due, due && fix_on_whole_map);
                due
            })
            .collect()
    }

    #[test]
    fn over_water_it_is_searched_less_and_less_often() {
        assert_eq!(searched(false, false), [2, 4, 8, 16, 24]);
        assert_eq!(searched(true, false), [0, 2, 6, 14, 22]);
    }

    #[test]
    fn while_it_gives_fixes_every_frame_until_one_is_accepted() {
        assert_eq!(searched(false, true), (2..30).collect::<Vec<_>>());
        let mut whole_map = WholeMap::default();
        for _ in 0..5 {
            whole_map.missed(true, false);
        }
        whole_map.accepted();
        assert!(!whole_map.is_due(false, 2));
        assert!(whole_map.is_due(true, 2));
    }
}
