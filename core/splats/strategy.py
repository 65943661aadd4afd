"""How the set of Gaussians changes during training: clone, split and prune. numpy only.

A strategy is a value: its constants are its fields, the trainer adds up screen-space gradients and calls
`refine` when `due`. The schedule is in fractions of the run, so that it suits a run of any length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .gaussians import Gaussians


@dataclass(frozen=True)
class Refinement:
    """The new set of Gaussians and where each came from.

    Attributes:
        gaussians: N of them.
        source: (N,) index into the old set, for the optimiser's state.
        fresh: (N,) bool, whether the optimiser starts anew.
    """

    gaussians: Gaussians
    source: NDArray[np.int64]
    fresh: NDArray[np.bool_]


@dataclass(frozen=True)
class CloneSplitPrune:
    """Adaptive density control after Kerbl et al. 2023, sections 5.2, with a budget and without opacity resets.

    A reset costs a run of a few thousand steps more than it gains (notes/splats.md), and the budget, reached step by
    step, keeps the growth where the screen-space gradient is largest.

    Attributes:
        start, stop: the fractions of the run between which Gaussians are added.
        rounds: how often between them.
        gradient_threshold: mean norm of dL/d(centre), in normalised device units and from absolute values a pixel
            (AbsGS, Ye et al. 2024), of a region that is not fitted well.
        small: largest standard deviation, in frame units, of a Gaussian that is cloned rather than split.
        split_shrink: standard deviations of the two halves are divided by this.
        min_opacity: a Gaussian below it is removed.
    """

    start: float = 0.06
    stop: float = 0.6
    rounds: int = 25
    gradient_threshold: float = 4e-4
    small: float = 0.01
    split_shrink: float = 1.6
    min_opacity: float = 0.005

    def due(self, step: int, steps: int) -> bool:
        """Whether to refine after `step` of `steps`."""
        first, last = round(self.start * steps), round(self.stop * steps)
        every = max(math.ceil((last - first) / self.rounds), 1)
        return first <= step <= last and (step - first) % every == 0

    def budget(self, step: int, steps: int, initial: int, limit: int) -> int:
        """How many Gaussians there may be after refining at `step`: from `initial` to `limit`, fast at first."""
        progress = np.clip((step / steps - self.start) / max(self.stop - self.start, 1e-9), 0.0, 1.0)
        return round(initial + (limit - initial) * float(progress**0.5))

    def refine(
        self, gaussians: Gaussians, gradient: NDArray[np.float32], budget: int, rng: np.random.Generator
    ) -> Refinement:
        """Remove what is transparent or broken, then clone or split where `gradient` is largest, within `budget`.

        Args:
            gaussians: N, in frame units.
            gradient: (N,) mean screen-space gradient norm since the last refinement.
        """
        finite = np.isfinite(gaussians.means).all(axis=1) & np.isfinite(gaussians.log_scales).all(axis=1)
        finite &= np.isfinite(gaussians.quaternions).all(axis=1) & np.isfinite(gaussians.sh).all(axis=(1, 2))
        with np.errstate(invalid="ignore"):
            kept = finite & (gaussians.opacities >= self.min_opacity)
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
        new = _take(gaussians, source)
        halves = slice(len(stay_index) + len(clone), None)
        spread = np.exp(new.log_scales[halves]) * rng.standard_normal((2 * len(split), 3)).astype(np.float32)
        new.means[halves] += _rotate(new.quaternions[halves], spread)
        new.log_scales[halves] -= np.float32(np.log(self.split_shrink))
        return Refinement(new, source, fresh)


def _take(gaussians: Gaussians, index: NDArray[np.int64]) -> Gaussians:
    return Gaussians(
        gaussians.means[index],
        gaussians.log_scales[index],
        gaussians.quaternions[index],
        gaussians.opacity_logits[index],
        gaussians.sh[index],
    )


def _rotate(quaternions: NDArray[np.float32], vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 3) vectors turned by (N, 4) wxyz quaternions of any length but zero."""
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    w, axis = unit[:, :1], unit[:, 1:]
    across = 2.0 * np.cross(axis, vectors)
    return vectors + w * across + np.cross(axis, across)
