//! World files and GDAL's `.aux.xml` beside GeoTIFFs.

use std::sync::{Arc, Mutex};

use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

use super::*;

const STATISTICS: &str = "<PAMDataset><PAMRasterBand band=\"1\"><Metadata><MDI key=\"STATISTICS_MAXIMUM\">254</MDI></Metadata>\
                          </PAMRasterBand></PAMDataset>";
const NODATA_0: &str = "<PAMDataset><PAMRasterBand band=\"1\"><NoDataValue>0</NoDataValue></PAMRasterBand></PAMDataset>";

fn hash(map: &dyn Raster) -> [u8; 32] {
    map.content_hash().unwrap()
}

/// Tags of a map whose left edge lies this many metres east of the usual one.
fn moved_tags(east_m: f64) -> Vec<support::Tag> {
    let mut tags = geo_tags(32632);
    tags[1] = double(
        33922,
        &[0.0, 0.0, 0.0, 300_000.0 + east_m, 2_700_000.0, 0.0],
    );
    tags
}

#[test]
fn exchanged_world_files_are_another_map() {
    let dir = folder();
    for (name, blue) in [("a", 10), ("b", 20), ("c", 30)] {
        let path = dir.path().join(name).with_extension("tif");
        write_map(&path, (20, 10), vec![], |x, y| [x as u8, y as u8, blue]);
    }
    let put = |name: &str, column: u32| {
        let x = 300_000.25 + 10.0 * f64::from(column);
        let text = format!("0.5\n0\n0\n-0.5\n{x}\n2699999.75\n");
        std::fs::write(dir.path().join(name).with_extension("tfw"), text).unwrap();
    };
    let list = dir.path().join("list.txt");
    std::fs::write(&list, "a.tif\nb.tif\nc.tif\n").unwrap();
    let open = |path: &Path| with_crs(path, "EPSG:32632").unwrap();
    for (column, name) in ["a", "b", "c"].iter().enumerate() {
        put(name, column as u32);
    }
    let before = [open(dir.path()), open(&list)];
    put("a", 1);
    put("b", 0);
    for (before, path) in before.iter().zip([dir.path(), &list]) {
        let after = open(path);
        assert_eq!(before.size_px(), after.size_px());
        assert_eq!(
            before.georeference().affine(),
            after.georeference().affine()
        );
        assert_ne!(hash(before.as_ref()), hash(after.as_ref()));
    }
}

#[test]
fn statistics_beside_a_map_leave_it_the_same() {
    let dir = folder();
    let path = dir.path().join("town.tif");
    write_map(&path, (20, 10), geo_tags(32632), colours);
    let of_bytes = *blake3::hash(&std::fs::read(&path).unwrap()).as_bytes();
    let of_folder = hash(open(dir.path()).unwrap().as_ref());
    let pam = dir.path().join("town.tif.aux.xml");
    std::fs::write(&pam, STATISTICS).unwrap();
    // The file has a place of its own.
    let world = dir.path().join("town.tfw");
    std::fs::write(&world, "1 0 0 -1 5 5").unwrap();
    let map = open(&path).unwrap();
    assert_eq!(hash(map.as_ref()), of_bytes);
    assert_eq!(hash(open(dir.path()).unwrap().as_ref()), of_folder);
    // No output may replace them all the same.
    assert!(map.files().contains(&pam) && map.files().contains(&world));
    std::fs::write(&pam, NODATA_0).unwrap();
    assert_ne!(hash(open(&path).unwrap().as_ref()), of_bytes);
    assert_ne!(hash(open(dir.path()).unwrap().as_ref()), of_folder);
}

