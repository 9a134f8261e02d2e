//! `grim track` while the aircraft flies: links that are open before the first frame, and streams.

use std::fs;
use std::net::UdpSocket;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::{grim, pack};

#[test]
fn the_link_is_open_before_the_first_photo() {
    let folder = tempfile::tempdir().unwrap();
    let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
    let patience = Duration::from_secs(120);
    autopilot.set_read_timeout(Some(patience)).unwrap();
    let address = format!("udpout:{}", autopilot.local_addr().unwrap());
    let mut follower = Command::new(assert_cmd::cargo::cargo_bin("grim"))
        .args(["track", "--follow", "--mavlink", &address, "--pack"])
        .arg(pack())
        .arg(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let heard = autopilot.recv(&mut [0; 300]);
    follower.kill().unwrap();
    follower.wait().unwrap();
    assert!(heard.is_ok_and(|bytes| bytes > 0));
}

#[test]
fn sentences_without_the_time_of_day_are_refused_before_the_first_photo() {
    let folder = tempfile::tempdir().unwrap();
    grim()
        .args(["track", "--follow", "--fps", "2", "--nmea"])
        .args(["udpout:127.0.0.1:9", "--pack"])
        .arg(pack())
        .arg(folder.path())
        .timeout(Duration::from_secs(60))
        .assert()
        .code(2)
        .stderr(predicates::str::contains("time of day"));
}

#[test]
#[cfg(unix)]
fn a_stream_gives_its_newest_frames_and_a_recorded_video_all() {
    use std::os::unix::fs::PermissionsExt as _;

    const FRAMES: usize = 10;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let pictures = (1..=FRAMES).map(|number| fs::read(super::track::frame(number)).unwrap());
    fs::write(path("pictures"), pictures.collect::<Vec<_>>().concat()).unwrap();
    fs::write(path("flight.mkv"), "a video").unwrap();
    // In place of the decoder: gives all of them at once.
    let script = format!(
        "#!/bin/sh\necho \"$*\" > arguments\nexec /bin/cat '{}'\n",
        path("pictures").display()
    );
    fs::write(path("ffmpeg"), script).unwrap();
    fs::set_permissions(path("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    let track = |arguments: &[&str]| {
        let (lines, errors, _) = super::track::answers(
            grim()
                .current_dir(folder.path())
                .env("PATH", folder.path())
                .args(["track", "--pack"])
                .arg(pack())
                .args(arguments),
        );
        let last_s = lines.last().map(|line| line["time"].as_f64().unwrap());
        // At the default rate of 2 frames a second.
        assert_eq!(last_s, Some((FRAMES - 1) as f64 / 2.0), "{errors}");
        (lines.len(), errors)
    };
    let (frames, errors) = track(&["flight.mkv"]);
    assert_eq!(frames, FRAMES, "{errors}");
    // Rounded to the nearest, each picture would be the one shown almost half an interval after its time; an encoder with several threads
    // would hold the newest ones back.
    let arguments = fs::read_to_string(path("arguments")).unwrap();
    // A name may have a colon, and a radio link may be lost for longer than the 10 s that `ffmpeg` would take out of the times.
    for expected in [
        "-dts_delta_threshold 600 -i file:flight.mkv ",
        "fps=2:start_time=0:round=up,",
        "-c:v mjpeg -threads 1 ",
    ] {
        assert!(arguments.contains(expected), "{arguments}");
    }
    let stream = "rtsp://127.0.0.1/stream";
    let dry_run = ["--mavlink", "udpout:127.0.0.1:9", "--dry-run", stream];
    let (frames, errors) = track(&dry_run);
    assert!(frames < FRAMES, "{errors}");
    let dropped = format!("{} frames were dropped for newer ones", FRAMES - frames);
    assert!(errors.contains(&dropped), "{errors}");
    // How old its frames are is not known, or it is stated.
    let unknown = "give --frame-latency S";
    assert_eq!(errors.matches(unknown).count(), 1, "{errors}");
    let (_, errors) = track(&[&dry_run[..], &["--frame-latency", "0.3"]].concat());
    assert!(!errors.contains(unknown), "{errors}");
}

#[test]
#[cfg(unix)]
fn a_stream_that_gives_nothing_is_ended_together_with_its_decoder() {
    use std::os::unix::fs::PermissionsExt as _;
    use std::time::Instant;

    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let script = "#!/bin/sh\necho $$ > pid.new\n/bin/mv pid.new pid\nexec /bin/sleep 600\n";
    fs::write(path("ffmpeg"), script).unwrap();
    fs::set_permissions(path("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    let mut follower = Command::new(assert_cmd::cargo::cargo_bin("grim"))
        .current_dir(folder.path())
        .env("PATH", folder.path())
        .args(["track", "rtsp://127.0.0.1/stream", "--pack"])
        .arg(pack())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !path("pid").exists() && began.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(50));
    }
    let kill = |arguments: &str| {
        let mut shell = Command::new("/bin/sh");
        shell.args(["-c", &format!("kill {arguments}")]);
        shell.stderr(Stdio::null()).status().unwrap().success()
    };
    assert!(kill(&format!("-TERM {}", follower.id())));
    assert_eq!(follower.wait().unwrap().code(), Some(130));
    let decoder = fs::read_to_string(path("pid")).unwrap();
    assert!(!kill(&format!("-0 {decoder}")));
}
