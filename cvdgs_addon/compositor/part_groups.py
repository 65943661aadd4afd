"""Compositor node groups that the simulation consists of: its matrices, and the sRGB transfer function.

Every model is a weighted sum of published matrices, so the groups sum those. The weights are the same for all pixels
and cost nothing. A matrix is three vectors, its rows. The transfer function (IEC 61966-2-1) takes a channel at a time:
Blender's Convert Colorspace node does the same from a table, 2e-5 off, and takes premultiplied colours for straight.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import bpy
import numpy as np

from ...core.color import machado2009
from ...core.color.matrices import Matrix, linear_simulation
from ...core.color.srgb import ENCODED_KNEE, EXPONENT, LINEAR_KNEE, OFFSET, SLOPE
from ..scene.nodes import NodeWriter, Value, add_input, new_group

DICHROMATIC_TYPES = ("protan", "deutan", "tritan")

SEVERITY = "Severity"
ROWS = ("Red", "Green", "Blue")
ROWS_BELOW = ("Red Below", "Green Below", "Blue Below")
SEPARATOR = "Separator"
ACHROMAT, VIENOT, BRETTEL = "Achromat", "Viénot", "Brettel"  # weights, beside those of the types


def machado_group(cvd: str) -> bpy.types.NodeTree:
    """Severity to the rows of Machado's matrix for one type, interpolated between the published severities."""
    tree = new_group("CompositorNodeTree", f"CVD Machado {cvd}")
    add_input(tree, SEVERITY, "NodeSocketFloat", "0 is normal vision, 1 is dichromacy")
    _add_outputs(tree, *ROWS)
    write = NodeWriter(tree)
    (severity, *_) = write.node("NodeGroupInput").outputs
    table = machado2009.MATRICES[cvd]
    rows: list[Value] = [row.tolist() for row in table[0]]
    for step, (lower, upper) in enumerate(itertools.pairwise(table)):
        # How far severity has passed this step, 0 to 1.
        passed = write.output("ShaderNodeMath", severity, 1.0 / machado2009.SEVERITY_STEP, -float(step),
                              operation="MULTIPLY_ADD", use_clamp=True)  # fmt: skip
        rows = _add(write, rows, passed, upper - lower)
    return _finished(write, rows)


def dichromat_group() -> bpy.types.NodeTree:
    """Weights of types and models, and severity, to the rows of everything that is not Machado's.

    Below severity 1 these models are mixed with normal vision. Brettel's has two matrices: the ordinary rows apply
    where a colour's product with the separator is not negative, the rows below where it is.
    """
    tree = new_group("CompositorNodeTree", "CVD dichromats")
    for name in (SEVERITY, *DICHROMATIC_TYPES, ACHROMAT, VIENOT, BRETTEL):
        add_input(tree, name, "NodeSocketFloat", "Weight, 0 or 1" if name != SEVERITY else "0 to 1")
    _add_outputs(tree, *ROWS, *ROWS_BELOW, SEPARATOR)
    write = NodeWriter(tree)
    inputs = write.node("NodeGroupInput").outputs
    severity = inputs[SEVERITY]

    rows: list[Value] = [(0.0, 0.0, 0.0)] * 3
    rows = _add(write, rows, write.math("SUBTRACT", 1.0, severity), np.eye(3))
    achromat = write.math("MULTIPLY", inputs[ACHROMAT], severity)
    rows = _add(write, rows, achromat, linear_simulation("achromat", 1.0).matrix)
    for cvd in ("protan", "deutan"):
        weight = write.product(inputs[VIENOT], inputs[cvd], severity)
        rows = _add(write, rows, weight, linear_simulation(cvd, 1.0, "vienot").matrix)
    below = list(rows)
    separator: list[Value] = [(0.0, 0.0, 0.0)]
    for cvd in DICHROMATIC_TYPES:
        brettel = linear_simulation(cvd, 1.0, "brettel")
        assert brettel.matrix_below is not None
        assert brettel.separator is not None
        # Viénot et al. describe no tritan vision; Brettel's stands in.
        model = write.sum(inputs[BRETTEL], inputs[VIENOT]) if cvd == "tritan" else inputs[BRETTEL]
        weight = write.product(model, inputs[cvd], severity)
        rows, below = _add(write, rows, weight, brettel.matrix), _add(write, below, weight, brettel.matrix_below)
        separator = _add(write, separator, inputs[cvd], brettel.separator[None])
    return _finished(write, [*rows, *below, *separator])


def _add_outputs(tree: bpy.types.NodeTree, *names: str) -> None:
    for name in names:
        tree.interface.new_socket(name, in_out="OUTPUT", socket_type="NodeSocketVector")


def _add(write: NodeWriter, rows: Sequence[Value], weight: Value, matrix: Matrix) -> list[Value]:
    """The rows plus those of weight times matrix."""
    return [
        write.vector_math("MULTIPLY_ADD", addend.tolist(), weight, row)
        for row, addend in zip(rows, matrix, strict=True)
    ]


def _finished(write: NodeWriter, outputs: Sequence[Value]) -> bpy.types.NodeTree:
    write.node("NodeGroupOutput", *outputs)
    write.arrange()
    return write.tree


def decoding_group() -> bpy.types.NodeTree:
    """An sRGB value, clipped as a screen clips, to linear light."""
    write, value = _begun("CVD sRGB to light", "sRGB value")
    clipped = write.output("ShaderNodeClamp", value, 0.0, 1.0)
    base = write.math("DIVIDE", write.sum(clipped, OFFSET), 1.0 + OFFSET)
    straight = write.math("DIVIDE", clipped, SLOPE)
    return _by_knee(write, clipped, ENCODED_KNEE, straight, write.math("POWER", base, EXPONENT))


def encoding_group() -> bpy.types.NodeTree:
    """Linear light, clipped as a screen clips, to an sRGB value."""
    write, value = _begun("CVD light to sRGB", "Light")
    clipped = write.output("ShaderNodeClamp", value, 0.0, 1.0)
    power = write.math("POWER", clipped, 1.0 / EXPONENT)
    straight = write.math("MULTIPLY", clipped, SLOPE)
    return _by_knee(write, clipped, LINEAR_KNEE, straight, write.math("MULTIPLY_ADD", power, 1.0 + OFFSET, -OFFSET))


def _begun(name: str, description: str) -> tuple[NodeWriter, Value]:
    tree = new_group("CompositorNodeTree", name)
    add_input(tree, "Value", "NodeSocketFloat", description)
    tree.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    write = NodeWriter(tree)
    return write, write.node("NodeGroupInput").outputs[0]


def _by_knee(write: NodeWriter, value: Value, knee: float, straight: Value, curved: Value) -> bpy.types.NodeTree:
    write.node("NodeGroupOutput", write.mix("FLOAT", write.math("GREATER_THAN", value, knee), straight, curved))
    write.arrange()
    return write.tree
