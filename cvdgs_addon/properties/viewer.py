"""What the sub-panel "Viewer" keeps: whose eyes the scene is made for, and the course of the arrangement test."""

from __future__ import annotations

import bpy

from ..arrangement import CAP_COUNT
from .deficiency import Deficiency


class ViewerProperties(Deficiency, bpy.types.PropertyGroup):
    """``scene.cvdgs.viewer``."""

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
