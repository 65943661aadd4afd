"""Whose eyes the scene is made for: presets, and the course of the arrangement test."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..core.color.arrangement import CAP_COUNT, Suggestion, cap_colors, score_arrangement, suggest
from ..core.errors import InputError
from .pictures import PICTURES


@dataclass(frozen=True)
class Preset:
    """A common colour vision deficiency.

    Attributes:
        name: of the preset in scripts.
        label, description: as the user reads them.
        cvd, severity: its settings. Anomalous trichromats differ; 0.6 stands for the middle.
    """

    name: str
    label: str
    description: str
    cvd: str
    severity: float


PRESETS = (
    Preset("DEUTERANOMALY", "Deuteranomaly", "Weak green: 5 % of men", "deutan", 0.6),
    Preset("DEUTERANOPIA", "Deuteranopia", "No M cones: 1 % of men", "deutan", 1.0),
    Preset("PROTANOMALY", "Protanomaly", "Weak red: 1 % of men", "protan", 0.6),
    Preset("PROTANOPIA", "Protanopia", "No L cones: 1 % of men", "protan", 1.0),
    Preset("TRITANOPIA", "Tritanopia", "No S cones: rare", "tritan", 1.0),
    Preset("ACHROMATOPSIA", "Achromatopsia", "No working cones: very rare", "achromat", 1.0),
)


def apply_preset(scene: bpy.types.Scene, name: str) -> None:
    """Set type and severity of the preset `name`."""
    preset = next(preset for preset in PRESETS if preset.name == name)
    scene.cvdgs.viewer.cvd, scene.cvdgs.viewer.severity = preset.cvd, preset.severity


def start_test(scene: bpy.types.Scene, seed: int = 0) -> None:
    """Offer the caps in a random order and show the test.

    Args:
        seed: of the order; 0 for another every time.
    """
    viewer = scene.cvdgs.viewer
    viewer.test_pool = (np.random.default_rng(seed or None).permutation(CAP_COUNT) + 1).tolist()
    viewer.test_arranged = [0] * CAP_COUNT
    viewer.test_is_open = True


def arranged_caps(scene: bpy.types.Scene) -> list[int]:
    """The caps in the row, in order, without the reference cap."""
    return [cap for cap in scene.cvdgs.viewer.test_arranged if cap]


def free_caps(scene: bpy.types.Scene) -> list[int]:
    """The caps that are still offered, in the order in which they were."""
    arranged = arranged_caps(scene)
    return [cap for cap in scene.cvdgs.viewer.test_pool if cap not in arranged]


def place_cap(scene: bpy.types.Scene, cap: int) -> None:
    """Put a free cap at the end of the row.

    Raises:
        InputError: it is in the row already.
    """
    arranged = arranged_caps(scene)
    if cap in arranged:
        raise InputError(f"cap {cap} is already in the row", remedy="take it out first")
    _set_row(scene, [*arranged, cap])


def take_back_cap(scene: bpy.types.Scene, cap: int) -> None:
    """Take a cap out of the row; those behind it move up."""
    _set_row(scene, [other for other in arranged_caps(scene) if other != cap])


def current_suggestion(scene: bpy.types.Scene) -> Suggestion | None:
    """What the row suggests, or None as long as caps are free."""
    arranged = arranged_caps(scene)
    return suggest(score_arrangement(arranged)) if len(arranged) == CAP_COUNT else None


def use_suggestion(scene: bpy.types.Scene) -> None:
    """Take over what the row suggests, and close the test.

    Raises:
        InputError: it suggests nothing.
    """
    suggestion = current_suggestion(scene)
    if suggestion is None or suggestion.cvd is None:
        raise InputError("this order suggests no type", remedy="place every cap in the row")
    viewer = scene.cvdgs.viewer
    viewer.cvd, viewer.severity, viewer.test_is_open = suggestion.cvd, suggestion.severity, False


def cap_key(cap: int) -> str:
    """Under which `PICTURES` has a cap, 0 being the reference; paints it when it is new."""
    key = f"cap {cap}"
    if key not in PICTURES:
        PICTURES.paint(key, cap_colors()[cap])
    return key


def _set_row(scene: bpy.types.Scene, caps: list[int]) -> None:
    scene.cvdgs.viewer.test_arranged = caps + [0] * (CAP_COUNT - len(caps))
