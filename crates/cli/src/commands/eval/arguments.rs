//! Arguments of `grim eval`.

use std::path::PathBuf;

use clap::Args;
use grimnet_eval::scene::HeadingMode;
use grimnet_locate::DEFAULT_MAP_ERROR_M;
use grimnet_program::heading_modes::{BOTH, heading_modes};

use crate::commands::elsewhere::{ELSEWHERE_FOLDERS, ElsewhereOptions};
use crate::commands::eval_track_options::TrackEvalOptions;
use crate::commands::locate::AdaptChoice;
use crate::commands::map_place::MapPlace;
use crate::commands::retrieval_options::RetrievalOptions;
use crate::commands::{LimitsChoice, ModeChoice, ModelChoice};
use crate::outputs::OverwriteChoice;
use crate::values;

/// Arguments of `grim eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// A folder with map.tif, photos/ and truth.csv, or a scene of UAV-VisLoc or AnyVisLoc, or photos with a position in their
    /// EXIF, such as MSDI's (with --map)
    ///
    /// truth.csv has the columns photo, lat_deg, lon_deg (of the image centre; or centre_lat, centre_lon), and, if known,
    /// heading_deg, gps_lat, gps_lon, footprint_w_m (ground width of the photo, metres; given to the localiser instead of the
    /// metadata), tilt_deg, truth_err_m (1 sigma per axis), flat_frac (share without features; above 0.5 no answer is expected)
    /// and place (photos of one place are not independent). For UAV-VisLoc give the folder of one scene, such as
    /// UAV-VisLoc/03, for AnyVisLoc likewise, such as AnyVisLoc/Scene_01; --map satellite_map.png selects its satellite map.
    /// For MSDI give the whole data set or one scene of its calibrated_images.
    pub(super) folder: Option<PathBuf>,

    /// Render the procedural world of this seed and a flight over it, and localise that
    #[arg(long, value_name = "SEED", conflicts_with_all = ["folder", ELSEWHERE_FOLDERS])]
    pub(super) world: Option<u64>,

    /// Folder for report.html, summary.json, frames.csv, failed.jsonl, recall.json, matches, pack
    #[arg(short, long, value_name = "DIR", value_parser = values::output_folder())]
    pub(super) out: PathBuf,

    #[command(flatten)]
    pub(super) overwrite: OverwriteChoice,

    /// The map [default: FOLDER/map.tif]
    #[arg(long, value_name = "MAP")]
    pub(super) map: Option<PathBuf>,

    #[command(flatten)]
    pub(super) place: MapPlace,

    #[command(flatten)]
    pub(super) model: ModelChoice,

    /// Whether the localiser is given the true headings
    #[arg(
        long,
        value_parser = heading_modes(),
        default_value = BOTH,
        conflicts_with_all = [ELSEWHERE_FOLDERS, "track"]
    )]
    pub(super) heading: &'static [HeadingMode],

    /// Commit that this program was built from, recorded with the figures
    #[arg(long, value_name = "HASH", conflicts_with = ELSEWHERE_FOLDERS)]
    pub(super) commit: Option<String>,

    /// Ground width that every photo shows, metres, given to the localiser instead of truth file and metadata
    #[arg(
        long,
        value_name = "M",
        value_parser = values::length_m,
        allow_hyphen_values = true,
        conflicts_with = ELSEWHERE_FOLDERS
    )]
    pub(super) footprint_width: Option<f64>,

    /// Method
    #[arg(long, value_enum, default_value_t)]
    pub(super) mode: ModeChoice,

    /// Position error of the map itself, metres (1 sigma per axis); the stated radius includes it
    #[arg(
        long,
        value_name = "M",
        value_parser = values::sigma_m,
        allow_hyphen_values = true,
        default_value_t = DEFAULT_MAP_ERROR_M
    )]
    pub(super) map_error: f64,

    /// Error of the true positions, metres (1 sigma per axis), for photos whose truth file does not state it
    #[arg(
        long,
        value_name = "M",
        value_parser = values::sigma_m,
        allow_hyphen_values = true,
        conflicts_with_all = [ELSEWHERE_FOLDERS, "track"]
    )]
    pub(super) truth_error: Option<f64>,

    /// Recompute batch-normalisation statistics
    #[arg(long, value_enum, default_value_t)]
    pub(super) adapt: AdaptChoice,

    /// Least confidence of a fix, 0 to 1; 0 turns the confidence gate off [default: from the model's calibration]
    #[arg(long, value_name = "P", value_parser = values::probability, allow_hyphen_values = true)]
    pub(super) min_confidence: Option<f64>,

    #[command(flatten)]
    pub(super) track: TrackEvalOptions,

    #[command(flatten)]
    pub(super) elsewhere: ElsewhereOptions,

    #[command(flatten)]
    pub(super) retrieval: RetrievalOptions,

    #[command(flatten)]
    pub(super) limits: LimitsChoice,
}
