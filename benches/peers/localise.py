"""Localises photos by OpenCV's SIFT or by XFeat, every tile of the map tried, the tile of most inliers taken.

Usage: localise.py sift FOLDER [--footprint-width M] [--heading known|unknown] [--gsd 0.25]
       localise.py xfeat FOLDER [--footprint-width M] [--heading known|unknown] [--gsd 0.25] --onnx xfeat_640x640.onnx
FOLDER is laid out as for `grim eval`: map.tif, photos/, truth.csv. Without --footprint-width each photo's own is taken from the column
footprint_w_m of truth.csv. Photos that are mostly flat (flat_frac above 0.5) have nothing to find and are left out. Right is an answer within
5 % of the footprint, wrong one beyond 5 % and three times truth_err_m. Each photo is resampled to the map's working resolution as its
footprint and heading say (unknown: twelve headings), reduced by area averages as the map is; a similarity is estimated by RANSAC.
There is no retrieval and no gate: a photo is always answered if any tile has a transform. Prints one line of JSON, the fields as in a
claim.json's `peers`.
"""
import argparse
import csv
import json
import math
import pathlib
import statistics
import time

import cv2
import numpy as np
import rasterio
from rasterio.warp import transform as to_crs

TILE_PX, STRIDE_PX = 640, 320
HEADINGS_DEG = range(0, 360, 30)
METRES_PER_DEGREE = 111_320.0


class Sift:
    """2,048 keypoints, mutual nearest neighbours with Lowe's ratio."""

    name = 'SIFT (OpenCV)'

    def __init__(self):
        self.sift = cv2.SIFT_create(2048)

    def features(self, grey):
        points, descriptors = self.sift.detectAndCompute(grey, None)
        if descriptors is None:
            return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
        return np.float32([point.pt for point in points]), unit(descriptors)

    def keep(self, similarity):
        best = np.partition(similarity, -2, axis=1)[:, -2:]
        second, first = np.sqrt(np.maximum(0, 2 - 2 * best)).T
        return first < 0.8 * second


class XFeat:
    """640 x 640 grey, 1,024 keypoints, mutual nearest neighbours of cosine above 0.82."""

    name = 'XFeat (ONNX)'

    def __init__(self, path):
        import onnxruntime
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 2
        self.session = onnxruntime.InferenceSession(path, options)

    def features(self, grey):
        side = TILE_PX
        image = np.zeros((side, side), np.float32)
        image[:grey.shape[0], :grey.shape[1]] = grey / 255.0
        image = (image - image.mean()) / (image.std() + 1e-5)
        fields, logits, reliability = self.session.run(None, {'input': image[None, None].astype(np.float32)})
        cells = np.exp(logits[0] - logits[0].max(-1, keepdims=True))
        cells = (cells / cells.sum(-1, keepdims=True))[..., :64]
        heat = cells.reshape(side // 8, side // 8, 8, 8).transpose(0, 2, 1, 3).reshape(side, side)
        peak = (heat == cv2.dilate(heat, np.ones((5, 5)))) & (heat > 0.05)
        peak[:grey.shape[0], :grey.shape[1]] &= grey > 0
        peak[grey.shape[0]:], peak[:, grey.shape[1]:] = False, False
        y, x = np.nonzero(peak)
        score = heat[y, x] * cv2.resize(reliability[0, 0], (side, side))[y, x]
        best = np.argsort(-score)[:1024]
        y, x = y[best].astype(np.float32), x[best].astype(np.float32)
        at = (x + 0.5) / 8 - 0.5, (y + 0.5) / 8 - 0.5
        sampled = [cv2.remap(fields[0][..., c], at[0][:, None], at[1][:, None], cv2.INTER_LINEAR,
                             borderMode=cv2.BORDER_REPLICATE)[:, 0] for c in range(64)] if len(x) else [np.zeros(0)] * 64
        return np.stack([x, y], 1), unit(np.stack(sampled, 1))

    def keep(self, similarity):
        return similarity.max(1) > 0.82


def unit(rows):
    return (rows / (np.linalg.norm(rows, axis=1, keepdims=True) + 1e-9)).astype(np.float32)


def matches(method, a, b):
    """Index pairs of mutual nearest neighbours that the method keeps."""
    similarity = a @ b.T
    if min(similarity.shape) < 2:
        return np.zeros((0, 2), int)
    nearest, back = similarity.argmax(1), similarity.argmax(0)
    mutual = (back[nearest] == np.arange(len(a))) & method.keep(similarity)
    return np.stack([np.nonzero(mutual)[0], nearest[mutual]], 1)


class Map:
    """The map as a grey picture at the working resolution, and its tiles' features."""

    def __init__(self, path, gsd_m, method):
        with rasterio.open(path) as source:
            self.transform, self.crs = source.transform, source.crs
            pixels = source.read([1, 2, 3]).transpose(1, 2, 0)
            middle = self.lonlat(np.array([source.width / 2, source.height / 2]))
            right = self.lonlat(np.array([source.width / 2 + 100, source.height / 2]))
        self.map_gsd_m = distance_m(middle, right) / 100
        self.scale = self.map_gsd_m / gsd_m
        grey = cv2.cvtColor(cv2.resize(pixels, None, fx=self.scale, fy=self.scale, interpolation=cv2.INTER_AREA),
                            cv2.COLOR_RGB2GRAY)
        self.tiles = [(np.array([x, y]), *method.features(np.ascontiguousarray(grey[y:y + TILE_PX, x:x + TILE_PX])))
                      for y in starts(grey.shape[0]) for x in starts(grey.shape[1])]

    def lonlat(self, map_px):
        x, y = self.transform * tuple(map_px)
        (lon,), (lat,) = to_crs(self.crs, 'EPSG:4326', [x], [y])
        return lon, lat


def starts(length):
    return sorted({*range(0, max(1, length - TILE_PX), STRIDE_PX), max(0, length - TILE_PX)})


def distance_m(a, b):
    east = (a[0] - b[0]) * math.cos(math.radians((a[1] + b[1]) / 2))
    return math.hypot(east, a[1] - b[1]) * METRES_PER_DEGREE


def locate(method, area, photo, headings_deg, scale):
    """Longitude and latitude of the photo's centre by the tile of most inliers; None without any transform."""
    most, place = 0, None
    height, width = photo.shape
    for heading in headings_deg:
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), -heading, scale)
        turn[:, 2] += TILE_PX / 2 - np.array([width / 2, height / 2])
        points, descriptors = method.features(cv2.warpAffine(photo, turn, (TILE_PX, TILE_PX), flags=cv2.INTER_LINEAR))
        for corner, tile_points, tile_descriptors in area.tiles:
            pairs = matches(method, descriptors, tile_descriptors)
            if len(pairs) < 8:
                continue
            similarity, inliers = cv2.estimateAffinePartial2D(
                points[pairs[:, 0]], tile_points[pairs[:, 1]], method=cv2.RANSAC, ransacReprojThreshold=6, maxIters=2000)
            if similarity is None or not 0.7 < math.hypot(*similarity[:, 0]) < 1.4:
                continue
            if inliers.sum() > most:
                most = int(inliers.sum())
                centre = similarity @ [TILE_PX / 2, TILE_PX / 2, 1] + corner
                place = area.lonlat(centre / area.scale)
    return place


