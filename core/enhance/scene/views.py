"""The views of a scene as what is fitted or predicted sees them: some of them, and small."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ...errors import InputError
from ...intake.sampling import evenly_spread
from ..pairs import Alphas, Images

_FINEST = 8  # larger images lose pixels before they are reduced, in units of the size that is asked for
_LEAST_COVERAGE = 1 / 255


def chosen_views(images: Images, alphas: Alphas, most: int) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8] | None]]:
    """At most so many of the views that have a covered pixel, spread over the scene, with their coverage.

    Raises:
        InputError: there are none.
    """
    alphas = [None] * len(images) if alphas is None else alphas
    visible = [i for i, alpha in enumerate(alphas) if alpha is None or alpha.any()]
    if not visible:
        raise InputError("no view has a visible pixel", remedy="check the alpha channels of the photographs")
    return [(images[i], alphas[i]) for i in evenly_spread(visible, most)]


def reduced(image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None, size: int) -> tuple[Tensor, Tensor | None]:
    """(3, H, W) in [0, 1] with a longer side of at most `size` pixels, and (H, W) coverage where there is some.

    Pixels that are not covered have the mean colour of the others: windows and squares reach across the border.
    """
    longer = max(image.shape[:2])
    thinning = np.s_[:: max(longer // (_FINEST * size), 1)]
    pixels = torch.from_numpy(np.ascontiguousarray(image[thinning, thinning].transpose(2, 0, 1))).float() / 255.0
    shape = [max(round(side * min(size / longer, 1.0)), 1) for side in image.shape[:2]]

    def reduce(maps: Tensor) -> Tensor:
        return functional.interpolate(maps[None], shape, mode="bilinear", antialias=True)[0]

    if alpha is None:
        return reduce(pixels), None
    coverage = torch.from_numpy(np.ascontiguousarray(alpha[thinning, thinning])).float()[None] / 255.0
    mean = (coverage * pixels).sum((1, 2)) / coverage.sum().clamp(min=torch.finfo(coverage.dtype).tiny)
    *premultiplied, covered = reduce(torch.cat([coverage * pixels, coverage]))
    straight = torch.stack(premultiplied) / covered.clamp(min=_LEAST_COVERAGE)
    is_covered = covered >= _LEAST_COVERAGE
    return torch.where(is_covered, straight, mean[:, None, None]), covered * is_covered