#[test]
fn nodata_beside_a_geotiff_uncovers_what_lies_below() {
    let dir = folder();
    let list = dir.path().join("list.txt");
    std::fs::write(&list, "a.tif\nb.tif\n").unwrap();
    write_map(
        &dir.path().join("a.tif"),
        (20, 10),
        moved_tags(0.0),
        |_, _| [1, 2, 3],
    );
    // Its left half is a black collar over the right half of the other.
    let above = dir.path().join("b.tif");
    write_map(&above, (20, 10), moved_tags(5.0), |x, _| {
        if x < 10 { [0; 3] } else { [7, 8, 9] }
    });
    let colour = |path: &Path| {
        let map = open(path).unwrap();
        let patch = map
            .read(WindowPx::new(0.0, 0.0, 30.0, 10.0), 30, 10)
            .unwrap();
        [5, 15, 25].map(|x| patch.rgb.get_pixel(x, 5).0)
    };
    assert_eq!(colour(&list), [[1, 2, 3], [0; 3], [7, 8, 9]]);
    std::fs::write(dir.path().join("b.tif.aux.xml"), NODATA_0).unwrap();
    for path in [list.as_path(), dir.path()] {
        assert_eq!(colour(path), [[1, 2, 3], [1, 2, 3], [7, 8, 9]]);
    }
}

#[test]
fn a_coordinate_system_beside_a_transform_is_used() {
    let dir = folder();
    let path = dir.path().join("nocrs.tif");
    let mut tags = geo_tags(32632);
    tags.pop();
    write_map(&path, (20, 10), tags, colours);
    let pam = dir.path().join("nocrs.tif.aux.xml");
    let write = |crs: &str| {
        let text = format!("<PAMDataset><SRS>{crs}</SRS></PAMDataset>");
        std::fs::write(&pam, text).unwrap();
    };
    write("EPSG:32632");
    let first = open(&path).unwrap();
    assert_eq!(first.georeference().crs().definition(), "EPSG:32632");
    assert_eq!(first.caveats(), [""; 0]);
    write("EPSG:32633");
    assert_ne!(hash(first.as_ref()), hash(open(&path).unwrap().as_ref()));
    // One that is not known, and one that the user knows.
    write("EPSG:9999");
    let error = refused(open(&path), &pam, &["coordinate system", "EPSG:9999"]);
    assert!(matches!(error, GeoError::UnsupportedCrs { .. }), "{error}");
    assert!(with_crs(&path, "EPSG:32632").is_ok());
    // Keys that say something else only: pixels are areas.
    write("EPSG:32632");
    let mut tags = geo_tags(32632);
    tags[2] = short(34735, &[1, 1, 0, 1, 1025, 0, 1, 1]);
    write_map(&path, (20, 10), tags, colours);
    let map = open(&path).unwrap();
    assert_eq!(map.georeference().crs().definition(), "EPSG:32632");
    // A world file without one.
    write_map(&path, (20, 10), vec![], colours);
    std::fs::write(
        dir.path().join("nocrs.tfw"),
        "0.5 0 0 -0.5 300000.25 2699999.75",
    )
    .unwrap();
    let map = open(&path).unwrap();
    assert_eq!(map.georeference(), first.georeference());
}

#[test]
fn another_place_beside_a_geotiff_than_in_it_is_said() {
    let dir = folder();
    let path = dir.path().join("town.tif");
    write_map(&path, (20, 10), geo_tags(32632), colours);
    let pam = dir.path().join("town.tif.aux.xml");
    let write = |x: f64| {
        let text = format!(
            "<PAMDataset><SRS>EPSG:32632</SRS><GeoTransform>{x}, 0.5, 0, 2700000, 0, -0.5</GeoTransform></PAMDataset>"
        );
        std::fs::write(&pam, text).unwrap();
    };
    write(300_000.0);
    assert_eq!(open(&path).unwrap().caveats(), [""; 0]);
    write(400_000.0);
    let map = open(&path).unwrap();
    assert_eq!(map.georeference().affine().to_gdal()[0], 300_000.0);
    let caveats = map.caveats().join("\n");
    assert!(
        caveats.contains(".aux.xml") && caveats.contains("gdal_translate"),
        "{caveats}"
    );
}

