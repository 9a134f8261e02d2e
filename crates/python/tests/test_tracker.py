"""`Tracker` gives the lines of `grim track`."""

import datetime
import math

import grimnet
import numpy as np
import pytest

FRAMES = 10


@pytest.fixture(scope="module")
def lines(demo, pack, json_lines):
    frames = sorted((demo / "flight").glob("*.jpg"))[:FRAMES]
    return json_lines("track", "--pack", pack, "--format", "jsonl", *frames)


def seconds(line):
    return datetime.datetime.fromisoformat(line["time"].replace("Z", "+00:00")).timestamp()


def test_same_track_as_the_program(localizer, lines):
    tracker = grimnet.Tracker(localizer)
    states = set()
    for line in lines:
        point = tracker.frame(line["photo"], seconds(line))
        states.add(point.state)
        for name, value in point.to_dict().items():
            assert getattr(point, name) is not None or value is None
            if name == "heading_sigma_deg":
                # Not in the line.
                assert (value is None) == (point.heading_deg is None)
            elif name == "time_s":
                assert value == seconds(line)
            elif value is None or isinstance(value, str):
                assert value == line[name], name
            else:
                # The line is rounded.
                assert np.allclose(value, line[name], rtol=0, atol=1e-2 if "deg" not in name or name == "heading_deg" else 1e-8), name
        assert point.answer.state == line["frame"]
    assert "tracking" in states
    assert point.covariance_en_m2.shape == (2, 2)
    later = tracker.point_at(seconds(lines[-1]) + 0.5)
    assert later.answer is None and later.radius95_m > point.radius95_m
    assert "tracking" in repr(point)


def test_one_exposure_given_again_is_no_more_evidence(localizer, lines):
    tracker = grimnet.Tracker(localizer)
    for _ in range(5):
        point = tracker.frame(lines[0]["photo"], seconds(lines[0]))
        assert point.answer.state == "fix" and point.state == "searching"


def test_a_frame_with_a_wrong_value_never_reaches_its_track(localizer, lines):
    tracker, other = grimnet.Tracker(localizer), grimnet.Tracker(localizer)
    for line in lines[:6]:
        at = seconds(line)
        with pytest.raises(grimnet.InvalidValueError, match="height_agl_m is 50000"):
            tracker.frame(line["photo"], at, height_agl_m=50_000.0)
        assert tracker.frame(line["photo"], at).to_dict() == other.frame(line["photo"], at).to_dict()


def test_telemetry_that_fixes_contradict_is_warned_of(localizer, lines):
    tracker = grimnet.Tracker(localizer)
    for line in lines[:6]:
        at = seconds(line)
        tracker.push_gimbal(at, yaw_deg=99.0, pitch_deg=-60.0, roll_deg=0.0)
        tracker.frame(line["photo"], at, heading="unknown")
    (warning,) = tracker.warnings()
    assert "-30 degrees of pitch" in warning


def test_a_mount_turns_the_attitude_of_the_aircraft(localizer, lines):
    turned, plain = grimnet.Tracker(localizer, camera_mount=[180, -90]), grimnet.Tracker(localizer)
    for line in lines[:6]:
        at = seconds(line)
        turned.push_height(at, agl_m=110.0)
        plain.push_height(at, agl_m=110.0)
        turned.push_attitude(at, yaw_deg=279.0, pitch_deg=-2.0, roll_deg=1.0)
        plain.push_attitude(at, yaw_deg=99.0, pitch_deg=2.0, roll_deg=-1.0)
        points = [tracker.frame(line["photo"], at) for tracker in (turned, plain)]
    assert points[0].position_of == "aircraft"
    assert np.allclose(*((point.lat_deg, point.lon_deg) for point in points), rtol=0, atol=1e-9)
    with pytest.raises(grimnet.InvalidValueError, match="camera_mount is 0,-5"):
        grimnet.Tracker(localizer, camera_mount=(0, -5))


def test_telemetry_is_taken_in(localizer, lines):
    tracker = grimnet.Tracker(localizer, vehicle="plane", start=(1.0, 1.5, 2000.0), focal_length_px=1000.0)
    for line in lines[:4]:
        at = seconds(line)
        tracker.push_height(at, agl_m=110.0, amsl_m=140.0)
        tracker.push_velocity(at, east_m_s=13.8, north_m_s=-2.3, sigma_m_s=0.5)
        tracker.push_gimbal(at, yaw_deg=90.0, pitch_deg=-90.0, roll_deg=0.0)
        point = tracker.frame(line["photo"], at)
    assert point.altitude_amsl_m in (140.0, None)
    assert tracker.warnings() == []
    tracker.push_attitude(at + 0.1, yaw_deg=90.0, pitch_deg=0.0, roll_deg=0.0)
    for bad in (
        lambda: tracker.push_height(math.nan, agl_m=100.0),
        lambda: tracker.push_height(at, agl_m=-1.0),
        lambda: tracker.push_velocity(at - 1e6, east_m_s=0.0, north_m_s=0.0, sigma_m_s=1.0),
        lambda: tracker.frame(lines[0]["photo"], math.inf),
        lambda: grimnet.Tracker(localizer, vehicle="ship"),
    ):
        with pytest.raises(grimnet.InvalidValueError):
            bad()
    with pytest.raises(grimnet.PhotoError):
        tracker.frame("nowhere.jpg", at)
    # By the name of the argument that is wrong.
    with pytest.raises(grimnet.InvalidValueError, match="pitch_deg is inf"):
        tracker.push_gimbal(at, yaw_deg=0.0, pitch_deg=math.inf, roll_deg=0.0)
    with pytest.raises(grimnet.InvalidValueError, match=r"lat_deg is 120; expected in \[-90, 90\]"):
        grimnet.Tracker(localizer, start=(120.0, 24.0, 50.0))
    with pytest.raises(grimnet.InvalidValueError, match="lon_deg is NaN"):
        grimnet.Tracker(localizer, start=(1.0, math.nan, 50.0))
