//! What an extractor promises about sizes, masks, windows, threads and memory.

#![allow(clippy::unwrap_used)]

use grimnet_net::{
    Decoder, Domain, ExtractOptions, Extractor, KeypointHead, Model, NetError, NetSpec, Statistics,
    Vlad, VladInput, VladSum,
};
use image::{GrayImage, Luma, Rgb, RgbImage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn tiny_compact() -> NetSpec {
    let mut spec = NetSpec::compact();
    for (stage, width) in spec.stages.iter_mut().zip([4, 8, 16, 16, 24]) {
        stage.widths = vec![width, width];
    }
    NetSpec {
        decoder: Decoder::Lateral { width: 16 },
        descriptor_dim: 24,
        keypoints: KeypointHead::FromGrey {
            width: 16,
            layers: 2,
        },
        vlad: Vlad {
            input: VladInput::Descriptors,
            clusters: 6,
        },
        global_dim: 32,
        ..spec
    }
}

fn tiny_vgg16() -> NetSpec {
    let mut spec = NetSpec::vgg16();
    for (stage, width) in spec.stages.iter_mut().zip([4, 8, 8, 16, 24]) {
        stage.widths.fill(width);
    }
    NetSpec {
        decoder: Decoder::Transposed { width: 16 },
        descriptor_dim: 24,
        global_dim: 0,
        ..spec
    }
}

fn picture(width: u32, height: u32, seed: u64) -> RgbImage {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    RgbImage::from_fn(width, height, |x, y| {
        let wave = ((x as f32 / 9.0).sin() * (y as f32 / 7.0).cos() * 90.0 + 128.0) as u8;
        Rgb([
            wave,
            random.random(),
            wave / 2 + random.random_range(0..100),
        ])
    })
}

fn extractor(spec: &NetSpec) -> Extractor {
    Extractor::new(&Model::random(spec, 11).unwrap(), Domain::Uav).unwrap()
}

fn options() -> ExtractOptions {
    ExtractOptions {
        threshold: 0.001,
        max_keypoints: 10_000,
        nms_radius_px: 2,
    }
}

fn assert_close(a: &[f32], b: &[f32]) {
    let largest = b.iter().fold(0.0, |m: f32, v| m.max(v.abs()));
    assert_eq!(a.len(), b.len());
    assert!(
        a.iter()
            .zip(b)
            .all(|(a, b)| (a - b).abs() <= 1e-4 * largest),
        "{a:?} and {b:?}"
    );
}

#[test]
fn sizes_that_do_not_fit_are_refused() {
    let extractor = extractor(&tiny_compact());
    for (width, height) in [(0, 0), (0, 32), (33, 32), (32, 48), (31, 31)] {
        let error = extractor
            .dense(&RgbImage::new(width, height), None)
            .unwrap_err();
        assert!(matches!(error, NetError::ImageSize { .. }), "{error}");
        assert!(error.to_string().contains("multiples of 32"));
    }
    let mask = GrayImage::new(32, 64);
    for error in [
        extractor
            .dense(&RgbImage::new(64, 32), Some(&mask))
            .unwrap_err(),
        extractor
            .dense_instance(&RgbImage::new(64, 32), Some(&mask))
            .unwrap_err(),
        extractor
            .extract(&RgbImage::new(64, 32), Some(&mask), &options())
            .unwrap_err(),
    ] {
        assert!(matches!(error, NetError::MaskSize { .. }), "{error}");
    }
}

#[test]
fn the_smallest_picture_works_in_every_way() {
    for spec in [tiny_compact(), tiny_vgg16()] {
        let extractor = extractor(&spec);
        let image = picture(32, 32, 1);
        let nothing = GrayImage::new(32, 32);
        for mask in [None, Some(&nothing)] {
            let (of_instance, _) = extractor.dense_instance(&image, mask).unwrap();
            for features in [
                extractor.extract(&image, mask, &options()).unwrap(),
                extractor.features_of(&of_instance, mask, &options()),
            ] {
                let all = features.global.iter().chain(&features.descriptors);
                assert!(all.into_iter().all(|v| v.is_finite()));
                assert_eq!(features.global.len(), spec.global_len());
                assert_eq!(features.keypoints.is_empty(), mask.is_some());
                let length: f32 = features.global.iter().map(|v| v * v).sum();
                assert!((length - if mask.is_some() { 0.0 } else { 1.0 }).abs() < 1e-4);
            }
        }
    }
}

#[test]
fn windows_side_by_side_make_up_the_whole() {
    for (spec, cut) in [(tiny_compact(), [40, 21]), (tiny_vgg16(), [64, 33])] {
        let extractor = extractor(&spec);
        let dense = extractor.dense(&picture(128, 96, 2), None).unwrap();
        let [x, y] = cut;
        let windows = [
            [0, 0, x, y],
            [x, 0, 128 - x, y],
            [0, y, x, u32::MAX],
            [x, y, u32::MAX, u32::MAX],
        ];
        let whole = [0, 0, 128, 96];
        let mut sum = VladSum::default();
        windows.iter().for_each(|w| sum += dense.vlad(*w, None));
        assert_close(sum.as_slice(), dense.vlad(whole, None).as_slice());

        let place = |k: &grimnet_net::Keypoint| (k.y_px as u32, k.x_px as u32);
        let mut parts: Vec<_> = windows
            .iter()
            .flat_map(|w| dense.keypoints(*w, &options(), None))
            .map(|k| place(&k))
            .collect();
        let mut all: Vec<_> = dense
            .keypoints(whole, &options(), None)
            .iter()
            .map(place)
            .collect();
        parts.sort_unstable();
        all.sort_unstable();
        assert!(all.len() > 20);
        assert_eq!(parts, all);
        assert!(
            dense
                .keypoints([500, 500, 9, 9], &options(), None)
                .is_empty()
        );
        assert!(
            dense
                .vlad([500, 500, 9, 9], None)
                .as_slice()
                .iter()
                .all(|&v| v == 0.0)
        );
    }
}

#[test]
fn what_lies_behind_the_mask_does_not_matter() {
    let mask = GrayImage::from_fn(96, 96, |x, y| Luma([if x + y / 2 < 80 { 255 } else { 0 }]));
    let shown = picture(96, 96, 3);
    let mut other = shown.clone();
    for (x, y, pixel) in other.enumerate_pixels_mut() {
        if mask.get_pixel(x, y).0[0] == 0 {
            *pixel = Rgb([255, (x * 2) as u8, 0]);
        }
    }
    for spec in [tiny_compact(), tiny_vgg16()] {
        let extractor = extractor(&spec);
        let mask = Some(&mask);
        let features = extractor.extract(&shown, mask, &options()).unwrap();
        assert_eq!(
            features,
            extractor.extract(&other, mask, &options()).unwrap()
        );
        assert_ne!(
            features,
            extractor.extract(&other, None, &options()).unwrap()
        );
        assert!(!features.keypoints.is_empty());
        assert!(
            features
                .keypoints
                .iter()
                .all(|k| k.x_px + k.y_px / 2.0 < 76.0)
        );
        let (_, statistics) = extractor.dense_instance(&shown, mask).unwrap();
        assert_eq!(
            statistics,
            extractor.dense_instance(&other, mask).unwrap().1
        );
    }
}

#[test]
fn threads_and_repetition_change_nothing() {
    for spec in [tiny_compact(), tiny_vgg16()] {
        let extractor = extractor(&spec);
        let (small, large) = (picture(64, 96, 4), picture(160, 128, 5));
        let first = extractor.extract(&large, None, &options()).unwrap();
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let other = pool.install(|| extractor.extract(&small, None, &options()).unwrap());
            assert!(!other.keypoints.is_empty());
            assert_eq!(
                pool.install(|| extractor.extract(&large, None, &options()).unwrap()),
                first,
                "{threads} threads"
            );
        }
        let (extractor, large) = (&extractor, &large);
        std::thread::scope(|scope| {
            let runs: Vec<_> = (0..4)
                .map(|_| scope.spawn(move || extractor.extract(large, None, &options()).unwrap()))
                .collect();
            runs.into_iter()
                .for_each(|run| assert_eq!(run.join().unwrap(), first));
        });
    }
}

