"""Several reconstructions of one set of photographs joined into one, by the points that they have in common.

A photograph that two pieces have placed shows points of both, and so does a match between a photograph of one and a
photograph of the other. Where enough of these pairs of points agree on one similarity (Umeyama 1991, in RANSAC), the
smaller piece's photographs take their places beside the larger one's, and all points are triangulated anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

Indices = Mapping[tuple[int, int], NDArray[np.int64]]
"""By two image numbers (n, 2) the numbers of their features that were matched."""

_LEAST_PAIRS = 15  # of points that agree; RANSAC finds fewer by chance
_LEAST_SHARE = 0.25  # of the pairs, that agree
_AGREE = 0.03  # of a piece's extent, up to which two points are the same


def join_pieces(
    pieces: Sequence[pycolmap.Reconstruction], database: Path, images: Path, workspace: Path, seed: int
) -> pycolmap.Reconstruction | None:
    """The largest of `pieces` with all that can be joined to it; None where nothing can.

    Args:
        pieces: made from one database; not changed.
        database: of matched features.
        images: folder of the photographs, for the points' colours.
        workspace: a new folder.
        seed: of RANSAC.
    """
    ordered = sorted(pieces, key=lambda piece: piece.num_reg_images(), reverse=True)
    whole, left = pycolmap.Reconstruction(ordered[0]), list(ordered[1:])
    matches, before = read_indices(database), whole.num_reg_images()
    while left:
        # A piece may hold on to the whole only by one that was joined before.
        for piece in left:
            fit = _similarity(piece, whole, matches, seed)
            if fit is not None:
                whole = _with_piece(whole, piece, fit, database, images, workspace, seed)
                left.remove(piece)
                break
        else:
            break
    return whole if whole.num_reg_images() > before else None


def read_indices(database: Path) -> Indices:
    """The matches that agree with the geometry of their two photographs."""
    with pycolmap.Database.open(str(database)) as opened:
        pairs, geometries = opened.read_two_view_geometries()
    return {
        pycolmap.pair_id_to_image_pair(pair): np.asarray(geometry.inlier_matches, np.int64)
        for pair, geometry in zip(pairs, geometries, strict=True)
        if len(geometry.inlier_matches)
    }


def _similarity(
    piece: pycolmap.Reconstruction, whole: pycolmap.Reconstruction, matches: Indices, seed: int
) -> pycolmap.Sim3d | None:
    """What brings `piece` into the world of `whole`, if the points they have in common agree on it."""
    own, other = _points_of(piece), _points_of(whole)
    common: set[tuple[int, int]] = set()
    for image in own.keys() & other.keys():
        common |= {(point, other[image][feature]) for feature, point in own[image].items() if feature in other[image]}
    for (first, second), indices in matches.items():
        for one, two, columns in ((first, second, indices), (second, first, indices[:, ::-1])):
            if one in own and two in other and one != two:
                common |= {
                    (own[one][feature], other[two][matched])
                    for feature, matched in columns.tolist()
                    if feature in own[one] and matched in other[two]
                }
    if len(common) < _LEAST_PAIRS:
        return None
    pairs = sorted(common)
    source = np.array([piece.point3D(point).xyz for point, _ in pairs])
    target = np.array([whole.point3D(point).xyz for _, point in pairs])
    options = pycolmap.RANSACOptions()
    options.max_error = _AGREE * float(np.linalg.norm(target - np.median(target, axis=0), axis=1).mean())
    options.random_seed = seed
    fit: Any = pycolmap.estimate_sim3d_robust(source, target, options)  # a dictionary, other than its types say
    if fit is None or fit["num_inliers"] < max(_LEAST_PAIRS, _LEAST_SHARE * len(pairs)):
        return None
    return fit["tgt_from_src"]


def _points_of(model: pycolmap.Reconstruction) -> dict[int, dict[int, int]]:
    """By image number and the number of a feature, the point it shows."""
    found: dict[int, dict[int, int]] = {image: {} for image in model.reg_image_ids()}
    for number, point in model.points3D.items():
        for element in point.track.elements:
            if element.image_id in found:
                found[element.image_id][element.point2D_idx] = number
    return found


def _with_piece(
    whole: pycolmap.Reconstruction,
    piece: pycolmap.Reconstruction,
    fit: pycolmap.Sim3d,
    database: Path,
    images: Path,
    workspace: Path,
    seed: int,
) -> pycolmap.Reconstruction:
    moved, there = pycolmap.Reconstruction(piece), set(whole.reg_image_ids())
    moved.transform(fit)
    for number in sorted(set(moved.reg_image_ids()) - there):
        image = moved.image(number)
        if not whole.exists_camera(image.camera_id):
            whole.add_camera_with_trivial_rig(moved.camera(image.camera_id))
        if whole.exists_image(number):  # without a place
            whole.frame(whole.image(number).frame_id).set_cam_from_world(image.camera_id, image.cam_from_world())
            whole.register_frame(whole.image(number).frame_id)
            continue
        features = [pycolmap.Point2D(point.xy) for point in image.points2D]
        added = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=number, points2D=features)
        whole.add_image_with_trivial_frame(added, image.cam_from_world())
    workspace.mkdir(parents=True, exist_ok=True)
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed, options.num_threads = seed, 1
    pycolmap.set_random_seed(seed)
    return pycolmap.triangulate_points(whole, database, images, workspace, True, options)
