"""Where on this map was this photo taken? Localises drone photos without GNSS and without network.

A map is built once into a pack (`build_pack`). A `Localizer` answers for each photo with a `Fix` or, with the reason, with
`NoFix`; a `Tracker` follows a flight. `FeatureExtractor`, `features` and `match` give the network's output for research.
"""

from functools import lru_cache as _lru_cache

from ._grimnet import (
    BuildProgress,
    BuildReport,
    FeatureExtractor,
    Features,
    Fix,
    GrimnetError,
    InvalidValueError,
    Localizer,
    MapError,
    Matches,
    ModelError,
    NoFix,
    PackError,
    PhotoError,
    Tracker,
    TrackPoint,
    __version__,
    build_pack,
    match,
    read_photo,
)

__all__ = [
    "BuildProgress",
    "BuildReport",
    "FeatureExtractor",
    "Features",
    "Fix",
    "GrimnetError",
    "InvalidValueError",
    "Localizer",
    "MapError",
    "Matches",
    "ModelError",
    "NoFix",
    "PackError",
    "PhotoError",
    "TrackPoint",
    "Tracker",
    "__version__",
    "build_pack",
    "features",
    "match",
    "read_photo",
]


@_lru_cache(maxsize=2)
def _bundled_extractor(domain):
    return FeatureExtractor(domain=domain)


def features(picture, *, domain="uav", max_keypoints=1024, threshold=0.005, nms_radius_px=2, max_side_px=1024):
    """The features of a picture under the bundled model: `FeatureExtractor(domain=domain).features(picture, ...)`."""
    return _bundled_extractor(domain).features(
        picture,
        max_keypoints=max_keypoints,
        threshold=threshold,
        nms_radius_px=nms_radius_px,
        max_side_px=max_side_px,
    )
