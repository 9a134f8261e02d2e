//! `grim eval`.

use super::*;

/// `grim eval` of the photos in `folder` on a map.
fn eval_on(map: &Path, folder: &Path, heading: &str, out: &Path) -> Command {
    let mut command = grim();
    command.arg("eval").arg(folder).arg("--map").arg(map);
    command.args(["--heading", heading, "--out"]).arg(out);
    command
}

#[test]
fn evaluation_agrees_with_the_demo() {
    let folder = tempfile::tempdir().unwrap();
    grim()
        .arg("eval")
        .arg(demo())
        .arg("--out")
        .arg(folder.path())
        .args(["--heading", "unknown"])
        .assert()
        .success();
    for name in ["summary.json", "report.html", "frames.csv", "failed.jsonl"] {
        assert!(folder.path().join(name).exists(), "{name}");
    }
    let summary = json(&folder.path().join("summary.json"));
    let within = summary["heading_unknown"]["within_10m"].as_f64().unwrap();
    assert!(within >= 0.85, "{summary}");
}

#[test]
fn a_run_that_fails_before_it_writes_anything_leaves_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let demo = std::fs::canonicalize(demo()).unwrap().display().to_string();
    for command in [
        "eval no/such --out new/results".to_owned(),
        format!("eval {demo} --out new/results --model no.safetensors"),
        format!("eval {demo} --out new/results --track --model no.safetensors"),
        format!("eval {demo} --out new/results --elsewhere no/such"),
        "demo --out new/demo --model no.safetensors".to_owned(),
        format!(
            "track --pack {demo}/area.grim --follow no/such --record new/recorded --report new/report"
        ),
        format!("locate --pack {demo}/area.grim a.jpg --draw new/drawn --model no.safetensors"),
    ] {
        grim()
            .current_dir(folder.path())
            .args(command.split_whitespace())
            .assert()
            .code(2)
            .stderr(contains("no/such").or(contains("no.safetensors")));
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            0,
            "{command}"
        );
    }
}

#[test]
fn a_confidence_that_is_never_stated_is_refused_before_the_pack_is_built() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("uncalibrated.safetensors");
    grimnet_net::Model::random(&grimnet_net::NetSpec::compact(), 5)
        .unwrap()
        .save(&model)
        .unwrap();
    let out = folder.path().join("out");
    for (options, said) in [
        (["--mode", "paper"], "--min-confidence has no meaning"),
        (
            ["--model", model.to_str().unwrap()],
            "gates.min_confidence is 0.5; expected 0 with a model that states no confidence",
        ),
    ] {
        let mut command = grim();
        command.arg("eval").arg(demo()).arg("--out").arg(&out);
        command.args(["--min-confidence", "0.5"]).args(options);
        command.assert().code(2).stderr(contains(said));
        assert!(!out.exists(), "{options:?}");
    }
}

#[test]
fn truth_that_cannot_be_scored_is_named_and_the_rest_is_scored() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    let truth = std::fs::read_to_string(demo().join("truth.csv")).unwrap();
    let mut rows = truth.lines();
    let header = rows.next().unwrap();
    let first = rows.next().unwrap();
    for (number, name) in [(1, "flight_001.jpg"), (2, "far.jpg"), (3, "alone.jpg")] {
        std::fs::copy(photo(number), photos.join(name)).unwrap();
    }
    for number in 1..=3 {
        std::fs::write(photos.join(format!("other{number}.jpg")), "").unwrap();
    }
    let bad = "gone.jpg,1.0,1.5,0,100\nnan.jpg,NaN,1.5,0,100\nfar.jpg,48.0,11.0,0,100\n\
               gone2.jpg,1.0,1.5,0,100\ngone3.jpg,1.0,1.5,0,100\ngone4.jpg,1.0,1.5,0,100";
    let table = format!("{header}\n{first}\n{bad}\n");
    std::fs::write(folder.path().join("truth.csv"), table).unwrap();
    let out = folder.path().join("out");
    let eval = |folder: &Path, map: &Path| eval_on(map, folder, "exif", &out);
    let map = demo().join("map.tif");
    eval(folder.path(), &map)
        .assert()
        .success()
        .stderr(contains("gone.jpg: listed in the truth file but missing"))
        .stderr(contains(
            "photos: 1 more listed in the truth file but missing",
        ))
        .stderr(contains("line 4: `lat_deg` is `NaN`"))
        .stderr(contains("far.jpg: its true position is off the map"))
        .stderr(contains("alone.jpg: has no truth"))
        .stderr(contains("photos: 1 more without truth"));
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["heading_from_the_photo"]["frames"], 1);
    assert_eq!(summary["about"]["mode"], "default");
    for name in ["report.html", "frames.csv", "failed.jsonl"] {
        assert!(out.join(name).is_file(), "{name}");
    }

    // Another place than the map's, as a wrong coordinate system gives.
    let elsewhere = format!("{header}\nflight_001.jpg,48.0,11.0,0,100\n");
    std::fs::write(folder.path().join("truth.csv"), elsewhere).unwrap();
    eval(folder.path(), &map)
        .assert()
        .code(2)
        .stderr(contains("none of the 1 true positions is on the map"));

    let empty = tempfile::tempdir().unwrap();
    eval(empty.path(), &map)
        .assert()
        .code(2)
        .stderr(contains("no photo").or(contains("no photos")));
    eval(&empty.path().join("absent"), &map)
        .assert()
        .code(2)
        .stderr(contains("no such folder"));
}

