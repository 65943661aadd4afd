"""Basic colour names: which of eleven words most people use for a colour, and how many pairs an observer loses.

The eleven are the basic terms of English (B. Berlin, P. Kay, "Basic color terms", 1969). Who says what is from the xkcd
colour survey, several million answers given at uncalibrated displays; `color_names.json` says how it was reduced.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

BASIC_NAMES = ("black", "white", "red", "green", "yellow", "blue", "brown", "orange", "pink", "purple", "grey")
"""What the indices of `basic_names` stand for."""

NAME_PAIRS = 200_000
"""Random pairs of pixels that are compared."""

_TABLE = Path(__file__).with_name("color_names.json")


def basic_names(image: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The most common basic name of every pixel, that of the nearest node of the survey's table.

    Args:
        image: (..., 3) encoded sRGB in [0, 1].

    Returns:
        (...) indices into `BASIC_NAMES`.
    """
    table = _table()
    nodes = np.rint(np.clip(image, 0.0, 1.0) * (len(table) - 1)).astype(np.intp)
    return table[nodes[..., 0], nodes[..., 1], nodes[..., 2]]


def confused_names(original: NDArray[np.floating], seen: NDArray[np.floating], seed: int = 0) -> float:
    """Share of random pixel pairs with different names in the original whose names are one in what is seen.

    Args:
        original, seen: (H, W, 3) encoded sRGB in [0, 1]: for normal vision, and as an observer sees it.
        seed: of the pairs.

    Returns:
        A share in [0, 1]; NaN if the original has one name only.
    """
    before, after = basic_names(original).ravel(), basic_names(seen).ravel()
    first, second = np.random.default_rng(seed).integers(0, before.size, (2, NAME_PAIRS))
    distinct = before[first] != before[second]
    return float((after[first] == after[second])[distinct].mean()) if distinct.any() else math.nan


@lru_cache(1)
def _table() -> NDArray[np.uint8]:
    """(N, N, N) indices into `BASIC_NAMES` over levels of red, green and blue."""
    read = json.loads(_TABLE.read_text(encoding="utf-8"))
    numbers = {letter: BASIC_NAMES.index(name) for letter, name in read["letters"].items()}
    planes = [[numbers[letter] for letter in plane] for plane in read["planes"]]
    return np.array(planes, np.uint8).reshape(len(planes), len(planes), len(planes))
