"""What the add-on's preferences say: the worker's environment, the device, and the cache."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from .folders import PACKAGE, Cache, user_folder
from .quality import likely_speed

_MEGABYTE = 1 << 20


@dataclass
class Preferences:
    """What belongs to the machine and not to a file: the fields of the add-on's preferences, with their defaults.

    Attributes:
        python: an interpreter for the worker; empty: the one made here, or one found.
        base_python: from which the environment is made; empty: the first that is found.
        device: one of `core.settings.DEVICES`.
        cache: folder of thumbnails and kernels; empty: the extension's own.
        cache_limit: megabytes.
        machine: what the last check of the worker found, as JSON.
        speed: relative to the reference machine; 0: not measured.
        stage_speeds: the same of the stages that runs have timed, as JSON.
    """

    python: str = ""
    base_python: str = ""
    device: str = "auto"
    cache: str = ""
    cache_limit: int = 1000
    machine: str = ""
    speed: float = 0.0
    stage_speeds: str = ""


def get_preferences() -> Preferences:
    """The add-on's preferences, which have these fields; where the package is not enabled as one, the defaults."""
    entry = bpy.context.preferences.addons.get(PACKAGE)
    return entry.preferences if entry is not None and entry.preferences is not None else Preferences()


def remember(**fields: str | float) -> None:
    """Set fields of the add-on's preferences, so that Blender saves them with its own."""
    preferences = get_preferences()
    for name, value in fields.items():
        setattr(preferences, name, value)
    bpy.context.preferences.is_dirty = True  # Blender notes by itself only what is changed in its window


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


def learned_stage_speeds() -> dict[str, float]:
    """This machine's speeds by stage, as runs have shown them."""
    try:
        found = json.loads(get_preferences().stage_speeds or "{}")
        return {str(stage): float(speed) for stage, speed in found.items() if float(speed) > 0.0}
    except (ValueError, TypeError, AttributeError):
        return {}


def known_machine() -> dict[str, Any]:
    """What the last check found (see `core.pipeline.device`), or an empty dictionary."""
    try:
        return dict(json.loads(get_preferences().machine or "{}"))
    except ValueError:
        return {}
