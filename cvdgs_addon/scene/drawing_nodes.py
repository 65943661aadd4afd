"""Geometry nodes that choose Gaussians (budget, crop box) and draw them: as points, discs, or one mesh of all discs.

The discs face the camera. A ray meets hundreds of them, one after the other. To meet an instance Cycles changes into
its space and back; faces of one mesh it meets without. A picture was measured to take 0.6 of the processor's time, and
0.9 where the scene is turned to the camera's axes (see `stills`). But a mesh takes memory for each corner of each disc,
where instances share one hull: so only up to so many discs.
"""

from __future__ import annotations

import math

import bpy

from .nodes import NodeWriter, Value
from .splat_attributes import Attribute

DISC_CORNERS = 8  # fewer cost more in rays through transparent corners than they save in triangles
# With so many, a small picture was measured to take 14 seconds of the processor as a mesh, building it included, and 21
# as instances; the mesh took six per cent more memory at the peak. More were not measured.
MESH_LIMIT = 300_000
# Matches what the material does not read: attributes of instances would become those of every corner.
_NOT_SHOWN = (
    *("color_*", "sh_*", Attribute.SCALE, Attribute.ROTATION),
    *(Attribute.FRAME, Attribute.RANK, Attribute.NORMAL, Attribute.PREVIEW_COLOR),
)


def within_budget(write: NodeWriter, rank: Value, budget: Value, is_limited: Value) -> bpy.types.NodeSocket:
    """Boolean: `rank` (0 is the most important Gaussian) is below `budget`, where that is not 0 and `is_limited`."""
    has_budget = write.both(is_limited, write.compare("GREATER_THAN", budget, 0.5))
    too_many = write.both(has_budget, write.compare("GREATER_EQUAL", rank, budget))
    return write.output("FunctionNodeBooleanMath", too_many, operation="NOT")


def inside_box(write: NodeWriter, position: Value, box: Value, is_cropped: Value) -> bpy.types.NodeSocket:
    """Boolean: `position` lies within the cube of side two around the object `box`, in its own space; or no crop, nor
    where the box is gone.
    """
    info = write.node("GeometryNodeObjectInfo", box, transform_space="RELATIVE").outputs
    to_box = write.output("FunctionNodeInvertMatrix", info["Transform"])
    in_box = write.output("FunctionNodeTransformPoint", position, to_box)
    x, y, z = write.separate(write.vector_math("ABSOLUTE", in_box))
    largest = write.math("MAXIMUM", x, write.math("MAXIMUM", y, z))
    has_box = write.compare("GREATER_THAN", write.vector_math("LENGTH", info["Scale"]), 0.0)  # without: all zeros
    outside = write.both(write.both(is_cropped, has_box), write.compare("GREATER_THAN", largest, 1.0))
    return write.output("FunctionNodeBooleanMath", outside, operation="NOT")


def as_points(
    write: NodeWriter, points: Value, drawn: Value, scale: Value, size: Value, material: bpy.types.Material
) -> bpy.types.NodeSocket:
    """A point for each Gaussian that is drawn: a sphere of the Gaussian's mean standard deviation times `size`."""
    x, y, z = write.separate(scale)
    volume = write.product(x, y, z)
    radius = write.math("MULTIPLY", size, write.math("POWER", volume, 1.0 / 3.0))
    cloud = write.output("GeometryNodeMeshToPoints", points, drawn, None, radius)
    return write.output("GeometryNodeSetMaterial", cloud, True, material)


def disc_hull(write: NodeWriter, material: Value) -> bpy.types.NodeSocket:
    """A polygon circumscribed about the unit circle, so that it cuts nothing off, with `Attribute.ON_DISC`."""
    mesh = write.output("GeometryNodeMeshCircle", DISC_CORNERS, 1.0 / math.cos(math.pi / DISC_CORNERS),
                        fill_type="NGON")  # fmt: skip
    position = write.output("GeometryNodeInputPosition")
    mesh = write.output("GeometryNodeStoreNamedAttribute", mesh, True, Attribute.ON_DISC, position,
                        data_type="FLOAT_VECTOR", domain="POINT")  # fmt: skip
    return write.output("GeometryNodeSetMaterial", mesh, True, material)


def few_enough(write: NodeWriter, points: Value, drawn: Value, limit: Value) -> bpy.types.NodeSocket:
    """Boolean: at most `limit` of the points are `drawn`."""
    count = write.output("GeometryNodeAttributeStatistic", points, drawn, 1.0, name="Sum")
    return write.compare("LESS_EQUAL", count, limit)


def one_mesh(write: NodeWriter, instances: Value, depth: Value) -> bpy.types.NodeSocket:
    """The instances as a mesh with the attributes that the material shows, and the farthest first.

    Cycles sorts along each ray, whatever the order; EEVEE sorts objects, but draws the faces of one as they come.
    """
    nearness = write.math("MULTIPLY", -1.0, depth)
    ordered = write.output("GeometryNodeSortElements", instances, True, None, nearness, domain="INSTANCE")
    for pattern in _NOT_SHOWN:
        ordered = _without(write, ordered, pattern)
    return write.output("GeometryNodeRealizeInstances", ordered)


def _without(write: NodeWriter, geometry: Value, pattern: str) -> bpy.types.NodeSocket:
    """`geometry` without the attributes whose names match `pattern`."""
    if bpy.app.version >= (5, 0):
        return write.output("GeometryNodeRemoveAttribute", geometry, "Wildcard", pattern)
    return write.output("GeometryNodeRemoveAttribute", geometry, pattern, pattern_mode="WILDCARD")
