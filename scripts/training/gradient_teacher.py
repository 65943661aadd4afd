"""A spatial teacher: gradients that the observer loses are added along a direction that the observer sees.

Gradient-domain daltonisation in the manner of Simon-Liedtke and Farup (Journal of Visual Communication and Image
Representation 35, 2016) and Farup, "Individualised Halo-Free Gradient-Domain Colour Image Daltonisation" (Journal of
Imaging 6(11), 2020), carried out in CIELAB, where lengths are the contrasts that CCPR counts. With

    l = e · (Lab(I) - Lab(S(I)))      what S takes away, along its principal direction e in the scene,
    v                                 a direction orthogonal to e,
    v'                                how a small change along v looks through S,
    c, s                              a difference of neighbours in Lab(I) and in Lab(S(I)),

the wanted difference g has the sign of the lost one and lengthens s to the length of c, |s + g v'| = |c|. The result is
Lab(I) + D v with the D that minimises

    ∫ |∇D - g|² + (D - gain l)² / reach²

(screened Poisson with Neumann boundary, solved exactly by a cosine transform). The second term replaces the first
estimate and the anisotropic diffusion of the papers: what lies further off than `reach` is held to a function of the
colour alone, so halos stay small and greys, of which S takes nothing, keep their place.

Direction and gain are chosen once for a scene, the ones with the smallest sum of lost contrast and change among all
that the settings offer, so all its views agree on which way reds and greens move apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from torch import Tensor

from ...core.color.spaces import (
    delta_e_76,
    image_to_tensor,
    lab_to_linear,
    linear_to_srgb,
    linear_to_xyz,
    srgb_to_linear,
    tensor_to_image,
    xyz_to_lab,
)
from ...core.enhance import SceneEnhancer
from ...core.enhance.lut import as_float
from ...core.enhance.pairs import Alphas, Images, PairSampling, sample_pairs
from ...core.files.images import to_bytes
from ...core.runtime.protocol import Reporter

_PROBE = 5.0  # ΔE76 of the step by which v' is measured; small beside the contrasts that matter, large beside rounding
_GAMUT_BISECTIONS = 6  # to 1/64 of the change
_GAMUT_TOLERANCE = 1e-4  # linear light; a third of the smallest step of 8 bits
_LEAST_LOSS = 1e-3  # ΔE76 along e below which there is nothing to restore


@dataclass(frozen=True)
class GradientSettings:
    """Constants of the teacher.

    Attributes:
        directions: candidates for v, evenly spread over the full circle orthogonal to e.
        gains: candidates for the change along v per ΔE76 that is lost; 0 is always among them.
        pairs: pairs of colours on which the candidates are judged.
        discernible: ΔE76 from which a pair's contrast counts.
        contrast_offset: ΔE76 added to a pair's contrast where its loss is divided by it.
        naturalness_weight: of the squared ΔE76 of the change, as in the LUT teacher's objective.
        largest_amplification: bound of a wanted difference, per lost one and gain.
        reach: distance, as a share of the shorter side, beyond which the change follows the colour alone.
        neutral_chroma: chroma from which a colour moves in full; less near grey, nothing at it.
    """

    directions: int = 12
    gains: tuple[float, ...] = (0.15, 0.3, 0.45, 0.6, 0.8, 1.0)
    pairs: int = 6000
    discernible: float = 2.0
    contrast_offset: float = 5.0
    naturalness_weight: float = 0.15 / 20.0
    largest_amplification: float = 2.0
    reach: float = 0.03
    neutral_chroma: float = 6.0
    sampling: PairSampling = field(default_factory=PairSampling)


@dataclass(frozen=True)
class SceneDirections:
    """What all views of a scene share; CIELAB vectors of shape (3,).

    Attributes:
        lost: e, the unit vector along which S takes most away.
        visible: v, the unit vector along which it is given back.
        seen: v', the change of Lab(S(I)) per unit along `visible`.
        gain: change along `visible` per lost ΔE76; 0 where nothing is worth a change.
    """

    lost: Tensor
    visible: Tensor
    seen: Tensor
    gain: float


class GradientTeacher(SceneEnhancer):
    """Recolours images by their gradients, along directions that a scene's views share.

    Args:
        settings: constants; None for the defaults.

    An image that is given before `fit` is a scene of its own. Memory: some 180 bytes a pixel, for the change of a
    pixel depends on all others.
    """

    name = "gradient"

    def __init__(
        self,
        cvd: str,
        severity: float,
        simulation: str = "machado",
        strength: float = 1.0,
        seed: int = 0,
        settings: GradientSettings | None = None,
    ) -> None:
        super().__init__(cvd, severity, simulation, strength, seed)
        self._settings = settings or GradientSettings()
        self.directions: SceneDirections | None = None
        """What `fit` chose; None before it and where the teacher is the identity."""

    def _fit(self, images: Images, reporter: Reporter, alphas: Alphas) -> None:
        self.directions = self._choose(images, alphas)

    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        pixels = as_float(image)
        directions = self.directions or self._choose([to_bytes(pixels)], None)
        if directions.gain == 0.0:
            return pixels
        linear = srgb_to_linear(image_to_tensor(pixels))
        lab, seen = _lab(linear), self._observer.lab(linear)
        change = self._change(lab, seen, directions) * self._strength
        mapped = tensor_to_image(_into_gamut(lab, change * directions.visible[:, None, None]))
        untouched = (change == 0.0).numpy()[..., None]
        return np.where(untouched, pixels, mapped)

    def _choose(self, images: Images, alphas: Alphas) -> SceneDirections:
        settings = self._settings
        generator = np.random.default_rng(self._seed)
        colors = sample_pairs(images, settings.pairs, generator, settings.sampling, alphas)
        linear = srgb_to_linear(torch.from_numpy(colors).double().permute(2, 0, 1) / 255.0)  # (3, P, 2)
        lab, seen = _lab(linear), self._observer.lab(linear)
        lost_vectors = (lab - seen).flatten(1)
        lost = torch.linalg.eigh(lost_vectors @ lost_vectors.T).eigenvectors[:, -1]
        lost = lost * torch.sign(lost[lost.abs().argmax()])
        amount = torch.tensordot(lost, lab - seen, 1)
        first, second = _orthogonal_plane(lost)
        best = SceneDirections(lost.float(), first.float(), torch.zeros(3), 0.0)
        if float(amount.abs().max()) < _LEAST_LOSS:
            return best
        least = self._cost(lab, seen, lab)
        for angle in 2.0 * np.pi * np.arange(settings.directions) / settings.directions:
            visible = np.cos(angle) * first + np.sin(angle) * second
            for gain in settings.gains:
                mapped = lab_to_linear(lab + gain * amount * visible[:, None, None]).clamp(0.0, 1.0)
                cost = self._cost(lab, self._observer.lab(mapped), _lab(mapped))
                if cost < least:
                    seen_direction = self._seen_direction(lab, visible)
                    least = cost
                    best = SceneDirections(lost.float(), visible.float(), seen_direction.float(), gain)
        return best

    def _cost(self, lab: Tensor, seen: Tensor, mapped: Tensor) -> float:
        """Lost contrast and change of (3, P, 2) pairs, weighted as by the LUT teacher."""
        settings = self._settings
        contrast = delta_e_76(lab[..., 0:1], lab[..., 1:2])
        remaining = delta_e_76(seen[..., 0:1], seen[..., 1:2])
        loss = torch.relu(contrast - remaining) ** 2 / (contrast + settings.contrast_offset)
        change = ((mapped - lab) ** 2).sum(0).mean()
        return float((loss * (contrast >= settings.discernible)).mean() + settings.naturalness_weight * change)

    def _seen_direction(self, lab: Tensor, visible: Tensor) -> Tensor:
        """v': the mean change of what the observer sees per ΔE76 along `visible`."""
        step = 0.5 * _PROBE * visible[:, None, None]
        ahead, behind = (self._observer.lab(lab_to_linear(lab + sign * step).clamp(0.0, 1.0)) for sign in (1.0, -1.0))
        return (ahead - behind).flatten(1).mean(1) / _PROBE

    def _change(self, lab: Tensor, seen: Tensor, directions: SceneDirections) -> Tensor:
        """(H, W) D, the change along the visible direction in ΔE76."""
        settings = self._settings
        lost = torch.tensordot(directions.lost, lab - seen, 1)
        wanted = [
            self._wanted_difference(torch.diff(lab, dim=axis), torch.diff(seen, dim=axis), directions)
            for axis in (-2, -1)
        ]
        reach = max(settings.reach * min(lost.shape), 1.0)
        anchor = directions.gain * lost
        change = torch.from_numpy(_screened_poisson(wanted[0].numpy(), wanted[1].numpy(), anchor.numpy(), reach))
        chroma = torch.linalg.vector_norm(lab[1:], dim=0)
        return change * (chroma / settings.neutral_chroma).clamp(max=1.0) ** 2

    def _wanted_difference(self, original: Tensor, seen: Tensor, directions: SceneDirections) -> Tensor:
        """g for (3, ...) differences: the root of |s + g v'| = |c| with the sign of the lost difference."""
        lost = torch.tensordot(directions.lost, original - seen, 1)
        along = torch.tensordot(directions.seen, seen, 1) * torch.sign(lost)
        squared = (directions.seen**2).sum().clamp(min=1e-6)
        missing = ((original**2).sum(0) - (seen**2).sum(0)).clamp(min=0.0)
        root = (torch.sqrt(along**2 + squared * missing) - along) / squared
        # Without a bound a difference of which little is lost, but in the other sense, would be turned round.
        bound = self._settings.largest_amplification * directions.gain * lost.abs()
        return torch.sign(lost) * torch.minimum(root, bound)


