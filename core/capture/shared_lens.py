"""One lens for views that COLMAP calibrated one by one, where their tracks bear that out.

Photographs of one phone that went through COLMAP without ``--single_camera`` have as many focal lengths as views, and
each makes up for what is wrong with its pose. Such views agree less with each other than their reprojection errors say.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from .bundle import adjust, extended_params
from .colmap_files import ColmapModel

_LEAST_VIEWS = 20  # of one lens; fewer are better judged one by one
_LEAST_POINTS = 500
_MOST_POINTS = 30_000  # of the adjustment; more make it slower, not better
_LEAST_TRACK, _LEAST_HELD_TRACK = 2, 4  # images that see a point, and those of which one may be held out
_HELD_EVERY = 4  # points of which an observation is held out
_LEAST_HELD = 100
_AS_GOOD = 1.05  # ratio of errors up to which the simpler explanation wins
_MOST_ZOOM = 0.1  # spread of the focal lengths, between their quartiles, relative to the middle one
_LENS = "RADIAL"  # f, cx, cy, k1, k2: suits phones and ordinary lenses
_ONE_FOCAL = {"SIMPLE_PINHOLE": 0, "SIMPLE_RADIAL": 1, "RADIAL": 2}  # numbers of distortion
_STEPS = 50  # of an adjustment


@dataclass(frozen=True)
class SharedLens:
    """What was found.

    Attributes:
        model: the same with one lens, or as it was where that explains the tracks less well.
        views: how many share the lens; 0 where they do not.
        focal_length: of the lens, in pixels.
        error_apart, error_shared: median distance in pixels of observations that were held out, with a camera for every
            view and with one.
    """

    model: ColmapModel
    views: int
    focal_length: float
    error_apart: float
    error_shared: float


def may_share_lens(model: ColmapModel) -> bool:
    """Whether (nearly) every view has a camera of its own, and these look like one lens."""
    cameras = [model.cameras[image.camera_id] for image in model.images]
    used = Counter(image.camera_id for image in model.images)
    if len(cameras) < _LEAST_VIEWS or max(used.values()) > 1:
        return False
    if any(camera.model.name not in _ONE_FOCAL for camera in cameras):
        return False
    if len({(camera.model.name, camera.width, camera.height) for camera in cameras}) > 1:
        return False
    low, middle, high = np.percentile([camera.params[0] for camera in cameras], [25, 50, 75])
    return bool(high - low <= _MOST_ZOOM * middle)


def share_lens(model: ColmapModel) -> SharedLens | None:
    """Adjust poses, points and one lens to the tracks of a model, and keep them if held-out observations bear it out.

    Both explanations, a camera for every view and one lens, are fitted to the same observations by bundle adjustment
    and judged by the others. Deterministic.

    Args:
        model: read with its observations; `may_share_lens`.

    Returns:
        None where its tracks are too few to judge.
    """
    if len(model.points) < _LEAST_POINTS:
        return None
    tracks = _tracks(model)
    held = tracks.held_out()
    if len(tracks.points) < _LEAST_POINTS or len(held) < _LEAST_HELD:
        return None
    lens = _lens(model)
    errors = []
    for camera in (None, lens):
        fitted = _reconstruction(model, tracks, camera, held)
        adjust(fitted, robust=False, steps=_STEPS)
        errors.append(_median_error(fitted, tracks, held))
    apart, shared = errors
    if not shared <= _AS_GOOD * apart:
        return SharedLens(model, 0, lens.params[0], apart, shared)
    final = _reconstruction(model, tracks, lens, set())
    adjust(final, robust=False, steps=_STEPS)
    (fitted_lens,) = final.cameras.values()
    if not (np.isfinite(fitted_lens.params).all() and fitted_lens.focal_length > 0.0):
        return SharedLens(model, 0, lens.params[0], apart, shared)
    return SharedLens(_with(model, final, tracks), len(model.images), fitted_lens.focal_length, apart, shared)


@dataclass(frozen=True)
class _Tracks:
    """Which images see which points, and where.

    Attributes:
        points: (P,) indices of the model's points that take part, in order.
        images: (O,) index of the image, `of` (O,) place of the point in `points`, and `positions` (O, 2) pixels; by
            points, then by images.
    """

    points: NDArray[np.int64]
    images: NDArray[np.int64]
    of: NDArray[np.int64]
    positions: NDArray[np.float64]

    def held_out(self) -> set[int]:
        """Observations that do not take part in a trial: one of every few points that enough images see."""
        starts = np.searchsorted(self.of, np.arange(len(self.points)))
        lengths = np.diff(np.append(starts, len(self.of)))
        long = np.flatnonzero(lengths >= _LEAST_HELD_TRACK)[::_HELD_EVERY]
        # Another place in every track, so that no image loses more than others.
        return {int(starts[point] + number % lengths[point]) for number, point in enumerate(long)}

    def rows(self, place: int) -> range:
        """The observations of the point at a place."""
        return range(*np.searchsorted(self.of, [place, place + 1]))


def _tracks(model: ColmapModel) -> _Tracks:
    """The tracks of points that are finite and seen twice, at most `_MOST_POINTS`, spread over the model."""
    order = np.argsort(model.point_numbers, kind="stable")
    numbers = model.point_numbers[order].astype(np.int64)
    images, points, positions = [], [], []
    for index, image in enumerate(model.images):
        seen = image.observations
        usable = np.isfinite(seen["position"]).all(axis=1) & (np.abs(seen["position"]) < 1e6).all(axis=1)
        _, first = np.unique(seen["point"], return_index=True)  # an image sees a point once
        usable &= np.isin(np.arange(len(seen)), first)
        place = np.minimum(np.searchsorted(numbers, seen["point"]), len(numbers) - 1)
        usable &= numbers[place] == seen["point"]
        points.append(order[place[usable]])
        images.append(np.full(len(points[-1]), index))
        positions.append(seen["position"][usable])
    of = np.concatenate(points)
    counts = np.bincount(of, minlength=len(model.points))
    chosen = np.flatnonzero((counts >= _LEAST_TRACK) & np.isfinite(model.points).all(axis=1))
    chosen = chosen[:: max(-(-len(chosen) // _MOST_POINTS), 1)]
    places = np.full(len(model.points), -1)
    places[chosen] = np.arange(len(chosen))
    image_of, position_of = np.concatenate(images), np.concatenate(positions)
    kept = np.flatnonzero(places[of] >= 0)
    kept = kept[np.lexsort((image_of[kept], places[of[kept]]))]
    return _Tracks(chosen, image_of[kept], places[of[kept]], position_of[kept])


def _lens(model: ColmapModel) -> pycolmap.Camera:
    """The middle one of the cameras, as the lens to begin with."""
    cameras = [model.cameras[image.camera_id] for image in model.images]
    first = cameras[0]
    lens = pycolmap.Camera.create_from_model_name(1, _LENS, 1.0, first.width, first.height)
    middle = np.median([camera.params for camera in cameras], axis=0)
    lens.params = extended_params(list(middle), lens)
    return lens


def _reconstruction(
    model: ColmapModel, tracks: _Tracks, lens: pycolmap.Camera | None, held: set[int]
) -> pycolmap.Reconstruction:
    """The model as pycolmap holds it, with the images numbered from 1; without the observations `held`."""
    made = pycolmap.Reconstruction()
    if lens is not None:
        made.add_camera_with_trivial_rig(lens)
    rows_of: list[list[int]] = [[] for _ in model.images]
    element: dict[int, int] = {}
    for row, image in enumerate(tracks.images):
        if row not in held:
            element[row] = len(rows_of[image])
            rows_of[image].append(row)
    for index, image in enumerate(model.images):
        number = 1
        if lens is None:
            number = index + 1
            own = model.cameras[image.camera_id]
            camera = pycolmap.Camera(
                camera_id=number, model=own.model, width=own.width, height=own.height, params=list(own.params)
            )
            made.add_camera_with_trivial_rig(camera)
        points = [pycolmap.Point2D(tracks.positions[row]) for row in rows_of[index]]
        pose = pycolmap.Rigid3d(image.world_to_camera)
        made.add_image_with_trivial_frame(
            pycolmap.Image(name=str(index), camera_id=number, image_id=index + 1, points2D=points), pose
        )
    for place, point in enumerate(tracks.points):
        track = pycolmap.Track(
            [
                pycolmap.TrackElement(int(tracks.images[row]) + 1, element[row])
                for row in tracks.rows(place)
                if row in element
            ]
        )
        made.add_point3D(model.points[point].astype(np.float64), track, np.zeros(3, np.uint8))
    return made


def _point_numbers(model: pycolmap.Reconstruction) -> list[int]:
    """The numbers that pycolmap gave the points, in the order in which they were added."""
    return sorted(model.points3D)


def _median_error(model: pycolmap.Reconstruction, tracks: _Tracks, held: set[int]) -> float:
    """Median distance in pixels of the observations `held`; infinite where most are behind their cameras."""
    numbers = _point_numbers(model)
    errors = []
    for row in sorted(held):
        point = model.points3D[numbers[tracks.of[row]]].xyz
        projected = model.images[int(tracks.images[row]) + 1].project_point(point)
        errors.append(np.inf if projected is None else float(np.linalg.norm(projected - tracks.positions[row])))
    return float(np.median(errors))


def _with(model: ColmapModel, fitted: pycolmap.Reconstruction, tracks: _Tracks) -> ColmapModel:
    """The model with the lens, poses and points that were fitted; further points stay where they are."""
    ((number, lens),) = fitted.cameras.items()
    images = []
    for index, image in enumerate(model.images):
        pose = fitted.images[index + 1].cam_from_world()
        x, y, z, w = pose.rotation.quat
        images.append(
            replace(image, camera_id=number, quaternion=(w, x, y, z), translation=tuple(map(float, pose.translation)))
        )
    points = model.points.copy()
    points[tracks.points] = [fitted.points3D[point].xyz for point in _point_numbers(fitted)]
    return replace(model, cameras={number: lens}, images=images, points=points)


def describe(found: SharedLens, file: Path) -> str:
    """One line on a lens that is shared."""
    errors = f"{found.error_shared:.2f} px on held-out tracks, {found.error_apart:.2f} with a camera for each"
    return f"{file}: one lens is fitted to all {found.views} views, f {found.focal_length:.0f} px ({errors})"
