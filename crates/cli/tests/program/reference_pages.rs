//! The reference pages of the guide: `docs/answers.md` names the fields, columns and reasons that the program writes, and no others;
//! `docs/datasets.md` names columns that are read.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{demo, grim, guide, lines, locate, pack, photo};

type Names = BTreeSet<String>;

fn docs(name: &str) -> String {
    fs::read_to_string(guide::docs().join(name)).unwrap()
}

fn page() -> String {
    docs("answers.md")
}

/// The text below a heading of the second level.
fn section(page: &str, heading: &str) -> String {
    let (_, rest) = page
        .split_once(&format!("\n## {heading}\n"))
        .unwrap_or_else(|| panic!("the page has no section {heading:?}"));
    rest.split("\n## ").next().unwrap().to_owned()
}

/// What stands between backticks, code blocks apart.
fn quoted(text: &str) -> Vec<String> {
    let outside: String = text.split("```").step_by(2).collect();
    let words = outside.split('`').skip(1).step_by(2);
    words.map(str::to_owned).collect()
}

/// The rows of a section's tables.
fn rows(section: &str) -> Vec<Vec<&str>> {
    let lines = section.lines().filter(|line| line.starts_with('|'));
    lines
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect()
}

/// The names in the first cells of a section's tables.
fn first_cells(section: &str) -> Names {
    rows(section)
        .iter()
        .flat_map(|cells| quoted(cells[0]))
        .collect()
}

/// The keys of an object, and those of the objects in it.
fn keys(value: &Value, inner: &mut Names) -> Names {
    let mut found = Names::new();
    for (key, value) in value.as_object().unwrap() {
        found.insert(key.clone());
        let objects = match value {
            Value::Object(_) => std::slice::from_ref(value),
            Value::Array(items) => items.as_slice(),
            _ => &[],
        };
        for object in objects.iter().filter(|object| object.is_object()) {
            let within = keys(object, &mut Names::new());
            inner.extend(within);
        }
    }
    found
}

