//! What a step lowers: the weighted sum of the losses (paper, section 3.6).

use crate::TrainError;
use crate::config::{DescriptorLoss, GlobalLoss, Stage, TrainConfig};
use crate::data::{Batch, LABEL_NONE, Pair, Scene};
use crate::loss::{
    Correspondences, constant, descriptor_contrast, descriptor_distillation, descriptor_hinge,
    global_contrast, homography_reprojection, keypoint_cross_entropy, keypoint_distillation,
    multi_similarity, sample_descriptors, scene_cross_entropy, similarity_distillation, triplet,
};
use crate::memory::{Memory, overlaps_within};
use crate::network::{Input, Network, Output};
use crate::parameters::host;
use crate::teacher::Teacher;
use burn::tensor::{Device, Tensor};
use grimnet_net::NetSpec;

/// The losses of a step, or their mean over some; 0 where one was not asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Keypoint cross-entropy.
    pub keypoint: f32,
    /// Local descriptors.
    pub descriptor: f32,
    /// Global descriptors.
    pub global: f32,
    /// Homography reprojection, pixels over `homography.unit_px`.
    pub homography: f32,
    /// The teacher's keypoint probabilities.
    pub taught_keypoint: f32,
    /// The teacher's local descriptors: 1 - cosine.
    pub taught_descriptor: f32,
    /// The teacher's similarities of global descriptors.
    pub taught_global: f32,
    /// Cross-entropy over scene classes.
    pub scene: f32,
}

impl Losses {
    /// The losses by name.
    pub fn terms(&self) -> [(&'static str, f32); 8] {
        [
            ("keypoint loss", self.keypoint),
            ("descriptor loss", self.descriptor),
            ("global loss", self.global),
            ("homography loss", self.homography),
            ("taught keypoint loss", self.taught_keypoint),
            ("taught descriptor loss", self.taught_descriptor),
            ("taught global loss", self.taught_global),
            ("scene loss", self.scene),
        ]
    }

    fn slots(&mut self) -> [&mut f32; 8] {
        [
            &mut self.keypoint,
            &mut self.descriptor,
            &mut self.global,
            &mut self.homography,
            &mut self.taught_keypoint,
            &mut self.taught_descriptor,
            &mut self.taught_global,
            &mut self.scene,
        ]
    }

    /// Adds another step's losses.
    pub fn add(&mut self, other: &Losses) {
        for (slot, (_, value)) in self.slots().into_iter().zip(other.terms()) {
            *slot += value;
        }
    }

    /// All of them times a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Self {
        self.slots().into_iter().for_each(|slot| *slot *= factor);
        self
    }
}

/// Which of the paper's two tasks a step trains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Turn {
    /// Encoder and NetVLAD.
    pub retrieval: bool,
    /// Encoder and decoders.
    pub matching: bool,
}

impl Turn {
    /// The turn of a step; retrieval waits until NetVLAD has its centres.
    pub fn of(config: &TrainConfig, step: u64, centres_started: bool) -> Self {
        let retrieval = centres_started && config.weights.global > 0.0;
        if config.alternate && retrieval {
            let odd = step % 2 == 1;
            return Self {
                retrieval: odd,
                matching: !odd,
            };
        }
        Self {
            retrieval,
            matching: true,
        }
    }
}

/// The losses of a configuration, with what they remember.
pub(crate) struct Objective {
    config: TrainConfig,
    memory: Memory,
    teacher: Option<Teacher>,
}

/// A sum of weighted losses under way.
#[derive(Default)]
struct Sum {
    total: Option<Tensor<1>>,
}

impl Sum {
    /// Adds a loss and tells its value.
    fn add(&mut self, loss: Tensor<1>, weight: f32) -> Result<f32, TrainError> {
        let value = host(loss.clone().without_autodiff())?;
        let weighted = loss.mul_scalar(weight);
        self.total = Some(match self.total.take() {
            Some(total) => total + weighted,
            None => weighted,
        });
        Ok(value.first().copied().unwrap_or(0.0))
    }
}

impl Objective {
    /// For a network.
    ///
    /// # Errors
    /// Where the teacher cannot be opened, or cannot teach this network.
    pub fn new(
        config: &TrainConfig,
        student: &NetSpec,
        device: &Device,
    ) -> Result<Self, TrainError> {
        let teacher = match &config.teacher {
            Some(options) => Some(Teacher::open(options, student, device)?),
            None => None,
        };
        Ok(Self {
            config: config.clone(),
            memory: Memory::new(config.memory_batches),
            teacher,
        })
    }

