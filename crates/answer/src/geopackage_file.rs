//! A GeoPackage (OGC 12-128r18, version 1.3) as a file of layers.

use rusqlite::{Connection, ToSql};

use crate::error::Result;
use crate::geopackage_geometry::{Bounds, Geometry, SRS_ID};

/// "GPKG" as a number, and the version (OGC 12-128r18, requirement 2).
const APPLICATION_ID: i32 = 0x4750_4B47;
const USER_VERSION: i32 = 10_300;

const WKT_4326: &str = r#"GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AXIS["Latitude",NORTH],AXIS["Longitude",EAST],AUTHORITY["EPSG","4326"]]"#;

/// Tables that every GeoPackage has (OGC 12-128r18, annex C).
const TABLES: &str = "
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL,
  z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
";

/// A layer: features of one kind of geometry.
pub(crate) struct Layer {
    /// Its name.
    pub name: &'static str,
    /// `POINT`, `LINESTRING` or `POLYGON`.
    pub geometry: &'static str,
    /// What it holds.
    pub description: &'static str,
    /// Columns besides the geometry: name and type.
    pub columns: &'static [(&'static str, &'static str)],
}

/// A file of layers that is being written, in memory.
pub(crate) struct GeoPackage {
    base: Connection,
    layers: &'static [Layer],
    bounds: Vec<Bounds>,
}

impl GeoPackage {
    /// A file with empty layers.
    ///
    /// # Errors
    /// SQLite fails, as in all functions here.
    pub fn new(layers: &'static [Layer]) -> Result<Self> {
        let base = Connection::open_in_memory()?;
        base.pragma_update(None, "application_id", APPLICATION_ID)?;
        base.pragma_update(None, "user_version", USER_VERSION)?;
        base.execute_batch("BEGIN")?;
        base.execute_batch(TABLES)?;
        add_systems(&base)?;
        for layer in layers {
            let columns = layer.columns.iter();
            let columns: String = columns
                .map(|(name, kind)| format!(", {name} {kind}"))
                .collect();
            let sql = format!(
                "CREATE TABLE {} (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom {}{columns})",
                layer.name, layer.geometry
            );
            base.execute_batch(&sql)?;
        }
        Ok(Self {
            base,
            layers,
            bounds: vec![Bounds::default(); layers.len()],
        })
    }

    /// Adds a feature to the layer with this place in the list, with a value for each of its columns.
    pub fn add(
        &mut self,
        layer: usize,
        geometry: Option<&Geometry>,
        values: &[&dyn ToSql],
    ) -> Result<()> {
        let of = &self.layers[layer];
        let names: String = of
            .columns
            .iter()
            .map(|(name, _)| format!(", {name}"))
            .collect();
        let places: String = (0..of.columns.len())
            .map(|i| format!(", ?{}", i + 2))
            .collect();
        let sql = format!("INSERT INTO {} (geom{names}) VALUES (?1{places})", of.name);
        let blob = geometry.map(Geometry::blob);
        let mut all: Vec<&dyn ToSql> = vec![&blob];
        all.extend(values);
        self.base.prepare(&sql)?.execute(&all[..])?;
        if let Some(geometry) = geometry {
            self.bounds[layer].add(geometry.points());
        }
        Ok(())
    }

    /// The bytes of the file.
    pub fn finish(mut self) -> Result<Vec<u8>> {
        for (layer, bounds) in self.layers.iter().zip(&self.bounds) {
            let [west, south, east, north] = bounds.edges();
            self.base.execute(
                "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, min_x, min_y, max_x, max_y, srs_id) \
                 VALUES (?1, 'features', ?1, ?2, ?3, ?4, ?5, ?6, ?7)",
                (layer.name, layer.description, west, south, east, north, SRS_ID),
            )?;
            self.base.execute(
                "INSERT INTO gpkg_geometry_columns VALUES (?1, 'geom', ?2, ?3, 0, 0)",
                (layer.name, layer.geometry, SRS_ID),
            )?;
        }
        self.base.execute_batch("COMMIT")?;
        Ok(self.base.serialize("main")?.to_vec())
    }
}

fn add_systems(base: &Connection) -> Result<()> {
    let systems = [
        ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined"),
        ("Undefined geographic SRS", 0, "NONE", 0, "undefined"),
        ("WGS 84 geodetic", SRS_ID, "EPSG", SRS_ID, WKT_4326),
    ];
    for system in systems {
        base.execute(
            "INSERT INTO gpkg_spatial_ref_sys (srs_name, srs_id, organization, organization_coordsys_id, definition) \
             VALUES (?1, ?2, ?3, ?4, ?5)",
            system,
        )?;
    }
    Ok(())
}
