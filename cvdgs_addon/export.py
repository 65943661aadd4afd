"""From Blender's objects to files of other programs: Gaussians as they are edited and blended, and the scene's LUT."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.files.untrusted import read_bytes, writing_whole
from ..core.runs.layout import ORIGINAL, layer_cube_file
from ..core.splats.gaussians import SH_C0, Gaussians
from ..core.splats.harmonics import turned
from ..core.splats.io.files import write_gaussians, write_layers
from ..core.splats.web.finished_run import is_finished_run, surroundings_of
from ..core.splats.web.page import Surroundings, write_web_page
from .scene.color_nodes import coefficient_attribute, coefficient_count
from .scene.crop import left_by_crop
from .scene.origin import run_of
from .scene.shapes import frame_map, rotation_matrices
from .scene.splat_attributes import Attribute, color_attribute, read_attribute, require_object_mode, vertex_positions
from .scene.splat_nodes import Input
from .scene.splats import get_input, layer_names
from .scene.world_matrix import world_of
from .shown import shown_layer

# A logit beyond this is as good as 0 or 1, and finite.
_LARGEST_LOGIT = 15.0
_SMALLEST_SCALE = 1e-12
_MOST_CUBE_BYTES = 64 << 20  # one of 128 nodes a side; those of a run have 33, and 1 MB
_SCENES_UP = "z"  # in Blender
# A linear map that differs from a uniform scale by less than this turns nothing that could be seen.
_TURN_TOLERANCE = 1e-5


@dataclass(frozen=True)
class ExportedGaussians:
    """Gaussians read from an object.

    Attributes:
        gaussians: as a PLY has them.
        lost_view_dependence: whether the original colours' view-dependent terms were left out, because the object was
            stretched.
        points: (V,) which points of the object's mesh they are.
    """

    gaussians: Gaussians
    lost_view_dependence: bool
    points: NDArray[np.bool_]


def read_gaussians(
    splats: bpy.types.Object,
    layer: str,
    enhanced: float,
    *,
    axes: mathutils.Matrix | None = None,
    as_in_viewport: bool = False,
) -> ExportedGaussians:
    """The Gaussians of an object as they are now: removed and cropped ones are gone, applied transforms count.

    Args:
        splats: made by `scene.splats.add_gaussians`.
        layer: colour layer.
        enhanced: 0 for the original colours, 1 for the layer's.
        axes: to which axes the object's own are taken, by 4 × 4: to the scene's by `world_of`. None: the
            object's own, which are the capture's.
        as_in_viewport: only those within the budget, which limits what the viewport draws.

    Raises:
        InputError: no Gaussians are left, they are being edited, or there is no such layer.
    """
    require_object_mode(splats)
    mesh = splats.data
    frame = read_attribute(mesh, Attribute.FRAME)
    positions = vertex_positions(mesh)
    kept = (frame == 0) & left_by_crop(splats, positions) & ~_mask(mesh, Attribute.REMOVED, np.bool_)
    if as_in_viewport:
        kept &= within_budget(splats, read_attribute(mesh, Attribute.RANK))
    if not kept.any():
        raise InputError("no Gaussians are left", where=splats.name, remedy="undo their deletion, or move the crop box")
    shape = frame_map(mesh)
    scales = read_attribute(mesh, Attribute.SCALE)[kept].astype(np.float64)
    quaternions = read_attribute(mesh, Attribute.ROTATION)[kept]
    means = positions[kept].astype(np.float64)
    if axes is not None:
        matrix = np.array(axes, np.float64)
        means, shape = means @ matrix[:3, :3].T + matrix[:3, 3], matrix[:3, :3] @ shape
    if not np.allclose(shape, np.eye(3), atol=_TURN_TOLERANCE):
        scales, quaternions = _deformed(scales, quaternions, shape)
    opacities = np.clip(read_attribute(mesh, Attribute.OPACITY)[kept].astype(np.float64), 1e-9, 1.0 - 1e-9)
    sh, lost = _harmonics(splats, layer, enhanced, kept, shape)
    gaussians = Gaussians(
        means.astype(np.float32),
        np.log(np.maximum(scales, _SMALLEST_SCALE)).astype(np.float32),
        quaternions.astype(np.float32),
        np.clip(np.log(opacities / (1.0 - opacities)), -_LARGEST_LOGIT, _LARGEST_LOGIT).astype(np.float32),
        sh,
    )
    return ExportedGaussians(gaussians, lost, kept)


def proposed_name(splats: bpy.types.Object) -> str:
    """A file's name for Gaussians as they are shown, without its ending: the run, the layer, and how far it is shown.

    ``photos CVD deutan-1.0`` for the run in the folder ``photos CVD``.
    """
    layer, enhanced = shown_layer(splats)
    name = f"{_title(splats)} {layer if enhanced > 0.0 else ORIGINAL}"
    return name if layer == ORIGINAL or enhanced in (0.0, 1.0) else f"{name} at {100 * enhanced:.0f} percent"


def proposed_title(splats: bpy.types.Object) -> str:
    """A file's name for what holds all layers, without its ending."""
    return _title(splats)


