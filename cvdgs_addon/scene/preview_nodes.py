"""Geometry nodes that draw Gaussians as tens of thousands of opaque quads: a preview in colour for Solid shading.

Each quad lies in the plane of its Gaussian's two longest axes, so that nothing has to be done again when somebody
orbits. The quads are extruded out of the points, not instanced on them: only then does the mesh remain the object's
own, with its active colour attribute, which is the one that Solid shading shows.
"""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from .nodes import NodeWriter, Sockets, Value
from .splat_attributes import Attribute

# A processor alone takes 0.28 s for a redraw of so many, 0.25 s for a fifth of them, and 0.18 s for an empty view. With
# a fifth a weave's small threads are missing, and cloth has the colour of what lies below them.
PREVIEW_COUNT = 40_000
# Half a side of an opaque Gaussian's quad in standard deviations: smaller ones leave holes in walls, larger ones hide
# the weave. One of less opacity gets a quad whose area is as much smaller.
_HALF_SIDE = 1.5


def as_quads(
    write: NodeWriter,
    points: Value,
    chosen: Value,
    frame: bpy.types.NodeSocket,
    light: Value,
    material: bpy.types.Material,
) -> bpy.types.NodeSocket:
    """A mesh of a quad for each Gaussian that is `chosen`.

    Args:
        write: into the group of the Gaussians.
        points: the mesh of the Gaussians.
        chosen: boolean field, the Gaussians to draw.
        frame: matrix that the Gaussians' axes went through (see `Frame`).
        light: scene-linear colour field, for Solid shading.
        material: for the other kinds of shading.
    """
    kept = write.output("GeometryNodeSeparateGeometry", points, chosen, domain="POINT")
    kept = write.output("GeometryNodeStoreNamedAttribute", kept, True, Attribute.PREVIEW_COLOR, light,
                        data_type="FLOAT_COLOR", domain="POINT")  # fmt: skip
    sides = write.nested("CVD Gaussian Quad", _sides, {"frame": frame})
    corner = write.vector_math("MULTIPLY", write.vector_math("ADD", sides["one"], sides["other"]), (-0.5, -0.5, -0.5))
    placed = write.output("GeometryNodeSetPosition", kept, True, None, corner)
    edges = write.output("GeometryNodeExtrudeMesh", placed, True, sides["one"], 1.0, mode="VERTICES")
    quads = write.output("GeometryNodeExtrudeMesh", edges, True, sides["other"], 1.0, mode="EDGES")
    return write.output("GeometryNodeSetMaterial", quads, True, material)


def _sides(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    """The sides of a Gaussian's quad as vectors in the object's space."""
    x, y, z = write.separate(write.attribute("FLOAT_VECTOR", Attribute.SCALE).outputs["Attribute"])
    rotation = write.attribute("QUATERNION", Attribute.ROTATION).outputs["Attribute"]
    opacity = write.attribute("FLOAT", Attribute.OPACITY).outputs["Attribute"]
    size = write.math("MULTIPLY", 2.0 * _HALF_SIDE, write.math("SQRT", opacity))
    x_is_least = write.both(write.compare("LESS_EQUAL", x, y), write.compare("LESS_EQUAL", x, z))
    z_is_least = write.both(write.compare("LESS_EQUAL", z, x), write.compare("LESS_EQUAL", z, y))
    along_x, along_y, along_z = (
        write.combine(*(value if place == axis else 0.0 for place in range(3))) for axis, value in enumerate((x, y, z))
    )
    # The least axis is left out.
    one = write.switch("VECTOR", x_is_least, along_x, along_y)
    other = write.switch("VECTOR", z_is_least, along_z, along_y)
    sides = {"one": one, "other": other}
    return {name: _placed(write, axis, rotation, size, inputs["frame"]) for name, axis in sides.items()}


def _placed(
    write: NodeWriter, axis: Value, rotation: Value, size: Value, frame: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    turned = write.output("FunctionNodeRotateVector", axis, rotation)
    moved = write.output("FunctionNodeTransformDirection", turned, frame)
    return write.output("ShaderNodeVectorMath", moved, size, operation="SCALE")
