//! Batches of pairs, made ahead of the training loop. The batch of a step depends on seed and step only, not on the number of
//! threads.

use super::layout::{Serves, Task};
use super::pair::{Pair, PairOptions, Source};
use crate::error::TrainError;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// The pairs of one step.
pub type Batch = Vec<Pair>;

/// A source of pairs with its weight in the random choice.
#[derive(Clone)]
pub struct WeightedSource {
    /// Weight relative to the other sources.
    pub share: f64,
    /// The tasks that its pairs train.
    pub serves: Serves,
    /// The source.
    pub source: Arc<dyn Source>,
}

impl WeightedSource {
    /// A source whose pairs train both tasks.
    pub fn new(share: f64, source: Arc<dyn Source>) -> Self {
        Self {
            share,
            serves: Serves::Both,
            source,
        }
    }
}

/// Groups without a pair after which a batch stays as it is.
const MOST_WITHOUT_PAIRS: usize = 100;

/// The sources of a run.
pub type Sources = Vec<WeightedSource>;

/// How batches are drawn.
#[derive(Clone, Debug)]
pub struct BatchOptions {
    /// How pairs are made.
    pub pair: PairOptions,
    /// Pairs in a batch.
    pub pairs: usize,
    /// Seed of all batches.
    pub seed: u64,
    /// Whether the steps train the two tasks in turns, each on the sources that serve it.
    pub alternate: bool,
}

/// The batch of a step from the sources that serve `task` (`None`: from all): groups of `options.group` pairs, each group from
/// one source. It has fewer than `pairs` pairs if the sources give no more.
pub fn batch_of(
    sources: &Sources,
    task: Option<Task>,
    options: &PairOptions,
    pairs: usize,
    seed: u64,
    step: u64,
) -> Batch {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(step);
    let serving: Vec<&WeightedSource> = sources
        .iter()
        .filter(|source| source.serves.includes(task))
        .collect();
    let total: f64 = serving.iter().map(|source| source.share).sum();
    let mut out = Batch::new();
    let mut without_pairs = 0;
    while out.len() < pairs && without_pairs < MOST_WITHOUT_PAIRS {
        let mut at = random.random_range(0.0..total.max(f64::MIN_POSITIVE));
        let chosen = serving.iter().find(|source| {
            at -= source.share;
            at < 0.0
        });
        let Some(chosen) = chosen.or(serving.last()) else {
            break;
        };
        let count = options.group.min(pairs - out.len());
        let group = chosen.source.group(count, options, &mut random);
        without_pairs += usize::from(group.is_empty());
        out.extend(group);
    }
    out
}

/// The batch, if a step can use it.
///
/// # Errors
/// [`TrainError::NoPairs`] if there are fewer than two pairs.
pub(crate) fn usable(batch: Batch, step: u64) -> Result<Batch, TrainError> {
    if batch.len() < 2 {
        return Err(TrainError::NoPairs { step });
    }
    Ok(batch)
}

/// Batches in the order of the steps.
pub struct Stream {
    receiver: Receiver<(u64, Batch)>,
    waiting: BTreeMap<u64, Batch>,
    next: u64,
    stop: Arc<AtomicBool>,
}

impl Stream {
    /// Starts `threads` threads that make the batches from step `first` on, a bounded number of them ahead.
    pub fn start(sources: Sources, options: BatchOptions, first: u64, threads: usize) -> Self {
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
            std::thread::spawn(move || produce(&sender, &sources, &options, &stop, &counter));
        }
        Self {
            receiver,
            waiting: BTreeMap::new(),
            next: first,
            stop,
        }
    }

    /// The next step's batch; `None` if the threads have ended.
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

/// Ends the other threads when one panics: the batch that it was making never comes, and theirs would be kept in vain.
struct StopOnPanic<'a>(&'a AtomicBool);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

