//! Is it better to turn the photo or to store each tile's descriptor turned? `turned_tiles FOLDER [FOOTPRINT_WIDTH_M]` measures
//! recall both ways with the heading unknown; the folder holds `map.tif`, `photos/` and `truth.csv`.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::path::Path;

use grimnet_eval::datasets::{DataSet, DataSetRequest};
use grimnet_eval::metrics::recall::{RECALL_AT, RightTile, rank_of_right};
use grimnet_eval::scene::{HeadingMode, Scene, Shot};
use grimnet_geo::{MapOptions, MapPx, Raster, WindowPx};
use grimnet_locate::Options;
use grimnet_net::{Domain, Extractor, Model};
use grimnet_pack::{BuildOptions, Level, Levels, Pack, build};
use grimnet_photo::{Metadata, Photo, PhotoLimits, Query, QueryOptions};
use rayon::prelude::*;

/// Global descriptors, one after the other.
struct Descriptors {
    dim: usize,
    values: Vec<f32>,
}

impl Descriptors {
    fn of(extractor: &Extractor, queries: &[Query]) -> Result<Self, Box<dyn Error>> {
        let rows: Vec<Vec<f32>> = queries
            .par_iter()
            .map(|query| {
                let dense = extractor.dense(&query.image, Some(&query.mask))?;
                let (width, height) = query.image.dimensions();
                let sum = dense.vlad([0, 0, width, height], Some(&query.mask));
                Ok(extractor.model().global_descriptor(&sum))
            })
            .collect::<Result<_, grimnet_net::NetError>>()?;
        Ok(Self {
            dim: rows.first().map_or(1, Vec::len),
            values: rows.concat(),
        })
    }

    /// The largest cosine between any of these and any of `other`.
    fn nearest(&self, other: &Self) -> f32 {
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        self.values
            .chunks_exact(self.dim)
            .flat_map(|a| other.values.chunks_exact(other.dim).map(move |b| dot(a, b)))
            .fold(f32::NEG_INFINITY, f32::max)
    }
}

/// A picture turned by each of `count` angles, `width_m` of it across at `gsd_m`, cropped about its centre to `side_px`.
fn turned(
    photo: &Photo,
    width_m: f64,
    gsd_m: f64,
    side_px: u32,
    count: usize,
) -> Result<Vec<Query>, Box<dyn Error>> {
    let maker = photo.query_maker(&QueryOptions {
        max_side_px: side_px,
        ..QueryOptions::new(gsd_m, width_m)
    })?;
    Ok((0..count)
        .map(|i| maker.make(360.0 * i as f64 / count as f64))
        .collect())
}

/// What lies about a tile's centre, enough of it to turn the tile.
fn surroundings(map: &dyn Raster, level: &Level, tile: usize) -> Result<Photo, Box<dyn Error>> {
    let side_px = f64::from(level.tile_px()) * std::f64::consts::SQRT_2;
    let centre = level.tile(tile).centre_px;
    let corner = |sign: f64| {
        level.map_px_from_level_px(centre.offset(sign * side_px / 2.0, sign * side_px / 2.0))
    };
    let (MapPx { x, y }, end) = (corner(-1.0), corner(1.0));
    let window = WindowPx::new(x, y, end.x - x, end.y - y);
    let out_px = side_px.round() as u32;
    let patch = map.read(window, out_px, out_px)?;
    Ok(Photo::from_image(patch.rgb, Metadata::default()))
}

fn rank(
    level: &Level,
    shot: &Shot,
    photo: &Descriptors,
    tiles: &[Descriptors],
) -> Result<Option<usize>, Box<dyn Error>> {
    let scores: Vec<f32> = tiles.iter().map(|tile| photo.nearest(tile)).collect();
    let mut order: Vec<usize> = (0..tiles.len()).collect();
    order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]));
    let truth_px = level.level_px_from_lonlat(shot.truth.position)?;
    let side_px = f64::from(level.tile_px());
    Ok(rank_of_right(&order, |tile| {
        RightTile::Covers.holds(level.tile(tile).centre_px, side_px, truth_px)
    }))
}

fn scene(folder: &Path, footprint_width_m: Option<f64>) -> Result<Scene, Box<dyn Error>> {
    let data = DataSet::find(&DataSetRequest {
        folder,
        map: None,
        map_options: MapOptions::default(),
        scratch: folder,
        photo_limits: PhotoLimits::DEFAULT,
    })?;
    let map = data.open_map()?;
    let mut scene = data.into_scene(map)?.decoded()?;
    for shot in &mut scene.shots {
        shot.footprint_width_m = footprint_width_m.or(shot.footprint_width_m);
    }
    Ok(scene)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments
        .next()
        .ok_or("turned_tiles FOLDER [FOOTPRINT_WIDTH_M]")?;
    let footprint_width_m = arguments.next().map(|width| width.parse()).transpose()?;
    let scene = scene(Path::new(&folder), footprint_width_m)?;
    let width_m = scene.ground_width_m()?.ok_or("no photo's width is known")?;
    let as_used = Options::default();
    let model = Model::bundled()?;
    let work = tempfile::tempdir()?;
    let path = work.path().join("area.grim");
    let options = BuildOptions {
        levels: Levels::Gsd(vec![width_m / as_used.query_width_px]),
        ..BuildOptions::standard()
    };
    build(scene.map.as_ref(), &model, &options, &path, &mut |_| ())?;
    let pack = Pack::open(&path)?;
    let level = &pack.levels()[0];

    let sat = Extractor::new(&model, Domain::Sat)?;
    let uav = Extractor::new(&model, Domain::Uav)?;
    let side_m = level.tile_m() * std::f64::consts::SQRT_2;
    let tiles = |count: usize| -> Result<Vec<Descriptors>, Box<dyn Error>> {
        (0..level.tile_count())
            .map(|tile| {
                let around = surroundings(scene.map.as_ref(), level, tile)?;
                let queries = turned(&around, side_m, level.gsd_m(), level.tile_px(), count)?;
                Descriptors::of(&sat, &queries)
            })
            .collect()
    };
    println!("{} photos, {} tiles", scene.shots.len(), level.tile_count());
    let (upright, turned_tiles) = (tiles(1)?, tiles(as_used.headings)?);
    for (name, photo_turns, tiles) in [
        ("photo turned", as_used.headings, &upright),
        ("tiles turned", 1, &turned_tiles),
        ("neither", 1, &upright),
    ] {
        let mut ranks = Vec::new();
        for shot in &scene.shots {
            let photo = shot.photo.open()?;
            let view = photo.view(&shot.prior(HeadingMode::Unknown, photo.full_size_px).view);
            let width_m = view
                .footprint
                .map_or(width_m, |footprint| footprint.width_m);
            let queries = turned(
                &photo,
                width_m,
                level.gsd_m(),
                as_used.hypothesis_side_px,
                photo_turns,
            )?;
            ranks.push(rank(level, shot, &Descriptors::of(&uav, &queries)?, tiles)?);
        }
        let within = |k: usize| {
            let found = ranks.iter().filter(|rank| rank.is_some_and(|r| r <= k));
            100 * found.count() / ranks.len().max(1)
        };
        let line: Vec<String> = RECALL_AT
            .iter()
            .map(|&k| format!("R@{k} {} %", within(k)))
            .collect();
        println!("{name:>13}: {}", line.join(", "));
    }
    Ok(())
}
