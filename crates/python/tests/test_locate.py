"""`Localizer.locate` gives the program's answers."""

import inspect
import math
import os
import pathlib
import pickle
import threading
import time

import grimnet
import numpy as np
import pytest


def without(answer, *names):
    return {name: value for name, value in answer.items() if name not in ("time_ms", *names)}


def distance_m(a, b):
    north = math.radians(a["lat_deg"] - b["lat_deg"]) * 6_371_000
    east = math.radians(a["lon_deg"] - b["lon_deg"]) * 6_371_000 * math.cos(math.radians(b["lat_deg"]))
    return math.hypot(north, east)


@pytest.mark.parametrize("heading", [None, "unknown", 95.0])
def test_same_numbers_as_the_program(localizer, pack, photos, json_lines, heading):
    options = [] if heading is None else ["--heading", heading]
    for line in json_lines("locate", "--pack", pack, "--format", "jsonl", *options, *photos):
        path = line["photo"]
        answer = localizer.locate(path, heading=heading)
        assert without(answer.to_dict()) == without(line)
        assert list(answer.to_dict()) == list(line), "the fields stand in the same order"
        assert set(answer.time_ms) == set(line["time_ms"])
        from_bytes = localizer.locate(pathlib.Path(path).read_bytes(), heading=heading)
        assert without(from_bytes.to_dict(), "photo") == without(line, "photo")
        assert from_bytes.photo == "bytes"


def test_all_prior_values_reach_the_search(localizer, pack, photos, truth, json_lines):
    true = truth[photos[0].name]
    near = (true["lat_deg"], true["lon_deg"], 150.0)
    known = {"heading": true["heading_deg"], "height_agl_m": true["height_agl_m"], "hfov_deg": 70.0, "near": near}
    options = ["--heading", true["heading_deg"], "--height-agl", true["height_agl_m"], "--hfov", 70, "--near", ",".join(map(str, near))]
    (line,) = json_lines("locate", "--pack", pack, "--format", "jsonl", *options, photos[0])
    answer = localizer.locate(photos[0], **known)
    assert without(answer.to_dict()) == without(line)
    # Also as JSON and numpy have it.
    for same in (list(near), np.array(near)):
        assert without(localizer.locate(photos[0], **{**known, "near": same}).to_dict()) == without(line)
    coarse = localizer.locate(photos[0], gsd_m=0.12)
    assert any("0.12" in text for text in coarse.used), coarse.used


def test_fields_of_a_fix(localizer, photos, truth):
    fix = localizer.locate(os.fspath(photos[0]))
    assert isinstance(fix, grimnet.Fix) and fix and fix.state == "fix"
    as_dict = fix.to_dict()
    ee, en, nn = as_dict["covariance_en_m2"]
    assert fix.covariance_en_m2.tolist() == [[ee, en], [en, nn]]
    assert fix.covariance_en_m2.dtype == np.float64
    assert fix.outline_lon_lat_deg.tolist() == as_dict["outline_lon_lat_deg"]
    for name in ("lat_deg", "lon_deg", "heading_deg", "gsd_m", "radius95_m", "confidence", "inliers", "matches", "runner_up_inliers", "photo", "assumed"):
        assert getattr(fix, name) == as_dict[name], name
    assert repr(fix).startswith("Fix(") and f"{fix.lat_deg:.7f}" in repr(fix)
    assert distance_m(as_dict, truth[photos[0].name]) < 5.0
    with pytest.raises(AttributeError):
        fix.lat_deg = 0.0
    assert pickle.loads(pickle.dumps(fix)) == fix
    assert grimnet.Fix.from_json(fix.to_json()) == fix
    with pytest.raises(grimnet.InvalidValueError):
        grimnet.NoFix.from_json(fix.to_json())


def test_no_fix_says_why(localizer, pack, photos, json_lines):
    (line,) = json_lines("locate", "--pack", pack, "--format", "jsonl", "--near", "60,10,100", photos[0])
    answer = localizer.locate(photos[0], near=(60.0, 10.0, 100.0))
    assert isinstance(answer, grimnet.NoFix) and not answer and answer.state == "no_fix"
    assert without(answer.to_dict()) == without(line)
    assert answer.reason == line["reason"] and answer.reason in repr(answer)
    assert pickle.loads(pickle.dumps(answer)) == answer
    uniform = localizer.locate(np.full((600, 800, 3), 128, np.uint8))
    assert not uniform and "texture" in uniform.reason


