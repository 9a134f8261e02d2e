//! `grim locate`: say where photos were taken.

use std::fmt;
use std::io::{IsTerminal as _, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use grimnet_geo::{LonLat, Raster, distance_m, open_map};
use grimnet_locate::draw::{DrawOptions, draw_matches};
use grimnet_locate::{
    Adapt, DEFAULT_MAP_ERROR_M, Gates, HeadingPrior, Localizer, Options, Outcome, Prior, Trace,
};
use grimnet_pack::Pack;
use grimnet_photo::{Photo, ViewPrior};

use super::map::MapPlace;
use super::{ModeChoice, ModelChoice};
use crate::answer::Answer;
use crate::exit::Exit;
use crate::output::Format;
use crate::{photos, progress};

/// A heading that the user gives is taken to be right to this many degrees (1 sigma).
const GIVEN_HEADING_SIGMA_DEG: f64 = 5.0;

/// What the user says of the heading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HeadingChoice {
    /// As the photo's metadata say, if they do.
    Exif,
    /// Searched.
    Unknown,
    /// Degrees clockwise from true north.
    Degrees(f64),
}

impl FromStr for HeadingChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "exif" => Ok(Self::Exif),
            "unknown" => Ok(Self::Unknown),
            _ => match text.parse::<f64>() {
                Ok(degrees) if degrees.is_finite() => Ok(Self::Degrees(degrees.rem_euclid(360.0))),
                _ => {
                    Err("a number of degrees clockwise from north, `exif` or `unknown`".to_owned())
                }
            },
        }
    }
}

impl HeadingChoice {
    /// As the localiser takes it.
    pub fn prior(self) -> HeadingPrior {
        match self {
            Self::Exif => HeadingPrior::FromMetadata,
            Self::Unknown => HeadingPrior::Unknown,
            Self::Degrees(heading_deg) => HeadingPrior::Known {
                heading_deg,
                sigma_deg: GIVEN_HEADING_SIGMA_DEG,
            },
        }
    }
}

/// `LAT,LON,RADIUS_M`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearChoice(grimnet_locate::Near);

impl FromStr for NearChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text
            .split(',')
            .filter_map(|t| t.trim().parse().ok())
            .collect();
        match numbers[..] {
            [lat_deg, lon_deg, radius_m]
                if lat_deg.abs() <= 90.0
                    && lon_deg.abs() <= 180.0
                    && radius_m > 0.0
                    && radius_m.is_finite() =>
            {
                let centre = LonLat { lon_deg, lat_deg };
                Ok(Self(grimnet_locate::Near { centre, radius_m }))
            }
            _ => Err(
                "latitude, longitude (degrees) and radius (metres), such as 24.26,120.72,500"
                    .to_owned(),
            ),
        }
    }
}

/// Whose normalisation statistics the photo's features are made with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum AdaptChoice {
    /// The model's own
    #[default]
    None,
    /// Each photo's own
    Photo,
    /// Those of all given photos together
    Flight,
}

impl fmt::Display for AdaptChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "none",
            Self::Photo => "photo",
            Self::Flight => "flight",
        })
    }
}

/// What is known of the view, and how to localise: shared by all commands that localise.
#[derive(Debug, Clone, Args)]
pub struct LocateOptions {
    /// Where the top of the photo points: degrees clockwise from north, `exif` (from the photo, searched where it does
    /// not say) or `unknown` (searched)
    #[arg(
        long,
        value_name = "DEG|exif|unknown",
        default_value = "exif",
        allow_hyphen_values = true
    )]
    pub heading: HeadingChoice,

    /// Height above ground, metres [default: from the photo]
    #[arg(long, value_name = "M")]
    pub height_agl: Option<f64>,

    /// Horizontal field of view, degrees [default: from the photo]
    #[arg(long, value_name = "DEG")]
    pub hfov: Option<f64>,

    /// Ground resolution of the full-size photo, metres per pixel
    #[arg(long, value_name = "M", conflicts_with_all = ["height_agl", "hfov"])]
    pub gsd: Option<f64>,

    /// Only look within a radius of a place
    #[arg(long, value_name = "LAT,LON,RADIUS_M", allow_hyphen_values = true)]
    pub near: Option<NearChoice>,

    /// Which recipe to follow
    #[arg(long, value_enum, default_value_t)]
    pub mode: ModeChoice,

    /// Take the normalisation statistics anew
    #[arg(long, value_enum, default_value_t)]
    pub adapt: AdaptChoice,

    /// How far the map itself may lie beside the truth, metres (1 sigma per axis); the stated radius includes it
    #[arg(long, value_name = "M", default_value_t = DEFAULT_MAP_ERROR_M)]
    pub map_error: f64,

    /// Give a fix only if it is this probably right, 0 to 1 [default: as the model's calibration asks for]
    #[arg(long, value_name = "P")]
    pub min_confidence: Option<f64>,

    /// Stop searching after this many milliseconds a photo
    #[arg(long, value_name = "MS")]
    pub budget_ms: Option<f64>,

    /// Tiles taken from the search [default: 5 in paper mode, hundreds in default mode]
    #[arg(long, value_name = "K")]
    pub top_k: Option<usize>,
}

