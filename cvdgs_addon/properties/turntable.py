"""What the sub-panel "Turntable" keeps: the camera's way around the subject, and how it is rendered."""

from __future__ import annotations

import math

import bpy


class TurntableProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.turntable``."""

    frames: bpy.props.IntProperty(
        name="Frames",
        description="Pictures of one turn",
        min=2,
        soft_max=720,
        default=96,
    )
    radius: bpy.props.FloatProperty(
        name="Radius",
        description="Distance of the camera from the axis of the turn; 0: as far as the photographs were taken from",
        subtype="DISTANCE",
        min=0.0,
        default=0.0,
    )
    height: bpy.props.FloatProperty(
        name="Camera Height",
        description="Height of the camera above the subject's centre, as a share of the radius",
        soft_min=-1.0,
        soft_max=2.0,
        default=0.25,
    )
    focal_length: bpy.props.FloatProperty(
        name="Focal Length",
        description="Of the camera, for a sensor 36 mm wide; 0: that of the photographs",
        unit="CAMERA",
        min=0.0,
        soft_max=200.0,
        default=0.0,
    )
    arc: bpy.props.FloatProperty(
        name="Arc",
        description="How far around: a full turn, or to and fro through less; 0: as far as the photographs were taken",
        subtype="ANGLE",
        min=0.0,
        max=2.0 * math.pi,
        default=0.0,
    )
    engine: bpy.props.EnumProperty(
        name="Engine",
        description="What renders the turntable",
        items=(
            ("CYCLES", "Cycles", "Exactly the trained images, one sample without noise"),
            ("EEVEE", "EEVEE", "Close to the trained images; needs OpenGL, fast on a graphics card"),
            ("SCENE", "Of the Scene", "The scene's own engine and settings"),
        ),
        default="CYCLES",
    )
    width: bpy.props.IntProperty(
        name="Width", description="Of the pictures", subtype="PIXEL", min=4, soft_max=4096, default=640
    )
    height_pixels: bpy.props.IntProperty(
        name="Height", description="Of the pictures", subtype="PIXEL", min=4, soft_max=4096, default=480
    )
    folder: bpy.props.StringProperty(
        name="Folder",
        description="Where the pictures are written, as 0001.png, 0002.png, ...",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        default="//turntable/",
    )


CLASSES: tuple[type, ...] = (TurntableProperties,)
