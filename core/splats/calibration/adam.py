"""Adam for the few parameters of a correction, whose learning rate decays: exposures, poses, a focal length."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...files.states import SavedState, State

_BETA_1, _BETA_2 = 0.9, 0.99  # a view is visited some hundred times


class AdamMoments:
    """Bias-corrected moving averages of a gradient (Kingma and Ba 2015); a step is -learning_rate * mean / scale.

    Args:
        epsilon: added to the scale.
        shared: one second moment for all components, the mean of their squares.
    """

    def __init__(self, epsilon: float = 1e-30, *, shared: bool = False) -> None:
        self._epsilon, self._shared = epsilon, shared
        self._first: Any = None
        self._second: Any = None
        # The powers of numpy's integers differ from Python's in the last bit; the choice keeps results what they were.
        self._steps: Any = np.int64(0) if shared else 0

    def update(self, gradient: Any) -> tuple[Any, Any]:
        """The mean and the scale (root mean square) of the gradients so far, `gradient` included.

        Args:
            gradient: a number, an array or a tensor, which stays on its device; finite, and always of the same shape.
        """
        square = (gradient**2).mean() if self._shared else gradient**2
        if not self._steps:
            self._first = 0.0 * gradient
            self._second = 0.0 if self._shared else self._first
        average, root = (torch.lerp, torch.sqrt) if isinstance(gradient, torch.Tensor) else (_lerp, np.sqrt)
        self._steps += 1
        self._first = average(self._first, gradient, 1.0 - _BETA_1)
        self._second = average(self._second, square, 1.0 - _BETA_2)
        mean = self._first / (1.0 - _BETA_1**self._steps)
        return mean, root(self._second / (1.0 - _BETA_2**self._steps)) + self._epsilon


def snapshot_moments(moments: Sequence[AdamMoments], size: int) -> State:
    """What `restore_moments` continues from; `size` is the number of components of a gradient."""
    first, second = np.zeros((len(moments), size)), np.zeros((len(moments), size))
    for row, one in enumerate(moments):
        if one._steps:
            first[row], second[row] = (np.asarray(value, np.float64) for value in (one._first, one._second))
    return {"steps": np.array([int(one._steps) for one in moments], np.int64), "first": first, "second": second}


def restore_moments(
    moments: Sequence[AdamMoments], size: int, saved: SavedState, component: Callable[[NDArray[np.float64]], Any]
) -> None:
    """Continue from a `snapshot_moments`; `component` makes a row of its doubles what `AdamMoments.update` is given.

    Raises:
        InputError: it is of other moments.
    """
    steps = saved.array("steps", np.int64, len(moments))
    first, second = (saved.array(name, np.float64, len(moments), size) for name in ("first", "second"))
    for row, one in enumerate(moments):
        one._steps = steps[row] if one._shared else int(steps[row])
        one._first = component(first[row])
        one._second = second[row, 0] if one._shared else component(second[row])


def decayed(rate: float, final_factor: float, progress: float, start: float = 0.0) -> float:
    """A learning rate at the fraction `progress` of a run: `rate` until `start`, then exponential decay.

    Args:
        final_factor: of the rate, at the end of the run.
    """
    done = (progress - start) / (1.0 - start) if start < 1.0 else 1.0
    return rate * final_factor ** min(max(done, 0.0), 1.0)


def _lerp(start: Any, end: Any, weight: float) -> Any:
    return start + weight * (end - start)