#[test]
fn memory_is_used_again() {
    let extractor = extractor(&tiny_compact());
    let (small, large) = (picture(64, 64, 6), picture(128, 128, 7));
    let address = extractor.dense(&large, None).unwrap().heatmap().as_ptr();
    assert_eq!(
        extractor.dense(&small, None).unwrap().heatmap().as_ptr(),
        address
    );
    assert_eq!(
        extractor.dense(&large, None).unwrap().heatmap().as_ptr(),
        address
    );
}

#[test]
fn statistics_of_another_model_are_refused() {
    let spec = tiny_compact();
    let (a, b) = (
        Model::random(&spec, 1).unwrap(),
        Model::random(&spec, 2).unwrap(),
    );
    let statistics = Statistics::of_model(&a, Domain::Sat).unwrap();
    Extractor::with_statistics(&a, Domain::Sat, &statistics).unwrap();
    let error = Extractor::with_statistics(&b, Domain::Sat, &statistics).unwrap_err();
    assert!(matches!(error, NetError::Statistics { .. }), "{error}");
}

#[test]
fn global_descriptors_of_many_equal_those_of_one() {
    for spec in [tiny_compact(), tiny_vgg16()] {
        let extractor = extractor(&spec);
        let sums: Vec<_> = (0..3)
            .map(|seed| {
                extractor
                    .dense(&picture(64, 64, seed), None)
                    .unwrap()
                    .vlad([0, 0, 64, 64], None)
            })
            .collect();
        let together = extractor.model().global_descriptors(&sums);
        let apart: Vec<f32> = sums
            .iter()
            .flat_map(|sum| extractor.model().global_descriptor(sum))
            .collect();
        assert_eq!(together, apart);
        assert!(extractor.model().global_descriptors(&[]).is_empty());
    }
}
