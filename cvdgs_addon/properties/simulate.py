"""What the sub-panel "Simulate" keeps: where the CVD simulation shows, and whose eyes it simulates."""

from __future__ import annotations

import bpy

from .deficiency import Deficiency, update_simulation


class SimulateProperties(Deficiency, bpy.types.PropertyGroup):
    """``scene.cvdgs.simulate``; every change is put in force at once."""

    in_renders: bpy.props.BoolProperty(
        name="Renders",
        description="Show renders as they are seen with the colour vision deficiency",
        update=update_simulation,
    )
    in_viewport: bpy.props.BoolProperty(
        name="Viewport",
        description="Show 3D views as they are seen with the colour vision deficiency, in Material Preview and "
        "Rendered shading",
        update=update_simulation,
    )
    same_as_viewer: bpy.props.BoolProperty(
        name="As in Viewer",
        description="Simulate the type, severity and model of the sub-panel Viewer; off: another one",
        default=True,
        update=update_simulation,
    )
    wipe: bpy.props.BoolProperty(
        name="Side by Side",
        description="Leave the left part of the picture as it is, to compare",
        update=update_simulation,
    )
    wipe_position: bpy.props.FloatProperty(
        name="Border",
        description="Where the simulated part begins, as a share of the picture's width",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=0.5,
        update=update_simulation,
    )


CLASSES: tuple[type, ...] = (SimulateProperties,)
