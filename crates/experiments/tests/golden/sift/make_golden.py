"""Keypoints, descriptors and matches of OpenCV's SIFT on three pairs of pictures.

Run in this folder with numpy and opencv-python (4.10 or later): for each pair it reads or makes PAIR_a.png and PAIR_b.png, and writes
PAIR_keypoints_{a,b}.csv, PAIR_descriptors_{a,b}.bin and PAIR_matches.csv.

- `drawn`: boxes and texture; the second picture is the first, turned by 35 degrees and reduced to 0.8 about the centre, with other light
  and noise.
- `photographed`: a part of NASA's portrait of Eileen Collins (public domain; `skimage.data.astronaut()`), and the same turned, reduced and
  in other light. The first picture is kept; where it is missing, scikit-image is needed.
- `rendered`: a place of the procedural world, in its map and in a photo of a flight over it, with parallax, other light and JPEG. The
  pictures are kept; to cut them anew (rasterio needed): `grim demo --photos 3 -o DEMO`, then `python make_golden.py DEMO`.
"""

import pathlib
import sys

import cv2
import numpy as np

SIDE = 224
RENDERED_PHOTO = "flight_002.jpg"


def grey(picture):
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def draw():
    rng = np.random.default_rng(2004)
    picture = np.full((SIDE, SIDE), 110, np.float32)
    for _ in range(90):
        x, y = rng.uniform(0, SIDE, 2)
        w, h = rng.uniform(4, 26, 2)
        box = cv2.boxPoints(((x, y), (w, h), rng.uniform(0, 90)))
        cv2.fillConvexPoly(picture, np.round(box).astype(np.int32), float(rng.uniform(20, 235)))
    texture = cv2.GaussianBlur(rng.normal(0, 60, picture.shape).astype(np.float32), (0, 0), 2.5)
    first = cv2.GaussianBlur(picture, (0, 0), 0.8) + texture
    cv2.imwrite("drawn_a.png", grey(first))
    cv2.imwrite("drawn_b.png", grey(turned(first, rng)))


def turned(picture, rng):
    centre = ((SIDE - 1) / 2, (SIDE - 1) / 2)
    turn = cv2.getRotationMatrix2D(centre, 35, 0.8)
    second = cv2.warpAffine(picture, turn, (SIDE, SIDE), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT_101)
    return second * 0.85 + 20 + rng.normal(0, 2, second.shape)


def photograph():
    if not pathlib.Path("photographed_a.png").exists():
        from skimage import data

        whole = cv2.cvtColor(data.astronaut(), cv2.COLOR_RGB2GRAY)
        cv2.imwrite("photographed_a.png", whole[:SIDE, 140 : 140 + SIDE])
    first = cv2.imread("photographed_a.png", cv2.IMREAD_GRAYSCALE).astype(np.float32)
    cv2.imwrite("photographed_b.png", grey(turned(first, np.random.default_rng(1999))))


def cut(demo):
    import csv
    import math

    import rasterio.warp
    import rasterio.windows

    with open(demo / "truth.csv") as file:
        truth = next(row for row in csv.DictReader(file) if row["photo"] == RENDERED_PHOTO)
    with rasterio.open(demo / "map.tif") as dataset:
        at = rasterio.warp.transform("EPSG:4326", dataset.crs, [float(truth["lon_deg"])], [float(truth["lat_deg"])])
        row, column = dataset.index(at[0][0], at[1][0])
        window = rasterio.windows.Window(column - SIDE // 2, row - SIDE // 2, SIDE, SIDE)
        tile = dataset.read([1, 2, 3], window=window).transpose(1, 2, 0)
        gsd_m = dataset.res[0]
    photo = cv2.imread(str(demo / "photos" / RENDERED_PHOTO))
    # The demo's camera sees 70 degrees across.
    width = round(2 * float(truth["height_agl_m"]) * math.tan(math.radians(35)) / gsd_m)
    photo = cv2.resize(photo, (width, round(width * photo.shape[0] / photo.shape[1])), interpolation=cv2.INTER_AREA)
    y, x = (photo.shape[0] - SIDE) // 2, (photo.shape[1] - SIDE) // 2
    cv2.imwrite("rendered_a.png", cv2.cvtColor(tile, cv2.COLOR_RGB2GRAY))
    cv2.imwrite("rendered_b.png", cv2.cvtColor(photo[y : y + SIDE, x : x + SIDE], cv2.COLOR_BGR2GRAY))


def features(pair, name):
    picture = cv2.imread(f"{pair}_{name}.png", cv2.IMREAD_GRAYSCALE)
    keypoints, descriptors = cv2.SIFT_create(enable_precise_upscale=True).detectAndCompute(picture, None)
    with open(f"{pair}_keypoints_{name}.csv", "w") as out:
        out.write("x_px,y_px,sigma_px,angle_deg,response\n")
        for k in keypoints:
            out.write(f"{k.pt[0]:.4f},{k.pt[1]:.4f},{k.size / 2:.4f},{k.angle:.3f},{k.response:.6f}\n")
    descriptors.astype(np.uint8).tofile(f"{pair}_descriptors_{name}.bin")
    return keypoints, descriptors


def oracle(pair):
    (ka, da), (kb, db) = features(pair, "a"), features(pair, "b")
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(da, db, k=2)
    kept = [m for m, n in matches if m.distance < 0.8 * n.distance]
    with open(f"{pair}_matches.csv", "w") as out:
        out.write("ax_px,ay_px,bx_px,by_px\n")
        for m in kept:
            a, b = ka[m.queryIdx].pt, kb[m.trainIdx].pt
            out.write(f"{a[0]:.3f},{a[1]:.3f},{b[0]:.3f},{b[1]:.3f}\n")
    ends = [np.float32([k[i].pt for i in index]) for k, index in ((ka, [m.queryIdx for m in kept]), (kb, [m.trainIdx for m in kept]))]
    _, inside = cv2.findHomography(*ends, cv2.RANSAC, 3.0)
    print(pair, len(ka), len(kb), "matches", len(kept), "of one homography", int(inside.sum()))


draw()
photograph()
if len(sys.argv) > 1:
    cut(pathlib.Path(sys.argv[1]))
for pair in ("drawn", "photographed", "rendered"):
    oracle(pair)
print("OpenCV", cv2.__version__)
