"""Whether views agree on their pixels, and on which colour.

Two questions on the same correspondences. Where the *photographs* differ between views (gloss, glass, a wrong depth),
the enhanced views cannot be expected to agree: such pixels get a lower weight. Elsewhere the *enhanced* views differ
because each was enhanced on its own, and their median is what a view should have shown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from ..runtime.protocol import Reporter
from .correspondence import SceneCorrespondences, nearest_views, sample_bilinear

Image = NDArray[np.uint8]
Weights = NDArray[np.uint8]

_STAGE = "agreement"
_SMOOTHED_KEPT = 32  # neighbours in space are mostly neighbours in order


@dataclass(frozen=True)
class AgreementSettings:
    """How views are compared.

    Attributes:
        neighbours: other views that each view is compared with.
        blur: side of the box, in pixels, over which photographs are averaged before they are compared, so that a
            texture matched half a pixel off does not count as gloss.
        drift_blur: side of the box, in pixels, over which a view's disagreement with the others is averaged: drift is
            smooth, and the texture, which resampling softens, stays the view's own.
        tolerance: difference of the photographs, in units of the scene's median difference, at which a weight is 1/2;
            noise, resampling and exposure, which are everywhere, stay below.
        least_tolerance: the same in [0, 1], for scenes that agree perfectly.
        least_weight: of a pixel, however much its photographs differ: it still needs some colour.
    """

    neighbours: int = 4
    blur: int = 5
    drift_blur: int = 7
    tolerance: float = 4.0
    least_tolerance: float = 0.02
    least_weight: float = 0.1


@dataclass(frozen=True)
class Consensus:
    """What a view should show according to the others: its own picture, shifted.

    Shifts are means over more than a few pixels, so squares of `CELL` pixels share one, and hundreds of views fit into
    memory.

    Attributes:
        shifts: (⌈H / CELL⌉, ⌈W / CELL⌉, 3) int8, in levels of 255; `UNKNOWN` where no other view corresponds.
    """

    CELL: ClassVar[int] = 2
    UNKNOWN: ClassVar[int] = -128

    shifts: NDArray[np.int8]

    @classmethod
    def of(cls, shifts: NDArray[np.floating], known: NDArray[np.bool_]) -> Consensus:
        """From the (H, W, 3) shifts of all pixels, and (H, W) where another view corresponds."""
        first = np.s_[:: cls.CELL, :: cls.CELL]
        levels = np.clip(np.round(shifts[first]), cls.UNKNOWN + 1, 127)
        return cls(np.where(known[first][..., None], levels, cls.UNKNOWN).astype(np.int8))

    def known(self, height: int, width: int) -> NDArray[np.bool_]:
        """(H, W) where another view corresponds to a pixel of the view's picture."""
        return _spread(self.shifts[..., 0] != self.UNKNOWN, self.CELL, height, width)

    def colors(self, image: Image) -> Image:
        """What the view should show, whose own picture is the (H, W, 3) `image`; its own where nothing is known."""
        shifts = np.where(self.shifts == self.UNKNOWN, 0, self.shifts)
        shifted = image.astype(np.int16) + _spread(shifts, self.CELL, *image.shape[:2])
        return np.clip(shifted, 0, 255).astype(np.uint8)


