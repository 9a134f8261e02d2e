#!/usr/bin/env python3
"""Makes the golden files of grimnet-photo. Needs numpy, opencv-python-headless and pillow.

palette.png, cmyk.jpg, progressive.jpg, subsampled.jpg: red, green, blue and white quarters, 64 x 64.
restart.jpg: the same in 256 x 256, with a restart marker after each row of MCUs.
warp.json: one smooth synthetic picture sampled by OpenCV's warpAffine and warpPerspective (double-checked against the
           formula, which has no quantised coordinates).
"""
import json
import pathlib

import cv2
import numpy as np
from PIL import Image

here = pathlib.Path(__file__).parent


def quarters():
    a = np.zeros((64, 64, 3), np.uint8)
    a[:32, :32] = (255, 0, 0)
    a[:32, 32:] = (0, 255, 0)
    a[32:, :32] = (0, 0, 255)
    a[32:, 32:] = 255
    return Image.fromarray(a)


q = quarters()
q.quantize(4).save(here / "palette.png")
q.convert("CMYK").save(here / "cmyk.jpg", quality=95)
q.save(here / "progressive.jpg", quality=95, progressive=True)
q.save(here / "subsampled.jpg", quality=95, subsampling=2)
q.resize((256, 256)).save(here / "restart.jpg", quality=90, subsampling=2, restart_marker_rows=1)


def smooth(width, height):
    """The picture of warp.rs's test: sines, written out in both places."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    return np.stack(
        [
            np.floor(127.5 + 120 * np.sin(x / 9.0) * np.cos(y / 13.0)),
            np.floor(127.5 + 120 * np.sin(x / 17.0 + y / 11.0)),
            np.floor(127.5 + 120 * np.cos(x / 23.0 - y / 7.0)),
        ],
        axis=-1,
    ).astype(np.uint8)


picture = smooth(160, 120)
cases = []
corner = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # continuous from index coordinates


def case(name, matrix, width, height):
    """`matrix`: continuous picture pixels from continuous output pixels."""
    index = np.linalg.inv(corner) @ matrix @ corner
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    if np.all(matrix[2, :2] == 0):
        out = cv2.warpAffine(picture, index[:2] / index[2, 2], (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    else:
        out = cv2.warpPerspective(picture, index, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    samples = []
    for y in range(1, height, 5):
        for x in range(1, width, 5):
            u, v, w = matrix @ (x + 0.5, y + 0.5, 1)
            u, v = u / w, v / w
            if w > 0 and 2 < u < 158 and 2 < v < 118:
                samples.append([x, y, *map(int, out[y, x])])
    assert len(samples) > 100, (name, len(samples))
    cases.append({"name": name, "matrix": matrix.ravel().tolist(), "size": [width, height], "samples": samples})


def about(angle, scale, centre_out, centre_in):
    c, s = np.cos(np.radians(angle)) * scale, np.sin(np.radians(angle)) * scale
    m = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    m[:2, 2] = np.array(centre_in) - m[:2, :2] @ centre_out
    return m


case("shift", np.array([[1, 0, 3.25], [0, 1, -2.5], [0, 0, 1.0]]), 160, 128)
case("turn by 33 degrees", about(33, 0.8, (80, 80), (80, 60)), 160, 160)
case("turn by 200 degrees, enlarged", about(200, 0.5, (80, 80), (70, 55)), 160, 160)
case(
    "perspective",
    about(10, 0.7, (80, 64), (80, 60)) + np.array([[0, 0, 0], [0, 0, 0], [4e-4, -1.1e-3, 0]]),
    160,
    128,
)
text = "[\n" + ",\n".join(json.dumps(c, separators=(",", ":")) for c in cases) + "\n]\n"
(here / "warp.json").write_text(text)
