"""Makes the maps of these tests and what GDAL reads from them.

GDAL 3.6 (Debian's gdal-bin) makes the MBTiles, the folders, and the VRTs; PyPI's pmtiles writes the PMTiles file from the
same tiles. What GDAL reads through rasterio is the expected value.

    apt-get install gdal-bin python3-gdal
    python3 -m venv oracles && oracles/bin/pip install numpy pillow rasterio==1.4.4 pmtiles==3.8.1
    oracles/bin/python crates/geo/tests/sources/make_sources.py
"""

import io
import json
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import rasterio
from PIL import Image
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer
from rasterio.transform import from_origin
from rasterio.warp import transform as transform_points

HERE = Path(__file__).parent
MAPS = HERE / "maps"
WORK = HERE / "work"
HALF_WORLD = np.pi * 6378137.0


def run(*words):
    print(" ".join(str(w) for w in words))
    subprocess.run([str(w) for w in words], check=True, stdout=subprocess.DEVNULL)


def picture(width, height, seed, side=12):
    """Flat squares: small as PNG, and any shift or flip shows. No sample is 0."""
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 6, (-(-height // side), -(-width // side), 3), dtype=np.uint8) * 40 + 20
    return np.repeat(np.repeat(small, side, 0), side, 1)[:height, :width]


def write_tif(path, rgb, left, top, size, crs, nodata=None):
    height, width = rgb.shape[:2]
    with rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=3, dtype="uint8", crs=crs, nodata=nodata,
        transform=from_origin(left, top, size, size), compress="deflate", tiled=True, blockxsize=128, blockysize=128,
        photometric="rgb",
    ) as out:
        out.write(rgb.transpose(2, 0, 1))


def answers(path, windows, options={}):
    """What GDAL reads: sums of pixels, some pixels, and where points lie."""
    with rasterio.open(path, **options) as map_file:
        if map_file.crs is None:
            raise SystemExit(f"{path}: no CRS")
        size = (map_file.width, map_file.height)
        points = []
        for fx, fy in [(0, 0), (1, 0), (0.5, 0.5), (0.25, 0.8), (1, 1)]:
            x_px, y_px = fx * size[0], fy * size[1]
            x, y = map_file.transform * (x_px, y_px)
            lon, lat = transform_points(map_file.crs, "EPSG:4326", [x], [y])
            points.append({"x_px": x_px, "y_px": y_px, "lon_deg": lon[0], "lat_deg": lat[0]})
        read = []
        for x, y, w, h in windows:
            window = rasterio.windows.Window(x, y, w, h)
            rgb = map_file.read([1, 2, 3], window=window)
            valid = map_file.dataset_mask(window=window) > 0
            rgb = np.where(valid[None], rgb, 0).transpose(1, 2, 0)
            name = f"{path.name}.{x}_{y}_{w}_{h}.png"
            Image.fromarray(np.dstack([rgb, np.where(valid, 255, 0)]).astype(np.uint8)).save(
                HERE / "expected" / name, optimize=True
            )
            read.append({"window": [x, y, w, h], "expected": name})
        has_mask = any(flag != [rasterio.enums.MaskFlags.all_valid] for flag in map_file.mask_flag_enums)
        return {"file": path.name, "size_px": size, "has_mask": has_mask, "points": points, "windows": read}


def tiles_of_mbtiles(path):
    """Tiles in the XYZ scheme, from the database itself."""
    with sqlite3.connect(path) as base:
        for zoom, column, row, data in base.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles"):
            yield zoom, column, (1 << zoom) - 1 - row, data


def write_pmtiles(path, tiles, tile_type, leaf_size=None):
    with open(path, "wb") as out:
        writer = Writer(out)
        ordered = sorted((zxy_to_tileid(z, x, y), data) for z, x, y, data in tiles)
        for number, data in ordered:
            writer.write_tile(number, data)
        zooms = [t[0] for t in tiles]
        writer.finalize(
            {
                "tile_type": tile_type, "tile_compression": Compression.NONE, "min_zoom": min(zooms),
                "max_zoom": max(zooms), "min_lon_e7": 0, "min_lat_e7": 0, "max_lon_e7": 10_000_000,
                "max_lat_e7": 10_000_000, "center_zoom": max(zooms), "center_lon_e7": 0, "center_lat_e7": 0,
            },
            {"name": "test"},
        )


def main():
    for folder in [MAPS, WORK, HERE / "expected"]:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    golden = {"gdal": rasterio.__gdal_version__, "maps": []}

    # A map on the pixel grid of zoom 17, near 47 N 11 E, one tile missing, so that nothing is resampled.
    zoom, tiles_wide, tiles_high = 17, 3, 3
    size = 2 * HALF_WORLD / (256 << zoom)
    column, row = 69541, 46101
    left, top = column * 256 * size - HALF_WORLD, HALF_WORLD - row * 256 * size
    rgb = picture(tiles_wide * 256, tiles_high * 256, 1)
    write_tif(WORK / "web.tif", rgb, left, top, size, "EPSG:3857")
    run("gdal_translate", "-q", "-of", "MBTILES", "-co", "TILE_FORMAT=PNG", WORK / "web.tif", MAPS / "town.mbtiles")
    run("gdaladdo", "-q", "-r", "average", MAPS / "town.mbtiles", "2", "4")
    with sqlite3.connect(MAPS / "town.mbtiles") as base:
        missing = (zoom, column + 1, (1 << zoom) - 1 - (row + 2))
        base.execute("DELETE FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?", missing)
        base.commit()
        base.execute("VACUUM")
    windows = [(0, 0, 64, 64), (200, 200, 160, 120), (180, 480, 200, 130), (700, 700, 100, 100)]
    windows = [w for w in windows if w[0] + w[2] <= 768 and w[1] + w[3] <= 768] + [(704, 704, 64, 64)]
    golden["maps"].append(answers(MAPS / "town.mbtiles", windows, {"zoom_level": zoom}))

    # Tiles of 512 pixels, JPEG and PNG mixed, one corner transparent.
    half_size = size / 2
    mixed = picture(1024, 1024, 2, 60)
    holed = np.dstack([mixed, np.full(mixed.shape[:2], 255, np.uint8)])
    holed[700:, 700:, 3] = 0
    with rasterio.open(
        WORK / "mixed.tif", "w", driver="GTiff", width=1024, height=1024, count=4, dtype="uint8", crs="EPSG:3857",
        transform=from_origin(left - left % 1e-9, top, half_size, half_size), compress="deflate", photometric="rgb", alpha="yes",
    ) as out:
        out.write(holed.transpose(2, 0, 1))
    run("gdal_translate", "-q", "-of", "MBTILES", "-co", "TILE_FORMAT=PNG_JPEG", "-co", "QUALITY=60", "-co", "BLOCKSIZE=512",
        WORK / "mixed.tif", MAPS / "mixed.mbtiles")
    with sqlite3.connect(MAPS / "mixed.mbtiles") as base:
        # JPEG without subsampling of colours, which decoders undo differently.
        tiles = base.execute("SELECT rowid, tile_data FROM tiles WHERE hex(tile_data) LIKE 'FFD8%'").fetchall()
        for rowid, data in tiles:
            jpeg = io.BytesIO()
            Image.open(io.BytesIO(data)).convert("RGB").save(jpeg, "JPEG", quality=50, subsampling=0)
            base.execute("UPDATE tiles SET tile_data=? WHERE rowid=?", (jpeg.getvalue(), rowid))
        base.commit()
        base.execute("VACUUM")
    golden["maps"].append(answers(MAPS / "mixed.mbtiles", [(480, 480, 64, 64), (660, 660, 90, 90)]))

    # The same tiles as folders, in both schemes, and as PMTiles.
    stored = list(tiles_of_mbtiles(MAPS / "town.mbtiles"))
    for z, x, y, data in stored:
        for folder, name in [("town_xyz", y), ("town_tms", (1 << z) - 1 - y)]:
            path = MAPS / folder / str(z) / str(x) / f"{name}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    (MAPS / "town_tms" / "tilemapresource.xml").write_text(
        "<?xml version='1.0'?>\n<TileMap version='1.0.0'><SRS>EPSG:3857</SRS><TileSets profile='mercator'/></TileMap>\n"
    )
    write_pmtiles(MAPS / "town.pmtiles", stored, TileType.PNG)

    # What is refused.
    write_pmtiles(MAPS / "vector.pmtiles", [(0, 0, 0, b"\x1a\x00")], TileType.MVT)
    with sqlite3.connect(MAPS / "vector.mbtiles") as base:
        base.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        base.execute("CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB)")
        base.execute("INSERT INTO metadata VALUES ('format', 'pbf')")
        base.execute("INSERT INTO tiles VALUES (0, 0, 0, x'1f8b')")
    with sqlite3.connect(MAPS / "raster.gpkg") as base:
        base.execute("CREATE TABLE gpkg_contents (table_name TEXT, data_type TEXT)")
    with sqlite3.connect(MAPS / "other.sqlite") as base:
        base.execute("CREATE TABLE photos (name TEXT)")

    # Four GeoTIFFs that overlap, the later wins; one has nodata, one lies on another grid.
    for index, (x, y, nodata) in enumerate([(0, 0, None), (96, 8, None), (16, 90, 0), (100, 96, None)]):
        part = picture(120, 112, 10 + index)
        if nodata is not None:
            part[40:70, 30:100] = 0
        write_tif(MAPS / f"part_{index}.tif", part, 500000 + 0.5 * x, 5200000 - 0.5 * y, 0.5, "EPSG:32632", nodata)
    parts = [MAPS / f"part_{i}.tif" for i in range(4)]
    run("gdalbuildvrt", "-q", MAPS / "parts.vrt", *parts)
    run("gdalbuildvrt", "-q", "-vrtnodata", "7", "-srcnodata", "0", MAPS / "nodata.vrt", *parts)
    run("gdalbuildvrt", "-q", "-te", 500010, 5199940, 500090, 5199990, MAPS / "cut.vrt", *parts[:2])
    whole = [(0, 0, 220, 208), (90, 80, 40, 40)]
    golden["maps"].append(answers(MAPS / "parts.vrt", whole))
    golden["maps"].append(answers(MAPS / "nodata.vrt", whole))
    golden["maps"].append(answers(MAPS / "cut.vrt", [(0, 0, 160, 100)]))
    (MAPS / "parts.txt").write_text("# later ones lie above\n" + "\n".join(p.name for p in parts) + "\n")
    run("gdalwarp", "-q", "-of", "VRT", "-t_srs", "EPSG:4326", parts[0], MAPS / "warped.vrt")

    # Georeference, nodata and overviews in files beside the map.
    write_tif(WORK / "plain.tif", picture(96, 80, 30), 500000, 5200000, 0.5, "EPSG:32632", 0)
    run("gdal_translate", "-q", "-of", "PNG", WORK / "plain.tif", MAPS / "pam.png")
    golden["maps"].append(answers(MAPS / "pam.png", [(0, 0, 96, 80)]))
    run("gdal_translate", "-q", "-of", "GTiff", "-co", "PROFILE=BASELINE", WORK / "plain.tif", MAPS / "pam_baseline.tif")
    golden["maps"].append(answers(MAPS / "pam_baseline.tif", [(0, 0, 96, 80)]))

    (HERE / "golden.json").write_text(json.dumps(golden, indent=1) + "\n")
    shutil.rmtree(WORK)


if __name__ == "__main__":
    sys.exit(main())
