"""Geometry nodes that compare: the original colours left of a border in the active camera's picture, others right.

The border is a plane through the camera's eye, which its picture shows as a vertical line. The plane is a part of the
scene, so that stills, turntables and 3D views agree on it, and a view from elsewhere shows where it cuts. On hulls the
material finds the side for each ray; what has one colour in all has that of its centre's side.
"""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from .nodes import NodeWriter, Sockets, Value
from .projection_nodes import FIELD_MARGIN, Camera
from .splat_attributes import Attribute

_ORIGIN = (0.0, 0.0, 0.0)


def add_border_nodes(write: NodeWriter, camera: Camera, border: Value) -> bpy.types.NodeSocket:
    """Normal of the plane in the camera's space; `border` is a fraction of the picture's width, from the left.

    A point (x, y, z) of that space is seen at the tangent x / -z, so that x + tangent z is negative left of the border.
    """
    inputs = {"low": camera.low_x, "high": camera.high_x, "border": border}
    return write.nested("CVD Border", _border, inputs)["normal"]


def _border(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    # The limits of the linearised field lie that far beyond the picture's own.
    share = write.math("DIVIDE", write.sum(inputs["border"], FIELD_MARGIN / 2.0), 1.0 + FIELD_MARGIN)
    tangent = write.mix("FLOAT", share, inputs["low"], inputs["high"])
    return {"normal": write.combine(1.0, 0.0, tangent)}


def is_left(write: NodeWriter, camera: Camera, normal: Value) -> bpy.types.NodeSocket:
    """Boolean field: the centre lies left of the border."""
    center = write.output("FunctionNodeTransformPoint", write.output("GeometryNodeInputPosition"), camera.from_object)
    return write.compare("LESS_THAN", write.vector_math("DOT_PRODUCT", normal, center), 0.0)


def with_border(
    write: NodeWriter, instances: Value, camera: Camera, normal: Value, original: Value
) -> bpy.types.NodeSocket:
    """Hulls with the colours of both sides, and the plane in the space of each: normal as colour, offset as alpha."""
    transform = write.output("GeometryNodeInstanceTransform")
    to_camera = write.multiply_matrices(camera.from_object, transform)
    transposed = write.output("FunctionNodeTransposeMatrix", to_camera)
    on_hull = write.separate(write.output("FunctionNodeTransformDirection", normal, transposed))
    center = write.output("FunctionNodeTransformPoint", _ORIGIN, to_camera)
    offset = write.vector_math("DOT_PRODUCT", normal, center)
    plane = write.output("FunctionNodeCombineColor", *on_hull, offset)
    for name, value in ((Attribute.BORDER, plane), (Attribute.ORIGINAL_COLOR, original)):
        instances = write.output("GeometryNodeStoreNamedAttribute", instances, True, name, value,
                                 data_type="FLOAT_COLOR", domain="INSTANCE")  # fmt: skip
    return instances
