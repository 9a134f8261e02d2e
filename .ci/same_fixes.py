#!/usr/bin/env python3
"""Compares two tables of `folder_to_csv`: the same fixes within the tolerances that SECURITY.md states.

    .ci/same_fixes.py A.csv B.csv
"""

import csv
import math
import sys

TOLERANCE_M = 0.01
TOLERANCE_CONFIDENCE = 0.001
# Of latitude; the demo lies at the equator.
DEGREE_M = 111_195.0


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        found = {row["photo"]: row for row in csv.DictReader(file)}
    missing = [photo for photo, row in found.items() if not row["lat_deg"]]
    if not found or missing:
        sys.exit(f"{path}: expected a fix for each photo; without one: {missing or 'all'}")
    return found


def main():
    a, b = (rows(path) for path in sys.argv[1:3])
    if a.keys() != b.keys():
        sys.exit(f"other photos: {sorted(a)}, {sorted(b)}")
    failed = False
    for photo in sorted(a):
        off = {name: abs(float(a[photo][name]) - float(b[photo][name])) for name in ("lat_deg", "lon_deg", "radius95_m", "confidence")}
        off_m = DEGREE_M * math.hypot(off["lat_deg"], off["lon_deg"])
        failed |= off_m > TOLERANCE_M or off["radius95_m"] > TOLERANCE_M or off["confidence"] > TOLERANCE_CONFIDENCE
        print(f"{photo}: {off_m:.4f} m apart, radii {off['radius95_m']:.3f} m, confidences {off['confidence']:.4f}")
    if failed:
        sys.exit(f"more than {TOLERANCE_M} m, or more than {TOLERANCE_CONFIDENCE} in confidence")


main()
