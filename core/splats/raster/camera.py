"""The camera a rasteriser renders from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

# The perspective is linearised within 1.3 times the field of view (Kerbl et al. 2023): beyond it a Gaussian's footprint
# would grow without bound.
_FIELD_OF_VIEW_MARGIN = 0.3


@dataclass(frozen=True)
class RasterCamera:
    """A pinhole camera in OpenCV axes; pixel centres lie at +0.5.

    Attributes:
        width, height: of the image, pixels.
        fx, fy, cx, cy: focal lengths and principal point, pixels.
        world_to_camera: (4, 4), rigid.
        near: smallest depth that is drawn, scene units.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: NDArray[np.float64] = field(repr=False)
    near: float = 0.05

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) camera centre in the world."""
        matrix = np.asarray(self.world_to_camera, np.float64)
        return -matrix[:3, :3].T @ matrix[:3, 3]

    def zoomed(self, factor: float) -> RasterCamera:
        """The same camera with focal lengths that many times as long."""
        return replace(self, fx=self.fx * factor, fy=self.fy * factor)

    def packed(self, background: tuple[float, float, float]) -> NDArray[np.float32]:
        """The floats of `Camera` in projection.h, in its order."""
        matrix = np.asarray(self.world_to_camera, np.float64)
        margin_x = _FIELD_OF_VIEW_MARGIN * 0.5 * self.width / self.fx
        margin_y = _FIELD_OF_VIEW_MARGIN * 0.5 * self.height / self.fy
        return np.array(
            [
                *matrix[:3, :3].ravel(),
                *matrix[:3, 3],
                *self.center,
                self.fx,
                self.fy,
                self.cx,
                self.cy,
                self.near,
                -self.cx / self.fx - margin_x,
                (self.width - self.cx) / self.fx + margin_x,
                -self.cy / self.fy - margin_y,
                (self.height - self.cy) / self.fy + margin_y,
                *background,
            ],
            np.float32,
        )


CAMERA_FLOATS = 27  # length of `packed`
