"""Estimates the contrast that second photographs would have, from photographs of the same surfaces from other places.

Two photographs from one place differ by noise, so the first one's contrast is not a fair goal for a scene. Captures
rarely have second photographs. But a photograph I = T + n, and two neighbours resampled to its pixels, P = A T + p and
Q = B T + q, are three measurements of the same surfaces whose errors have nothing to do with each other, and then

    Cov(T) = Cov(I, P) Cov(Q, P)^-1 Cov(Q, I)

whatever A and B, such as the blur of resampling, are: triple collocation (Stoffelen 1998, JGR Oceans 103(C4)). Here the
measurements are differences of neighbouring pixels in CIELAB as the observer sees them, each split into what a 3×3 box
leaves of it and the rest, so that A and B may act on the two differently. Given the first photograph's difference, the
second one's is then drawn from the normal distribution with these covariances. They are gathered for pairs of similar
local contrast, since noise is stronger where there is texture (rendered and compressed photographs) and so is what
resampling loses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..color.metrics import CCPR_THRESHOLD, half_size, half_size_mask, neighbour_pairs
from ..color.simulation import Observer
from ..color.spaces import image_to_tensor, srgb_to_lab
from ..consistency import Correspondences, nearest_views
from ..consistency.correspondence import PosedCamera
from .scores import PYRAMID, Image

ESTIMATED_FIGURES = ("ccpr", *(f"ccpr_{size}" for size in PYRAMID))
"""What `SecondPhotographs` estimates."""

Floats = NDArray[np.float64]

_CONSIDERED = 6  # nearest views
_BOX = 3  # pixels, of the split into a smooth part and the rest
_WINDOW = 7  # pixels, of the local contrast
_BANDS = 6  # Lab of the smooth part, Lab of the rest
# ΔE, root mean square in the window, between classes of local contrast: half octaves around the threshold of 6.
_CLASSES = 2.0 ** np.arange(-2.0, 4.5, 0.5)
_MOST_PAIRS = 50_000  # of a view in each direction: more change no third digit
_LEAST_PAIRS = 2000  # of a class that three photographs show; thinner ones are merged with the next
_LEAST_SHARE = 0.05  # of all pairs, seen by three photographs, that speak for the others
_SMALLEST_GAIN = 1e-3  # singular values relative to the largest below which neighbours say nothing
_TINY = 1e-9  # ΔE²


@dataclass(frozen=True)
class _Versions:
    """One view: the photograph, and the version whose second photograph is asked for, beside two neighbours' of it.

    Attributes:
        photograph, version, first, second: (3, H, W) sRGB; NaN in the neighbours' where they do not see the place.
        mask: (H, W) bool, the pixels that count; None for all.
    """

    photograph: Tensor
    version: Tensor
    first: Tensor
    second: Tensor
    mask: Tensor | None

    def halved(self) -> _Versions:
        """At half the size."""
        mask = None if self.mask is None else half_size_mask(self.mask)
        photograph, version, first, second = map(half_size, (self.photograph, self.version, self.first, self.second))
        return _Versions(photograph, version, first, second, mask)


@dataclass(frozen=True)
class _Pairs:
    """Neighbouring pixels of a view.

    Attributes:
        before: (P,) ΔE in the photograph.
        kinds: (P,) class of local contrast.
        measured: (P, 6) differences of the version and, if asked for, of its neighbours; NaN where they do not see it.
    """

    before: NDArray[np.float32]
    kinds: NDArray[np.int64]
    measured: list[Floats]


class _Moments:
    """Sums of products of differences, for each class of local contrast.

    Attributes:
        count: (C,) pairs that all three show.
        pairs: pairs in all.
        own: (C, 6, 6) of I with I over these; `with_first`, `from_second` and `between`: of I with P, of Q with I, and
            of Q with P.
    """

    def __init__(self) -> None:
        classes = len(_CLASSES) + 1
        self.count, self.pairs = np.zeros(classes, np.int64), 0
        self.own, self.with_first, self.from_second, self.between = np.zeros((4, classes, _BANDS, _BANDS))

    def add(self, pairs: _Pairs) -> None:
        """Add a view's pairs, with those of its neighbours."""
        kinds, (own, first, second) = pairs.kinds, pairs.measured
        self.pairs += len(kinds)
        seen = np.isfinite(first).all(1) & np.isfinite(second).all(1)
        kinds, own, first, second = (values[seen] for values in (kinds, own, first, second))
        for kind in np.unique(kinds):
            chosen = kinds == kind
            x, p, q = own[chosen], first[chosen], second[chosen]
            self.count[kind] += len(x)
            self.own[kind] += x.T @ x
            self.with_first[kind] += x.T @ p
            self.from_second[kind] += q.T @ x
            self.between[kind] += q.T @ p

    def predictors(self) -> list[tuple[Floats, Floats]] | None:
        """For each class the matrix to the expected second difference, and a root of the covariance of the rest."""
        if self.count.sum() < max(_LEAST_SHARE * self.pairs, _LEAST_PAIRS):
            return None
        found: list[tuple[Floats, Floats]] = []
        kind = len(self.count) - 1
        while kind >= 0:
            lowest = kind
            while lowest > 0 and self.count[lowest : kind + 1].sum() < _LEAST_PAIRS:
                lowest -= 1
            if self.count[lowest : kind + 1].sum() < _LEAST_PAIRS:
                found += [found[-1]] * (kind - lowest + 1)  # too few of the weakest: like the next ones
            else:
                found += [self._predictor(slice(lowest, kind + 1))] * (kind - lowest + 1)
            kind = lowest - 1
        return found[::-1]

    def _predictor(self, kinds: slice) -> tuple[Floats, Floats]:
        count = self.count[kinds].sum()
        own, with_first, from_second, between = (
            sums[kinds].sum(0) / count for sums in (self.own, self.with_first, self.from_second, self.between)
        )
        signal = with_first @ np.linalg.pinv(between, rcond=_SMALLEST_GAIN) @ from_second
        values, axes = np.linalg.eigh(own)
        values = np.maximum(values, _TINY)
        whiten, color = axes / np.sqrt(values), axes * np.sqrt(values)
        # Shares of the photograph's own variance; outside [0, 1] they are errors of estimation.
        shares, directions = np.linalg.eigh(whiten.T @ (signal + signal.T) @ whiten / 2)
        shares = np.clip(shares, 0.0, 1.0)
        kept = color @ (directions * shares) @ directions.T
        return kept @ whiten.T, color @ (directions * np.sqrt(1.0 - shares**2))


