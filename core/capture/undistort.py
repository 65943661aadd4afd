"""Undistortion: a pinhole for a distorted camera, and the map from its pixels to the photograph's."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import InputError
from .model import PinholeCamera

# Beyond 60 degrees off the axis a pinhole image stretches more than it shows; fisheye photographs are cut there.
_MAX_TANGENT = np.tan(np.radians(60.0))
# Rays within 0.06 degrees of the image plane, or behind it, count as infinitely far out.
_MIN_COSINE = 1e-3
_BORDER_SAMPLES = 200
# A pixel of the photograph must come back to itself through unprojection and projection, in pixels.
_ROUND_TRIP = 0.1
# Parts of the image, from each side, that may lie where a polynomial folds over or a fisheye looks behind itself.
_INSETS = tuple(np.arange(0.0, 0.42, 0.02))
_NO_DISTORTION = 0.01
_MAPS_KEPT = 4


def is_pinhole(camera: pycolmap.Camera) -> bool:
    """Whether the photograph is a pinhole image already, to a hundredth of a pixel along the border.

    Measured, because pycolmap calls a fisheye without further distortion undistorted as well.
    """
    nominal = _nominal_pinhole(camera)
    border = _border(camera.width, camera.height, 0.0)
    rays = np.ones((len(border), 3))
    rays[:, :2] = (border - (nominal.cx, nominal.cy)) / (nominal.fx, nominal.fy)
    return bool(np.abs(_project(camera, rays) - border).max() < _NO_DISTORTION)


def choose_pinhole(camera: pycolmap.Camera, *, where: str | Path) -> PinholeCamera:
    """A pinhole of the same size whose image the photograph fills to the border.

    It is the largest window of the photograph's aspect in the rectangle inscribed into the undistorted border; the
    ratio of the focal lengths stays, the principal point stays where the window allows it.

    Raises:
        InputError: the distortion cannot be inverted anywhere near the border.
    """
    width, height = camera.width, camera.height
    if is_pinhole(camera):
        return _nominal_pinhole(camera)
    left, right, top, bottom = _inscribed_rectangle(camera, where)
    ratio = camera.focal_length_y / camera.focal_length_x
    focal_x = max(width / (right - left), height / (bottom - top) / ratio)
    focal_y = focal_x * ratio
    window_x, window_y = width / focal_x, height / focal_y
    start_x = np.clip(-camera.principal_point_x / focal_x, left, right - window_x)
    start_y = np.clip(-camera.principal_point_y / focal_y, top, bottom - window_y)
    return PinholeCamera(width, height, focal_x, focal_y, float(-start_x * focal_x), float(-start_y * focal_y))


def source_pixels(camera: pycolmap.Camera, pinhole: PinholeCamera) -> NDArray[np.float32]:
    """(H, W, 2) positions in the photograph, as fractions of its width and height, of the pinhole's pixel centres."""
    x = (np.arange(pinhole.width) + 0.5 - pinhole.cx) / pinhole.fx
    y = (np.arange(pinhole.height) + 0.5 - pinhole.cy) / pinhole.fy
    positions = np.empty((pinhole.height, pinhole.width, 2), np.float32)
    rays = np.ones((pinhole.width, 3))
    rays[:, 0] = x
    for row, ray_y in enumerate(y):
        rays[:, 1] = ray_y
        positions[row] = _project(camera, rays) / (camera.width, camera.height)
    return positions


@dataclass(frozen=True)
class _Map:
    """Where the pixels of a view lie in a photograph.

    Attributes:
        camera: the photograph's; kept so that its id is not given to another while the map is.
        pinhole: of the view.
        positions: (H, W, 2) fractions of width and height; None where the photograph is a pinhole image already.
        outside: (H, W) bool, pixels that the photograph does not show; None where there are none.
    """

    camera: pycolmap.Camera
    pinhole: PinholeCamera
    positions: NDArray[np.float32] | None = None
    outside: NDArray[np.bool_] | None = None


