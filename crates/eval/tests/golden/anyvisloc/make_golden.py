"""A scene in the shape of AnyVisLoc, as its publishers' reader (github.com/UAV-AVL/Benchmark: avl_data.py, avl_utils.py) takes it, and
what is to be read from it. Nothing here is of the data set: pictures are noise, numbers made up.

Run in this folder with numpy, pillow and pyproj; writes Scene_07/ and expected.json.
"""

import json
import math
import pathlib

import numpy as np
from PIL import Image
from pyproj import Geod

HERE = pathlib.Path(__file__).parent
SCENE = HERE / "Scene_07"
SCENE.mkdir(exist_ok=True)
rng = np.random.default_rng(7)


def noise(height, width):
    return rng.integers(0, 256, (height // 8 + 1, width // 8 + 1, 3), np.uint8).repeat(8, 0).repeat(8, 1)[:height, :width]


maps = {"aerial": ((96, 120), [2.5, 2.5], [0.0, 0.0]), "satellite": ((30, 40), [10.0, 10.0], [-20.0, -30.0])}
for name, (shape, _, _) in maps.items():
    Image.fromarray(noise(*shape)).save(SCENE / f"{name}_map.png")
modes = {
    name: {
        "map_path": f"{name}_map.png",
        "dsm_path": f"{name}_dsm.npy",
        "map_resolution": resolution,
        "dsm_resolution": [30.0, 30.0],
        "map_origin_local": origin,
        "dsm_origin_local": [0.0, 0.0],
    }
    for name, (_, resolution, origin) in maps.items()
}
(SCENE / "L07_reference.json").write_text(json.dumps({"scene_id": 7, "modes": modes}, indent=1) + "\n")

# Straight down; ahead to the north-east; past the horizon.
poses = {
    "L07_0001": ([150.0, 120.0, 80.0], [0.0, 0.0, 30.0]),
    "L07_0002": ([100.0, 150.0, 60.0], [1.5, 40.0, 45.0]),
    "L07_0003": ([100.0, 150.0, 60.0], [0.0, 88.0, 0.0]),
}
geod = Geod(ellps="WGS84")


def lon_lat(x, y):
    """The plane onto the ellipsoid at (0, 0): x to the east, y to the south."""
    lon, lat, _ = geod.fwd(0.0, 0.0, math.degrees(math.atan2(x, -y)), math.hypot(x, y))
    return [lon, lat]


expected = {"frames": [], "corners": {}}
for i, (name, (xyz, euler)) in enumerate(poses.items()):
    save, kind = (np.savez, np.float64) if i == 0 else (np.savez_compressed, np.float32)
    save(
        SCENE / f"{name}.npz",
        image=noise(48, 64),
        K=np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]], kind),
        dist=np.zeros(5, kind),
        xyz=np.array(xyz, kind),
        euler_deg=np.array(euler, kind),
        sample_id=np.array(name),
        scene_id=np.array(7),
    )
    # As view_center_anyvisloc.
    x, y, z = xyz
    yaw, ahead = math.radians(euler[2]), z * math.tan(math.radians(euler[1]))
    centre = lon_lat(x + ahead * math.sin(yaw), y - ahead * math.cos(yaw))
    if euler[1] < 80:
        expected["frames"].append({"photo": f"{name}.jpg", "centre": centre, "camera": lon_lat(x, y), "heading_deg": euler[2]})
for name, ((height, width), (rx, ry), (x, y)) in maps.items():
    expected["corners"][name] = lon_lat(x, y + ry * height) + lon_lat(x + rx * width, y)
(HERE / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")
