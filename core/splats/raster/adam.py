"""Adam for Gaussians: all parameter groups in one pass, and only the Gaussians that took part in the step."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...files.states import SavedState, State
from .parameters import FIELDS, Gradients, ParameterSet
from .rasterizer import Rasterizer

# Bias corrections are tabulated; at the end of the table beta2^t has left float32 for the usual beta2 = 0.999.
_TABLE_STEPS = 20_000


@dataclass(frozen=True)
class LearningRates:
    """Per parameter group; `sh0` for the degree-0 colour, `sh_rest` for the higher degrees. 0 freezes a group."""

    means: float = 0.0
    log_scales: float = 0.0
    quaternions: float = 0.0
    opacity_logits: float = 0.0
    sh0: float = 0.0
    sh_rest: float = 0.0

    def scaled(self, factor: float) -> LearningRates:
        """All of them times `factor`."""
        return LearningRates(**{group: rate * factor for group, rate in vars(self).items()})


class Adam:
    """Adam with bias correction (Kingma and Ba 2015) and a step count per Gaussian.

    A Gaussian that was not drawn, or whose gradient is not finite, is skipped: neither its parameters nor its moments
    change. Its bias correction counts its own steps, so Gaussians that densification adds late are corrected like those
    that were there from the start. If every Gaussian is drawn in every step, this is ordinary Adam.
    """

    def __init__(self, params: ParameterSet, betas: tuple[float, float] = (0.9, 0.999), eps: float = 1e-15) -> None:
        self.betas = betas
        self.eps = eps
        device = params.device
        self._first = ParameterSet.zeros(len(params), params.sh_count, device)
        self._second = ParameterSet.zeros(len(params), params.sh_count, device)
        self._steps = wp.zeros(len(params), dtype=wp.int32, device=device)
        exponents = np.arange(1, _TABLE_STEPS)
        bias = np.ones((_TABLE_STEPS, 2), np.float64)
        bias[1:, 0] = 1.0 / (1.0 - betas[0] ** exponents)
        bias[1:, 1] = 1.0 / np.sqrt(1.0 - betas[1] ** exponents)
        self._bias = wp.array(bias.astype(np.float32), dtype=wp.float32, device=device)

    def snapshot(self) -> State:
        """What `restore` continues from."""
        return {"first": self._first.numpy(), "second": self._second.numpy(), "steps": self._steps.numpy()}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot` of as many Gaussians; raises `InputError` where it is another one."""
        count, sh_count, device = len(self._first), self._first.sh_count, self._steps.device
        self._first, self._second = (
            ParameterSet.restored(saved.part(name), count, sh_count, device) for name in ("first", "second")
        )
        steps = saved.array("steps", np.int32, count)
        if (steps < 0).any():
            saved.refuse("steps are negative")
        self._steps = wp.array(steps, dtype=wp.int32, device=device)

    def step(
        self, rasterizer: Rasterizer, params: ParameterSet, gradients: Gradients, learning_rates: LearningRates
    ) -> None:
        """Update `params` in place. With `gradients.colors_only`, only `sh[:, 0]` changes."""
        runner = rasterizer.runner
        state = runner.state
        for name in FIELDS:
            runner.bind(name, getattr(params, name))
            runner.bind(f"m_{name}", getattr(self._first, name))
            runner.bind(f"v_{name}", getattr(self._second, name))
            runner.bind(f"grad_{name}", getattr(gradients, name))
        runner.bind("touched", gradients.touched)
        runner.bind("adam_steps", self._steps)
        runner.bind("adam_bias", self._bias)
        state.gaussians, state.sh_count = len(params), params.sh_count
        state.colors_only = int(gradients.colors_only)
        state.adam_table_size = _TABLE_STEPS
        state.beta1, state.beta2 = self.betas
        state.epsilon = self.eps
        for group in fields(LearningRates):
            setattr(state, f"rate_{group.name}", getattr(learning_rates, group.name))
        runner.adam()

    def select(self, index: NDArray[np.integer], fresh: NDArray[np.bool_]) -> None:
        """Follow Gaussians that were added, removed or reordered.

        Args:
            index: (M,) the previous index of each Gaussian.
            fresh: (M,) bool, Gaussians that start with zero moments and a step count of zero.
        """
        device = self._steps.device
        fresh = np.asarray(fresh, bool)

        def chosen(array: wp.array) -> wp.array:
            values = array.numpy()[index]
            values[fresh] = 0
            return wp.array(values, dtype=array.dtype, device=device)

        self._first = ParameterSet(*(chosen(getattr(self._first, name)) for name in FIELDS))
        self._second = ParameterSet(*(chosen(getattr(self._second, name)) for name in FIELDS))
        self._steps = chosen(self._steps)
