"""Small batches for the tests of what Blender does for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cvdgs.core.rendering.requests import FramesArguments
from cvdgs.core.runs.layout import picture_name
from cvdgs.cvdgs_addon.batch.pixels import Pixels, write_picture

SIZE = (48, 36)
"""Width and height of the pictures."""


def frames_arguments(run: Path, **changes) -> FramesArguments:
    """A turn of four pictures around a run, in its original colours."""
    values = {
        "run": str(run), "layer": "original", "engine": "cycles", "folder": "turn", "first": 1, "last": 4, "frames": 4,
        "radius": 3.5, "height": 0.3, "focal_length": 40.0, "arc": 360.0, "width": SIZE[0], "height_pixels": SIZE[1],
        "simulated": {}, "model": "machado",
    }  # fmt: skip
    return FramesArguments(**{**values, **changes})


def number_picture(number: int, hue: int = 0) -> Pixels:
    """A picture that tells its number by its brightness, with a square in its upper left corner."""
    width, height = SIZE
    picture = np.full((height, width, 3), 20 * number, np.uint8)
    picture[: height // 2, : width // 2, hue] = 250
    return picture


def sequence(folder: Path, count: int, hue: int = 0) -> Path:
    """Write the pictures 1 to `count`."""
    for number in range(1, count + 1):
        write_picture(folder / picture_name(number), number_picture(number, hue))
    return folder
