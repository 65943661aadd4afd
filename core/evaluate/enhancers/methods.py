"""The enhancers that a comparison can name, and how one is applied to a photograph of its own."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...enhance import Enhancer, make_enhancer
from ...enhance.controls import ContrastGain
from ...enhance.fidaner import FidanerEnhancer
from ...enhance.gradient_teacher import GradientTeacher
from ...errors import InputError
from ...images import to_bytes
from ...settings import WEIGHTS_SUFFIX
from .scores import Enhanced

NONE, GAIN, LUT, NETWORK = "none", "gain", "lut", "cgan"

MethodFactory = Callable[[str, float, str], Enhancer]
"""(cvd, severity, simulation) to an enhancer."""

METHODS: Mapping[str, MethodFactory] = {
    "fidaner": FidanerEnhancer,
    "gradient": GradientTeacher,
}
"""Enhancers of the comparison alone, beside those that `make_enhancer` knows; one line adds another."""

_TIMED_SIDE = 1000  # pixels: one megapixel
_TIMED_REPETITIONS = 3


def method_factory(name: str) -> MethodFactory:
    """The factory of a name in `METHODS`, a name that `make_enhancer` knows, or a file of weights."""
    return METHODS.get(name) or (lambda cvd, severity, simulation: make_enhancer(name, cvd, severity, simulation))


def method_label(name: str) -> str:
    """What tables call a method: its name, or a weight file's without folder and suffix."""
    return name.replace("\\", "/").rsplit("/", 1)[-1].removesuffix(WEIGHTS_SUFFIX)


def check_labels(names: Sequence[str]) -> None:
    """Raise `InputError` where tables would call two methods the same."""
    labels = [method_label(name) for name in names]
    repeated = sorted({label for label in labels if labels.count(label) > 1})
    if repeated:
        remedy = "name each once, and weight files differently"
        raise InputError(f"two methods are called {', '.join(repeated)}", where="--enhancers", remedy=remedy)


def is_network(name: str) -> bool:
    """Whether the method is a trained network."""
    return name == NETWORK or name.endswith(WEIGHTS_SUFFIX)


def gain_references(names: Sequence[str]) -> list[str]:
    """Which of the methods contrast gain is matched to: every network, the LUT where there is none.

    Raises:
        InputError: there is nothing to match.
    """
    references = [name for name in names if is_network(name)] or [name for name in names if name == LUT]
    if references:
        return references
    others = [name for name in names if name not in (NONE, GAIN)]
    if not others:
        raise InputError("contrast gain needs a method to match", where="--enhancers", remedy="add lut or cgan")
    return others[:1]


def gain_label(reference: str) -> str:
    """What tables call the contrast gain matched to a method."""
    return f"gain as {method_label(reference)}"


def enhance(method: str, enhancer: Enhancer, image: NDArray[np.uint8]) -> Enhanced:
    """Fit the enhancer to the image alone and apply it; `method` is its label."""
    started = time.perf_counter()
    enhancer.fit([image])
    fitted = time.perf_counter()
    pixels = enhancer(image)
    applied = time.perf_counter()
    return Enhanced(method, to_bytes(pixels), fitted - started, applied - fitted)


def matched_gain(reference: str, image: NDArray[np.uint8], delta_e: float) -> Enhanced:
    """Contrast gain that changes the image by a mean ΔE76 of `delta_e`, as the reference method does."""
    return enhance(gain_label(reference), ContrastGain(delta_e), image)


def blend(original: NDArray[np.uint8], enhanced: NDArray[np.uint8], strength: float) -> NDArray[np.uint8]:
    """The enhancement at part of its strength, which is how enhancers define it: original + s (enhanced - original)."""
    return to_bytes((original + strength * (enhanced.astype(np.float32) - original)) / np.float32(255.0))


def seconds_per_megapixel(enhancer: Enhancer, image: NDArray[np.uint8]) -> float:
    """Fastest of a few calls on one megapixel of the image, repeated to that size; the fit is not counted."""
    enhancer.fit([image])
    repeats = [math.ceil(_TIMED_SIDE / side) for side in image.shape[:2]]
    large = np.ascontiguousarray(np.tile(image, (*repeats, 1))[:_TIMED_SIDE, :_TIMED_SIDE])
    seconds = []
    for _ in range(_TIMED_REPETITIONS):
        started = time.perf_counter()
        enhancer(large)
        seconds.append(time.perf_counter() - started)
    return min(seconds)
