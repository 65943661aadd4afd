"""The enhancers that benchmarks can name, and their application to a single photograph."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ....core.enhance import (
    CganEnhancer,
    Enhancer,
    IdentityEnhancer,
    LutEnhancer,
    SceneEnhancer,
    SceneNetworkEnhancer,
    make_enhancer,
)
from ....core.errors import InputError
from ....core.files.images import to_bytes
from ....core.settings import WEIGHTS_SUFFIX
from ..baselines import ContrastGain, FidanerEnhancer, PerViewLut
from .scores import Enhanced

NONE, LUT, NETWORK, PER_VIEW_LUT = IdentityEnhancer.name, LutEnhancer.name, CganEnhancer.name, PerViewLut.name
SCENE = SceneNetworkEnhancer.name
GAIN = "gain"
FIT_MARK = "@"
"""Between a network's name and the steps by which its prediction is fitted."""

MethodFactory = Callable[[str, float, str], Enhancer]
"""(cvd, severity, simulation) to an enhancer."""

METHODS: Mapping[str, type[SceneEnhancer]] = {method.name: method for method in (FidanerEnhancer, PerViewLut)}
"""Enhancers of benchmarks alone, in addition to those of `make_enhancer`."""

_TIMED_SIDE = 1000  # pixels: one megapixel
_TIMED_REPETITIONS = 3


def method_factory(name: str, seed: int = 0) -> MethodFactory:
    """The factory for a name in `METHODS`, a name that `make_enhancer` takes, or a weight file; `seed` is of its fits.

    ``cgan@0`` and ``FILE@0`` take the network's prediction as it is; any other number is that of the steps of the fit.
    """
    plain, at, number = name.rpartition(FIT_MARK)
    if at and number.isdecimal():
        return partial(make_enhancer, plain, seed=seed, fit_steps=int(number))
    method = METHODS.get(name)
    return partial(make_enhancer, name, seed=seed) if method is None else partial(method, seed=seed)


def method_label(name: str) -> str:
    """The name of a method in tables; a weight file's without folder and suffix."""
    plain, at, number = name.replace("\\", "/").rsplit("/", 1)[-1].partition(FIT_MARK)
    return plain.removesuffix(WEIGHTS_SUFFIX) + at + number


def check_labels(names: Sequence[str]) -> None:
    """Raise `InputError` if two methods would have the same name in tables."""
    labels = [method_label(name) for name in names]
    repeated = sorted({label for label in labels if labels.count(label) > 1})
    if repeated:
        remedy = "name each once, and weight files differently"
        raise InputError(f"two methods are called {', '.join(repeated)}", where="--enhancers", remedy=remedy)


def is_network(name: str) -> bool:
    """Whether the method is a network, of the scene or predicted."""
    plain = name.partition(FIT_MARK)[0]
    return plain in (NETWORK, SCENE) or plain.endswith(WEIGHTS_SUFFIX)


def gain_references(names: Sequence[str]) -> list[str]:
    """The methods that contrast gain is matched to: the scene network and every trained one, else the LUT.

    Raises:
        InputError: there is no method to match.
    """
    references = [name for name in names if name == SCENE or is_network(name)]
    references = references or [name for name in names if name == LUT]
    if references:
        return references
    others = [name for name in names if name not in (NONE, GAIN)]
    if not others:
        raise InputError("contrast gain needs a method to match", where="--enhancers", remedy="add lut, scene or cgan")
    return others[:1]


def gain_label(reference: str) -> str:
    """The name in tables of the contrast gain matched to a method."""
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
    """Contrast gain that changes the image by a mean ΔE76 of `delta_e`, as much as the reference method."""
    return enhance(gain_label(reference), ContrastGain(delta_e), image)


def blend(original: NDArray[np.uint8], enhanced: NDArray[np.uint8], strength: float) -> NDArray[np.uint8]:
    """The enhancement at partial strength as enhancers define it: original + strength · (enhanced - original)."""
    return to_bytes((original + strength * (enhanced.astype(np.float32) - original)) / np.float32(255.0))


def seconds_per_megapixel(enhancer: Enhancer, image: NDArray[np.uint8]) -> float:
    """The fastest of a few calls on the image tiled to one megapixel; the fit is not counted."""
    enhancer.fit([image])
    repeats = [math.ceil(_TIMED_SIDE / side) for side in image.shape[:2]]
    large = np.ascontiguousarray(np.tile(image, (*repeats, 1))[:_TIMED_SIDE, :_TIMED_SIDE])
    seconds = []
    for _ in range(_TIMED_REPETITIONS):
        started = time.perf_counter()
        enhancer(large)
        seconds.append(time.perf_counter() - started)
    return min(seconds)
