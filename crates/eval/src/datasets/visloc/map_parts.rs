//! A map that is published in parts, as that of scene 09: `satellite09_01-01.tif`, `satellite09_01-02.tif` and so on, by row and column
//! from the upper left. They lie edge to edge; the table of corners has one line for all of them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::VislocError;

/// A part by its row and column, from 1.
type Parts = BTreeMap<(u32, u32), PathBuf>;

/// Whether a folder has parts of the map of a scene.
pub(super) fn has_parts(folder: &Path, scene: &str) -> bool {
    !parts(folder, scene).is_empty()
}

/// Joins the parts: writes `satellite09.vrt`, a virtual raster without a georeference, into the folder `out`, and gives its path.
///
/// # Errors
/// [`VislocError::Parts`] if one is missing, unreadable or does not fit the others; [`VislocError::Io`].
pub(super) fn join(folder: &Path, scene: &str, out: &Path) -> Result<PathBuf, VislocError> {
    let parts = parts(folder, scene);
    let wrong = |reason: String| VislocError::Parts {
        folder: folder.to_owned(),
        reason,
    };
    let rows = parts.keys().map(|at| at.0).max().unwrap_or(0);
    let columns = parts.keys().map(|at| at.1).max().unwrap_or(0);
    let (mut sources, mut size_px) = (Vec::new(), (0, 0));
    let mut widths_px = Vec::new();
    for row in 1..=rows {
        let (mut left_px, mut row_height_px) = (0, 0);
        for column in 1..=columns {
            let name = format!("satellite{scene}_{row:02}-{column:02}.tif");
            let path = parts
                .get(&(row, column))
                .ok_or_else(|| wrong(format!("{name} is missing")))?;
            let (width_px, height_px) =
                image::image_dimensions(path).map_err(|error| wrong(format!("{name}: {error}")))?;
            if row == 1 {
                widths_px.push(width_px);
            }
            if column == 1 {
                row_height_px = height_px;
            }
            if widths_px[column as usize - 1] != width_px || row_height_px != height_px {
                return Err(wrong(format!(
                    "{name} has {width_px} x {height_px} pixels, and does not fit those above and beside it"
                )));
            }
            let path = fs_err::canonicalize(path)?;
            let path = path
                .to_str()
                .ok_or_else(|| wrong(format!("the path of {name} is not UTF-8")))?;
            sources.push(Source {
                path: path.to_owned(),
                corner_px: (left_px, size_px.1),
                size_px: (width_px, height_px),
            });
            left_px += u64::from(width_px);
        }
        size_px = (left_px, size_px.1 + u64::from(row_height_px));
    }
    let joined = out.join(format!("satellite{scene}.vrt"));
    fs_err::create_dir_all(out)?;
    fs_err::write(&joined, vrt(size_px, &sources))?;
    Ok(joined)
}

/// A part with its place in the whole.
struct Source {
    path: String,
    corner_px: (u64, u64),
    size_px: (u32, u32),
}

fn parts(folder: &Path, scene: &str) -> Parts {
    let place = |path: &Path| {
        let name = path.file_name()?.to_str()?.strip_prefix("satellite")?;
        let place = name.strip_prefix(scene)?.strip_prefix('_')?;
        let (row, column) = place.strip_suffix(".tif")?.split_once('-')?;
        let number = |text: &str| text.parse().ok().filter(|&number: &u32| number > 0);
        Some((number(row)?, number(column)?))
    };
    let entries = fs_err::read_dir(folder).into_iter().flatten();
    let paths = entries.flatten().map(|entry| entry.path());
    paths
        .filter_map(|path| Some((place(&path)?, path)))
        .collect()
}

/// The sources edge to edge, as GDAL writes it.
fn vrt((width_px, height_px): (u64, u64), sources: &[Source]) -> String {
    let mut text = format!("<VRTDataset rasterXSize=\"{width_px}\" rasterYSize=\"{height_px}\">\n");
    for (band, colour) in (1..).zip(["Red", "Green", "Blue"]) {
        let _ = writeln!(
            text,
            "  <VRTRasterBand dataType=\"Byte\" band=\"{band}\"><ColorInterp>{colour}</ColorInterp>"
        );
        for source in sources {
            let ((left, top), (width, height)) = (source.corner_px, source.size_px);
            let path = source.path.replace('&', "&amp;").replace('<', "&lt;");
            let _ = writeln!(
                text,
                "    <SimpleSource><SourceFilename relativeToVRT=\"0\">{path}</SourceFilename><SourceBand>{band}</SourceBand>\
                 <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"{width}\" ySize=\"{height}\"/>\
                 <DstRect xOff=\"{left}\" yOff=\"{top}\" xSize=\"{width}\" ySize=\"{height}\"/></SimpleSource>"
            );
        }
        text.push_str("  </VRTRasterBand>\n");
    }
    text + "</VRTDataset>\n"
}

#[cfg(test)]
mod tests {
    use grimnet_geo::{MapOptions, WindowPx, open_map};
    use image::{Rgb, RgbImage};

    use super::*;

    fn part(folder: &Path, name: &str, size_px: (u32, u32), tone: u8) {
        let picture = RgbImage::from_pixel(size_px.0, size_px.1, Rgb([tone, 9, 200]));
        picture.save(folder.join(name)).unwrap();
    }

    #[test]
    fn parts_lie_edge_to_edge() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("a & b");
        fs_err::create_dir_all(&folder).unwrap();
        part(&folder, "satellite09_01-01.tif", (40, 30), 10);
        part(&folder, "satellite09_01-02.tif", (24, 30), 60);
        part(&folder, "satellite09_02-01.tif", (40, 16), 110);
        part(&folder, "satellite19_01-01.tif", (5, 5), 0);
        assert!(has_parts(&folder, "09") && !has_parts(&folder, "03"));
        let out = root.path().join("out");
        let text = join(&folder, "09", &out).unwrap_err().to_string();
        assert!(text.contains("satellite09_02-02.tif is missing"), "{text}");
        part(&folder, "satellite09_02-02.tif", (25, 16), 160);
        let text = join(&folder, "09", &out).unwrap_err().to_string();
        assert!(text.contains("25 x 16"), "{text}");
        part(&folder, "satellite09_02-02.tif", (24, 16), 160);
        let options = MapOptions {
            corners: Some([119.0, 32.0, 119.1, 32.1]),
            ..MapOptions::default()
        };
        let map = open_map(&join(&folder, "09", &out).unwrap(), &options).unwrap();
        assert_eq!(map.size_px(), (64, 46));
        for (x, y, tone) in [
            (0, 0, 10),
            (39, 29, 10),
            (40, 29, 60),
            (39, 30, 110),
            (63, 45, 160),
        ] {
            let window = WindowPx::new(f64::from(x), f64::from(y), 1.0, 1.0);
            let read = map.read(window, 1, 1).unwrap().rgb;
            assert_eq!(read.get_pixel(0, 0).0, [tone, 9, 200], "{x}, {y}");
        }
    }
}
