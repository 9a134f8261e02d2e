"""Makes a harder data set of one laid out as for `grim eval`: a coarser map, or photos that show less ground.

Usage: harder_data.py FOLDER --out HARDER [--map-factor 5] [--crop 0.5]
FOLDER holds map.tif, photos/ and truth.csv with the centre of each photo in degrees. The map is averaged to pixels --map-factor times as large,
the photos are cut to the middle --crop of their width and height (JPEG, quality 95, without metadata), so that their centres stay where they are.
Columns of truth.csv in pixels of the map are left out, and the ground width (footprint_w_m) is that of what is kept. Needs GDAL's programs.
"""
import argparse
import csv
import pathlib
import re
import shutil
import subprocess
import sys


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f'harder_data.py: {command[0]} failed: {done.stderr.strip()}')
    return done.stdout


def cut(photo, share, out):
    width, height = map(int, re.search(r'Size is (\d+), (\d+)', run('gdalinfo', photo)).groups())
    sides = round(width * share), round(height * share)
    window = ((width - sides[0]) // 2, (height - sides[1]) // 2, *sides)
    run('gdal_translate', '-q', '-of', 'JPEG', '-co', 'QUALITY=95', '-co', 'WRITE_EXIF_METADATA=NO', '-srcwin', *window, photo, out)
    pathlib.Path(f'{out}.aux.xml').unlink(missing_ok=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--out', type=pathlib.Path, required=True)
    parser.add_argument('--map-factor', type=float, default=1.0)
    parser.add_argument('--crop', type=float, default=1.0)
    arguments = parser.parse_args()
    if not (arguments.map_factor >= 1 and 0 < arguments.crop <= 1):
        parser.error('expected --map-factor of 1 or more, and --crop above 0, up to 1')
    with open(arguments.folder / 'truth.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    (arguments.out / 'photos').mkdir(parents=True)

    share = f'{100 / arguments.map_factor}%'
    if arguments.map_factor == 1.0:
        shutil.copy(arguments.folder / 'map.tif', arguments.out / 'map.tif')
    else:
        run('gdal_translate', '-q', '-r', 'average', '-outsize', share, share, arguments.folder / 'map.tif', arguments.out / 'map.tif')
    kept = [name for name in rows[0] if name not in ('map_x_px', 'map_y_px')]
    for row in rows:
        if row.get('footprint_w_m'):
            row['footprint_w_m'] = f"{float(row['footprint_w_m']) * arguments.crop:g}"
    with open(arguments.out / 'truth.csv', 'w', newline='') as file:
        writer = csv.DictWriter(file, kept, extrasaction='ignore', lineterminator='\n')
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        photo = arguments.folder / 'photos' / row['photo']
        if arguments.crop == 1.0:
            shutil.copy(photo, arguments.out / 'photos')
        else:
            cut(photo, arguments.crop, arguments.out / 'photos' / row['photo'])


if __name__ == '__main__':
    main()
