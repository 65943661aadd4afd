"""A colour vision deficiency as properties: what the sub-panels "Viewer" and "Simulate" both keep."""

from __future__ import annotations

import bpy

from ..compositor.apply import apply_simulation

CVD_ITEMS = (
    ("protan", "Protan", "L cones are missing or shifted: red is dark and resembles green"),
    ("deutan", "Deutan", "M cones are missing or shifted: the most common, red resembles green"),
    ("tritan", "Tritan", "S cones are missing: blue resembles green, yellow resembles grey"),
    ("achromat", "Achromat", "No colours at all, luminance only"),
)
_SIMULATION_ITEMS = (
    ("machado", "Machado 2009", "Describes every severity; the usual choice"),
    ("vienot", "Viénot 1999", "Protan and deutan vision that lacks a kind of cones"),
    ("brettel", "Brettel 1997", "Vision that lacks a kind of cones; the accepted model for tritan"),
)


def update_simulation(_properties: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Put what was changed in force at once, where a simulation is shown."""
    apply_simulation(context.scene)


class Deficiency:
    """Properties of a group: the type, how severe it is, and the model that simulates it."""

    cvd: bpy.props.EnumProperty(
        name="Type",
        description="The colour vision deficiency",
        items=CVD_ITEMS,
        default="deutan",
        update=update_simulation,
    )
    severity: bpy.props.FloatProperty(
        name="Severity",
        description="0 is normal vision, 1 the lack of a kind of cones",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=1.0,
        update=update_simulation,
    )
    simulation: bpy.props.EnumProperty(
        name="Model",
        description="The published model behind the simulation; Viénot describes no tritan vision and takes Brettel's",
        items=_SIMULATION_ITEMS,
        default="machado",
        update=update_simulation,
    )
