"""Cleans a trained scene: scores its Gaussians by what the views show of them, and removes what looks like floaters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from ..runs.layout import GAUSSIANS_FILE
from ..splats.floaters import Sightings, floater_scores, kept_after
from ..splats.gaussians import Gaussians
from ..splats.raster import ParameterSet, Rasterizer
from ..splats.renderer import SceneRenderer
from ..splats.scene_frame import SceneFrame
from ..splats.subject import find_subject
from ..splats.targets import Background, prepare_targets
from ..splats.training.evidence import gather_view_evidence

_REDUCTION = 2  # of the views: whether something is shown does not depend on fine detail


@dataclass(frozen=True)
class Cleaned:
    """A scene after the floaters were removed.

    Attributes:
        gaussians: that are left.
        scores: (N,) theirs, see `core.splats.floaters`.
        figures: for the report: ``removed``, ``share``, and on held-out views ``psnr_before`` and ``psnr_after`` in dB
            or None; empty where nothing was asked for.
    """

    gaussians: Gaussians
    scores: NDArray[np.float32]
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def in_words(self) -> dict[str, str]:
        """The report's decision; empty where nothing was asked for."""
        if not self.figures:
            return {}
        words = f"{self.figures['removed']:,} Gaussians ({self.figures['share']:.2%}) removed as floaters"
        if self.figures["psnr_before"] is not None:
            before, after = self.figures["psnr_before"], self.figures["psnr_after"]
            words += f"; held-out views had {before:.2f} dB before and have {after:.2f} dB after"
        return {"clean": words}


def propose_crop(views: Sequence[View], gaussians: Gaussians, figures: Mapping[str, Any]) -> dict[str, Any]:
    """What a crop to the subject would keep, for the report, if there is one; also told in the ``notes`` of `figures`.

    Args:
        views: the training views.
        gaussians: in world units.
    """
    subject = find_subject(views, gaussians)
    if subject is None:
        return {}
    kept = int(subject.holds(gaussians).sum())
    share = kept / len(gaussians)
    figures["notes"]["subject"] = (
        f"the photographs go around one thing; cropped to it, {kept:,} of {len(gaussians):,} Gaussians ({share:.0%}) "
        f'would stay: convert.py {GAUSSIANS_FILE} subject.ply --crop "{subject}"'
    )
    center, radius = [round(value, 6) for value in subject.center.tolist()], round(subject.radius, 6)
    return {"center": center, "radius": radius, "gaussians": kept, "share": round(share, 6)}


def look(rasterizer: Rasterizer, gaussians: Gaussians, views: Sequence[View], background: Background) -> Sightings:
    """What the training `views` show of `gaussians`, in world units."""
    frame = SceneFrame.around(views, gaussians.means)
    parameters = ParameterSet.from_gaussians(frame.from_world(gaussians), rasterizer.device)
    targets = prepare_targets(rasterizer, views, frame, background, {_REDUCTION})
    found = gather_view_evidence(rasterizer, parameters, targets, background, complete=True, reduction=_REDUCTION)
    return Sightings(found.views, found.seen, found.weight, found.nearness)


def clean(
    gaussians: Gaussians, sightings: Sightings, amount: float, scene: SceneRenderer, held_out: Sequence[int]
) -> Cleaned:
    """Remove the Gaussians whose scores are above 1 - `amount`; none if all were.

    Args:
        sightings: of `gaussians` by the training views.
        scene: of the capture's views.
        held_out: indices of the views on which PSNR is compared.
    """
    scores = floater_scores(gaussians, sightings)
    if not amount:
        return Cleaned(gaussians, scores)
    kept = kept_after(scores, amount)
    left = gaussians if kept.all() or not kept.any() else gaussians.take(kept)
    removed = len(gaussians) - len(left)
    before = _psnr(scene, gaussians, held_out)
    figures = {
        "removed": removed,
        "share": removed / len(gaussians),
        "psnr_before": before,
        "psnr_after": _psnr(scene, left, held_out) if removed else before,
    }
    return Cleaned(left, scores[kept] if removed else scores, figures)


def _psnr(scene: SceneRenderer, gaussians: Gaussians, views: Sequence[int]) -> float | None:
    if not views:
        return None
    return float(np.mean([scene.fidelity(index, scene.color(gaussians, index))["psnr"] for index in views]))