def column(row, *names):
    return next(float(row[name]) for name in names if row.get(name))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('method', choices=['sift', 'xfeat'])
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--footprint-width', type=float, help='metres of ground that every photo shows across')
    parser.add_argument('--heading', choices=['known', 'unknown'], default='known')
    parser.add_argument('--gsd', type=float, default=0.25, help='metres a pixel at which both are compared')
    parser.add_argument('--onnx', help='the XFeat network')
    arguments = parser.parse_args()
    if arguments.method == 'xfeat' and not arguments.onnx:
        parser.error('xfeat needs --onnx, the network')
    method = Sift() if arguments.method == 'sift' else XFeat(arguments.onnx)
    area = Map(arguments.folder / 'map.tif', arguments.gsd, method)
    errors, times, right, wrong = [], [], 0, 0
    with open(arguments.folder / 'truth.csv', newline='') as rows:
        for row in csv.DictReader(rows):
            if float(row.get('flat_frac') or 0) > 0.5:
                continue
            photo = cv2.imread(str(arguments.folder / 'photos' / row['photo']), cv2.IMREAD_GRAYSCALE)
            truth = column(row, 'centre_lon', 'lon_deg'), column(row, 'centre_lat', 'lat_deg')
            known = arguments.heading == 'known'
            headings = [column(row, 'flight_yaw_deg', 'heading_deg')] if known else HEADINGS_DEG
            start = time.perf_counter()
            footprint_m = arguments.footprint_width or column(row, 'footprint_w_m')
            scale = footprint_m / arguments.gsd / photo.shape[1]
            if scale < 1:
                # As the map is reduced: warpAffine has no area averaging, and four neighbours of a pixel alias.
                photo, scale = cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), 1.0
            place = locate(method, area, photo, headings, scale)
            times.append(time.perf_counter() - start)
            errors.append(distance_m(place, truth) if place else math.inf)
            right += errors[-1] <= 0.05 * footprint_m
            wrong += place is not None and errors[-1] > 0.05 * footprint_m + 3 * float(row.get('truth_err_m') or 0)
    within = {f'within_{m}m': round(sum(e < m for e in errors) / len(errors), 3) for m in (5, 10, 20)}
    print(json.dumps({'name': method.name, 'run': f'heading_{arguments.heading}', 'frames': len(errors), **within,
                      'right': right, 'wrong': wrong, 'median_m': round(statistics.median(errors), 2), 'seconds_a_frame': round(statistics.mean(times), 2)}))


main()