def proposed_cube_name(splats: bpy.types.Object) -> str:
    """A file's name for the LUT of the layer that is shown, without its ending."""
    return f"{_title(splats)} {shown_layer(splats)[0]}"


def proposed_folder(splats: bpy.types.Object) -> str:
    """Where files of Gaussians go unless another place is chosen: beside the .blend, else beside their run's folder."""
    beside = bpy.data.filepath or run_of(splats)
    return str(Path(beside).parent if beside else Path.home())


def export_gaussians(path: str, exported: ExportedGaussians) -> None:
    """Write a splat file; its ending chooses the format (PLY, SPZ or .splat).

    Raises:
        InputError: an unknown ending, or the file cannot be written.
    """
    try:
        write_gaussians(path, exported.gaussians)
    except OSError as error:
        raise _cannot_write(path, error) from error


def export_web_page(path: str, splats: bpy.types.Object) -> int:
    """Write all layers of the Gaussians as they are now, in the capture's axes, as a web page; returns their number.

    The page begins at the run's cameras and has its captions, where the run is there and the Gaussians were not turned.

    Raises:
        InputError: no Gaussians are left, they are being edited, or the file cannot be written.
    """
    layers = _all_layers(splats)
    run, surroundings = run_of(splats), Surroundings(title=_title(splats))
    mesh = splats.data
    in_place = not _turns(frame_map(mesh))
    if run and in_place and is_finished_run(Path(run)):
        surroundings = surroundings_of(Path(run))
    write_web_page(path, layers, "" if in_place else _SCENES_UP, surroundings)
    return len(layers[ORIGINAL])


def export_layers(path: str, splats: bpy.types.Object) -> int:
    """Write all layers of the Gaussians as they stand in the scene, upright, as glTF or USD; returns their number.

    Raises:
        InputError: no Gaussians are left, they are being edited, an unknown ending, a library that is missing, or the
            file cannot be written.
    """
    layers = _all_layers(splats, axes=world_of(splats))
    try:
        write_layers(path, layers, up=_SCENES_UP)
    except OSError as error:
        raise _cannot_write(path, error) from error
    return len(layers[ORIGINAL])


def _all_layers(splats: bpy.types.Object, *, axes: mathutils.Matrix | None = None) -> dict[str, Gaussians]:
    """The Gaussians in every layer's colours, the original ones first."""
    names = [ORIGINAL, *(name for name in layer_names(splats) if name != ORIGINAL)]
    return {name: read_gaussians(splats, name, 1.0, axes=axes).gaussians for name in names}


def find_cube(folder: str, layer: str) -> Path:
    """The LUT of a layer of the run in `folder`.

    Raises:
        InputError: the run has none for this layer.
    """
    source = Path(folder, layer_cube_file(layer))
    if not source.is_file():
        remedy = "choose a layer of this run, or load the run from its current folder"
        raise InputError("there is no such LUT", where=source, remedy=remedy)
    return source


def export_cube(folder: str, layer: str, path: str) -> None:
    """Copy the LUT of a layer of the run in `folder`.

    Raises:
        InputError: the run has none for this layer, or the file cannot be written; an earlier one then stays.
    """
    content = read_bytes(find_cube(folder, layer), most_bytes=_MOST_CUBE_BYTES)
    with writing_whole(Path(path)) as file:
        file.write(content)


def _title(splats: bpy.types.Object) -> str:
    return Path(run_of(splats)).name or bpy.path.clean_name(splats.name)


def _cannot_write(path: str, error: OSError) -> InputError:
    return InputError(f"cannot be written ({error.strerror or error})", where=path, remedy="choose another folder")


