"""Leaves some Gaussians out of every step of a run that fits a few photographs very often.

Such a run overfits: Gaussians that are always drawn together may hide each other's errors, so that their sum is right
from the photographs' cameras and wrong from elsewhere. Where any of them may be missing, each has to be right by itself
(Park, Ryu and Kim 2025, DropGaussian).
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit, logit

from ..raster import ParameterSet

_SHARE = 0.1
_FEW_VIEWS = 10  # 17 gained nothing by it, and 35 lost 0.6 dB
_OFTEN = 200  # steps for each of them; 60 are too few to overfit, and lost 0.3 dB by it
_NEVER_DRAWN = -30.0  # logit of the opacity
_LEAST_OPAQUE, _MOST_OPAQUE = 1e-6, 0.995  # so that logits stay finite


def dropout_share(steps: int, views: int) -> float:
    """The share of the Gaussians to leave out of each of so many steps on so many views; 0 in most runs."""
    return _SHARE if views <= _FEW_VIEWS and steps >= _OFTEN * views else 0.0


def with_dropout(parameters: ParameterSet, share: float, seed: int) -> ParameterSet:
    """The Gaussians, a random share of them invisible and the others more opaque, so that the mean stays as it is.

    All arrays but that of the opacities are shared with `parameters`.

    Args:
        share: from 0 to below 1.
        seed: gives the same ones again.
    """
    if not share:
        return parameters
    logits = parameters.opacity_logits.numpy()
    opacities = np.clip(expit(logits) / (1.0 - share), _LEAST_OPAQUE, _MOST_OPAQUE)
    drawn = np.random.default_rng(seed).random(len(logits)) >= share
    return parameters.with_opacity_logits(np.where(drawn, logit(opacities), _NEVER_DRAWN))
