//! The plan of a track: how places become pixels, and the map below it.

use base64::Engine as _;
use grimnet_geo::{GeoError, LonLat, Raster, WindowPx, offset_en_m};

/// Longest side of the plan, pixels.
const SIDE_PX: f64 = 1000.0;
/// Least extent of the plan, metres.
const LEAST_EXTENT_M: f64 = 50.0;
/// Margin around the track, as a share of its extent.
const MARGIN: f64 = 0.15;

/// How metres and places become pixels of the plan: east to the right, north up.
pub(super) struct Plan {
    origin: LonLat,
    /// East and north of the left bottom corner, metres.
    low_en_m: [f64; 2],
    pub(super) size_m: [f64; 2],
    pub(super) px_per_m: f64,
}

impl Plan {
    pub(super) fn around(places: &[LonLat]) -> Option<Self> {
        let origin = *places.first()?;
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for place in places {
            let (east_m, north_m) = offset_en_m(origin, *place);
            for (axis, value) in [east_m, north_m].into_iter().enumerate() {
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
        let extent_m = (high[0] - low[0]).max(high[1] - low[1]).max(LEAST_EXTENT_M);
        let low_en_m = low.map(|value| value - MARGIN * extent_m);
        let size_m = [0, 1].map(|axis| high[axis] + MARGIN * extent_m - low_en_m[axis]);
        Some(Self {
            origin,
            low_en_m,
            size_m,
            px_per_m: SIDE_PX / size_m[0].max(size_m[1]),
        })
    }

    pub(super) fn size_px(&self) -> [f64; 2] {
        self.size_m.map(|side| side * self.px_per_m)
    }

    pub(super) fn px(&self, place: LonLat) -> [f64; 2] {
        let (east_m, north_m) = offset_en_m(self.origin, place);
        [
            (east_m - self.low_en_m[0]) * self.px_per_m,
            (self.low_en_m[1] + self.size_m[1] - north_m) * self.px_per_m,
        ]
    }

    /// The map below the plan as JPEG, and where its corners lie on the plan. The map's axes need not be those of the plan.
    pub(super) fn background(&self, map: &dyn Raster) -> Result<Option<Background>, GeoError> {
        let georeference = map.georeference();
        let corner = |east: f64, north: f64| {
            let [e, n] = self.low_en_m;
            let place = grimnet_geo::destination_en_m(
                self.origin,
                e + east * self.size_m[0],
                n + north * self.size_m[1],
            );
            georeference.map_px_from_lonlat(place)
        };
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(e, n)| corner(e, n));
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in corners {
            let corner = corner?;
            for (axis, value) in [corner.x, corner.y].into_iter().enumerate() {
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
        let (width, height) = map.size_px();
        let (width, height) = (width as f64, height as f64);
        let (low, high) = (
            [low[0].max(0.0), low[1].max(0.0)],
            [high[0].min(width), high[1].min(height)],
        );
        let (w, h) = (high[0] - low[0], high[1] - low[1]);
        if !(w >= 1.0 && h >= 1.0) {
            return Ok(None);
        }
        let scale = (SIDE_PX / w.max(h)).min(1.0);
        let side = |length: f64| ((length * scale).round() as u32).max(1);
        let window = WindowPx {
            x: low[0],
            y: low[1],
            w,
            h,
        };
        let picture = map.read(window, side(w), side(h))?.rgb;
        let at = |x: f64, y: f64| -> Result<[f64; 2], GeoError> {
            let px = grimnet_geo::MapPx::new(x, y);
            Ok(self.px(georeference.lonlat_from_map_px(px)?))
        };
        Ok(Some(Background {
            picture,
            top_left_px: at(low[0], low[1])?,
            top_right_px: at(high[0], low[1])?,
            bottom_left_px: at(low[0], high[1])?,
        }))
    }
}

pub(super) struct Background {
    picture: image::RgbImage,
    top_left_px: [f64; 2],
    top_right_px: [f64; 2],
    bottom_left_px: [f64; 2],
}

impl Background {
    /// As an element of the plan: an affine picture.
    pub(super) fn svg(&self) -> Result<String, image::ImageError> {
        let mut jpeg = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 80)
            .encode_image(&self.picture)?;
        let data = base64::engine::general_purpose::STANDARD.encode(&jpeg);
        let (width, height) = self.picture.dimensions();
        let along = |to: [f64; 2], count: u32| {
            [0, 1].map(|axis| (to[axis] - self.top_left_px[axis]) / f64::from(count.max(1)))
        };
        let ([a, b], [c, d]) = (
            along(self.top_right_px, width),
            along(self.bottom_left_px, height),
        );
        let [e, f] = self.top_left_px;
        Ok(format!(
            "<image width=\"{width}\" height=\"{height}\" opacity=\"0.75\" transform=\"matrix({a} {b} {c} {d} {e} {f})\" \
             preserveAspectRatio=\"none\" href=\"data:image/jpeg;base64,{data}\"/>"
        ))
    }
}
