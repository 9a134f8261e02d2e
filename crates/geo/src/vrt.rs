//! GDAL's virtual rasters (VRT), as `gdalbuildvrt` writes them.

use std::path::{Path, PathBuf};

use grimnet_limits::MapLimits;

use crate::content_hash::ContentValues;
use crate::error::ADVICE_TILE_IT;
use crate::pam::affine_of;
use crate::stated_crs::StatedCrs;
use crate::xml_tree::{Element, read_xml};
use crate::{Affine, GeoError, WindowPx};

/// Pictures, at most.
const MAX_SOURCES: usize = MapLimits::DEFAULT.max_mosaic_pictures as usize;
/// Largest side of a VRT, pixels.
const MAX_SIDE_PX: u64 = 1 << 31;

/// What a VRT says.
pub(crate) struct Vrt {
    pub size_px: (u64, u64),
    pub affine: Option<Affine>,
    pub crs: StatedCrs,
    pub is_grey: bool,
    /// Lowest first.
    pub sources: Vec<VrtSource>,
}

/// A picture in a VRT.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VrtSource {
    pub file: PathBuf,
    pub from: WindowPx,
    pub to: WindowPx,
    pub nodata: Option<f64>,
}

impl Vrt {
    /// Adds what decides its pixels and its place to a map's content: GDAL keeps statistics in the same file.
    pub fn add_to(&self, values: &mut ContentValues) {
        let size = [self.size_px.0, self.size_px.1].map(|side| side as f64);
        values.add_numbers("size", &size);
        if let Some(affine) = self.affine {
            values.add_numbers("transform", &affine.to_gdal());
        }
        if let Some(crs) = self.crs.known() {
            values.add_text("crs", crs.definition());
        }
        for source in &self.sources {
            for window in [source.from, source.to] {
                values.add_numbers("window", &[window.x, window.y, window.w, window.h]);
            }
            if let Some(nodata) = source.nodata {
                values.add_numbers("nodata", &[nodata]);
            }
        }
    }
}

/// Reads a VRT. Pictures are not opened.
pub(crate) fn read_vrt(path: &Path) -> Result<Vrt, GeoError> {
    let root = read_xml(path)?;
    let reader = Reader { path };
    if root.name != "VRTDataset" {
        return Err(GeoError::NotAMap {
            path: path.to_path_buf(),
            reason: format!("it is XML with the root '{}', not a VRT", root.name),
        });
    }
    if let Some(class) = root.attribute("subClass") {
        return Err(reader.unsupported(&format!("a VRT of class {class}")));
    }
    let side = |name: &str| {
        root.attribute(name)
            .and_then(|text| text.trim().parse::<u64>().ok())
            .filter(|side| (1..=MAX_SIDE_PX).contains(side))
            .ok_or_else(|| GeoError::damaged(path, format!("{name} is not a number of pixels")))
    };
    let size_px = (side("rasterXSize")?, side("rasterYSize")?);
    let affine = match root.child_text("GeoTransform") {
        Some(text) => Some(affine_of(path, text)?),
        None => None,
    };
    let crs = StatedCrs::from_text(root.child_text("SRS").unwrap_or_default());
    let bands: Vec<&Element> = root.all("VRTRasterBand").collect();
    let (sources, is_grey) = reader.sources(&bands)?;
    Ok(Vrt {
        size_px,
        affine,
        crs,
        is_grey,
        sources,
    })
}

struct Reader<'a> {
    path: &'a Path,
}

