"""A light like that of the photographs, for objects that stand among Gaussians, estimated from their colours.

A matt surface of normal n is as bright as a + b . n under a soft light from b (the first two bands of irradiance,
Ramamoorthi and Hanrahan 2001). What the surfaces are made of averages out over thousands of Gaussians. It is a guess:
one direction for the whole scene, no place, and a room whose light walls all face one way leads it astray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...core.color import srgb
from ...core.errors import InputError
from ...core.runs.layout import ORIGINAL
from .shapes import rotation_matrices, towards_cameras
from .splat_attributes import Attribute, color_attribute, is_gaussian, read_attribute, require_object_mode
from .world_matrix import world_of

LIGHT_NAME = "Light of the Photographs"

_LEAST_OPACITY = 0.3
_MOST_FLAT = 0.7  # thickness over the second axis; a rounder Gaussian has no normal to speak of
_FEWEST = 20
_WHITE = 90.0  # percentile of brightness that is taken for white
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB
_SOFTNESS = math.radians(30.0)  # angle that the light comes from: rooms have soft ones


@dataclass(frozen=True)
class EstimatedLight:
    """What shines on the scene.

    Attributes:
        direction: (3,) unit vector towards the light, in the scene.
        color: (3,) linear, the largest 1.
        direct, ambient: radiance of white that faces the light beyond, and of white wherever it faces.
    """

    direction: NDArray[np.float64]
    color: NDArray[np.float64]
    direct: float
    ambient: float


def estimate_light(splats: bpy.types.Object) -> EstimatedLight:
    """The light in which `splats` were photographed.

    Raises:
        InputError: too few flat Gaussians to tell, or they are being edited.
    """
    require_object_mode(splats)
    mesh, mask = splats.data, is_gaussian(splats.data)
    scales, opacity, rotation = (
        read_attribute(mesh, name)[mask].astype(np.float64)
        for name in (Attribute.SCALE, Attribute.OPACITY, Attribute.ROTATION)
    )
    colors = srgb.decode(np.clip(read_attribute(mesh, color_attribute(ORIGINAL))[mask, :3], 0.0, 1.0))
    axes = np.sort(scales, axis=1)
    usable = (opacity > _LEAST_OPACITY) & (axes[:, 0] < _MOST_FLAT * axes[:, 1])
    if usable.sum() < _FEWEST:
        raise InputError(
            "too few flat Gaussians to tell the light from", where=splats.name, remedy="place lamps by hand"
        )
    normals = rotation_matrices(rotation)[np.arange(len(rotation)), :, scales.argmin(axis=1)][usable]
    outwards = (normals * towards_cameras(splats)[usable]).sum(axis=1)
    normals *= np.where(outwards < 0.0, -1.0, 1.0)[:, None]
    weights = opacity[usable] * axes[usable, 1] * axes[usable, 2]
    weights = np.minimum(weights, np.percentile(weights, 95.0))  # a wall behind everything is no more than others
    brightness = colors[usable] @ _LUMINANCE
    root = np.sqrt(weights)
    design = np.column_stack([np.ones(len(normals)), normals])
    ambient, *b = np.linalg.lstsq(design * root[:, None], brightness * root, rcond=None)[0]
    direct = float(np.linalg.norm(b))
    turned = np.array(world_of(splats).to_3x3().normalized()) @ np.array(b)
    is_white = brightness >= np.percentile(brightness, _WHITE)
    white = np.median(colors[usable][is_white], axis=0)
    # The fit has the scene's mean reflectance in it; white has about one.
    gain = float(white @ _LUMINANCE) / max(ambient + direct, 1e-6)
    direction = turned / np.linalg.norm(turned) if direct > 1e-9 else np.array([0.0, 0.0, 1.0])
    return EstimatedLight(direction, white / max(white.max(), 1e-6), direct * gain, max(float(ambient), 0.0) * gain)


def add_estimated_light(splats: bpy.types.Object, scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Add two lamps that shine like the light of the photographs, in place of earlier ones: one from its direction, and
    one from all sides of the sky. Returns them.

    Raises:
        InputError: see `estimate_light`.
    """
    light = estimate_light(splats)
    earlier = (found for found in scene.objects if found.type == "LIGHT" and found.name.startswith(LIGHT_NAME))
    for data in {lamp.data for lamp in earlier}:  # linked duplicates share theirs
        bpy.data.lights.remove(data)
    lamps = []
    # White that faces a sun of strength pi has a radiance of one.
    for name, direction, radiance, angle in (
        (LIGHT_NAME, light.direction, light.direct, _SOFTNESS),
        (f"{LIGHT_NAME}, Fill", np.array([0.0, 0.0, 1.0]), light.ambient, math.pi),
    ):
        data = bpy.data.lights.new(name, "SUN")
        data.energy, data.color, data.angle = math.pi * radiance, light.color.tolist(), angle
        lamp = bpy.data.objects.new(name, data)
        lamp.rotation_euler = mathutils.Vector(direction.tolist()).to_track_quat("Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
        lamps.append(lamp)
    return lamps