impl LocateOptions {
    /// What the user knows of the photos.
    pub fn prior(&self) -> Prior {
        Prior {
            view: ViewPrior {
                heading: self.heading.prior(),
                height_agl_m: self.height_agl,
                hfov_deg: self.hfov,
                gsd_m: self.gsd,
            },
            near: self.near.map(|n| n.0),
        }
    }

    /// How to localise.
    pub fn options(&self) -> Options {
        let named = match self.mode {
            ModeChoice::Default => Options::default(),
            ModeChoice::Paper => Options::paper(),
        };
        Options {
            top_k: self.top_k.unwrap_or(named.top_k),
            budget_ms: self.budget_ms,
            map_error_m: self.map_error,
            gates: named.gates.map(|gates| Gates {
                min_confidence: self.min_confidence,
                ..gates
            }),
            adapt: match self.adapt {
                AdaptChoice::None => Adapt::None,
                AdaptChoice::Photo => Adapt::Photo,
                AdaptChoice::Flight => Adapt::Flight,
            },
            ..named
        }
    }

    /// Nothing known beside the photos; for commands that give each photo its own prior.
    pub fn plain(mode: ModeChoice, adapt: AdaptChoice) -> Self {
        Self {
            heading: HeadingChoice::Exif,
            height_agl: None,
            hfov: None,
            gsd: None,
            near: None,
            mode,
            adapt,
            map_error: DEFAULT_MAP_ERROR_M,
            min_confidence: None,
            budget_ms: None,
            top_k: None,
        }
    }

    fn check(&self) -> Result<()> {
        let positive = |name: &str, value: Option<f64>| match value {
            Some(v) if !(v > 0.0 && v.is_finite()) => {
                bail!("--{name} {v}: must be a positive number")
            }
            _ => Ok(()),
        };
        positive("height-agl", self.height_agl)?;
        positive("gsd", self.gsd)?;
        positive("budget-ms", self.budget_ms)?;
        if !(self.map_error >= 0.0 && self.map_error.is_finite()) {
            bail!(
                "--map-error {}: must be a number of metres, not below zero",
                self.map_error
            );
        }
        if let Some(p) = self.min_confidence
            && !(0.0..=1.0).contains(&p)
        {
            bail!("--min-confidence {p}: must lie between 0 and 1");
        }
        match self.hfov {
            Some(v) if !(v > 0.0 && v < 180.0) => {
                bail!("--hfov {v}: must lie between 0 and 180 degrees")
            }
            _ => Ok(()),
        }
    }
}

/// Arguments of `grim locate`.
#[derive(Debug, Args)]
pub struct LocateArgs {
    /// The map pack (see `grim map build`)
    #[arg(short, long, value_name = "AREA.grim")]
    pack: PathBuf,

    /// Photos, folders of photos, or patterns
    #[arg(required = true)]
    photos: Vec<PathBuf>,

    #[command(flatten)]
    locate: LocateOptions,

    #[command(flatten)]
    model: ModelChoice,

    /// How to write the answers [default: table on a terminal, jsonl elsewhere]
    #[arg(long, value_enum)]
    format: Option<Format>,

    /// Write the answers to this file
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Also tell how far each answer lies from the position in the photo's metadata
    #[arg(long)]
    check: bool,

    /// Draw for each photo what was matched, and its outline on the map (with --map), into this folder
    #[arg(long, value_name = "DIR")]
    draw: Option<PathBuf>,

    /// The map that the pack was built from, for --draw
    #[arg(long, value_name = "MAP", requires = "draw")]
    map: Option<PathBuf>,

    #[command(flatten)]
    place: MapPlace,
}

