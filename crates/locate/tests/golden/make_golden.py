"""Writes geometry.json: noisy points with OpenCV's answers.

Needs numpy and opencv-python-headless (made with opencv 4 or later). Run here: python make_golden.py
"""
import json

import cv2
import numpy as np

rng = np.random.default_rng(20261121)


def similarity(scale, degrees, shift):
    c, s = scale * np.cos(np.radians(degrees)), scale * np.sin(np.radians(degrees))
    return np.array([[c, -s, shift[0]], [s, c, shift[1]], [0, 0, 1.0]])


def through(m, points):
    h = np.c_[points, np.ones(len(points))] @ m.T
    return h[:, :2] / h[:, 2:]


def scene(m, inliers, outliers, noise):
    "Points on a 512 px picture, mapped by m with noise; outliers anywhere but near the truth. Shuffled."
    a = rng.uniform(0, 512, (inliers + outliers, 2))
    b = through(m, a)
    b[:inliers] += rng.normal(0, noise, (inliers, 2))
    b[inliers:] += rng.uniform(25, 250, (outliers, 2)) * rng.choice([-1, 1], (outliers, 2))
    order = rng.permutation(len(a))
    # What is written is what OpenCV sees.
    return np.round(a[order], 4), np.round(b[order], 4), sorted(int(i) for i in np.nonzero(order < inliers)[0])


cases = []
for number in range(6):
    m = similarity(rng.uniform(0.8, 1.25), rng.uniform(-180, 180), rng.uniform(-200, 200, 2))
    m = m @ np.array([[1, rng.uniform(-0.1, 0.1), 0], [0, rng.uniform(0.9, 1.1), 0], [*rng.uniform(-2e-4, 2e-4, 2), 1]])
    a, b, inliers = scene(m, int(rng.integers(12, 120)), int(rng.integers(0, 120)), rng.uniform(0.2, 0.8))
    all_points, _ = cv2.findHomography(a[inliers], b[inliers], 0)
    robust, mask = cv2.findHomography(a, b, cv2.RANSAC, 4.0, maxIters=5000, confidence=0.9999)
    cases.append({"kind": "homography", "from": a.tolist(), "to": b.tolist(), "inliers": inliers,
                  "opencv_least_squares": all_points.tolist(), "opencv_ransac": robust.tolist(),
                  "opencv_inliers": np.nonzero(mask.ravel())[0].tolist()})
for number in range(4):
    m = similarity(rng.uniform(0.8, 1.25), rng.uniform(-180, 180), rng.uniform(-200, 200, 2))
    a, b, inliers = scene(m, int(rng.integers(10, 80)), int(rng.integers(0, 160)), rng.uniform(0.2, 0.8))
    robust, mask = cv2.estimateAffinePartial2D(a, b, method=cv2.RANSAC, ransacReprojThreshold=4, maxIters=5000,
                                               confidence=0.9999, refineIters=50)
    cases.append({"kind": "similarity", "from": a.tolist(), "to": b.tolist(), "inliers": inliers,
                  "opencv_ransac": robust.tolist() + [[0, 0, 1]], "opencv_inliers": np.nonzero(mask.ravel())[0].tolist()})

# Matching: brute force over float descriptors, cross-checked, with Lowe's ratio.
a = rng.normal(size=(90, 32)).astype(np.float32)
b = np.concatenate([a[:60] + rng.normal(0, 0.45, (60, 32)).astype(np.float32), rng.normal(size=(50, 32)).astype(np.float32)])
a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b[rng.permutation(len(b))]))
a, b = np.round(a, 5), np.round(b, 5)
cross = [(m.queryIdx, m.trainIdx) for m in cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(a, b)]
ratio = {m.queryIdx for m, n in cv2.BFMatcher(cv2.NORM_L2).knnMatch(a, b, k=2) if m.distance < 0.8 * n.distance}
matching = {"dim": 32, "query": a.ravel().astype(float).round(5).tolist(), "tile": b.ravel().astype(float).round(5).tolist(), "mutual": sorted(cross),
            "mutual_ratio_0.8": sorted(p for p in cross if p[0] in ratio)}
json.dump({"cases": cases, "matching": matching}, open("geometry.json", "w"), separators=(",", ":"), default=lambda x: round(float(x), 6))
