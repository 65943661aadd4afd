"""Geometry nodes that shade Gaussians by a lamp: a diffuse factor on their colours, by the normals of `normals`.

The factor multiplies light that the photographs already hold. No shadow is thrown, none that was there goes away, and
gloss stays where it was photographed.
"""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from .color_nodes import add_decoding_nodes, add_encoding_nodes
from .nodes import NodeWriter, Sockets, Value
from .splat_attributes import Attribute

# Of what faces away from the lamp, and what is added where a surface faces it: a surface that the lamp meets at 50
# degrees keeps its brightness. Chosen by looking at the demo.
TURNED_AWAY = 0.35
FACING = 1.04

_Z = (0.0, 0.0, 1.0)


def add_shade_nodes(write: NodeWriter, lamp: Value, frame: bpy.types.NodeSocket, amount: Value) -> Value:
    """What the lamp multiplies a Gaussian's light by: 1 where `amount` is 0, and where no normals were stored.

    Args:
        write: into the group of the Gaussians.
        lamp: object; the direction in which it shines, its -z, counts, and not its place.
        frame: matrix that the Gaussians' axes went through (see `Frame`).
        amount: how far, 0 to 1.
    """
    to_object = write.output("GeometryNodeObjectInfo", lamp, name="Transform", transform_space="RELATIVE")
    return write.nested("CVD Shade", _shade, {"lamp": to_object, "frame": frame, "amount": amount})["factor"]


def _shade(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    towards = write.output("FunctionNodeTransformDirection", _Z, inputs["lamp"])
    unframed = write.output("FunctionNodeInvertMatrix", inputs["frame"])
    towards = write.vector_math("NORMALIZE", write.output("FunctionNodeTransformDirection", towards, unframed))
    normal = write.attribute("FLOAT_VECTOR", Attribute.NORMAL)
    facing = write.math("MAXIMUM", write.vector_math("DOT_PRODUCT", normal.outputs["Attribute"], towards), 0.0)
    lit = write.math("MULTIPLY_ADD", facing, FACING, TURNED_AWAY)
    known = write.switch("FLOAT", normal.outputs["Exists"], 1.0, lit)
    return {"factor": write.mix("FLOAT", inputs["amount"], 1.0, known)}


def shaded(write: NodeWriter, encoded: Value, factor: Value, is_relit: Value) -> bpy.types.NodeSocket:
    """The display-referred colour with its light multiplied by `factor`, where `is_relit`."""
    light = write.output("ShaderNodeVectorMath", add_decoding_nodes(write, encoded), factor, operation="SCALE")
    return write.switch("RGBA", is_relit, encoded, add_encoding_nodes(write, light))
