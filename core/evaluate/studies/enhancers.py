"""The enhancers of recipes: the product's, controls, and ones that contradict themselves from view to view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...color.difference import delta_e_76
from ...color.spaces import image_to_tensor, lab_to_linear, linear_to_srgb, srgb_to_lab, tensor_to_image
from ...enhance import Enhancer, LutEnhancer
from ...enhance.controls import ContrastGain
from ...enhance.enhancer import SceneIndependent
from ...enhance.teacher import TeacherSettings
from ...events import Reporter
from ...images import to_bytes
from ..enhancers.methods import GAIN, LUT, method_factory
from .recipe import Recipe

PER_VIEW_LUT = "lut-per-view"
# Of a LUT that is fitted to every view and every rendering anew: a third of the teacher's usual work.
_PER_VIEW_STEPS = 80
_PER_VIEW_PAIRS = 3000
_MATCHED_VIEWS = 8  # that contrast gain is matched on; the mean changes little with more


def recipe_enhancer(recipe: Recipe) -> Enhancer:
    """The enhancer of a recipe, not fitted yet.

    Raises:
        InputError: an enhancer or an observer that does not exist.
    """
    observer = (recipe.layer.cvd, recipe.layer.severity, recipe.simulation)
    enhancer: Enhancer
    if recipe.enhancer == PER_VIEW_LUT:
        enhancer = PerViewLut(*observer)
    elif recipe.enhancer == GAIN:
        enhancer = MatchedGain(method_factory(LUT)(*observer))
    else:
        enhancer = method_factory(recipe.enhancer)(*observer)
    return Drifting(enhancer, recipe.drift) if recipe.drift else enhancer


class PerViewLut(SceneIndependent):
    """Fits a LUT to every image anew: what a method that knows single images only does to a scene.

    Two colours that look alike can be told apart in either direction. For a scene the teacher decides that once; here
    nothing ties the views together, and a coin decides for each image, thrown by its own pixels.

    Args:
        cvd, severity, simulation: the observer, as for `simulate`.
    """

    def __init__(self, cvd: str, severity: float, simulation: str) -> None:
        self._observer = (cvd, severity, simulation)

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The image, recoloured by a LUT of its own."""
        usual = TeacherSettings()
        direction = 1.0 if _thrown_by(image).random() < 0.5 else -1.0
        settings = replace(
            usual,
            steps=_PER_VIEW_STEPS,
            pairs=_PER_VIEW_PAIRS,
            relaxations=0,
            initial_shift=direction * usual.initial_shift,
        )
        enhancer = LutEnhancer(*self._observer, settings=settings)
        enhancer.fit([image])
        return enhancer(image)


class MatchedGain:
    """Plain contrast gain that changes the scene by the mean ΔE76 of another enhancer.

    Args:
        reference: the other; fitted with this one.
    """

    def __init__(self, reference: Enhancer) -> None:
        self._reference = reference
        self._gain = ContrastGain(0.0)

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Fit the reference, and match its change."""
        self._reference.fit(images, reporter, alphas=alphas)
        some = images[:: max(len(images) // _MATCHED_VIEWS, 1)]
        changes = [_mean_delta_e(image, self._reference(image)) for image in some]
        self._gain = ContrastGain(float(np.mean(changes)))
        self._gain.fit(images, alphas=alphas)

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The image with its contrast raised."""
        return self._gain(image)


class Drifting:
    """Another enhancer, with the hues of every image turned by an angle of its own.

    Args:
        inner: the other.
        degrees: standard deviation of the angle in CIELAB's a*b* plane; an image's pixels draw it.
    """

    def __init__(self, inner: Enhancer, degrees: float) -> None:
        self._inner, self._degrees = inner, degrees

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Fit the other."""
        self._inner.fit(images, reporter, alphas=alphas)

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The enhanced image, in turned hues."""
        angle = np.deg2rad(self._degrees * _thrown_by(image).standard_normal())
        lab = srgb_to_lab(image_to_tensor(self._inner(image)))
        a, b = lab[1].clone(), lab[2].clone()
        lab[1], lab[2] = np.cos(angle) * a - np.sin(angle) * b, np.sin(angle) * a + np.cos(angle) * b
        return tensor_to_image(linear_to_srgb(lab_to_linear(lab).clamp(0.0, 1.0)))


def _thrown_by(image: NDArray) -> np.random.Generator:
    """A generator that the image's own pixels seed."""
    return np.random.default_rng(int(to_bytes(image).astype(np.uint64).sum()))


def _mean_delta_e(first: NDArray, second: NDArray) -> float:
    return float(delta_e_76(*(srgb_to_lab(image_to_tensor(image)) for image in (first, second))).double().mean())
