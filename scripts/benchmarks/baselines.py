"""Enhancers to compare ours with: controls, a classical method, and ones that are inconsistent between views.

Local contrast preservation rewards any gain in contrast, so every comparison should include plain contrast gain: an
enhancer achieves something only where it beats a gain that changes the images as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.color.spaces import (
    delta_e_76,
    delta_e_2000,
    image_to_tensor,
    lab_to_linear,
    linear_to_srgb,
    srgb_to_lab,
    tensor_to_image,
)
from ...core.enhance import Enhancer, SceneEnhancer
from ...core.enhance.lut import as_float
from ...core.enhance.lut_fit import LutSettings, fit_lut
from ...core.enhance.pairs import Alphas, Images
from ...core.errors import InputError
from ...core.files.images import to_bytes
from ...core.runtime.protocol import Reporter

Difference = Callable[[NDArray, NDArray], float]
"""The mean difference of two (H, W, 3) images."""

_LARGEST_GAIN = 16.0
_BISECTIONS = 20  # to 16 / 2^20
_SAMPLES = 10_000  # pixels on which the gain is found; few enough that torch starts no threads
_MATCHED_VIEWS = 8  # on which a scene's contrast gain is matched; more hardly change the mean
# Of a LUT fitted to each view and rendering: a third of the usual effort.
_PER_VIEW_STEPS = 80
_PER_VIEW_PAIRS = 3000

# From the (red, green, blue) error to the correction. Red-green observers keep blue and overall lightness, so the error
# of red goes to green and blue: the original matrix. It would give tritan observers their errors back in blue, which
# they cannot see, so for them the error of blue goes to red and green, as in later programs.
_FROM_RED = np.array([[0.0, 0.0, 0.0], [0.7, 1.0, 0.0], [0.7, 0.0, 1.0]], np.float32)
_FROM_BLUE = np.array([[1.0, 0.0, 0.7], [0.0, 1.0, 0.7], [0.0, 0.0, 0.0]], np.float32)
_REDISTRIBUTION = {"protan": _FROM_RED, "deutan": _FROM_RED, "tritan": _FROM_BLUE}


def mean_delta_e_76(first: NDArray, second: NDArray) -> float:
    """Mean ΔE76 of two (H, W, 3) images."""
    return float(delta_e_76(*(srgb_to_lab(image_to_tensor(image)) for image in (first, second))).double().mean())


def mean_delta_e_2000(first: NDArray, second: NDArray) -> float:
    """Mean ΔE00 of two (H, W, 3) images."""
    return float(delta_e_2000(image_to_tensor(first), image_to_tensor(second)).mean())


class ContrastGain:
    """Plain contrast gain: scales colours about the scene's mean until images differ from the originals by `delta_e`.

    Args:
        delta_e: mean difference over the training views to match, usually that of another enhancer.
        seed: for the pixels on which the gain is found.
        difference: mean difference of two images; ΔE76 unless another is given.
    """

    def __init__(self, delta_e: float, seed: int = 0, difference: Difference = mean_delta_e_76) -> None:
        self._delta_e, self._seed, self._difference = delta_e, seed, difference
        self.gain = 1.0
        """The factor found by `fit`; 16 if no smaller gain changes the images enough."""
        self._center = np.zeros(3, np.float32)

    def fit(self, images: Images, reporter: Reporter | None = None, *, alphas: Alphas = None) -> None:
        """Find the scene's mean colour and the gain, by bisection."""
        colors = np.concatenate([_covered(*view) for view in _with_alphas(images, alphas)])
        self._center = as_float(colors).mean(0, dtype=np.float64).astype(np.float32)
        sample = as_float(np.random.default_rng(self._seed).choice(colors, min(_SAMPLES, len(colors)), replace=False))[
            :, None
        ]
        low, high = 1.0, _LARGEST_GAIN
        for _ in range(_BISECTIONS):
            self.gain = (low + high) / 2.0
            if self._difference(sample, self(sample)) < self._delta_e:
                low = self.gain
            else:
                high = self.gain

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The image with its contrast raised."""
        return np.clip(self._center + (as_float(image) - self._center) * np.float32(self.gain), 0.0, 1.0)


class MatchedGain:
    """Contrast gain that changes the scene by the same mean ΔE76 as another enhancer.

    Args:
        reference: the other enhancer; fitted along with this one.
        seed: as of `ContrastGain`.
    """

    def __init__(self, reference: Enhancer, seed: int = 0) -> None:
        self._reference, self._seed = reference, seed
        self._gain = ContrastGain(0.0)

    def fit(self, images: Images, reporter: Reporter | None = None, *, alphas: Alphas = None) -> None:
        """Fit the reference and match its change."""
        self._reference.fit(images, reporter, alphas=alphas)
        some = _with_alphas(images, alphas)[:: max(len(images) // _MATCHED_VIEWS, 1)]
        # Where nothing is covered, an enhancer may do anything: the gain is searched on what is covered, too.
        given = np.concatenate([_covered(image, alpha) for image, alpha in some])
        changed = np.concatenate([_covered(self._reference(image), alpha) for image, alpha in some])
        self._gain = ContrastGain(mean_delta_e_76(given[:, None], changed[:, None]), self._seed)
        self._gain.fit(images, alphas=alphas)

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The image with its contrast raised."""
        return self._gain(image)


