"""The discs of Gaussians that face the camera: their hull, and many of them as one mesh instead of instances.

A ray meets hundreds of discs, one after the other. To meet an instance Cycles changes into its space and back; faces of
one mesh it meets without. A picture was measured to take 0.6 of the processor's time, and 0.9 where the scene is turned
to the camera's axes (see `stills`). But a mesh takes memory for each corner of each disc, where instances share one
hull: so only up to so many discs.
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
_NOT_SHOWN = ("color_*", "sh_*", Attribute.SCALE, Attribute.ROTATION, Attribute.FRAME, Attribute.RANK)


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
