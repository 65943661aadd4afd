"""Colour differences: ΔE76 on tensors (differentiable) and ΔE2000 for evaluation."""

from __future__ import annotations

import warnings

import torch
from torch import Tensor

from .spaces import srgb_to_lab


def delta_e_76(first_lab: Tensor, second_lab: Tensor) -> Tensor:
    """(..., H, W) Euclidean distance of two (..., 3, H, W) CIELAB images; its gradient is 0 where they agree."""
    difference = first_lab - second_lab
    # Not `vector_norm`, which is a hundred times slower along this dimension. The bound keeps the root's slope finite.
    return (difference * difference).sum(-3).clamp(min=torch.finfo(difference.dtype).tiny).sqrt()


def delta_e_2000(first: Tensor, second: Tensor) -> Tensor:
    """(..., H, W) float64 CIEDE2000 difference of two (..., 3, H, W) sRGB images, by colour-science; no gradient."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Matplotlib.*")  # of no concern to our user
        from colour.difference import delta_E_CIE2000  # late: it takes a second to import
    first_lab, second_lab = (
        srgb_to_lab(image.detach().double()).movedim(-3, -1).cpu().numpy() for image in (first, second)
    )
    return torch.as_tensor(delta_E_CIE2000(first_lab, second_lab))
