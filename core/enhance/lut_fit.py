"""Fits the scene's LUT: one smooth recolouring so that what normal vision tells apart stays apart under S.

With d the ΔE76 of a pair of colours in the original, d' that of the pair in S(f(·)), the objective is

    E = mean [d >= 2] relu(d - d')² / (d + 5)               contrast that the observer would lose
      + 0.15 mean ‖Lab(f(c)) - Lab(c)‖² / 20                stay close to the original
      + 2000 mean ‖f(grey) - grey‖²                         keep greys
      + 200 mean ‖f(c) - clip(f(c))‖²                       stay in gamut
      + 1000 mean ‖second difference of the residual‖²      stay smooth: no banding, no hue breaks

The contrast term is one-sided on purpose: contrast beyond the original's is never rewarded.

The weight of staying close is what trades contrast for appearance. Where contrast preservation (CCPR) is still that of
a hard scene after the fit, the weight is halved and the fit goes on: appearance is spent where it is needed, and easy
scenes keep theirs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ..color.metrics import CCPR_THRESHOLD
from ..color.simulation import Observer
from ..color.spaces import (
    delta_e_76,
    lab_to_linear,
    linear_to_srgb,
    linear_to_xyz,
    srgb_to_lab,
    srgb_to_linear,
    xyz_to_lab,
)
from ..runtime.protocol import Reporter
from ..runtime.threads import one_thread
from .descent import Adam
from .lut import ColorLut, interpolate
from .pairs import Alphas, Images, PairSampling, sample_neighbours, sample_pairs

_STAGE = "enhance"
_GREYS = 17  # greys held in place

# CIELAB coordinate that a type loses most, the one that is to stand in for it, and in which direction.
_STAND_IN = {
    "protan": (1, 2, 1.0),  # reds towards yellow, greens towards blue: warm colours become warmer
    "deutan": (1, 2, 1.0),
    "tritan": (2, 1, 1.0),  # yellows towards red, blues towards green: the same
    "achromat": (1, 0, -1.0),  # reds darker, greens lighter
}
_NEIGHBOURS = 20_000  # pairs of adjacent pixels from which CCPR is estimated, to about half a percent


@dataclass(frozen=True)
class LutSettings:
    """Constants of the fit; weights belong to the terms of the module's formula.

    Attributes:
        nodes: LUT nodes along an edge.
        steps: Adam steps.
        pairs: colour pairs a step.
        learning_rate: of Adam, in units of sRGB.
        discernible: ΔE76 from which a pair's contrast counts.
        contrast_offset: ΔE76 added to a pair's contrast where the loss is divided by it.
        initial_shift: share of the coordinate that an observer loses which is given to a visible one at the start. Two
            colours that look alike could be told apart in either direction; this decides it alike for all scenes.
        sufficient_ccpr: contrast preservation from which a scene is no longer hard and the fit ends.
        relaxations: how often the naturalness weight is halved at most.
        relaxation_steps: Adam steps after each.
    """

    nodes: int = 9
    steps: int = 250
    pairs: int = 6000
    learning_rate: float = 0.01
    discernible: float = 2.0
    contrast_offset: float = 5.0
    naturalness_weight: float = 0.15 / 20.0
    neutral_weight: float = 2000.0
    gamut_weight: float = 200.0
    smoothness_weight: float = 1000.0
    initial_shift: float = 0.2
    sufficient_ccpr: float = 0.9
    relaxations: int = 2
    relaxation_steps: int = 100
    sampling: PairSampling = field(default_factory=PairSampling)


def fit_lut(
    images: Images,
    cvd: str,
    severity: float,
    model: str = "machado",
    *,
    alphas: Alphas = None,
    settings: LutSettings = LutSettings(),
    seed: int = 0,
    reporter: Reporter | None = None,
) -> ColorLut:
    """Fit the recolouring of a scene for one observer; deterministic for a seed.

    Args:
        images: (H, W, 3) uint8 training views.
        cvd, severity, model: the observer, as for `simulate`.
        alphas: (H, W) coverage per view or None; uncovered pixels are left out.
        settings: constants of the fit.
        seed: draws the pairs.
        reporter: receives the progress of the stage "enhance".

    Raises:
        InputError: an observer that cannot be simulated.

    Example:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> from cvdgs.core import fit_lut
        >>> brown, green = (200, 50, 25), (100, 125, 25)
        >>> image = np.tile(np.array([brown, green], np.uint8), (16, 8, 1))  # stripes, 16 x 16 pixels
        >>> lut = fit_lut([image], "deutan", 1.0)
        >>> lut(image).shape  # recoloured, in [0, 1]
        (16, 16, 3)
        >>> lut.export_cube(Path("deutan.cube"))  # for grading tools
    """
    observer, reporter = Observer(cvd, severity, model), reporter or Reporter()
    generator = np.random.default_rng(seed)
    neighbours = torch.from_numpy(sample_neighbours(images, _NEIGHBOURS, generator, alphas)).float() / 255.0
    residual = initial_residual(observer, settings.nodes, settings.initial_shift).requires_grad_()
    optimizer = Adam([residual])
    rounds = [settings.steps] + [settings.relaxation_steps] * settings.relaxations
    done = 0
    with one_thread():
        for relaxation, steps in enumerate(rounds):
            if relaxation and _ccpr(residual.detach(), neighbours, observer) >= settings.sufficient_ccpr:
                break
            naturalness_weight = settings.naturalness_weight / 2.0**relaxation
            samples = sample_pairs(images, steps * settings.pairs, generator, settings.sampling, alphas)
            for batch in torch.from_numpy(samples).view(steps, settings.pairs, 2, 3):
                loss = _objective(residual, batch.float() / 255.0, observer, settings, naturalness_weight)
                optimizer.descend(loss, settings.learning_rate)
                done += 1
                reporter.progress(_STAGE, done / sum(rounds), f"loss {loss.item():.3f}")
    reporter.progress(_STAGE, 1.0)
    return ColorLut(residual.detach(), _description(observer))


def initial_residual(observer: Observer, nodes: int, shift: float) -> Tensor:
    """(N, N, N, 3) table from which a fit starts: the part `shift` of what is lost, made visible; N is `nodes`."""
    axis = torch.linspace(0.0, 1.0, nodes)
    colors = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).flatten(1)[..., None]
    linear = srgb_to_linear(colors)
    lab = xyz_to_lab(linear_to_xyz(linear))
    lost, visible, sign = _STAND_IN[observer.cvd]
    shifted = lab.clone()
    shifted[visible] += sign * shift * (lab - observer.lab(linear))[lost]
    moved = linear_to_srgb(lab_to_linear(shifted).clamp(0.0, 1.0))
    return (moved - colors)[..., 0].T.reshape(nodes, nodes, nodes, 3).contiguous()


def _description(observer: Observer) -> dict[str, str]:
    return {"cvd": observer.cvd, "severity": repr(float(observer.severity)), "simulation": observer.simulation}


def _objective(
    residual: Tensor, pairs: Tensor, observer: Observer, settings: LutSettings, naturalness_weight: float
) -> Tensor:
    """E of an (N, N, N, 3) table for (P, 2, 3) pairs of colours."""
    mapped = pairs + interpolate(residual, pairs.view(1, -1, 3)).reshape(pairs.shape)
    clipped = mapped.clamp(0.0, 1.0)
    original_lab = srgb_to_lab(_channels_first(pairs))
    linear = srgb_to_linear(_channels_first(clipped))
    contrast, seen = _contrast(original_lab), _contrast(observer.lab(linear))
    lost = torch.relu(contrast - seen) ** 2 / (contrast + settings.contrast_offset)
    # The second pixels have the same distribution as the first, so one half of them is enough here.
    shift = xyz_to_lab(linear_to_xyz(linear[..., :1])) - original_lab[..., :1]
    greys = torch.linspace(0.0, 1.0, _GREYS)[None, :, None].expand(1, -1, 3)
    roughness = torch.stack([torch.diff(residual, n=2, dim=axis).pow(2).mean() for axis in range(3)]).sum()
    return (
        (lost * (contrast >= settings.discernible)).mean()
        + naturalness_weight * (shift**2).sum(-3).mean()
        + settings.neutral_weight * (interpolate(residual, greys) ** 2).mean()
        + settings.gamut_weight * ((mapped - clipped) ** 2).sum(-1).mean()
        + settings.smoothness_weight * roughness
    )


def _ccpr(residual: Tensor, neighbours: Tensor, observer: Observer) -> float:
    """CCPR over (P, 2, 3) neighbouring colours; 1 where no two differ, for then there is nothing to gain."""
    mapped = neighbours + interpolate(residual, neighbours.view(1, -1, 3)).reshape(neighbours.shape)
    distinct = _contrast(srgb_to_lab(_channels_first(neighbours))) >= CCPR_THRESHOLD
    seen = _contrast(observer.lab(srgb_to_linear(_channels_first(mapped.clamp(0.0, 1.0)))))
    return float((seen[distinct] >= CCPR_THRESHOLD).double().mean()) if distinct.any() else 1.0


def _contrast(lab: Tensor) -> Tensor:
    """(..., P, 1) ΔE76 of the pairs of (..., 3, P, 2) CIELAB colours."""
    return delta_e_76(lab[..., :1], lab[..., 1:])


def _channels_first(pairs: Tensor) -> Tensor:
    """(..., P, 2, 3) to (..., 3, P, 2): colour functions want channels at dimension -3."""
    return pairs.movedim(-1, -3)
