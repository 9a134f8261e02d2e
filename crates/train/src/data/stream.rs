//! Batches made ahead of the training loop, the same for the same seed and step however many threads make them.

use super::pair::{Pair, PairOptions, Source};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// The pairs of one step.
pub type Batch = Vec<Pair>;

/// Sources, each with its share of the groups.
pub type Sources = Vec<(f64, Arc<dyn Source>)>;

/// Batches in the order of the steps.
pub struct Stream {
    receiver: Receiver<(u64, Batch)>,
    waiting: BTreeMap<u64, Batch>,
    next: u64,
    stop: Arc<AtomicBool>,
}

/// The batch of a step: `pairs` pairs in groups of `options.group`, each group from a source drawn by its share.
pub fn batch_of(
    sources: &Sources,
    options: &PairOptions,
    pairs: usize,
    seed: u64,
    step: u64,
) -> Batch {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(step);
    let total: f64 = sources.iter().map(|(share, _)| share).sum();
    let mut out = Batch::new();
    let mut tries = 0;
    while out.len() < pairs && tries < 100 {
        tries += 1;
        let mut at = random.random_range(0.0..total.max(f64::MIN_POSITIVE));
        let chosen = sources.iter().find(|(share, _)| {
            at -= share;
            at < 0.0
        });
        let Some((_, source)) = chosen.or(sources.last()) else {
            break;
        };
        out.extend(source.group(options.group.min(pairs - out.len()), options, &mut random));
    }
    out
}

impl Stream {
    /// Starts `threads` threads that make the batches from step `first` on, at most some ahead.
    pub fn start(
        sources: Sources,
        options: PairOptions,
        pairs: usize,
        seed: u64,
        first: u64,
        threads: usize,
    ) -> Self {
        let threads = threads.max(1);
        let (sender, receiver) = sync_channel(2 * threads + 2);
        let (stop, counter) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicU64::new(first)),
        );
        let sources = Arc::new(sources);
        for _ in 0..threads {
            let (sender, sources, options) = (sender.clone(), sources.clone(), options.clone());
            let (stop, counter) = (stop.clone(), counter.clone());
            std::thread::spawn(move || {
                produce(&sender, &sources, &options, pairs, seed, &stop, &counter)
            });
        }
        Self {
            receiver,
            waiting: BTreeMap::new(),
            next: first,
            stop,
        }
    }

    /// The next step's batch; `None` where the threads died.
    pub fn next_batch(&mut self) -> Option<Batch> {
        while !self.waiting.contains_key(&self.next) {
            let (step, batch) = self.receiver.recv().ok()?;
            self.waiting.insert(step, batch);
        }
        let batch = self.waiting.remove(&self.next);
        self.next += 1;
        batch
    }
}

fn produce(
    sender: &SyncSender<(u64, Batch)>,
    sources: &Sources,
    options: &PairOptions,
    pairs: usize,
    seed: u64,
    stop: &AtomicBool,
    counter: &AtomicU64,
) {
    while !stop.load(Ordering::Relaxed) {
        let step = counter.fetch_add(1, Ordering::Relaxed);
        if sender
            .send((step, batch_of(sources, options, pairs, seed, step)))
            .is_err()
        {
            return;
        }
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}
