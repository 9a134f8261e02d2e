//! The network in int8 against the same network in single precision, and on all instruction sets.

#![allow(clippy::unwrap_used)]

use grimnet_kernels::Isa;
use grimnet_net::{
    Domain, ExtractOptions, Extractor, Model, NetError, NetSpec, Precision, Purpose, Statistics,
};
use image::{GrayImage, Luma, Rgb, RgbImage};

/// Fields, roads and noise.
fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let noise = (x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b))
            .wrapping_mul(0xc2b2_ae35)
            >> 27;
        let field = 60 + (x / 37 * 53 + y / 29 * 71) % 110;
        let road = if (x + y / 3) % 61 < 6 { 60 } else { 0 };
        let of = |tint: u32| (field + road + noise + tint).min(255) as u8;
        Rgb([of(0), of(20), of(5)])
    })
}

const FLOATS_AND_BYTES: [Precision; 2] = [Precision::F32, Precision::Int8];

fn bundled(precision: Precision) -> Model {
    Model::bundled().unwrap().with_precision(precision).unwrap()
}

fn cosine(a: &[f32], b: &[f32]) -> f32 {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
}

#[test]
fn keypoints_are_the_same_and_descriptors_nearly() {
    let image = picture(256, 192);
    // A corner is not seen, as where a photo was turned.
    let mask = GrayImage::from_fn(256, 192, |x, y| Luma([if x + y < 90 { 0 } else { 255 }]));
    for domain in Domain::ALL {
        let [floats, bytes] = FLOATS_AND_BYTES.map(|precision| {
            let extractor = Extractor::new(&bundled(precision), domain).unwrap();
            extractor
                .extract(&image, Some(&mask), &ExtractOptions::default())
                .unwrap()
        });
        assert!(floats.keypoints.len() > 100);
        assert_eq!(floats.keypoints, bytes.keypoints);
        let dim = floats.descriptor_dim;
        let pairs = floats.descriptors.chunks_exact(dim);
        for (a, b) in pairs.zip(bytes.descriptors.chunks_exact(dim)) {
            let cosine = cosine(a, b);
            assert!(cosine > 0.995, "{domain:?}: {cosine}");
        }
        let cosine = cosine(&floats.global, &bytes.global);
        assert!(cosine > 0.995, "{domain:?}: global {cosine}");
        assert_ne!(floats.global, bytes.global);
    }
}

#[test]
fn mixed_precision_searches_in_bytes_and_answers_in_single_precision() {
    let image = picture(96, 64);
    let field = |precision, purpose| {
        let extractor = Extractor::new(&bundled(precision), Domain::Uav).unwrap();
        let dense = extractor.dense_for(purpose, &image, None).unwrap();
        dense.descriptors().to_hwc()
    };
    let [floats, bytes] = FLOATS_AND_BYTES.map(|pure| field(pure, Purpose::Answer));
    assert_ne!(floats, bytes);
    for (pure, expected) in FLOATS_AND_BYTES.into_iter().zip([&floats, &bytes]) {
        assert_eq!(&field(pure, Purpose::Search), expected);
    }
    assert_eq!(field(Precision::Mixed, Purpose::Answer), floats);
    assert_eq!(field(Precision::Mixed, Purpose::Search), bytes);
    let usual = match Isa::detect().has_byte_products() {
        true => Precision::Mixed,
        false => Precision::F32,
    };
    assert_eq!(Model::bundled().unwrap().precision(), usual);
}

#[test]
fn all_instruction_sets_and_numbers_of_threads_give_the_same_descriptors() {
    let image = picture(160, 96);
    let model = bundled(Precision::Int8);
    let statistics = Statistics::of_model(&model, Domain::Uav).unwrap();
    let mut fields = Vec::new();
    for (isa, threads) in Isa::available()
        .into_iter()
        .flat_map(|isa| [(isa, 1), (isa, 3)])
    {
        let extractor = Extractor::with_isa(&model, Domain::Uav, &statistics, isa).unwrap();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let dense = pool.install(|| extractor.dense(&image, None)).unwrap();
        fields.push((isa, dense.descriptors().to_hwc()));
    }
    let (_, first) = &fields[0];
    for (isa, field) in &fields {
        assert!(first == field, "{isa}");
    }
}

#[test]
fn values_behind_the_mask_have_no_influence() {
    let image = picture(96, 96);
    let hidden = |x: u32, y: u32| x < 40 && y < 32;
    let mask = GrayImage::from_fn(96, 96, |x, y| Luma([if hidden(x, y) { 0 } else { 255 }]));
    let mut painted = image.clone();
    for (x, y, pixel) in painted.enumerate_pixels_mut() {
        if hidden(x, y) {
            *pixel = Rgb([255, 0, 99]);
        }
    }
    let extractor = Extractor::new(&bundled(Precision::Int8), Domain::Sat).unwrap();
    let options = ExtractOptions::default();
    let [a, b] = [&image, &painted].map(|image| {
        extractor
            .extract(image, Some(&mask), &options)
            .unwrap()
            .global
    });
    assert_eq!(a, b);
}

#[test]
fn statistics_are_computed_in_single_precision_and_adapted_ones_are_used() {
    let image = picture(128, 128);
    let [floats, bytes] =
        FLOATS_AND_BYTES.map(|precision| Extractor::new(&bundled(precision), Domain::Uav).unwrap());
    let own = floats.dense_instance(&image, None).unwrap().1;
    assert_eq!(own, bytes.dense_instance(&image, None).unwrap().1);
    let adapted = FLOATS_AND_BYTES.map(|precision| {
        let model = bundled(precision);
        let extractor = Extractor::with_statistics(&model, Domain::Uav, &own).unwrap();
        extractor
            .dense(&image, None)
            .unwrap()
            .descriptors()
            .to_hwc()
    });
    assert!(cosine(&adapted[0], &adapted[1]) > 0.995);
    let plain = bytes.dense(&image, None).unwrap().descriptors().to_hwc();
    assert_ne!(plain, adapted[1]);
}

#[test]
fn the_identity_stays_and_other_networks_are_refused() {
    let model = bundled(Precision::F32);
    let int8 = model.with_precision(Precision::Int8).unwrap();
    assert_eq!(model.hash(), int8.hash());
    assert_eq!(
        int8.with_card(Default::default()).precision(),
        Precision::Int8
    );
    let vgg16 = Model::random(
        &NetSpec {
            global_dim: 0,
            ..NetSpec::vgg16()
        },
        1,
    )
    .unwrap();
    let error = vgg16.with_precision(Precision::Int8).unwrap_err();
    assert!(matches!(error, NetError::UnsupportedPrecision { .. }));
    assert!(
        error
            .to_string()
            .contains("`vgg16` cannot be computed in int8")
    );
}
