"""Gaussians as a Blender object: a mesh of loose points with attributes, drawn by the node group of `splat_nodes`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.runs.layout import ORIGINAL
from ...core.splats.gaussians import SH_C0, Gaussians, core_bounds
from .color_nodes import coefficient_attribute, coefficient_count
from .nodes import InputValue, get_modifier_input, modifier_input_path, modifier_input_property, set_modifier_input
from .render_settings import TRANSPARENT_BOUNCES
from .splat_attributes import Attribute, Frame, color_attribute, hide_frame, opaque, write_attribute
from .splat_material import (
    DISC_NAME,
    ELLIPSOID_NAME,
    MESH_DISC_NAME,
    POINT_NAME,
    build_disc_material,
    build_ellipsoid_material,
    build_mesh_disc_material,
    build_point_material,
    hull_name,
)
from .splat_nodes import GROUP_NAME, Hulls, Input, Materials, build_group, group_name

MODIFIER_NAME = "Gaussians"
LAYER_BEFORE_UNDO = "cvdgs_layer_before_undo"
"""Custom property of Gaussians: the layer that they showed until undo took it away; any other choice ends that."""

# Blender's own engines, numbers 0 and 1, need no bounces.
_BOUNCES = f"transparent_max_bounces if engine > 1 else {TRANSPARENT_BOUNCES}"
_OF_CYCLES = ("transparent_max_bounces",)  # settings that are not among the scene's for all engines

_RUN_AGAIN = "train it again"


def add_gaussians(
    gaussians: Gaussians,
    layers: Mapping[str, NDArray[np.float32]],
    collection: bpy.types.Collection,
    name: str = "Gaussians",
) -> bpy.types.Object:
    """Add `gaussians` to `collection` as one object that shows the first layer's colours.

    Takes about a second for a million Gaussians; nothing loops over points in Python.

    Args:
        gaussians: geometry and the original colours.
        layers: colours of further layers by name, (N, 3) display-referred sRGB.
        collection: where the object is linked.
        name: of the object and its mesh.

    Raises:
        InputError: no Gaussians, values that are not finite, or a layer of another length.
    """
    check_gaussians(gaussians, layers)
    mesh = bpy.data.meshes.new(name)
    _fill_mesh(mesh, gaussians, layers)
    splats = bpy.data.objects.new(name, mesh)
    # They shine and have no surface to throw a shadow with; EEVEE spends minutes on those of thousands of objects.
    splats.visible_shadow = False
    # Nor do they light what stands among them: each bounce would meet hundreds. See `estimated_light`.
    splats.visible_diffuse = False
    collection.objects.link(splats)
    modifier = splats.modifiers.new(MODIFIER_NAME, "NODES")
    modifier.node_group = _shared_group(gaussians.sh_degree)
    for name, size in ((Input.WIDTH, "resolution_x"), (Input.HEIGHT, "resolution_y")):
        _drive_by_render_settings(splats, name, f"{size} * resolution_percentage / 100")
    _drive_by_render_settings(splats, Input.MOTION_BLUR, "use_motion_blur")
    _drive_by_render_settings(splats, Input.BOUNCES, _BOUNCES)
    show_layer(splats, next(iter(layers), ORIGINAL))
    return splats


def check_gaussians(gaussians: Gaussians, layers: Mapping[str, NDArray[np.float32]], where: str | Path = "") -> None:
    """Refuse what cannot be shown.

    Args:
        gaussians: geometry and the original colours.
        layers: colours of further layers by name.
        where: what the complaint names.

    Raises:
        InputError: no Gaussians, values that are not finite, or a layer of another length.
    """
    if len(gaussians) == 0:
        raise InputError("it holds no Gaussians", where=where, remedy=_RUN_AGAIN)
    arrays = {
        "positions": gaussians.means,
        "scales": gaussians.log_scales,
        "rotations": gaussians.quaternions,
        "opacities": gaussians.opacity_logits,
        "colours": gaussians.sh,
    }
    for name, array in {**arrays, **layers}.items():
        if not np.isfinite(array).all():
            raise InputError(f"some {name} are not finite numbers", where=where, remedy=_RUN_AGAIN)
    for name, colors in layers.items():
        if colors.shape != (len(gaussians), 3):
            counts = f"{len(colors)} colours for {len(gaussians)} Gaussians"
            raise InputError(f"layer '{name}' has {counts}", where=where, remedy="use layers of the same run")


def layer_names(splats: bpy.types.Object) -> list[str]:
    """Names of the colour layers of `splats`, the original first."""
    prefix = color_attribute("")
    names = splats.data.attributes.keys()
    return [name.removeprefix(prefix) for name in names if name.startswith(prefix)]


def show_layer(splats: bpy.types.Object, layer: str, enhanced: float = 1.0) -> None:
    """Show `layer`, blended with the original colours: 0 shows those, 1 the layer's.

    Raises:
        InputError: there is no such layer.
    """
    layers = layer_names(splats)
    if layer not in layers:
        raise InputError(f"no colour layer '{layer}'", where=splats.name, remedy="choose " + ", ".join(layers))
    set_input(splats, Input.LAYER, color_attribute(layer))
    set_input(splats, Input.ENHANCED, float(enhanced))
    splats.pop(LAYER_BEFORE_UNDO, None)


def set_input(splats: bpy.types.Object, name: str, value: InputValue) -> None:
    """Set an input of the node group (see `splat_nodes.Input`) for this object."""
    set_modifier_input(splats.modifiers[MODIFIER_NAME], name, value)
    splats.update_tag()


def get_input(splats: bpy.types.Object, name: str) -> InputValue:
    """The value of an input of the node group for this object."""
    return get_modifier_input(splats.modifiers[MODIFIER_NAME], name)


def input_path(splats: bpy.types.Object, name: str) -> str:
    """Data path of an input of the node group from this object: for keyframes, drivers and panels."""
    return modifier_input_path(splats.modifiers[MODIFIER_NAME], name)


def input_property(splats: bpy.types.Object, name: str) -> tuple[bpy.types.bpy_struct, str]:
    """Owner and name of the property that is an input of the node group: for ``layout.prop``."""
    return modifier_input_property(splats.modifiers[MODIFIER_NAME], name)


def has_input(splats: bpy.types.Object, name: str) -> bool:
    """Whether the node group has that input; one of an earlier release may lack it."""
    return name in {item.name for item in splats.modifiers[MODIFIER_NAME].node_group.interface.items_tree}


def is_splats(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is an object made by `add_gaussians`."""
    modifier = candidate.modifiers.get(MODIFIER_NAME)
    group = modifier.node_group if modifier is not None and modifier.type == "NODES" else None
    return group is not None and group.name.startswith(GROUP_NAME)


