"""What the sub-panel "Simulate" keeps: where the CVD simulation shows, and whose eyes it simulates."""

from __future__ import annotations

import bpy

from ..compositor.apply import apply_simulation
from .viewer import CVD_ITEMS, SIMULATION_ITEMS


def _apply(_simulate: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    apply_simulation(context.scene)


class SimulateProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.simulate``; every change is put in force at once."""

    in_renders: bpy.props.BoolProperty(
        name="Renders",
        description="Show renders as they are seen with the colour vision deficiency",
        update=_apply,
    )
    in_viewport: bpy.props.BoolProperty(
        name="Viewport",
        description="Show 3D views as they are seen with the colour vision deficiency, in Material Preview and "
        "Rendered shading",
        update=_apply,
    )
    same_as_viewer: bpy.props.BoolProperty(
        name="As in Viewer",
        description="Simulate the type, severity and model of the sub-panel Viewer; off: another one",
        default=True,
        update=_apply,
    )
    cvd: bpy.props.EnumProperty(
        name="Type",
        description="The colour vision deficiency to simulate",
        items=CVD_ITEMS,
        default="deutan",
        update=_apply,
    )
    severity: bpy.props.FloatProperty(
        name="Severity",
        description="0 is normal vision, 1 the lack of a kind of cones",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=1.0,
        update=_apply,
    )
    simulation: bpy.props.EnumProperty(
        name="Model",
        description="The published model behind the simulation; Viénot describes no tritan vision and takes Brettel's",
        items=SIMULATION_ITEMS,
        default="machado",
        update=_apply,
    )
    wipe: bpy.props.BoolProperty(
        name="Side by Side",
        description="Leave the left part of the picture as it is, to compare",
        update=_apply,
    )
    wipe_position: bpy.props.FloatProperty(
        name="Border",
        description="Where the simulated part begins, as a share of the picture's width",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=0.5,
        update=_apply,
    )


CLASSES: tuple[type, ...] = (SimulateProperties,)
