//! Wrong-area trials: photos that are not on the map are localised, and every fix is an error.
//!
//! Pictures come from [`Source`]s. A photo with a ground width in its metadata is tried at that width and at drawn ones; a picture
//! without is tried at drawn ones only. Widths are drawn log-uniformly as a share of the map's width, and every second trial has
//! an unknown heading. Trials with nothing given have neither a width nor a heading, whatever the metadata say. A picture that is
//! tried again is cropped at random, so that no trial repeats another. All draws depend on the seed, the source and the number of
//! the trial alone.

use std::convert::Infallible;
use std::path::{Path, PathBuf};

use grimnet_locate::{Outcome, Prior, Support};
use grimnet_photo::{Metadata, Photo, PhotoLimits, QUERY_LONG_SIDE_PX};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::evaluation::Method;
use crate::scene::TRUE_HEADING_SIGMA_DEG;

/// Widths of the footprints that are drawn, as shares of the map's width.
pub const WIDTH_SHARES: [f64; 2] = [0.1, 2.0];

/// A picture that is tried again keeps at least this share of its sides.
const MIN_CROP: f64 = 0.6;

/// Pictures of one origin, none of them on the map.
#[derive(Debug, Clone)]
pub struct Source {
    /// Name, such as the folder's: no other source has it.
    pub name: String,
    /// The folder that the pictures lie in or below.
    pub folder: PathBuf,
    /// The pictures.
    pub pictures: Vec<PathBuf>,
    /// Whether the model was trained on them.
    pub trained_on: bool,
}

/// How many trials, and which.
#[derive(Debug, Clone, Copy)]
pub struct ElsewhereOptions {
    /// Trials per source.
    pub trials: usize,
    /// Seed of all draws.
    pub seed: u64,
    /// Width of the map, metres.
    pub map_width_m: f64,
    /// The localiser is given neither a ground width nor a heading.
    pub nothing_given: bool,
    /// Limits within which pictures are read.
    pub photo_limits: PhotoLimits,
}

/// How the ground width of a trial was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// From the photo's metadata.
    Metadata,
    /// Drawn at random.
    Drawn,
    /// None was given.
    NotGiven,
}

/// One trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ElsewhereTrial {
    /// Name of the source.
    pub source: String,
    /// Whether the model was trained on the source.
    pub trained_on: bool,
    /// Path of the picture from the folder of its source.
    pub picture: String,
    /// How the ground width was chosen.
    pub scale: Scale,
    /// Ground width that the localiser was given, metres.
    pub footprint_width_m: Option<f64>,
    /// The same as a share of the map's width.
    pub map_share: Option<f64>,
    /// Whether the localiser was given a (random) heading.
    pub heading_known: bool,
    /// Whether it gave a fix, which is wrong.
    pub fixed: bool,
    /// Stated confidence of the fix.
    pub confidence: Option<f64>,
    /// Inliers of the answer or of the refused candidate.
    pub inliers: Option<usize>,
    /// Why there is no fix.
    pub reason: Option<String>,
    /// Support of the fix.
    #[serde(skip)]
    pub support: Option<Support>,
}

/// Runs the trials of all sources; `on_trial` is called after each. Each picture is decoded once. Pictures that cannot be read are
/// logged as warnings and left out.
pub fn run(
    method: &dyn Method,
    sources: &[Source],
    options: &ElsewhereOptions,
    on_trial: &mut dyn FnMut(&ElsewhereTrial),
) -> Vec<ElsewhereTrial> {
    let mut trials = Vec::new();
    let Ok(()) = try_each::<Infallible>(sources, options, &mut |make| {
        let trial = make(method);
        on_trial(&trial);
        trials.push(trial);
        Ok(())
    });
    trials
}

/// Makes one trial with a method.
pub type MakeTrial<'a> = dyn Fn(&dyn Method) -> ElsewhereTrial + 'a;