def _fill_mesh(mesh: bpy.types.Mesh, gaussians: Gaussians, layers: Mapping[str, NDArray[np.float32]]) -> None:
    """The points of the Gaussians, then the four of the frame, with their attributes."""
    # With view-dependent terms to come, the constant one may be negative.
    original = 0.5 + SH_C0 * gaussians.sh[:, 0] if gaussians.sh_degree else gaussians.base_colors
    colors = {ORIGINAL: original, **layers}
    count = len(gaussians)
    center, radius = core_bounds(gaussians.means)
    frame = center + radius * np.vstack([np.zeros(3), np.eye(3)])

    def with_frame(values: NDArray, frame_values: NDArray | float = 0.0) -> NDArray[np.float32]:
        padded = np.zeros((count + len(frame), *values.shape[1:]), np.float32)
        padded[:count] = values
        padded[count:] = frame_values
        return padded

    rotations = gaussians.quaternions / np.maximum(np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True), 1e-12)
    frame_numbers = np.zeros(count + len(frame), np.int32)
    frame_numbers[count:] = list(Frame)
    mesh.vertices.add(count + len(frame))
    mesh.vertices.foreach_set("co", with_frame(gaussians.means, frame).ravel())
    write_attribute(mesh, Attribute.SCALE, "FLOAT_VECTOR", with_frame(np.exp(gaussians.log_scales), radius))
    write_attribute(mesh, Attribute.ROTATION, "QUATERNION", with_frame(rotations, np.array([1.0, 0, 0, 0])))
    write_attribute(mesh, Attribute.OPACITY, "FLOAT", with_frame(gaussians.opacities))
    write_attribute(mesh, Attribute.FRAME, "INT", frame_numbers)
    write_attribute(mesh, Attribute.RANK, "INT", _ranks(gaussians, count + len(frame)))
    for layer, rgb in colors.items():
        write_attribute(mesh, color_attribute(layer), "FLOAT_COLOR", with_frame(opaque(rgb)))
    for index in range(1, coefficient_count(gaussians.sh_degree) + 1):
        name = coefficient_attribute(index)
        write_attribute(mesh, name, "FLOAT_VECTOR", with_frame(gaussians.sh[:, index]))
    # Solid shading shows the active colours, which the preview makes; in Edit Mode it is black if the mesh has none.
    mesh.attributes.new(Attribute.PREVIEW_COLOR, "BYTE_COLOR", "POINT")
    mesh.attributes.active_color_name = Attribute.PREVIEW_COLOR
    mesh.vertices.foreach_set("select", np.zeros(count + len(frame), np.bool_))  # Blender selects what is new
    hide_frame(mesh)
    mesh.update()


