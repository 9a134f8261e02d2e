"""Puts a map among other pictures, so that retrieval among thousands of tiles can be measured with a small data set.

Usage: large_map.py FOLDER PICTURES... --out LARGE [--side-px 20800x18400] [--seed 5]
FOLDER is laid out as for `grim eval`: map.tif (a projected GeoTIFF), photos/, truth.csv. The map stays in the upper left corner with its
georeference; the pictures below the PICTURES folders, each at its own pixels, fill the rest in a random order of the seed, larger ones
first. LARGE gets map.tif, truth.csv and a link to the photos. Needs numpy, pillow, tifffile and imagecodecs.
"""
import argparse
import pathlib
import random
import shutil

import numpy as np
import tifffile
from PIL import Image

CELL_PX = 400
# GDAL's and GeoTIFF's tags: scale, tiepoint, transform, keys, doubles, text.
GEO_TAGS = {33550: 12, 33922: 12, 34264: 12, 34735: 3, 34736: 12, 34737: 2}


def pictures(folders, seed):
    """Paths, larger pictures first, in a random order among those of one size."""
    paths = sorted(path for folder in folders for path in pathlib.Path(folder).rglob('*.jpg'))
    random.Random(seed).shuffle(paths)
    sizes = {}
    for path in paths:
        with Image.open(path) as picture:
            sizes[path] = -(-picture.width // CELL_PX) * -(-picture.height // CELL_PX)
    return sorted(paths, key=lambda path: -sizes[path])


def free_place(taken, rows, columns):
    """The first free rectangle of cells, row by row."""
    for row in range(taken.shape[0] - rows + 1):
        for column in range(taken.shape[1] - columns + 1):
            if not taken[row:row + rows, column:column + columns].any():
                return row, column
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('pictures', nargs='+')
    parser.add_argument('--out', type=pathlib.Path, required=True)
    parser.add_argument('--side-px', default='20800x18400')
    parser.add_argument('--seed', type=int, default=5)
    arguments = parser.parse_args()
    try:
        width, height = (int(side) // CELL_PX * CELL_PX for side in arguments.side_px.split('x'))
    except ValueError:
        parser.error('--side-px: expected WIDTHxHEIGHT, such as 20800x18400')

    with tifffile.TiffFile(arguments.folder / 'map.tif') as file:
        page = file.pages[0]
        tags = {code: page.tags[code].value for code in GEO_TAGS if code in page.tags}
        small = page.asarray()
    if small.shape[0] > height or small.shape[1] > width:
        parser.error(f'the map has {small.shape[1]} x {small.shape[0]} pixels: --side-px has to be larger')
    canvas = np.zeros((height, width, 3), np.uint8)
    canvas[:small.shape[0], :small.shape[1]] = small
    taken = np.zeros((height // CELL_PX, width // CELL_PX), bool)
    taken[:-(-small.shape[0] // CELL_PX), :-(-small.shape[1] // CELL_PX)] = True
    placed = 0
    for path in pictures(arguments.pictures, arguments.seed):
        with Image.open(path) as picture:
            pixels = np.asarray(picture.convert('RGB'))
        rows, columns = (-(-side // CELL_PX) for side in pixels.shape[:2])
        place = free_place(taken, rows, columns)
        if place is None:
            if rows == columns == 1:
                break
            continue
        row, column = place
        taken[row:row + rows, column:column + columns] = True
        canvas[row * CELL_PX:, column * CELL_PX:][:pixels.shape[0], :pixels.shape[1]] = pixels
        placed += 1

    if placed == 0:
        parser.error('no .jpg picture has a place beside the map; check the folders of PICTURES and --side-px')

    arguments.out.mkdir(parents=True, exist_ok=True)
    extra = [
        (code, GEO_TAGS[code], len(value) + 1 if isinstance(value, str) else len(value), value, True)
        for code, value in tags.items()
    ]
    tifffile.imwrite(arguments.out / 'map.tif', canvas, tile=(512, 512), compression='jpeg', compressionargs={'level': 92},
                     photometric='rgb', extratags=extra)
    shutil.copyfile(arguments.folder / 'truth.csv', arguments.out / 'truth.csv')
    photos = arguments.out / 'photos'
    if not photos.exists():
        photos.symlink_to((arguments.folder / 'photos').resolve())
    print(f'{arguments.out}/map.tif: {width} x {height}, {placed} pictures beside the map')


if __name__ == '__main__':
    main()
