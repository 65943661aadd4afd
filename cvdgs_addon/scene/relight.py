"""Shade Gaussians by a lamp, or no longer: normals, the lamp, and the inputs of the node group."""

from __future__ import annotations

import math

import bpy

from ...core.errors import InputError
from .normals import store_normals
from .splat_attributes import Attribute
from .splat_nodes import Input
from .splats import get_input, has_input, set_input

LAMP_NAME = "Relight Lamp"
_SLANT = math.radians(50.0)  # of a new lamp, from straight down


def relight(splats: bpy.types.Object, scene: bpy.types.Scene, lamp: bpy.types.Object | None = None) -> bpy.types.Object:
    """Shade `splats` by a lamp, which is returned: the one given, that of before, or a new sun from the upper left.

    Raises:
        InputError: the Gaussians were made by an earlier release.
    """
    if not has_input(splats, Input.RELIGHT):
        raise InputError("they were made by an earlier release", where=splats.name, remedy="load the run again")
    store_normals(splats)
    lamp = lamp or lamp_of(splats) or _new_lamp(scene)
    set_input(splats, Input.LAMP, lamp)
    set_input(splats, Input.RELIGHT, 1.0)
    return lamp


def is_relit(splats: bpy.types.Object) -> bool:
    """Whether `relight` was called and not `take_light_back`."""
    return has_input(splats, Input.RELIGHT) and Attribute.NORMAL in splats.data.attributes


def take_light_back(splats: bpy.types.Object) -> None:
    """Show the light of the photographs alone; the lamp stays."""
    set_input(splats, Input.RELIGHT, 0.0)
    normals = splats.data.attributes.get(Attribute.NORMAL)
    if normals is not None:
        splats.data.attributes.remove(normals)
    splats.data.update()


def lamp_of(splats: bpy.types.Object) -> bpy.types.Object | None:
    """The lamp that shades `splats`; None where there is none, or somebody deleted it from the scene."""
    lamp = get_input(splats, Input.LAMP)
    return lamp if isinstance(lamp, bpy.types.Object) and lamp.users_scene else None


def _new_lamp(scene: bpy.types.Scene) -> bpy.types.Object:
    lamp = bpy.data.objects.new(LAMP_NAME, bpy.data.lights.new(LAMP_NAME, "SUN"))
    lamp.rotation_euler = (_SLANT, 0.0, -_SLANT)
    scene.collection.objects.link(lamp)
    return lamp
