"""What a capture is once it is read: pinhole views in one world frame and sparse points. numpy only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .upright import UpDirection

MIN_VIEWS = 2


@dataclass(frozen=True)
class View:
    """One photograph with a known camera.

    Attributes:
        key: file-system-safe name, unique in the capture; output files are named after it.
        source: the image file it came from.
        camera: intrinsics of `image`.
        world_to_camera: (4, 4) float64, rigid, OpenCV axes.
        image: (H, W, 3) uint8, display-referred sRGB, undistorted, at training resolution.
        alpha: (H, W) uint8 coverage, or None where the photograph is opaque everywhere. Where it is not, `image` holds
            straight (not premultiplied) colours. Pixels that undistortion could not fill count as not covered.
        again: like `image`, of a second photograph from the same place, or None without one. Two photographs differ by
            their noise alone, so no scene can be more like a photograph than the other one is.
        time: seconds into the video that it is a frame of, or None for a photograph.
        mask: (H, W) bool, False where the photograph is not looked at, or None where all of it is. Unlike `alpha` it
            does not say that nothing is there.
        smear: (2,) the line along which motion smeared the photograph while it was exposed, from end to end, right and
            down, pixels; None where that is not known.
    """

    key: str
    source: Path
    camera: PinholeCamera
    world_to_camera: NDArray[np.float64]
    image: NDArray[np.uint8]
    alpha: NDArray[np.uint8] | None = None
    again: NDArray[np.uint8] | None = None
    time: float | None = None
    mask: NDArray[np.bool_] | None = None
    smear: NDArray[np.float64] | None = None

    def at(self, world_to_camera: NDArray[np.float64]) -> View:
        """The same photograph from another (4, 4) pose."""
        return replace(self, world_to_camera=world_to_camera)

    def without(self, region: NDArray[np.bool_]) -> View:
        """The same photograph, of which an (H, W) region is not looked at, either."""
        return replace(self, mask=~region if self.mask is None else self.mask & ~region)

    @property
    def shown(self) -> NDArray[np.uint8] | None:
        """(H, W) uint8 `alpha` that is 0 where the photograph is masked: what counts of its colours; None for all."""
        if self.mask is None:
            return self.alpha
        return np.where(self.mask, 255 if self.alpha is None else self.alpha, 0).astype(np.uint8)

    def blanked(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """An (H, W, 3) picture from this camera, black where the photograph is masked, as what lies outside it."""
        return picture if self.mask is None else picture * self.mask[..., None]

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) camera centre in the world."""
        rotation, translation = self.world_to_camera[:3, :3], self.world_to_camera[:3, 3]
        return -rotation.T @ translation


@dataclass(frozen=True)
class CaptureWarning:
    """Something the user should know that does not stop the run; `name` is stable for programs."""

    name: str
    message: str


@dataclass(frozen=True)
class Estimate:
    """How cameras were estimated.

    Attributes:
        photographs: number of them.
        placed: number of those that have a camera now.
        pieces: number of photographs in each piece that hangs together, largest first; the first one is used.
        focal_ratios: of each camera, its focal length as a multiple of the photographs' longer side.
        method: "global", "incremental" or "pieces" (of either, joined).
        sheet: (H, W, 3) uint8 small pictures of all photographs, where some have no place.
    """

    photographs: int
    placed: int
    pieces: tuple[int, ...]
    focal_ratios: tuple[float, ...]
    method: str
    sheet: NDArray[np.uint8] | None = None

    def to_dict(self) -> dict[str, Any]:
        """What the report says of it."""
        return {
            "photographs": self.photographs,
            "placed": self.placed,
            "pieces": list(self.pieces),
            "focal_ratios": [round(ratio, 4) for ratio in self.focal_ratios],
            "method": self.method,
        }


@dataclass(frozen=True)
class Capture:
    """Views in file-name order, sparse points (possibly none) and what was noticed while reading.

    Attributes:
        source: the capture folder.
        format: "colmap", "transforms" or "sfm".
        views: at least two.
        points: (P, 3) float32 world positions; P may be 0.
        point_colors: (P, 3) uint8 sRGB.
        warnings: in the order in which they were noticed.
        estimate: of cameras that were estimated.
        up: which direction of the world is up.
        metres_per_unit: of the world, or None where nobody has measured it.
    """

    source: Path
    format: str
    views: tuple[View, ...]
    points: NDArray[np.float32]
    point_colors: NDArray[np.uint8]
    warnings: tuple[CaptureWarning, ...] = field(default=())
    estimate: Estimate | None = None
    up: UpDirection | None = None
    metres_per_unit: float | None = None

    def turned(self, rotation: NDArray[np.float64]) -> Capture:
        """The same photographs in a world turned by a (3, 3) rotation."""
        back = np.eye(4)
        back[:3, :3] = rotation.T
        views = tuple(view.at(view.world_to_camera @ back) for view in self.views)
        points = (self.points @ rotation.T).astype(np.float32)
        up = self.up and replace(self.up, direction=rotation @ self.up.direction)
        return replace(self, views=views, points=points, up=up)

    def moved(self, poses: Mapping[str, NDArray[np.float64]]) -> Capture:
        """The same photographs, those of the given keys from other (4, 4) world-to-camera poses."""
        views = tuple(view.at(poses[view.key]) if view.key in poses else view for view in self.views)
        return replace(self, views=views)

    def smeared(self, lines: Mapping[str, NDArray[np.float64]]) -> Capture:
        """The same photographs, those of the given keys known to be smeared along these (2,) lines."""
        views = tuple(replace(view, smear=lines[view.key]) if view.key in lines else view for view in self.views)
        return replace(self, views=views)

    def without(self, regions: Mapping[str, NDArray[np.bool_]]) -> Capture:
        """The same photographs, of which (H, W) regions, by key, are not looked at, either."""
        if not regions:
            return self
        views = tuple(view.without(regions[view.key]) if view.key in regions else view for view in self.views)
        return replace(self, views=views)

    def zoomed(self, factor: float) -> Capture:
        """The same photographs by a lens whose focal length is that many times as long."""
        return replace(self, views=tuple(replace(view, camera=view.camera.zoomed(factor)) for view in self.views))


@dataclass(frozen=True)
class CaptureSummary:
    """What is known of a capture before any pixel is read.

    Attributes:
        source: the path that was given.
        format: "colmap", "transforms" or "sfm".
        views: number of usable photographs; frames of videos are chosen later.
        sizes: (width, height, number of photographs) as they are upright, most frequent first.
        points: number of sparse points.
        warnings: in the order in which they were noticed.
        videos: whose frames become photographs, and `seconds` of them all.
    """

    source: Path
    format: str
    views: int
    sizes: tuple[tuple[int, int, int], ...]
    points: int
    warnings: tuple[CaptureWarning, ...] = field(default=())
    videos: int = 0
    seconds: float = 0.0


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
