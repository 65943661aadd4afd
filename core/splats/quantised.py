"""Numbers in a byte, as .spz and .splat store opacities and quaternions. numpy only: Blender's Python imports this."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# The bytes 0 and 255 stand for what lies within half a step of the ends; the middle of that is finite as a logit.
_END = 0.25


def to_bytes(values: NDArray) -> NDArray[np.uint8]:
    """The nearest whole numbers in 0..255, halves upwards; what is not a number becomes 0."""
    return np.clip(np.floor(np.nan_to_num(values) + 0.5), 0.0, 255.0).astype(np.uint8)


def opacities_to_bytes(logits: NDArray[np.float32]) -> NDArray[np.uint8]:
    """sigmoid(logit) in 255ths."""
    with np.errstate(over="ignore"):  # exp(-logit) of a logit below -88 is infinite, and the opacity zero
        return to_bytes(255.0 / (1.0 + np.exp(-logits)))


def bytes_to_opacity_logits(opacities: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The logits, finite throughout."""
    steps = np.clip(opacities.astype(np.float32), _END, 255.0 - _END)
    return np.log(steps / (255.0 - steps))


def normalised(quaternions: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 4) of unit length; the identity (wxyz) where the length is zero."""
    largest = np.abs(quaternions).max(axis=1, keepdims=True)  # its square, unlike theirs, cannot overflow
    zero = (largest == 0.0)[:, 0]
    result = np.divide(quaternions, largest, out=np.zeros_like(quaternions), where=largest > 0.0)
    result[zero, 0] = 1.0
    return result / np.linalg.norm(result, axis=1, keepdims=True)