def _screened_poisson(
    down: NDArray[np.float32], right: NDArray[np.float32], anchor: NDArray[np.float32], reach: float
) -> NDArray[np.float32]:
    """The (H, W) field whose differences come closest to those wanted while it stays near `anchor`.

    Minimises Σ (∂D - g)² + Σ (D - anchor)² / reach² over pixels.

    Args:
        down, right: (H - 1, W) and (H, W - 1) wanted differences to the next row and column.
        anchor: (H, W) what D is held to.
        reach: in pixels.
    """
    height, width = anchor.shape
    tension = 1.0 / reach**2
    source = tension * anchor
    source[:-1] -= down
    source[1:] += down
    source[:, :-1] -= right
    source[:, 1:] += right
    # Eigenvalues of minus the five-point Laplacian with reflecting borders (Strang 1999, "The Discrete Cosine
    # Transform"); the transform diagonalises it.
    rows = 2.0 - 2.0 * np.cos(np.pi * np.arange(height, dtype=np.float32) / height)
    columns = 2.0 - 2.0 * np.cos(np.pi * np.arange(width, dtype=np.float32) / width)
    spectrum = dctn(source, norm="ortho", overwrite_x=True)
    spectrum /= rows[:, None] + columns + np.float32(tension)
    return idctn(spectrum, norm="ortho", overwrite_x=True).astype(np.float32, copy=False)


