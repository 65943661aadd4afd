"""Compositor node groups of the sRGB transfer function (IEC 61966-2-1), a channel at a time.

Blender's Convert Colorspace node does the same from a table, 2e-5 off, and takes premultiplied colours for straight.
"""

from __future__ import annotations

import bpy

from ...core.color.srgb import ENCODED_KNEE, EXPONENT, LINEAR_KNEE, OFFSET, SLOPE
from ..scene.nodes import NodeWriter, Value, add_input, new_group


def decoding_group() -> bpy.types.NodeTree:
    """An sRGB value, clipped as a screen clips, to linear light."""
    write, value = _begun("CVD sRGB to light", "sRGB value")
    clipped = write.output("ShaderNodeClamp", value, 0.0, 1.0)
    base = write.math("DIVIDE", write.sum(clipped, OFFSET), 1.0 + OFFSET)
    straight = write.math("DIVIDE", clipped, SLOPE)
    return _chosen(write, clipped, ENCODED_KNEE, straight, write.math("POWER", base, EXPONENT))


def encoding_group() -> bpy.types.NodeTree:
    """Linear light, clipped as a screen clips, to an sRGB value."""
    write, value = _begun("CVD light to sRGB", "Light")
    clipped = write.output("ShaderNodeClamp", value, 0.0, 1.0)
    power = write.math("POWER", clipped, 1.0 / EXPONENT)
    straight = write.math("MULTIPLY", clipped, SLOPE)
    return _chosen(write, clipped, LINEAR_KNEE, straight, write.math("MULTIPLY_ADD", power, 1.0 + OFFSET, -OFFSET))


def _begun(name: str, description: str) -> tuple[NodeWriter, Value]:
    tree = new_group("CompositorNodeTree", name)
    add_input(tree, "Value", "NodeSocketFloat", description)
    tree.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    write = NodeWriter(tree)
    return write, write.node("NodeGroupInput").outputs[0]


def _chosen(write: NodeWriter, value: Value, knee: float, straight: Value, curved: Value) -> bpy.types.NodeTree:
    write.node("NodeGroupOutput", write.mix("FLOAT", write.math("GREATER_THAN", value, knee), straight, curved))
    write.arrange()
    return write.tree