impl Reader<'_> {
    fn unsupported(&self, what: &str) -> GeoError {
        GeoError::Unsupported {
            path: self.path.to_path_buf(),
            what: what.to_string(),
            advice: ADVICE_TILE_IT,
        }
    }

    /// The pictures of the colour bands, which must be the same in each, and whether there is one band only.
    fn sources(&self, bands: &[&Element]) -> Result<(Vec<VrtSource>, bool), GeoError> {
        let colours: Vec<&Element> = bands
            .iter()
            .copied()
            .filter(|band| band.child_text("ColorInterp") != Some("Alpha"))
            .take(3)
            .collect();
        let is_grey = colours.len() < 3;
        let used = if is_grey { 1 } else { 3 };
        let mut first: Option<Vec<VrtSource>> = None;
        for (index, band) in colours.iter().take(used).enumerate() {
            let sources = self.sources_of_band(band, index + 1)?;
            match &first {
                None => first = Some(sources),
                Some(first) if *first == sources => {}
                Some(_) => {
                    return Err(self.unsupported("bands that are made of different pictures"));
                }
            }
        }
        match first {
            Some(sources) if !sources.is_empty() => Ok((sources, is_grey)),
            _ => Err(GeoError::NotAMap {
                path: self.path.to_path_buf(),
                reason: "the VRT names no pictures".to_string(),
            }),
        }
    }

    fn sources_of_band(&self, band: &Element, number: usize) -> Result<Vec<VrtSource>, GeoError> {
        if let Some(class) = band.attribute("subClass") {
            return Err(self.unsupported(&format!("a VRT band of class {class}")));
        }
        if band.child("ColorTable").is_some() {
            return Err(self.unsupported("a VRT band with a colour table"));
        }
        let band_nodata = self.nodata(band.child_text("NoDataValue"))?;
        let mut sources = Vec::new();
        for element in band.children.iter().filter(|e| e.name.ends_with("Source")) {
            if element.name != "SimpleSource" && element.name != "ComplexSource" {
                return Err(self.unsupported(&format!("{} in a VRT", element.name)));
            }
            if sources.len() >= MAX_SOURCES {
                return Err(self.unsupported(&format!("more than {MAX_SOURCES} pictures")));
            }
            let mut source = self.source(element, number)?;
            source.nodata = source.nodata.or(band_nodata);
            sources.push(source);
        }
        Ok(sources)
    }

    fn source(&self, element: &Element, number: usize) -> Result<VrtSource, GeoError> {
        for name in [
            "ScaleOffset",
            "ScaleRatio",
            "LUT",
            "Exponent",
            "ColorTableComponent",
        ] {
            if element.child(name).is_some() {
                return Err(self.unsupported(&format!("{name} in a VRT")));
            }
        }
        let band = element.child_text("SourceBand").unwrap_or("1");
        if band != number.to_string() {
            return Err(self.unsupported(&format!(
                "band {number} of a VRT that is made of band {band} of a picture"
            )));
        }
        let file = element
            .child("SourceFilename")
            .ok_or_else(|| GeoError::damaged(self.path, "a source has no SourceFilename"))?;
        let name = file.text.trim();
        if name.is_empty() || name.starts_with("/vsi") || name.contains("://") {
            return Err(self.unsupported(&format!("the picture '{name}', which is not a file")));
        }
        let relative = file.attribute("relativeToVRT").map(str::trim) == Some("1");
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let file = if relative {
            folder.join(name)
        } else {
            PathBuf::from(name)
        };
        Ok(VrtSource {
            file,
            from: self.rectangle(element, "SrcRect")?,
            to: self.rectangle(element, "DstRect")?,
            nodata: self.nodata(element.child_text("NODATA"))?,
        })
    }

    fn nodata(&self, text: Option<&str>) -> Result<Option<f64>, GeoError> {
        text.map(|text| {
            text.parse::<f64>()
                .map_err(|_| GeoError::damaged(self.path, format!("nodata '{text}' is no number")))
        })
        .transpose()
    }

    fn rectangle(&self, source: &Element, name: &str) -> Result<WindowPx, GeoError> {
        let found = source.child(name).and_then(|e| {
            let side = |key: &str| e.attribute(key)?.trim().parse::<f64>().ok();
            let sides = [side("xOff")?, side("yOff")?, side("xSize")?, side("ySize")?];
            let usable = sides
                .iter()
                .all(|v| v.is_finite() && v.abs() < MAX_SIDE_PX as f64)
                && sides[2] > 0.0
                && sides[3] > 0.0;
            usable.then(|| WindowPx::new(sides[0], sides[1], sides[2], sides[3]))
        });
        found.ok_or_else(|| GeoError::damaged(self.path, format!("a source has no usable {name}")))
    }
}