#[test]
fn photos_that_cannot_be_read_take_no_place_among_the_pictures_of_the_worst() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    std::fs::copy(photo(1), photos.join("flight_001.jpg")).unwrap();
    let truth = std::fs::read_to_string(demo().join("truth.csv")).unwrap();
    let mut table: Vec<String> = truth.lines().take(2).map(str::to_owned).collect();
    for number in 1..=5 {
        let name = format!("empty{number}.jpg");
        std::fs::write(photos.join(&name), "").unwrap();
        table.push(table[1].replace("flight_001.jpg", &name));
    }
    std::fs::write(folder.path().join("truth.csv"), table.join("\n")).unwrap();
    let out = folder.path().join("out");
    eval_on(&demo().join("map.tif"), folder.path(), "exif", &out)
        .assert()
        .success();
    assert!(out.join("matches/flight_001.jpg").is_file());
}

#[test]
fn photos_of_another_town_are_counted_by_setting() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = folder.path().join("fog");
    std::fs::create_dir(&pictures).unwrap();
    let fog = image::RgbImage::from_pixel(400, 300, image::Rgb([190, 192, 195]));
    fog.save(pictures.join("fog.png")).unwrap();
    let out = folder.path().join("out");
    let eval = |elsewhere: &Path| {
        let mut command = grim();
        command.arg("eval").arg("--map").arg(demo().join("map.tif"));
        command.arg("--elsewhere").arg(elsewhere);
        command.args(["--precision", "mixed"]);
        command.args(["--elsewhere-trials", "4", "--out"]).arg(&out);
        command
    };
    eval(&pictures)
        .assert()
        .success()
        .stdout(contains("sources not trained on"));
    let summary = json(&out.join("elsewhere.json"));
    assert_eq!(summary["all"]["trials"], 4);
    assert_eq!(summary["all"]["fixes"], 0, "{summary}");
    assert_eq!(summary["about"]["mode"], "default");
    assert_eq!(summary["about"]["precision"], "mixed", "that of the search");
    let map = summary["about"]["map"].as_str().unwrap();
    assert!(map.starts_with("map.tif"), "{map}");
    let table = std::fs::read_to_string(out.join("elsewhere.csv")).unwrap();
    assert_eq!(table.lines().count(), 5);
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    eval(&empty)
        .assert()
        .code(2)
        .stderr(contains("no pictures"));
    let unreadable = folder.path().join("unreadable");
    std::fs::create_dir(&unreadable).unwrap();
    std::fs::write(unreadable.join("a.jpg"), "no picture").unwrap();
    eval(&unreadable)
        .assert()
        .code(2)
        .stderr(contains("a.jpg: not a picture"))
        .stderr(contains("none of the pictures"));
}