def test_arrays(localizer, photos, truth):
    rgb = grimnet.read_photo(photos[0])
    assert rgb.dtype == np.uint8 and rgb.ndim == 3 and rgb.shape[2] == 3 and rgb.flags.c_contiguous
    true = truth[photos[0].name]
    known = {"heading": true["heading_deg"], "height_agl_m": true["height_agl_m"], "hfov_deg": 70.0}
    answer = localizer.locate(rgb, **known)
    assert answer.photo == "array" and distance_m(answer.to_dict(), true) < 25.0
    # As OpenCV has it, and as numpy keeps columns: copied, not refused, with the same answer.
    bgr = np.ascontiguousarray(rgb[:, :, ::-1])
    rgba = np.dstack([rgb, rgb[:, :, :1]])
    wide = np.hstack([bgr, bgr])
    layouts = (
        bgr[:, :, ::-1],
        np.asfortranarray(rgb),
        np.asfortranarray(bgr)[:, :, ::-1],
        np.repeat(rgb, 2, axis=0)[::2],
        np.repeat(rgb, 2, axis=1)[:, ::2],
        np.ascontiguousarray(rgb.transpose(2, 0, 1)).transpose(1, 2, 0),
        np.ascontiguousarray(rgb.transpose(1, 0, 2)).transpose(1, 0, 2),
        np.ascontiguousarray(rgb[::-1, ::-1])[::-1, ::-1],
        rgba[:, :, :3],
        wide[:, : rgb.shape[1], ::-1],
    )
    for same in layouts:
        assert not same.flags.c_contiguous
        assert without(localizer.locate(same, **known).to_dict()) == without(answer.to_dict())
    before = rgb.copy()
    rgb.setflags(write=False)
    localizer.locate(rgb, **known)
    assert np.array_equal(rgb, before)
    # What numpy makes an array of, as Pillow's pictures.
    class Picture:
        __array_interface__ = before.__array_interface__
    assert without(localizer.locate(Picture(), **known).to_dict()) == without(answer.to_dict())
    reduced = grimnet.read_photo(photos[0].read_bytes(), max_side_px=300)
    assert max(grimnet.read_photo(grimnet.read_photo(photos[0]), max_side_px=200).shape) == 200
    with pytest.raises(grimnet.InvalidValueError, match="max_side_px is 0"):
        grimnet.read_photo(photos[0], max_side_px=0)
    assert max(reduced.shape) == 300


def test_wrong_input_is_an_error(localizer, photos, tmp_path):
    rgb = np.zeros((64, 64, 3), np.uint8)
    for bad in (rgb.astype(np.float32), rgb[:, :, 0], rgb[:, :, :2], np.zeros((3, 64, 64), np.uint8), rgb[:4]):
        with pytest.raises(grimnet.InvalidValueError):
            localizer.locate(bad)
    with pytest.raises(ValueError, match=r"\(64, 64, 3\).*float32.*height x width x 3 of uint8"):
        localizer.locate(rgb.astype(np.float32))
    for bad, advice in ((rgb[:, :, 0], r"numpy\.dstack"), (np.zeros((64, 64, 4), np.uint8), "fourth band")):
        with pytest.raises(grimnet.InvalidValueError, match=advice):
            localizer.locate(bad)

    class Hsv:
        """A picture of Pillow."""

        mode = "HSV"
        __array_interface__ = rgb.__array_interface__

    with pytest.raises(grimnet.InvalidValueError, match="mode HSV is no photo"):
        localizer.locate(Hsv())
    for bad in (None, 3, ["a.jpg"]):
        with pytest.raises(TypeError, match="a path, the bytes"):
            localizer.locate(bad)
    with pytest.raises(grimnet.PhotoError, match="nowhere.jpg"):
        localizer.locate(tmp_path / "nowhere.jpg")
    # 2.7 GB, of which the copy is refused.
    with pytest.raises(grimnet.PhotoError, match="30000 x 30000 px .*an orthophoto is a map"):
        localizer.locate(np.broadcast_to(np.uint8(7), (30_000, 30_000, 3)))
    with pytest.raises(grimnet.PhotoError):
        localizer.locate(b"not a picture")
    (tmp_path / "half.jpg").write_bytes(photos[0].read_bytes()[:5000])
    with pytest.raises(grimnet.PhotoError, match="half.jpg"):
        localizer.locate(tmp_path / "half.jpg")
    bad_priors = (
        {"heading": "north"},
        {"heading": float("nan")},
        {"heading_sigma_deg": 3.0},
        {"heading": 3.0, "heading_sigma_deg": -1.0},
        {"heading": 3.0, "heading_sigma_deg": 0.0},
        {"heading": 3.0, "heading_sigma_deg": 181.0},
        {"hfov_deg": 180.0},
        {"height_agl_m": -1.0},
        {"gsd_m": 0.1, "hfov_deg": 70.0},
        {"near": (120.0, 24.0, 500.0)},
    )
    for bad in bad_priors:
        with pytest.raises(grimnet.InvalidValueError):
            localizer.locate(photos[0], **bad)
    for bad in ({"near": (24.0, 120.0)}, {"near": "1,2,3"}, {"hfov_deg": "wide"}):
        with pytest.raises((TypeError, ValueError)):
            localizer.locate(photos[0], **bad)
    with pytest.raises(TypeError):
        localizer.locate(photos[0], 90.0)


