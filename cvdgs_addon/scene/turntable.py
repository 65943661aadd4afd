"""A turntable: a camera on its way around the subject, and the pictures that it takes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..activity import scene_by_uid
from .apart import follow
from .bystanders import bystanders
from .cameras import SENSOR_WIDTH, Clip, is_capture_camera
from .display import match_display
from .remembered_settings import Setting, change_settings, changes, restore_settings
from .render_settings import Display, Engine, display_of, engine_settings, literal_path, png_settings
from .splat_attributes import core_of
from .world_matrix import scale_of, world_of

_RENDER = "cvdgs_turntable_render"
_IS_RIG = "cvdgs_turntable"  # custom property of the Empty
# Custom properties of the Empty: pictures of a turn, the angle of the first one, and how far the camera swings from it.
_FRAMES, _START, _SWING = "frames", "start", "swing"
_ASKED = "asked_{what}"  # of the Empty, too: what settings and Gaussians asked for when the camera was set last
_FULL_TURN = 2.0 * math.pi
_SURROUNDED = math.radians(100.0)  # a gap between photographs up to this is a part of a full turn
_LEAST_ARC = math.radians(20.0)  # less shows no shape
_NAME = "Turntable"
_LENS = 50.0  # mm, where there are no photographs: Blender's own
USUAL_HEIGHT = 0.25
"""Of a camera above a subject without photographs, as a share of the radius."""
_RADII_AWAY = 2.5  # of such a camera, in radii of the subject's core
_POLL_SECONDS = 0.5  # between looks at whether a render still goes on
_NUMBER = "####"  # of a picture in its file name


@dataclass(frozen=True)
class Turntable:
    """A turn.

    Attributes:
        frames: pictures of one turn.
        radius: of the camera from the axis in scene units; 0: as far as the photographs were taken from.
        height: of the camera above the subject's centre, as a share of the radius; None: as high as the photographs
            were taken from.
        focal_length: in millimetres for a sensor 36 mm wide; 0: that of the photographs.
        arc: in degrees; 360 goes around, less swings to and fro, 0: as far around as the photographs were taken.
        width, height_pixels: of the pictures.
        engine: that renders; None: the scene's own, with its settings.
    """

    frames: int = 96
    radius: float = 0.0
    height: float | None = None
    focal_length: float = 0.0
    arc: float = 0.0
    width: int = 640
    height_pixels: int = 480
    engine: Engine | None = Engine.CYCLES


def add_turntable(scene: bpy.types.Scene, splats: bpy.types.Object, turntable: Turntable) -> bpy.types.Object:
    """Add the camera and the Empty that turns it, or bring those of `scene` up to date; returns the camera.

    The axis is vertical, through the centre of the Gaussians. The first picture of a full turn is taken from the side
    of the first photograph, that of a swing from the middle. The angle is driven by the frame, so it is exact in every
    frame and goes on after the last one. Of a turntable that is there, only what `turntable` or the Gaussians ask for
    anew is changed: what an artist has set by hand stays.

    Raises:
        InputError: the Gaussians are being edited, or none are left; the earlier turntable stays as it was.
    """
    bpy.context.view_layer.update()
    center, core_radius = _subject(splats)
    photographs = [camera for camera in _related(splats) if is_capture_camera(camera)]
    # Doubles, whose scalars are Python's numbers too: Blender stores no others.
    places = np.array([world_of(camera).translation for camera in photographs], np.float64).reshape(-1, 3) - center
    usual = _usual_radius(places)
    radius = turntable.radius or usual or _RADII_AWAY * core_radius
    height = turntable.height if turntable.height is not None else _usual_height(places, usual)
    start, swing = _way_around(places, math.radians(turntable.arc))
    camera = turntable_of(scene) or _new_turntable(scene)  # not before all is known of it
    rig = camera.parent
    rig[_FRAMES], rig[_START], rig[_SWING] = turntable.frames, start, swing
    _drive_by_frame(rig, swing)
    rig.empty_display_size = radius
    if _is_new(rig, "center", center.tolist()):
        rig.location = center.tolist()
    if _is_new(rig, "place", [radius, height]):
        camera.location = (radius, 0.0, height * radius)
        camera.rotation_mode = "QUATERNION"
        camera.rotation_quaternion = (-camera.location).to_track_quat("-Z", "Y")
    lens = turntable.focal_length or _usual_lens(photographs)
    if _is_new(rig, "lens", [lens]):
        camera.data.sensor_fit, camera.data.sensor_width, camera.data.lens = "HORIZONTAL", SENSOR_WIDTH, lens
    clip = _clip_of(photographs, radius, core_radius)
    if _is_new(rig, "clip", [clip.start, clip.end]):
        camera.data.clip_start, camera.data.clip_end = clip.start, clip.end
    return camera


def turntable_of(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The turntable's camera, if `scene` has one."""
    cameras = (found for found in scene.objects if found.type == "CAMERA")
    return next((camera for camera in cameras if camera.parent is not None and _IS_RIG in camera.parent), None)


