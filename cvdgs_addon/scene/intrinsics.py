"""A pinhole camera's intrinsics, as Blender's side of the package holds them. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Intrinsics:
    """In pixels; pixel centres lie at +0.5, x right, y down. The same fields as `core.capture.model.PinholeCamera`.

    That one cannot be imported here: its package reads captures, with libraries that Blender's Python does not have.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
