#!/usr/bin/env python3
"""Makes the golden files of grimnet-jpeg: small JPEGs, and libjpeg-turbo's decoding of them at 1/2, 1/4 and 1/8. Needs numpy and
pillow (which decodes with libjpeg-turbo; `draft` is its scale_denom), and jpegtran (Debian's libjpeg-turbo-progs)."""
import pathlib
import subprocess
import tempfile

import numpy as np
from PIL import Image

here = pathlib.Path(__file__).parent


def picture(width, height):
    """Waves, an edge and some noise, so that all frequencies occur."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    noise = np.random.default_rng(5).normal(0, 6, (height, width, 1))
    colours = np.stack(
        [
            120 + 70 * np.sin(x / 5.0) * np.cos(y / 9.0),
            130 + 60 * np.sin(x / 17.0 + y / 11.0),
            110 + 60 * np.cos(x / 23.0 - y / 7.0),
        ],
        axis=-1,
    )
    colours[(x > width * 0.6) & (y > x * 0.5)] *= 0.5
    return Image.fromarray(np.clip(colours + noise, 0, 255).astype(np.uint8))


def make(name, size, grey=False, **options):
    source = picture(*size)
    source = source.convert("L") if grey else source
    path = here / f"{name}.jpg"
    source.save(path, **options)
    for divisor in (2, 4, 8):
        with Image.open(path) as image:
            image.draft(None, (size[0] // divisor, size[1] // divisor))
            expected = tuple(-(-side // divisor) for side in size)
            assert image.size == expected, (name, image.size, expected)
            image.convert("RGB").save(here / f"{name}_{divisor}.png", optimize=True)


make("444", (97, 61), quality=90, subsampling="4:4:4")
make("422", (101, 59), quality=92, subsampling="4:2:2")
make("420", (115, 83), quality=85, subsampling="4:2:0")
make("grey", (73, 90), grey=True, quality=88)
make("restart", (160, 96), quality=80, subsampling="4:2:0", restart_marker_rows=1)
make("optimised", (128, 64), quality=97, subsampling="4:2:0", optimize=True)

# Each colour in a scan of its own.
for name in ("444", "420"):
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as scans:
        scans.write("0; 1; 2;")
        scans.flush()
        to = here / f"{name}_scans.jpg"
        subprocess.run(["jpegtran", "-scans", scans.name, "-outfile", to, here / f"{name}.jpg"], check=True)
