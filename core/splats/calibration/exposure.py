"""Exposure compensation: exposure and white balance that vary between photographs are kept out of the scene's colours.

Each view has a gain per channel, which multiplies the rendered image before it is compared with the photograph. The
log gains have zero mean over the views, so the scene keeps the capture's colours, and three numbers per view are too
few to explain anything else away (richer corrections, such as bilateral grids, fit what is better left to the scene).
Where the photographs agree, nothing is corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import warp as wp
from numpy.typing import NDArray

from ...files.states import SavedState, State
from ..raster import Frame
from .adam import AdamMoments, decayed, restore_moments, snapshot_moments
from .trial_plan import TrialPlan

_BLOCK = 16  # pixels; gains are estimated from the means of square blocks, which blur and noise hardly change
_DARKEST = 0.05  # mean of a block whose ratio is usable
_FEWEST_BLOCKS = 8
_EPSILON = 1e-15  # of Adam


@dataclass(frozen=True)
class ExposurePlan(TrialPlan):
    """When and how gains are fitted.

    Attributes:
        decided_at: fraction of the run after which the photographs are compared with the scene.
        threshold: RMS of the log gains from which correcting them pays. Smaller differences average out over the views;
            correcting the 2 % of an automatic camera on fox gained 0.4 dB on held-out views with their exposure
            compensated, and cost 0.8 dB on them as photographed and a tenth of the time.
        trial: share of the run's steps in each of the two branches of a trial, at least `fewest_trial_steps`.
        least_gain: dB that validation views, their exposures compensated, have to gain in it.
        learning_rate: of the log gains, right after the decision.
        lr_final_factor: factor of the learning rate at the end of the run, reached exponentially.
    """

    decided_at: float = 0.2
    threshold: float = 0.04
    trial: float = 0.04
    fewest_trial_steps: int = 100
    least_gain: float = 0.1
    learning_rate: float = 4e-3
    lr_final_factor: float = 0.1

    def learning_rate_at(self, progress: float) -> float:
        """The learning rate at the fraction `progress` of the run."""
        return decayed(self.learning_rate, self.lr_final_factor, progress, self.decided_at)


def estimate_log_gains(
    rendered: NDArray[np.float32], photograph: NDArray[np.float32], shown: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """(3,) logarithms of the gains that take `rendered` to `photograph`, both (H, W, 3) sRGB in [0, 1].

    The median over blocks of pixels of the ratio of their means, which is robust to blurred or missing parts. Zero if
    the image has too few usable blocks.

    Args:
        shown: (H, W) what of the photograph is looked at; None for all. Blocks with anything else are not used.
    """
    first, second = _block_means(rendered), _block_means(photograph)
    usable = (first > _DARKEST) & (second > _DARKEST)
    if shown is not None:
        usable &= _block_means(np.repeat(shown[..., None], 3, axis=2).astype(np.float32)) == 1.0
    result = np.zeros(3)
    for channel in range(3):
        chosen = usable[:, channel]
        if chosen.sum() >= _FEWEST_BLOCKS:
            result[channel] = np.median(np.log(second[chosen, channel] / first[chosen, channel]))
    return result


class ExposureCorrection:
    """The gains of all views, and their optimiser; inactive until `start` finds that the photographs differ.

    Changes a frame's arrays in place on the frame's device, and reads nothing back from there.

    Args:
        device: of the frames that are corrected.
        views: number of views.

    Attributes:
        active: whether anything is corrected.
        gradient: (3,) of the loss with respect to the logarithms of the gains, from the latest `backward`.
    """

    def __init__(self, device: wp.Device, views: int) -> None:
        self._device = wp.device_to_torch(device)
        self._log_gains = torch.zeros((views, 3), device=self._device)
        self._moments = [AdamMoments(_EPSILON) for _ in range(views)]
        self.gradient = torch.zeros(3, device=self._device)
        self.active = False

    @property
    def log_gains(self) -> NDArray[np.float32]:
        """(V, 3) natural logarithms of the gains, zero in the mean over the views."""
        return self._log_gains.cpu().numpy().copy()

    def snapshot(self) -> State:
        """What `restore` continues from, between two steps."""
        return {"active": self.active, "log_gains": self.log_gains, "moments": snapshot_moments(self._moments, 3)}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is of other views."""
        self.active = saved.value("active", bool)
        gains = saved.array("log_gains", np.float32, len(self._moments), 3)
        self._log_gains = torch.from_numpy(gains).to(self._device)
        restore_moments(self._moments, 3, saved.part("moments"), self._on_device)

    def _on_device(self, row: NDArray[np.float64]) -> torch.Tensor:
        return torch.from_numpy(row.astype(np.float32)).to(self._device)

    def start(self, estimates: Sequence[NDArray[np.float64]], threshold: float) -> bool:
        """Correct from now on if the (V, 3) estimated log gains differ by more than `threshold` (RMS)."""
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
        """After the loss: keep the gains' gradient, and take the gains out of the frame's colour and gradient."""
        if not self.active:
            return
        color, slope = _rows(frame.color), _rows(frame.grad_color)
        # d loss / d log gain = sum over pixels of (d loss / d corrected colour) * corrected colour
        self.gradient = (color * slope).sum(dim=0).view(-1, 3).sum(dim=0)
        gains = self._row_of_gains(view, color)
        slope *= gains
        color /= gains

    def step(self, view: int, learning_rate: float) -> None:
        """An Adam step of the view's gains; then all gains are shifted so that their mean stays zero."""
        if not self.active:
            return
        mean, scale = self._moments[view].update(torch.nan_to_num(self.gradient, 0.0, 0.0, 0.0))
        move = mean / scale
        self._log_gains[view] -= learning_rate * move
        self._log_gains += learning_rate * move / len(self._moments)

    def _row_of_gains(self, view: int, rows: torch.Tensor) -> torch.Tensor:
        return self._log_gains[view].exp().repeat(rows.shape[1] // 3)


def _rows(image: wp.array) -> torch.Tensor:
    """(H, W * 3) view of an (H, W, 3) image: multiplying whole rows is several times as fast as per channel."""
    return wp.to_torch(image, requires_grad=False).view(image.shape[0], -1)


def _block_means(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """(B, 3) means over square blocks; incomplete ones at the far edges are left out."""
    rows, columns = image.shape[0] // _BLOCK, image.shape[1] // _BLOCK
    blocks = image[: rows * _BLOCK, : columns * _BLOCK].reshape(rows, _BLOCK, columns, _BLOCK, 3)
    return blocks.mean(axis=(1, 3)).reshape(-1, 3)