/// Well-known text as ArcGIS writes it, without codes, in a projection.
fn esri(projection: &str) -> String {
    format!(
        "PROJCS[\"WGS_1984_Own\",GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",SPHEROID[\"WGS_1984\",6378137.0,298.257223563]],\
         PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],PROJECTION[\"{projection}\"],\
         PARAMETER[\"False_Easting\",500000.0],PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",15.0],\
         PARAMETER[\"Scale_Factor\",0.9996],PARAMETER[\"Latitude_Of_Origin\",0.0],UNIT[\"Meter\",1.0]]"
    )
}

#[test]
fn a_coordinate_system_without_a_code_beside_a_picture_is_read_or_named() {
    let dir = folder();
    let tagged = dir.path().join("town.tif");
    write_map(&tagged, (20, 10), geo_tags(32632), colours);
    let plain = dir.path().join("town.png");
    picture(&plain, 20, 10);
    let world = "0.5 0 0 -0.5 300000.25 2699999.75";
    std::fs::write(dir.path().join("town.pgw"), world).unwrap();
    let write = |projection: &str| {
        let text = format!("<PAMDataset><SRS>{}</SRS></PAMDataset>", esri(projection));
        for name in ["town.tif.aux.xml", "town.png.aux.xml"] {
            std::fs::write(dir.path().join(name), &text).unwrap();
        }
    };
    // One that is read: GDAL puts the map a zone farther east, and the picture lies there.
    write("Transverse_Mercator");
    let caveats = open(&tagged).unwrap().caveats().join("\n");
    assert!(caveats.contains("puts the centre at"), "{caveats}");
    let map = open(&plain).unwrap();
    let in_zone_33 = with_crs(&plain, "EPSG:32633").unwrap();
    let centre = |map: &dyn Raster| {
        let place = map.georeference();
        place.lonlat_from_map_px(place.centre_px()).unwrap()
    };
    assert!(distance_m(centre(map.as_ref()), centre(in_zone_33.as_ref())) < 0.01);
    // One that is not.
    write("Other");
    let map = open(&tagged).unwrap();
    assert_eq!(map.georeference().crs().definition(), "EPSG:32632");
    let caveats = map.caveats().join("\n");
    assert!(
        caveats.contains(".aux.xml") && caveats.contains("'WGS_1984_Own'"),
        "{caveats}"
    );
    assert_eq!(with_crs(&tagged, "EPSG:32632").unwrap().caveats(), [""; 0]);
    let pam = dir.path().join("town.png.aux.xml");
    refused(open(&plain), &pam, &["WGS_1984_Own", "projection other"]);
}

#[test]
fn a_prj_beside_a_world_file_gives_the_coordinate_system() {
    let dir = folder();
    let world = "0.5 0 0 -0.5 300000.25 2699999.75";
    let prj = dir.path().join("town.prj");
    let crs_of = |map: &dyn Raster| map.georeference().crs().definition().to_owned();
    for name in ["town.png", "town.tif"] {
        let path = dir.path().join(name);
        if name == "town.tif" {
            write_map(&path, (20, 10), vec![], colours);
        } else {
            picture(&path, 20, 10);
        }
        let world_file = path.with_extension(if name == "town.tif" { "tfw" } else { "pgw" });
        std::fs::write(&world_file, world).unwrap();
        refused(open(&path), &path, &["no coordinate system", ".prj"]);
        std::fs::write(&prj, esri("Transverse_Mercator")).unwrap();
        let map = open(&path).unwrap();
        let in_zone_33 = with_crs(&path, "EPSG:32633").unwrap();
        let [own, given] = [&map, &in_zone_33].map(|map| {
            let place = map.georeference();
            place.lonlat_from_map_px(place.centre_px()).unwrap()
        });
        assert!(distance_m(own, given) < 0.01);
        assert!(map.files().contains(&prj), "{:?}", map.files());
        // It belongs to the map, GDAL's file comes first, and what is not known is not guessed.
        let first = hash(map.as_ref());
        std::fs::write(&prj, "EPSG:32632").unwrap();
        assert_ne!(hash(open(&path).unwrap().as_ref()), first);
        let pam = dir.path().join(format!("{name}.aux.xml"));
        std::fs::write(&pam, "<PAMDataset><SRS>EPSG:32634</SRS></PAMDataset>").unwrap();
        assert_eq!(crs_of(open(&path).unwrap().as_ref()), "EPSG:32634");
        std::fs::remove_file(&pam).unwrap();
        std::fs::write(&prj, esri("Other")).unwrap();
        refused(open(&path), &prj, &["WGS_1984_Own", "projection other"]);
        std::fs::remove_file(&prj).unwrap();
    }
    // Keys in the file are its own.
    let tagged = dir.path().join("tagged.tif");
    write_map(&tagged, (20, 10), geo_tags(32632), colours);
    std::fs::write(dir.path().join("tagged.prj"), "EPSG:32633").unwrap();
    assert_eq!(crs_of(open(&tagged).unwrap().as_ref()), "EPSG:32632");
}

#[test]
fn a_coordinate_system_that_contradicts_several_files_is_said() {
    let dir = folder();
    for (name, east_m) in [("a.tif", 0.0), ("b.tif", 10.0)] {
        write_map(
            &dir.path().join(name),
            (20, 10),
            moved_tags(east_m),
            colours,
        );
    }
    let list = dir.path().join("list.txt");
    std::fs::write(&list, "a.tif\nb.tif\n").unwrap();
    let band = |number: u32| {
        format!(
            "<VRTRasterBand band=\"{number}\"><SimpleSource><SourceFilename relativeToVRT=\"1\">a.tif</SourceFilename>\
             <SourceBand>{number}</SourceBand><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"20\" ySize=\"10\"/>\
             <DstRect xOff=\"0\" yOff=\"0\" xSize=\"20\" ySize=\"10\"/></SimpleSource></VRTRasterBand>"
        )
    };
    for (name, srs) in [("code.vrt", "<SRS>EPSG:32632</SRS>"), ("of_files.vrt", "")] {
        let text = format!(
            "<VRTDataset rasterXSize=\"20\" rasterYSize=\"10\">{srs}<GeoTransform>300000, 0.5, 0, 2700000, 0, -0.5</GeoTransform>{}{}{}\
             </VRTDataset>",
            band(1),
            band(2),
            band(3)
        );
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    for name in ["", "list.txt", "code.vrt", "of_files.vrt"] {
        let path = dir.path().join(name);
        for same in ["EPSG:32632", "EPSG:25832"] {
            assert_eq!(with_crs(&path, same).unwrap().caveats(), [""; 0], "{name}");
        }
        let caveats = with_crs(&path, "EPSG:32633").unwrap().caveats().join("\n");
        assert!(caveats.contains("states EPSG:32632"), "{name}: {caveats}");
    }
}

/// The messages of warnings.
#[derive(Clone, Default)]
struct Warnings(Arc<Mutex<Vec<String>>>);

impl Subscriber for Warnings {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() == tracing::Level::WARN
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        struct Message(String);
        impl Visit for Message {
            fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
                if field.name() == "message" {
                    self.0 = format!("{value:?}");
                }
            }
        }
        let mut message = Message(String::new());
        event.record(&mut message);
        self.0.lock().unwrap().push(message.0);
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

#[test]
fn what_may_be_wrong_is_logged_when_a_map_is_opened() {
    let dir = folder();
    write_map(
        &dir.path().join("a.tif"),
        (20, 10),
        geo_tags(32632),
        colours,
    );
    let warnings = Warnings::default();
    let map = tracing::subscriber::with_default(warnings.clone(), || {
        with_crs(dir.path(), "EPSG:32633").unwrap()
    });
    assert_eq!(map.caveats().len(), 1);
    assert_eq!(*warnings.0.lock().unwrap(), map.caveats());
}

#[test]
fn world_files_may_have_a_byte_order_mark_and_decimal_commas() {
    let dir = folder();
    let path = dir.path().join("town.png");
    picture(&path, 20, 10);
    let world = dir.path().join("town.pgw");
    let numbers = "0.5\n0\n0\n-0.5\n300000.25\n2699999.75\n";
    std::fs::write(&world, format!("\u{feff}{numbers}")).unwrap();
    let map = with_crs(&path, "EPSG:32632").unwrap();
    assert_eq!(map.georeference().affine().to_gdal()[0], 300_000.0);
    std::fs::write(&world, numbers.replace('.', ",")).unwrap();
    let with_commas = with_crs(&path, "EPSG:32632").unwrap();
    assert_eq!(
        with_commas.georeference().affine(),
        map.georeference().affine()
    );
    let utf_16: Vec<u8> = numbers.encode_utf16().flat_map(u16::to_le_bytes).collect();
    std::fs::write(&world, [&[0xFF, 0xFE][..], &utf_16].concat()).unwrap();
    refused(with_crs(&path, "EPSG:32632"), &world, &["UTF-8"]);
}
