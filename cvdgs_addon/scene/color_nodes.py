"""Geometry nodes from display-referred sRGB to scene-linear light."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from ...core.color.srgb import ENCODED_KNEE, EXPONENT, OFFSET, SLOPE
from .nodes import NodeWriter, Sockets, Value


def add_decoding_nodes(write: NodeWriter, encoded: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Scene-linear light of sRGB values (IEC 61966-2-1)."""
    return write.nested("CVD sRGB to Light", _decoded, {"encoded": encoded})["light"]


def _decoded(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    channels = []
    for value in write.separate(inputs["encoded"]):
        power = write.math("POWER", write.math("DIVIDE", write.sum(value, OFFSET), 1.0 + OFFSET), EXPONENT)
        is_dark = write.compare("LESS_EQUAL", value, ENCODED_KNEE)
        channels.append(write.switch("FLOAT", is_dark, power, write.math("DIVIDE", value, SLOPE)))
    return {"light": write.combine(*channels)}
