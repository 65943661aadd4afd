"""Asks training views what they think of every Gaussian: how much of it they show, and how wrong they are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from .gaussians import SH_C0
from .raster import ParameterSet, Rasterizer
from .strategy import ViewEvidence, ViewEvidenceSum
from .targets import Background, TrainingView

ERROR_PERCENTILE = 70.0
"""Of a view's own pixel errors: a rank, so that neither one pixel nor the scene's noise level rules."""
ERROR_FLOOR = 0.02
"""Mean absolute difference of sRGB values (five of 255) that counts as fitted, whatever the percentile is."""

_DARKEST = np.float32((1.0 / 512.0 - 0.5) / SH_C0)  # degree-0 coefficient of a colour just above black


def gather_view_evidence(
    rasterizer: Rasterizer,
    parameters: ParameterSet,
    views: Sequence[TrainingView],
    background: Background,
    *,
    complete: bool,
    reduction: int = 1,
) -> ViewEvidence:
    """Renders every view and goes backward once: blend weights are what the colours' gradient is made of.

    dL/d(colour of k) is the sum over the pixels of w_jk dL/d(pixel j). So with "dL/d(pixel)" 1 in one channel and the
    error in another, one backward pass gives both sums.

    Args:
        complete: whether `views` are all training views.
        reduction: level of the views that is compared. Sums are in pixels of the full images.
    """
    shown, weighed = _without_black(parameters)
    means = parameters.means.numpy()
    total = ViewEvidenceSum(len(parameters))
    for view in views:
        image, camera = view.at(reduction)
        frame = rasterizer.render(shown, camera, background.color)
        color = frame.color.numpy()
        error = np.nan_to_num(np.abs(color - image.numpy() * np.float32(1.0 / 255.0)).mean(axis=2))
        threshold = max(float(np.percentile(error, ERROR_PERCENTILE)), ERROR_FLOOR)
        asked = wp.array(
            np.stack([np.ones_like(error), error, np.zeros_like(error)], axis=2),
            dtype=wp.float32,
            device=rasterizer.device,
        )
        if weighed is not shown:
            frame = rasterizer.render(weighed, camera, background.color)
        sums = rasterizer.backward(frame, grad_color=asked, colors_only=True).sh.numpy()[:, 0]
        full_image, _ = view.at(1)
        pixels = np.float32(full_image.size / image.size / SH_C0)
        distance = np.linalg.norm(means - camera.center.astype(np.float32), axis=1)
        total.add(sums[:, 0] * pixels, sums[:, 1] * pixels, threshold, distance)
    return total.evidence(complete)


def _without_black(parameters: ParameterSet) -> tuple[ParameterSet, ParameterSet]:
    """What to compare with the photographs, and what to weigh; the same where that is possible.

    The gradient of a channel is cut where the colour is clipped at black, and then no weight is known. Degree 0 is
    lifted from black by less than a byte's step; a colour that changes with the view is weighed in grey.
    """
    sh = parameters.sh.numpy()
    if parameters.sh_count > 1:
        grey = wp.zeros(parameters.sh.shape, dtype=wp.float32, device=parameters.device)
        return parameters, replace(parameters, sh=grey)
    lifted = wp.array(np.maximum(sh, _DARKEST), dtype=wp.float32, device=parameters.device)
    shown = replace(parameters, sh=lifted)
    return shown, shown
