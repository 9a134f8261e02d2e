"""Writes wkt_golden.tsv: well-known text without codes of the systems in ../../epsg/datums.txt and of some that are projected from them, as
ESRI's programs and GDAL write it, and a place in each as PROJ transforms it without grids.

    python make_wkt_golden.py            # needs pyproj

A row has the EPSG code, x, y (or longitude and latitude in the system), longitude and latitude on WGS 84 in degrees, and the text. Left out
are systems for which PROJ knows no transformation to WGS 84.
"""

import re
import warnings
from pathlib import Path

import pyproj
from make_golden import place

HERE = Path(__file__).parent
PROJECTED = (
    2039, 2056, 2057, 2100, 2326, 2393, 3003, 3021, 3078, 3375, 3765, 3844, 3907, 5514, 20350, 21781, 23030, 23700, 26191, 27291, 27700, 28192,
    28406, 28992, 29873, 29903, 30161, 31255, 31287, 31370, 31467, 32260,
)  # fmt: skip


def main():
    warnings.simplefilter("ignore")
    pyproj.network.set_network_enabled(False)
    # Some have a code only: their name is that of a newer datum.
    named = re.findall(r"^(\d+) .*[A-Za-z]", (HERE / "../../epsg/datums.txt").read_text(), re.M)
    rows, without = [], []
    for code in [*map(int, named), *PROJECTED]:
        crs = pyproj.CRS.from_epsg(code)
        texts = [crs.to_wkt("WKT1_ESRI")]
        if code in PROJECTED:
            texts.append(re.sub(r',AUTHORITY\["EPSG","\d+"\]', "", crs.to_wkt("WKT1_GDAL")))
        for text in texts:
            try:
                found = place(pyproj.CRS.from_wkt(text), crs.area_of_use)
            except pyproj.exceptions.ProjError:
                found = None
            if found is None:
                without.append(code)
                continue
            x, y, lon, lat = found
            rows.append(f"{code}\t{x!r}\t{y!r}\t{lon:.8f}\t{lat:.8f}\t{text}")
    head = f"# pyproj {pyproj.__version__}, PROJ {pyproj.proj_version_str}"
    (HERE / "wkt_golden.tsv").write_text("\n".join([head, *rows]) + "\n")
    print(len(rows), "rows; without a transformation:", *without)


main()