fn produce(
    sender: &SyncSender<(u64, Batch)>,
    sources: &Sources,
    options: &BatchOptions,
    stop: &AtomicBool,
    counter: &AtomicU64,
) {
    let _guard = StopOnPanic(stop);
    while !stop.load(Ordering::Relaxed) {
        let step = counter.fetch_add(1, Ordering::Relaxed);
        let task = options.alternate.then(|| Task::of_step(step));
        let batch = batch_of(
            sources,
            task,
            &options.pair,
            options.pairs,
            options.seed,
            step,
        );
        if sender.send((step, batch)).is_err() {
            return;
        }
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::super::mapping::Mapping;
    use super::super::pair::Place;
    use super::*;
    use image::RgbImage;
    use nalgebra::Matrix3;

    /// Gives empty pairs whose place is the number of the source.
    struct Numbered(usize);

    impl Source for Numbered {
        fn group(&self, count: usize, _: &PairOptions, _: &mut ChaCha8Rng) -> Vec<Pair> {
            let pair = Pair {
                sat: RgbImage::new(8, 8),
                uav: RgbImage::new(8, 8),
                uav_seen: vec![true],
                sat_labels: vec![0],
                uav_labels: vec![0],
                sat_points: Vec::new(),
                uav_points: Vec::new(),
                uav_from_sat_px: Matrix3::identity(),
                mapping: Mapping::Unknown,
                place: Place {
                    picture: self.0,
                    window: [0.0, 0.0, 1.0, 1.0],
                },
                scene: None,
            };
            vec![pair; count]
        }
    }

    fn sources() -> Sources {
        let source = |number, share, serves| WeightedSource {
            share,
            serves,
            source: Arc::new(Numbered(number)),
        };
        vec![
            source(0, 0.5, Serves::Retrieval),
            source(1, 0.3, Serves::Matching),
            source(2, 0.2, Serves::Both),
        ]
    }

    /// Panics in the first call of all and gives numbered pairs in the others.
    struct Breaks(AtomicBool);

    impl Source for Breaks {
        fn group(&self, count: usize, options: &PairOptions, random: &mut ChaCha8Rng) -> Vec<Pair> {
            assert!(self.0.swap(true, Ordering::Relaxed), "the first call");
            Numbered(0).group(count, options, random)
        }
    }

    #[test]
    fn a_batch_of_many_small_groups_is_complete() {
        let one = PairOptions {
            group: 1,
            ..PairOptions::default()
        };
        assert_eq!(batch_of(&sources(), None, &one, 250, 1, 0).len(), 250);
    }

    #[test]
    fn a_thread_that_panics_ends_the_stream() {
        let sources = vec![WeightedSource::new(
            1.0,
            Arc::new(Breaks(AtomicBool::new(false))),
        )];
        let options = BatchOptions {
            pair: PairOptions::default(),
            pairs: 2,
            seed: 1,
            alternate: false,
        };
        let mut stream = Stream::start(sources, options, 0, 3);
        let batches = std::iter::from_fn(|| stream.next_batch()).count();
        assert!(batches < 3, "those before the one that is missing");
    }

    /// In turns, even steps train matching and odd steps retrieval, each on the sources that serve it; by the weights otherwise.
    #[test]
    fn each_task_draws_from_the_sources_that_serve_it() {
        let options = BatchOptions {
            pair: PairOptions {
                group: 1,
                ..PairOptions::default()
            },
            pairs: 10,
            seed: 4,
            alternate: true,
        };
        let mut stream = Stream::start(sources(), options.clone(), 0, 2);
        let mut counts = [[0usize; 3]; 2];
        for step in 0..200 {
            for pair in stream.next_batch().unwrap() {
                counts[step % 2][pair.place.picture] += 1;
            }
        }
        let [matching, retrieval] = counts;
        assert_eq!((matching[0], retrieval[1]), (0, 0));
        // Shares of 0.3 and 0.2, and of 0.5 and 0.2, among 1,000 pairs.
        assert!((550..650).contains(&matching[1]), "{matching:?}");
        assert!((660..770).contains(&retrieval[0]), "{retrieval:?}");

        let mut all = [0usize; 3];
        for step in 0..100 {
            for pair in batch_of(&sources(), None, &options.pair, 10, 4, step) {
                all[pair.place.picture] += 1;
            }
        }
        assert!((450..550).contains(&all[0]) && all[1] > all[2], "{all:?}");
    }
}
