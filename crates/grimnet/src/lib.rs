//! Finds where on a map a drone photo was taken, without GNSS.
//!
//! A map is built once into a pack ([`map::build`], or the program `grim map build`). Each photo is then localised on it: the answer
//! is a position with a 95 % radius, or a reason why there is none.
//!
//! # Example
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use grimnet::Outcome;
//!
//! let localizer = grimnet::Localizer::open("area.grim")?;         // the bundled model; a builder for anything else
//! let photo = grimnet::Photo::open("DJI_0042.jpg")?;              // read at the size that a query needs
//! match localizer.locate(&photo, &grimnet::Prior::none())? {
//!     Outcome::Fix(fix) => println!("{:.7} {:.7} ±{:.1} m", fix.lat_deg, fix.lon_deg, fix.radius95_m),
//!     Outcome::NoFix(reason) => eprintln!("{reason}"),
//! }
//! # Ok(())
//! # }
//! ```
//!
//! [`Localizer::builder`] takes another model or other settings. A [`Prior`] says what is known besides the photo: its heading, height
//! or ground resolution, or the area where it was taken. [`Localizer::needed_pixels`] says at what size photos serve on this map; JPEG
//! files that [`NeededPixels::open`] reads are decoded at half, a quarter or an eighth of their size where that suffices.
//!
//! A camera's frame needs no file: [`Photo::from_image`] takes its pixels. [`frames`] measures how a camera moved from one frame to the
//! next, and [`settings`] has the types of the fields of [`Options`].
//!
//! # Debug builds
//! Without optimisation a search takes many times as long. The manifest of a program that is also run without `--release` should have
//! its dependencies optimised:
//! ```toml
//! [profile.dev.package."*"]
//! opt-level = 2
//! ```
//!
//! # Errors
//! [`Localizer`] returns [`LocateError`], [`Photo`] returns [`PhotoError`], [`map::build`] returns [`map::BuildError`]. A photo whose
//! position is not found is no error but [`Outcome::NoFix`] with a [`Reason`].
//!
//! # Warnings
//! What is no error but may make positions wrong, such as a map whose shift to WGS 84 is coarse, is an event of the crate `tracing`, of the
//! level `WARN`: a program that sets no subscriber does not see it.
//!
//! # Threads
//! A [`Localizer`] may be shared by threads. One search, and one [`map::build`], is computed on the rayon pool of the thread that calls it:
//! the global pool, with all cores, unless it is called within `rayon::ThreadPool::install`. A build reads its map on a thread of its own,
//! which uses the global pool. `RAYON_NUM_THREADS` sets the size of the global pool.
//!
//! # Frames and units
//! Positions are WGS 84 degrees of the ground at the photo's centre; headings are degrees clockwise from true north; covariances are
//! metres east and north.

pub mod frames;
pub mod map;
pub mod settings;

pub use grimnet_geo::{LonLat, MapPx, WindowPx};
pub use grimnet_locate::{
    EvidenceUsed, Fix, Gates, HeadingPrior, Localizer, LocalizerBuilder, LocateError, MatchedPair,
    MatchedPoints, MatchingError, Near, NeededPixels, NoFix, Options, Outcome, Prior, Reason,
    Rejection, RunnerUp, Support, TileRef, TimeMs, ViewPrior,
};
pub use grimnet_net::{Model, NetError, Precision};
pub use grimnet_pack::{Level, LevelInfo, Pack, PackError, PackInfo, PackLimits, VerifyProgress};
pub use grimnet_photo::{
    CameraAttitude, Damage, Evidence, ExposureTime, Footprint, GpsPosition, Heading,
    ImageDirection, Metadata, Photo, PhotoError, PhotoLimits, PhotoPx, Query, QueryMaker,
    QueryOptions, Tilt, View,
};
/// The pictures of [`Photo::from_image`] are of this version of the crate.
pub use image;
