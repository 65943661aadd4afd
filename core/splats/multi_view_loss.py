"""The multi-view consistency loss L_mv (Hu and Xiao 2026, Eq. 9) as a gradient image for the rasteriser.

    L_mv = Σ_p w(p) ρ(render(p) - consensus(p)) / (3 Σ_p w(p)),    ρ(d) = sqrt(d² + ε²)

The consensus is the robust mean of what the neighbouring views show at the same surface point, so the sum over pairs of
views of Eq. 9 becomes one image a view that is made once, and a view that drifted far does not pull the others along.
"""

# No `from __future__ import annotations`: Warp evaluates the annotations of kernels, which are values, not types.
# mypy: disable-error-code="valid-type, misc, index"
import warp as wp

from ..consistency import Consensus
from .raster import Frame

_SOFTNESS = 2.0 / 255.0
"""ε: differences below it are resampling rather than drift, and are pulled less."""

_Bytes3 = wp.array3d(dtype=wp.uint8)
_Floats3 = wp.array3d(dtype=wp.float32)
_Floats2 = wp.array2d(dtype=wp.float32)


@wp.kernel(enable_backward=False)
def _add_pull(
    color: _Floats3, consensus: _Bytes3, weights: _Floats2, scale: wp.float32, softness: wp.float32, gradient: _Floats3
):
    row, column = wp.tid()
    weight = weights[row, column] * scale
    if weight > 0.0:
        for channel in range(3):
            apart = color[row, column, channel] - wp.float32(consensus[row, column, channel]) / 255.0
            gradient[row, column, channel] += weight * apart / wp.sqrt(apart * apart + softness * softness)


class MultiViewLoss:
    """L_mv of one view.

    Args:
        consensus: of the view.
        strength: λ_mv, L_mv's weight beside the photometric loss.
        device: of the frames.
    """

    def __init__(self, consensus: Consensus, strength: float, device: wp.Device) -> None:
        total = float(consensus.weights.sum())
        self._scale = strength / (3.0 * total) if total > 0.0 else 0.0
        self._colors = wp.array(consensus.colors, dtype=wp.uint8, device=device)
        self._weights = wp.array(consensus.weights, dtype=wp.float32, device=device)

    def add_gradient(self, frame: Frame) -> None:
        """Add strength · dL_mv/dcolor to `frame.grad_color`, which the photometric loss has filled."""
        if self._scale:
            inputs = [frame.color, self._colors, self._weights, self._scale, _SOFTNESS, frame.grad_color]
            wp.launch(_add_pull, dim=self._weights.shape, inputs=inputs, device=self._weights.device)
