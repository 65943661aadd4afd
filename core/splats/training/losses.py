"""Losses of colours fitted to enhanced views: photometric, weighted by pixel; multi-view, L_mv; and contrast."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from ...capture.model import View
from ...color.matrices import LinearSimulation
from ...color.noise import typical_noise
from ...consistency import Consensus
from ..raster import ContrastHinge, ContrastPlan, Frame, Loss, Mask, Rasterizer
from ..targets import Background, TrainingView

# The annotations of kernels are values that Warp evaluates.
# mypy: disable-error-code="valid-type, misc, index"

_CELL, _UNKNOWN = wp.constant(Consensus.CELL), wp.constant(Consensus.UNKNOWN)

_SOFTNESS = 2.0 / 255.0
"""ε of the multi-view loss: smaller differences are resampling rather than drift, and are pulled less."""


@dataclass(frozen=True)
class ViewGuide:
    """What the other views say about a view that colours are fitted to.

    Attributes:
        weights: (H, W) uint8, weight of each pixel, 255 = 1: lower where the photographs vary with the view.
        consensus: colours that the views agree on; None leaves out the multi-view loss.
    """

    weights: NDArray[np.uint8]
    consensus: Consensus | None = None


@dataclass(frozen=True)
class SeenContrast:
    """The contrast that a layer is to keep, and for whom.

    Attributes:
        plan: of the contrast hinge.
        photographs: the views with their photographs, which say where there is contrast.
        observer: S of the layer; None for normal vision.
    """

    plan: ContrastPlan
    photographs: Sequence[View]
    observer: LinearSimulation | None = None


class KeptContrast:
    """The contrast hinge over a number of views.

    Args:
        rasterizer: that renders the frames.
        plan: of the hinge.
        photographs: (H, W, 3) device images, one per view, which say where there is contrast, and their (H, W) masks.
        observer: S of the layer; None for normal vision.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        plan: ContrastPlan,
        photographs: Iterable[tuple[wp.array, NDArray[np.bool_] | None]],
        observer: LinearSimulation | None = None,
    ) -> None:
        self._hinge = ContrastHinge(rasterizer, plan, observer)
        self._pairs = [_without_masked(self._hinge.pairs(image), mask) for image, mask in photographs]

    @classmethod
    def of(cls, rasterizer: Rasterizer, contrast: SeenContrast, background: Background) -> KeptContrast:
        """That of a layer, whose photographs are composited over `background`."""
        images = (
            (wp.array(background.behind(view), dtype=wp.uint8, device=rasterizer.device), view.mask)
            for view in contrast.photographs
        )
        plan = contrast.plan.beyond(typical_noise([view.image for view in contrast.photographs]))
        return cls(rasterizer, plan, images, contrast.observer)

    def add_gradient(self, view: int, frame: Frame, target: wp.array) -> None:
        """Add the gradient of a view, by its index, to `frame.grad_color`, which the photometric loss has filled."""
        self._hinge.add_gradient(frame, target, self._pairs[view])


def _without_masked(pairs: wp.array, mask: NDArray[np.bool_] | None) -> wp.array:
    """(H, W) `ContrastHinge.pairs` without those of pixels that are masked or beside such."""
    if mask is None:
        return pairs
    kept = pairs.numpy() * binary_erosion(mask, np.ones((3, 3)), border_value=1)
    return wp.array(kept.astype(np.uint8), dtype=wp.uint8, device=pairs.device)


