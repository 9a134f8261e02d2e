//! Measures the localiser on a folder of photos with known places.
//!
//! ```text
//! cargo run --release -p grimnet-locate --example evaluate -- MODEL MAP FOLDER [--pack FILE] [--width-m 157] [--wrong FOLDER]...
//!     [--mode paper] [--limit N] [--set JSON] [--jsonl FILE]
//! ```
//! MODEL is a file or `bundled`. FOLDER holds `photos/` and `truth.csv` with the columns photo, flight_yaw_deg, centre_lat,
//! centre_lon and, where it differs between photos, width_m. Without a width the metadata's is taken. Photos of `--wrong` show
//! places that are not on the map. `--set` overrides options, as in `{"top_k": 100}`.

use std::{collections::BTreeMap, error::Error, io::Write, path::Path, path::PathBuf};

use grimnet_geo::{LonLat, MapOptions, distance_m, open_map};
use grimnet_locate::{Localizer, Options, Outcome, Prior, TimeMs};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Pack, build};
use grimnet_photo::Photo;

type Failure = Box<dyn Error>;

/// Queries need no more.
const LONG_SIDE_PX: u32 = 2048;

struct Arguments {
    positional: Vec<String>,
    named: BTreeMap<String, Vec<String>>,
}

impl Arguments {
    fn read() -> Result<Self, Failure> {
        let (mut positional, mut named) = (Vec::new(), BTreeMap::<String, Vec<String>>::new());
        let mut all = std::env::args().skip(1);
        while let Some(argument) = all.next() {
            match argument.strip_prefix("--") {
                Some(name) => {
                    let value = all.next().ok_or(format!("--{name} wants a value"))?;
                    named.entry(name.to_string()).or_default().push(value);
                }
                None => positional.push(argument),
            }
        }
        Ok(Self { positional, named })
    }

    fn last(&self, name: &str) -> Option<&str> {
        self.named.get(name)?.last().map(String::as_str)
    }
}

struct Frame {
    path: PathBuf,
    heading_deg: f64,
    width_m: Option<f64>,
    truth: LonLat,
}

fn frames(folder: &Path, limit: usize) -> Result<Vec<Frame>, Failure> {
    let text = std::fs::read_to_string(folder.join("truth.csv"))?;
    let mut lines = text.lines();
    let columns: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let frame = |line: &str| -> Result<Frame, Failure> {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |name: &str| {
            columns
                .iter()
                .position(|column| *column == name)
                .and_then(|at| cells.get(at).copied())
        };
        let number = |name: &str| -> Result<f64, Failure> {
            Ok(cell(name)
                .ok_or(format!("truth.csv has no {name}"))?
                .parse()?)
        };
        Ok(Frame {
            path: folder
                .join("photos")
                .join(cell("photo").ok_or("truth.csv has no photo")?),
            heading_deg: number("flight_yaw_deg")?,
            width_m: cell("width_m").map(str::parse).transpose()?,
            truth: LonLat::new(number("centre_lon")?, number("centre_lat")?),
        })
    };
    lines.take(limit).map(frame).collect()
}

/// Middle of a list; NaN for none.
fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
}

fn prior_of(photo: &Photo, width_m: Option<f64>) -> Prior {
    match width_m {
        Some(width_m) => Prior::none().with_gsd_m(width_m / f64::from(photo.full_size_px.0)),
        None => Prior::none(),
    }
}

