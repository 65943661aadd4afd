"""Motion blur: the line along which a photograph was smeared while it was exposed is kept out of the scene.

Each view has a line, of two parameters, along which its rendering is averaged before it is compared with the
photograph; so the scene may be sharper than the photographs. That is what is left of a camera's motion during an
exposure if it is short, steady, and moves everything in the image alike (as in Fergus et al. 2006, whose kernels are
free, and unlike Zhao et al. 2024, who render a whole path). The sign of a line means nothing, and its middle is where
the camera's pose is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import warp as wp
from numpy.typing import NDArray
from torch.nn import functional

from ...files.states import SavedState, State
from ..raster import Frame
from .adam import AdamMoments, decayed, restore_moments, snapshot_moments
from .trial_plan import TrialPlan

_SAMPLES_PER_PIXEL = 2
_EPSILON = 1e-12  # of Adam
_LONGEST = 0.12  # of the longer side: longer lines are no longer the same everywhere in the image
_GRID_SIDE, _SEARCH_SIDE = 120, 240  # pixels of the longer side at which lines are searched, first and then around
_DIRECTIONS = 8
_LENGTHS = (0.006, 0.012, 0.024, 0.048, 0.096)  # of the longer side
_ROUNDS = 4  # of the search around a line
_SHARPENING = 3.0  # of gradients: detail that a line averages away altogether counts four times


@dataclass(frozen=True)
class MotionBlurPlan(TrialPlan):
    """When and how lines are fitted.

    Attributes:
        decided_at: fraction of the run after which the photographs are compared with the scene.
        least_steps: shortest run with that comparison.
        probed_views: largest number of views in it.
        threshold: pixels; where the lines of a quarter of the views are as long, it is tried whether they help. A
            rough scene is softer than sharp photographs, so averaging it only makes it worse.
        trial: share of the run's steps in each of the two branches of a trial, at least `fewest_trial_steps`.
        least_gain: dB that validation views have to gain in it, each compared through the line that suits it best.
        learning_rate: of the lines, right after the decision: of their length, or of a pixel for shorter ones.
        lr_final_factor: factor of the learning rate at the end of the run, reached exponentially.
    """

    decided_at: float = 0.22
    least_steps: int = 300
    probed_views: int = 12
    threshold: float = 0.8
    trial: float = 0.08
    fewest_trial_steps: int = 200
    least_gain: float = 0.1
    learning_rate: float = 0.3
    lr_final_factor: float = 0.1

    def learning_rate_at(self, progress: float) -> float:
        """The learning rate at the fraction `progress` of the run."""
        return decayed(self.learning_rate, self.lr_final_factor, progress, self.decided_at)


def line_kernel(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, K) weights, K odd, of the mean along a line, as samples between which pixels are interpolated linearly.

    Args:
        line: (2,) from one end to the other, right and down, pixels.
    """
    along, columns, rows = _samples(line)
    return _tent(rows, along * line[1]).T @ _tent(columns, along * line[0]) / len(along)


def line_slopes(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, K, K) derivatives of `line_kernel` with respect to the line."""
    along, columns, rows = _samples(line)
    right, down = _tent(columns, along * line[0]), _tent(rows, along * line[1])
    by_right, by_down = (
        along[:, None] * np.where(np.abs(offset) < 1.0, np.sign(offset), 0.0)
        for offset in (columns - along[:, None] * line[0], rows - along[:, None] * line[1])
    )
    return np.stack([down.T @ by_right, by_down.T @ right]) / len(along)


def _samples(line: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places along a line, from -0.5 to 0.5, and the offsets of a kernel's columns and rows."""
    radius = int(np.ceil(np.abs(line).max() / 2.0)) + 1
    along = np.linspace(-0.5, 0.5, max(int(np.ceil(_SAMPLES_PER_PIXEL * np.linalg.norm(line))), 2) + 1)
    offsets = np.arange(-radius, radius + 1.0)
    return along, offsets, offsets


