"""Makes metrics_frames.csv and metrics_figures.json: the figures of `Summary::of`, computed independently with numpy; and
retrieval_tiles.csv and retrieval_figures.json: those of `RankDistance::of`.

Run: python make_golden.py (needs numpy). Inputs are made up: a fixed seed, errors drawn under their own covariance,
some misses, some gross errors.
"""

import csv
import json
import math
import pathlib

import numpy as np

HERE = pathlib.Path(__file__).parent


def radius(ee, en, nn, probability):
    """By integrating the normal density over strips of a disc, not over angles as the program does."""
    s1, s2 = np.sqrt(np.maximum(np.linalg.eigvalsh(np.array([[ee, en], [en, nn]])), 1e-12))
    # Nodes at r sin(t): the square root at the ends of the strip is smooth in t.
    t, w = np.polynomial.legendre.leggauss(400)
    t, w = t * math.pi / 2, w * math.pi / 2
    erf = np.vectorize(math.erf)

    def inside(r):
        x = r * np.sin(t)
        density = np.exp(-0.5 * (x / s1) ** 2) / (s1 * math.sqrt(2 * math.pi))
        return np.sum(w * r * np.cos(t) * density * erf(r * np.cos(t) / (s2 * math.sqrt(2))))

    low, high = 0.0, 6.0 * float(s2)
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if inside(middle) < probability else (low, middle)
    return (low + high) / 2


def main():
    rng = np.random.default_rng(20260510)
    rows = []
    for i in range(60):
        if i % 11 == 7:
            rows.append([f"{i:03}.jpg", "", "", "", "", "", "", 5.0 + i])
            continue
        a = rng.normal(size=(2, 2))
        c = a @ a.T + 0.3 * np.eye(2)
        off = rng.multivariate_normal([0.4, -0.2], c) * (1.3 if i % 5 else 4.0)
        if i == 23:
            off = np.array([150.0, 10.0])
        if i == 31:
            off = np.array([14.0, -19.0])
        rows.append([f"{i:03}.jpg", *off, c[0, 0], c[0, 1], c[1, 1], 1 / (1 + math.exp(-rng.normal(3, 1))), 20 + 3.7 * i])
    with open(HERE / "metrics_frames.csv", "w", newline="") as f:
        out = csv.writer(f, lineterminator="\n")
        out.writerow(["photo", "east_m", "north_m", "ee", "en", "nn", "confidence", "time_ms"])
        out.writerows(rows)

    fixes = [r for r in rows if r[1] != ""]
    e = np.array([r[1:3] for r in fixes], float)
    c = np.array([r[3:6] for r in fixes], float)
    errors = np.hypot(e[:, 0], e[:, 1])
    everything = np.concatenate([errors, np.full(len(rows) - len(fixes), np.inf)])
    inverse = np.linalg.inv(np.array([[[ee, en], [en, nn]] for ee, en, nn in c]))
    d2 = np.einsum("ni,nij,nj->n", e, inverse, e)
    radii = {p: np.array([radius(*row, p) for row in c]) for p in (0.5, 0.9, 0.95)}
    times = np.array([r[7] for r in rows], float)
    confidence = np.array([r[6] for r in fixes], float)
    order = np.argsort(-confidence, kind="stable")
    failures = np.cumsum(errors[order] > 20)
    finite = lambda v: None if not np.isfinite(v) else float(v)
    with np.errstate(invalid="ignore"):
        median, p90 = np.percentile(everything, 50), np.percentile(everything, 90)
    figures = {
        "frames": len(rows),
        "fixes": len(fixes),
        **{f"within_{m}m": float(np.mean(everything <= m)) for m in (5, 10, 20, 25)},
        "median_m": finite(median),
        "p90_m": finite(p90),
        "ale_m": float(errors.mean()),
        "bias_east_m": float(e[:, 0].mean()),
        "bias_north_m": float(e[:, 1].mean()),
        "availability": len(fixes) / len(rows),
        "precision": float(np.mean(errors <= 20)),
        "beyond_3_sigma": int(np.sum(d2 > 9)),
        "confidently_wrong": int(np.sum((errors > 100) | ((errors > 20) & (d2 > 9)))),
        "coverage_50": float(np.mean(errors <= radii[0.5])),
        "coverage_90": float(np.mean(errors <= radii[0.9])),
        "coverage_95": float(np.mean(errors <= radii[0.95])),
        "radius95_median_m": float(np.median(radii[0.95])),
        "risk_coverage_area": float(np.mean(failures / np.arange(1, len(fixes) + 1))),
        "time_p50_ms": float(np.percentile(times, 50)),
        "time_p95_ms": float(np.percentile(times, 95)),
    }
    (HERE / "metrics_figures.json").write_text(json.dumps(figures, indent=1) + "\n")


def ranked_mean(scores):
    return float(np.average(scores, weights=np.arange(len(scores), 0, -1))) if len(scores) else 0.0


def retrieval():
    """SDM@K and PDM@K of made-up searches: tiles about the truth, in no good order, of some frames fewer than K, of one none."""
    rng = np.random.default_rng(20260511)
    lon, lat = 13.4, 52.5
    # Radii of curvature of the WGS 84 ellipsoid at the truth: metres per radian.
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    w = math.sqrt(1 - e2 * math.sin(math.radians(lat)) ** 2)
    east_m, north_m = a / w * math.cos(math.radians(lat)), a * (1 - e2) / w**3
    rows, sdm, pdm = [], [], []
    at = [1, 2, 5, 10]
    for frame, (count, tile_m) in enumerate([(12, 128.0), (12, 64.0), (7, 200.0), (0, 64.0), (1, 30.0), (10, 512.0)]):
        places = np.array([lon, lat]) + rng.normal(size=(count, 2)) * [9e-4, 6e-4] * rng.uniform(0, 1, (count, 1))
        rows += [[frame, tile_m, *place] for place in places.tolist()]
        off = places - [lon, lat]
        degrees = np.hypot(off[:, 0], off[:, 1])
        metres = np.hypot(np.radians(off[:, 0]) * east_m, np.radians(off[:, 1]) * north_m)
        sdm.append([ranked_mean(np.exp(-5e3 * degrees[:k])) for k in at])
        pdm.append([ranked_mean(1 / (1 + np.exp(6 * (metres[:k] / tile_m - 0.9)))) for k in at])
    with open(HERE / "retrieval_tiles.csv", "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["frame", "tile_m", "lon_deg", "lat_deg"])
        out.writerows(rows)
    figures = {"frames": len(sdm), "at": at, "sdm": np.mean(sdm, 0).tolist(), "pdm": np.mean(pdm, 0).tolist()}
    (HERE / "retrieval_figures.json").write_text(json.dumps(figures, indent=1) + "\n")


main()
retrieval()
