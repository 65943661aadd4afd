"""What the mesh of Gaussians carries: attributes of its points and of the colour layers, read and written."""

from __future__ import annotations

from enum import IntEnum, StrEnum

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.splats.gaussians import core_bounds

# The field that holds an attribute's values and the shape of one, by the attribute's type.
_STORED = {
    "FLOAT": ("value", ()),
    "INT": ("value", ()),
    "BOOLEAN": ("value", ()),
    "FLOAT_VECTOR": ("vector", (3,)),
    "QUATERNION": ("value", (4,)),
    "FLOAT4": ("vector", (4,)),
    "FLOAT_COLOR": ("color", (4,)),
    "BYTE_COLOR": ("color", (4,)),
}


_DTYPES: dict[str, type] = {"INT": np.int32, "BOOLEAN": np.bool_}


class Attribute(StrEnum):
    """Attributes of the mesh's points, and of what is drawn. Colour layers are called ``color_<layer>``."""

    SCALE = "scale"  # FLOAT_VECTOR, standard deviations along the local axes
    ROTATION = "rotation"  # QUATERNION, wxyz, local to object
    OPACITY = "opacity"  # FLOAT
    FRAME = "frame"  # INT, 0 for a Gaussian, else which point of the frame (see `Frame`)
    RANK = "rank"  # INT, 0 for the most important Gaussian, then 1, ...: those that a budget leaves come first
    REMOVED = "removed"  # BOOLEAN, not drawn and not exported; where it is missing, all are (see `masks`)
    KEPT_ORIGINAL = "kept_original"  # FLOAT, how far a layer's colour is left out; 0 where it is missing
    FLOATER = "floater"  # FLOAT, 0 to 1, how likely it is one; of runs that know
    NORMAL = "surface_normal"  # FLOAT_VECTOR, which way the surface faces; only where somebody relights (see `normals`)
    DRAWN_COLOR = "drawn_color"  # FLOAT_COLOR, of what is drawn only: what the material shows
    PREVIEW_COLOR = "preview_color"  # FLOAT_COLOR, of the preview: what Solid shading shows; a place for it in the mesh
    ORIGINAL_COLOR = "original_color"  # FLOAT_COLOR, of what is compared only: shown left of the border
    BORDER = "border"  # FLOAT_COLOR, of what is compared only: plane on the hull (see `compare_nodes`)
    ON_DISC = "on_disc"  # FLOAT_VECTOR, of discs only: place in units of the radius at which they end


class Frame(IntEnum):
    """Values of `Attribute.FRAME`.

    Apply Transform moves a mesh's points but not its attributes. Four extra points follow it, and the group takes the
    linear map that they went through and applies it to every Gaussian's axes. Nobody who edits a part of the Gaussians
    is to move or delete these: they are hidden in Edit Mode.
    """

    ORIGIN = 1
    X = 2
    Y = 3
    Z = 4


def color_attribute(layer: str) -> str:
    """Name of the colour attribute of `layer`, e.g. ``color_deutan-1.0``."""
    return f"color_{layer}"


def read_attribute(mesh: bpy.types.Mesh, name: str) -> NDArray:
    """(V, ...) values of an attribute: int32 of an INT, bool of a BOOLEAN, else float32.

    Raises:
        InputError: somebody has removed or converted it.
    """
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.data_type not in _STORED:
        raise InputError(f"it no longer has the attribute '{name}'", where=mesh.name, remedy="load the run again")
    field, shape = _STORED[attribute.data_type]
    values: NDArray = np.empty((len(attribute.data), *shape), _DTYPES.get(attribute.data_type, np.float32))
    attribute.data.foreach_get(field, values.reshape(-1))
    return values


def write_attribute(data: bpy.types.Mesh | bpy.types.PointCloud, name: str, kind: str, values: NDArray) -> None:
    """Set the attribute `name` of the points, made with the type `kind` where it is missing; (V, ...) `values`."""
    attribute = data.attributes.get(name) or data.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(_STORED[kind][0], np.ascontiguousarray(values).ravel())


def opaque(colors: NDArray) -> NDArray[np.float32]:
    """(N, 4) of (N, 3) colours."""
    return np.concatenate([colors, np.ones((len(colors), 1))], axis=1).astype(np.float32)


def vertex_positions(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """(V, 3) positions, those of the frame included."""
    positions = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", positions.reshape(-1))
    return positions


def is_gaussian(mesh: bpy.types.Mesh) -> NDArray[np.bool_]:
    """(V,) which vertices are Gaussians, and not points of the frame."""
    if Attribute.FRAME not in mesh.attributes:
        return np.ones(len(mesh.vertices), np.bool_)
    return read_attribute(mesh, Attribute.FRAME) == 0


JOINED = "Blender's Join (Ctrl+J) loses the shapes of Gaussians"
HOW_TO_JOIN = "undo it, and use Align and Join Runs"


def is_joined(mesh: bpy.types.Mesh) -> bool:
    """Whether Blender's *Join* made one mesh of several runs: it then has several frames. 1 ms a million points."""
    if mesh.is_editmode or Attribute.FRAME not in mesh.attributes:
        return False
    return bool(np.count_nonzero(read_attribute(mesh, Attribute.FRAME) == Frame.ORIGIN) > 1)


def refuse_joined(mesh: bpy.types.Mesh) -> None:
    """Refuse what Blender's *Join* made of several runs: their frames do not tell any more what each went through.

    Raises:
        InputError: it is such a mesh.
    """
    if is_joined(mesh):
        raise InputError(JOINED, where=mesh.name, remedy=HOW_TO_JOIN)


def hide_frame(mesh: bpy.types.Mesh) -> None:
    """Keep the points of the frame out of Edit Mode; what else is hidden there stays so."""
    hidden = np.empty(len(mesh.vertices), np.bool_)
    mesh.vertices.foreach_get("hide", hidden)
    hidden |= ~is_gaussian(mesh)
    mesh.vertices.foreach_set("hide", hidden)
    selected = np.empty(len(hidden), np.bool_)
    mesh.vertices.foreach_get("select", selected)
    mesh.vertices.foreach_set("select", selected & ~hidden)


def point_positions(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """(N, 3) positions of a mesh's points; of Gaussians those alone, without the points of the frame."""
    return vertex_positions(mesh)[is_gaussian(mesh)]


def require_object_mode(owner: bpy.types.Object) -> None:
    """Refuse an object whose mesh is being edited: its attributes cannot be reached meanwhile.

    Raises:
        InputError: it is.
    """
    if owner.data.is_editmode:
        raise InputError("it is being edited", where=owner.name, remedy="leave Edit Mode first")


def core_of(owner: bpy.types.Object) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and radius of the part that holds most of an object's points, in its own space.

    Raises:
        InputError: it is being edited, or somebody has deleted all its points.
    """
    require_object_mode(owner)
    positions = point_positions(owner.data)
    if not len(positions):
        raise InputError("it has no points any more", where=owner.name, remedy="load the run again")
    return core_bounds(positions)
