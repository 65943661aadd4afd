"""What the N-panel keeps with the scene, as ``scene.cvdgs``: one group of properties a sub-panel.

What a run can be told (`core.settings`) brings its name, its description and its limits along.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import bpy

from ..core.color.arrangement import CAP_COUNT
from ..core.errors import InputError
from ..core.settings import CVD_TYPES, OPTIONS, Settings
from .comparison import follow_comparison
from .compositor.apply import apply_simulation, remove_simulation
from .inspection import start_inspection
from .messages import sentence, show_problem
from .quality import QUALITIES
from .scene.splats import is_splats
from .scene.turntable import USUAL_HEIGHT, Turntable

_CVD_WORDS = {
    "protan": ("Protan", "L cones missing or shifted: red looks dark and resembles green"),
    "deutan": ("Deutan", "M cones missing or shifted, the most common type: red resembles green"),
    "tritan": ("Tritan", "S cones missing: blue resembles green, yellow resembles grey"),
    "achromat": ("Achromat", "No colour vision, luminance only"),
}
_SIMULATION_WORDS = {
    "machado": ("Machado 2009", "Covers every severity; the usual choice"),
    "vienot": ("Viénot 1999", "Protan and deutan dichromats"),
    "brettel": ("Brettel 1997", "Dichromats; the accepted model for tritan"),
}
_CVD_ITEMS = tuple((cvd, *_CVD_WORDS[cvd]) for cvd in CVD_TYPES)
_SIMULATION_ITEMS = tuple((model, *_SIMULATION_WORDS[model]) for model in OPTIONS["simulation"].choices)
_ENGINES = (
    ("CYCLES", "Cycles", "Exactly the trained image in one noise-free sample; fast on many cores"),
    ("EEVEE", "EEVEE", "Close to the trained image; needs OpenGL, fast on a graphics card"),
)
_DEFAULTS = {field.name: field.default for field in fields(Settings)}


def setting(name: str, /, **others: Any) -> dict[str, Any]:
    """Keywords of a property for the setting `name`: what `core.settings` says of it, then `others`."""
    option = OPTIONS[name]
    limits = {key: value for key, value in (("min", option.low), ("max", option.high)) if math.isfinite(value)}
    default = {} if _DEFAULTS[name] is None else {"default": _DEFAULTS[name]}
    return {"name": option.label, "description": sentence(option.text), **limits, **default, **others}


def _inspect(capture: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    if not bpy.app.background:  # nobody would hear the worker's answer; see operators.capture
        start_inspection(capture.id_data)


def _simulate(changed: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Put what was changed in force at once, where a simulation is shown."""
    _apply_simulation(changed.id_data)


def _apply_simulation(scene: bpy.types.Scene) -> None:
    """Put in force what `scene` says of the simulation; where that is not possible, tell why and untick it."""
    try:
        apply_simulation(scene)
    except InputError as error:
        remove_simulation(scene)
        for where in ("in_renders", "in_viewport"):
            scene.cvdgs.simulate.property_unset(where)  # setting it would call this again
        show_problem("Simulate CVD", str(error))