#[allow(clippy::print_stdout)]
fn report(
    name: &str,
    errors_m: &[f64],
    inliers: &[(f64, usize, usize)],
    covered: usize,
    times: &[TimeMs],
) {
    let share = |limit: f64| {
        errors_m.iter().filter(|&&error| error < limit).count() as f64
            / errors_m.len().max(1) as f64
    };
    let fixes: Vec<f64> = errors_m
        .iter()
        .copied()
        .filter(|error| error.is_finite())
        .collect();
    let wrong = fixes.iter().filter(|&&error| error >= 20.0).count();
    println!(
        "{name}: {} frames, {} fixes, within 5/10/20 m {:.2} {:.2} {:.2}, median of fixes {:.2} m, wrong {wrong}, covered {covered}",
        errors_m.len(),
        fixes.len(),
        share(5.0),
        share(10.0),
        share(20.0),
        median(fixes.clone()),
    );
    let mut right: Vec<usize> = inliers
        .iter()
        .filter(|(error, ..)| *error < 20.0)
        .map(|&(_, inliers, _)| inliers)
        .collect();
    right.sort_unstable();
    let other: Vec<String> = inliers
        .iter()
        .filter(|(error, ..)| *error >= 20.0)
        .map(|(_, inliers, matches)| format!("{inliers}/{matches}"))
        .collect();
    println!(
        "  inliers of right fixes {right:?}; of others {}",
        other.join(" ")
    );
    let time = |of: fn(&TimeMs) -> f64| median(times.iter().map(of).collect());
    println!(
        "  median ms: query {:.1} features {:.1} search {:.1} vote {:.1} matching {:.1} total {:.1}",
        time(|t| t.query),
        time(|t| t.features),
        time(|t| t.search),
        time(|t| t.vote),
        time(|t| t.matching),
        time(|t| t.total)
    );
}

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Failure> {
    let arguments = Arguments::read()?;
    let [model, map, folder] = &arguments.positional[..] else {
        return Err(
            "usage: evaluate MODEL MAP FOLDER [--pack FILE] [--width-m M] [--wrong FOLDER]..."
                .into(),
        );
    };
    let folder = Path::new(folder);
    let model = if model == "bundled" {
        Model::bundled()?
    } else {
        Model::open(model)?
    };
    let paper = arguments.last("mode") == Some("paper");
    let width_m: Option<f64> = arguments.last("width-m").map(str::parse).transpose()?;
    let limit = arguments.last("limit").map_or(Ok(usize::MAX), str::parse)?;
    let pack_path = arguments
        .last("pack")
        .map_or_else(|| std::env::temp_dir().join("evaluate.grim"), PathBuf::from);
    let raster = open_map(map.as_ref(), &MapOptions::default())?;
    let build_options = if paper {
        BuildOptions::paper()
    } else {
        BuildOptions::standard()
    };
    let report_of_build = build(
        raster.as_ref(),
        &model,
        &build_options,
        &pack_path,
        &mut |_| (),
    )?;
    println!("{report_of_build:?}");

    let mut options = serde_json::to_value(if paper {
        Options::paper()
    } else {
        Options::default()
    })?;
    if let Some(overrides) = arguments.last("set") {
        let overrides: serde_json::Map<String, serde_json::Value> =
            serde_json::from_str(overrides)?;
        for (name, value) in overrides {
            match (options.get_mut(&name), value) {
                (Some(serde_json::Value::Object(inner)), serde_json::Value::Object(more)) => {
                    inner.extend(more)
                }
                (Some(slot), value) => *slot = value,
                (None, _) => return Err(format!("no option {name}").into()),
            }
        }
    }
    let options: Options = serde_json::from_value(options)?;
    let localizer = Localizer::new(model, Pack::open(&pack_path)?)?.with_options(options);
    let mut jsonl = arguments
        .last("jsonl")
        .map(std::fs::File::create)
        .transpose()?;
    let frames = frames(folder, limit)?;
    for known in [true, false] {
        let (mut errors_m, mut inliers, mut times, mut covered) =
            (Vec::new(), Vec::new(), Vec::new(), 0);
        for frame in &frames {
            let photo = Photo::open_reduced(&frame.path, LONG_SIDE_PX)?;
            let prior = prior_of(&photo, frame.width_m.or(width_m));
            let prior = if known {
                prior.with_heading(frame.heading_deg, 3.0)
            } else {
                prior.with_unknown_heading()
            };
            let outcome = localizer.locate(&photo, &prior)?;
            times.push(*outcome.time_ms());
            let error_m = outcome.fix().map_or(f64::INFINITY, |fix| {
                distance_m(frame.truth, LonLat::new(fix.lon_deg, fix.lat_deg))
            });
            errors_m.push(error_m);
            match &outcome {
                Outcome::Fix(fix) => {
                    inliers.push((error_m, fix.inliers, fix.matches));
                    covered += usize::from(error_m <= fix.radius95_m);
                }
                Outcome::NoFix(no_fix) => inliers.push((error_m, no_fix.inliers, no_fix.matches)),
            }
            if let Some(file) = &mut jsonl {
                let line = serde_json::json!({"photo": frame.path, "known": known, "error_m": error_m, "outcome": outcome});
                writeln!(file, "{line}")?;
            }
        }
        report(
            if known {
                "heading known"
            } else {
                "heading unknown"
            },
            &errors_m,
            &inliers,
            covered,
            &times,
        );
    }
    for wrong in arguments.named.get("wrong").into_iter().flatten() {
        let mut paths: Vec<PathBuf> = std::fs::read_dir(wrong)?
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<Result<_, _>>()?;
        paths.retain(|path| {
            path.extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case("jpg"))
        });
        paths.sort();
        let (mut found, mut best) = (0, Vec::new());
        for path in paths.iter().take(limit) {
            let photo = Photo::open_reduced(path, LONG_SIDE_PX)?;
            for prior in [
                prior_of(&photo, width_m),
                prior_of(&photo, width_m).with_unknown_heading(),
            ] {
                match localizer.locate(&photo, &prior)? {
                    Outcome::Fix(fix) => {
                        found += 1;
                        best.push(fix.inliers);
                    }
                    Outcome::NoFix(no_fix) => best.push(no_fix.inliers),
                }
            }
        }
        best.sort_unstable();
        println!(
            "wrong area {wrong}: {} photos, heading as in the photo and unknown: {found} fixes, best inliers {best:?}",
            paths.len()
        );
    }
    Ok(())
}
