//! `grim demo`: a made-up town, a flight over it, every photo located. Nothing to download.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Args;
use grimnet_eval::report::{Picture, Report, Run};
use grimnet_eval::truth::{self, TruthFrame};
use grimnet_geo::{MapOptions, Raster, open_map};
use grimnet_locate::{Localizer, Options, Prior};
use grimnet_pack::{BuildOptions, Pack};
use grimnet_world::{
    Camera, Flight, Look, PhotoTags, Placement, RegionM, Season, TruthRow, World, WorldConfig,
    write_geotiff, write_jpeg_with_exif, write_truth_csv,
};
use image::RgbImage;

use super::ModelChoice;
use super::eval::{HeadingMode, locate_all, score};
use super::locate::{draw, locate_one};
use super::map::build_with_bar;
use super::results::{print_summary, write_summary};
use crate::answer::Answer;
use crate::exit::Exit;
use crate::output::Format;
use crate::progress;

/// Ground resolution of the map, metres per pixel: that of a good aerial orthophoto.
const MAP_GSD_M: f64 = 0.3;

/// The camera: near that of a small consumer drone, at a resolution that keeps the demo short.
const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 1200,
    height_px: 900,
};

/// Where the made-up town is put: in the Gulf of Guinea, where there is none.
const PLACE_LON_LAT_DEG: [f64; 2] = [1.5, 1.0];

/// Ground above the sea, metres, as the photos' GPS altitude has it.
const GROUND_ALTITUDE_M: f64 = 40.0;

/// Quality of the photos' JPEG.
const JPEG_QUALITY: u8 = 90;

/// Match pictures that the report shows.
const PICTURES: usize = 6;

/// Arguments of `grim demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Where everything is written: map, photos, truth, pack, fixes, report
    #[arg(short, long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,

    /// Another town for another number
    #[arg(long, default_value_t = 7)]
    seed: u64,

    /// Photos of the flight
    #[arg(long, value_name = "N", default_value_t = 40)]
    photos: usize,

    #[command(flatten)]
    model: ModelChoice,
}

/// Runs the command.
///
/// # Errors
/// The folder cannot be written.
pub fn run(arguments: &DemoArgs) -> Result<Exit> {
    if arguments.photos == 0 {
        bail!("--photos 0: a flight has at least one photo");
    }
    let started = Instant::now();
    let model = arguments.model.open()?;
    let out = &arguments.out;
    make_flight(out, arguments.seed, arguments.photos)?;
    let truth: Vec<(TruthFrame, PathBuf)> = truth::read(&out.join("truth.csv"))?
        .into_iter()
        .map(|frame| {
            let path = out.join("photos").join(&frame.photo);
            (frame, path)
        })
        .collect();

    let map = open_map(&out.join("map.tif"), &MapOptions::default())?;
    let pack = out.join("area.grim");
    build_with_bar(map.as_ref(), &model, &BuildOptions::standard(), &pack)?;
    let localizer = Localizer::new(model, Pack::open(&pack)?)?.with_options(Options {
        keep_matches: true,
        // The map is drawn from the town itself.
        map_error_m: 0.0,
        ..Options::default()
    });

    let mut runs = Vec::new();
    for (mode, file) in [
        (HeadingMode::Exif, "fixes.jsonl"),
        (HeadingMode::Unknown, "fixes_unknown_heading.jsonl"),
    ] {
        let (answers, _) = locate_all(&localizer, &truth, mode, None)?;
        write_answers(&out.join(file), &answers)?;
        let name = if mode == HeadingMode::Exif {
            "heading known"
        } else {
            mode.name()
        };
        runs.push(score(name, &answers, &truth));
    }
    write_summary(&out.join("summary.json"), &runs)?;
    let pictures = draw_some(
        &localizer,
        map.as_ref(),
        &truth,
        &runs[0],
        &out.join("matches"),
    )?;
    let report = Report {
        title: "A flight over a made-up town".into(),
        description: vec![
            format!(
                "{} photos from 100 to 130 m above ground, taken in another season, light and year than the map, with a tilted \
                 camera and metadata that err; {:.0} m of town and countryside at {MAP_GSD_M} m per pixel.",
                truth.len(),
                WorldConfig::default().size_m
            ),
            "Everything here was made by this program: there is no such town, and real maps are harder.".into(),
        ],
        runs: runs.clone(),
        pictures,
    };
    fs_err::write(out.join("report.html"), report.to_html()?)?;

    print_summary(&runs)?;
    writeln!(
        std::io::stdout(),
        "\n{:.0} s in all. Look at {} and the pictures in {}",
        started.elapsed().as_secs_f64(),
        out.join("report.html").display(),
        out.join("matches").display()
    )?;
    Ok(Exit::Done)
}

