"""Makes the small maps of this folder and what rasterio, pyproj and Pillow say about them.

    python make_golden.py            # needs rasterio, pyproj, pillow, numpy

Writes maps/ (synthetic pictures in all the forms that a map can have), expected/ (RGBA pictures:
colours, and 255 where the map has data) and golden.json. Nothing here is random: the same versions
of the libraries give the same files.
"""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from affine import Affine
from PIL import Image
from rasterio.enums import ColorInterp, Resampling
from rasterio.shutil import copy as rio_copy

HERE = Path(__file__).parent
MAPS = HERE / "maps"
EXPECTED = HERE / "expected"
W, H = 96, 80

# A place for each CRS (lon, lat).
PLACES = {
    4326: (120.72, 24.26),
    3857: (120.72, 24.26),
    32651: (120.72, 24.26),
    3826: (120.72, 24.26),
    28992: (5.12, 52.09),
    27700: (-1.55, 53.8),
    2056: (7.45, 46.95),
    25832: (9.0, 48.0),
    2154: (2.35, 48.85),
    5186: (127.0, 37.5),
    6677: (139.7, 35.7),
    2193: (174.7, -41.3),
    3035: (10.0, 52.0),
    31370: (4.35, 50.85),
    5514: (14.42, 50.09),
    4258: (5.0, 45.0),
    32733: (15.5, -22.5),
    3832: (179.9985, -17.0),
}


