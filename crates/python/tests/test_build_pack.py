"""`build_pack` makes the program's packs, tells its progress, and can be ended."""

import os
import pathlib
import signal
import subprocess
import sys

import grimnet
import pytest

GSD_M = 1.2


def test_same_bytes_as_the_program(grim, demo, tmp_path):
    out = tmp_path / "own.grim"
    reported = []
    report = grimnet.build_pack(demo / "map.tif", out, gsd_m=GSD_M, progress=reported.append)
    subprocess.run([grim, "map", "build", demo / "map.tif", "-o", tmp_path / "its.grim", "--gsd", str(GSD_M)], check=True, stdout=subprocess.DEVNULL)
    assert out.read_bytes() == (tmp_path / "its.grim").read_bytes()
    assert report.tiles > 0 and report.len_bytes == out.stat().st_size and not report.was_complete
    assert isinstance(report.path, pathlib.Path) and report.path == out
    done = [progress.tiles_done for progress in reported]
    assert done == sorted(done) and done[-1] == reported[-1].tiles_total
    assert {progress.phase for progress in reported} == {"tiles", "writing"}
    assert reported[0].gsd_m == GSD_M
    again = grimnet.build_pack(demo / "map.tif", out, gsd_m=[GSD_M])
    assert again.was_complete
    assert grimnet.Localizer(out).levels_gsd_m == [GSD_M]


def test_precision_is_that_of_the_program(grim, demo, tmp_path):
    made = {}
    for precision in ("mixed", "f32", "int8"):
        out, its = tmp_path / f"own-{precision}.grim", tmp_path / f"its-{precision}.grim"
        grimnet.build_pack(demo / "map.tif", out, gsd_m=GSD_M, precision=precision)
        command = [grim, "map", "build", demo / "map.tif", "-o", its, "--gsd", str(GSD_M), "--precision", precision]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        made[precision] = out.read_bytes()
        assert made[precision] == its.read_bytes()
    assert made["mixed"] == made["f32"] != made["int8"]
    with pytest.raises(grimnet.InvalidValueError, match="precision"):
        grimnet.build_pack(demo / "map.tif", tmp_path / "none.grim", precision="f16")


def test_warnings_of_the_library_are_logged(demo, tmp_path, caplog):
    # A shift to WGS 84 of three parameters, and not the system that the map's file states.
    grimnet.build_pack(demo / "map.tif", tmp_path / "area.grim", gsd_m=GSD_M, crs="EPSG:23032")
    records = [record for record in caplog.records if record.name == "grimnet"]
    assert {record.levelname for record in records} == {"WARNING"}
    assert any("positions can be off by tens of metres" in record.getMessage() for record in records)
    assert any("the file itself states EPSG:" in record.getMessage() for record in records)


def test_an_exception_in_the_callback_ends_the_build(demo, tmp_path):
    out = tmp_path / "area.grim"

    def stop(progress):
        if progress.tiles_done > 0:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        grimnet.build_pack(demo / "map.tif", out, gsd_m=GSD_M, progress=stop)
    assert not out.exists() and pathlib.Path(f"{out}.partial").exists()
    report = grimnet.build_pack(demo / "map.tif", out, gsd_m=GSD_M)
    assert report.tiles_resumed > 0
    assert not pathlib.Path(f"{out}.partial").exists()


def test_what_is_not_replaced(demo, tmp_path):
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    with pytest.raises(grimnet.PackError, match="notes.txt"):
        grimnet.build_pack(demo / "map.tif", notes, gsd_m=GSD_M)
    assert notes.read_text() == "mine"
    copy = tmp_path / "map.tif"
    copy.write_bytes((demo / "map.tif").read_bytes())
    before = copy.stat().st_size
    with pytest.raises(grimnet.PackError):
        grimnet.build_pack(copy, copy, gsd_m=GSD_M, overwrite=True)
    assert copy.stat().st_size == before