def _deformed(
    scales: NDArray[np.float64], quaternions: NDArray, shape: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Scales and rotations of the ellipsoids after the linear map `shape`: again ellipsoids, by their axes."""
    axes = shape @ (rotation_matrices(quaternions) * scales[:, None, :])
    directions, deviations, _ = np.linalg.svd(axes)
    directions[:, :, 2] *= np.sign(np.linalg.det(directions))[:, None]  # a rotation, not a reflection
    return deviations, _quaternions(directions)


def _turns(shape: NDArray[np.float64]) -> bool:
    """Whether a linear map is more than a uniform scale."""
    scale = np.cbrt(abs(np.linalg.det(shape)))
    return not np.allclose(shape, scale * np.eye(3), atol=_TURN_TOLERANCE * max(scale, 1e-12))


def _harmonics(
    splats: bpy.types.Object, layer: str, enhanced: float, kept: NDArray[np.bool_], shape: NDArray[np.float64]
) -> tuple[NDArray[np.float32], bool]:
    """(N, K, 3) coefficients of the blended colours after the linear map `shape`, and whether view-dependent terms were
    left out, as they are where it is no similarity.
    """
    mesh = splats.data
    colors = _colors(mesh, ORIGINAL)[kept]
    share: NDArray = np.zeros((len(colors), 1), np.float32)  # of the layer's colours
    if layer != ORIGINAL and enhanced > 0.0:
        share += enhanced * (1.0 - _mask(mesh, Attribute.KEPT_ORIGINAL, np.float32)[kept, None])
        colors = (1.0 - share) * colors + share * _colors(mesh, layer)[kept]
    constant = ((colors - 0.5) / SH_C0)[:, None, :]
    degree = _degree(mesh)
    # Where the original colours still show, so does what depends on the view.
    original_shows = bool((share < 1.0).any())
    rotation = _rotation(shape)
    if degree == 0 or rotation is None or not original_shows:
        return constant.astype(np.float32), degree > 0 and rotation is None and original_shows
    names = [coefficient_attribute(index) for index in range(1, coefficient_count(degree) + 1)]
    rest = np.stack([read_attribute(mesh, name)[kept] for name in names], axis=1)
    return turned(np.concatenate([constant, (1.0 - share)[:, :, None] * rest], axis=1), rotation), False


def _rotation(shape: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(3, 3) rotation of a linear map that turns and resizes; None where it stretches or mirrors."""
    scale = np.cbrt(max(np.linalg.det(shape), 0.0))
    rotation = shape / max(scale, 1e-12)
    return rotation if np.allclose(rotation @ rotation.T, np.eye(3), atol=_TURN_TOLERANCE) else None


def _colors(mesh: bpy.types.Mesh, layer: str) -> NDArray[np.float32]:
    """(V, 3) display-referred sRGB of a layer."""
    if color_attribute(layer) not in mesh.attributes:
        raise InputError(f"no colour layer '{layer}'", where=mesh.name, remedy="choose another")
    return read_attribute(mesh, color_attribute(layer))[:, :3]


def _mask(mesh: bpy.types.Mesh, name: str, kind: type) -> NDArray:
    """(V,) values of a mask (see `scene.masks`)."""
    return read_attribute(mesh, name) if name in mesh.attributes else np.zeros(len(mesh.vertices), kind)


def _degree(mesh: bpy.types.Mesh) -> int:
    return next(
        degree
        for degree in (3, 2, 1, 0)
        if degree == 0 or coefficient_attribute(coefficient_count(degree)) in mesh.attributes
    )


def _quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4) wxyz of (N, 3, 3): the eigenvector of Bar-Itzhack's symmetric matrix (2000), stable for every angle."""
    r = rotations
    matrix = np.zeros((len(r), 4, 4))
    trace = np.trace(r, axis1=1, axis2=2)
    matrix[:, :3, :3] = r + r.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
    matrix[:, 3, :3] = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], 1)
    matrix[:, :3, 3] = matrix[:, 3, :3]
    matrix[:, 3, 3] = trace
    xyzw = np.linalg.eigh(matrix)[1][:, :, -1]
    return np.roll(xyzw, 1, axis=1)


def within_budget(splats: bpy.types.Object, ranks: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(V,) which of the (V,) places by importance (see `Attribute.RANK`) are among those that the viewport draws."""
    budget = get_input(splats, Input.BUDGET)
    return ranks < budget if isinstance(budget, int) and budget > 0 else np.ones(len(ranks), np.bool_)