def picture(bands, dtype=np.uint8, high=255):
    """Smooth hills, stripes and a chessboard: no two places alike."""
    y, x = np.mgrid[0:H, 0:W].astype(np.float64)
    out = []
    for b in range(bands):
        v = 0.5 + 0.25 * np.sin(x / (5 + b) + b) + 0.2 * np.cos(y / (7 - b % 3) - x / 19)
        v += 0.12 * (((x // 12 + y // 10 + b) % 2) - 0.5)
        # In steps, so that the files are small.
        out.append(np.floor(np.clip(v, 0.04, 1) * 24) / 24 * high)
    return np.array(out).astype(dtype)


def north_up(epsg, gsd=0.5):
    lon, lat = PLACES[epsg]
    x, y = pyproj.Transformer.from_crs(4326, epsg, always_xy=True).transform(lon, lat)
    crs = pyproj.CRS.from_epsg(epsg)
    if crs.is_geographic:
        sx, sy = gsd / (111320 * math.cos(math.radians(lat))), gsd / 110570
    else:
        sx = sy = gsd
        x, y = round(x, 1), round(y, 1)
    return Affine(sx, 0, x, 0, -sy, y)


def write(name, data, epsg=32651, transform=None, crs=None, overviews=(), mask=None, **options):
    path = MAPS / name
    nodata = options.pop("nodata", None)
    colormap = options.pop("colormap", None)
    alpha = options.pop("alpha", False)
    profile = dict(
        driver="GTiff", width=data.shape[2], height=data.shape[1], count=data.shape[0],
        dtype=data.dtype, crs=crs or rasterio.crs.CRS.from_epsg(epsg),
        transform=transform if transform is not None else north_up(epsg), nodata=nodata,
    )
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
        with rasterio.open(path, "w", **profile, **options) as out:
            out.write(data)
            if colormap:
                out.write_colormap(1, colormap)
            if alpha:
                interp = list(out.colorinterp)
                interp[-1] = ColorInterp.alpha
                out.colorinterp = interp
            if mask is not None:
                out.write_mask(mask)
        if overviews:
            with rasterio.open(path, "r+") as out:
                out.build_overviews(list(overviews), Resampling.average)
    return path


def stretch(bands):
    """2nd to 98th percentile (nearest rank) to 0..255, as the reader documents."""
    out = []
    for band in bands:
        v = np.sort(band[np.isfinite(band)].ravel())
        low, high = (v[int(math.floor((len(v) - 1) * q + 0.5))] for q in (0.02, 0.98))
        s = 255.0 * (band.astype(np.float64) - float(low)) / float(high - low)
        out.append(np.nan_to_num(np.clip(np.floor(s + 0.5), 0, 255)))
    return np.array(out)


def shown(path, level=None):
    """RGB (h, w, 3) and validity (h, w) of a map or of one of its overviews, by rasterio."""
    kwargs = {} if level is None else {"overview_level": level}
    with rasterio.open(path, **kwargs) as src:
        data = src.read()
        valid = src.dataset_mask() != 0
        interp = src.colorinterp
        if interp[0] == ColorInterp.palette:
            table = src.colormap(1)
            rgb = np.array([[table[v][:3] for v in row] for row in data[0]])
            return rgb.astype(np.uint8), valid
        colour = data if interp[-1] != ColorInterp.alpha else data[:-1]
        colour = colour[:3] if len(colour) >= 3 else colour[:1]
        if interp[0] == ColorInterp.gray and src.tags(1, ns="IMAGE_STRUCTURE").get("NBITS") == "1":
            colour = colour * 255
        if colour.dtype != np.uint8:
            colour = stretch(colour)
        if path.stem == "white_is_zero":  # GDAL gives the stored numbers
            colour = 255 - colour
        if len(colour) == 1:
            colour = np.repeat(colour, 3, axis=0)
    return np.moveaxis(colour, 0, 2).astype(np.uint8), valid


def copied(rgb, valid, x, y, w, h):
    """A window at the map's own resolution; black and not valid outside."""
    out = np.zeros((h, w, 4), np.uint8)
    for j in range(h):
        for i in range(w):
            u, v = x + i, y + j
            if 0 <= u < rgb.shape[1] and 0 <= v < rgb.shape[0] and valid[v, u]:
                out[j, i, :3] = rgb[v, u]
                out[j, i, 3] = 255
    return out


def resampled(rgb, valid, box, w, h):
    """Pillow's antialiased bilinear over a fractional box, colours weighted by validity."""
    weight = valid.astype(np.float32)

    def resize(plane):
        return np.asarray(
            Image.fromarray(plane.astype(np.float32)).resize((w, h), Image.BILINEAR, box=box)
        )

    total = resize(weight)
    out = np.zeros((h, w, 4), np.uint8)
    seen = total >= 0.5
    for c in range(3):
        colour = resize(rgb[..., c] * weight) / np.maximum(total, 1e-6)
        out[..., c] = np.where(seen, np.clip(np.floor(colour + 0.5), 0, 255), 0)
    out[..., 3] = np.where(seen, 255, 0)
    return out


def lonlat_points(transform, crs, width=W, height=H):
    """Longitude and latitude of some map pixels, by pyproj."""
    to_lonlat = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    points = []
    for col, row in [(0, 0), (width, 0), (0, height), (width, height), (40.5, 30.5), (-100, 900)]:
        x, y = transform * (col, row)
        lon, lat = to_lonlat.transform(x, y)
        lon = (lon + 180) % 360 - 180
        points.append(dict(x_px=col, y_px=row, lon_deg=lon, lat_deg=lat))
    return points


golden = {"made_with": {"rasterio": rasterio.__version__, "gdal": rasterio.__gdal_version__,
                        "pyproj": pyproj.__version__, "proj": pyproj.proj_version_str,
                        "pillow": Image.__version__}, "maps": []}


def case(path, max_abs=0, mean_abs=0.0, tolerance_m=1e-4, windows=True, **extra):
    """Records what the libraries say about a map. Resampled windows may differ by one more grey
    value: rounding."""
    with rasterio.open(path) as src:
        entry = dict(file=path.name, width=src.width, height=src.height,
                     transform=list(src.transform.to_gdal()), overviews=src.overviews(1),
                     tolerance_m=tolerance_m, **extra)
        entry["points"] = lonlat_points(src.transform, src.crs.to_wkt(), src.width, src.height)
        overviews = len(src.overviews(1))
    rgb, valid = shown(path)
    entry["windows"] = []

    def window(kind, box, w, h, out):
        name = f"{path.stem}.{kind}.png"
        Image.fromarray(out).save(EXPECTED / name, optimize=True)
        slack = 0 if kind == "copy" else 1
        entry["windows"].append(dict(
            expected=name, x=box[0], y=box[1], w=box[2] - box[0], h=box[3] - box[1],
            out_w=w, out_h=h, max_abs=max_abs + slack, mean_abs=mean_abs + 0.5 * slack))

    if windows:
        width, height = rgb.shape[1], rgb.shape[0]
        x, y = width - 26, -6
        window("copy", (x, y, x + 36, y + 30), 36, 30, copied(rgb, valid, x, y, 36, 30))
        box = (10.25, 8.5, 10.25 + 45.9, 8.5 + 38.25)
        window("reduce", box, 27, 25, resampled(rgb, valid, box, 27, 25))
        box = (30.2, 20.7, 42.2, 30.7)
        window("enlarge", box, 30, 25, resampled(rgb, valid, box, 30, 25))
    if overviews:
        small, seen = shown(path, 0)
        f = (width / small.shape[1], height / small.shape[0])
        box = (4.0, 6.0, 4.0 + 25 * 2.6, 6.0 + 24 * 2.6)
        in_level = (box[0] / f[0], box[1] / f[1], box[2] / f[0], box[3] / f[1])
        window("overview", box, 25, 24, resampled(small, seen, in_level, 25, 24))
    golden["maps"].append(entry)


def make_maps():
    rgb = picture(3)
    # Two JPEG decoders differ in how they enlarge chroma.
    jpeg = dict(max_abs=40, mean_abs=3.5)
    case(write("tiled_jpeg_ycbcr.tif", rgb, 3857, overviews=[2], tiled=True, blockxsize=32,
               blockysize=32, compress="jpeg", photometric="ycbcr", jpeg_quality=92), **jpeg)
    case(write("striped_jpeg_rgb.tif", rgb, 32651, compress="jpeg", photometric="rgb",
               blockysize=16, jpeg_quality=92), max_abs=3, mean_abs=0.6)
    case(write("tiled_deflate_predictor.tif", rgb, 32651, overviews=[2, 4], tiled=True,
               blockxsize=32, blockysize=16, compress="deflate", predictor=2))
    case(write("striped_lzw_one_row.tif", rgb, 3826, compress="lzw", blockysize=1))
    case(write("striped_zstd_planar.tif", rgb, 27700, compress="zstd", interleave="band",
               blockysize=7), tolerance_m=0.004)
    case(write("striped_uncompressed.tif", rgb, 2056, blockysize=11), tolerance_m=0.001)
    case(write("packbits_bigtiff.tif", rgb, 25832, compress="packbits", BIGTIFF="YES"))
    case(write("big_endian_u16.tif", picture(3, np.uint16, 9000), 2154, ENDIANNESS="BIG",
               tiled=True, blockxsize=32, blockysize=32), max_abs=1, mean_abs=0.02)
    case(write("u16_five_bands.tif", picture(5, np.uint16, 3000), 5186, compress="deflate",
               tiled=True, blockxsize=32, blockysize=32), max_abs=1, mean_abs=0.02)
    grey = picture(1)
    case(write("grey.tif", grey, 4326, compress="deflate"))
    case(write("white_is_zero.tif", grey, 6677, compress="lzw", photometric="miniswhite"))
    border = rgb.copy()
    border[:, :, :9] = 0
    border[:, 70:, :] = 0
    border[0, 40, 40] = 0  # one band only: still data
    case(write("nodata_border.tif", border, 2193, overviews=[2], nodata=0, compress="deflate",
               tiled=True, blockxsize=32, blockysize=32))
    alpha = np.concatenate([rgb, np.full((1, H, W), 255, np.uint8)])
    alpha[3, :20, :] = 0
    alpha[3, :, 80:] = 0
    case(write("rgba.tif", alpha, 3035, alpha=True, photometric="rgb", compress="lzw"),
         tolerance_m=0.001)  # series of the authalic latitude
    mask = np.full((H, W), 255, np.uint8)
    mask[50:, :] = 0
    mask[:, :13] = 0
    case(write("jpeg_internal_mask.tif", rgb, 31370, overviews=[2], mask=mask, tiled=True,
               blockxsize=32, blockysize=32, compress="jpeg", photometric="ycbcr"),
         tolerance_m=0.001, **jpeg)
    floats = picture(1, np.float32, 1.0)
    floats[0, :15] = np.nan
    case(write("float_nan.tif", floats, 4258, nodata=float("nan"), compress="deflate",
               predictor=3, tiled=True, blockxsize=32, blockysize=32), max_abs=1, mean_abs=0.02)
    index = (picture(1)[0] // 8).astype(np.uint8)[None]
    table = {i: ((i * 8) % 256, (255 - i * 5) % 256, (i * 37) % 256, 255) for i in range(256)}
    case(write("palette.tif", index, 32733, colormap=table, photometric="palette",
               compress="lzw"))
    bit = (picture(1) > 128).astype(np.uint8)
    case(write("one_bit.tif", bit, 32651, nbits=1, compress="deflate"))
    # Rotated by 30 degrees, sheared, x and y pixels unequal.
    turned = Affine.translation(500000, 2690000) * Affine.rotation(30) * Affine.shear(2, 0)
    case(write("rotated.tif", rgb, 32651, transform=turned * Affine.scale(0.4, -0.5),
               compress="deflate"))
    case(write("antimeridian.tif", rgb, 3832, transform=north_up(3832, 5.0), compress="deflate"))
    lon = Affine(2e-5, 0, 179.999, 0, -2e-5, -17.0)
    case(write("antimeridian_degrees.tif", rgb, 4326, transform=lon, compress="deflate"))
    user = "+proj=tmerc +lat_0=23.5 +lon_0=120.5 +k=0.9998 +x_0=1000 +y_0=2000 +ellps=GRS80 +units=m"
    case(write("user_defined_tmerc.tif", rgb[:, :8, :12], crs=rasterio.crs.CRS.from_string(user),
               transform=Affine(0.5, 0, 20000, 0, -0.5, 80000), compress="deflate"),
         windows=False)
    user = "+proj=lcc +lat_1=48 +lat_2=50 +lat_0=49 +lon_0=4 +x_0=70000 +y_0=60000 +datum=WGS84 +units=us-ft"
    case(write("user_defined_lcc_feet.tif", rgb[:, :8, :12], crs=rasterio.crs.CRS.from_string(user),
               transform=Affine(1.5, 0, 20000, 0, -1.5, 80000), compress="deflate"),
         windows=False)
    holes = rgb.copy()
    holes[:, :, 32:64] = 0
    sparse = write("sparse.tif", holes, 32651, tiled=True, blockxsize=32, blockysize=32,
                   compress="deflate", SPARSE_OK=True)
    case(sparse, windows=False)
    with rasterio.Env(GTIFF_POINT_GEO_IGNORE=False):
        path = MAPS / "pixel_is_point.tif"
        with rasterio.open(path, "w", driver="GTiff", width=W, height=H, count=3, dtype="uint8",
                           crs="EPSG:32651", transform=north_up(32651), compress="deflate") as out:
            out.write(rgb)
            out.update_tags(AREA_OR_POINT="Point")
    case(path, windows=False)

    plain = write("tmp.tif", rgb, 28992)
    cog = MAPS / "cog.tif"
    rio_copy(plain, cog, driver="COG", compress="deflate", blocksize=128, overviews="FORCE_USE_EXISTING")
    plain.unlink()
    case(cog, tolerance_m=0.008)
    path = write("external_overviews.tif", rgb, 32651, compress="deflate")
    with rasterio.Env(TIFF_USE_OVR=True, COMPRESS_OVERVIEW="DEFLATE"):
        with rasterio.open(path, "r+") as out:
            out.build_overviews([2], Resampling.average)
    assert Path(f"{path}.ovr").exists()
    case(path)
    path = write("external_mask.tif", rgb, 32651, compress="deflate")
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False):
        with rasterio.open(path, "r+") as out:
            out.write_mask(mask)
    assert Path(f"{path}.msk").exists()
    case(path)


def make_pictures():
    """Pictures with world files."""
    rgb = np.moveaxis(picture(3), 0, 2)
    t = Affine(0.45, 0.05, 263000.25, 0.03, -0.5, 2683999.75)  # corner; world files want the centre
    for name, world in [("world.png", "world.pgw"), ("world.jpg", "world.jgw")]:
        Image.fromarray(rgb).save(MAPS / name, quality=95, optimize=True)
        x, y = t * (0.5, 0.5)
        (MAPS / world).write_text("\n".join(repr(v) for v in (t.a, t.d, t.b, t.e, x, y)) + "\n")
    golden["world_files"] = dict(files=["world.png", "world.jpg"], crs="EPSG:32651",
                                 transform=list(t.to_gdal()),
                                 points=lonlat_points(t, "EPSG:32651"))


def make_crs():
    """Longitude and latitude of places in many CRS, with convergence and scale where projected."""
    out = []
    for epsg, (lon, lat) in PLACES.items():
        crs = pyproj.CRS.from_epsg(epsg)
        forward = pyproj.Transformer.from_crs(4326, epsg, always_xy=True)
        back = pyproj.Transformer.from_crs(epsg, 4326, always_xy=True)
        x, y = forward.transform(lon, lat)
        lon2, lat2 = back.transform(x, y)
        entry = dict(epsg=epsg, x=x, y=y, lon_deg=lon2, lat_deg=lat2,
                     operation=back.description if back.description else "unknown")
        if crs.is_projected:
            geographic = pyproj.Transformer.from_crs(4326, crs.geodetic_crs, always_xy=True)
            f = pyproj.Proj(crs).get_factors(*geographic.transform(lon, lat))
            entry["convergence_deg"] = f.meridian_convergence
            # Metres on the ellipsoid of a pixel of 0.5 units, over 128 pixels.
            geod = pyproj.Geod(ellps="WGS84")
            along = [back.transform(x + dx, y + dy) for dx, dy in
                     ((-32, 0), (32, 0), (0, -32), (0, 32))]
            entry["pixel_east_m"] = geod.inv(*along[0], *along[1])[2] / 128
            entry["pixel_north_m"] = geod.inv(*along[2], *along[3])[2] / 128
        out.append(entry)
    golden["crs"] = out


def make_geodesics():
    geod = pyproj.Geod(ellps="WGS84")
    pairs = [(120.72, 24.26, 120.73, 24.25), (0, 0, 0.001, 0.001), (179.9999, -17, -179.9999, -17),
             (5, 52, 6, 53), (10, 89.9, -170, 89.9), (-70, -33, -70, -33.5)]
    out = []
    for lon1, lat1, lon2, lat2 in pairs:
        azimuth, _, length = geod.inv(lon1, lat1, lon2, lat2)
        lon3, lat3, _ = geod.fwd(lon1, lat1, 33.0, 1234.5)
        out.append(dict(a=[lon1, lat1], b=[lon2, lat2], length_m=length, azimuth_deg=azimuth,
                        ahead_33deg_1234m5=[lon3, lat3]))
    golden["geodesics"] = out


for folder in (MAPS, EXPECTED):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
make_maps()
make_pictures()
make_crs()
make_geodesics()
for leftover in MAPS.glob("*.aux.xml"):
    leftover.unlink()
(HERE / "golden.json").write_text(json.dumps(golden, indent=1) + "\n")
print(sum(f.stat().st_size for f in HERE.rglob("*") if f.is_file()), "bytes")
