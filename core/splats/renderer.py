"""Renders a scene from its capture's cameras, in world units, for evaluation and previews."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from ..capture.model import View
from ..color.metrics import psnr, ssim
from ..color.spaces import image_to_tensor
from ..files.images import to_bytes
from .calibration.motion_blur import smeared_array
from .gaussians import Gaussians
from .raster import Frame, ParameterSet, RasterCamera, Rasterizer
from .scene_frame import SceneFrame
from .targets import Background

_COMPARED = 4  # pixels around one that take part when views are compared (`AgreementSettings.blur`, and sampling)


class _Loaded(NamedTuple):
    """Gaussians in world units, and as they are drawn: the frame and the parameters on the device."""

    gaussians: Gaussians
    frame: SceneFrame
    parameters: ParameterSet


class SceneRenderer:
    """Renders Gaussians from the cameras of `views`.

    Args:
        rasterizer: renders the Gaussians.
        views: all views of the capture; the methods take an index into them.
        background: behind the Gaussians.
    """

    def __init__(self, rasterizer: Rasterizer, views: Sequence[View], background: Background) -> None:
        self.views = views
        self._rasterizer = rasterizer
        self._background = background
        self._loaded: _Loaded | None = None

    def color(self, gaussians: Gaussians, index: int) -> NDArray[np.uint8]:
        """(H, W, 3) sRGB."""
        return to_bytes(self._render(gaussians, index).color.numpy())

    def depth(self, gaussians: Gaussians, index: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(H, W) mean planar depth in world units, 0 where there is nothing; (H, W) alpha, 0 at masks and beside."""
        loaded, mask = self._load(gaussians), self.views[index].mask
        frame = self._render(gaussians, index)
        alpha = frame.alpha.numpy().copy()
        if mask is not None:
            alpha *= binary_erosion(mask, np.ones((3, 3)), iterations=_COMPARED, border_value=1)
        depth = np.where(alpha > 1e-3, frame.depth.numpy() / np.maximum(alpha, 1e-3), 0.0)
        return (depth / loaded.frame.scale).astype(np.float32), alpha

    def mask(self, index: int) -> NDArray[np.bool_] | None:
        """(H, W) pixels that the photograph covers and its mask leaves, or None if these are all."""
        shown = self.views[index].shown
        return None if shown is None else shown > 127

    def fidelity(self, index: int, rendered: NDArray[np.uint8]) -> dict[str, float]:
        """PSNR in dB and SSIM of a rendering against the photograph over the same background, without what is masked.

        The rendering is first smeared as the photograph is known to be.
        """
        mask = self.views[index].mask
        kept = None if mask is None else torch.from_numpy(mask)
        view = self.views[index]
        if view.smear is not None:
            rendered = to_bytes(smeared_array(rendered / np.float32(255.0), view.smear))
        pictures = (view.blanked(picture) for picture in (self._background.behind(view), rendered))
        photograph, image = (image_to_tensor(picture) for picture in pictures)
        return {"psnr": psnr(photograph, image, mask=kept), "ssim": ssim(photograph, image, mask=kept)}

    def _load(self, gaussians: Gaussians) -> _Loaded:
        if self._loaded is None or self._loaded.gaussians is not gaussians:
            # By the means, as in training: cameras that share a centre give no unit of length.
            frame = SceneFrame.around(self.views, gaussians.means)
            parameters = ParameterSet.from_gaussians(frame.from_world(gaussians), self._rasterizer.device)
            self._loaded = _Loaded(gaussians, frame, parameters)
        return self._loaded

    def _render(self, gaussians: Gaussians, index: int) -> Frame:
        loaded, view = self._load(gaussians), self.views[index]
        c = view.camera
        pose = loaded.frame.world_to_camera(view.world_to_camera)
        camera = RasterCamera(c.width, c.height, c.fx, c.fy, c.cx, c.cy, pose)
        return self._rasterizer.render(loaded.parameters, camera, self._background.color)
