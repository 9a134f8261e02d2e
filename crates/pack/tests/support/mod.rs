//! A made-up map and a tiny random network, so that builds take a moment.
#![allow(dead_code)] // each test file uses its part
#![allow(clippy::unwrap_used)] // helpers outside of test functions fail the test that calls them

pub mod forged;

use std::path::Path;

use grimnet_geo::{Affine, Crs, GeoError, Georeference, Raster, RasterPatch, WindowPx};
use grimnet_net::{Decoder, Downsample, KeypointHead, Model, NetSpec, Stage, Vlad, VladInput};
use grimnet_pack::{BuildOptions, BuildReport, Levels, Pack, Progress, Result, build};
use image::{GrayImage, Luma, Rgb, RgbImage};

/// Metres a map pixel.
pub const GSD_M: f64 = 0.25;

/// A random texture of blobs of several sizes, with parts that have no data or are black.
pub struct TestMap {
    pub size: (u64, u64),
    pub seed: u64,
    /// Left part of the map (this many pixels) without data.
    pub nodata_left: u64,
    /// Upper part of the map (this many pixels) black.
    pub black_top: u64,
    georeference: Georeference,
}

impl TestMap {
    pub fn new(width: u64, height: u64) -> Self {
        Self::with_pixel(width, height, GSD_M)
    }

    /// A map with pixels of this many metres.
    pub fn with_pixel(width: u64, height: u64, pixel_m: f64) -> Self {
        let affine =
            Affine::from_gdal([500_000.0, pixel_m, 0.0, 4_982_950.0, 0.0, -pixel_m]).unwrap();
        let crs = Crs::parse("EPSG:32632").unwrap();
        let georeference = Georeference::new(affine, crs, (width, height));
        Self {
            size: (width, height),
            seed: 1,
            nodata_left: 0,
            black_top: 0,
            georeference,
        }
    }

    fn colour(&self, x: f64, y: f64) -> [u8; 3] {
        let value = |side: f64, channel: u64| {
            let (i, j) = ((x / side).floor() as i64, (y / side).floor() as i64);
            let mut h = self.seed ^ channel << 60 ^ (side as u64) << 50;
            for v in [i as u64, j as u64] {
                h = (h ^ v).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
            }
            (h >> 40) as u8 as f64
        };
        // Regions differ in colour and in grain, so that tiles differ too.
        let grain = value(331.0, 3) / 255.0;
        [0, 1, 2].map(|c| {
            let fine = grain * value(5.0, c) + (1.0 - grain) * value(17.0, c);
            (15.0 + 0.5 * value(331.0, c) + 0.15 * value(61.0, c) + 0.29 * fine) as u8
        })
    }
}

impl Raster for TestMap {
    fn size_px(&self) -> (u64, u64) {
        self.size
    }

    fn georeference(&self) -> &Georeference {
        &self.georeference
    }

    fn content_hash(&self) -> std::result::Result<[u8; 32], GeoError> {
        let mut hash = [0; 32];
        let words = [
            self.size.0,
            self.size.1,
            self.seed,
            self.nodata_left ^ self.black_top << 32,
        ];
        for (i, word) in words.iter().enumerate() {
            hash[8 * i..8 * i + 8].copy_from_slice(&word.to_le_bytes());
        }
        Ok(hash)
    }

    fn read(
        &self,
        w: WindowPx,
        out_w: u32,
        out_h: u32,
    ) -> std::result::Result<RasterPatch, GeoError> {
        let mut rgb = RgbImage::new(out_w, out_h);
        let mut valid = GrayImage::new(out_w, out_h);
        for j in 0..out_h {
            for i in 0..out_w {
                let x = w.x + (f64::from(i) + 0.5) * w.w / f64::from(out_w);
                let y = w.y + (f64::from(j) + 0.5) * w.h / f64::from(out_h);
                let inside = x >= self.nodata_left as f64
                    && x < self.size.0 as f64
                    && y >= 0.0
                    && y < self.size.1 as f64;
                if inside {
                    valid.put_pixel(i, j, Luma([255]));
                    if y >= self.black_top as f64 {
                        rgb.put_pixel(i, j, Rgb(self.colour(x, y)));
                    }
                }
            }
        }
        Ok(RasterPatch { rgb, valid })
    }

    fn describe(&self) -> String {
        format!("a made-up map of {} x {} px", self.size.0, self.size.1)
    }
}

/// A network of the compact design with few channels.
pub fn tiny_spec() -> NetSpec {
    let stage = |width: usize| Stage {
        widths: vec![width],
        downsample: Downsample::StrideFirst,
    };
    NetSpec {
        preset: "tiny".into(),
        input_mean: [0.45; 3],
        input_std: [0.25; 3],
        stages: [4, 8, 8, 8, 8].map(stage).into(),
        decoder: Decoder::Lateral { width: 8 },
        descriptor_dim: 16,
        keypoints: KeypointHead::FromGrey {
            width: 8,
            layers: 1,
        },
        vlad: Vlad {
            input: VladInput::Descriptors,
            clusters: 8,
        },
        global_dim: 64,
    }
}

pub fn tiny_model(seed: u64) -> Model {
    Model::random(&tiny_spec(), seed).unwrap()
}

/// One level at the map's own resolution.
pub fn one_level() -> BuildOptions {
    BuildOptions {
        levels: Levels::Gsd(vec![GSD_M]),
        keypoint_threshold: 0.001,
        ..BuildOptions::standard()
    }
}

/// The same with an index of its keypoints.
pub fn indexed() -> BuildOptions {
    BuildOptions {
        keypoint_index_tiles: 1,
        ..one_level()
    }
}

pub fn paper() -> BuildOptions {
    BuildOptions {
        keypoint_threshold: 0.001,
        resolution: 96,
        max_keypoints: 64,
        ..BuildOptions::paper()
    }
}

pub fn make(map: &TestMap, options: &BuildOptions, out: &Path) -> Result<BuildReport> {
    build(map, &tiny_model(1), options, out, &mut |_: &Progress| {})
}

pub fn make_and_open(map: &TestMap, options: &BuildOptions) -> Pack {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    make(map, options, &out).unwrap();
    // The mapping outlives the name.
    Pack::open(&out).unwrap()
}
