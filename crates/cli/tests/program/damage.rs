//! Damaged and too large photos.

use std::fs;

use super::{lines, locate, photo};

#[test]
fn a_photo_with_damaged_data_gets_no_fix_and_is_called_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(photo(1)).unwrap();
    // A part is lost in the middle of the compressed data: what follows is shifted.
    let mut bytes = whole.clone();
    let middle = bytes.len() / 2;
    bytes.drain(middle..middle + 2000);
    let (shifted, cut) = (
        folder.path().join("shifted.jpg"),
        folder.path().join("cut.jpg"),
    );
    fs::write(&shifted, bytes).unwrap();
    fs::write(&cut, &whole[..middle]).unwrap();

    let (text, status) = locate(&[], &[shifted.clone(), photo(1)]);
    assert_eq!(status, 1, "{text}");
    let answers = lines(&text);
    assert_eq!(answers[0]["state"], "no_fix");
    assert_eq!(answers[0]["damaged"], true);
    let reason = answers[0]["reason"].as_str().unwrap();
    assert!(reason.contains("copy it again"), "{reason}");
    assert_eq!(answers[1]["state"], "fix");
    assert_eq!(answers[1]["damaged"], false);

    let (text, status) = locate(&[], std::slice::from_ref(&cut));
    assert_eq!((status, &lines(&text)[0]["damaged"]), (2, &true.into()));

    let (csv, _) = locate(&["--format", "csv"], &[shifted.clone(), photo(1)]);
    let column: Vec<&str> = csv
        .lines()
        // The last but one; reasons may hold commas.
        .map(|line| line.rsplit(',').nth(1).unwrap())
        .collect();
    assert_eq!(column, ["damaged", "true", "false"]);
    let (geojson, _) = locate(&["--format", "geojson"], &[shifted]);
    let collection: serde_json::Value = serde_json::from_str(&geojson).unwrap();
    assert_eq!(collection["features"][0]["properties"]["damaged"], true);
}

#[test]
fn a_photo_above_the_memory_limit_is_refused_with_the_option_that_raises_it() {
    let (text, status) = locate(&["--max-photo-memory", "1"], &[photo(1)]);
    assert_eq!(status, 2);
    let reason = lines(&text)[0]["reason"].as_str().unwrap().to_owned();
    assert!(
        reason.contains("the limit for a photo is 1 MiB"),
        "{reason}"
    );
    assert!(reason.contains("--max-photo-memory"), "{reason}");
    // A file that is larger is not read at all.
    let folder = tempfile::tempdir().unwrap();
    let large = folder.path().join("large.tif");
    fs::File::create(&large)
        .unwrap()
        .set_len(2_500_000_000)
        .unwrap();
    let (text, status) = locate(&[], &[large]);
    assert_eq!(status, 2);
    assert!(text.contains("large.tif has 2.3 GiB"), "{text}");
}
