"""Writes golden.csv: a place for each datum of the lists of EPSG definitions (that of crs-definitions and ../../epsg/definitions.txt), as
PROJ transforms it without grids.

    python make_golden.py ~/.cargo/registry/src/*/crs-definitions-*/src/defs.rs            # needs pyproj

A row has the EPSG code, x, y (or longitude and latitude in the CRS), and longitude and latitude on WGS 84 in degrees. There is one row for
each datum of the EPSG registry, as the list defines it, with each projection method, unit and axis order. CRS for which PROJ knows no
transformation to WGS 84 are left out.
"""

import re
import sys
import warnings
from pathlib import Path

import pyproj

DATUM = ("+datum=", "+ellps=", "+towgs84=", "+a=", "+b=", "+rf=", "+pm=", "+nadgrids=")
METHOD = ("+proj=", "+axis=", "+units=", "+to_meter=")


def place(crs, area):
    """x, y, longitude and latitude of a place in the area of use that PROJ transforms there and back."""
    to_wgs84 = pyproj.Transformer.from_crs(crs, 4326, always_xy=True, allow_ballpark=False)
    width = (area.east - area.west) % 360 or 360
    for share in (0.5, 0.35, 0.7):
        lon = (area.west + share * width + 180) % 360 - 180
        lat = area.south + share * (area.north - area.south)
        x, y = to_wgs84.transform(lon, lat, direction="INVERSE")
        # As they are written.
        x, y = (round(v, 8 if crs.is_geographic else 3) for v in (x, y))
        lon, lat = to_wgs84.transform(x, y)
        if abs(x) < 1e12 and abs(lon) <= 180.01:
            return x, y, lon, lat
    return None


def main(listed):
    warnings.simplefilter("ignore")
    seen = set()
    rows = []
    here = Path(__file__).parent
    definitions = re.findall(r'^\s*EPSG_(\d+)\|\d+\|"([^"]*)"', Path(listed).read_text(), re.M)
    definitions += re.findall(r"^(\d+) (.*)$", (here / "../../epsg/definitions.txt").read_text(), re.M)
    for code, definition in definitions:
        try:
            crs = pyproj.CRS.from_epsg(code)
            datum = crs.geodetic_crs.to_authority()
        except (pyproj.exceptions.CRSError, AttributeError):
            continue  # not in PROJ's registry, or no horizontal CRS
        parts = definition.split()
        key = datum, *(p for p in parts if p.startswith(DATUM + METHOD))
        if key in seen or crs.area_of_use is None or crs.is_geocentric:
            continue
        # A CRS that cannot be transformed tells nothing of its datum: the next one may.
        try:
            found = place(crs, crs.area_of_use)
        except pyproj.exceptions.ProjError:
            continue
        if found:
            seen.add(key)
            x, y, lon, lat = found
            rows.append(f"{code},{x!r},{y!r},{lon:.8f},{lat:.8f}")
    head = f"# pyproj {pyproj.__version__}, PROJ {pyproj.proj_version_str}"
    (here / "golden.csv").write_text("\n".join([head, *rows]) + "\n")
    print(len(rows), "rows")


if __name__ == "__main__":
    main(sys.argv[1])
