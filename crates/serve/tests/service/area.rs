//! A procedural map with photos and a pack, and services on it.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::thread::JoinHandle;

use grimnet::map::{self, BuildOptions, Levels, MapBuild};
use grimnet::{Localizer, Options};
use grimnet_geo::{MapOptions, open_map};
use grimnet_serve::{Access, Limits, ServeError, ServedMap, Service, StopHandle};
use grimnet_world::{
    Camera, Look, PhotoTags, Placement, Pose, RegionM, Season, World, WorldConfig, write_geotiff,
    write_jpeg_with_exif,
};

const SIZE_M: f64 = 420.0;
const MAP_GSD_M: f64 = 0.3;
const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 800,
    height_px: 600,
};
pub const POSE: Pose = Pose {
    x_m: 180.0,
    y_m: 230.0,
    height_agl_m: 90.0,
    heading_deg: 40.0,
    pitch_off_nadir_deg: 0.0,
    roll_deg: 0.0,
};

pub struct Area {
    folder: PathBuf,
    pub photo: Vec<u8>,
    /// Longitude and latitude of the photo's centre, degrees.
    pub truth: [f64; 2],
    /// Photos of a flight to the east, [`FLIGHT_STEP_S`] after each other, with longitude and latitude of their centres, degrees.
    pub flight: Vec<(Vec<u8>, [f64; 2])>,
}

impl Area {
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Distance from the true position, metres.
    pub fn error_m(&self, lat_deg: f64, lon_deg: f64) -> f64 {
        distance_m(self.truth, lat_deg, lon_deg)
    }

    /// The photo with a run of lost bytes amid its compressed data.
    pub fn damaged_photo(&self) -> Vec<u8> {
        let mut photo = self.photo.clone();
        let middle = photo.len() / 2;
        photo[middle..middle + 400].fill(0);
        photo
    }

    pub fn localizer(&self) -> Localizer {
        let options = Options {
            keep_matches: true,
            ..Options::default()
        };
        Localizer::builder()
            .options(options)
            .open(self.file("area.grim"))
            .unwrap()
    }

    /// The area as a map of a service, with its picture or without.
    pub fn served(&self, name: &str, with_picture: bool) -> ServedMap {
        let raster = with_picture.then(|| {
            open_map(&self.file("map.tif"), &MapOptions::default())
                .unwrap()
                .into()
        });
        ServedMap::new(name, self.localizer(), raster).unwrap()
    }
}

/// Distance from a longitude and latitude, metres; right to a few parts in a thousand near the equator.
pub fn distance_m(from: [f64; 2], lat_deg: f64, lon_deg: f64) -> f64 {
    let north_m = (lat_deg - from[1]) * 110_600.0;
    let east_m = (lon_deg - from[0]) * 111_320.0 * lat_deg.to_radians().cos();
    north_m.hypot(east_m)
}

/// Frames of the flight.
const FLIGHT_FRAMES: usize = 8;

/// Time between two of them, seconds: 12 m at 8 m/s.
pub const FLIGHT_STEP_S: f64 = 1.5;

/// Map, photo and pack, made once.
pub fn area() -> &'static Area {
    static AREA: OnceLock<Area> = OnceLock::new();
    AREA.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("serve_area");
        std::fs::create_dir_all(&folder).unwrap();
        let placement = Placement::at(1.5, 1.0).unwrap();
        let world = World::new(WorldConfig {
            seed: 11,
            size_m: SIZE_M,
            ..WorldConfig::default()
        });
        let whole = RegionM {
            x_min_m: 0.0,
            y_min_m: 0.0,
            width_m: SIZE_M,
            height_m: SIZE_M,
        };
        let picture = world.render_map(whole, MAP_GSD_M, &Look::satellite(Season::Summer));
        let map = folder.join("map.tif");
        let top_left = placement.utm_from_world([0.0, SIZE_M]);
        write_geotiff(&map, &picture, MAP_GSD_M, top_left, placement.epsg()).unwrap();
        let path = folder.join("photo.jpg");
        let taken = |pose: &Pose| {
            let photo = world.render_photo(pose, &CAMERA, &Look::drone(Season::Summer));
            let tags = PhotoTags::for_pose(pose, &CAMERA, &placement, 40.0).unwrap();
            write_jpeg_with_exif(&path, &photo, 92, &tags).unwrap();
            let truth = placement.lonlat_from_world([pose.x_m, pose.y_m]).unwrap();
            (std::fs::read(&path).unwrap(), truth)
        };
        let (photo, truth) = taken(&POSE);
        let flight = (0..FLIGHT_FRAMES).map(|number| {
            taken(&Pose {
                x_m: 150.0 + 12.0 * number as f64,
                heading_deg: 90.0,
                ..POSE
            })
        });
        let flight = flight.collect();
        let options = MapBuild {
            pack: BuildOptions {
                levels: Levels::Gsd(vec![MAP_GSD_M]),
                ..BuildOptions::default()
            },
            ..MapBuild::default()
        };
        map::build(&map, folder.join("area.grim"), &options, |_| {}).unwrap();
        Area {
            photo,
            truth,
            flight,
            folder,
        }
    })
}

/// A service that runs until it is dropped.
pub struct Running {
    pub address: SocketAddr,
    pub stop: StopHandle,
    thread: Option<JoinHandle<Result<(), ServeError>>>,
}

impl Running {
    pub fn start(access: Access, maps: Vec<ServedMap>, limits: Limits) -> Self {
        let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
        let service = Service::bind(any_port, access, maps, limits).unwrap();
        Self {
            address: service.address(),
            stop: service.stop_handle(),
            thread: Some(std::thread::spawn(move || service.run(false))),
        }
    }

    /// On the area, for this machine.
    pub fn on_area(limits: Limits) -> Self {
        Self::start(
            Access::ThisMachine,
            vec![area().served("area", true)],
            limits,
        )
    }

    /// Stops it and waits until it has ended.
    pub fn end(&mut self) {
        self.stop.stop();
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap().unwrap();
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.end();
        }
    }
}

/// One service with default limits for all tests that do not fill it.
pub fn shared() -> SocketAddr {
    static SHARED: OnceLock<Running> = OnceLock::new();
    SHARED
        .get_or_init(|| Running::on_area(Limits::default()))
        .address
}