def _into_gamut(lab: Tensor, change: Tensor) -> Tensor:
    """sRGB of `lab` + `change`, (3, H, W) each; where that is no sRGB colour, of as much of the change as is one."""
    shape = lab.shape
    lab, change = lab.flatten(1)[..., None], change.flatten(1)[..., None]
    linear = lab_to_linear(lab + change)
    outside = ((linear < -_GAMUT_TOLERANCE) | (linear > 1.0 + _GAMUT_TOLERANCE)).any(0)[:, 0]
    if outside.any():
        start, full = lab[:, outside], change[:, outside]
        inside_share = torch.zeros(start.shape[1:])
        step = 0.5
        for _ in range(_GAMUT_BISECTIONS):
            trial = lab_to_linear(start + (inside_share + step) * full)
            fits = ((trial >= -_GAMUT_TOLERANCE) & (trial <= 1.0 + _GAMUT_TOLERANCE)).all(0)
            inside_share = torch.where(fits, inside_share + step, inside_share)
            step /= 2.0
        linear[:, outside] = lab_to_linear(start + inside_share * full)
    return linear_to_srgb(linear.clamp(0.0, 1.0)).reshape(shape)


def _orthogonal_plane(normal: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors orthogonal to `normal` and to each other; the second as close to lightness as can be."""
    lightness = torch.tensor([1.0, 0.0, 0.0], dtype=normal.dtype)
    upward = lightness - (lightness @ normal) * normal
    if float(upward.norm()) < 1e-3:  # only lightness is lost
        upward = torch.tensor([0.0, 0.0, 1.0], dtype=normal.dtype)
    upward = upward / upward.norm()
    return torch.linalg.cross(upward, normal), upward


def _lab(linear: Tensor) -> Tensor:
    return xyz_to_lab(linear_to_xyz(linear))
