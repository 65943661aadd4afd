"""What the other views say about a view, and the loss that listens to it: weights and the multi-view loss."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..consistency import Consensus
from .multi_view_loss import MultiViewLoss
from .raster import Frame, Loss, Mask, Rasterizer


@dataclass(frozen=True)
class ViewGuide:
    """What the other views say about a view that colours are fitted to.

    Attributes:
        weights: (H, W) float32, how much each pixel counts: less where the photographs vary with the view.
        consensus: the colours that the other views ask for; None leaves the multi-view loss out.
    """

    weights: NDArray[np.float32]
    consensus: Consensus | None = None


class GuidedLoss:
    """The photometric loss, weighted pixel by pixel, and the multi-view loss, as the guides of the views have it.

    Args:
        rasterizer: whose frames are measured.
        guides: one for each view, or None.
        ssim_weight: share of 1 - SSIM in the photometric loss.
        multi_view_weight: λ_mv.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        guides: Sequence[ViewGuide] | None,
        ssim_weight: float,
        multi_view_weight: float,
    ) -> None:
        device = rasterizer.device
        self._rasterizer, self._ssim_weight = rasterizer, ssim_weight
        self._masks = [Mask.of(guide.weights, device) for guide in guides or ()]
        self._pulls = [
            MultiViewLoss(guide.consensus, multi_view_weight, device) if guide.consensus and multi_view_weight else None
            for guide in guides or ()
        ]

    def of(self, view: int) -> Callable[[Frame, wp.array], Loss]:
        """The loss of the view with this number, which fills `frame.grad_color`.

        Its value is that of the photometric part; the multi-view loss is a gradient only.
        """
        return partial(self._measure, view)

    def _measure(self, view: int, frame: Frame, image: wp.array) -> Loss:
        mask = self._masks[view] if self._masks else None
        loss = self._rasterizer.photometric_loss(frame, image, self._ssim_weight, mask)
        pull = self._pulls[view] if self._pulls else None
        if pull is not None:
            pull.add_gradient(frame)
        return loss