/// Renders the map and the photos, with what they claim and where they truly are.
///
/// # Errors
/// The folder cannot be written.
pub fn make_flight(out: &Path, seed: u64, count: usize) -> Result<()> {
    let photos = out.join("photos");
    fs_err::create_dir_all(&photos)?;
    // Photos of an earlier, longer flight would stand among these.
    for entry in fs_err::read_dir(&photos)? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "jpg") {
            fs_err::remove_file(path)?;
        }
    }
    let world = World::new(WorldConfig {
        seed,
        ..WorldConfig::default()
    });
    let [lon_deg, lat_deg] = PLACE_LON_LAT_DEG;
    let placement = Placement::at(lon_deg, lat_deg)?;
    let size_m = world.size_m();
    let flight = Flight::plan(&world, count, seed);

    let bar = progress::bar(
        flight.frames.len() as u64 + 1,
        "drawing the town",
        "pictures",
    );
    let whole = RegionM {
        x_min_m: 0.0,
        y_min_m: 0.0,
        width_m: size_m,
        height_m: size_m,
    };
    let map = world.render_map(whole, MAP_GSD_M, &Look::satellite(Season::Summer));
    let north_west_m = placement.utm_from_world([0.0, size_m]);
    write_geotiff(
        &out.join("map.tif"),
        &map,
        MAP_GSD_M,
        north_west_m,
        placement.epsg(),
    )?;
    bar.inc(1);

    let look = Look::drone(Season::Autumn);
    let mut rows = Vec::with_capacity(flight.frames.len());
    for (i, frame) in flight.frames.iter().enumerate() {
        let name = format!("flight_{:03}.jpg", i + 1);
        let photo: RgbImage = world.render_photo(&frame.pose, &CAMERA, &look);
        let tags = PhotoTags::for_pose(&frame.reported, &CAMERA, &placement, GROUND_ALTITUDE_M)?;
        write_jpeg_with_exif(&photos.join(&name), &photo, JPEG_QUALITY, &tags)?;
        rows.push(TruthRow::new(&name, &frame.pose, &CAMERA, &placement)?);
        bar.inc(1);
    }
    write_truth_csv(&out.join("truth.csv"), &rows)?;
    bar.finish_and_clear();
    Ok(())
}

fn write_answers(path: &Path, answers: &[Answer]) -> Result<()> {
    let mut text = Vec::new();
    {
        let mut writer = Format::Jsonl.writer(Box::new(&mut text));
        for answer in answers {
            writer.write(answer)?;
        }
        writer.finish()?;
    }
    fs_err::write(path, text)?;
    Ok(())
}

/// Draws the matches of a few photos, the worst first: they tell most.
fn draw_some(
    localizer: &Localizer,
    map: &dyn Raster,
    truth: &[(TruthFrame, PathBuf)],
    run: &Run,
    folder: &Path,
) -> Result<Vec<Picture>> {
    fs_err::create_dir_all(folder)?;
    let mut worst: Vec<usize> = (0..truth.len()).filter(|i| run.frames[*i].fixed).collect();
    worst.sort_by(|a, b| {
        let error = |i: usize| run.frames[i].error_m.unwrap_or(0.0);
        error(*b).total_cmp(&error(*a))
    });
    // Two of the worst, the others from the whole range.
    let step = (worst.len() / PICTURES).max(1);
    let chosen = worst
        .iter()
        .take(2)
        .chain(worst.iter().skip(step).step_by(step))
        .take(PICTURES);
    let mut pictures = Vec::new();
    for &i in chosen {
        let (frame, path) = &truth[i];
        let (photo, outcome) = locate_one(localizer, path, &Prior::none())?;
        let file = folder.join(&frame.photo).with_extension("jpg");
        if !draw(&photo, &outcome, Some(map), &file)? {
            continue;
        }
        pictures.push(Picture {
            caption: format!(
                "{}: {:.1} m off",
                frame.photo,
                run.frames[i].error_m.unwrap_or(f64::NAN)
            ),
            jpeg: fs_err::read(&file).context("cannot read the picture again")?,
        });
    }
    Ok(pictures)
}