def remove_turntable(scene: bpy.types.Scene) -> None:
    """Delete the turntable of `scene`, and the Empties of those whose camera somebody deleted."""
    camera = turntable_of(scene)
    if camera is not None:
        rig, data = camera.parent, camera.data
        bpy.data.objects.remove(camera)
        if not data.users:
            bpy.data.cameras.remove(data)
        bpy.data.objects.remove(rig)
    for rig in [found for found in scene.objects if _IS_RIG in found]:
        if not any(child.type == "CAMERA" for child in rig.children):
            bpy.data.objects.remove(rig)


def render_turntable(scene: bpy.types.Scene, turntable: Turntable, folder: Path, *, wait: bool) -> list[str]:
    """Render the turn into ``0001.png``, ``0002.png``, ... in `folder`.

    The scene's settings are as they were afterwards.

    Args:
        scene: has a turntable.
        turntable: frames, size and engine; the camera is where `add_turntable` put it, or the artist since.
        folder: made when it is missing.
        wait: until all pictures are there; else Blender's own render window shows how far it is.

    Returns:
        The settings that are changed meanwhile, in words.

    Raises:
        InputError: there is no turntable, or the folder cannot be written.
        RuntimeError: Blender could not render.
    """
    camera = turntable_of(scene)
    if camera is None:
        raise InputError("the scene has no turntable", where=scene.name, remedy="add one first")
    _require_writable(folder)
    camera.parent[_FRAMES] = turntable.frames
    display = display_of(scene) if bystanders(scene) else Display.PHOTO  # Gaussians alone need one sample
    # Markers first: whenever one changes, Blender takes the camera that the others bind.
    wanted = {**_unbound(scene), **_turn_settings(camera, turntable, display, folder)}
    told = change_settings(scene, _RENDER, wanted)
    with ExitStack() as afterwards:
        afterwards.callback(_restore, scene)
        match_display(scene)
        follow(scene)
        bpy.ops.render.render("EXEC_DEFAULT" if wait else "INVOKE_DEFAULT", animation=True, scene=scene.name)
        if not wait:
            _restore_when_rendered(scene)
            afterwards.pop_all()  # nothing is restored before
    return told


def is_rendering() -> bool:
    """Whether Blender's render window is at work: nothing of a turntable can be changed meanwhile."""
    return bool(bpy.app.is_job_running("RENDER"))


def rendering_changes(scene: bpy.types.Scene) -> Iterator[str]:
    """Settings that are changed while a turntable renders, in words."""
    return changes(scene, _RENDER)


def restore_interrupted(scene: bpy.types.Scene) -> None:
    """Put the settings back in a scene that was saved while its turntable rendered."""
    if any(rendering_changes(scene)) and not is_rendering():
        _restore(scene)


def picture_settings(
    camera: bpy.types.Object, turntable: Turntable, display: Display = Display.PHOTO
) -> dict[str, Setting]:
    """What a picture that `camera` takes needs, by path from the scene."""
    settings = engine_settings(turntable.engine, display) if turntable.engine is not None else {}
    return {
        **settings,
        **png_settings(),
        "camera": camera.name,
        "render.resolution_x": turntable.width,
        "render.resolution_y": turntable.height_pixels,
        "render.resolution_percentage": 100,
        "render.pixel_aspect_x": 1.0,
        "render.pixel_aspect_y": 1.0,
    }


def _turn_settings(
    camera: bpy.types.Object, turntable: Turntable, display: Display, folder: Path
) -> dict[str, Setting]:
    return {
        **picture_settings(camera, turntable, display),
        "frame_start": 1,
        "frame_end": turntable.frames,
        "frame_step": 1,
        "render.frame_map_old": 100,  # a stretched frame is turned to another angle
        "render.frame_map_new": 100,
        "render.use_sequencer": False,
        "render.use_file_extension": True,
        "render.use_overwrite": True,
        "render.filepath": literal_path(folder / _NUMBER),
    }


def _unbound(scene: bpy.types.Scene) -> dict[str, Setting]:
    """Markers without the cameras that they bind: Blender would change to these instead of the turntable's."""
    bound = (index for index, marker in enumerate(scene.timeline_markers) if marker.camera is not None)
    return {f"timeline_markers[{index}].camera": None for index in bound}


def _restore(scene: bpy.types.Scene) -> None:
    restore_settings(scene, _RENDER)
    match_display(scene)


