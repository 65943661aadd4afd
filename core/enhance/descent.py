"""Adam by torch's function: torch's class imports its compiler, two seconds of every process that fits."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.optim.adam import adam

_EPSILON = 1e-8


class Adam:
    """Adam (Kingma and Ba 2015); its steps are those of `torch.optim.Adam` to the last bit.

    Args:
        parameters: leaf tensors that require gradients; changed in place.
        betas: decay of the first and the second moment.
    """

    def __init__(self, parameters: Sequence[Tensor], betas: tuple[float, float] = (0.9, 0.999)) -> None:
        self._parameters, self._betas = list(parameters), betas
        self._first, self._second = ([torch.zeros_like(one) for one in self._parameters] for _ in range(2))
        self._steps = [torch.tensor(0.0) for _ in self._parameters]

    def descend(self, loss: Tensor, rate: float) -> None:
        """One step down the gradient of `loss`, which depends on every parameter, at a learning rate."""
        gradients = list(torch.autograd.grad(loss, self._parameters))
        with torch.no_grad():
            adam(
                self._parameters,
                gradients,
                self._first,
                self._second,
                [],
                self._steps,
                amsgrad=False,
                beta1=self._betas[0],
                beta2=self._betas[1],
                lr=rate,
                weight_decay=0.0,
                eps=_EPSILON,
                maximize=False,
            )
