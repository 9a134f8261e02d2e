//! Appearance of a picture: season, sun, time, sensor.

use serde::{Deserialize, Serialize};

use crate::random::Stream;

/// Season of the vegetation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Season {
    /// Fresh greens, rape in flower, bare soil in the row crops.
    Spring,
    /// Full canopies, ripe grain.
    Summer,
    /// Coloured canopies, stubble and ploughed land.
    Autumn,
    /// Bare deciduous trees, brown grass, winter grain.
    Winter,
}

impl Season {
    /// All four, in the order of the year.
    pub const ALL: [Self; 4] = [Self::Spring, Self::Summer, Self::Autumn, Self::Winter];
}

/// Camera and image processing. Lengths are in pixels of the rendered picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorModel {
    /// Exposure of red, green and blue relative to a neutral camera.
    pub gain_rgb: [f32; 3],
    /// Contrast: 1 is neutral.
    pub contrast: f32,
    /// Saturation: 1 is neutral, 0 is grey.
    pub saturation: f32,
    /// Local contrast normalisation over about 40 m, as map services use: 0 none, 1 full.
    pub equalisation: f32,
    /// Haze: share of bluish path radiance, 0 to 1.
    pub haze: f32,
    /// Vignetting: darkening of the corners, 0 to 1.
    pub vignette: f32,
    /// Standard deviation of the point spread function.
    pub blur_px: f32,
    /// Amount of unsharp masking after the blur; 0 none.
    pub sharpen: f32,
    /// Standard deviation of the noise in display values 0-255.
    pub noise: f32,
    /// JPEG quality (1-100) of a compression step; `None` for none.
    pub jpeg_quality: Option<u8>,
}

impl SensorModel {
    /// A web map's satellite or aircraft layer: soft, equalised, greenish-blue, compressed.
    pub fn satellite() -> Self {
        Self {
            gain_rgb: [0.92, 1.02, 1.06],
            contrast: 1.12,
            saturation: 1.05,
            equalisation: 0.35,
            haze: 0.05,
            vignette: 0.0,
            blur_px: 0.85,
            sharpen: 0.0,
            noise: 1.0,
            jpeg_quality: Some(78),
        }
    }

    /// A small drone's camera: sharp, contrasty, warm, with vignetting.
    pub fn drone() -> Self {
        Self {
            gain_rgb: [1.06, 1.0, 0.93],
            contrast: 1.0,
            saturation: 0.95,
            equalisation: 0.0,
            haze: 0.0,
            vignette: 0.22,
            blur_px: 0.5,
            sharpen: 0.35,
            noise: 2.0,
            jpeg_quality: None,
        }
    }
}

/// Appearance of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// Season of the vegetation.
    pub season: Season,
    /// Camera and processing.
    pub sensor: SensorModel,
    /// Azimuth of the sun, degrees clockwise from north.
    pub sun_azimuth_deg: f32,
    /// Elevation of the sun, degrees; clamped to 10..=85.
    pub sun_elevation_deg: f32,
    /// Share of skylight in the light on flat ground: 0.2 clear, 0.9 overcast.
    pub sky_share: f32,
    /// Point in time: cars and other moving objects have other positions in another epoch.
    pub epoch: u32,
    /// Share of buildings and trees that may appear or disappear between epochs, 0 to 1.
    pub change: f32,
    /// Maps only: displacement of a roof per metre of height, east and north; satellite images are
    /// taken some degrees off nadir.
    pub lean_en: [f32; 2],
}

impl Look {
    /// A satellite map, epoch 0, sun from the south-east.
    pub fn satellite(season: Season) -> Self {
        Self {
            season,
            sensor: SensorModel::satellite(),
            sun_azimuth_deg: 142.0,
            sun_elevation_deg: if season == Season::Winter { 38.0 } else { 55.0 },
            sky_share: 0.24,
            epoch: 0,
            change: 0.03,
            lean_en: [0.10, -0.06],
        }
    }

    /// A drone photo, epoch 1, sun from the south-west.
    pub fn drone(season: Season) -> Self {
        Self {
            season,
            sensor: SensorModel::drone(),
            sun_azimuth_deg: 224.0,
            sun_elevation_deg: if season == Season::Winter { 32.0 } else { 47.0 },
            sky_share: 0.2,
            epoch: 1,
            change: 0.03,
            lean_en: [0.0, 0.0],
        }
    }

    /// A random satellite look: season, sun, roof displacement and processing vary.
    pub fn varied_satellite(seed: u64) -> Self {
        let mut r = Stream::new(seed);
        let mut look = Self::satellite(r.pick(&Season::ALL));
        look.vary(&mut r);
        let lean = r.range(0.0, 0.25);
        let towards = r.range(0.0, std::f32::consts::TAU);
        look.lean_en = [lean * towards.sin(), lean * towards.cos()];
        look.sensor.equalisation = if r.chance(0.5) {
            r.range(0.0, 0.9)
        } else {
            0.0
        };
        look.sensor.blur_px = r.range(0.4, 1.4);
        look.sensor.sharpen = if r.chance(0.3) {
            r.range(0.0, 0.8)
        } else {
            0.0
        };
        look.sensor.haze = r.range(0.0, 0.2);
        look.sensor.noise = r.range(0.3, 2.5);
        look.sensor.jpeg_quality = r.chance(0.7).then(|| r.range(45.0, 95.0) as u8);
        look
    }

    /// A random drone look.
    pub fn varied_drone(seed: u64) -> Self {
        let mut r = Stream::new(seed ^ 0xd70e);
        let mut look = Self::drone(r.pick(&Season::ALL));
        look.vary(&mut r);
        look.sensor.vignette = r.range(0.0, 0.4);
        look.sensor.blur_px = r.range(0.3, 1.0);
        look.sensor.sharpen = r.range(0.0, 0.8);
        look.sensor.haze = if r.chance(0.3) {
            r.range(0.0, 0.15)
        } else {
            0.0
        };
        look.sensor.noise = r.range(0.5, 5.0);
        look.sensor.jpeg_quality = r.chance(0.5).then(|| r.range(60.0, 95.0) as u8);
        look
    }

    fn vary(&mut self, r: &mut Stream) {
        self.sun_azimuth_deg = r.range(80.0, 280.0);
        self.sun_elevation_deg = r.range(25.0, 70.0);
        self.sky_share = if r.chance(0.2) {
            r.range(0.5, 0.9)
        } else {
            r.range(0.15, 0.35)
        };
        self.epoch = r.next_u32();
        self.change = r.range(0.0, 0.08);
        let s = &mut self.sensor;
        let exposure = r.range(0.75, 1.3);
        for g in &mut s.gain_rgb {
            *g *= exposure * r.range(0.88, 1.14);
        }
        s.contrast = r.range(0.8, 1.35);
        s.saturation = r.range(0.5, 1.35);
    }
}