def _restore_when_rendered(scene: bpy.types.Scene) -> None:
    """Restore the settings as soon as Blender's render job has ended, however it did."""
    uid = scene.session_uid

    def look() -> float | None:
        if is_rendering():
            return _POLL_SECONDS
        found = scene_by_uid(uid)
        if found is not None:
            _restore(found)
        return None

    bpy.app.timers.register(look, first_interval=_POLL_SECONDS)


def _require_writable(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".cvdgs"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"cannot be written to ({error.strerror})", where=folder, remedy="choose another folder"
        ) from error


def _subject(splats: bpy.types.Object) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and radius of the Gaussians' core in the scene."""
    center, radius = core_of(splats)
    matrix = world_of(splats)
    in_scene = np.array(matrix @ mathutils.Vector(center.tolist()), np.float64)
    return in_scene, float(radius) * scale_of(matrix)


def _related(splats: bpy.types.Object) -> list[bpy.types.Object]:
    """Objects of the same capture."""
    return list(splats.parent.children) if splats.parent is not None else []


def _usual_radius(places: NDArray[np.float64]) -> float:
    """Median distance of the photographs' cameras from the axis; 0 where there are none."""
    return float(np.median(np.linalg.norm(places[:, :2], axis=1))) if len(places) else 0.0


def _usual_height(places: NDArray[np.float64], radius: float) -> float:
    """Median height of the photographs' cameras above the centre, as a share of their usual `radius`.

    From higher up or lower down the camera would look past what they show.
    """
    return float(np.median(places[:, 2])) / radius if radius else USUAL_HEIGHT


def _way_around(places: NDArray[np.float64], arc: float) -> tuple[float, float]:
    """Angle of the first picture, and how far the camera swings from it to both sides; 0: all the way around.

    Args:
        places: (P, 3) of the photographs' cameras, relative to the axis.
        arc: to go through; 0: that of the photographs. What nobody photographed would be shown as it was not.
    """
    if len(places) == 0:
        return -math.pi / 2.0, 0.0 if arc in (0.0, _FULL_TURN) else arc / 2.0
    angles = np.arctan2(places[:, 1], places[:, 0])
    ordered = np.sort(angles)
    gaps = np.diff(ordered, append=ordered[0] + _FULL_TURN)
    widest = int(gaps.argmax())
    arc = arc or (_FULL_TURN if gaps[widest] <= _SURROUNDED else max(_FULL_TURN - gaps[widest], _LEAST_ARC))
    if arc >= _FULL_TURN:
        return float(angles[0]), 0.0
    opposite = ordered[widest] + gaps[widest] / 2.0
    return float(opposite - math.pi), float(arc) / 2.0


def _new_turntable(scene: bpy.types.Scene) -> bpy.types.Object:
    """A camera below an Empty, in place of Empties that lost theirs; nothing is placed yet."""
    remove_turntable(scene)
    rig = bpy.data.objects.new(_NAME, None)
    rig[_IS_RIG] = True
    rig.empty_display_type = "CIRCLE"
    camera = bpy.data.objects.new(f"{_NAME} Camera", bpy.data.cameras.new(f"{_NAME} Camera"))
    camera.parent = rig
    for added in (rig, camera):
        scene.collection.objects.link(added)
    return camera


def _is_new(rig: bpy.types.Object, what: str, values: list[float]) -> bool:
    """Whether `values` are others than at the last call, which `rig` remembers."""
    key = _ASKED.format(what=what)
    before = list(rig.get(key, ()))
    rig[key] = values
    return len(before) != len(values) or not np.allclose(before, values)


def _usual_lens(photographs: list[bpy.types.Object]) -> float:
    """Median focal length of the photographs' cameras in millimetres; a usual one where there are none."""
    return float(np.median([photograph.data.lens for photograph in photographs])) if photographs else _LENS


def _clip_of(photographs: list[bpy.types.Object], radius: float, core: float) -> Clip:
    if photographs:
        return Clip(photographs[0].data.clip_start, photographs[0].data.clip_end)
    return Clip(0.01 * radius, 10.0 * (radius + core))


def _drive_by_frame(rig: bpy.types.Object, swing: float) -> None:
    rig.driver_remove("rotation_euler", 2)
    driver = rig.driver_add("rotation_euler", 2).driver
    driver.type = "SCRIPTED"
    for name in (_FRAMES, _START, _SWING):
        variable = driver.variables.new()
        variable.name, variable.type = name, "SINGLE_PROP"
        variable.targets[0].id, variable.targets[0].data_path = rig, f'["{name}"]'
    # Simple enough for Blender to evaluate without running Python.
    turn = f"2 * pi * (frame - 1) / {_FRAMES}"
    driver.expression = f"{_START} + {_SWING} * sin({turn})" if swing else f"{_START} + {turn}"
