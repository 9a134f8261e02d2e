//! A cache of decoded blocks with a byte budget; the least recently used block is dropped first.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use crate::GeoError;
use crate::block::{Block, BlockSource};

/// Identifies a block among all sources that share a cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    source: usize,
    level: usize,
    column: u64,
    row: u64,
}

#[derive(Default)]
struct State {
    blocks: HashMap<Key, (Arc<Block>, u64)>,
    /// Keys by the time of their last use.
    by_use: BTreeMap<u64, Key>,
    clock: u64,
    bytes: usize,
    budget_bytes: usize,
}

/// A cache of decoded blocks. Several sources (the pictures of a mosaic) may share one.
///
/// It may hold one block more than the budget: a picture that is a single block larger than that
/// would otherwise be decoded for each window.
pub(crate) struct BlockCache {
    state: Mutex<State>,
}

impl BlockCache {
    pub fn new(budget_bytes: usize) -> Self {
        Self {
            state: Mutex::new(State {
                budget_bytes,
                ..State::default()
            }),
        }
    }

    /// Raises the budget if it is lower than this.
    pub fn ensure_budget(&self, budget_bytes: usize) {
        let mut state = self.lock();
        state.budget_bytes = state.budget_bytes.max(budget_bytes);
    }

    /// Blocks of columns `[columns.0, columns.1)` of a row, those that are missing decoded in
    /// parallel.
    pub fn row_of_blocks(
        &self,
        source: &dyn BlockSource,
        source_id: usize,
        level: usize,
        columns: (u64, u64),
        row: u64,
    ) -> Result<Vec<Arc<Block>>, GeoError> {
        let keys: Vec<Key> = (columns.0..columns.1)
            .map(|column| Key {
                source: source_id,
                level,
                column,
                row,
            })
            .collect();
        let mut found: Vec<Option<Arc<Block>>> = {
            let mut state = self.lock();
            keys.iter().map(|key| state.get(key)).collect()
        };
        let missing: Vec<usize> = (0..keys.len()).filter(|&i| found[i].is_none()).collect();
        // The lock is not held while decoding: rayon may run other reads of this cache meanwhile.
        let decode = |&i: &usize| {
            let block = source.decode(level, keys[i].column, keys[i].row)?;
            Ok((i, Arc::new(block)))
        };
        let decoded: Vec<(usize, Arc<Block>)> = if missing.len() == 1 {
            missing
                .iter()
                .map(decode)
                .collect::<Result<_, GeoError>>()?
        } else {
            missing
                .par_iter()
                .map(decode)
                .collect::<Result<_, GeoError>>()?
        };
        if !decoded.is_empty() {
            let mut state = self.lock();
            for (i, block) in decoded {
                state.insert(keys[i], Arc::clone(&block));
                found[i] = Some(block);
            }
        }
        Ok(found.into_iter().flatten().collect())
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic elsewhere leaves at worst a block that is not counted.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    #[cfg(test)]
    fn held(&self) -> (usize, usize) {
        let state = self.lock();
        (state.blocks.len(), state.bytes)
    }
}

impl State {
    fn get(&mut self, key: &Key) -> Option<Arc<Block>> {
        self.clock += 1;
        let clock = self.clock;
        let (block, used) = self.blocks.get_mut(key)?;
        self.by_use.remove(used);
        *used = clock;
        let block = Arc::clone(block);
        self.by_use.insert(clock, *key);
        Some(block)
    }

    fn insert(&mut self, key: Key, block: Arc<Block>) {
        self.clock += 1;
        let bytes = block.bytes();
        if let Some((old, used)) = self.blocks.remove(&key) {
            // Another thread decoded it at the same time.
            self.by_use.remove(&used);
            self.bytes -= old.bytes();
        }
        while self.bytes + bytes > self.budget_bytes {
            let Some((_, oldest)) = self.by_use.pop_first() else {
                break;
            };
            if let Some((block, _)) = self.blocks.remove(&oldest) {
                self.bytes -= block.bytes();
            }
        }
        self.bytes += bytes;
        self.by_use.insert(self.clock, key);
        self.blocks.insert(key, (block, self.clock));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::block::{BlockLayout, Validity};

    struct Counting {
        layout: [BlockLayout; 1],
        decoded: AtomicUsize,
    }

    impl BlockSource for Counting {
        fn levels(&self) -> &[BlockLayout] {
            &self.layout
        }

        fn decode(&self, _level: usize, column: u64, _row: u64) -> Result<Block, GeoError> {
            self.decoded.fetch_add(1, Ordering::Relaxed);
            Ok(Block {
                width: 10,
                rgb: vec![column as u8; 300],
                validity: Validity::All,
            })
        }
    }

    fn counting() -> Counting {
        let layout = BlockLayout {
            width: 1000,
            height: 10,
            block_w: 10,
            block_h: 10,
        };
        Counting {
            layout: [layout],
            decoded: AtomicUsize::new(0),
        }
    }

    #[test]
    fn decodes_each_block_once_within_the_budget() {
        let (cache, source) = (BlockCache::new(100_000), counting());
        for _ in 0..3 {
            let blocks = cache.row_of_blocks(&source, 0, 0, (0, 10), 0).unwrap();
            assert_eq!(blocks.len(), 10);
            assert_eq!(blocks[7].rgb[0], 7);
        }
        assert_eq!(source.decoded.load(Ordering::Relaxed), 10);
    }

    #[test]
    fn forgets_the_least_recently_used_and_keeps_to_the_budget() {
        let (cache, source) = (BlockCache::new(556 * 4), counting());
        cache.row_of_blocks(&source, 0, 0, (0, 4), 0).unwrap();
        cache.row_of_blocks(&source, 0, 0, (0, 1), 0).unwrap();
        cache.row_of_blocks(&source, 0, 0, (4, 6), 0).unwrap();
        assert_eq!(cache.held(), (4, 556 * 4));
        assert_eq!(source.decoded.load(Ordering::Relaxed), 6);
        cache.row_of_blocks(&source, 0, 0, (0, 1), 0).unwrap();
        assert_eq!(
            source.decoded.load(Ordering::Relaxed),
            6,
            "block 0 was used, so it stayed"
        );
        cache.row_of_blocks(&source, 0, 0, (1, 2), 0).unwrap();
        assert_eq!(
            source.decoded.load(Ordering::Relaxed),
            7,
            "block 1 was the oldest"
        );
    }

    #[test]
    fn holds_one_block_larger_than_the_budget() {
        let (cache, source) = (BlockCache::new(10), counting());
        cache.row_of_blocks(&source, 0, 0, (0, 1), 0).unwrap();
        cache.row_of_blocks(&source, 0, 0, (0, 1), 0).unwrap();
        assert_eq!(source.decoded.load(Ordering::Relaxed), 1);
    }
}
