//! What is known of a view, and how to localise: the options that all localising commands share.

use std::fmt;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use grimnet_locate::{Adapt, DEFAULT_MAP_ERROR_M, Gates, HeadingPrior, Near, Options, Prior};
use grimnet_photo::ViewPrior;

use super::ModeChoice;
use crate::values;

/// Heading of the options that state what is known.
const PRIOR: &str = "What you know about the photos (overrides their metadata)";

/// Heading of the options that change the method.
const METHOD: &str = "Method";

/// Which batch-normalisation statistics the photos' features are computed with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum AdaptChoice {
    /// Those of the model
    #[default]
    None,
    /// Those of each photo by itself
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

/// What is known of the view, and how to localise.
#[derive(Debug, Clone, Args)]
pub struct LocateOptions {
    /// Direction of the photo's top edge: degrees clockwise from true north, `exif` (from the photo's metadata; searched if
    /// they do not tell it) or `unknown` (searched)
    #[arg(
        long,
        value_name = "DEG|exif|unknown",
        default_value = "exif",
        allow_hyphen_values = true,
        help_heading = PRIOR
    )]
    pub heading: HeadingPrior,

    /// Pitch of the camera, degrees: -90 looks straight down, -60 towards the photo's top by 30 degrees; needs the field of
    /// view, too; overrides metadata [default: from the photo, else straight down]
    #[arg(long, value_name = "DEG", value_parser = values::pitch_deg, allow_hyphen_values = true, help_heading = PRIOR)]
    pub pitch: Option<f64>,

    /// Height above ground, metres; overrides metadata [default: from the photo]
    #[arg(long, value_name = "M", value_parser = values::height_agl_m, allow_hyphen_values = true, help_heading = PRIOR)]
    pub height_agl: Option<f64>,

    /// Horizontal field of view, degrees; overrides metadata [default: from the photo]
    #[arg(long, value_name = "DEG", value_parser = values::fov_deg, allow_hyphen_values = true, help_heading = PRIOR)]
    pub hfov: Option<f64>,

    /// Ground resolution of the full-size photo, metres per pixel; overrides metadata
    #[arg(
        long,
        value_name = "M",
        value_parser = values::photo_gsd_m,
        allow_hyphen_values = true,
        conflicts_with_all = ["height_agl", "hfov"],
        help_heading = PRIOR
    )]
    pub gsd: Option<f64>,

    /// Search only within a radius around a position
    #[arg(
        long,
        value_name = "LAT,LON,RADIUS_M",
        allow_hyphen_values = true,
        help_heading = PRIOR
    )]
    pub near: Option<Near>,

    /// Which method to use
    #[arg(long, value_enum, default_value_t, help_heading = METHOD)]
    pub mode: ModeChoice,

    /// Recompute batch-normalisation statistics from the photos
    #[arg(long, value_enum, default_value_t, help_heading = METHOD)]
    pub adapt: AdaptChoice,

    /// Position error of the map itself, metres (1 sigma per axis); the stated radius includes it
    #[arg(
        long,
        value_name = "M",
        value_parser = values::sigma_m,
        allow_hyphen_values = true,
        default_value_t = DEFAULT_MAP_ERROR_M,
        help_heading = METHOD
    )]
    pub map_error: f64,

    /// Smallest confidence of a fix, 0 to 1; below it the answer is "no fix" [default: from the model's calibration]
    #[arg(
        long,
        value_name = "P",
        value_parser = values::probability,
        allow_hyphen_values = true,
        help_heading = METHOD
    )]
    pub min_confidence: Option<f64>,

    /// Stop the search after this many milliseconds per photo
    ///
    /// It ends between ground widths: the first one is searched in any case, which takes some tenths of a second where neither heading
    /// nor ground width is known.
    #[arg(
        long,
        value_name = "MS",
        value_parser = values::duration_ms,
        allow_hyphen_values = true,
        help_heading = METHOD
    )]
    pub budget_ms: Option<f64>,

    /// Number of map tiles found by descriptor for each heading and ground width [default: 5 in paper mode, 1000 in default mode]
    #[arg(long, value_name = "K", value_parser = values::count, help_heading = METHOD)]
    pub top_k: Option<usize>,
}

impl LocateOptions {
    /// What the user knows about the photos.
    pub fn prior(&self) -> Prior {
        Prior {
            view: ViewPrior {
                heading: self.heading,
                pitch_deg: self.pitch,
                roll_deg: None,
                height_agl_m: self.height_agl,
                hfov_deg: self.hfov,
                gsd_m: self.gsd,
            },
            near: self.near,
        }
    }

    /// How to localise.
    ///
    /// # Errors
    /// An option that the mode does not have.
    pub fn options(&self) -> Result<Options> {
        if self.mode == ModeChoice::Paper && self.budget_ms.is_some() {
            bail!(
                "--budget-ms has no meaning in paper mode, which matches all of the K tiles that it retrieved: leave one of them out, or lower --top-k"
            );
        }
        if self.mode == ModeChoice::Paper && self.min_confidence.is_some() {
            bail!(
                "--min-confidence has no meaning in paper mode, which always answers and states no confidence: leave one of them out"
            );
        }
        let named = match self.mode {
            ModeChoice::Default => Options::default(),
            ModeChoice::Paper => Options::paper(),
        };
        Ok(Options {
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
        })
    }

    /// Nothing known but the photos themselves; for commands that give each photo its own prior.
    pub fn plain(mode: ModeChoice, adapt: AdaptChoice) -> Self {
        Self {
            heading: HeadingPrior::FromMetadata,
            pitch: None,
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
}