/// As [`run`], for a caller that does not need all trials: `each` is called with what makes the next one.
///
/// # Errors
/// The first error of `each`, which ends the trials.
pub fn try_each<E>(
    sources: &[Source],
    options: &ElsewhereOptions,
    each: &mut dyn FnMut(&MakeTrial<'_>) -> Result<(), E>,
) -> Result<(), E> {
    for (index, source) in (0u64..).zip(sources) {
        let mut order = source.pictures.clone();
        order.shuffle(&mut rng(options.seed, index, u64::MAX));
        for (number, path) in order.iter().enumerate().take(options.trials) {
            let photo =
                match Photo::open_with(path, Some(QUERY_LONG_SIDE_PX), &options.photo_limits) {
                    Ok(photo) if options.nothing_given => Photo {
                        metadata: Metadata::default(),
                        ..photo
                    },
                    Ok(photo) => photo,
                    Err(error) => {
                        tracing::warn!("{error}; left out");
                        continue;
                    }
                };
            for trial in (number..options.trials).step_by(order.len()) {
                // Rounds of four: both scales with both headings.
                let round = trial / order.len() + number;
                let is_again = trial >= order.len();
                each(&|method| {
                    let mut rng = rng(options.seed, index, trial as u64);
                    one(method, source, &photo, options, round, is_again, &mut rng)
                })?;
            }
        }
    }
    Ok(())
}

/// A generator that depends on the seed, the source and the trial alone.
fn rng(seed: u64, source: u64, trial: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ (source << 32));
    rng.set_stream(trial);
    rng
}

fn one(
    method: &dyn Method,
    source: &Source,
    photo: &Photo,
    options: &ElsewhereOptions,
    round: usize,
    is_again: bool,
    rng: &mut ChaCha8Rng,
) -> ElsewhereTrial {
    let heading_known = !options.nothing_given && round.is_multiple_of(2);
    let [low, high] = WIDTH_SHARES.map(f64::ln);
    let drawn_m = options.map_width_m * rng.random_range(low..high).exp();
    let heading_deg = rng.random_range(0.0..360.0);
    let crop = is_again.then(|| cropped(photo, rng));
    let tried = crop.as_ref().unwrap_or(photo);
    let stated_m = photo
        .view(&Prior::none().view)
        .footprint
        .map(|whole| {
            let share = f64::from(tried.full_size_px.0) / f64::from(photo.full_size_px.0);
            whole.width_m * share
        })
        .filter(|_| (round / 2).is_multiple_of(2));
    let (scale, footprint_width_m) = match stated_m {
        _ if options.nothing_given => (Scale::NotGiven, None),
        Some(width_m) => (Scale::Metadata, Some(width_m)),
        None => (Scale::Drawn, Some(drawn_m)),
    };
    let prior = match footprint_width_m {
        Some(width_m) => Prior::none().with_gsd_m(width_m / f64::from(tried.full_size_px.0)),
        None => Prior::none(),
    };
    let prior = if heading_known {
        prior.with_heading(heading_deg, TRUE_HEADING_SIGMA_DEG)
    } else {
        prior.with_unknown_heading()
    };
    let found = method.locate(tried, &prior);
    let answer = found.as_ref().ok();
    ElsewhereTrial {
        source: source.name.clone(),
        trained_on: source.trained_on,
        picture: picture_name(source, &photo.path),
        scale,
        footprint_width_m,
        map_share: footprint_width_m.map(|width_m| width_m / options.map_width_m),
        heading_known,
        fixed: answer.is_some_and(|found| found.fix.is_some()),
        confidence: answer.and_then(|found| found.confidence),
        inliers: answer.and_then(|found| found.inliers),
        reason: match &found {
            Ok(found) => found.reason.clone(),
            Err(error) => Some(error.to_string()),
        },
        support: answer
            .and_then(|found| found.outcome.as_ref().and_then(Outcome::fix))
            .map(|fix| fix.support),
    }
}

/// The path of a picture from the folder of its source: folders of a camera have files of the same names.
fn picture_name(source: &Source, path: &Path) -> String {
    let inside = path.strip_prefix(&source.folder).unwrap_or(path);
    inside.to_string_lossy().into_owned()
}

