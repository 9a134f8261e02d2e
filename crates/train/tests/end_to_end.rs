//! A small training from pictures to a model that localises.

#![allow(clippy::unwrap_used)]

use burn::tensor::Device;
use grimnet_geo::{LonLat, MapOptions, MapPx, distance_m, open_map};
use grimnet_locate::{Localizer, Outcome, Prior};
use grimnet_net::{Card, Model};
use grimnet_pack::{BuildOptions, Levels, Pack, build};
use grimnet_photo::{Metadata, Photo};
use grimnet_train::data::{
    Folder, Layout, Pair, PairOptions, Serves, Source, Sources, WeightedSource,
};
use grimnet_train::{
    Data, GlobalLoss, Losses, TeacherOptions, TrainConfig, Trainer, Weights, with_export_statistics,
};
use image::{Rgb, RgbImage, imageops};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rstest::rstest;
use std::path::Path;
use std::sync::Arc;

const GSD_M: f64 = 0.3;
const MAP_PX: u32 = 640;
const PICTURES: u64 = 24;
const REPORT_STEPS: u64 = 8;
const PAIRS: usize = 4;

/// Roofs and fields without order: every place looks different.
fn town(side_px: u32, seed: u64) -> RgbImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut map = RgbImage::from_pixel(side_px, side_px, Rgb([96, 110, 84]));
    for _ in 0..side_px * side_px / 700 {
        let (x, y) = (rng.random_range(0..side_px), rng.random_range(0..side_px));
        let (w, h) = (rng.random_range(5..40u32), rng.random_range(5..40u32));
        let colour = Rgb(std::array::from_fn(|_| rng.random_range(40..230u8)));
        for v in y..(y + h).min(side_px) {
            for u in x..(x + w).min(side_px) {
                map.put_pixel(u, v, colour);
            }
        }
    }
    map
}

fn config(folder: &Path) -> TrainConfig {
    TrainConfig {
        out: folder.join("run"),
        data: vec![Folder {
            path: folder.join("pictures"),
            layout: Layout::default(),
            serves: Serves::default(),
            repeat: 1,
        }],
        minutes: 60.0,
        pairs_per_step: PAIRS,
        warmup_steps: 4,
        learning_rate: 2e-3,
        global_from: 0.0,
        memory_batches: 2,
        average_decay: 0.5,
        validate_minutes: 0.0,
        report_steps: REPORT_STEPS,
        pairs: PairOptions {
            side_px: 96,
            points: 40,
            group: 2,
            ..PairOptions::default()
        },
        ..TrainConfig::default()
    }
}

/// The same pairs at every step.
struct Same(Arc<dyn Source>);

impl Source for Same {
    fn group(&self, count: usize, options: &PairOptions, _: &mut ChaCha8Rng) -> Vec<Pair> {
        let pair = |i| self.0.group(1, options, &mut ChaCha8Rng::seed_from_u64(i));
        (0..count as u64).flat_map(pair).collect()
    }
}

/// Trains for `reports` reports and gives the trainer with the losses of the first and of the last.
fn train(config: &TrainConfig, sources: Sources, reports: usize) -> (Trainer, Losses, Losses) {
    let mut trainer = Trainer::new(config.clone(), sources, &Device::flex(), false).unwrap();
    let mut losses = Vec::new();
    trainer
        .run(&mut |progress, _| {
            losses.push(progress.losses);
            losses.len() < reports
        })
        .unwrap();
    (trainer, losses[0], losses[reports - 1])
}

fn pictures_in(folder: &Path) {
    std::fs::create_dir(folder.join("pictures")).unwrap();
    for i in 0..PICTURES {
        town(200, i)
            .save(folder.join("pictures").join(format!("{i}.png")))
            .unwrap();
    }
}

/// Every loss that is trained is lower at the end.
fn assert_lower(first: &Losses, last: &Losses, expected: usize) {
    let trained: Vec<_> = first
        .terms()
        .into_iter()
        .zip(last.terms())
        .filter(|((_, value), _)| value.is_some())
        .collect();
    assert_eq!(trained.len(), expected, "{first:?}");
    for ((name, before), (_, after)) in trained {
        let (before, after) = (before.unwrap(), after.unwrap());
        assert!(after < before, "{name}: {before}, then {after}");
    }
}