def test_packs_and_models_that_cannot_be_used(pack, photos, demo, tmp_path):
    for bad in (tmp_path / "nowhere.grim", photos[0]):
        with pytest.raises(grimnet.PackError):
            grimnet.Localizer(bad)
    with pytest.raises(grimnet.ModelError):
        grimnet.Localizer(pack, model=demo / "truth.csv")
    with pytest.raises(grimnet.InvalidValueError, match="map_error_m"):
        grimnet.Localizer(pack, map_error_m=-1.0)
    for kind in (grimnet.PhotoError, grimnet.PackError, grimnet.MapError, grimnet.ModelError, grimnet.InvalidValueError):
        assert issubclass(kind, grimnet.GrimnetError)
    assert issubclass(grimnet.InvalidValueError, ValueError)


def test_options_of_a_localizer(pack, photos, localizer):
    exact = grimnet.Localizer(pack, map_error_m=0.0).locate(photos[0])
    difference = localizer.locate(photos[0]).covariance_en_m2 - exact.covariance_en_m2
    assert np.allclose(difference, np.eye(2), atol=1e-5), "the map's error of 1 m per axis"
    strict = grimnet.Localizer(pack, min_confidence=1.0).locate(photos[0])
    assert not strict and "confidence" in strict.reason
    assert isinstance(localizer.pack, pathlib.Path) and localizer.pack == pack
    assert localizer.levels_gsd_m == sorted(localizer.levels_gsd_m)


def test_precision_is_that_of_the_program(localizer, pack, photos, json_lines):
    int8 = grimnet.Localizer(pack, precision="int8")
    (line,) = json_lines("locate", "--pack", pack, "--precision", "int8", "--format", "jsonl", photos[0])
    answer = int8.locate(photos[0])
    assert without(answer.to_dict()) == without(line)
    f32 = localizer.locate(photos[0])
    assert without(answer.to_dict()) != without(f32.to_dict()), "int8 changes descriptors"
    assert without(grimnet.Localizer(pack, precision="f32").locate(photos[0]).to_dict()) == without(f32.to_dict())
    with pytest.raises(grimnet.InvalidValueError, match='precision is "f16"; expected "mixed" or "f32" or "int8"'):
        grimnet.Localizer(pack, precision="f16")


def test_threads_share_a_localizer(localizer, photos):
    expected = [without(localizer.locate(path).to_dict()) for path in photos]
    found = {}

    def work(number):
        found[number] = [without(localizer.locate(path).to_dict()) for path in photos]

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert list(found.values()) == [expected] * 4


def test_other_threads_run_during_a_search(localizer, photos):
    ticks, ended = [], threading.Event()

    def tick():
        while not ended.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        begin = time.perf_counter()
        localizer.locate(photos[0], heading="unknown")
        end = time.perf_counter()
    finally:
        ended.set()
        thread.join()
    # Without release of the interpreter lock there is none but at the edges.
    edge = 0.1 * (end - begin)
    assert any(begin + edge < at < end - edge for at in ticks)


def test_help_names_every_argument():
    extractor = grimnet.FeatureExtractor
    for documented in (grimnet.Localizer, grimnet.Localizer.locate, grimnet.Tracker, extractor, extractor.features, grimnet.build_pack):
        for name in inspect.signature(documented).parameters:
            # What the first sentence speaks of.
            if name not in ("self", "pack", "localizer", "picture", "map"):
                assert f"`{name}`" in documented.__doc__, f"{documented.__name__}: {name}"
