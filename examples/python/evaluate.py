"""Recall of a data set in the style of AnyVisLoc and hloc: python3 evaluate.py AREA.grim PHOTOS truth.csv"""

import csv, math, pathlib, sys  # noqa: E401
import grimnet

localizer, photos, errors_m = grimnet.Localizer(sys.argv[1]), pathlib.Path(sys.argv[2]), []
for row in csv.DictReader(open(sys.argv[3], newline="")):
    answer = localizer.locate(photos / row["photo"], heading="unknown")
    lat_deg, lon_deg = (float(row.get(a) or row[b]) for a, b in (("lat_deg", "centre_lat"), ("lon_deg", "centre_lon")))
    north_m = (answer.lat_deg - lat_deg) * 110_574 if answer else math.inf
    east_m = (answer.lon_deg - lon_deg) * 111_320 * math.cos(math.radians(lat_deg)) if answer else math.inf
    errors_m.append(math.hypot(north_m, east_m))
for limit_m in (5, 10, 20):
    print(f"A@{limit_m}m {sum(error <= limit_m for error in errors_m) / len(errors_m):.1%}")
