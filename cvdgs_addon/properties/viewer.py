"""What the sub-panel "Viewer" keeps: whose eyes the scene is made for, and the course of the arrangement test."""

from __future__ import annotations

import bpy

from ..arrangement import CAP_COUNT
from ..compositor.apply import apply_simulation

CVD_ITEMS = (
    ("protan", "Protan", "L cones are missing or shifted: red is dark and resembles green"),
    ("deutan", "Deutan", "M cones are missing or shifted: the most common, red resembles green"),
    ("tritan", "Tritan", "S cones are missing: blue resembles green, yellow resembles grey"),
    ("achromat", "Achromat", "No colours at all, luminance only"),
)
SIMULATION_ITEMS = (
    ("machado", "Machado 2009", "Describes every severity; the usual choice"),
    ("vienot", "Viénot 1999", "Protan and deutan vision that lacks a kind of cones"),
    ("brettel", "Brettel 1997", "Vision that lacks a kind of cones; the accepted model for tritan"),
)


def _simulate(_viewer: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    apply_simulation(context.scene)


class ViewerProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.viewer``."""

    cvd: bpy.props.EnumProperty(
        name="Type", description="The colour vision deficiency", items=CVD_ITEMS, default="deutan", update=_simulate
    )
    severity: bpy.props.FloatProperty(
        name="Severity",
        description="0 is normal vision, 1 the lack of a kind of cones",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=1.0,
        update=_simulate,
    )
    simulation: bpy.props.EnumProperty(
        name="Model",
        description="The published model behind the simulation",
        items=SIMULATION_ITEMS,
        default="machado",
        update=_simulate,
    )
    strength: bpy.props.FloatProperty(
        name="Strength",
        description="0 leaves the colours as they are, 1 is the full enhancement",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=1.0,
    )
    test_is_open: bpy.props.BoolProperty(
        name="Arrangement Test", description="Whether the test is shown", options={"HIDDEN"}
    )
    test_pool: bpy.props.IntVectorProperty(
        name="Pool", description="Order in which the caps are offered", size=CAP_COUNT, options={"HIDDEN"}
    )
    test_arranged: bpy.props.IntVectorProperty(
        name="Arrangement",
        description="Numbers of the caps as they were put in a row; 0: free",
        size=CAP_COUNT,
        options={"HIDDEN"},
    )


CLASSES: tuple[type, ...] = (ViewerProperties,)