def _tent(offsets: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.maximum(1.0 - np.abs(offsets - places[:, None]), 0.0)


def smeared(image: torch.Tensor, line: NDArray[np.float64]) -> torch.Tensor:
    """(H, W, C) image averaged along a line; beyond its border it is taken to go on as there."""
    return _filtered(image, line_kernel(line)[None])[..., 0]


def _filtered(image: torch.Tensor, kernels: NDArray[np.float64]) -> torch.Tensor:
    """(H, W, C, F) the image filtered with each of (F, K, K) kernels."""
    weights = torch.from_numpy(kernels.astype(np.float32)).to(image.device)[:, None]
    radius = kernels.shape[-1] // 2
    padded = functional.pad(image.permute(2, 0, 1)[:, None], [radius] * 4, mode="replicate")
    return functional.conv2d(padded, weights).permute(2, 3, 0, 1)


def _spread(slope: torch.Tensor, line: NDArray[np.float64]) -> torch.Tensor:
    """The adjoint of `smeared`: (H, W, C) gradient of the image from that of the smeared one."""
    kernel = line_kernel(line)  # symmetric about its middle
    radius = kernel.shape[-1] // 2
    wide = functional.pad(slope.permute(2, 0, 1)[:, None], [2 * radius] * 4)
    wide = functional.conv2d(wide, torch.from_numpy(kernel.astype(np.float32)).to(slope.device)[None, None])[:, 0]
    for dim in (1, 2):  # what fell beyond the border belongs to the border
        size = wide.shape[dim] - 2 * radius
        inner = wide.narrow(dim, radius, size).clone()
        inner.narrow(dim, 0, 1).add_(wide.narrow(dim, 0, radius).sum(dim, keepdim=True))
        inner.narrow(dim, size - 1, 1).add_(wide.narrow(dim, radius + size, radius).sum(dim, keepdim=True))
        wide = inner
    return wide.permute(1, 2, 0)


def sharpened(gradient: torch.Tensor, line: NDArray[np.float64]) -> torch.Tensor:
    """(H, W, C) gradient of an image that is compared through a line, for detail to come back sooner.

    A line that leaves a share κ of a pattern leaves that share of its gradient as well, so the detail that is missing
    is what a descent is slowest to find. Here the share is multiplied by 1 + `_SHARPENING` (1 - κ), which is positive
    for every pattern (κ is from -0.22 to 1): the loss still falls along it, and it vanishes where the gradient does.
    """
    return torch.lerp(smeared(gradient, line), gradient, 1.0 + _SHARPENING)


def smeared_array(image: NDArray[np.float32], line: NDArray[np.float64] | None) -> NDArray[np.float32]:
    """`smeared`, for arrays; the image itself without a line."""
    return image if line is None or not np.any(line) else smeared(torch.from_numpy(image), line).numpy()


def best_line(
    rendered: NDArray[np.float32],
    photograph: NDArray[np.float32],
    shown: NDArray[np.bool_] | None = None,
    near: NDArray[np.float64] | None = None,
    device: wp.Device | str = "cpu",
) -> NDArray[np.float64]:
    """(2,) the line that makes `rendered` most like `photograph`, both (H, W, 3) in [0, 1]; zeros for none.

    A search over lengths and directions in small grey images, and around the best of them in larger ones.

    Args:
        shown: (H, W) what of the photograph is looked at; None for all.
        near: (2,) a line to search around instead.
        device: that does the search.
    """

    def reduced(side: int) -> _GreyPair:
        return _GreyPair.of(rendered, photograph, shown, side, device)

    line = _line_of_grid(reduced(_GRID_SIDE)) if near is None else near
    if not np.any(line):
        return np.zeros(2)
    pair, ratio, turn = reduced(_SEARCH_SIDE), 2.0**0.5, np.pi / _DIRECTIONS / 2.0
    length, angle = float(np.hypot(*line)), float(np.arctan2(line[1], line[0]))
    least = pair.error(length, angle)
    for _ in range(_ROUNDS):
        around = [(length * ratio, angle), (length / ratio, angle), (length, angle + turn), (length, angle - turn)]
        errors = [pair.error(*candidate) for candidate in around]
        best = int(np.argmin(errors))
        if errors[best] < least:
            (length, angle), least = around[best], errors[best]
        else:
            ratio, turn = ratio**0.5, turn / 2.0
    longest = longest_line(rendered.shape[1], rendered.shape[0])
    return _polar(min(length, longest), angle) if least < pair.error(0.0, 0.0) else np.zeros(2)


def _line_of_grid(pair: _GreyPair) -> NDArray[np.float64]:
    lengths = (share * max(pair.first.shape[:2]) * pair.factor for share in _LENGTHS)
    grid = [(0.0, 0.0), *((length, turn * np.pi / _DIRECTIONS) for length in lengths for turn in range(_DIRECTIONS))]
    return _polar(*grid[int(np.argmin([pair.error(*candidate) for candidate in grid]))])


def _polar(length: float, angle: float) -> NDArray[np.float64]:
    return length * np.array([np.cos(angle), np.sin(angle)])


@dataclass(frozen=True)
class _GreyPair:
    """A rendering and a photograph in grey, reduced by `factor`."""

    first: torch.Tensor
    second: torch.Tensor
    shown: torch.Tensor | None
    factor: int

    @classmethod
    def of(
        cls,
        rendered: NDArray[np.float32],
        photograph: NDArray[np.float32],
        shown: NDArray[np.bool_] | None,
        side: int,
        device: wp.Device | str,
    ) -> _GreyPair:
        factor, on = max(round(max(rendered.shape[:2]) / side), 1), wp.device_to_torch(device)
        mask = None if shown is None else (_reduced(shown[..., None].astype(np.float32), factor) == 1.0).to(on)
        return cls(_reduced(rendered, factor).to(on), _reduced(photograph, factor).to(on), mask, factor)

    def error(self, length: float, angle: float) -> float:
        """Mean square difference, with the rendering smeared along a line in pixels of the full image."""
        line = _polar(length, angle) / self.factor
        apart = (smeared(self.first, line) if length else self.first) - self.second
        return float((apart if self.shown is None else apart[self.shown]).square().mean())


class MotionBlur:
    """The lines of all views, and their optimiser; inactive until `start`.

    Args:
        device: of the frames.
        views: number of views.

    Attributes:
        active: whether renderings are averaged.
    """

    def __init__(self, device: wp.Device, views: int) -> None:
        self._device = wp.device_to_torch(device)
        self.lines = np.zeros((views, 2))  # in pixels of the full images
        self._moments = [AdamMoments(_EPSILON, shared=True) for _ in range(views)]
        self._sharp: torch.Tensor | None = None
        self._gradient = np.zeros(2)
        self.active = False

    def start(self, lines: Sequence[NDArray[np.float64]]) -> None:
        """Average from now on along these (V, 2) lines, in pixels of the full images."""
        self.lines = np.asarray(lines, np.float64).copy()
        self._moments = [AdamMoments(_EPSILON, shared=True) for _ in self.lines]
        self.active = True

    @property
    def length(self) -> float:
        """Pixels; a quarter of the lines are as long or longer."""
        return typical_length(self.lines)

    def line(self, view: int) -> NDArray[np.float64] | None:
        """(2,) of a view, in pixels of the full image; None where nothing is averaged."""
        return self.lines[view] if self.active else None

    def apply(self, frame: Frame, view: int, reduction: float) -> None:
        """Average the frame's colour along the view's line, before the loss is measured.

        Args:
            reduction: factor by which the frame is reduced.
        """
        self._sharp = None
        if not self.active or not np.any(self.lines[view]):
            return
        color = wp.to_torch(frame.color, requires_grad=False)
        self._sharp = color.clone()
        color.copy_(smeared(self._sharp, self.lines[view] / reduction))

    def backward(self, frame: Frame, view: int, reduction: float) -> None:
        """After the loss: keep the line's gradient, and take the line out of the frame's colour and gradient.

        The gradient is `sharpened`.
        """
        if self._sharp is None:
            self._gradient = np.zeros(2)
            return
        slope, line = wp.to_torch(frame.grad_color, requires_grad=False), self.lines[view] / reduction
        by_line = _filtered(self._sharp, line_slopes(line)).mul_(slope[..., None]).sum(dim=(0, 1, 2))
        self._gradient = by_line.double().cpu().numpy()
        slope.copy_(sharpened(_spread(slope, line), line))
        wp.to_torch(frame.color, requires_grad=False).copy_(self._sharp)
        self._sharp = None

    def step(self, view: int, learning_rate: float, longest: float) -> None:
        """An Adam step of the view's line, with one second moment for both parameters.

        Args:
            learning_rate: relative to the line, or to a pixel for a shorter one.
            longest: pixels.
        """
        if not self.active or not np.any(self._gradient) or not np.isfinite(self._gradient).all():
            return
        mean, scale = self._moments[view].update(self._gradient)
        length = max(float(np.linalg.norm(self.lines[view])), 1.0)
        self.lines[view] -= learning_rate * length * mean / scale
        self.lines[view] *= min(longest / max(float(np.linalg.norm(self.lines[view])), 1e-12), 1.0)

    def snapshot(self) -> State:
        """What `restore` continues from, between two steps."""
        return {"active": self.active, "lines": self.lines, "moments": snapshot_moments(self._moments, 2)}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is of other views."""
        self.active = saved.value("active", bool)
        self.lines = saved.array("lines", np.float64, len(self._moments), 2)
        restore_moments(self._moments, 2, saved.part("moments"), np.copy)


def typical_length(lines: Sequence[NDArray[np.float64]] | NDArray[np.float64]) -> float:
    """Pixels; a quarter of the (V, 2) lines are as long or longer."""
    return float(np.percentile(np.linalg.norm(np.asarray(lines), axis=1), 75.0))


def longest_line(width: int, height: int) -> float:
    """Pixels, of a line in an image of this size."""
    return _LONGEST * max(width, height)


def _reduced(image: NDArray[np.float32], factor: int) -> torch.Tensor:
    """(H // factor, W // factor, 1) mean over square blocks and channels."""
    height, width, channels = image.shape[0] // factor, image.shape[1] // factor, image.shape[2]
    blocks = image[: height * factor, : width * factor].reshape(height, factor, width, factor, channels)
    return torch.from_numpy(np.ascontiguousarray(blocks.mean(axis=(1, 3, 4), dtype=np.float32)))[..., None]
