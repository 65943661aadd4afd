"""A normalised capture in the open file: cameras, the photographs behind them, and sparse points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...core.capture.folder import CaptureView, read_capture_folder, read_points
from ...core.splats.gaussians import core_bounds
from ...core.splats.scene_frame import near_depth
from .bystanders import hide_start_cube
from .camera_view import views_3d
from .cameras import Clip, add_camera, camera_intrinsics, camera_to_world, is_capture_camera, view_key
from .display import match_display
from .placement import (
    NOTHING_FOUND,
    Found,
    Placing,
    add_empty,
    camera_distance,
    found_of,
    is_capture,
    metres_of_unit,
    placement,
)
from .sparse_points import add_sparse_points, is_sparse_points
from .splat_attributes import core_of
from .splats import is_splats

_CLIP_END = 500.0  # far end of the cameras' range in distances to the subject: generous, yet well inside float32
# Display sizes of the capture's Empty, of cameras and of sparse points, in distances to the subject.
_EMPTY_SIZE, _CAMERA_SIZE, _POINT_SIZE = 0.2, 0.03, 0.002
_PHOTOGRAPH_OPACITY = 0.5  # of a photograph in front of the scene's own picture


@dataclass(frozen=True)
class ImportOptions:
    """What is brought in.

    Attributes:
        images: show each camera's photograph behind it.
        points: add the sparse points.
        placing: how the capture is set into the scene.
    """

    images: bool = True
    points: bool = True
    placing: Placing = field(default_factory=Placing)


@dataclass(frozen=True)
class CaptureObjects:
    """What was added.

    Attributes:
        collection: holds all of it.
        empty: the parent of all of it.
        cameras: by view key.
        points: the sparse points, if there are any.
    """

    collection: bpy.types.Collection
    empty: bpy.types.Object
    cameras: dict[str, bpy.types.Object]
    points: bpy.types.Object | None = None


def import_capture(folder: Path, scene: bpy.types.Scene, options: ImportOptions = ImportOptions()) -> CaptureObjects:
    """Add the normalised capture in `folder` to `scene`; render settings stay as they are.

    The untouched cube of a new file, which would stand in its middle, is hidden.

    Raises:
        InputError: cameras or points are missing or damaged, or Blender cannot express a camera.
    """
    capture = read_capture_folder(folder)
    positions, colors = read_points(folder)
    center = core_bounds(positions)[0] if len(positions) else _focus(capture.views)
    found = Found(capture.up, capture.metres_per_unit)
    matrix = placement(capture.views, center, options.placing, found, metres_of_unit(scene))
    points = positions if len(positions) else center[None]
    added = add_cameras(capture.views, matrix, center, points, scene, found)
    hide_start_cube(scene)
    if options.images:
        for view in capture.views:
            if view.image is not None:
                _show_photograph(added.cameras[view.key], view.image)
    if not options.points or not len(positions):
        return added
    radius = _POINT_SIZE * camera_distance(capture.views, center)
    points = add_sparse_points(positions, colors, radius, added.collection)
    points.parent = added.empty
    match_display(scene)
    return CaptureObjects(added.collection, added.empty, added.cameras, points)


def add_cameras(
    views: Sequence[CaptureView],
    matrix: NDArray[np.float64],
    center: NDArray[np.float64],
    points: NDArray[np.floating],
    scene: bpy.types.Scene,
    found: Found = NOTHING_FOUND,
    name: str = "",
) -> CaptureObjects:
    """Add a small camera for each view, below an Empty, in a collection of its own.

    3D views draw no lines from cameras to the Empty any more.

    Args:
        views: at least one.
        matrix: (4, 4) similarity from the capture's world to the scene (see `placement`).
        center: (3,) of the subject, in the capture's world.
        points: (P, 3) of what the cameras see, likewise: the range of depths follows from them.
        scene: gets all of it.
        found: what is known of the capture's world, for placing it again.
        name: of a run; collections and the Empty are called after it.
    """
    scale, distance = _scale_of(matrix), camera_distance(views, center)
    clip = Clip(near_depth(views, points) * scale, _CLIP_END * distance * scale)
    top = _add_collection(name or "Capture", scene.collection)
    empty = add_empty(f"{name} Capture".strip(), matrix, _EMPTY_SIZE * distance, top, found)
    collection = _add_collection(f"{name} Cameras".strip(), top)
    cameras = {}
    for view in views:
        camera = add_camera(view.key, view.camera, view.camera_to_world, clip, collection)
        camera.data.display_size = _CAMERA_SIZE * distance
        camera.parent = empty
        cameras[view.key] = camera
    for space in views_3d():
        space.overlay.show_relationship_lines = False  # from each camera to the Empty, across the picture
    return CaptureObjects(top, empty, cameras)


def capture_of(candidate: bpy.types.Object | None) -> bpy.types.Object | None:
    """The Empty of the capture that `candidate` belongs to, if it belongs to one."""
    while candidate is not None and not is_capture(candidate):
        candidate = candidate.parent
    return candidate


def place_again(empty: bpy.types.Object, placing: Placing) -> None:
    """Set a capture that is in the scene up in another way; its Empty's own transform is replaced."""
    views = _views_of(empty)
    if not views:
        return
    metres = metres_of_unit(bpy.context.scene)
    matrix = placement(views, _center_of(empty, views), placing, found_of(empty), metres)
    ratio = _scale_of(matrix) / _scale_of(np.array(empty.matrix_basis))
    empty.matrix_basis = mathutils.Matrix(matrix.tolist())
    scale_ranges(empty, ratio)


