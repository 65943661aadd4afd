"""Exposure and white balance that change from photograph to photograph, kept out of the scene's colours.

Each view has a gain per channel, which multiplies the rendered image before it is compared with the photograph. The
logarithms of the gains are zero in the mean over the views, so the scene keeps the capture's colours, and three numbers
a view are too few to explain anything else away (richer corrections, such as bilateral grids, fit what is better left
to the scene). Where the photographs agree, nothing is corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import warp as wp
from numpy.typing import NDArray

from .raster import Frame

_BLOCK = 16  # pixels; gains are estimated from the means of square blocks, which blur and noise leave as they are
_DARKEST = 0.05  # mean of a block that says something about a ratio
_FEWEST_BLOCKS = 8
_BETA_1, _BETA_2 = 0.9, 0.99  # of Adam; a view is visited some hundred times
_EPSILON = 1e-15


@dataclass(frozen=True)
class ExposurePlan:
    """When and how gains are fitted.

    Attributes:
        decided: fraction of the run after which the photographs are compared with the scene.
        threshold: root mean square of the logarithms of the gains from which on correcting is worth its while. Smaller
            differences average out over the views; correcting the 2 % of an automatic camera on fox gained 0.4 dB on
            held-out views whose exposure is allowed for, and cost 0.8 dB on them as they are and a tenth of the time.
        rate: step size of the logarithms right after the decision, and what is left of it at the end.
        rate_left: see `rate`.
    """

    decided: float = 0.2
    threshold: float = 0.04
    rate: float = 4e-3
    rate_left: float = 0.1

    def rate_at(self, progress: float) -> float:
        """The step size when the fraction `progress` of the run is done: exponential from start to end."""
        done = (progress - self.decided) / (1.0 - self.decided) if self.decided < 1.0 else 1.0
        return self.rate * self.rate_left ** min(max(done, 0.0), 1.0)


def estimate_log_gains(rendered: NDArray[np.float32], photograph: NDArray[np.float32]) -> NDArray[np.float64]:
    """(3,) logarithms of the gains that take `rendered` to `photograph`, both (H, W, 3) sRGB in [0, 1].

    The median over blocks of pixels of the ratio of their means: what is blurred or missing in places does not matter.
    Zero where the image has too few blocks to tell.
    """
    first, second = _block_means(rendered), _block_means(photograph)
    usable = (first > _DARKEST) & (second > _DARKEST)
    result = np.zeros(3)
    for channel in range(3):
        chosen = usable[:, channel]
        if chosen.sum() >= _FEWEST_BLOCKS:
            result[channel] = np.median(np.log(second[chosen, channel] / first[chosen, channel]))
    return result


class ExposureCorrection:
    """The gains of all views, and their optimiser. Does nothing until `start` has found the photographs to differ.

    It changes a frame's arrays in place on the frame's device, and nothing is read back from there.

    Args:
        device: of the frames that are corrected.
        views: how many views there are.

    Attributes:
        active: whether anything is corrected.
        gradient: (3,) of the loss with respect to the logarithms of the gains, from the latest `backward`.
    """

    def __init__(self, device: wp.Device, views: int) -> None:
        self._device = wp.device_to_torch(device)
        self._log_gains = torch.zeros((views, 3), device=self._device)
        self._first, self._second = torch.zeros_like(self._log_gains), torch.zeros_like(self._log_gains)
        self._visits = [0] * views
        self.gradient = torch.zeros(3, device=self._device)
        self.active = False

    @property
    def log_gains(self) -> NDArray[np.float32]:
        """(V, 3) natural logarithms of the gains, zero in the mean over the views."""
        return self._log_gains.cpu().numpy().copy()

    def start(self, estimates: Sequence[NDArray[np.float64]], threshold: float) -> bool:
        """Correct from now on if (V, 3) `estimates` of the gains' logarithms differ by more than `threshold` (RMS)."""
        centred = np.asarray(estimates, np.float64)
        centred = centred - centred.mean(axis=0)
        self.active = bool(len(centred) > 1 and np.sqrt((centred**2).mean()) > threshold)
        if self.active:
            self._log_gains = torch.from_numpy(centred.astype(np.float32)).to(self._device)
        return self.active

    def apply(self, frame: Frame, view: int) -> None:
        """Multiply the frame's colour by the view's gains, before the loss is measured."""
        if self.active:
            color = _rows(frame.color)
            color *= self._row_of_gains(view, color)

    def backward(self, frame: Frame, view: int) -> None:
        """After the loss: keep the gains' gradient, and leave the frame's colour and gradient as without gains."""
        if not self.active:
            return
        color, slope = _rows(frame.color), _rows(frame.grad_color)
        # d loss / d log gain = sum over pixels of (d loss / d corrected colour) * corrected colour
        self.gradient = (color * slope).sum(dim=0).view(-1, 3).sum(dim=0)
        gains = self._row_of_gains(view, color)
        slope *= gains
        color /= gains

    def step(self, view: int, rate: float) -> None:
        """Move the view's gains by Adam with step size `rate`, and all so that their mean stays zero."""
        if not self.active:
            return
        slope = torch.nan_to_num(self.gradient, 0.0, 0.0, 0.0)
        self._visits[view] += 1
        first, second = self._first[view], self._second[view]
        first.lerp_(slope, 1.0 - _BETA_1)
        second.lerp_(slope**2, 1.0 - _BETA_2)
        unbiased = second / (1.0 - _BETA_2 ** self._visits[view])
        move = first / (1.0 - _BETA_1 ** self._visits[view]) / (unbiased.sqrt() + _EPSILON)
        self._log_gains[view] -= rate * move
        self._log_gains += rate * move / len(self._visits)

    def _row_of_gains(self, view: int, rows: torch.Tensor) -> torch.Tensor:
        return self._log_gains[view].exp().repeat(rows.shape[1] // 3)


def _rows(image: wp.array) -> torch.Tensor:
    """(H, W * 3) view of an (H, W, 3) image: what multiplies whole rows is several times as fast as per channel."""
    return wp.to_torch(image, requires_grad=False).view(image.shape[0], -1)


def _block_means(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """(B, 3) means over square blocks; what does not fill one at the far edges is left out."""
    rows, columns = image.shape[0] // _BLOCK, image.shape[1] // _BLOCK
    blocks = image[: rows * _BLOCK, : columns * _BLOCK].reshape(rows, _BLOCK, columns, _BLOCK, 3)
    return blocks.mean(axis=(1, 3)).reshape(-1, 3)