    /// Runs what the stage trains of the network, and gives the sum to be descended with the values of its terms.
    ///
    /// # Errors
    /// Where the device does not give values back, or nothing is weighted.
    pub fn of(
        &mut self,
        network: &mut Network<'_>,
        input: &Input,
        batch: &Batch,
        turn: Turn,
    ) -> Result<(Tensor<1>, Losses), TrainError> {
        let (mut sum, mut losses) = (Sum::default(), Losses::default());
        match self.config.stage {
            Stage::Shapes => {
                let logits = network.keypoints(input)?;
                self.add_keypoints(logits, batch, &mut sum, &mut losses)?;
            }
            Stage::Scenes => {
                let loss = scene_cross_entropy(network.scenes(input)?, &scenes_of(batch));
                losses.scene = sum.add(loss, 1.0)?;
            }
            Stage::Joint => {
                let output = network.forward(input, turn.retrieval)?;
                self.add_joint(output, batch, turn, &mut sum, &mut losses)?;
            }
        }
        let total = sum.total.ok_or_else(|| TrainError::Config {
            reason: "all `weights` are 0: there is nothing to train".into(),
        })?;
        Ok((total, losses))
    }

    fn add_joint(
        &mut self,
        output: Output,
        batch: &Batch,
        turn: Turn,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        if turn.matching {
            self.add_matching(&output, batch, sum, losses)?;
        }
        if self.teacher.is_some() {
            self.add_teacher(&output, batch, turn, sum, losses)?;
        }
        if turn.retrieval {
            self.add_retrieval(output, batch, sum, losses)?;
        }
        Ok(())
    }

    fn add_keypoints(
        &self,
        logits: Tensor<2>,
        batch: &Batch,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let weights = &self.config.weights;
        let labels = labels_of(batch);
        let shares = cell_weights(batch, &labels, weights.dustbin);
        let loss = keypoint_cross_entropy(logits, &labels, &shares);
        losses.keypoint = sum.add(loss, weights.keypoint)?;
        Ok(())
    }

    fn add_matching(
        &self,
        output: &Output,
        batch: &Batch,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let weights = &self.config.weights;
        self.add_keypoints(output.keypoints.clone(), batch, sum, losses)?;
        let points = points_of(batch);
        let (n, half) = (batch.len(), points.len() / 2);
        let sampled = sample_descriptors(output.descriptors.clone(), &points);
        let sat = sampled.clone().narrow(0, 0, half);
        let uav = sampled.narrow(0, half, half);
        if weights.homography > 0.0 {
            let places = correspondences_of(batch, &output.descriptors.device());
            let options = &self.config.homography;
            let loss = homography_reprojection(sat.clone(), uav.clone(), &places, options);
            losses.homography = sum.add(loss, weights.homography)?;
        }
        let descriptor = match self.config.descriptor_loss {
            DescriptorLoss::Contrast => {
                descriptor_contrast(sat, uav, n, self.config.descriptor_temperature)
            }
            DescriptorLoss::Hinge => {
                descriptor_hinge(sat, uav, n, &same_places(batch), &self.config.hinge)
            }
        };
        losses.descriptor = sum.add(descriptor, weights.descriptor)?;
        Ok(())
    }

    fn add_retrieval(
        &mut self,
        output: Output,
        batch: &Batch,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let n = batch.len();
        let sat = output.global.clone().narrow(0, 0, n);
        let uav = output.global.narrow(0, n, n);
        let config = &self.config;
        let loss = match config.global_loss {
            GlobalLoss::Contrast => {
                let (past, excluded) = (self.memory.rows(), self.memory.excluded(batch));
                let loss =
                    global_contrast(sat.clone(), uav, past, &excluded, config.global_temperature);
                self.memory.push(sat, batch);
                loss
            }
            GlobalLoss::Triplet => triplet(sat, uav, &overlaps_within(batch), &config.triplet),
            GlobalLoss::MultiSimilarity => {
                let excluded = overlaps_within(batch);
                multi_similarity(sat, uav, &excluded, &config.multi_similarity)
            }
        };
        losses.global = sum.add(loss, config.weights.global)?;
        Ok(())
    }

