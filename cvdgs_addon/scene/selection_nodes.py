"""Which Gaussians the node group of `splat_nodes` draws: those within a budget, inside a crop box."""

from __future__ import annotations

import bpy

from .nodes import NodeWriter, Value


def within_budget(write: NodeWriter, rank: Value, budget: Value, is_limited: Value) -> bpy.types.NodeSocket:
    """Boolean: `rank` (0 is the most important Gaussian) is below `budget`, where that is not 0 and `is_limited`."""
    has_budget = write.both(is_limited, write.compare("GREATER_THAN", budget, 0.5))
    too_many = write.both(has_budget, write.compare("GREATER_EQUAL", rank, budget))
    return write.output("FunctionNodeBooleanMath", too_many, operation="NOT")


def inside_box(write: NodeWriter, position: Value, box: Value, is_cropped: Value) -> bpy.types.NodeSocket:
    """Boolean: `position` lies within the cube of side two around the object `box`, in its own space; or no crop."""
    to_object = write.output("GeometryNodeObjectInfo", box, name="Transform", transform_space="RELATIVE")
    in_box = write.output("FunctionNodeTransformPoint", position, write.output("FunctionNodeInvertMatrix", to_object))
    x, y, z = write.separate(write.vector_math("ABSOLUTE", in_box))
    largest = write.math("MAXIMUM", x, write.math("MAXIMUM", y, z))
    outside = write.both(is_cropped, write.compare("GREATER_THAN", largest, 1.0))
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
