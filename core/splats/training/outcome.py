"""What a training run has to say at its end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.protocol import Reporter
from ..calibration.corrections import ViewCorrections
from ..raster import ContrastPlan
from ..scene_frame import SceneFrame
from .fitting import Fit
from .moving import MovingThings
from .plan import Region
from .validation import HeldOut


def conclude(
    reporter: Reporter,
    steps: int,
    fit: Fit,
    corrections: ViewCorrections,
    moving: MovingThings,
    *,
    aligned: bool,
) -> dict[str, Any]:
    """Report steps that were skipped, of so many, and what was corrected; returns decisions about the views.

    Args:
        aligned: whether held-out views were aligned with the scene.
    """
    if fit.skipped:
        reporter.warning(
            "skipped-steps",
            f"{fit.skipped} of {steps} steps gave numbers that are not finite and were skipped, entirely or for the "
            "Gaussians concerned",
        )
    if corrections.poses_were_off:
        reporter.warning(
            "cameras-corrected",
            f"the camera poses were about {corrections.pose_motion:.1f} pixels off and were corrected along with the "
            "scene; a better calibration may make it sharper",
        )
    if corrections.blur.active:
        reporter.warning(
            "motion-blur-corrected",
            f"motion smeared a quarter of the photographs by {corrections.blur.length:.1f} pixels or more, which was "
            "kept out of the scene; a steadier camera or more light gives a sharper one",
        )
    decision = corrections.in_words() | moving.in_words()
    if aligned:
        decision["poses"] += "; the held-out views were then aligned with the finished scene"
    if fit.noise:
        least = ContrastPlan().beyond(fit.noise).listed
        decision["noise"] = f"allowed for: neighbouring pixels count as distinct from {least:.0f} ΔE on"
    if fit.dropout:
        decision["dropout"] = f"{fit.dropout:.0%} of the Gaussians left out of each step, since photographs are few"
    return decision


def found_in_views(
    corrections: ViewCorrections, moving: MovingThings, keys: Sequence[str], held_out: HeldOut, frame: SceneFrame
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]], dict[str, Region]]:
    """`moved_poses`, `smears` and `moving` of a `TrainingResult`; the fitted views have `keys`."""
    smears = _smears(corrections, keys, held_out)
    return _moved_poses(corrections, keys, held_out, frame), smears, moving.of_targets(keys)


def _moved_poses(
    corrections: ViewCorrections, keys: Sequence[str], held_out: HeldOut, frame: SceneFrame
) -> dict[str, NDArray[np.float64]]:
    """(4, 4) world-to-camera of all views by key; none if poses are as given."""
    moved = corrections.moved_poses
    if moved is None:
        return {}
    poses = {**dict(zip(keys, moved, strict=True)), **held_out.poses}
    return {key: frame.pose_to_world(pose) for key, pose in poses.items()}


def _smears(corrections: ViewCorrections, keys: Sequence[str], held_out: HeldOut) -> dict[str, NDArray[np.float64]]:
    """`View.smear` of all views by key; none if photographs were taken to be sharp."""
    found = corrections.smears
    return {} if found is None else {**dict(zip(keys, found, strict=True)), **held_out.smears}
