"""Picture files for the documentation, which are made where somebody wants them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

FOR_PICTURES = pytest.mark.skipif(
    not os.environ.get("CVDGS_PICTURES"), reason="nobody wants the picture: CVDGS_PICTURES is not set"
)


def save_smaller(picture: Image.Image, path: Path) -> None:
    """Write a PNG file in even levels alone: nobody sees it, and a fifth of the bytes is saved."""
    levels = np.asarray(picture)
    Image.fromarray(levels - levels % 2).save(path, optimize=True)