def test_maps_that_cannot_be_used(demo, tmp_path, photos):
    with pytest.raises(grimnet.MapError, match="nowhere.tif"):
        grimnet.build_pack(tmp_path / "nowhere.tif", tmp_path / "a.grim")
    with pytest.raises(grimnet.MapError):
        grimnet.build_pack(photos[0], tmp_path / "a.grim")
    with pytest.raises(grimnet.GrimnetError):
        grimnet.build_pack(demo / "map.tif", tmp_path / "a.grim", gsd_m=-1.0)
    for gsd_m in ("0.3", b"x", [0.3, None]):
        with pytest.raises(grimnet.InvalidValueError, match="expected metres per pixel, a number or several"):
            grimnet.build_pack(demo / "map.tif", tmp_path / "a.grim", gsd_m=gsd_m)
    with pytest.raises(ValueError):
        grimnet.build_pack(photos[0], tmp_path / "a.grim", corners=(1.0, 2.0, 3.0))
    for zoom in (-1, 256):
        with pytest.raises(grimnet.InvalidValueError, match=f"zoom is {zoom}; expected a whole number from 0 to 255"):
            grimnet.build_pack(demo / "map.tif", tmp_path / "a.grim", zoom=zoom)
    assert list(tmp_path.glob("*.grim")) == []


# A process that a shell starts in the background ignores SIGINT, and so do its children: Python then installs no handler of its own.
AS_IN_A_TERMINAL = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
INTERRUPTED = {
    "build": """
import sys, grimnet
def tell(progress):
    if progress.tiles_done:
        print("begun", flush=True)
grimnet.build_pack(sys.argv[1] + "/map.tif", sys.argv[2], gsd_m=0.6, progress=tell)
print("done", flush=True)
""",
    "locate": """
import sys, grimnet
localizer = grimnet.Localizer(sys.argv[1] + "/area.grim")
print("begun", flush=True)
while True:
    localizer.locate(sys.argv[1] + "/photos/flight_001.jpg")
""",
}


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("work", INTERRUPTED)
def test_ctrl_c(demo, tmp_path, work):
    out = tmp_path / "area.grim"
    command = [sys.executable, "-c", AS_IN_A_TERMINAL + INTERRUPTED[work], demo, out]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n", process.stderr.read()
    process.send_signal(signal.SIGINT)
    # The limit is a watchdog.
    printed, errors = process.communicate(timeout=120)
    assert "KeyboardInterrupt" in errors and "done" not in printed
    assert not out.exists()
    if work == "build":
        assert pathlib.Path(f"{out}.partial").exists(), "the work so far is kept"


def test_mbtiles_are_maps(tmp_path):
    town = pathlib.Path(__file__).parents[2] / "geo" / "tests" / "sources" / "maps" / "town.mbtiles"
    report = grimnet.build_pack(town, tmp_path / "town.grim", gsd_m=2.0)
    assert report.tiles > 0
    assert grimnet.Localizer(tmp_path / "town.grim").levels_gsd_m == [2.0]


def test_zoom_is_that_of_the_program(grim, demo, tmp_path):
    town = pathlib.Path(__file__).parents[2] / "geo" / "tests" / "sources" / "maps" / "town_xyz"
    out, its = tmp_path / "own.grim", tmp_path / "its.grim"
    grimnet.build_pack(town, out, gsd_m=2.0, zoom=16)
    subprocess.run([grim, "map", "build", town, "-o", its, "--gsd", "2.0", "--zoom", "16"], check=True, stdout=subprocess.DEVNULL)
    assert out.read_bytes() == its.read_bytes()
    with pytest.raises(grimnet.MapError, match="zooms 15, 16, 17"):
        grimnet.build_pack(town, tmp_path / "none.grim", zoom=12)
    with pytest.raises(grimnet.MapError, match="give no zoom"):
        grimnet.build_pack(demo / "map.tif", tmp_path / "none.grim", zoom=16)