def scale_ranges(empty: bpy.types.Object, ratio: float) -> None:
    """Let the cameras of a capture see as far as before, now that it is `ratio` times as large."""
    for camera in empty.children:
        if is_capture_camera(camera):
            camera.data.clip_start, camera.data.clip_end = camera.data.clip_start * ratio, camera.data.clip_end * ratio


def middle_of(empty: bpy.types.Object) -> tuple[NDArray[np.float64], float]:
    """(3,) centre of the subject in the capture's world, and how far its cameras are; the origin and 1 without any."""
    views = _views_of(empty)
    if not views:
        return np.zeros(3), 1.0
    center = _center_of(empty, views)
    return center, camera_distance(views, center)


def _views_of(empty: bpy.types.Object) -> list[CaptureView]:
    return [
        CaptureView(view_key(camera), camera_intrinsics(camera), camera_to_world(camera))
        for camera in empty.children
        if is_capture_camera(camera)
    ]


def _center_of(empty: bpy.types.Object, views: Sequence[CaptureView]) -> NDArray[np.float64]:
    """(3,) centre of the subject in the capture's world: of Gaussians, else of sparse points, else of the views."""
    for is_subject in (is_splats, is_sparse_points):
        for child in empty.children:
            if is_subject(child):
                return core_of(child)[0]
    return _focus(views)


def _focus(views: Sequence[CaptureView]) -> NDArray[np.float64]:
    """(3,) the point nearest to the axes of all views, in the least-squares sense.

    Where the axes are parallel any point of theirs is; the one nearest to the origin is taken.
    """
    poses = np.stack([view.camera_to_world for view in views])
    across = np.eye(3) - poses[:, :3, 2, None] * poses[:, None, :3, 2]  # projections along the axes
    return np.linalg.lstsq(across.sum(0), (across @ poses[:, :3, 3, None]).sum(0)[:, 0], rcond=1e-6)[0]


def _show_photograph(camera: bpy.types.Object, path: Path) -> None:
    background = camera.data.background_images.new()
    background.image = bpy.data.images.load(str(path), check_existing=True)
    background.alpha = _PHOTOGRAPH_OPACITY
    background.frame_method = "STRETCH"  # pixel for pixel, since `use_camera` takes the photograph's size
    camera.data.show_background_images = True


def _scale_of(matrix: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(matrix[:3, 0]))


def _add_collection(name: str, parent: bpy.types.Collection) -> bpy.types.Collection:
    collection = bpy.data.collections.new(name)
    parent.children.link(collection)
    return collection