#[rstest]
#[case::papers_by_turns(TrainConfig::paper(), 4)]
#[case::multi_similarity_and_homography(
    TrainConfig {
        global_loss: GlobalLoss::MultiSimilarity,
        weights: Weights { homography: 0.01, ..Weights::default() },
        ..TrainConfig::default()
    },
    4
)]
#[case::with_a_teacher(TrainConfig { teacher: Some(TeacherOptions::default()), ..TrainConfig::default() }, 6)]
fn every_loss_falls(#[case] recipe: TrainConfig, #[case] losses: usize) {
    let folder = tempfile::tempdir().unwrap();
    pictures_in(folder.path());
    // The small network in place of the paper's: the losses are what is tested.
    let config = TrainConfig {
        weights: recipe.weights,
        descriptor_loss: recipe.descriptor_loss,
        global_loss: recipe.global_loss,
        alternate: recipe.alternate,
        teacher: recipe.teacher,
        ..config(folder.path())
    };
    let config = TrainConfig {
        pairs: PairOptions {
            group: PAIRS,
            ..config.pairs
        },
        ..config
    };
    let all = Data::open(&config).unwrap().training;
    let same: Sources = all
        .into_iter()
        .map(|one| WeightedSource {
            source: Arc::new(Same(one.source)),
            ..one
        })
        .collect();
    let (_, first, last) = train(&config, same, 4);
    assert_lower(&first, &last, losses);
}

#[test]
fn a_trained_model_localises() {
    let folder = tempfile::tempdir().unwrap();
    pictures_in(folder.path());
    let config = config(folder.path());
    let sources = Data::open(&config).unwrap().training;
    let (trainer, ..) = train(&config, sources.clone(), 12);
    let average = &trainer.state().average;
    let parameters = with_export_statistics(average, &sources, &config, &Device::flex()).unwrap();
    let model = parameters.to_model(Card::default()).unwrap();
    let path = folder.path().join("model.safetensors");
    model.save(&path).unwrap();
    let model = Model::open(&path).unwrap();

    let picture = town(MAP_PX, 1000);
    picture.save(folder.path().join("town.png")).unwrap();
    let corner = [500_000.0 + GSD_M / 2.0, 5_400_000.0 - GSD_M / 2.0];
    let world = format!("{GSD_M}\n0\n0\n-{GSD_M}\n{}\n{}\n", corner[0], corner[1]);
    std::fs::write(folder.path().join("town.pgw"), world).unwrap();
    let options = MapOptions {
        crs: Some("EPSG:32633".into()),
        ..MapOptions::default()
    };
    let map = open_map(&folder.path().join("town.png"), &options).unwrap();
    let pack = folder.path().join("town.grim");
    let levels = Levels::Gsd(vec![GSD_M]);
    let options = BuildOptions {
        levels,
        ..BuildOptions::standard()
    };
    build(map.as_ref(), &model, &options, &pack, &mut |_| ()).unwrap();

    let localizer = Localizer::new(model, Pack::open(&pack).unwrap()).unwrap();
    let place = MapPx::new(350.0, 290.0);
    let cut = imageops::crop_imm(&picture, 350 - 160, 290 - 120, 320, 240).to_image();
    let photo = Photo::from_image(cut, Metadata::default());
    let north_deg = map.georeference().up_bearing_deg(place).unwrap();
    let prior = Prior::none().with_gsd_m(GSD_M).with_heading(north_deg, 2.0);
    let outcome = localizer.locate(&photo, &prior).unwrap();
    let Outcome::Fix(fix) = outcome else {
        panic!("no fix: {outcome:?}")
    };
    let truth = map.georeference().lonlat_from_map_px(place).unwrap();
    let error_m = distance_m(LonLat::new(fix.lon_deg, fix.lat_deg), truth);
    assert!(error_m < 5.0, "{error_m} m");
}