class FidanerEnhancer(SceneEnhancer):
    """The classic "daltonize": redistributes what the simulation S loses, image + M (image - S(image)).

    After Fidaner, Lin and Ozguven, "Analysis of Color Blindness" (Stanford, Psych 221, 2005), whose method most such
    programs still use. As there, the error is taken between encoded values, but S is the product's own, in linear
    light, so that all methods are compared for the same observer. "achromat" is refused.
    """

    name = "fidaner"

    def __init__(
        self, cvd: str, severity: float, simulation: str = "machado", strength: float = 1.0, seed: int = 0
    ) -> None:
        super().__init__(cvd, severity, simulation, strength, seed)
        if cvd not in _REDISTRIBUTION:
            raise InputError(
                f"error redistribution is not defined for {cvd} vision",
                remedy=f"use {', '.join(_REDISTRIBUTION)}, or another enhancer",
            )
        self._matrix = _REDISTRIBUTION[cvd] * np.float32(strength)

    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        pixels = as_float(image)
        error = pixels - tensor_to_image(self._observer.simulate(image_to_tensor(pixels)))
        return np.clip(pixels + error @ self._matrix.T, 0.0, 1.0)


class PerViewLut(SceneEnhancer):
    """Fits a new LUT to every image, as a method for single images would treat a scene.

    Two confused colours can be separated in either direction. For a scene the fit decides that once; here nothing
    ties the views together, and each image is decided by a coin toss seeded with its pixels.
    """

    name = "lut-per-view"

    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        usual = LutSettings()
        direction = 1.0 if _seeded_by(image).random() < 0.5 else -1.0
        settings = replace(
            usual,
            steps=_PER_VIEW_STEPS,
            pairs=_PER_VIEW_PAIRS,
            relaxations=0,
            initial_shift=direction * usual.initial_shift,
        )
        who = (self._observer.cvd, self._observer.severity, self._observer.simulation)
        lut = fit_lut([image], *who, settings=settings, seed=self._seed)
        return lut(image, self._strength)


class Drifting:
    """Another enhancer, with the hues of each image rotated by a random angle.

    Args:
        inner: the other enhancer.
        degrees: standard deviation of the angle in CIELAB's a*b* plane; seeded with the image's pixels.
    """

    def __init__(self, inner: Enhancer, degrees: float) -> None:
        self._inner, self._degrees = inner, degrees
        self.fit = inner.fit

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The enhanced image with rotated hues."""
        angle = np.deg2rad(self._degrees * _seeded_by(image).standard_normal())
        lab = srgb_to_lab(image_to_tensor(self._inner(image)))
        a, b = lab[1].clone(), lab[2].clone()
        lab[1], lab[2] = np.cos(angle) * a - np.sin(angle) * b, np.sin(angle) * a + np.cos(angle) * b
        return tensor_to_image(linear_to_srgb(lab_to_linear(lab).clamp(0.0, 1.0)))


def _with_alphas(images: Images, alphas: Alphas) -> list[tuple[NDArray, NDArray | None]]:
    """Each image with its alpha."""
    return list(zip(images, alphas or [None] * len(images), strict=True))


def _covered(image: NDArray, alpha: NDArray | None) -> NDArray:
    """The (N, 3) colours of an image where its (H, W) alpha is above 0; of all pixels without one."""
    return image.reshape(-1, 3) if alpha is None else image[alpha > 0]


def _seeded_by(image: NDArray) -> np.random.Generator:
    """A generator seeded with the image's pixels."""
    return np.random.default_rng(int(to_bytes(image).astype(np.uint64).sum()))