def _ranks(gaussians: Gaussians, size: int) -> NDArray[np.int32]:
    """(size,) place of each Gaussian by its importance, the largest first; 0 beyond the Gaussians."""
    ranks = np.zeros(size, np.int32)
    ranks[np.argsort(-gaussians.importance, kind="stable")] = np.arange(len(gaussians), dtype=np.int32)
    return ranks


def _shared_group(sh_degree: int) -> bpy.types.NodeTree:
    """The node group of this file, made when there is none: all Gaussians of an SH degree share it.

    One that an earlier release made stays with the Gaussians that have it.
    """
    for existing in bpy.data.node_groups:
        name, _, _number = existing.name.partition(".")
        if name == group_name(sh_degree) and set(Input) <= {item.name for item in existing.interface.items_tree}:
            return existing
    point = bpy.data.materials.get(POINT_NAME) or build_point_material()
    return build_group(sh_degree, Materials(_hulls(compared=False), _hulls(compared=True), point))


def _hulls(*, compared: bool) -> Hulls:
    """The materials of hulls in this file, made where they are missing."""
    builders = {
        DISC_NAME: build_disc_material,
        MESH_DISC_NAME: build_mesh_disc_material,
        ELLIPSOID_NAME: build_ellipsoid_material,
    }
    existing = bpy.data.materials
    return Hulls(
        *(
            existing.get(hull_name(name, compared=compared)) or build(compared=compared)
            for name, build in builders.items()
        )
    )


def _drive_by_render_settings(splats: bpy.types.Object, name: Input, expression: str) -> None:
    """Let the input follow the settings in `expression` of whichever scene is shown.

    Args:
        expression: simple enough for Blender to evaluate without running Python.
    """
    driver = splats.driver_add(input_path(splats, name)).driver
    driver.type = "SCRIPTED"
    for setting in set(re.findall("[a-z_]+", expression)) - {"if", "else"}:
        variable = driver.variables.new()
        variable.name = setting
        variable.type = "CONTEXT_PROP"
        variable.targets[0].context_property = "ACTIVE_SCENE"
        variable.targets[0].data_path = f"{'cycles' if setting in _OF_CYCLES else 'render'}.{setting}"
    driver.expression = expression