/// Runs the command.
///
/// # Errors
/// Unreadable pack, model or map; answers that cannot be written. A photo that cannot be read is answered in its own line.
pub fn run(arguments: &LocateArgs) -> Result<Exit> {
    arguments.locate.check()?;
    let paths = photos::expand(&arguments.photos)?;
    let map = arguments
        .map
        .as_ref()
        .map(|m| open_map(m, &arguments.place.options()))
        .transpose()?;
    if let Some(folder) = &arguments.draw {
        fs_err::create_dir_all(folder)?;
    }
    let options = Options {
        keep_matches: arguments.draw.is_some(),
        ..arguments.locate.options()
    };
    let mut localizer = Localizer::new(arguments.model.open()?, Pack::open(&arguments.pack)?)?
        .with_options(options);
    let prior = arguments.locate.prior();
    if arguments.locate.adapt == AdaptChoice::Flight {
        localizer = adapt_to_flight(localizer, &paths, &prior)?;
    }

    let format = arguments.format.unwrap_or_else(|| {
        let readable = arguments.out.is_none() && std::io::stdout().is_terminal();
        if readable {
            Format::Table
        } else {
            Format::Jsonl
        }
    });
    let (out, aside): (Box<dyn Write>, _) = match &arguments.out {
        Some(path) => {
            let aside = write_aside(path)?;
            (Box::new(aside.reopen()?), Some((aside, path)))
        }
        None => (Box::new(std::io::stdout()), None),
    };
    let mut writer = format.writer(Box::new(std::io::BufWriter::new(out)));
    let bar = progress::bar(paths.len() as u64, "locating", "photos");
    let mut exit = Exit::Done;
    let names = photos::picture_names(&paths);
    for (path, name) in paths.iter().zip(&names) {
        let answer = match locate_one(&localizer, path, &prior) {
            Ok((photo, outcome)) => {
                if let Some(folder) = &arguments.draw {
                    let target = folder.join(format!("{name}.jpg"));
                    draw(&photo, &outcome, map.as_deref(), &target)?;
                }
                let mut answer = Answer::of(&path.display().to_string(), &outcome);
                if arguments.check {
                    answer.check_m = check_m(&photo, &answer);
                }
                answer
            }
            Err(error) => Answer::no_fix(&path.display().to_string(), format!("{error:#}")),
        };
        if answer.reason.is_some() {
            exit = Exit::SomeWithoutFix;
        }
        bar.suspend(|| writer.write(&answer))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    writer.finish()?;
    drop(writer);
    if let Some((aside, path)) = aside {
        aside
            .persist(path)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(exit)
}

/// Opens a photo as small as any query allows and localises it.
///
/// # Errors
/// The photo cannot be read.
pub fn locate_one(localizer: &Localizer, path: &Path, prior: &Prior) -> Result<(Photo, Outcome)> {
    let (photo, outcome, _) = locate_one_traced(localizer, path, prior)?;
    Ok((photo, outcome))
}

/// The same, with what was tried on the way.
///
/// # Errors
/// The photo cannot be read.
pub fn locate_one_traced(
    localizer: &Localizer,
    path: &Path,
    prior: &Prior,
) -> Result<(Photo, Outcome, Trace)> {
    let photo = Photo::open(path)?;
    let (outcome, trace) = localizer.locate_traced(&photo, prior)?;
    Ok((photo, outcome, trace))
}

/// A localiser whose photo statistics come from all the given photos; unreadable ones are left out.
///
/// # Errors
/// None of them can be used.
pub fn adapt_to_flight(
    localizer: Localizer,
    paths: &[PathBuf],
    prior: &Prior,
) -> Result<Localizer> {
    let photos: Vec<Photo> = paths.iter().filter_map(|p| Photo::open(p).ok()).collect();
    Ok(localizer.adapted_to_flight(photos.iter().map(|photo| (photo, prior)))?)
}

/// A temporary file in the folder of `path`, to be renamed to it when complete.
fn write_aside(path: &Path) -> Result<tempfile::NamedTempFile> {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    tempfile::NamedTempFile::new_in(folder)
        .with_context(|| format!("cannot write into {}", folder.display()))
}

/// Distance in metres between the answer and the position in the photo's metadata.
fn check_m(photo: &Photo, answer: &Answer) -> Option<f64> {
    let gps = photo.metadata.position?;
    let (lat_deg, lon_deg) = answer.lat_deg.zip(answer.lon_deg)?;
    let recorded = LonLat {
        lon_deg: gps.lon_deg,
        lat_deg: gps.lat_deg,
    };
    Some(distance_m(recorded, LonLat { lon_deg, lat_deg }))
}

/// Draws one answer to `target`; false where nothing was matched.
///
/// # Errors
/// The picture cannot be drawn or written.
pub fn draw(
    photo: &Photo,
    outcome: &Outcome,
    map: Option<&dyn Raster>,
    target: &Path,
) -> Result<bool> {
    let matched = match outcome {
        Outcome::Fix(fix) => fix.drawn.as_deref(),
        Outcome::NoFix(no_fix) => no_fix.drawn.as_deref(),
    };
    let Some(matched) = matched else {
        return Ok(false);
    };
    draw_matches(photo, matched, map, &DrawOptions::default())?
        .save(target)
        .with_context(|| format!("cannot write {}", target.display()))?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_and_places_are_read_or_refused() {
        assert_eq!("exif".parse(), Ok(HeadingChoice::Exif));
        assert_eq!("-90".parse(), Ok(HeadingChoice::Degrees(270.0)));
        assert!("north".parse::<HeadingChoice>().is_err());
        assert!("NaN".parse::<HeadingChoice>().is_err());
        assert!("24.26,120.72,500".parse::<NearChoice>().is_ok());
        assert!(
            "120.72,24.26,500".parse::<NearChoice>().is_err(),
            "longitude first"
        );
        assert!("24.26,120.72".parse::<NearChoice>().is_err());
    }
}
