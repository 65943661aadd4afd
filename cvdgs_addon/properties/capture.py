"""What the sub-panel "Capture" keeps: the folder, and what the worker has found in it."""

from __future__ import annotations

import bpy

from ..inspection import start_inspection


def _inspect(_capture: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    if not bpy.app.background:  # nobody would hear the worker's answer; see operators.capture
        start_inspection(context.scene)


class CaptureProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.capture``; all but `folder` and `sfm` is filled in by an inspection."""

    folder: bpy.props.StringProperty(
        name="Folder",
        description="Photographs with cameras: a COLMAP model or a transforms.json with its images",
        subtype="DIR_PATH",
        update=_inspect,
    )
    sfm: bpy.props.BoolProperty(
        name="Estimate Cameras",
        description="For a folder of photographs alone: find out where they were taken from; takes minutes",
        update=_inspect,
    )
    inspected: bpy.props.StringProperty(
        name="Inspected", description="The folder that the following is about", options={"HIDDEN"}
    )
    format: bpy.props.StringProperty(name="Format", description="Where the cameras come from")
    views: bpy.props.IntProperty(name="Views", description="Usable photographs", min=0)
    points: bpy.props.IntProperty(name="Points", description="Sparse points that came with the cameras", min=0)
    width: bpy.props.IntProperty(name="Width", description="Of most photographs, in pixels", min=0)
    height: bpy.props.IntProperty(name="Height", description="Of most photographs, in pixels", min=0)
    sizes: bpy.props.StringProperty(name="Sizes", description="Widths and heights of the photographs in pixels")
    warnings: bpy.props.StringProperty(name="Warnings", description="One a line", options={"HIDDEN"})
    problem: bpy.props.StringProperty(
        name="Problem", description="Why the folder cannot be used; empty: it can", options={"HIDDEN"}
    )


CLASSES: tuple[type, ...] = (CaptureProperties,)
