"""Poses that fit what views show in common, from given ones that do not, by bundle adjustment with the given lenses.

Cameras may be off by several degrees: which features belong together does not depend on them, and each point begins
where its rays come closest. Slight errors are corrected along with the scene (`calibration.poses`), more exactly than
features can; errors that a scene cannot follow are corrected here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from ...capture.bundle import adjust_near
from ...capture.joined_features import join_features
from ...capture.view_matches import Pair, ViewMatches, on_plane, poses_of
from ...errors import InputError
from ..similarity import fit_similarity

_LOSS_SCALES = (16.0, 4.0, 1.0)  # pixels of the robust loss, in one adjustment after the other
_LEAST_POINTS = 15  # that hold a view in its place
_LEAST_INLIERS = 0.8  # share of the matches of a view that its pose has to fit
_LEAST_HELD = 2 / 3  # share of the views whose poses have to be held by matches
_MOST_CONDITION = 1e4  # of the equations for a point; beyond it the rays are all but parallel
_DEVIATION = 0.05  # prior of the camera centres: standard deviation relative to their spread
_MOST_TURN = 3.0  # times the median rotation; a view that is turned farther is wrong
_MOST_POINTS = 30_000  # more make an adjustment slower, not better
_STEPS = 50  # of an adjustment
_POINT_ERROR = 2.0  # pixels, up to which a point is believed


@dataclass(frozen=True)
class AdjustedPoses:
    """What came of an adjustment, in the world of the given cameras.

    Attributes:
        poses: (4, 4) world-to-camera, by index of the views that are held; the others stay as given.
        points: (P, 3) float32 that these views show.
        points_before: (P, 3) float32, where the same were by the given poses.
        colors: (P, 3) uint8 sRGB.
    """

    poses: Mapping[int, NDArray[np.float64]]
    points: NDArray[np.float32]
    points_before: NDArray[np.float32]
    colors: NDArray[np.uint8]


def adjust_poses(matches: ViewMatches, pairs: Sequence[Pair]) -> AdjustedPoses | None:
    """Adjust the given poses to what these pairs of views have in common.

    Returns:
        None where matches hold too few of the views, or the cameras stand on one line.
    """
    given = np.array([view.center for view in matches.views])
    try:
        fit_similarity(given, given)
    except InputError:
        return None
    model, tracks, before = _model(matches, pairs)
    deviation = _DEVIATION * float(np.sqrt(given.var(axis=0).sum()))
    for reach in _LOSS_SCALES:
        adjust_near(model, dict(enumerate(given, 1)), deviation, reach=reach, steps=_STEPS)
    adjusted = [_pose(model.image(view + 1)) for view in range(len(matches.views))]
    held = _held(matches, pairs, adjusted, tracks)
    if len(held) < _LEAST_HELD * len(adjusted):
        return None
    try:
        back = fit_similarity([_center(adjusted[view]) for view in held], given[held])
    except InputError:
        return None
    turn = back.matrix[:3, :3] / back.scale
    poses = {}
    for view in held:
        center = back.matrix[:3, :3] @ _center(adjusted[view]) + back.matrix[:3, 3]
        poses[view] = np.eye(4)
        poses[view][:3, :3] = adjusted[view][:3, :3] @ turn.T
        poses[view][:3, 3] = -poses[view][:3, :3] @ center
    poses = _alike(poses, matches)
    points, colors, kept = _believed(matches, model, set(poses))
    points = points @ back.matrix[:3, :3].T + back.matrix[:3, 3]
    return AdjustedPoses(poses, points.astype(np.float32), before[kept].astype(np.float32), colors)


@dataclass(frozen=True)
class _Tracks:
    """Which views show which points.

    Attributes:
        views, features: (O,) of each observation, by points and then by views.
        of: (O,) the point that it shows, counted from 0.
    """

    views: NDArray[np.int64]
    features: NDArray[np.int64]
    of: NDArray[np.int64]

    def kept(self, points: NDArray[np.bool_]) -> _Tracks:
        """The tracks of these points alone, numbered anew."""
        rows = points[self.of]
        return _Tracks(self.views[rows], self.features[rows], (np.cumsum(points) - 1)[self.of[rows]])


def _tracks(matches: ViewMatches, pairs: Sequence[Pair]) -> _Tracks:
    """Features that are joined by matches, where no view shows a point twice; at most `_MOST_POINTS` points."""
    counts = {view: len(matches.positions(view)) for view in range(len(matches.views))}
    starts, labels = join_features({pair: matches.common(pair) for pair in pairs}, counts)
    order = np.argsort(labels, kind="stable")
    views = np.repeat(list(counts), list(counts.values()))[order]
    tracks = _Tracks(views, order - np.array(list(starts.values()))[views], labels[order])
    sizes = np.bincount(tracks.of)
    twice = np.zeros(len(sizes), bool)
    again = (tracks.of[1:] == tracks.of[:-1]) & (views[1:] == views[:-1])
    twice[tracks.of[1:][again]] = True
    usable = np.flatnonzero((sizes > 1) & ~twice)
    chosen = np.zeros(len(sizes), bool)
    chosen[usable[:: max(-(-len(usable) // _MOST_POINTS), 1)]] = True
    return tracks.kept(chosen)


def _model(matches: ViewMatches, pairs: Sequence[Pair]) -> tuple[pycolmap.Reconstruction, _Tracks, NDArray[np.float64]]:
    """The views in their given poses, and the tracks with (P, 3) points where the rays of each come closest."""
    tracks, poses = _tracks(matches, pairs), poses_of(matches.views)
    points, usable = _closest(matches, tracks, poses)
    tracks, points = tracks.kept(usable), points[usable]
    model = pycolmap.Reconstruction()
    for view, (lens, pose) in enumerate(zip(matches.cameras, poses, strict=True)):
        params = [lens.fx, lens.fy, lens.cx, lens.cy]
        size = {"width": lens.width, "height": lens.height}
        model.add_camera_with_trivial_rig(pycolmap.Camera(camera_id=view + 1, model="PINHOLE", params=params, **size))
        places = [pycolmap.Point2D(place) for place in matches.positions(view)]
        image = pycolmap.Image(name=str(view), camera_id=view + 1, image_id=view + 1, points2D=places)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    elements = [pycolmap.TrackElement(*row) for row in zip(tracks.views + 1, tracks.features, strict=True)]
    ends = np.searchsorted(tracks.of, np.arange(len(points) + 1))
    for point, start, end in zip(points, ends, ends[1:], strict=False):
        model.add_point3D(point, pycolmap.Track(elements[start:end]), np.zeros(3, np.uint8))
    return model, tracks, points


def _closest(
    matches: ViewMatches, tracks: _Tracks, poses: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(P, 3) points with the least squared distance from their rays, and whether they are ahead of all their views."""
    count = int(tracks.of.max(initial=-1)) + 1
    sums, sides = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for view, pose in enumerate(poses):
        rows = np.flatnonzero(tracks.views == view)
        places = on_plane(matches.cameras[view], matches.positions(view)[tracks.features[rows]])
        rays = np.column_stack([places, np.ones(len(rows))]) @ pose[:3, :3]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        # A view shows a point once, so no index comes twice.
        sums[tracks.of[rows]] += across
        sides[tracks.of[rows]] += across @ _center(pose)
    usable = np.linalg.cond(sums) < _MOST_CONDITION if count else np.zeros(0, bool)
    points = np.zeros((count, 3))
    points[usable] = np.linalg.solve(sums[usable], sides[usable][..., None])[..., 0]
    for view, pose in enumerate(poses):
        rows = np.flatnonzero(tracks.views == view)
        usable[tracks.of[rows]] &= points[tracks.of[rows]] @ pose[2, :3] + pose[2, 3] > 0.0
    return points, usable


