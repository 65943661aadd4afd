"""Asks training views what they think of every Gaussian: how much of it they see, and how wrong it is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .gaussians import SH_C0
from .raster import ParameterSet, Rasterizer
from .strategy.model import ViewEvidence
from .targets import Background, TrainingView

ERROR_PERCENTILE = 70.0
"""Of a view's own pixel errors: a rank, so that neither one pixel nor the scene's noise level rules."""
ERROR_FLOOR = 0.02
"""Mean absolute difference of sRGB values (five of 255) that counts as fitted, whatever the view's percentile is."""


def gather_view_evidence(
    rasterizer: Rasterizer,
    parameters: ParameterSet,
    views: Sequence[TrainingView],
    background: Background,
    reduction: int = 1,
    complete: bool = False,
) -> ViewEvidence:
    """Renders every view twice and goes backward once: blend weights are what the colours' gradient is made of.

    dL/d(colour of k) is the sum over the pixels of w_jk dL/d(pixel j). So with "dL/d(pixel)" 1 in one channel and the
    error in another, one backward pass gives both sums.

    Args:
        reduction: level of the views.
    """
    # Mid-grey, since the gradient of a channel is cut where the colour is clipped at black.
    grey = replace(parameters, sh=wp.zeros(parameters.sh.shape, dtype=wp.float32, device=parameters.device))
    weights = np.empty((len(views), len(parameters)), np.float32)
    errors = np.empty_like(weights)
    thresholds = np.empty(len(views), np.float32)
    for index, view in enumerate(views):
        image, camera = view.at(reduction)
        color = rasterizer.render(parameters, camera, background.color).color.numpy()
        error = np.abs(color - image.numpy() * np.float32(1.0 / 255.0)).mean(axis=2)
        error[~np.isfinite(error)] = 0.0
        thresholds[index] = max(float(np.percentile(error, ERROR_PERCENTILE)), ERROR_FLOOR)
        channels = np.stack([np.ones_like(error), error, np.zeros_like(error)], axis=2)
        frame = rasterizer.render(grey, camera, background.color)
        asked = wp.array(channels, dtype=wp.float32, device=rasterizer.device)
        sums = rasterizer.backward(frame, grad_color=asked, colors_only=True).sh.numpy()[:, 0]
        weights[index], errors[index] = sums[:, 0] / SH_C0, sums[:, 1] / SH_C0
    return ViewEvidence(weights, errors, thresholds, complete)
