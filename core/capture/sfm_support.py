"""How well a reconstruction explains the matches between photographs, above all those that it was not made from.

The judges are points that two photographs alone show: both mappers leave these out, because nothing contradicts a third
unknown, so their matches are held back from every reconstruction. A match is explained where each of its points lies on
the line that the other one's ray draws in its photograph (Sampson's distance; Hartley and Zisserman 2004, 11.4.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from .epipolar import sampson_distances
from .joined_features import join_features
from .sfm_pieces import read_indices

_FITS = 2.0  # pixels of the copies, up to which a match is explained
_MOST = 4.0  # pixels, beyond which it does not matter how far off it is
_FEW_JUDGES = 200  # matches of points that two photographs show, below which all matches judge

Pairs = Mapping[tuple[int, int], NDArray[np.float64]]
"""By two image numbers (n, 2, 2) places in pixels of what was matched, in the first, and in the second photograph."""


@dataclass(frozen=True)
class Matches:
    """Verified matches of a database.

    Attributes:
        every: of them.
        judges: those that no reconstruction was made from, or where these are few, all.
    """

    every: Pairs
    judges: Pairs


def read_matches(database: Path) -> Matches:
    """The matches that agree with the geometry of their two photographs."""
    with pycolmap.Database.open(str(database)) as opened:
        points = {
            image.image_id: np.asarray(opened.read_keypoints(image.image_id), np.float64)[:, :2]
            for image in opened.read_all_images()
        }
    indices = read_indices(database)
    every = {
        (first, second): np.stack([points[first][places[:, 0]], points[second][places[:, 1]]], axis=1)
        for (first, second), places in indices.items()
    }
    if not indices:
        return Matches({}, {})
    lonely = _seen_twice(indices, {image: len(found) for image, found in points.items()})
    judges = {pair: every[pair][lonely[pair]] for pair in every}
    enough = sum(map(len, judges.values())) >= _FEW_JUDGES
    return Matches(every, judges if enough else every)


def _seen_twice(
    indices: Mapping[tuple[int, int], NDArray[np.int64]], counts: Mapping[int, int]
) -> dict[tuple[int, int], NDArray[np.bool_]]:
    """Of each match, whether it is the only one of its point."""
    starts, labels = join_features(indices, counts)
    sizes = np.bincount(labels)
    return {pair: sizes[labels[places[:, 0] + starts[pair[0]]]] == 2 for pair, places in indices.items()}


@dataclass(frozen=True)
class Support:
    """What matches say of a reconstruction.

    Attributes:
        cost: mean over the judging matches, from 0 (all fit) to 1 (none does); matches of photographs without a place
            do not fit.
        shares: of every image number with a place, the share of its matches with others that have one which fit.
    """

    cost: float
    shares: Mapping[int, float]


def support_of(model: pycolmap.Reconstruction, matches: Matches) -> Support:
    """Ask the matches; `model` has its cameras for photographs of the size in which the matches were found."""
    total = sum(map(len, matches.judges.values()))
    distances = _distances(model, matches.judges)
    costs = sum(
        float(np.minimum(of_pair / _MOST, 1.0) @ np.minimum(of_pair / _MOST, 1.0)) for of_pair in distances.values()
    )
    without = total - sum(map(len, distances.values()))
    fits: dict[int, int] = dict.fromkeys(model.reg_image_ids(), 0)
    counts = dict(fits)
    for pair, of_pair in _distances(model, matches.every).items():
        for image in pair:
            fits[image] += int(np.count_nonzero(of_pair < _FITS))
            counts[image] += len(of_pair)
    shares = {image: fits[image] / counts[image] if counts[image] else 0.0 for image in counts}
    return Support((costs + without) / total if total else 1.0, shares)


def _distances(model: pycolmap.Reconstruction, pairs: Pairs) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Of the matches of every pair of photographs with places, in pixels."""
    placed = set(model.reg_image_ids())
    return {
        (first, second): _sampson(model.image(first), model.image(second), model, places)
        for (first, second), places in pairs.items()
        if first in placed and second in placed and len(places)
    }


def _sampson(
    first: pycolmap.Image, second: pycolmap.Image, model: pycolmap.Reconstruction, places: NDArray[np.float64]
) -> NDArray[np.float64]:
    cameras = model.camera(first.camera_id), model.camera(second.camera_id)
    own, others = (
        np.asarray(camera.cam_from_img(np.ascontiguousarray(places[:, side])), np.float64)
        for side, camera in enumerate(cameras)
    )
    focal = sum(camera.mean_focal_length() for camera in cameras) / 2.0
    distances = sampson_distances(own, others, second.cam_from_world() * first.cam_from_world().inverse()) * focal
    return np.nan_to_num(distances, nan=np.inf)  # of a place that the lens does not have
