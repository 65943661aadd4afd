"""Colour as geometry nodes: sRGB to scene-linear light and back, and spherical harmonics of degree 1 to 3."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from ...core.color.srgb import ENCODED_KNEE, EXPONENT, LINEAR_KNEE, OFFSET, SLOPE
from ...core.splats.harmonics import SH_C1, SH_C2, SH_C3
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


def add_encoding_nodes(write: NodeWriter, light: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """sRGB values of scene-linear light, the inverse of `add_decoding_nodes`."""
    return write.nested("CVD Light to sRGB", _encoded, {"light": light})["encoded"]


def _encoded(write: NodeWriter, inputs: Sockets) -> Mapping[str, Value]:
    channels = []
    for value in write.separate(inputs["light"]):
        root = write.math("POWER", value, 1.0 / EXPONENT)
        bright = write.math("MULTIPLY_ADD", root, 1.0 + OFFSET, -OFFSET)
        is_dark = write.compare("LESS_EQUAL", value, LINEAR_KNEE)
        channels.append(write.switch("FLOAT", is_dark, bright, write.math("MULTIPLY", value, SLOPE)))
    return {"encoded": write.combine(*channels)}


def coefficient_attribute(index: int) -> str:
    """Name of the FLOAT_VECTOR attribute of coefficient `index` (1 to 15), red, green and blue."""
    return f"sh_{index}"


def coefficient_count(degree: int) -> int:
    """Coefficients of degrees 1 to `degree`; the constant one is part of the original colour."""
    return (degree + 1) ** 2 - 1


def view_dependent_part(write: NodeWriter, direction: Value, degree: int) -> Value:
    """The sum of the coefficients times their basis functions, without the constant one.

    Args:
        direction: unit vector from the camera to the Gaussian, in the axes of the PLY.
        degree: 1 to 3.
    """
    total = None
    for index, basis in enumerate(_basis(write, direction, degree), start=1):
        coefficient = write.attribute("FLOAT_VECTOR", coefficient_attribute(index)).outputs["Attribute"]
        term = write.output("ShaderNodeVectorMath", coefficient, basis, operation="SCALE")
        total = term if total is None else write.vector_math("ADD", total, term)
    assert total is not None
    return total


def _basis(write: NodeWriter, direction: Value, degree: int) -> list[Value]:
    """What `core.splats.harmonics.basis` has, as nodes."""

    def weighted(*terms: tuple[float, Value]) -> Value:
        return write.sum(*(write.math("MULTIPLY", value, weight) for weight, value in terms))

    times = write.product
    x, y, z = write.separate(direction)
    basis = [times(-SH_C1, y), times(SH_C1, z), times(-SH_C1, x)]
    if degree >= 2:
        xx, yy, zz = times(x, x), times(y, y), times(z, z)
        basis += [
            times(SH_C2[0], x, y),
            times(SH_C2[1], y, z),
            times(SH_C2[2], weighted((2.0, zz), (-1.0, xx), (-1.0, yy))),
            times(SH_C2[3], x, z),
            times(SH_C2[4], weighted((1.0, xx), (-1.0, yy))),
        ]
    if degree >= 3:
        basis += [
            times(SH_C3[0], y, weighted((3.0, xx), (-1.0, yy))),
            times(SH_C3[1], x, y, z),
            times(SH_C3[2], y, weighted((4.0, zz), (-1.0, xx), (-1.0, yy))),
            times(SH_C3[3], z, weighted((2.0, zz), (-3.0, xx), (-3.0, yy))),
            times(SH_C3[4], x, weighted((4.0, zz), (-1.0, xx), (-1.0, yy))),
            times(SH_C3[5], z, weighted((1.0, xx), (-1.0, yy))),
            times(SH_C3[6], x, weighted((1.0, xx), (-3.0, yy))),
        ]
    return basis