/// Standard output of `grim track` over the demo's flight.
fn track(arguments: &[&str]) -> String {
    let output = grim()
        .args(["track", "--pack"])
        .arg(pack())
        .arg(demo().join("flight"))
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

fn check_lines(heading: &str, text: &str) {
    let section = section(&page(), heading);
    let (mut found, mut inner) = (Names::new(), Names::new());
    for line in lines(text) {
        found.extend(keys(&line, &mut inner));
    }
    assert_eq!(first_cells(&section), found, "fields of {heading}");
    let named: Names = quoted(&section).into_iter().collect();
    assert!(inner.is_subset(&named), "{inner:?} of {heading}");
}

#[test]
fn every_field_of_a_json_line_is_on_the_page() {
    // The second has no fix.
    let (text, _) = locate(&["--format", "jsonl"], &[photo(1), "gone.jpg".into()]);
    check_lines("JSON lines of `grim locate`", &text);
    check_lines("JSON lines of `grim track`", &track(&["--format", "jsonl"]));
}

#[test]
fn every_column_of_a_table_is_on_the_page() {
    let section = section(&page(), "CSV");
    let (of_photos, of_frames) = section.split_once("\n`grim track`:").unwrap();
    let (text, _) = locate(&["--format", "csv"], &[photo(1)]);
    for (text, part) in [(text, of_photos), (track(&["--format", "csv"]), of_frames)] {
        let listed = part.split_once(':').map_or(part, |(_, rest)| rest);
        let listed = quoted(listed.split('.').next().unwrap());
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        assert_eq!(listed, header);
    }
}

#[test]
fn geojson_has_the_fields_of_the_lines() {
    let (text, _) = locate(&["--format", "geojson"], &[photo(1)]);
    let collection: Value = serde_json::from_str(&text).unwrap();
    let mut inner = Names::new();
    let of = |feature: usize, inner: &mut Names| {
        keys(&collection["features"][feature]["properties"], inner)
    };
    let mut expected = first_cells(&section(&page(), "JSON lines of `grim locate`"));
    expected.remove("outline_lon_lat_deg");
    assert_eq!(of(0, &mut inner), expected);
    let outline = of(1, &mut inner);
    assert_eq!(outline, ["photo", "role"].map(str::to_owned).into());
    assert_eq!(collection["features"][1]["properties"]["role"], "outline");
}

/// The layers of a GeoPackage with their columns, from the text of its tables.
#[cfg(feature = "sqlite")]
fn layers(file: &Path) -> Vec<String> {
    let bytes = fs::read(file).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    // `CREATE TABLE fixes (fid ..., geom POINT, photo TEXT, ...)`
    let tables = text.split("CREATE TABLE ").skip(1);
    let mut found: Vec<String> = tables
        .filter_map(|table| {
            let (name, columns) = table.split_once(" (fid ")?;
            let columns = columns.split_once(')')?.0.split(", ").skip(2);
            let columns = columns.map(|column| column.split(' ').next().unwrap());
            let quoted: Vec<String> = columns.map(|column| format!("`{column}`")).collect();
            (!name.contains(' ')).then(|| format!("`{name}`: {}", quoted.join(", ")))
        })
        .collect();
    found.sort();
    found
}

#[test]
#[cfg(feature = "sqlite")]
fn every_layer_of_a_geopackage_is_on_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let (fixes, flight) = (folder.path().join("a.gpkg"), folder.path().join("b.gpkg"));
    locate(&["-o", fixes.to_str().unwrap()], &[photo(1)]);
    track(&["-o", flight.to_str().unwrap()]);
    let section = section(&page(), "GeoPackage");
    let rows = rows(&section);
    let of_layers = rows.iter().filter(|cells| cells[1].starts_with('`'));
    let listed: Vec<String> = of_layers
        .map(|cells| format!("{}: {}", cells[1], cells[3]))
        .collect();
    let mut written = layers(&fixes);
    assert_eq!(written.len(), 3, "{written:?}");
    written.extend(layers(&flight));
    let sorted = |mut lines: Vec<String>| {
        lines.sort();
        lines
    };
    assert_eq!(sorted(listed), sorted(written));
}

/// The messages of the reasons, as the source states them, with `...` in place of their values.
fn reasons() -> Names {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../locate/src/outcome.rs");
    let source = fs::read_to_string(source).unwrap();
    let messages = source.split("#[error(").skip(1);
    messages
        .map(|rest| {
            let text = rest.split('"').nth(1).unwrap();
            let mut pieces = text.split('{');
            let mut message = pieces.next().unwrap().to_owned();
            for piece in pieces {
                message += "...";
                message += piece.split_once('}').unwrap().1;
            }
            message
        })
        .collect()
}

#[test]
fn every_reason_is_on_the_page() {
    let listed = first_cells(&section(&page(), "No fix: the reasons"));
    assert_eq!(listed, reasons());
}

#[test]
fn every_column_of_a_truth_file_that_is_on_the_page_is_read() {
    let page = docs("datasets.md");
    let section = section(&page, "Your own photos: `truth.csv`");
    let mut columns = first_cells(&section);
    assert!(columns.remove("photo") && columns.remove("place"), "texts");
    assert!(columns.len() > 10, "{columns:?}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("truth.csv");
    for column in columns {
        // The other half of a position, and another position.
        let header = "photo,lat_deg,lon_deg,centre_lat,centre_lon,gps_lat,gps_lon";
        let others: Vec<&str> = match column.as_str() {
            "centre_lat" | "centre_lon" => vec!["photo", "centre_lat", "centre_lon"],
            _ => header.split(',').collect(),
        };
        let others = others.into_iter().filter(|other| *other != column);
        let header: Vec<&str> = others.chain([column.as_str()]).collect();
        let values = vec!["1"; header.len() - 1].join(",");
        fs::write(&file, format!("{}\n{values},x\n", header.join(","))).unwrap();
        let error = grimnet_eval::datasets::truth::read(&file).unwrap_err();
        assert!(
            error.to_string().contains(&format!("`{column}` is `x`")),
            "{error}"
        );
    }
}
