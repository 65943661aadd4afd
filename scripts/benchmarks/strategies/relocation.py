"""Densification by relocation: dead Gaussians are moved to living ones. numpy only.

After Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo": the set is a sample of the scene, so
faint Gaussians explore under noise, and one that carries nothing is relocated to one that does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ....core.splats.gaussians import Gaussians
from ....core.splats.strategy.editing import concatenate, covariance_product, finite, rotate
from ....core.splats.strategy.model import Evidence, Floats, Refinement, Schedule

_MOST_COPIES = 32  # at one place; beyond, the alternating sum of the correction loses its precision
_OPACITY_LIMITS = (5e-3, 1.0 - 1e-4)  # of a corrected Gaussian, so that the gradient of its logit does not vanish


@dataclass(frozen=True)
class Relocation:
    """Relocation of dead Gaussians, with noise on the positions and decay of opacities and scales.

    Attributes:
        schedule: when Gaussians are relocated and added.
        growth: Gaussians added in a round, as a share of their number.
        dead_opacity: below it a Gaussian is dead.
        noise: of the means per step, in units of the learning rate times the covariance. The paper's 5e5, for learning
            rates a quarter of ours.
        noise_sharpness: of the paper's sigmoid that ends the noise from the opacity `dead_opacity` on.
        spread: of a copy around its original, in the original's standard deviations: copies at the same place get the
            same gradients and would take long to separate.
        sample: training views rendered in a round.
        error_share: of the probability of being drawn that follows the views' blame; the rest follows the opacity, as
            in the paper.
        census_every: rounds between those that render all views.
        needed_pixels: a Gaussian that in a census covers fewer pixels in every view counts as dead.
        perturb_every: steps between perturbations, each as strong as those of so many steps together.
        opacity_decay, scale_decay: factors by which an opacity and a standard deviation would fall over a whole run if
            no photograph held them. They replace the paper's penalties, whose weight against the loss would depend on
            the number of Gaussians.
        shortest: a run of fewer steps decays like one of this many.
        gradient_every: 0: gradients are not needed.
    """

    schedule: Schedule = field(default_factory=lambda: Schedule(0.04, 0.75, rounds=30, shortest=50))
    growth: float = 0.08
    dead_opacity: float = 0.005
    noise: float = 1.25e5
    noise_sharpness: float = 100.0
    spread: float = 0.7
    sample: int = 10
    error_share: float = 0.8
    census_every: int = 4
    needed_pixels: float = 2.0
    perturb_every: int = 10
    opacity_decay: float = 1e-3
    scale_decay: float = 0.3
    shortest: int = 1000
    gradient_every: int = 0

    def views_wanted(self, step: int, steps: int, available: int) -> int:
        """A sample, whose errors show where Gaussians are needed, or in a census all, to find those that are not."""
        if self.schedule.round_of(step, steps) % self.census_every == self.census_every - 1:
            return available
        return min(self.sample, available)

    def refine(self, gaussians: Gaussians, evidence: Evidence, budget: int, rng: np.random.Generator) -> Refinement:
        """Relocate the dead to living Gaussians drawn at random, and add copies of these, within `budget`."""
        opacity = gaussians.opacities
        with np.errstate(invalid="ignore"):
            living = finite(gaussians) & (opacity > self.dead_opacity)
        if evidence.views is not None and evidence.views.complete:
            needed = living & (evidence.views.weight >= self.needed_pixels) & ~evidence.views.floaters
            living = needed if needed.any() else living
        alive = np.flatnonzero(living)
        if len(alive) == 0:
            kept = np.flatnonzero(finite(gaussians))
            return Refinement(gaussians.take(kept), kept, np.zeros(len(kept), bool))
        dead = len(gaussians) - len(alive)
        room = max(budget - len(gaussians), 0)
        copies = dead + min(round(self.growth * len(gaussians)), room)
        chance = self._chances(opacity[alive], alive, evidence)
        chosen = rng.choice(alive, copies, p=chance / chance.sum())
        times = 1 + np.bincount(chosen, minlength=len(gaussians))
        corrected = _shared_among(gaussians.take(alive), times[alive])
        place = np.empty(len(gaussians), np.int64)
        place[alive] = np.arange(len(alive))
        source = np.concatenate([alive, chosen])
        fresh = np.concatenate([times[alive] > 1, np.ones(copies, bool)])
        copied = corrected.take(place[chosen])
        offset = self.spread * np.exp(copied.log_scales) * rng.standard_normal((copies, 3))
        copied.means[:] += rotate(copied.quaternions, offset)
        return Refinement(concatenate(corrected, copied), source, fresh)

    def _chances(self, opacity: Floats, alive: NDArray[np.int64], evidence: Evidence) -> NDArray[np.float64]:
        """(L,) probabilities of drawing the `alive`: by opacity as in the paper, and by blame where it is known."""
        chance = opacity.astype(np.float64) / opacity.sum()
        blame = evidence.views.blame[alive].astype(np.float64) if evidence.views is not None else np.zeros(1)
        if blame.any():
            chance = (1.0 - self.error_share) * chance + self.error_share * blame / blame.sum()
        return chance

    def perturb(self, gaussians: Gaussians, steps: int, means_rate: float, rng: np.random.Generator) -> Gaussians:
        """Add the noise and decay of `perturb_every` steps."""
        share = self.perturb_every / max(steps, self.shortest)
        opacity = gaussians.opacities.astype(np.float64)
        wandering = 1.0 / (1.0 + np.exp(np.clip(self.noise_sharpness * (opacity - self.dead_opacity), -50.0, 50.0)))
        # The length of a random walk grows with the square root of its steps.
        length = self.noise * means_rate * np.sqrt(self.perturb_every) * wandering
        noise = length[:, None] * covariance_product(gaussians, rng.standard_normal((len(gaussians), 3)))
        # No step is longer than the Gaussian, or large ones would be thrown out of the scene.
        size = np.exp(gaussians.log_scales.max(axis=1).astype(np.float64))
        noise *= np.minimum(1.0, size / np.maximum(np.linalg.norm(noise, axis=1), 1e-30))[:, None]
        return replace(
            gaussians,
            means=(gaussians.means + np.nan_to_num(noise)).astype(np.float32),
            log_scales=gaussians.log_scales + np.float32(share * np.log(self.scale_decay)),
            opacity_logits=_logit(opacity * self.opacity_decay**share),
        )


def _shared_among(gaussians: Gaussians, copies: NDArray[np.int64]) -> Gaussians:
    """Each Gaussian corrected so that (N,) `copies` of it together look as it did (the paper's Eq. 9).

    The opacity follows from (1 - o')^n = 1 - o, the covariance from the integral of the blended copies along a line.
    """
    copies = np.minimum(copies, _MOST_COPIES)
    old = gaussians.opacities.astype(np.float64)
    new = 1.0 - (1.0 - old) ** (1.0 / copies)
    integral = np.zeros_like(old)
    for count in np.unique(copies):
        rows = copies == count
        # The paper's double sum over binomials, summed over its first index.
        for m in range(1, count + 1):
            integral[rows] -= math.comb(count, m) * (-new[rows]) ** m / math.sqrt(m)
    shrink = np.where(copies > 1, old / np.maximum(integral, 1e-12), 1.0)
    logits = np.where(copies > 1, _logit(np.clip(new, *_OPACITY_LIMITS)), gaussians.opacity_logits)
    return replace(
        gaussians,
        log_scales=(gaussians.log_scales + np.log(shrink)[:, None]).astype(np.float32),
        opacity_logits=logits.astype(np.float32),
    )


def _logit(opacity: NDArray[np.float64]) -> Floats:
    opacity = np.clip(opacity, 1e-7, 1.0 - 1e-7)
    return np.log(opacity / (1.0 - opacity)).astype(np.float32)