#[test]
fn footprint_place_and_answerability_come_from_the_truth_file() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    let truth = std::fs::read_to_string(demo().join("truth.csv")).unwrap();
    let mut table =
        "photo,lat_deg,lon_deg,heading_deg,footprint_w_m,truth_err_m,flat_frac,place\n".to_owned();
    for (number, flat) in [(1, "0.1"), (2, "0.9")] {
        std::fs::copy(photo(number), photos.join(format!("{number}.jpg"))).unwrap();
        let row: Vec<&str> = truth.lines().nth(number).unwrap().split(',').collect();
        let (lat, lon) = (row[1], row[2]);
        let heading = if number == 1 { row[3] } else { "" };
        let height_m: f64 = row[4].parse().unwrap();
        let width_m = 2.0 * height_m * 35f64.to_radians().tan();
        table += &format!("{number}.jpg,{lat},{lon},{heading},{width_m:.1},0.5,{flat},town\n");
    }
    std::fs::write(folder.path().join("truth.csv"), table).unwrap();
    let out = folder.path().join("out");
    eval_on(&demo().join("map.tif"), folder.path(), "known", &out)
        .args(["--min-confidence", "0"])
        .assert()
        .success()
        .stdout(contains("right (within 5 % of footprint)"))
        .stdout(contains(format!(
            "The report is {}",
            out.join("report.html").display()
        )))
        .stderr(contains("1 of 2 photos have no true heading"));
    let summary = json(&out.join("summary.json"));
    let figures = &summary["heading_known"]["footprint"];
    assert_eq!(figures["photos"], 2);
    assert_eq!(figures["answerable"], 1);
    assert_eq!(figures["right"], 1, "{figures}");
    assert_eq!(
        (figures["wrong"].as_u64(), figures["places"].as_u64()),
        (Some(0), Some(1))
    );
    assert!(summary["heading_known"]["reliability"]["bins"].is_array());
    let about = &summary["about"];
    assert_eq!(about["min_confidence"], 0.0);
    assert!(about["map"].as_str().unwrap().starts_with("map.tif"));
    assert!(about["calibration"]["confidence"]["needed"].is_number());
    let recall = json(&out.join("recall.json"));
    assert_eq!(recall[0]["frames"][1]["photo"], "2.jpg");
    assert_eq!(recall[0]["frames"][0]["matched"], true);
    let frames = std::fs::read_to_string(out.join("frames.csv")).unwrap();
    assert!(frames.lines().next().unwrap().contains("footprint_share"));
    assert!(frames.contains(",town,") && frames.contains(",right"));
    let mut rows = csv::Reader::from_reader(frames.as_bytes());
    let header = rows.headers().unwrap().clone();
    let row = rows.records().next().unwrap().unwrap();
    let value = |name: &str| -> f64 {
        let column = header.iter().position(|column| column == name);
        row[column.unwrap()].parse().unwrap()
    };
    let north_m = (value("lat_deg") - value("true_lat_deg")) * 110_580.0;
    assert!((north_m - value("error_north_m")).abs() < 0.05, "{north_m}");
    assert!((value("lon_deg") - value("true_lon_deg")).abs() < 1e-3);
    let [ee, en, nn] = ["ee", "en", "nn"].map(|axes| value(&format!("covariance_{axes}_m2")));
    assert!(ee * nn > en * en, "{ee} {en} {nn}");
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("Reliability"));
    assert!(page.contains("Error of the truth: that of the truth file"));
    assert!(page.contains("Ground width of the photos: that of the truth file"));
}

#[test]
fn published_data_sets_are_told_by_their_files() {
    let folder = tempfile::tempdir().unwrap();
    let eval = |data: &Path, out: &str| {
        let mut command = grim();
        command.arg("eval").arg(data).args(["--heading", "exif"]);
        command.arg("--out").arg(folder.path().join(out));
        command
    };
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../eval/tests/golden/anyvisloc");
    let run = eval(&golden.join("Scene_07"), "anyvisloc").assert();
    // Builds without the feature may leave the reader out.
    if cfg!(feature = "anyvisloc") || run.get_output().status.success() {
        run.success().stderr(contains(
            "L07_0003.npz: the camera is tilted 88 degrees from nadir",
        ));
        let summary = json(&folder.path().join("anyvisloc/summary.json"));
        assert_eq!(summary["about"]["data"], "AnyVisLoc Scene_07");
        assert_eq!(summary["heading_from_the_photo"]["frames"], 2);
    } else {
        run.code(2)
            .stderr(contains("Scene_07").and(contains("--features anyvisloc")));
    }

    let msdi = folder.path().join("msdi");
    let scene = msdi.join("data/calibrated_images/museum");
    std::fs::create_dir_all(&scene).unwrap();
    std::fs::copy(photo(1), scene.join("a.jpg")).unwrap();
    eval(&msdi, "none")
        .assert()
        .code(2)
        .stderr(contains("MSDI comes without a map"));
    eval(&msdi, "flight")
        .arg("--map")
        .arg(demo().join("map.tif"))
        .assert()
        .success();
    let summary = json(&folder.path().join("flight/summary.json"));
    assert_eq!(summary["heading_from_the_photo"]["frames"], 1);
    assert_eq!(summary["heading_from_the_photo"]["fixes"], 1, "{summary}");

    let other = msdi.join("data/calibrated_images/park");
    std::fs::create_dir(&other).unwrap();
    std::fs::copy(photo(2), other.join("a.jpg")).unwrap();
    eval(&msdi, "flight")
        .arg("--map")
        .arg(demo().join("map.tif"))
        .assert()
        .success();
    let frames = std::fs::read_to_string(folder.path().join("flight/frames.csv")).unwrap();
    assert!(
        frames.contains(",museum/a.jpg,") && frames.contains(",park/a.jpg,"),
        "{frames}"
    );
}
