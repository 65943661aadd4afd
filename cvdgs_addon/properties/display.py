"""What the sub-panel "Display" keeps beside the Gaussians' own inputs, which are kept with their modifier."""

from __future__ import annotations

import bpy

from ..scene.splats import is_splats


def _is_target(_display: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    return is_splats(candidate)


class DisplayProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.display``."""

    target: bpy.props.PointerProperty(
        name="Gaussians",
        description="The Gaussians that this panel is about; empty: the active object, or the first of the scene",
        type=bpy.types.Object,
        poll=_is_target,
    )
    engine: bpy.props.EnumProperty(
        name="Engine",
        description="The render engine that is set up for Gaussians",
        items=(
            ("CYCLES", "Cycles", "Exactly the trained image, one sample without noise; fast on many cores"),
            ("EEVEE", "EEVEE", "Close to the trained image; needs OpenGL, fast on a graphics card"),
        ),
        default="CYCLES",
    )
    colors: bpy.props.EnumProperty(
        name="Colours",
        description="How the photographs' colours get onto the screen",
        items=(
            ("PHOTO", "As Photographed", "Blended and shown as trained; the view transform is set to Raw"),
            ("SCENE_LINEAR", "With Lamps", "Converted to light, for a scene with lit objects; view transform Standard"),
        ),
        default="PHOTO",
    )


CLASSES: tuple[type, ...] = (DisplayProperties,)