class SceneAgreement:
    """Compares the views of a scene with their neighbours.

    Args:
        correspondences: of the scene.
        photographs: (H, W, 3) uint8 unenhanced images of the views to compare, by index.
        settings: how they are compared.
        reporter: receives the progress of matching, as the stage "agreement".

    Attributes:
        weights: (H, W) uint8, 255 = 1, by index of the view: 1 where the photographs agree or nothing is known, down
            to `least_weight` where they vary with the view.
    """

    def __init__(
        self,
        correspondences: SceneCorrespondences,
        photographs: Mapping[int, Image],
        settings: AgreementSettings = AgreementSettings(),
        reporter: Reporter | None = None,
    ) -> None:
        self._correspondences = correspondences
        self._settings = settings
        self._neighbours = nearest_views(correspondences.views, sorted(photographs), settings.neighbours)
        pairs = [(view, other) for view, others in self._neighbours.items() for other in others]
        correspondences.match(pairs, reporter, _STAGE)
        self.weights = self._weigh(photographs)

    def consensus(self, images: Mapping[int, Image], reporter: Reporter | None = None) -> dict[int, Consensus]:
        """The consensus for each of the (H, W, 3) enhanced `images`; reports its progress.

        Its own texture, shifted to the colours of the median of itself and its neighbours.
        """
        found, reporter = {}, reporter or Reporter()
        for view in self._neighbours:
            found[view] = self._consensus(images, view)
            reporter.progress(_STAGE, len(found) / len(self._neighbours), "comparing views")
        return found

    def _consensus(self, images: Mapping[int, Image], view: int) -> Consensus:
        image = images[view].astype(np.float32)
        own = image.reshape(-1, 3)
        others = np.stack([self._seen_by(images, view, other) for other in self._neighbours[view]])
        known = np.isfinite(others[..., 0]).any(axis=0)
        drift = np.zeros_like(own)
        drift[known] = _median(np.concatenate([own[None, known], others[:, known]])) - own[known]
        correction, near = _mean_over(
            self._settings.drift_blur, drift.reshape(image.shape), known.reshape(image.shape[:2])
        )
        return Consensus.of(correction, near)

    def _seen_by(self, images: Mapping[int, NDArray], view: int, other: int) -> NDArray[np.float32]:
        """(H * W, 3) colours of the view's pixels in another view, NaN where it does not see them."""
        found = self._correspondences.between(view, other)
        seen = np.full((images[view].shape[0] * images[view].shape[1], 3), np.nan, np.float32)
        seen[found.first_pixels] = sample_bilinear(images[other], found.second_positions)
        return seen

    def _weigh(self, photographs: Mapping[int, Image]) -> dict[int, Weights]:
        settings, stride = self._settings, self._correspondences.settings.stride
        smooth = _Smoothed(photographs, settings.blur)
        known, coarse = [], {}
        for view in self._neighbours:
            coarse[view] = self._variation(smooth, view)[::stride, ::stride].copy()  # no other pixels are matched
            known.append(coarse[view][np.isfinite(coarse[view])])
        typical = float(np.median(np.concatenate(known))) if any(map(len, known)) else 0.0
        tolerance = max(settings.tolerance * typical, 255.0 * settings.least_tolerance)
        weights = {}
        for view, difference in coarse.items():
            height, width = photographs[view].shape[:2]
            grid = np.nan_to_num(1.0 / (1.0 + (difference / tolerance) ** 2), nan=1.0)
            coverage = np.ceil(255.0 * np.maximum(grid, settings.least_weight)).astype(np.uint8)
            weights[view] = np.ascontiguousarray(_spread(coverage, stride, height, width))
        return weights

    def _variation(self, smooth: Mapping[int, NDArray[np.float32]], view: int) -> NDArray[np.float32]:
        """(H, W) median over the neighbours of the mean absolute difference of the channels, NaN where unknown.

        A difference that a match one pixel off would explain is subtracted: edges are not gloss.
        """
        own = smooth[view].reshape(-1, 3)
        apart = np.stack(
            [np.abs(self._seen_by(smooth, view, other) - own).mean(axis=1) for other in self._neighbours[view]]
        )
        down, right = np.gradient(smooth[view], axis=(0, 1))
        slope = np.hypot(down, right).mean(axis=2)
        return np.maximum(_median(apart).reshape(slope.shape) - slope, 0.0)


class _Smoothed(Mapping[int, NDArray[np.float32]]):
    """Photographs as means over boxes of `side` pixels; the last few are kept, because all would fill the memory."""

    def __init__(self, photographs: Mapping[int, Image], side: int) -> None:
        self._photographs = photographs
        self._side = side
        self._kept = lru_cache(_SMOOTHED_KEPT)(self._smooth)

    def _smooth(self, view: int) -> NDArray[np.float32]:
        side = (self._side, self._side, 0)
        return uniform_filter(self._photographs[view].astype(np.float32), side, mode="nearest")

    def __getitem__(self, view: int) -> NDArray[np.float32]:
        return self._kept(view)

    def __iter__(self) -> Iterator[int]:
        return iter(self._photographs)

    def __len__(self) -> int:
        return len(self._photographs)


def _spread(values: NDArray, side: int, height: int, width: int) -> NDArray:
    """(H, W, …) pixels of the (⌈H / side⌉, ⌈W / side⌉, …) `values` of squares."""
    return values.repeat(side, 0)[:height].repeat(side, 1)[:, :width]


def _mean_over(
    side: int, image: NDArray[np.float32], known: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(H, W, 3) means of the known pixels over boxes of `side` pixels, and (H, W) whether a box has any.

    Args:
        image: (H, W, 3), zero where nothing is known.
    """
    share = uniform_filter(known.astype(np.float32), side, mode="constant")
    near = share > 0.5 / side**2
    means = uniform_filter(image, (side, side, 0), mode="constant") / np.where(near, share, 1.0)[..., None]
    return np.where(near[..., None], means, 0.0), near


def _median(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median along the first axis ignoring NaN; NaN if all are. Many times as fast as numpy's nanmedian."""
    ordered = np.sort(values, axis=0)  # NaN comes last
    count = np.isfinite(values).sum(axis=0)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    middle = [np.take_along_axis(ordered, index[None], axis=0)[0] for index in (low, high)]
    return np.where(count > 0, (middle[0] + middle[1]) / 2, np.nan).astype(np.float32)