    fn add_teacher(
        &self,
        output: &Output,
        batch: &Batch,
        turn: Turn,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let (Some(teacher), Some(weights)) = (&self.teacher, &self.config.teacher) else {
            return Ok(());
        };
        let lesson = teacher.lesson(batch)?;
        let seen: Vec<f32> = seen_of(batch)
            .map(|seen| f32::from(u8::from(seen)))
            .collect();
        let keypoint = keypoint_distillation(output.keypoints.clone(), lesson.keypoints, &seen);
        losses.taught_keypoint = sum.add(keypoint, weights.keypoint)?;
        let [n, h, w, d] = output.descriptors.dims();
        let student = output.descriptors.clone().reshape([n * h * w, d]);
        let descriptor = descriptor_distillation(student, lesson.descriptors, &seen);
        losses.taught_descriptor = sum.add(descriptor, weights.descriptor)?;
        if turn.retrieval {
            let global = similarity_distillation(output.global.clone(), lesson.global);
            losses.taught_global = sum.add(global, weights.global)?;
        }
        Ok(())
    }
}

/// Scenes of all views: the map views', then the photos'.
fn scenes_of(batch: &Batch) -> Vec<Option<&Scene>> {
    let once = || batch.iter().map(|pair| pair.scene.as_ref());
    once().chain(once()).collect()
}

/// Keypoint labels of all cells: the map views', then the photos'.
fn labels_of(batch: &Batch) -> Vec<u8> {
    let sat = batch.iter().flat_map(|pair| &pair.sat_labels);
    sat.chain(batch.iter().flat_map(|pair| &pair.uav_labels))
        .copied()
        .collect()
}

/// Which cells were seen: all of the map views, then the photos'.
fn seen_of(batch: &Batch) -> impl Iterator<Item = bool> {
    let sat = batch
        .iter()
        .flat_map(|pair| std::iter::repeat_n(true, pair.sat_labels.len()));
    sat.chain(batch.iter().flat_map(|pair| pair.uav_seen.iter().copied()))
}

fn cell_weights(batch: &Batch, labels: &[u8], dustbin: f32) -> Vec<f32> {
    let weight = |(label, seen): (&u8, bool)| match (seen, *label) {
        (false, _) => 0.0,
        (true, LABEL_NONE) => dustbin,
        (true, _) => 1.0,
    };
    labels.iter().zip(seen_of(batch)).map(weight).collect()
}

/// Corresponding points, (picture, x px, y px): the map views', then the photos' in the same order.
fn points_of(batch: &Batch) -> Vec<(usize, [f32; 2])> {
    let n = batch.len();
    let of = |first: usize, points: fn(&Pair) -> &Vec<[f32; 2]>| {
        batch
            .iter()
            .enumerate()
            .flat_map(move |(i, pair)| points(pair).iter().map(move |at| (first + i, *at)))
    };
    of(0, |pair| &pair.sat_points)
        .chain(of(n, |pair| &pair.uav_points))
        .collect()
}

/// Points of one view that are nearer than this to each other show one place: half a descriptor cell.
const SAME_PLACE_PX: f32 = 4.0;

/// For each pair, each point of the map view and each point of the photo: whether they show one place.
fn same_places(batch: &Batch) -> Vec<bool> {
    let mut out = Vec::new();
    for pair in batch {
        for [x, y] in &pair.uav_points {
            let near = |[u, v]: &[f32; 2]| (u - x).hypot(v - y) < SAME_PLACE_PX;
            out.extend(pair.uav_points.iter().map(near));
        }
    }
    out
}

/// The points of all pairs as tensors.
fn correspondences_of(batch: &Batch, device: &Device) -> Correspondences {
    let count = batch.first().map_or(0, |pair| pair.sat_points.len());
    let places = |points: fn(&Pair) -> &Vec<[f32; 2]>| {
        let values = batch.iter().flat_map(|pair| points(pair).as_flattened());
        constant(values.copied().collect(), [batch.len(), count, 2], device)
    };
    Correspondences {
        from_px: places(|pair| &pair.sat_points),
        to_px: places(|pair| &pair.uav_points),
        side_px: batch.first().map_or(0.0, |pair| pair.sat.width() as f32),
    }
}