class GuidedLoss:
    """The photometric loss weighted by pixel and the multi-view loss, as the guides ask, and the contrast hinge.

    Args:
        rasterizer: that renders the frames.
        guides: one per view, or None.
        ssim_weight: weight of 1 - SSIM in the photometric loss.
        multi_view_weight: λ_mv.
        contrast: to keep; None leaves out the contrast hinge.
        noise: standard deviation of the views' noise, in [0, 1].
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        guides: Sequence[ViewGuide] | None,
        ssim_weight: float,
        multi_view_weight: float,
        contrast: KeptContrast | None = None,
        noise: float = 0.0,
    ) -> None:
        device = rasterizer.device
        self._rasterizer, self.ssim_weight, self._noise = rasterizer, ssim_weight, noise
        self._masks = [Mask.of(guide.weights, device) for guide in guides or ()]
        self._pulls = [
            MultiViewLoss(guide.consensus, guide.weights, multi_view_weight, device)
            if guide.consensus and multi_view_weight
            else None
            for guide in guides or ()
        ]
        self._contrast = contrast

    @classmethod
    def of_photographs(
        cls,
        rasterizer: Rasterizer,
        views: Sequence[TrainingView],
        ssim_weight: float,
        plan: ContrastPlan,
        noise: float = 0.0,
    ) -> GuidedLoss:
        """The photometric loss of `views`, which have this noise, with the contrast hinge for normal vision."""
        photographs = ((view.at(1)[0], view.looked_at()) for view in views)
        contrast = KeptContrast(rasterizer, plan.beyond(noise), photographs)
        return cls(rasterizer, None, ssim_weight, 0.0, contrast, noise)

    def of(self, view: int) -> Callable[[Frame, wp.array, Mask | None], Loss]:
        """The loss of a view, by its index, which fills `frame.grad_color`; guides take the place of a mask.

        Its value is that of the photometric part; the multi-view loss and the hinge contribute a gradient only.
        """
        return partial(self._measure, view)

    def _measure(self, view: int, frame: Frame, image: wp.array, mask: Mask | None) -> Loss:
        mask = self._masks[view] if self._masks else mask
        loss = self._rasterizer.photometric_loss(frame, image, self.ssim_weight, mask, noise=self._noise)
        pull = self._pulls[view] if self._pulls else None
        if pull is not None:
            pull.add_gradient(frame, image)
        if self._contrast is not None:
            self._contrast.add_gradient(view, frame, image)
        return loss


class MultiViewLoss:
    """L_mv of one view: the distance to the consensus, sqrt(d² + ε²), averaged over channels and weighted pixels.

    Args:
        consensus: of the view; pixels of which it knows nothing do not count.
        weights: (H, W) uint8 of the view's pixels, 255 = 1.
        strength: λ_mv, L_mv's weight beside the photometric loss.
        device: of the frames.
    """

    def __init__(self, consensus: Consensus, weights: NDArray[np.uint8], strength: float, device: wp.Device) -> None:
        total = float(weights.sum(where=consensus.known(*weights.shape), dtype=np.int64))
        self._scale = strength / (3.0 * total) if total > 0.0 else 0.0
        # Shared where that is possible: there are as many as views.
        self._shifts = wp.array(consensus.shifts, dtype=wp.int8, device=device, copy=False)
        self._weights = wp.array(weights, dtype=wp.uint8, device=device, copy=False)

    def add_gradient(self, frame: Frame, image: wp.array) -> None:
        """Add strength · dL_mv/dcolor to `frame.grad_color`, which the photometric loss has filled.

        Args:
            frame: a rendering of the view.
            image: (H, W, 3) uint8, the view's own picture, which the consensus shifts.
        """
        if self._scale:
            inputs = [frame.color, image, self._shifts, self._weights, self._scale, _SOFTNESS, frame.grad_color]
            wp.launch(_add_pull, dim=self._weights.shape, inputs=inputs, device=self._weights.device)


@wp.kernel(enable_backward=False)
def _add_pull(
    color: wp.array3d(dtype=wp.float32),
    image: wp.array3d(dtype=wp.uint8),
    shifts: wp.array3d(dtype=wp.int8),
    weights: wp.array2d(dtype=wp.uint8),
    scale: wp.float32,
    softness: wp.float32,
    gradient: wp.array3d(dtype=wp.float32),
):
    row, column = wp.tid()
    cell_row, cell_column = row // _CELL, column // _CELL
    weight = wp.float32(weights[row, column]) * scale
    if weight > 0.0 and wp.int32(shifts[cell_row, cell_column, 0]) != _UNKNOWN:
        for channel in range(3):
            own, shift = wp.int32(image[row, column, channel]), wp.int32(shifts[cell_row, cell_column, channel])
            apart = color[row, column, channel] - wp.float32(wp.clamp(own + shift, 0, 255)) / 255.0
            gradient[row, column, channel] += weight * apart / wp.sqrt(apart * apart + softness * softness)
