"""Training targets: photographs on the device, over a background, at the resolutions of the schedule."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..capture.model import View
from ..files.states import SavedState, State
from .raster import Mask, RasterCamera, Rasterizer
from .scene_frame import SceneFrame

_SMALLEST_SIDE = 96  # pixels; in smaller images SSIM's window sees much of the border, and steps hardly cost less


@dataclass(frozen=True)
class Background:
    """The background behind the Gaussians.

    Attributes:
        color: (3,) sRGB in [0, 1]. Black for photographs, which are opaque everywhere; white for cut-outs, as is usual
            for isolated objects.
    """

    color: tuple[float, float, float]

    @classmethod
    def of(cls, views: Iterable[View]) -> Background:
        """Black, or white if any view is a cut-out."""
        return cls((1.0, 1.0, 1.0) if any(view.alpha is not None for view in views) else (0.0, 0.0, 0.0))

    def behind(self, view: View) -> NDArray[np.uint8]:
        """(H, W, 3) uint8, the view's photograph composited over this background."""
        if view.alpha is None:
            return view.image
        alpha = view.alpha[..., None].astype(np.float32) / 255.0
        behind = np.asarray(self.color, np.float32) * 255.0
        return np.round(view.image * alpha + behind * (1.0 - alpha)).astype(np.uint8)


@dataclass(frozen=True)
class TrainingView:
    """One view at every resolution of the schedule.

    Attributes:
        levels: image, an (H, W, 3) uint8 device array, and camera by reduction factor.
        masks: of the photograph, by reduction factor; empty where all of it is looked at.
        smear: as in `View`, in pixels of the full image.
    """

    levels: dict[int, tuple[Any, RasterCamera]]
    masks: dict[int, Mask] = field(default_factory=dict)
    smear: NDArray[np.float64] | None = None

    def at(self, reduction: int) -> tuple[Any, RasterCamera]:
        """The image and camera at a reduction factor, or at full resolution if the view is too small for it."""
        return self.levels.get(reduction) or self.levels[1]

    def mask_at(self, reduction: int) -> Mask | None:
        """The mask of the image that `at` gives; None where all of it is looked at."""
        return self.masks.get(reduction if reduction in self.levels else 1)

    def looked_at(self) -> NDArray[np.bool_] | None:
        """(H, W) what of the full image is looked at; None for all."""
        return self.masks[1].pixels.numpy() > 0 if self.masks else None

    def reduced(self, reduction: int) -> TrainingView:
        """The view at one of its reductions alone."""
        mask = self.mask_at(reduction)
        return TrainingView({1: self.at(reduction)}, {} if mask is None else {1: mask}, self.smear_at(reduction))

    def smear_at(self, reduction: int) -> NDArray[np.float64] | None:
        """(2,) the line in pixels of the image that `at` gives; None where the photograph is sharp."""
        return None if self.smear is None else self.smear / (reduction if reduction in self.levels else 1)

    def without(self, region: NDArray[np.bool_] | None) -> TrainingView:
        """The same photograph, of which an (H, W) region of the full image is not looked at, either."""
        if region is None:
            return self
        looked_at = self.looked_at()
        shown = ~region if looked_at is None else looked_at & ~region
        device = self.levels[1][0].device
        return replace(self, masks={factor: Mask.of(block_all(shown, factor), device) for factor in self.levels})

    def moved(self, world_to_camera: NDArray[np.float64]) -> TrainingView:
        """The same photograph from another (4, 4) pose."""
        levels = {
            level: (image, replace(camera, world_to_camera=world_to_camera))
            for level, (image, camera) in self.levels.items()
        }
        return replace(self, levels=levels)


class ViewOrder:
    """The indices of `count` views, epoch after epoch, each in a new random order."""

    def __init__(self, count: int, rng: np.random.Generator) -> None:
        self._count = count
        self._rng = rng
        self._left: list[int] = []

    def snapshot(self) -> State:
        """What `restore` continues from; the random numbers are not in it."""
        return {"left": self._left}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is of other views."""
        left = saved.value("left", list)
        if not all(type(view) is int and 0 <= view < self._count for view in left):
            saved.refuse("left has other views")
        self._left = left

    def next(self) -> int:
        """The next view."""
        self._left = self._left or self._rng.permutation(self._count).tolist()
        return self._left.pop()


def prepare_targets(
    rasterizer: Rasterizer,
    views: Sequence[View],
    frame: SceneFrame,
    background: Background,
    reductions: Collection[int] = (),
) -> list[TrainingView]:
    """`views` on the rasteriser's device, at full resolution and reduced by each factor of `reductions`.

    On the CPU they share the photographs' memory, which nobody writes to.
    """
    return [_prepare(rasterizer, view, frame, background, reductions) for view in views]


def _prepare(
    rasterizer: Rasterizer, view: View, frame: SceneFrame, background: Background, reductions: Collection[int]
) -> TrainingView:
    image = background.behind(view)
    pose = frame.world_to_camera(view.world_to_camera)
    levels: dict[int, tuple[Any, RasterCamera]] = {}
    masks: dict[int, Mask] = {}
    for factor in sorted({1, *reductions}):
        height, width = image.shape[0] // factor, image.shape[1] // factor
        if factor > 1 and min(height, width) < _SMALLEST_SIDE:
            continue
        # Incomplete blocks are cut off at the far edges, so the principal point stays.
        camera = view.camera
        reduced = RasterCamera(
            width, height, camera.fx / factor, camera.fy / factor, camera.cx / factor, camera.cy / factor, pose
        )
        pixels = image if factor == 1 else block_mean(image, factor)
        device_pixels = wp.array(np.ascontiguousarray(pixels), dtype=wp.uint8, device=rasterizer.device, copy=False)
        levels[factor] = (device_pixels, reduced)
        if view.mask is not None:
            masks[factor] = Mask.of(block_all(view.mask, factor), rasterizer.device)
    return TrainingView(levels, masks, view.smear)


def block_all(mask: NDArray[np.bool_], factor: int) -> NDArray[np.uint8]:
    """(H // factor, W // factor) 255 where all pixels of a square block are looked at, else 0."""
    height, width = mask.shape[0] // factor, mask.shape[1] // factor
    blocks = mask[: height * factor, : width * factor].reshape(height, factor, width, factor)
    return np.where(blocks.all(axis=(1, 3)), 255, 0).astype(np.uint8)


def block_mean(image: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """(H // factor, W // factor, 3) mean of the encoded values, as the loss sees them, over square blocks."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    blocks = image[: height * factor, : width * factor].reshape(height, factor, width, factor, 3)
    return np.round(blocks.mean(axis=(1, 3), dtype=np.float32)).astype(np.uint8)
