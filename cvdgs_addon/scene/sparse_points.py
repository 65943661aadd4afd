"""Sparse points of a capture as a Blender object: a mesh of loose points, drawn as a point cloud by a node group."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from .color_nodes import add_decoding_nodes
from .nodes import NodeWriter, add_input, new_group, set_modifier_input
from .splat_attributes import Attribute, opaque, write_attribute
from .splat_material import POINT_NAME, build_point_material

GROUP_NAME = "CVD Sparse Points"
MODIFIER_NAME = "Sparse Points"

_COLOR = "color"  # FLOAT_COLOR, display-referred sRGB
_POINT_SIZE, _SCENE_LINEAR = "Point Size", "Scene Linear"


def add_sparse_points(
    positions: NDArray[np.float32], colors: NDArray[np.float32], radius: float, collection: bpy.types.Collection
) -> bpy.types.Object:
    """Add the points to `collection`.

    Args:
        positions: (P, 3).
        colors: (P, 3) display-referred sRGB in [0, 1].
        radius: of a point in the units of the positions.
        collection: where the object is linked.
    """
    mesh = bpy.data.meshes.new(MODIFIER_NAME)
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(positions, np.float32).ravel())
    write_attribute(mesh, _COLOR, "FLOAT_COLOR", opaque(colors))
    mesh.update()
    points = bpy.data.objects.new(MODIFIER_NAME, mesh)
    points.visible_shadow = False  # they shine
    collection.objects.link(points)
    modifier = points.modifiers.new(MODIFIER_NAME, "NODES")
    modifier.node_group = bpy.data.node_groups.get(GROUP_NAME) or _build_group()
    set_modifier_input(modifier, _POINT_SIZE, radius)
    return points


def is_sparse_points(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is an object made by `add_sparse_points`."""
    modifier = candidate.modifiers.get(MODIFIER_NAME)
    group = modifier.node_group if modifier is not None and modifier.type == "NODES" else None
    return group is not None and group.name.startswith(GROUP_NAME)


def show_as_light(points: bpy.types.Object, on: bool) -> None:
    """Convert the colours to scene-linear light, or leave them for the view transform Raw."""
    set_modifier_input(points.modifiers[MODIFIER_NAME], _SCENE_LINEAR, on)
    points.update_tag()


def _build_group() -> bpy.types.NodeTree:
    tree = new_group("GeometryNodeTree", GROUP_NAME)
    tree.is_modifier = True
    tree.description = "Draws the sparse points of a capture in the colours of its photographs"
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    add_input(tree, "Geometry", "NodeSocketGeometry", "Points with colours")
    add_input(tree, _POINT_SIZE, "NodeSocketFloat", "Radius of a point", subtype="DISTANCE", min_value=0.0)
    add_input(tree, _SCENE_LINEAR, "NodeSocketBool", "Convert the colours to scene-linear light; off: photo colours")
    write = NodeWriter(tree)
    inputs = {socket.name: socket for socket in write.node("NodeGroupInput").outputs}
    cloud = write.output("GeometryNodeMeshToPoints", inputs["Geometry"], None, None, inputs[_POINT_SIZE])
    color = write.attribute("FLOAT_COLOR", _COLOR).outputs["Attribute"]
    shown = write.switch("RGBA", inputs[_SCENE_LINEAR], color, add_decoding_nodes(write, color))
    cloud = write.output("GeometryNodeStoreNamedAttribute", cloud, True, Attribute.DRAWN_COLOR, shown,
                         data_type="FLOAT_COLOR", domain="POINT")  # fmt: skip
    material = bpy.data.materials.get(POINT_NAME) or build_point_material()
    write.node("NodeGroupOutput", write.output("GeometryNodeSetMaterial", cloud, True, material))
    write.arrange()
    return tree
