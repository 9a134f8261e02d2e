//! A fixed lag: inputs may come late and swapped, the state is as if they had come in order.

use std::collections::VecDeque;

use crate::{filter::Filter, input::Input, options::TrackOptions};

/// The state is kept after every so many inputs; a late input replays those after it.
const INPUTS_PER_SNAPSHOT: usize = 16;

/// The inputs of the last seconds in order of time, and states to start from.
#[derive(Debug, Clone)]
pub(crate) struct Lag {
    /// State before all inputs that are kept.
    base: Filter,
    entries: VecDeque<Entry>,
    /// State after all of them.
    head: Filter,
}

#[derive(Debug, Clone)]
struct Entry {
    input: Input,
    /// State after this input.
    after: Option<Box<Filter>>,
}

/// How an input was taken in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Taken {
    /// It is the newest.
    InOrder,
    /// It came late: what came after it was computed again.
    Late,
    /// It was there already and changes nothing.
    Duplicate,
    /// It confirms that a clock was set: the filter started again with it and with those refused before it that agree.
    Restarted,
}

impl Lag {
    pub fn new() -> Self {
        Self::of(Filter::new(false))
    }

    /// Without any input, after what was taken in before.
    pub fn restarted(&self) -> Self {
        Self::of(Filter::new(self.head.has_begun))
    }

    fn of(filter: Filter) -> Self {
        Self {
            base: filter.clone(),
            entries: VecDeque::new(),
            head: filter,
        }
    }

    /// The state after all inputs.
    pub fn head(&self) -> &Filter {
        &self.head
    }

    /// Time of the newest input.
    pub fn newest_s(&self) -> Option<f64> {
        self.entries.back().map(|entry| entry.input.time_s())
    }

    /// Puts an input in its place. It must be valid and not older than the lag.
    pub fn push(&mut self, input: Input, options: &TrackOptions) -> Taken {
        let place = self
            .entries
            .partition_point(|entry| entry.input.order(&input).is_lt());
        if let Some(same) = self.entries.get(place)
            && same.input.order(&input).is_eq()
        {
            return Taken::Duplicate;
        }
        let in_order = place == self.entries.len();
        self.entries.insert(place, Entry { input, after: None });
        if in_order {
            self.head.apply(&input, options);
            self.keep_snapshot(place);
            self.forget(options.lag_s);
            return Taken::InOrder;
        }
        for entry in self.entries.range_mut(place..) {
            entry.after = None;
        }
        let (mut state, first) = self.state_before(place);
        for at in first..self.entries.len() {
            state.apply(&self.entries[at].input, options);
            if (at + 1) % INPUTS_PER_SNAPSHOT == 0 {
                self.entries[at].after = Some(Box::new(state.clone()));
            }
        }
        self.head = state;
        Taken::Late
    }

    /// The state after all inputs up to a time, and none if that time is before what is kept.
    pub fn state_at(&self, time_s: f64, options: &TrackOptions) -> Option<Filter> {
        let end = self
            .entries
            .partition_point(|entry| entry.input.time_s() <= time_s);
        if end == self.entries.len() {
            return Some(self.head.clone());
        }
        let kept = (f64::MIN..=time_s).contains(&self.base.time_s);
        if end == 0 && !kept {
            return None;
        }
        let (mut state, first) = self.state_before(end);
        for entry in self.entries.range(first..end) {
            state.apply(&entry.input, options);
        }
        Some(state)
    }

    /// A state before the entry `place`, and the first entry that it does not contain.
    fn state_before(&self, place: usize) -> (Filter, usize) {
        (0..place)
            .rev()
            .find_map(|at| Some(((**self.entries[at].after.as_ref()?).clone(), at + 1)))
            .unwrap_or_else(|| (self.base.clone(), 0))
    }

    fn keep_snapshot(&mut self, place: usize) {
        let since = self
            .entries
            .range(..place)
            .rev()
            .take_while(|entry| entry.after.is_none())
            .count();
        if since + 1 >= INPUTS_PER_SNAPSHOT {
            self.entries[place].after = Some(Box::new(self.head.clone()));
        }
    }

    /// Drops what is older than the lag, as far as there is a state to start from.
    fn forget(&mut self, lag_s: f64) {
        let Some(newest_s) = self.newest_s() else {
            return;
        };
        while let Some(end) = self
            .entries
            .iter()
            .take(2 * INPUTS_PER_SNAPSHOT)
            .take_while(|entry| entry.input.time_s() < newest_s - lag_s)
            .position(|entry| entry.after.is_some())
        {
            if let Some(state) = self.entries.drain(..=end).next_back().and_then(|e| e.after) {
                self.base = *state;
            }
        }
    }
}
