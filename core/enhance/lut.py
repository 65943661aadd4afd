"""A smooth recolouring of the whole colour space: a residual three-dimensional look-up table.

The map is f(c) = clip(c + residual(c)), the residual interpolated trilinearly between the nodes of a regular grid over
display-referred sRGB. Being a function of the colour alone, it gives one colour the same result in every view.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..errors import InputError
from ..files.tensors import read_tensors, write_tensors

CUBE_SIZE = 33
"""Nodes along an edge of an exported `.cube` file: what grading tools commonly expect."""

_FORMAT = "cvdgs-color-lut"
_MAX_NODES = 129  # larger tables are no LUT that anyone made on purpose
_MAX_BYTES = 12 * _MAX_NODES**3 + (1 << 20)  # of such a table in its file, with a description


class ColorLut:
    """A residual LUT over sRGB.

    Args:
        residual: (N, N, N, 3) floating point, what is added to a colour at the grid node [red, green, blue].
        description: what the table is for (strings to strings), stored with it.
    """

    def __init__(self, residual: Tensor, description: dict[str, str] | None = None) -> None:
        if residual.ndim != 4 or residual.shape != (residual.shape[0],) * 3 + (3,) or residual.shape[0] < 2:
            raise ValueError(f"a residual of shape (N, N, N, 3) is needed, not {tuple(residual.shape)}")
        self.residual = residual
        self.description = dict(description or {})

    def __call__(self, image: NDArray, strength: float = 1.0) -> NDArray[np.float32]:
        """Recolour an (H, W, 3) uint8 image, or a floating-point one in [0, 1].

        Returns:
            (H, W, 3) float32 in [0, 1]: image + strength (f(image) - image).
        """
        colors = torch.from_numpy(as_float(image))
        with torch.no_grad():
            mapped = torch.add(
                colors, interpolate(self.residual.to(colors.dtype), colors), out=torch.empty_like(colors)
            )
            mapped.clamp_(0.0, 1.0)
            return (mapped if strength == 1.0 else torch.lerp(colors, mapped, strength)).numpy()

    def save(self, path: Path) -> None:
        """Write the table as safetensors."""
        metadata = {**self.description, "format": _FORMAT}
        write_tensors(path, {"residual": self.residual.float().contiguous()}, metadata)

    @classmethod
    def load(cls, path: Path) -> ColorLut:
        """Read what `save` wrote.

        Raises:
            InputError: the file is missing, damaged or something else.
        """
        remedy = "give a file that cvdgs saved as a colour LUT"
        metadata, tensors = read_tensors(path, "the colour LUT", remedy, most_bytes=_MAX_BYTES)
        residual = tensors.get("residual")
        if metadata.pop("format", "") != _FORMAT or residual is None:
            raise InputError("the file does not contain a colour LUT", where=path, remedy=remedy)
        if residual.dtype != torch.float32:
            raise InputError("the colour LUT is not in single precision", where=path, remedy=remedy)
        shape = tuple(residual.shape)
        if residual.ndim != 4 or not 2 <= shape[0] <= _MAX_NODES or shape != (shape[0],) * 3 + (3,):
            raise InputError(f"the colour LUT has the shape {shape}, not N x N x N x 3", where=path, remedy=remedy)
        if not torch.isfinite(residual).all():
            raise InputError("the colour LUT has values that are not finite", where=path, remedy=remedy)
        return cls(residual, metadata)

    def export_cube(self, path: Path, *, strength: float = 1.0, title: str = "cvdgs") -> None:
        """Write the map as an Adobe/IRIDAS `.cube` file for display-referred sRGB, red varying fastest."""
        axis = np.linspace(0.0, 1.0, CUBE_SIZE, dtype=np.float32)
        blue, green, red = np.meshgrid(axis, axis, axis, indexing="ij")
        colors = self(np.stack([red, green, blue], -1).reshape(-1, CUBE_SIZE, 3), strength).reshape(-1, 3)
        title = "".join(c for c in title if c.isprintable() and c != '"')
        header = [
            "# Input and output are display-referred sRGB.",
            f'TITLE "{title}"',
            f"LUT_3D_SIZE {CUBE_SIZE}",
            "DOMAIN_MIN 0.0 0.0 0.0",
            "DOMAIN_MAX 1.0 1.0 1.0",
        ]
        rows = [f"{r:.6f} {g:.6f} {b:.6f}" for r, g, b in colors.tolist()]
        path.write_text("\n".join([*header, *rows]) + "\n", encoding="utf-8")


def interpolate(table: Tensor, colors: Tensor) -> Tensor:
    """Trilinear interpolation of residual tables [red, green, blue] at colours in [0, 1].

    Differentiable with respect to the table; colours outside [0, 1] take the value of the nearest face. torch works on
    the B rows in parallel.

    Args:
        table: (N, N, N, 3), or (B, N, N, N, 3) for a table of its own for each row.
        colors: (B, P, 3).

    Returns:
        (B, P, 3).
    """
    # grid_sample's first coordinate runs along the last axis of its volume, so red has to become the last.
    volume = table.expand(len(colors), *table.shape[-4:]).permute(0, 4, 3, 2, 1)
    grid = (colors * 2.0 - 1.0)[:, None, None]
    sampled = torch.nn.functional.grid_sample(volume, grid, padding_mode="border", align_corners=True)
    return sampled[:, :, 0, 0].transpose(1, 2)


def as_float(image: NDArray) -> NDArray[np.float32]:
    """uint8 to [0, 1]; float32 as it is."""
    if image.dtype == np.uint8:
        return image.astype(np.float32) / np.float32(255.0)
    return np.ascontiguousarray(image, np.float32)