def _held(
    matches: ViewMatches, pairs: Sequence[Pair], poses: Sequence[NDArray[np.float64]], tracks: _Tracks
) -> list[int]:
    """The views whose adjusted poses fit what they have in common with others, in the largest part that is joined."""
    count = len(poses)
    strong = [pair for pair in pairs if len(matches.common(pair)) >= _LEAST_POINTS]
    fitting = {pair: matches.share_that_fits(pair, poses) for pair in strong}
    rows, columns = np.array([pair for pair in strong if fitting[pair] >= _LEAST_INLIERS], int).reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    largest = np.bincount(labels).argmax()
    points = np.bincount(tracks.views, minlength=count)
    shares: list[list[float]] = [[] for _ in range(count)]
    for pair, share in fitting.items():
        for view in pair:
            shares[view].append(share)
    return [
        view
        for view in np.flatnonzero(labels == largest).tolist()
        if points[view] >= _LEAST_POINTS and shares[view] and np.mean(shares[view]) >= _LEAST_INLIERS
    ]


def _alike(poses: dict[int, NDArray[np.float64]], matches: ViewMatches) -> dict[int, NDArray[np.float64]]:
    """Those poses that are not turned much farther from the given ones than most are: such views hang loosely."""
    given = matches.views
    turns = {
        view: Rotation.from_matrix(pose[:3, :3] @ given[view].world_to_camera[:3, :3].T).magnitude()
        for view, pose in poses.items()
    }
    most = _MOST_TURN * float(np.median(list(turns.values())))
    return {view: pose for view, pose in poses.items() if turns[view] <= most}


def _believed(
    matches: ViewMatches, model: pycolmap.Reconstruction, held: set[int]
) -> tuple[NDArray[np.float64], NDArray[np.uint8], list[int]]:
    """(P, 3) points that fit their places in views that are all held, their (P, 3) colours there, and their tracks."""
    model.update_point_3d_errors()
    points, colors, kept = [], [], []
    for track, number in enumerate(sorted(model.points3D)):
        point = model.points3D[number]
        seen = point.track.elements
        if point.error < _POINT_ERROR and all(element.image_id - 1 in held for element in seen):
            view = seen[0].image_id - 1
            points.append(point.xyz)
            colors.append(matches.color(view, seen[0].point2D_idx))
            kept.append(track)
    return np.array(points, np.float64).reshape(-1, 3), np.array(colors, np.uint8).reshape(-1, 3), kept


def _pose(image: pycolmap.Image) -> NDArray[np.float64]:
    return np.vstack([image.cam_from_world().matrix(), (0.0, 0.0, 0.0, 1.0)])


def _center(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    return -pose[:3, :3].T @ pose[:3, 3]