/// A random part of a photo, of the same proportions.
fn cropped(photo: &Photo, rng: &mut ChaCha8Rng) -> Photo {
    let share = rng.random_range(MIN_CROP..1.0);
    let kept_px = |side_px: u32| ((f64::from(side_px) * share).round() as u32).max(1);
    let (width_px, height_px) = photo.image.dimensions();
    let (kept_width_px, kept_height_px) = (kept_px(width_px), kept_px(height_px));
    let left_px = rng.random_range(0..=width_px - kept_width_px);
    let top_px = rng.random_range(0..=height_px - kept_height_px);
    let part =
        image::imageops::crop_imm(&photo.image, left_px, top_px, kept_width_px, kept_height_px);
    Photo {
        path: photo.path.clone(),
        image: part.to_image(),
        full_size_px: (kept_px(photo.full_size_px.0), kept_px(photo.full_size_px.1)),
        metadata: photo.metadata.clone(),
        damage: photo.damage,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use grimnet_geo::LonLat;
    use grimnet_locate::HeadingPrior;
    use grimnet_world::{PhotoTags, write_jpeg_with_exif};
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::elsewhere_summary::{ElsewhereSummary, Group};
    use crate::evaluation::{Found, MethodError};
    use crate::metrics::ScoredFix;
    use crate::metrics::statistics::wilson_interval;

    /// Gives a fix where the heading is known and the footprint small.
    struct Gullible;

    impl Method for Gullible {
        fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
            let width_m = match prior.view.gsd_m {
                Some(gsd_m) => gsd_m * f64::from(photo.full_size_px.0),
                None => f64::INFINITY,
            };
            let known = matches!(prior.view.heading, HeadingPrior::Known { .. });
            let fix = ScoredFix {
                position: LonLat {
                    lon_deg: 0.0,
                    lat_deg: 0.0,
                },
                covariance_en_m2: [1.0, 0.0, 1.0],
                radius95_m: 2.0,
            };
            let fixed = known && width_m < 500.0;
            Ok(Found {
                fix: fixed.then_some(fix),
                reason: (!fixed).then(|| format!("too few matches: {width_m}")),
                ..Found::default()
            })
        }
    }

    /// The sizes of the pictures that a method is given.
    fn method_sizes(sources: &[Source], options: &ElsewhereOptions) -> Vec<(u32, u32)> {
        struct Sizes(std::sync::Mutex<Vec<(u32, u32)>>);
        impl Method for Sizes {
            fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
                self.0.lock().unwrap().push(photo.image.dimensions());
                Gullible.locate(photo, prior)
            }
        }
        let sizes = Sizes(std::sync::Mutex::default());
        run(&sizes, sources, options, &mut |_| ());
        sizes.0.into_inner().unwrap()
    }

    fn source(folder: &Path, name: &str, count: usize, trained_on: bool) -> Source {
        let pictures = (0..count)
            .map(|i| {
                let path = folder.join(format!("{name}{i}.png"));
                let tone = Rgb([40 * i as u8, 90, 120]);
                RgbImage::from_pixel(96, 80, tone).save(&path).unwrap();
                path
            })
            .collect();
        Source {
            name: name.to_owned(),
            folder: folder.to_owned(),
            pictures,
            trained_on,
        }
    }

    /// On a map of one kilometre, with a ground width and a heading given to some trials.
    fn options(trials: usize, seed: u64) -> ElsewhereOptions {
        ElsewhereOptions {
            trials,
            seed,
            map_width_m: 1000.0,
            nothing_given: false,
            photo_limits: PhotoLimits::DEFAULT,
        }
    }

    #[test]
    fn trials_are_drawn_as_stated_and_counted_by_group() {
        let folder = tempfile::tempdir().unwrap();
        let sources = [
            source(folder.path(), "farms", 3, true),
            source(folder.path(), "coast", 50, false),
        ];
        let options = options(40, 7);
        let mut seen = 0;
        let trials = run(&Gullible, &sources, &options, &mut |_| seen += 1);
        assert_eq!((trials.len(), seen), (80, 80));
        let known = trials.iter().filter(|t| t.heading_known).count();
        assert!((36..=44).contains(&known), "{known}");
        let shares: Vec<f64> = trials.iter().filter_map(|t| t.map_share).collect();
        assert_eq!(shares.len(), trials.len());
        assert!(shares.iter().all(|share| (0.1..2.0).contains(share)));
        let below = shares.iter().filter(|&&share| share < 0.447).count();
        assert!(
            (28..=52).contains(&below),
            "half lies below the geometric mean: {below}"
        );
        assert!(
            trials.iter().all(|t| t.scale == Scale::Drawn),
            "no metadata"
        );
        assert_eq!(run(&Gullible, &sources, &options, &mut |_| ()), trials);

        // 3 pictures are tried whole once; their 37 other trials are crops.
        let sizes = method_sizes(&sources[..1], &options);
        let whole = sizes.iter().filter(|&&size| size == (96, 80)).count();
        assert!((3..6).contains(&whole), "{whole}");
        assert!(
            sizes
                .iter()
                .all(|&(w, h)| (57..=96).contains(&w) && (48..=80).contains(&h))
        );
        let different: HashSet<_> = sizes.iter().collect();
        assert!(different.len() > 15, "{different:?}");

        let summary = ElsewhereSummary::of(&trials);
        let expected = trials
            .iter()
            .filter(|t| t.heading_known && t.footprint_width_m < Some(500.0))
            .count();
        assert!(expected > 0);
        assert_eq!((summary.all.trials, summary.all.fixes), (80, expected));
        assert_eq!(summary.all.pictures, 3 + 40);
        let share = expected as f64 / 80.0;
        assert_eq!(summary.all.share_interval, wilson_interval(share, 43));
        let sums = |groups: &[Group]| {
            let trials: usize = groups.iter().map(|g| g.trials).sum();
            (trials, groups.iter().map(|g| g.fixes).sum::<usize>())
        };
        for groups in [
            &summary.by_training,
            &summary.by_setting,
            &summary.by_source,
        ] {
            assert_eq!(sums(groups), (80, expected));
        }
        for group in &summary.by_setting {
            let large = group.name.contains("larger") || group.name.contains("unknown");
            assert!(!large || group.fixes == 0, "{group:?}");
        }
        assert_eq!(
            summary.reasons,
            [("too few matches: ...".to_owned(), 80 - expected)]
        );
        let names: Vec<&str> = summary
            .by_training
            .iter()
            .map(|g| g.name.as_str())
            .collect();
        assert_eq!(names, ["sources not trained on", "sources trained on"]);
    }

    /// Says in its reason whether anything is known of the view.
    struct Telling;

    impl Method for Telling {
        fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
            let view = photo.view(&prior.view);
            let is_known = view.footprint.is_some() || view.heading.is_some();
            Ok(Found {
                reason: Some(if is_known { "known" } else { "nothing known" }.to_owned()),
                ..Found::default()
            })
        }
    }

    #[test]
    fn with_nothing_given_metadata_are_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let mut coast = source(folder.path(), "coast", 2, false);
        for path in &mut coast.pictures {
            path.set_extension("jpg");
            let picture = RgbImage::from_pixel(96, 80, Rgb([40, 90, 120]));
            write_jpeg_with_exif(path, &picture, 90, &tags()).unwrap();
        }
        let mut options = options(6, 1);
        let given = run(&Telling, &[coast.clone()], &options, &mut |_| ());
        assert!(given.iter().any(|t| t.scale == Scale::Metadata));
        assert!(given.iter().all(|t| t.reason.as_deref() == Some("known")));

        options.nothing_given = true;
        let trials = run(&Telling, &[coast], &options, &mut |_| ());
        assert_eq!(trials.len(), 6);
        for trial in &trials {
            assert_eq!(trial.reason.as_deref(), Some("nothing known"));
            assert_eq!((trial.scale, trial.map_share), (Scale::NotGiven, None));
        }
        let settings = ElsewhereSummary::of(&trials).by_setting;
        assert_eq!(settings.len(), 1);
        assert_eq!(settings[0].name, "scale not given, heading unknown");
    }

    #[test]
    fn pictures_of_one_name_in_several_folders_are_several() {
        let folder = tempfile::tempdir().unwrap();
        let mut flights = source(folder.path(), "DJI_", 1, false);
        for flight in ["a", "b"] {
            let path = folder.path().join(flight).join("DJI_0.png");
            fs_err::create_dir_all(path.parent().unwrap()).unwrap();
            fs_err::copy(&flights.pictures[0], &path).unwrap();
            flights.pictures.push(path);
        }
        let trials = run(&Gullible, &[flights], &options(9, 1), &mut |_| ());
        let names: HashSet<&str> = trials.iter().map(|t| t.picture.as_str()).collect();
        let in_a = Path::new("a").join("DJI_0.png");
        assert!(names.contains("DJI_0.png") && names.contains(in_a.to_str().unwrap()));
        assert_eq!(ElsewhereSummary::of(&trials).all.pictures, 3);
    }

    fn tags() -> PhotoTags {
        PhotoTags {
            lat_deg: 24.2,
            lon_deg: 120.7,
            gps_altitude_m: 150.0,
            relative_altitude_m: 120.0,
            gimbal_yaw_deg: 30.0,
            gimbal_pitch_deg: -90.0,
            gimbal_roll_deg: 0.0,
            flight_yaw_deg: 30.0,
            focal_length_mm: 4.5,
            focal_35mm: 24.0,
            calibrated_focal_px: 64.0,
            make: "DJI".to_owned(),
            model: "FC6310".to_owned(),
            taken: "2024:05:01 10:00:00".to_owned(),
        }
    }

    #[test]
    fn unreadable_pictures_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let mut one = source(folder.path(), "farms", 2, false);
        fs_err::write(&one.pictures[0], "no picture").unwrap();
        one.pictures.push(folder.path().join("gone.png"));
        let options = options(9, 1);
        assert_eq!(run(&Gullible, &[one], &options, &mut |_| ()).len(), 3);
        let none = ElsewhereSummary::of(&[]);
        assert_eq!((none.all.trials, none.all.share_interval), (0, [0.0, 1.0]));
    }
}