class Undistorter:
    """Resamples photographs to pinhole images, with a map computed once for a camera and a size. Thread-safe."""

    def __init__(self) -> None:
        self._maps: OrderedDict[tuple[int, int, int], _Map] = OrderedDict()
        self._lock = Lock()

    def apply(
        self, camera: pycolmap.Camera, image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None, *, where: str | Path
    ) -> tuple[PinholeCamera, NDArray[np.uint8], NDArray[np.uint8] | None]:
        """Undistort `image`, a possibly smaller version of what `camera` took.

        Returns:
            The pinhole camera at the image's size, the image, and the coverage or None where it is complete.

        Raises:
            InputError: the distortion cannot be inverted.
        """
        height, width = image.shape[:2]
        chosen = self._map(camera, width, height, where)
        if chosen.positions is None:
            return chosen.pinhole, image, alpha
        undistorted = _remap(image, chosen.positions)
        if alpha is not None:
            alpha = _remap(alpha[..., None], chosen.positions)[..., 0]
        if chosen.outside is not None:
            alpha = np.where(chosen.outside, 0, 255 if alpha is None else alpha).astype(np.uint8)
        if alpha is not None and alpha.min() == 255:
            alpha = None
        return chosen.pinhole, undistorted, alpha

    def apply_to_mask(
        self, camera: pycolmap.Camera, mask: NDArray[np.uint8], *, where: str | Path
    ) -> NDArray[np.uint8]:
        """Undistort an (H, W) mask of an image that `camera` took, as `apply` does the image."""
        height, width = mask.shape
        chosen = self._map(camera, width, height, where)
        return mask if chosen.positions is None else _remap(mask[..., None], chosen.positions)[..., 0]

    def _map(self, camera: pycolmap.Camera, width: int, height: int, where: str | Path) -> _Map:
        key = (id(camera), width, height)
        with self._lock:
            if key in self._maps:
                self._maps.move_to_end(key)
            else:
                self._maps[key] = _make_map(camera, width, height, where)
                if len(self._maps) > _MAPS_KEPT:
                    self._maps.popitem(last=False)
            return self._maps[key]


def _make_map(camera: pycolmap.Camera, width: int, height: int, where: str | Path) -> _Map:
    pinhole = choose_pinhole(camera, where=where).scaled(width, height)
    if is_pinhole(camera):
        return _Map(camera, pinhole)
    positions = source_pixels(camera, pinhole)
    half_pixel = 0.5 / np.array([width, height], np.float32)
    inside = ((positions >= -half_pixel) & (positions <= 1.0 + half_pixel)).all(axis=2)
    return _Map(camera, pinhole, np.nan_to_num(positions), None if inside.all() else ~inside)


def _project(camera: pycolmap.Camera, rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 2) pixels of (N, 3) rays; NaN for those behind the camera."""
    return np.asarray(camera.img_from_cam(rays))


def _nominal_pinhole(camera: pycolmap.Camera) -> PinholeCamera:
    """The camera without its distortion."""
    return PinholeCamera(
        camera.width,
        camera.height,
        camera.focal_length_x,
        camera.focal_length_y,
        camera.principal_point_x,
        camera.principal_point_y,
    )


def _inscribed_rectangle(camera: pycolmap.Camera, where: str | Path) -> tuple[float, float, float, float]:
    """(left, right, top, bottom) on the plane at depth 1 of a rectangle that the photograph covers."""
    for inset in _INSETS:
        border = _border(camera.width, camera.height, inset)
        rays = np.asarray(camera.cam_ray_from_img(border))
        if not np.isfinite(rays).all():
            continue
        ahead = rays[:, 2] > _MIN_COSINE
        back = _project(camera, rays[ahead])
        if ahead.any() and not np.abs(back - border[ahead]).max() < _ROUND_TRIP:
            continue
        # What a fisheye sees sideways or behind lies outside every window.
        depth = np.where(ahead, rays[:, 2], _MIN_COSINE)
        tangents = rays[:, :2] / depth[:, None]
        left, right, top, bottom = np.split(tangents, 4)
        limits = (left[:, 0].max(), right[:, 0].min(), top[:, 1].max(), bottom[:, 1].min())
        clipped = np.clip(limits, -_MAX_TANGENT, _MAX_TANGENT)
        if clipped[0] < clipped[1] and clipped[2] < clipped[3]:
            return tuple(clipped)
    raise InputError(
        "the lens distortion cannot be inverted",
        where=where,
        remedy="calibrate the camera again or undistort the photographs",
    )


def _border(width: int, height: int, inset: float) -> NDArray[np.float64]:
    """Pixels along the left, right, top and bottom border, (4 * samples, 2)."""
    x0, x1, y0, y1 = width * inset, width * (1.0 - inset), height * inset, height * (1.0 - inset)
    along_x, along_y = np.linspace(x0, x1, _BORDER_SAMPLES), np.linspace(y0, y1, _BORDER_SAMPLES)
    sides = ((x0, along_y), (x1, along_y), (along_x, y0), (along_x, y1))
    return np.concatenate([np.column_stack(np.broadcast_arrays(x, y)) for x, y in sides])


def _remap(pixels: NDArray[np.uint8], positions: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Sample (H, W, C) with a cubic kernel at (H', W', 2) fractions of its width and height."""
    import torch

    planes = torch.from_numpy(pixels).permute(2, 0, 1)[None].float()
    grid = torch.from_numpy(positions)[None] * 2.0 - 1.0
    sampled = torch.nn.functional.grid_sample(planes, grid, "bicubic", padding_mode="border", align_corners=False)
    return np.ascontiguousarray(sampled[0].permute(1, 2, 0).round_().clamp_(0.0, 255.0).byte().numpy())
