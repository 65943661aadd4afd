"""Colour spaces on tensors: sRGB, linear sRGB, CIE XYZ and CIELAB under D65. Differentiable everywhere.

Every function takes and returns (..., 3, H, W) tensors, channels at dimension -3; a list of N colours is (3, N, 1).
sRGB is display-referred in [0, 1]. `image_to_tensor` and `tensor_to_image` convert from and to (H, W, 3) arrays.
"""

from __future__ import annotations

import warnings

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .matrices import RGB_TO_XYZ
from .srgb import ENCODED_KNEE, EXPONENT, LINEAR_KNEE, OFFSET, SLOPE

_LAB_KNEE = 6.0 / 29.0  # CIE 15: the cube root gives way to a straight line at its cube
_XYZ_TO_RGB = np.linalg.inv(RGB_TO_XYZ)


def _power(base: Tensor, exponent: float) -> Tensor:
    """base ** exponent for positive bases; on the CPU twice as fast as torch.pow, and more in the backward pass."""
    return torch.exp(torch.log(base) * exponent)


def srgb_to_linear(srgb: Tensor) -> Tensor:
    """Undo the sRGB transfer function (IEC 61966-2-1, piecewise); values below 0 continue its linear part."""
    # Each branch of `where` is differentiated, so the power must not see values where its slope is infinite or NaN.
    power = _power((srgb.clamp(min=ENCODED_KNEE) + OFFSET) / (1.0 + OFFSET), EXPONENT)
    return torch.where(srgb > ENCODED_KNEE, power, srgb / SLOPE)


def linear_to_srgb(linear: Tensor) -> Tensor:
    """Apply the sRGB transfer function (IEC 61966-2-1, piecewise); values below 0 continue its linear part."""
    power = (1.0 + OFFSET) * _power(linear.clamp(min=LINEAR_KNEE), 1.0 / EXPONENT) - OFFSET
    return torch.where(linear > LINEAR_KNEE, power, linear * SLOPE)


def apply_matrix(matrix: NDArray[np.float64], image: Tensor) -> Tensor:
    """Multiply the channels of a (..., 3, H, W) tensor with a (3, 3) matrix."""
    return (torch.as_tensor(matrix, dtype=image.dtype, device=image.device) @ image.flatten(-2)).view(image.shape)


def linear_to_xyz(linear: Tensor) -> Tensor:
    """Linear sRGB to CIE XYZ, Y of white = 1."""
    return apply_matrix(RGB_TO_XYZ, linear)


def xyz_to_lab(xyz: Tensor) -> Tensor:
    """CIE XYZ to CIELAB (CIE 15) relative to D65; L* in [0, 100]."""
    white = torch.as_tensor(RGB_TO_XYZ.sum(1), dtype=xyz.dtype, device=xyz.device)[:, None, None]
    relative = xyz / white
    root = _power(relative.clamp(min=_LAB_KNEE**3), 1.0 / 3.0)
    x, y, z = torch.where(relative > _LAB_KNEE**3, root, relative / (3.0 * _LAB_KNEE**2) + 4.0 / 29.0).unbind(-3)
    return torch.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], -3)


def linear_to_lab(linear: Tensor) -> Tensor:
    """Linear sRGB to CIELAB under D65."""
    return xyz_to_lab(linear_to_xyz(linear))


def srgb_to_lab(srgb: Tensor) -> Tensor:
    """Display-referred sRGB to CIELAB under D65."""
    return linear_to_lab(srgb_to_linear(srgb))


def lab_to_linear(lab: Tensor) -> Tensor:
    """CIELAB under D65 to linear sRGB, the inverse of `linear_to_lab`; not clipped to the gamut."""
    white = torch.as_tensor(RGB_TO_XYZ.sum(1), dtype=lab.dtype, device=lab.device)[:, None, None]
    lightness, a, b = lab.unbind(-3)
    y = (lightness + 16.0) / 116.0
    root = torch.stack([y + a / 500.0, y, y - b / 200.0], -3)
    straight = 3.0 * _LAB_KNEE**2 * (root - 4.0 / 29.0)
    return apply_matrix(_XYZ_TO_RGB, white * torch.where(root > _LAB_KNEE, root**3, straight))


def image_to_tensor(image: NDArray) -> Tensor:
    """(H, W, 3) uint8, or float in [0, 1], to a (3, H, W) float32 tensor in [0, 1]."""
    pixels = torch.from_numpy(np.ascontiguousarray(np.moveaxis(image, -1, 0)))
    return pixels.float() / 255.0 if pixels.dtype == torch.uint8 else pixels.float()


def tensor_to_image(tensor: Tensor) -> NDArray[np.float32]:
    """(3, H, W) tensor to an (H, W, 3) float32 array."""
    return np.ascontiguousarray(tensor.detach().float().cpu().numpy().transpose(1, 2, 0))


def delta_e_76(first_lab: Tensor, second_lab: Tensor) -> Tensor:
    """(..., H, W) Euclidean distance between two (..., 3, H, W) CIELAB images; its gradient is 0 where they agree."""
    difference = first_lab - second_lab
    # `vector_norm` is a hundred times slower along this dimension. The bound keeps the slope of the root finite.
    return (difference * difference).sum(-3).clamp(min=torch.finfo(difference.dtype).tiny).sqrt()


def delta_e_2000(first: Tensor, second: Tensor) -> Tensor:
    """(..., H, W) float64 CIEDE2000 difference of two (..., 3, H, W) sRGB images, by colour-science; no gradient."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Matplotlib.*")  # optional there, and not needed here
        from colour.difference import delta_E_CIE2000  # here, because it takes a second to import
    first_lab, second_lab = (
        srgb_to_lab(image.detach().double()).movedim(-3, -1).cpu().numpy() for image in (first, second)
    )
    return torch.as_tensor(delta_E_CIE2000(first_lab, second_lab))
