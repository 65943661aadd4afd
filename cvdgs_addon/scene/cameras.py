"""Pinhole cameras to Blender's and back, exact to float32.

A camera of a capture has its own image size and possibly fx != fy. Blender keeps both with the scene (resolution, pixel
aspect), so the camera object carries them as custom properties and `camera_settings` puts them in force.

Blender's camera looks along -Z with Y up, which is OpenGL's convention. With sensor fit HORIZONTAL and pixel aspect
a = aspect_x / aspect_y (from Blender's view plane computation)::

    fx = lens / sensor_width * width         cx = width / 2 - shift_x * width
    fy = fx * a                              cy = height / 2 + shift_y * width * a
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...core.capture.model import PinholeCamera
from ...core.errors import InputError
from .remembered_settings import Setting, set_settings

SENSOR_WIDTH = 36.0  # mm, of the full-frame format that artists' lens numbers refer to

_KEY = "cvdgs_view"  # custom property of the camera data: the view's key, which Blender's names number and cut
_WIDTH, _HEIGHT = "cvdgs_width", "cvdgs_height"  # the same, in pixels
_ASPECT_X, _ASPECT_Y = "cvdgs_pixel_aspect_x", "cvdgs_pixel_aspect_y"

_COPY_NUMBER = re.compile(r"\.\d{3,}$")  # that Blender adds to a name which is taken
_ASPECT_LIMIT = 200.0  # Blender's largest pixel aspect


@dataclass(frozen=True)
class Clip:
    """Nearest and farthest visible distance in scene units."""

    start: float
    end: float


def add_camera(
    name: str, camera: PinholeCamera, camera_to_world: NDArray[np.float64], clip: Clip, collection: bpy.types.Collection
) -> bpy.types.Object:
    """Add a camera object.

    Args:
        name: of the object and its data, and the key of the view.
        camera: intrinsics in pixels.
        camera_to_world: (4, 4) rigid, OpenGL axes, in the space of the object's parent.
        clip: visible range.
        collection: where the object is linked.

    Raises:
        InputError: Blender cannot express the pixel aspect.
    """
    aspect_x, aspect_y = max(camera.fy / camera.fx, 1.0), max(camera.fx / camera.fy, 1.0)
    if max(aspect_x, aspect_y) > _ASPECT_LIMIT:
        raise InputError(
            f"focal lengths {camera.fx:g} and {camera.fy:g} differ too much", where=name, remedy="check the cameras"
        )
    data = bpy.data.cameras.new(name)
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = SENSOR_WIDTH
    data.lens = camera.fx * SENSOR_WIDTH / camera.width
    data.shift_x = (camera.width / 2.0 - camera.cx) / camera.width
    data.shift_y = (camera.cy - camera.height / 2.0) / (camera.width * aspect_x / aspect_y)
    data.clip_start, data.clip_end = clip.start, clip.end
    data[_KEY] = name
    data[_WIDTH], data[_HEIGHT] = camera.width, camera.height
    data[_ASPECT_X], data[_ASPECT_Y] = aspect_x, aspect_y
    camera_object = bpy.data.objects.new(name, data)
    camera_object.rotation_mode = "QUATERNION"
    camera_object.matrix_basis = mathutils.Matrix(np.asarray(camera_to_world, np.float64).tolist())
    collection.objects.link(camera_object)
    return camera_object


def camera_intrinsics(camera_object: bpy.types.Object) -> PinholeCamera:
    """The intrinsics of a camera made by `add_camera`, from its current lens, sensor and shift."""
    data = camera_object.data
    width, height = data[_WIDTH], data[_HEIGHT]
    aspect = data[_ASPECT_X] / data[_ASPECT_Y]
    fx = data.lens / data.sensor_width * width
    return PinholeCamera(
        width, height, fx, fx * aspect, width / 2.0 - data.shift_x * width, height / 2.0 + data.shift_y * width * aspect
    )


def camera_to_world(camera_object: bpy.types.Object) -> NDArray[np.float64]:
    """(4, 4) OpenGL camera-to-world matrix in the space of the object's parent: the capture's world."""
    return np.array(camera_object.matrix_basis, np.float64)


def is_capture_camera(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` was made by `add_camera`."""
    return candidate.type == "CAMERA" and _WIDTH in candidate.data


def view_key(camera_object: bpy.types.Object) -> str:
    """The key of the view that a camera of `add_camera` shows."""
    # In files that earlier versions saved, the name is all there is.
    return str(camera_object.data.get(_KEY) or _COPY_NUMBER.sub("", camera_object.name))


def camera_settings(camera_object: bpy.types.Object) -> dict[str, Setting]:
    """What a scene needs to look through a capture's camera, by path: Blender keeps size and aspect with the scene."""
    data = camera_object.data
    return {
        "camera": camera_object.name,
        "render.resolution_x": data[_WIDTH],
        "render.resolution_y": data[_HEIGHT],
        "render.resolution_percentage": 100,
        "render.pixel_aspect_x": data[_ASPECT_X],
        "render.pixel_aspect_y": data[_ASPECT_Y],
    }


def use_camera(scene: bpy.types.Scene, camera_object: bpy.types.Object) -> None:
    """Make a capture's camera the active one of `scene`, with its image size and pixel aspect, for good."""
    set_settings(scene, camera_settings(camera_object))
    scene.camera = camera_object  # of those of that name, should a library have one too
