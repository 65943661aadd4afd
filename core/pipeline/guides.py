"""What guides the fit of colours: where views agree, and on what."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from ..consistency import SceneAgreement
from ..runtime.protocol import Reporter
from ..splats.targets import Background
from ..splats.training.losses import ViewGuide


def view_guides(
    agreement: SceneAgreement,
    views: Sequence[View],
    chosen: Sequence[int],
    background: Background,
    enhanced: Sequence[View] | None = None,
    reporter: Reporter | None = None,
) -> list[ViewGuide]:
    """For each chosen view the weights of its pixels, 0 where it is masked, and with `enhanced` views their consensus.

    Args:
        agreement: of the photographs.
        views: all of the capture.
        chosen: indices into them.
        background: behind the Gaussians.
        enhanced: the chosen views with their enhanced pictures.
        reporter: told of the progress with these.
    """
    weights = [_unmasked(agreement.weights[i], views[i]) for i in chosen]
    if enhanced is None:
        return [ViewGuide(weight) for weight in weights]
    pictures = {i: background.behind(view) for i, view in zip(chosen, enhanced, strict=True)}
    consensus = agreement.consensus(pictures, reporter)
    return [ViewGuide(weight, consensus[i]) for i, weight in zip(chosen, weights, strict=True)]


def _unmasked(weights: NDArray[np.uint8], view: View) -> NDArray[np.uint8]:
    return weights if view.mask is None else np.where(view.mask, weights, 0).astype(np.uint8)
