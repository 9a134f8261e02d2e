//! Where `grim eval` finds map, photos and truth.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use grimnet_eval::truth::{self, TruthFrame};
use grimnet_eval::{anyvisloc, msdi, visloc};
use grimnet_geo::{LonLat, MapOptions, Raster};
use grimnet_output::{OutputFolder, OutputPolicy};
use grimnet_photo::Metadata;

use super::map::MapPlace;
use crate::photos;
use crate::procedural_flight::{make_flight, move_into};

/// Photos of the procedural flight of `--world`.
const WORLD_PHOTOS: usize = 40;

/// What the user said.
pub struct LayoutChoice<'a> {
    /// The folder, if one was given.
    pub folder: Option<&'a Path>,
    /// Seed of a procedural world, if that is to be localised.
    pub world: Option<u64>,
    /// Folder of results; a procedural world, and photos that are cut from a data set, are written there.
    pub out: &'a Path,
    /// What may be replaced there.
    pub policy: &'a OutputPolicy,
    /// The map, where it is not in its usual place.
    pub map: Option<&'a Path>,
    /// The map's place, where it does not tell it.
    pub place: &'a MapPlace,
}

/// What was found.
#[derive(Debug)]
pub struct Layout {
    /// The map.
    pub map: PathBuf,
    /// How it is placed.
    pub map_options: MapOptions,
    /// The photos whose place is known.
    pub truth: Vec<(TruthFrame, PathBuf)>,
    /// What it is, for people.
    pub data: String,
}

impl Layout {
    /// Looks at what was given, and names on standard error whatever cannot be scored.
    ///
    /// # Errors
    /// No layout that is known, or nothing in it that can be scored.
    pub fn find(choice: &LayoutChoice<'_>) -> Result<Self> {
        if let Some(seed) = choice.world {
            let out = OutputFolder::open(choice.out, choice.policy)?;
            make_flight(&out, seed, WORLD_PHOTOS)?;
            drop(out);
            let found = Self::plain(choice.out, choice)?;
            return Ok(Self {
                data: format!("procedural world {seed}"),
                ..found
            });
        }
        let Some(folder) = choice.folder else {
            bail!(
                "no FOLDER given: `grim eval FOLDER --out DIR`; only --world, --experiment and --sweep can do without"
            );
        };
        if !folder.is_dir() {
            bail!("{}: no such folder", folder.display());
        }
        if folder.join("truth.csv").is_file() {
            return Self::plain(folder, choice);
        }
        if visloc::is_scene(folder) {
            return Self::visloc(folder, choice);
        }
        if anyvisloc::is_scene(folder) {
            return Self::anyvisloc(folder, choice);
        }
        Self::by_exif(folder, choice)
    }

    /// Whether a folder says by its files that it is a data set.
    #[cfg(feature = "experiments")]
    pub fn is_told(folder: &Path) -> bool {
        folder.join("truth.csv").is_file()
            || visloc::is_scene(folder)
            || anyvisloc::is_scene(folder)
    }

    /// `map.tif`, `photos/`, `truth.csv`.
    fn plain(folder: &Path, choice: &LayoutChoice<'_>) -> Result<Self> {
        let (frames, bad) = truth::read_rows(&folder.join("truth.csv"))?;
        for error in bad {
            tracing::warn!("{error}; left out");
        }
        Ok(Self {
            map: choice
                .map
                .map_or_else(|| folder.join("map.tif"), Path::to_owned),
            map_options: choice.place.options(),
            truth: scorable(frames, &folder.join("photos"))?,
            data: name_of(folder),
        })
    }

    /// A scene of UAV-VisLoc.
    fn visloc(folder: &Path, choice: &LayoutChoice<'_>) -> Result<Self> {
        let scene = visloc::read(folder)?;
        for line in &scene.left_out {
            tracing::warn!("{line}");
        }
        let map_options = choice.place.options();
        Ok(Self {
            map: choice.map.map_or(scene.map, Path::to_owned),
            map_options: MapOptions {
                corners: map_options.corners.or(Some(scene.corners)),
                ..map_options
            },
            truth: scorable(scene.frames, &scene.photos)?,
            data: format!("UAV-VisLoc {}", name_of(folder)),
        })
    }

    /// A scene of AnyVisLoc, whose photos are written into the folder of results.
    fn anyvisloc(folder: &Path, choice: &LayoutChoice<'_>) -> Result<Self> {
        // The data set's reader writes to paths.
        let scratch = tempfile::tempdir()?;
        let scene = anyvisloc::read(folder, choice.map, scratch.path())?;
        let out = OutputFolder::open(choice.out, choice.policy)?.subfolder("photos")?;
        for entry in fs_err::read_dir(scratch.path())? {
            move_into(&out, &name_of(&entry?.path()), scratch.path())?;
        }
        let photos = out.path().to_owned();
        for line in &scene.left_out {
            tracing::warn!("{line}");
        }
        Ok(Self {
            map: scene.map,
            map_options: MapOptions {
                corners: Some(scene.corners),
                ..MapOptions::default()
            },
            truth: scorable(scene.frames, &photos)?,
            data: format!("AnyVisLoc {}", name_of(folder)),
        })
    }