class SecondPhotographs:
    """The CCPR that second photographs of some views would have, at all sizes.

    Args:
        observer: for whom a version is simulated.
        seed: of the noise that is drawn.
    """

    def __init__(self, observer: Observer, seed: int = 0) -> None:
        self._observer, self._seed = observer, seed
        self._views: list[_Versions] = []

    def add(self, photograph: Image, version: Image, neighbours: Sequence[NDArray], mask: NDArray | None) -> None:
        """Add a view.

        Args:
            photograph: (H, W, 3) uint8.
            version: likewise, the photograph itself or enhanced.
            neighbours: the same version of two others, from `resampled`.
            mask: (H, W) bool, the pixels that count; None for all.
        """
        first, second = (image_to_tensor(neighbour) for neighbour in neighbours)
        covered = None if mask is None else torch.from_numpy(mask)
        self._views.append(_Versions(image_to_tensor(photograph), image_to_tensor(version), first, second, covered))

    def figures(self) -> dict[str, float]:
        """`ESTIMATED_FIGURES`; NaN where too little is seen by three photographs."""
        views, figures = self._views, {}
        for figure in ESTIMATED_FIGURES:
            figures[figure] = self._ccpr(views)
            views = [view.halved() for view in views if min(view.photograph.shape[-2:]) >= 4]
        return figures

    def _ccpr(self, views: Sequence[_Versions]) -> float:
        moments = _Moments()
        for view in views:
            for pairs in self._pairs(view, neighbours=True):
                moments.add(pairs)
        predictors = moments.predictors()
        if predictors is None:
            return float("nan")
        random = np.random.default_rng(self._seed)
        of_views = []
        for view in views:
            distinct = kept = 0
            for pairs in self._pairs(view, neighbours=False):
                chosen = pairs.before >= CCPR_THRESHOLD
                second = _drawn(predictors, pairs.kinds[chosen], pairs.measured[0][chosen], random)
                distinct += len(second)
                kept += int((second >= CCPR_THRESHOLD).sum())
            if distinct:
                of_views.append(kept / distinct)
        return float(np.mean(of_views)) if of_views else float("nan")

    def _pairs(self, view: _Versions, *, neighbours: bool) -> Iterator[_Pairs]:
        """Those of each direction."""
        images = [view.version, view.first, view.second] if neighbours else [view.version]
        labs = [srgb_to_lab(view.photograph), *(srgb_to_lab(self._observer.simulate(image)) for image in images)]
        masks = [None] * 4 if view.mask is None else [first & second for first, second in neighbour_pairs(view.mask)]
        for mask, *sides in zip(masks, *(neighbour_pairs(lab) for lab in labs), strict=True):
            before, *measured = (first - second for first, second in sides)
            counted = torch.arange(before[0].numel()) if mask is None else mask.flatten().nonzero()[:, 0]
            counted = counted[:: -(-len(counted) // _MOST_PAIRS) or 1]
            contrast = _mean_over(_WINDOW, (measured[0] ** 2).sum(0, keepdim=True)).sqrt().flatten()[counted]
            yield _Pairs(
                before.flatten(1)[:, counted].norm(dim=0).numpy(),
                np.searchsorted(_CLASSES, contrast.numpy(), side="right"),
                [_bands(difference, counted) for difference in measured],
            )


def views_beside(views: Sequence[PosedCamera], among: Sequence[int]) -> dict[int, tuple[int, int]]:
    """For each of the views `among` the two others that its second photograph is estimated from; {} for too few views.

    The nearest, and the nearest of a few that stands on the other side, so that the two are resampled differently.
    """
    if len(views) < 3:
        return {}
    near = nearest_views(views, range(len(views)), _CONSIDERED)
    centers = [np.linalg.inv(view.world_to_camera)[:3, 3] for view in views]
    found = {}
    for view in among:
        first, *others = near[view]
        towards = centers[first] - centers[view]
        opposite = [other for other in others if towards @ (centers[other] - centers[view]) < 0.0]
        found[view] = first, (opposite or others)[0]
    return found


def resampled(picture: Image, seen: Correspondences, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """A picture as seen from another camera of `shape` (H, W): (H, W, 3) in [0, 1], NaN where it does not see a place.

    By cubic splines, since what is lost here has to be estimated again.
    """
    rows, columns = seen.second_positions[:, 1] - 0.5, seen.second_positions[:, 0] - 0.5
    found = np.full((shape[0] * shape[1], 3), np.nan, np.float32)
    for channel in range(3):
        values = map_coordinates(picture[..., channel].astype(np.float32), [rows, columns], order=3, mode="nearest")
        found[seen.first_pixels, channel] = np.clip(values / 255.0, 0.0, 1.0)
    return found.reshape(*shape, 3)


def _mean_over(side: int, image: Tensor) -> Tensor:
    """(C, H, W) means over boxes, which are cut at the border; NaN where a box has one."""
    return avg_pool2d(image[None], side, 1, side // 2, count_include_pad=False)[0]


def _bands(difference: Tensor, chosen: Tensor) -> Floats:
    """(P, 6) of the chosen pairs: what a box leaves of a (3, H, W) difference, and the rest."""
    smooth = _mean_over(_BOX, difference)
    return torch.cat([smooth, difference - smooth]).flatten(1)[:, chosen].T.double().numpy()


def _drawn(
    predictors: Sequence[tuple[Floats, Floats]], kinds: NDArray[np.int64], own: Floats, random: np.random.Generator
) -> Floats:
    """(P,) ΔE of second differences."""
    noise = random.standard_normal(own.shape)
    drawn = np.zeros_like(own)
    for kind in np.unique(kinds):
        chosen, (expected, root) = kinds == kind, predictors[kind]
        drawn[chosen] = own[chosen] @ expected.T + noise[chosen] @ root.T
    return np.linalg.norm(drawn[:, :3] + drawn[:, 3:], axis=1)
