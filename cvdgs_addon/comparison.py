"""Original and enhanced colours side by side, both as the observer sees them: what the button "Compare" shows."""

from __future__ import annotations

import bpy

from .scene.display import can_compare, compare_colors

NOTHING_TO_COMPARE = "These Gaussians were made by an earlier release; load the run again"


def follow_comparison(scene: bpy.types.Scene) -> None:
    """Put in force what ``scene.cvdgs.simulate`` says of the comparison."""
    simulate = scene.cvdgs.simulate
    compare_colors(scene, simulate.wipe_position if simulate.compare else None)


def compare(scene: bpy.types.Scene, *, on: bool) -> None:
    """Show the comparison as the observer sees it, in renders and 3D views; or neither any more."""
    simulate = scene.cvdgs.simulate
    simulate.compare = simulate.in_renders = simulate.in_viewport = on


def is_compared(scene: bpy.types.Scene) -> bool:
    """Whether renders or 3D views show the comparison as the observer sees it."""
    simulate = scene.cvdgs.simulate
    return simulate.compare and (simulate.in_renders or simulate.in_viewport)


def has_comparison(scene: bpy.types.Scene) -> bool:
    """Whether there are Gaussians that can be compared."""
    return any(map(can_compare, scene.objects))
