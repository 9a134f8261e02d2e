//! A model prepared for one domain.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use grimnet_kernels::Isa;
use image::{GrayImage, RgbImage};

use crate::byte_network::{ByteNetwork, ByteScratch};
use crate::error::StatisticsError;
use crate::forward::{Network, Output, Scratch};
use crate::layer::{Gathering, LayerSource};
use crate::seen::{Seen, check_mask};
use crate::spec::SIZE_MULTIPLE_PX;
use crate::vlad::{VladLayer, VladScratch};
use crate::{
    Dense, Domain, ExtractOptions, Features, Model, NetError, Precision, Purpose, Statistics,
    VladInput,
};

/// The network for one domain, with the normalisation folded into the weights, in the model's [`Precision`]. It may be used by several threads at once.
/// Memory is pooled: it does not grow once every thread has processed an image of the largest size.
pub struct Extractor {
    model: Model,
    domain: Domain,
    statistics: Statistics,
    /// In single precision, with these statistics.
    floats: OnceLock<Network>,
    /// In bytes, with these statistics.
    bytes: OnceLock<ByteNetwork>,
    /// In single precision, normalised with the image's own statistics.
    instance: OnceLock<Network>,
    shared: Arc<Shared>,
}

/// A network with stored or adapted statistics.
enum Folded<'a> {
    Floats(&'a Network),
    Bytes(&'a ByteNetwork),
}

/// What an extractor shares with its results.
pub(crate) struct Shared {
    pub isa: Isa,
    pub vlad: VladLayer,
    pub vlad_input: VladInput,
    scratches: Pool<Scratch>,
    byte_scratches: Pool<ByteScratch>,
    outputs: Pool<Output>,
    vlad_scratches: Pool<VladScratch>,
}

impl Shared {
    pub(crate) fn give_back(&self, output: Output) {
        self.outputs.put(output);
    }

    pub(crate) fn with_vlad_scratch<R>(&self, f: impl FnOnce(&mut VladScratch) -> R) -> R {
        let mut scratch = self.vlad_scratches.take();
        let result = f(&mut scratch);
        self.vlad_scratches.put(scratch);
        result
    }
}

impl Extractor {
    /// An extractor with the statistics stored in the model.
    ///
    /// # Errors
    /// [`NetError::Kernel`] if the kernels do not support a layer's shape.
    pub fn new(model: &Model, domain: Domain) -> Result<Self, NetError> {
        Self::with_statistics(model, domain, &Statistics::of_model(model, domain)?)
    }

    /// An extractor with adapted statistics: the domain's affine parameters with these means and variances.
    ///
    /// # Errors
    /// [`NetError::Statistics`] if they belong to another model; [`NetError::Kernel`] if the kernels do not support a layer's
    /// shape.
    pub fn with_statistics(
        model: &Model,
        domain: Domain,
        statistics: &Statistics,
    ) -> Result<Self, NetError> {
        Self::with_isa(model, domain, statistics, Isa::detect())
    }

    /// An extractor that uses a given instruction set, for tests and benchmarks.
    ///
    /// # Errors
    /// As [`Extractor::with_statistics`].
    pub fn with_isa(
        model: &Model,
        domain: Domain,
        statistics: &Statistics,
        isa: Isa,
    ) -> Result<Self, NetError> {
        if !statistics.same_layers(&Statistics::of_model(model, domain)?) {
            return Err(NetError::Statistics(StatisticsError::OtherModel));
        }
        let shared = Shared {
            isa,
            vlad: VladLayer::new(model)?,
            vlad_input: model.spec().vlad.input,
            scratches: Pool::default(),
            byte_scratches: Pool::default(),
            outputs: Pool::default(),
            vlad_scratches: Pool::default(),
        };
        let (model, statistics) = (model.clone(), statistics.clone());
        let extractor = Self {
            model,
            domain,
            statistics,
            floats: OnceLock::new(),
            bytes: OnceLock::new(),
            instance: OnceLock::new(),
            shared: Arc::new(shared),
        };
        // Unlike the other networks, this one is sure to be used: if it cannot be built, that is an error here.
        extractor.folded(Purpose::Answer)?;
        Ok(extractor)
    }

    /// The network for passes of this purpose.
    fn folded(&self, purpose: Purpose) -> Result<Folded<'_>, NetError> {
        let source = || self.source(false);
        Ok(match self.model.precision().of(purpose) {
            Precision::Int8 => {
                Folded::Bytes(made_once(&self.bytes, || ByteNetwork::new(&source()))?)
            }
            Precision::F32 | Precision::Mixed => {
                Folded::Floats(made_once(&self.floats, || Network::new(&source()))?)
            }
        })
    }

    fn source(&self, instance: bool) -> LayerSource<'_> {
        LayerSource {
            isa: self.shared.isa,
            model: &self.model,
            domain: self.domain,
            statistics: &self.statistics,
            instance,
        }
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The domain.
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// The statistics that it normalises with.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// [`Extractor::dense_for`] an answer.
    ///
    /// # Errors
    /// As [`Extractor::dense_for`].
    pub fn dense(&self, image: &RgbImage, mask: Option<&GrayImage>) -> Result<Dense, NetError> {
        self.dense_for(Purpose::Answer, image, mask)
    }

    /// Runs the network on an image whose sides are multiples of 32 px. Pixels that are 0 in the mask (of the same size) are
    /// replaced by the mean colour, so their values have no influence.
    ///
    /// # Errors
    /// [`NetError::ImageSize`], [`NetError::MaskSize`].
    pub fn dense_for(
        &self,
        purpose: Purpose,
        image: &RgbImage,
        mask: Option<&GrayImage>,
    ) -> Result<Dense, NetError> {
        check_size(image, mask)?;
        Ok(match self.folded(purpose)? {
            Folded::Floats(network) => self.run(network, image, mask, &mut Gathering::default()),
            Folded::Bytes(network) => self.run_bytes(network, image, mask),
        })
    }

    /// Runs the network normalised with the image's own statistics, over the visible positions, and returns these statistics, always in
    /// [`Precision::F32`]: adaptation to one photo and, with [`Statistics::mean_of`], to a map or a flight. A layer without a visible position
    /// keeps this extractor's statistics.
    ///
    /// # Errors
    /// [`NetError::ImageSize`], [`NetError::MaskSize`].
    pub fn dense_instance(
        &self,
        image: &RgbImage,
        mask: Option<&GrayImage>,
    ) -> Result<(Dense, Statistics), NetError> {
        check_size(image, mask)?;
        let network = made_once(&self.instance, || Network::new(&self.source(true)))?;
        let seen = mask.map(Seen::new);
        let mut gathering = Gathering {
            seen: seen.as_ref(),
            layers: Vec::new(),
        };
        let dense = self.run(network, image, mask, &mut gathering);
        Ok((dense, Statistics::new(self.model.hash(), gathering.layers)))
    }

    /// Keypoints, local descriptors and the global descriptor of an image, with a mask as in [`Extractor::dense`],
    /// [`Dense::keypoints`] and [`Dense::vlad`].
    ///
    /// # Errors
    /// [`NetError::ImageSize`], [`NetError::MaskSize`].
    pub fn extract(
        &self,
        image: &RgbImage,
        mask: Option<&GrayImage>,
        options: &ExtractOptions,
    ) -> Result<Features, NetError> {
        Ok(self.features_of(&self.dense(image, mask)?, mask, options))
    }

    /// The features of an image from the network's output for it, with the mask of that run.
    pub fn features_of(
        &self,
        dense: &Dense,
        mask: Option<&GrayImage>,
        options: &ExtractOptions,
    ) -> Features {
        let keypoints = dense.keypoints(dense.whole(), options, mask);
        Features {
            descriptors: dense.describe(&keypoints),
            keypoints,
            descriptor_dim: self.model.spec().descriptor_dim,
            global: self
                .model
                .global_descriptor(&dense.vlad(dense.whole(), mask)),
        }
    }

    fn run(
        &self,
        network: &Network,
        image: &RgbImage,
        mask: Option<&GrayImage>,
        gathering: &mut Gathering,
    ) -> Dense {
        let shared = &self.shared;
        let (mut scratch, mut output) = (shared.scratches.take(), shared.outputs.take());
        network.run(
            image,
            mask,
            &shared.vlad,
            &mut scratch,
            &mut output,
            gathering,
        );
        shared.scratches.put(scratch);
        Dense::new(output, Arc::clone(shared))
    }

    fn run_bytes(
        &self,
        network: &ByteNetwork,
        image: &RgbImage,
        mask: Option<&GrayImage>,
    ) -> Dense {
        let shared = &self.shared;
        let (mut scratch, mut output) = (shared.byte_scratches.take(), shared.outputs.take());
        network.run(image, mask, &shared.vlad, &mut scratch, &mut output);
        shared.byte_scratches.put(scratch);
        Dense::new(output, Arc::clone(shared))
    }
}

impl std::fmt::Debug for Extractor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Extractor")
            .field("model", &self.model)
            .field("domain", &self.domain)
            .finish_non_exhaustive()
    }
}

/// What the cell holds, made first if it is empty.
fn made_once<T>(
    cell: &OnceLock<T>,
    make: impl FnOnce() -> Result<T, NetError>,
) -> Result<&T, NetError> {
    if let Some(made) = cell.get() {
        return Ok(made);
    }
    let made = make()?;
    Ok(cell.get_or_init(|| made))
}

fn check_size(image: &RgbImage, mask: Option<&GrayImage>) -> Result<(), NetError> {
    let (width_px, height_px) = image.dimensions();
    let fits = |side: u32| side > 0 && side.is_multiple_of(SIZE_MULTIPLE_PX);
    if !fits(width_px) || !fits(height_px) {
        return Err(NetError::ImageSize {
            width_px,
            height_px,
        });
    }
    check_mask(mask, width_px, height_px)
}

/// Memory for reuse: what was put back last is taken first.
struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<T: Default> Pool<T> {
    fn take(&self) -> T {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop()
            .unwrap_or_default()
    }

    fn put(&self, value: T) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(value);
    }
}
