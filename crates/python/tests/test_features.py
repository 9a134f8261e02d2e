"""`features` and `match` against numpy."""

import sys

import grimnet
import numpy as np
import pytest


@pytest.fixture(scope="module")
def pair(photos):
    return [grimnet.features(path, max_side_px=640, max_keypoints=400) for path in photos[:2]]


def test_features(pair, photos):
    first = pair[0]
    n = len(first)
    assert 50 < n <= 400
    width, height = first.size_px
    assert max(width, height) == 640 and first.full_size_px[0] > 640
    assert first.keypoints_px.shape == (n, 2) and first.scores.shape == (n,)
    assert first.descriptors.shape[0] == n and first.descriptors.dtype == np.float32
    assert np.allclose(np.linalg.norm(first.descriptors, axis=1), 1.0, atol=1e-4)
    assert np.isclose(np.linalg.norm(first.global_descriptor), 1.0, atol=1e-4)
    x, y = first.keypoints_px.T
    assert x.min() >= 0 and x.max() <= width - 1 and y.min() >= 0 and y.max() <= height - 1
    assert (np.diff(first.scores) <= 0).all() and first.scores[-1] >= 0.005
    with pytest.raises(ValueError, match="read-only"):
        first.scores[0] = 2.0
    again = grimnet.features(grimnet.read_photo(photos[0], max_side_px=640), max_keypoints=400)
    assert np.array_equal(again.descriptors, first.descriptors)
    assert again.full_size_px == again.size_px == first.size_px
    # An array is reduced as a file is.
    as_array = grimnet.features(grimnet.read_photo(photos[0]), max_side_px=640, max_keypoints=400)
    assert np.array_equal(as_array.descriptors, first.descriptors)
    assert (as_array.size_px, as_array.full_size_px) == (first.size_px, first.full_size_px)
    own = grimnet.FeatureExtractor(domain="sat").features(photos[0], max_side_px=640, max_keypoints=400)
    assert not np.array_equal(own.global_descriptor, first.global_descriptor), "maps have statistics of their own"


def test_precision_changes_descriptors_and_no_keypoints(pair, photos):
    int8 = grimnet.FeatureExtractor(precision="int8").features(photos[0], max_side_px=640, max_keypoints=400)
    assert np.array_equal(int8.keypoints_px, pair[0].keypoints_px)
    similarity = (int8.descriptors * pair[0].descriptors).sum(axis=1)
    assert 0.99 < np.median(similarity) < 1.0 - 1e-6
    with pytest.raises(grimnet.InvalidValueError, match="precision"):
        grimnet.FeatureExtractor(precision="f16")
    with pytest.raises(grimnet.InvalidValueError, match="max_side_px is 0"):
        grimnet.features(photos[0], max_side_px=0)


def test_pixels_that_were_added_have_no_keypoints(photos):
    """Sides that are no multiples of 32 are padded, and the added pixels masked: no keypoint is within 4 px of them."""
    picture = grimnet.read_photo(photos[0], max_side_px=640)[:250, :330]
    found = grimnet.features(picture)
    assert found.size_px == (330, 250)
    assert found.keypoints_px[:, 0].max() < 330 - 4 and found.keypoints_px[:, 1].max() < 250 - 4


@pytest.mark.parametrize("max_ratio", [None, 0.9])
def test_match_is_mutual_nearest_neighbours(pair, max_ratio):
    a, b = (features.descriptors for features in pair)
    similarity = a.astype(np.float64) @ b.T.astype(np.float64)
    to_b, to_a = similarity.argmax(axis=1), similarity.argmax(axis=0)
    expected = [(i, j) for i, j in enumerate(to_b) if to_a[j] == i]
    if max_ratio is not None:
        distance = np.sqrt(np.maximum(0.0, 2.0 - 2.0 * np.sort(similarity, axis=1)[:, ::-1]))
        expected = [(i, j) for i, j in expected if distance[i, 0] < max_ratio * distance[i, 1]]
    found = grimnet.match(*pair, max_ratio=max_ratio)
    assert len(found) == len(found.indices) == len(found.similarities) > 5
    # Rounding to single precision may decide near ties otherwise.
    agreeing = set(map(tuple, found.indices.tolist())) & set(expected)
    assert len(agreeing) >= 0.99 * max(len(found), len(expected))
    i, j = found.indices.T
    assert np.allclose(found.similarities, similarity[i, j], atol=1e-4)
    # Descriptors in records, which begin at any byte.
    records = np.zeros(len(a), [("image", np.uint8), ("descriptor", np.float32, a.shape[1])])
    records["descriptor"] = a
    for first, second in ((a, b), (np.asfortranarray(a), np.repeat(b, 2, axis=0)[::2]), (records["descriptor"], b)):
        assert np.array_equal(grimnet.match(first, second, max_ratio=max_ratio).indices, found.indices)


def test_a_picture_matches_itself(pair):
    found = grimnet.match(pair[0], pair[0])
    assert (found.indices[:, 0] == found.indices[:, 1]).all()
    assert np.allclose(found.similarities, 1.0, atol=1e-4)


def test_wrong_input(pair, photos):
    for bad in (np.zeros((3, 4)), np.zeros(4, np.float32), "a.jpg"):
        with pytest.raises(grimnet.InvalidValueError):
            grimnet.match(bad, pair[0])
    with pytest.raises(grimnet.InvalidValueError, match="dimension"):
        grimnet.match(np.zeros((3, 4), np.float32), pair[0])
    with pytest.raises(grimnet.InvalidValueError):
        grimnet.match(*pair, max_ratio=0.0)
    # A pebibyte of similarities: refused, where the lack of memory would end the process.
    many = np.zeros((1 << 24, 1), np.float32)
    with pytest.raises(grimnet.InvalidValueError, match="no memory for 16777216 x 16777216 similarities"):
        grimnet.match(many, many)
    with pytest.raises(grimnet.InvalidValueError, match="domain"):
        grimnet.FeatureExtractor(domain="map")
    with pytest.raises(grimnet.InvalidValueError, match="threshold"):
        grimnet.features(photos[0], threshold=2.0)
    for name, bad in [("max_keypoints", -1), *((name, bad) for name in ("nms_radius_px", "max_side_px") for bad in (-1, 2**32))]:
        with pytest.raises(grimnet.InvalidValueError, match=f"{name} is {bad}; expected a whole number"):
            grimnet.features(photos[0], **{name: bad})
    # As many as there are.
    assert len(grimnet.features(photos[0], max_keypoints=sys.maxsize)) > 0
    with pytest.raises(grimnet.InvalidValueError, match="max_side_px is -1"):
        grimnet.read_photo(photos[0], max_side_px=-1)
    empty = np.zeros((0, pair[0].descriptors.shape[1]), np.float32)
    assert len(grimnet.match(empty, pair[0])) == 0
