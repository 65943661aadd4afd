"""The add-on's preferences: the worker's environment, the device, and the cache."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from .cache import Cache
from .package import PACKAGE, user_folder
from .quality import likely_speed
from .registration import register_classes, unregister_classes

_MEGABYTE = 1 << 20
_DEVICE = "auto"
_CACHE_LIMIT = 1000  # MB


class CVDGS_Preferences(bpy.types.AddonPreferences):
    """What belongs to the machine and not to a file."""

    bl_idname = PACKAGE

    python: bpy.props.StringProperty(
        name="Python",
        description="An interpreter of your own that has torch and Warp; empty: the one made here, or one found",
        subtype="FILE_PATH",
    )
    base_python: bpy.props.StringProperty(
        name="Made From",
        description="The Python 3.11 or later from which the environment is made; empty: the first that is found",
        subtype="FILE_PATH",
    )
    device: bpy.props.EnumProperty(
        name="Device",
        description="Where the worker computes",
        items=(
            ("auto", "Automatic", "The best that is known to work"),
            ("cpu", "Processor", "Works everywhere"),
            ("cuda", "NVIDIA GPU", "Not measured yet"),
        ),
        default=_DEVICE,
    )
    cache: bpy.props.StringProperty(
        name="Cache",
        description="Folder for thumbnails and compiled kernels; empty: the extension's own folder",
        subtype="DIR_PATH",
    )
    cache_limit: bpy.props.IntProperty(
        name="Cache Size",
        description="Beyond this, what was used longest ago is deleted, in MB",
        min=50,
        soft_max=10_000,
        default=_CACHE_LIMIT,
    )
    machine: bpy.props.StringProperty(
        name="Machine", description="What the last check of the worker found, as JSON", options={"HIDDEN"}
    )
    speed: bpy.props.FloatProperty(
        name="Speed", description="Of this machine relative to the reference one; 0: not measured", options={"HIDDEN"}
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """Called by Blender."""
        from .preferences_panel import draw_preferences

        draw_preferences(self, self.layout)


@dataclass
class _Unsaved:
    """Stands in for the preferences where the package is not an add-on of this Blender."""

    python: str = ""
    base_python: str = ""
    device: str = _DEVICE
    cache: str = ""
    cache_limit: int = _CACHE_LIMIT
    machine: str = ""
    speed: float = 0.0


def get_preferences() -> CVDGS_Preferences | _Unsaved:
    """The preferences; where the package is not enabled as an add-on, their defaults."""
    entry = bpy.context.preferences.addons.get(PACKAGE)
    return entry.preferences if entry is not None and entry.preferences is not None else _Unsaved()


def get_cache() -> Cache:
    """The cache in the folder of the preferences."""
    chosen = get_preferences().cache
    return Cache(Path(bpy.path.abspath(chosen)) if chosen else user_folder() / "cache")


def shrink_cache() -> None:
    """Keep the cache to the size of the preferences."""
    get_cache().shrink(get_preferences().cache_limit * _MEGABYTE)


def machine_speed() -> float:
    """This machine's speed relative to the reference one, as far as it is known."""
    return get_preferences().speed or likely_speed()


def known_machine() -> dict[str, Any]:
    """What the last check found (see `core.machine`), or an empty dictionary."""
    try:
        return dict(json.loads(get_preferences().machine or "{}"))
    except ValueError:
        return {}


CLASSES: tuple[type, ...] = (CVDGS_Preferences,)


def register() -> None:
    """Register the preferences."""
    register_classes(CLASSES)


def unregister() -> None:
    """Undo `register`."""
    unregister_classes(CLASSES)
