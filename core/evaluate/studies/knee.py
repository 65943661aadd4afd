"""How many Gaussians a scene needs: the plateau of its quality, and the knee in front of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..training.runs import Sized, at_quality

TOLERANCE = 0.1
"""dB below the plateau that still count as being on it."""
ALLOWED = 1.3
"""Times the knee's Gaussians that a good decision may take."""


@dataclass(frozen=True)
class Knee:
    """Where more Gaussians no longer pay.

    Attributes:
        plateau: best PSNR of all numbers of Gaussians that were tried, dB.
        gaussians: fewest that come within `TOLERANCE` of it, interpolated between runs in the logarithm of the number;
            an upper bound where even the fewest that were tried do.
    """

    plateau: float
    gaussians: float


def find_knee(runs: Sequence[Sized]) -> Knee:
    """The knee of runs on one capture that differ in their number of Gaussians alone.

    Raises:
        ValueError: there are no runs.
    """
    plateau = max(run.psnr for run in runs)
    return Knee(plateau, at_quality(runs, plateau - TOLERANCE).gaussians)


def quality_at(runs: Sequence[Sized], gaussians: float) -> float:
    """PSNR in dB with so many Gaussians, interpolated as for the knee; beyond the runs, that of the nearest."""
    ordered = sorted(runs, key=lambda run: run.gaussians)
    logarithms = np.log([run.gaussians for run in ordered])
    return float(np.interp(np.log(gaussians), logarithms, [run.psnr for run in ordered]))