def _wipe(simulate: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """One border at a time."""
    if simulate.wipe and simulate.compare:
        simulate.compare = False
    _apply_simulation(simulate.id_data)


def _compare(simulate: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    if simulate.compare and simulate.wipe:
        simulate.wipe = False
    follow_comparison(simulate.id_data)


def _move_border(simulate: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    follow_comparison(simulate.id_data)
    _apply_simulation(simulate.id_data)


def is_target(display: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    """Whether the panel's fields offer `candidate`: Gaussians of the same scene, which are what its buttons change."""
    return is_splats(candidate) and display.id_data.objects.get(candidate.name) == candidate


class CaptureProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.capture``; all but `folder` and `cameras` is filled in by an inspection."""

    folder: bpy.props.StringProperty(
        name="Folder",
        description="Photographs, with cameras (COLMAP or transforms.json) or without; or a video, or a zip",
        subtype="DIR_PATH",
        update=_inspect,
    )
    cameras: bpy.props.EnumProperty(
        name="Cameras",
        description="Where the photographs were taken from",
        items=(
            ("AUTO", "Automatic", "Take the cameras that are given; estimate them where there are none, in minutes"),
            ("ESTIMATE", "Estimate", "Reconstruct where the photographs were taken from; takes minutes"),
            ("GIVEN", "Given", "Refuse photographs without cameras"),
        ),
        update=_inspect,
    )
    inspected: bpy.props.StringProperty(
        name="Inspected", description="The folder that the following describes", options={"HIDDEN"}
    )
    format: bpy.props.StringProperty(name="Format", description="Where the cameras come from")
    views: bpy.props.IntProperty(name="Photographs", description="Number of usable photographs", min=0)
    videos: bpy.props.IntProperty(name="Videos", description="Whose frames become photographs", min=0)
    seconds: bpy.props.FloatProperty(name="Seconds", description="Of all videos", min=0.0)
    points: bpy.props.IntProperty(name="Points", description="Sparse points that came with the cameras", min=0)
    width: bpy.props.IntProperty(name="Width", description="Of most photographs, in pixels", min=0)
    height: bpy.props.IntProperty(name="Height", description="Of most photographs, in pixels", min=0)
    sizes: bpy.props.StringProperty(name="Sizes", description="Widths and heights of the photographs in pixels")
    warnings: bpy.props.StringProperty(name="Warnings", description="One per line", options={"HIDDEN"})
    problem: bpy.props.StringProperty(
        name="Problem", description="Why the folder cannot be used; empty if it can", options={"HIDDEN"}
    )


class Deficiency:
    """A colour vision deficiency: its type, how severe it is, and the model that simulates it."""

    cvd: bpy.props.EnumProperty(
        name="Type",
        description="The type of colour vision deficiency",
        items=_CVD_ITEMS,
        default="deutan",
        update=_simulate,
    )
    severity: bpy.props.FloatProperty(
        name="Severity",
        description="0 is normal vision, 1 is dichromacy: one type of cones is missing",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=1.0,
        update=_simulate,
    )
    simulation: bpy.props.EnumProperty(
        **setting(
            "simulation",
            description="The published simulation model; Viénot's has no tritan, so Brettel's is used there",
            items=_SIMULATION_ITEMS,
            update=_simulate,
        )
    )


class ViewerProperties(Deficiency, bpy.types.PropertyGroup):
    """``scene.cvdgs.viewer``: whose eyes the scene is made for, and the course of the arrangement test."""

    strength: bpy.props.FloatProperty(**setting("strength", subtype="FACTOR"))
    test_is_open: bpy.props.BoolProperty(
        name="Arrangement Test", description="Whether the test is shown", options={"HIDDEN"}
    )
    test_pool: bpy.props.IntVectorProperty(
        name="Pool", description="Order in which the caps are offered", size=CAP_COUNT, options={"HIDDEN"}
    )
    test_arranged: bpy.props.IntVectorProperty(
        name="Arrangement", description="Caps in the order of the row; 0: free", size=CAP_COUNT, options={"HIDDEN"}
    )


class RunProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.run``: how the button "Make CVD-friendly" works."""

    quality: bpy.props.EnumProperty(
        name="Quality",
        description="How detailed the reconstruction is, and how long it takes",
        items=tuple((quality.name, quality.label, quality.description) for quality in QUALITIES),
        default="STANDARD",
    )
    enhancer: bpy.props.EnumProperty(
        **setting(
            "enhancer",
            name="Enhancer",
            description="The method that finds the new colours",
            items=(
                (
                    "scene",
                    "Scene Network",
                    "A small network fitted to the photographs, which sees each pixel's surroundings",
                ),
                ("lut", "Colour Mapping", "One smooth mapping of the scene's colours, fitted to the photographs"),
                ("cgan", "Predicted Network", "The scene network, predicted by a trained one and briefly fitted"),
            ),
        )
    )
    out: bpy.props.StringProperty(
        name="Output",
        description="Folder for the results; empty: beside the capture. A run that is already there gets a new layer",
        subtype="DIR_PATH",
    )
    refine_poses: bpy.props.BoolProperty(**setting("refine_poses", default=True))
    start_over: bpy.props.BoolProperty(
        name="Start Over", description="Replace the run in the output folder instead of adding a layer to it"
    )
    scene_file: bpy.props.BoolProperty(
        **setting(
            "blend", description="Also write scene.blend and a still of each layer to the output folder", default=False
        )
    )


class DisplayProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.display``: what is kept beside the Gaussians' own inputs, which are kept with their modifier."""

    target: bpy.props.PointerProperty(
        name="Gaussians",
        description="The Gaussians that this panel controls; empty: the active object, or the first in the scene",
        type=bpy.types.Object,
        poll=is_target,
    )
    engine: bpy.props.EnumProperty(
        name="Engine", description="The render engine to set up for Gaussians", items=_ENGINES, default="CYCLES"
    )
    colors: bpy.props.EnumProperty(
        name="Colours",
        description="How the photographs' colours reach the screen",
        items=(
            ("PHOTO", "As Photographed", "Blended and shown as trained, with the Raw view transform"),
            ("SCENE_LINEAR", "With Lamps", "Converted to light for a scene with lit objects; Standard view transform"),
        ),
        default="PHOTO",
    )
    partner: bpy.props.PointerProperty(
        name="With",
        description="The run that this one is aligned with; empty: the first other one that is visible",
        type=bpy.types.Object,
        poll=is_target,
    )
    automatic: bpy.props.BoolProperty(
        name="Automatic",
        description="Draw the preview in Solid shading and the Gaussians in Cycles. Without a graphics card, also "
        "render a new scene through a camera once nothing else is going on",
        default=True,
    )


class SimulateProperties(Deficiency, bpy.types.PropertyGroup):
    """``scene.cvdgs.simulate``: where the simulation shows, and whose eyes; every change is put in force at once."""

    in_renders: bpy.props.BoolProperty(
        name="Renders", description="Show renders as seen with the colour vision deficiency", update=_simulate
    )
    in_viewport: bpy.props.BoolProperty(
        name="Viewport",
        description="Show 3D views as seen with the colour vision deficiency, in Material Preview and Rendered shading",
        update=_simulate,
    )
    same_as_viewer: bpy.props.BoolProperty(
        name="Use the Viewer's Settings",
        description="Simulate the type, severity and model set under Viewer; off: choose others here",
        default=True,
        update=_simulate,
    )
    wipe: bpy.props.BoolProperty(
        name="Side by Side", description="Leave the left part of the picture unchanged for comparison", update=_wipe
    )
    compare: bpy.props.BoolProperty(
        name="Original | Enhanced",
        description="Show the original colours left of the border in the camera's picture, those of the layer right",
        update=_compare,
    )
    wipe_position: bpy.props.FloatProperty(
        name="Border",
        description="Where the right part begins, as a fraction of the picture's width",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=0.5,
        update=_move_border,
    )


class TurntableProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs.turntable``: the camera's path around the subject, and how it is rendered."""

    frames: bpy.props.IntProperty(
        name="Frames", description="Images in one turn", min=2, soft_max=720, default=Turntable.frames
    )
    radius: bpy.props.FloatProperty(
        name="Radius",
        description="Distance of the camera from the turntable's axis; 0: as far as the photographs were taken from",
        subtype="DISTANCE",
        min=0.0,
        default=Turntable.radius,
    )
    has_height: bpy.props.BoolProperty(
        name="Choose Height",
        description="Choose the height of the camera; off: as high as the photographs were taken from",
    )
    height: bpy.props.FloatProperty(
        name="Height (× radius)",
        description="Height of the camera above the subject's centre, as a multiple of the radius",
        soft_min=-1.0,
        soft_max=2.0,
        default=USUAL_HEIGHT,
    )
    focal_length: bpy.props.FloatProperty(
        name="Focal Length",
        description="Focal length for a sensor 36 mm wide; 0: that of the photographs",
        unit="CAMERA",
        min=0.0,
        soft_max=200.0,
        default=Turntable.focal_length,
    )
    arc: bpy.props.FloatProperty(
        name="Arc",
        description="A full turn, or less to swing to and fro; 0: as far around as the photographs were taken",
        subtype="ANGLE",
        min=0.0,
        max=2.0 * math.pi,
        default=math.radians(Turntable.arc),
    )
    engine: bpy.props.EnumProperty(
        name="Engine",
        description="The render engine for the turntable",
        items=(*_ENGINES, ("SCENE", "Scene", "The scene's own engine and settings")),
        default="CYCLES",
    )
    width: bpy.props.IntProperty(
        name="Width", description="Width of the images", subtype="PIXEL", min=4, soft_max=4096, default=Turntable.width
    )
    height_pixels: bpy.props.IntProperty(
        name="Height",
        description="Height of the images",
        subtype="PIXEL",
        min=4,
        soft_max=4096,
        default=Turntable.height_pixels,
    )
    folder: bpy.props.StringProperty(
        name="Folder",
        description="Folder for the images 0001.png, 0002.png, ...",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        default="//turntable/",
    )


class SceneProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs``, saved with the .blend and part of its undo history."""

    capture: bpy.props.PointerProperty(type=CaptureProperties)
    viewer: bpy.props.PointerProperty(type=ViewerProperties)
    run: bpy.props.PointerProperty(type=RunProperties)
    display: bpy.props.PointerProperty(type=DisplayProperties)
    simulate: bpy.props.PointerProperty(type=SimulateProperties)
    turntable: bpy.props.PointerProperty(type=TurntableProperties)


CLASSES: tuple[type, ...] = (
    CaptureProperties,
    ViewerProperties,
    RunProperties,
    DisplayProperties,
    SimulateProperties,
    TurntableProperties,
    SceneProperties,
)
