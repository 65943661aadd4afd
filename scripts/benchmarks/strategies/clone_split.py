"""Densification by the screen-space gradient: clone, split and prune. numpy only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ....core.splats.gaussians import Gaussians
from ....core.splats.strategy.editing import finite, rotate
from ....core.splats.strategy.model import Evidence, Refinement, Schedule


@dataclass(frozen=True)
class CloneSplitPrune:
    """Adaptive density control after Kerbl et al. 2023, section 5.2, with a budget and without opacity resets.

    A reset costs a run of a few thousand steps more than it gains, and the gradually rising budget keeps growth where
    the screen-space gradient is largest.

    Attributes:
        schedule: when to refine.
        gradient_threshold: mean norm of dL/d(centre), in normalised device units and from absolute values per pixel
            (AbsGS, Ye et al. 2024), above which a region is badly fitted.
        small: largest standard deviation, in frame units, of a Gaussian that is cloned rather than split.
        split_shrink: standard deviations of the two halves are divided by this.
        min_opacity: a Gaussian below it is removed.
        gradient_every: steps between those whose gradients are gathered; with absolute values they take a third longer.
        perturb_every: 0.
    """

    schedule: Schedule = field(default_factory=lambda: Schedule(0.06, 0.6, rounds=25))
    gradient_threshold: float = 4e-4
    small: float = 0.01
    split_shrink: float = 1.6
    min_opacity: float = 0.005
    gradient_every: int = 1
    perturb_every: int = 0

    def views_wanted(self, step: int, steps: int, available: int) -> int:
        """None: the gradients of the training steps say where to grow."""
        return 0

    def refine(self, gaussians: Gaussians, evidence: Evidence, budget: int, rng: np.random.Generator) -> Refinement:
        """Remove what is transparent or broken, then clone or split where the gradient is largest, within `budget`."""
        gradient = evidence.gradient
        if gradient is None:
            raise ValueError("cloning and splitting need the gradients")
        with np.errstate(invalid="ignore"):
            kept = finite(gaussians) & (gaussians.opacities >= self.min_opacity)
        candidates = np.flatnonzero(kept & (gradient > self.gradient_threshold))
        room = max(budget - int(kept.sum()), 0)
        if len(candidates) > room:
            order = np.argsort(-gradient[candidates], kind="stable")
            candidates = np.sort(candidates[order[:room]])
        large = np.exp(gaussians.log_scales[candidates].max(axis=1)) > self.small
        split, clone = candidates[large], candidates[~large]
        stay = kept.copy()
        stay[split] = False
        stay_index = np.flatnonzero(stay)
        source = np.concatenate([stay_index, clone, split, split])
        fresh = np.arange(len(source)) >= len(stay_index)
        new = gaussians.take(source)
        halves = slice(len(stay_index) + len(clone), None)
        spread = np.exp(new.log_scales[halves]) * rng.standard_normal((2 * len(split), 3)).astype(np.float32)
        new.means[halves] += rotate(new.quaternions[halves], spread)
        new.log_scales[halves] -= np.float32(np.log(self.split_shrink))
        return Refinement(new, source, fresh)

    def perturb(self, gaussians: Gaussians, steps: int, means_rate: float, rng: np.random.Generator) -> Gaussians:
        """The Gaussians unchanged."""
        return gaussians