    /// Photos that tell themselves where they were taken: the receiver's place, not the image centre's.
    fn by_exif(folder: &Path, choice: &LayoutChoice<'_>) -> Result<Self> {
        let default = folder.join("map.tif");
        let Some(map) = choice
            .map
            .or_else(|| default.is_file().then_some(default.as_path()))
        else {
            if msdi::scenes(folder).is_some() {
                bail!(
                    "{}: MSDI comes without a map of its flights; give one that covers them with --map",
                    folder.display()
                );
            }
            bail!(
                "{}: neither truth.csv nor a scene of UAV-VisLoc or AnyVisLoc; for photos whose EXIF is the truth give the --map",
                folder.display()
            );
        };
        let inside = folder.join("photos");
        let sources = match msdi::scenes(folder) {
            Some(scenes) => scenes,
            None if inside.is_dir() => vec![inside],
            None => vec![folder.to_owned()],
        };
        let mut truth = Vec::new();
        for path in photos::expand(&sources)? {
            let Ok(metadata) = Metadata::read(&path) else {
                tracing::warn!("{}: cannot be read; left out", path.display());
                continue;
            };
            let Some(position) = metadata.position else {
                tracing::warn!("{}: has no position in its EXIF; left out", path.display());
                continue;
            };
            let frame = TruthFrame {
                photo: name_of(&path),
                centre_lat_lon_deg: None,
                gps_lat_lon_deg: Some((position.lat_deg, position.lon_deg)),
                heading_deg: None,
                height_agl_m: None,
            };
            truth.push((frame, path));
        }
        if truth.is_empty() {
            bail!(
                "{}: no photo there whose EXIF tells its place",
                folder.display()
            );
        }
        Ok(Self {
            map: map.to_owned(),
            map_options: choice.place.options(),
            truth,
            data: format!("{} (truth: EXIF, where the receiver was)", name_of(folder)),
        })
    }

    /// Leaves out truths that lie beside the map, each named.
    ///
    /// # Errors
    /// None lies on the map: its georeference is another than the truth's.
    pub fn on_map(
        truth: Vec<(TruthFrame, PathBuf)>,
        map: &dyn Raster,
    ) -> Result<Vec<(TruthFrame, PathBuf)>> {
        let (width, height) = map.size_px();
        let is_on = |lat_deg, lon_deg| {
            let place = LonLat { lon_deg, lat_deg };
            map.georeference()
                .map_px_from_lonlat(place)
                .is_ok_and(|px| {
                    (0.0..=width as f64).contains(&px.x) && (0.0..=height as f64).contains(&px.y)
                })
        };
        let place = |frame: &TruthFrame| frame.centre_lat_lon_deg.or(frame.gps_lat_lon_deg);
        let (on, beside): (Vec<_>, Vec<_>) = truth
            .into_iter()
            .partition(|(frame, _)| place(frame).is_some_and(|(lat, lon)| is_on(lat, lon)));
        if on.is_empty() {
            let example = beside.first().and_then(|(frame, _)| place(frame));
            bail!(
                "none of the {} true positions lies on the map (the first is {:?}, latitude and longitude; the map: {}): is its \
                 coordinate system right (--crs, --corners), and are latitude and longitude in their columns?",
                beside.len(),
                example.unwrap_or_default(),
                map.describe()
            );
        }
        for (frame, _) in &beside {
            tracing::warn!(
                "{}: its true position lies beside the map; left out",
                frame.photo
            );
        }
        Ok(on)
    }
}

/// The truths that can be scored: photo there, place known. The others, and photos without truth, are named on standard error.
fn scorable(truth: Vec<TruthFrame>, photos: &Path) -> Result<Vec<(TruthFrame, PathBuf)>> {
    let mut usable = Vec::new();
    let named: HashSet<String> = truth.iter().map(|frame| frame.photo.clone()).collect();
    for frame in truth {
        let path = photos.join(&frame.photo);
        if !path.is_file() {
            tracing::warn!(
                "{}: named in the truth and not there; left out",
                path.display()
            );
        } else if frame.centre_lat_lon_deg.is_none() && frame.gps_lat_lon_deg.is_none() {
            tracing::warn!(
                "{}: the truth does not say where it is; left out",
                frame.photo
            );
        } else {
            usable.push((frame, path));
        }
    }
    if photos.is_dir() {
        for path in photos::expand(&[photos.to_owned()]).unwrap_or_default() {
            if !named.contains(&name_of(&path)) {
                tracing::warn!("{}: has no truth; left out", path.display());
            }
        }
    }
    if usable.is_empty() {
        bail!("{}: no photo there whose place is known", photos.display());
    }
    Ok(usable)
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(
        || path.display().to_string(),
        |name| name.to_string_lossy().into_owned(),
    )
}
