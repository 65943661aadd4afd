"""What the sub-panel "Make CVD-friendly" keeps: how the button works."""

from __future__ import annotations

import bpy

from ..quality import QUALITIES


class RunProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.run``."""

    quality: bpy.props.EnumProperty(
        name="Quality",
        description="How fine the reconstruction becomes, and how long it takes",
        items=tuple((quality.name, quality.label, quality.description) for quality in QUALITIES),
        default="STANDARD",
    )
    enhancer: bpy.props.EnumProperty(
        name="Enhancer",
        description="What finds the new colours",
        items=(
            ("lut", "Colour Mapping", "One smooth mapping of the scene's colours, fitted to the photographs"),
            (
                "scene",
                "Scene Network",
                "A small network that is fitted to the photographs and sees what is around a place",
            ),
            ("cgan", "Network", "The mapping, and a trained network on top that may treat places differently"),
        ),
        default="lut",
    )
    out: bpy.props.StringProperty(
        name="Output",
        description="Folder for the results; empty: beside the capture. A run that is there gets a further layer",
        subtype="DIR_PATH",
    )
    refine_poses: bpy.props.BoolProperty(
        name="Correct Cameras",
        description="Correct cameras that are a little off, and a wrong focal length; good ones stay as given",
        default=True,
    )
    start_over: bpy.props.BoolProperty(
        name="Start Over",
        description="Make a new run in place of the one in the output folder, instead of adding a layer to it",
    )
    scene_file: bpy.props.BoolProperty(
        name="Scene File and Stills",
        description="Also write scene.blend and a still of each layer into the output folder",
    )


CLASSES: tuple[type, ...] = (RunProperties,)
