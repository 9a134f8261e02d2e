//! What an earlier, interrupted run left in the journal, checked against the plan.

use std::collections::VecDeque;

use grimnet_output::RecordPlace;

use crate::builder::level_plan::{Item, LevelPlan};
use crate::builder::level_state::LevelState;
use crate::builder::recipe::Recipe;
use crate::builder::record::Record;

/// Kind of a record in the journal: adapted statistics of one level.
pub const STATISTICS: u32 = 2;
/// Kind of a record in the journal: a finished item.
pub const ITEM: u32 = 3;

/// Takes the records of a journal in order and restores the state of each level from them.
pub struct Resume<'a> {
    plans: &'a [LevelPlan],
    recipe: &'a dyn Recipe,
    expected: Vec<Vec<Item>>,
    levels: VecDeque<LevelState>,
}

impl<'a> Resume<'a> {
    /// Expects records of these levels.
    pub fn new(plans: &'a [LevelPlan], recipe: &'a dyn Recipe) -> Self {
        let expected = plans
            .iter()
            .enumerate()
            .map(|(i, plan)| plan.items(i as u32).collect())
            .collect();
        Self {
            plans,
            recipe,
            expected,
            levels: VecDeque::new(),
        }
    }

    /// Takes the next record. Returns `false` if it is not the one that the plan expects.
    pub fn accept(&mut self, kind: u32, place: RecordPlace, content: &[u8]) -> bool {
        match kind {
            STATISTICS => self.accept_statistics(content).is_some(),
            ITEM => self.accept_item(place, content).is_some(),
            _ => false,
        }
    }

    /// States of the levels that were started, in order.
    pub fn into_levels(self) -> VecDeque<LevelState> {
        self.levels
    }

    /// The level that the next record belongs to.
    fn advance(&mut self) -> Option<usize> {
        let done = self
            .levels
            .back()
            .is_none_or(|state| state.items.len() == self.expected[self.levels.len() - 1].len());
        if done {
            if self.levels.len() == self.plans.len() {
                return None;
            }
            self.levels.push_back(LevelState::default());
        }
        Some(self.levels.len() - 1)
    }

    fn accept_statistics(&mut self, content: &[u8]) -> Option<()> {
        let level = self.advance()?;
        let (head, bytes) = content.split_first_chunk::<8>()?;
        let number = u32::from_le_bytes([head[0], head[1], head[2], head[3]]);
        let tiles = u32::from_le_bytes([head[4], head[5], head[6], head[7]]);
        let state = self.levels.back_mut()?;
        if number as usize != level || !state.items.is_empty() {
            return None;
        }
        state.statistics = Some((bytes.to_vec(), tiles));
        Some(())
    }

    fn accept_item(&mut self, place: RecordPlace, content: &[u8]) -> Option<()> {
        let level = self.advance()?;
        let record = Record::from_bytes(content)?;
        let state = self.levels.back_mut()?;
        let item = *self.expected[level].get(state.items.len())?;
        let count = (item.count[0] * item.count[1]) as usize;
        if record.level as usize != level || record.units.len() != count {
            return None;
        }
        self.recipe
            .restore(&self.plans[level], &item, &record, &mut state.frontier)?;
        state.tiles_done += self.recipe.tiles_completed_by(&item);
        state.add(item, place, &record);
        Some(())
    }
}
