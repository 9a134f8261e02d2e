"""Writes definitions.txt: PROJ strings of the EPSG codes that the list of crs-definitions lacks, most of them newer than it.

    python make_definitions.py ~/.cargo/registry/src/*/crs-definitions-*/src/defs.rs            # needs pyproj

A line has the EPSG code and the PROJ string, with the datum shift that PROJ uses without grids. Left out are deprecated codes, those whose
transformation has no PROJ string that agrees with it to 2 m over the area of use, and projections that proj4rs lacks.

Outside the area of a transformation PROJ takes no shift unless it is told not to (`allow_ballpark=False`), which is off by all of the shift;
a definition has its shift everywhere. EPSG:9284 and 9285 (Pampa del Castillo) are the only ones here whose area of use is larger than that
of their transformation.
"""

import re
import sys
import warnings
from pathlib import Path

import pyproj
from pyproj.database import get_database_metadata, query_crs_info
from pyproj.enums import PJType

TOLERANCE_M = 2.0
METHODS = {"aea", "aeqd", "cass", "laea", "lcc", "longlat", "merc", "omerc", "somerc", "stere", "sterea", "tmerc", "utm"}


def shift_of(pipeline):
    """The `+towgs84` of the only Helmert transformation of a pipeline, empty if there is none, or None if there are several."""
    steps = [s for s in pipeline.split("step ") if "helmert" in s]
    if "grid" in pipeline or len(steps) > 1:
        return None
    if not steps:
        return ""
    value = dict(re.findall(r"(\w+)=(\S+)", steps[0]))
    if set(value) - {"proj", "x", "y", "z", "rx", "ry", "rz", "s", "convention"}:
        return None
    sign = -1 if steps[0].startswith("inv ") else 1
    number = {k: sign * float(value.get(k, 0)) for k in ("x", "y", "z", "rx", "ry", "rz", "s")}
    if value.get("convention") == "coordinate_frame":
        number.update({k: -number[k] for k in ("rx", "ry", "rz")})
    return " +towgs84=" + ",".join(f"{v:.9g}" for v in (n + 0.0 for n in number.values()))


def places(area):
    width = (area.east - area.west) % 360 or 360
    for u in (0.1, 0.5, 0.9):
        for v in (0.1, 0.5, 0.9):
            yield (area.west + u * width + 180) % 360 - 180, area.south + v * (area.north - area.south)


def agrees(definition, to_wgs84, area):
    """Whether both put the same coordinates at the same place."""
    ours = pyproj.Transformer.from_crs(pyproj.CRS(definition), 4326, always_xy=True)
    earth = pyproj.Geod(ellps="WGS84")
    for lon, lat in places(area):
        x, y = to_wgs84.transform(lon, lat, direction="INVERSE")
        theirs = to_wgs84.transform(x, y)
        off_m = earth.inv(*theirs, *ours.transform(x, y))[2]
        if not off_m <= TOLERANCE_M:
            return False
    return True


def definition_of(code):
    crs = pyproj.CRS.from_epsg(code)
    if crs.area_of_use is None:
        return None
    try:
        # Frames that are fixed to a plate lie within two metres of WGS 84: they may go without a transformation.
        plate_fixed = crs.ellipsoid.name in ("GRS 1980", "WGS 84")
        to_wgs84 = pyproj.Transformer.from_crs(crs, 4326, always_xy=True, allow_ballpark=plate_fixed)
        to_wgs84.transform(*to_wgs84.transform(*list(places(crs.area_of_use))[4], direction="INVERSE"))
        several = to_wgs84.definition.startswith("unavailable")
        used = to_wgs84.get_last_used_operation() if several else to_wgs84
        shift = shift_of(used.definition)
        plain = crs.to_proj4().replace(" +type=crs", "").replace(" +no_defs", "")
        if shift is None or re.search(r"\+proj=(\w+)", plain)[1] not in METHODS:
            return None
        definition = plain + shift + " +no_defs"
        return definition if agrees(definition + " +type=crs", to_wgs84, crs.area_of_use) else None
    except pyproj.exceptions.ProjError:
        return None


def main(listed):
    warnings.simplefilter("ignore")
    pyproj.network.set_network_enabled(False)
    known = set(re.findall(r"^\s*EPSG_(\d+)\|", Path(listed).read_text(), re.M))
    kinds = [PJType.PROJECTED_CRS, PJType.GEOGRAPHIC_2D_CRS]
    codes = {int(info.code) for info in query_crs_info("EPSG", kinds) if info.code not in known}
    found = {code: definition_of(code) for code in sorted(codes)}
    rows = [f"{code} {definition}" for code, definition in found.items() if definition]
    head = f"# EPSG registry {get_database_metadata('EPSG.VERSION')}, PROJ {pyproj.proj_version_str}"
    Path(__file__).with_name("definitions.txt").write_text("\n".join([head, *rows]) + "\n")
    print(len(rows), "rows; left out:", *(code for code, definition in found.items() if not definition))


main(sys.argv[1])
