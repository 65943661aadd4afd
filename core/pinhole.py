"""The camera that both sides of the package know: an ideal pinhole. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class PinholeCamera:
    """Intrinsics of an undistorted view, in pixels; centres at +0.5 (OpenCV axes: x right, y down, z forward)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def scaled(self, width: int, height: int) -> PinholeCamera:
        """The same camera for an image resampled to `width` x `height`."""
        sx, sy = width / self.width, height / self.height
        return PinholeCamera(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)

    def zoomed(self, factor: float) -> PinholeCamera:
        """The same camera with focal lengths that many times as long."""
        return replace(self, fx=self.fx * factor, fy=self.fy * factor)
