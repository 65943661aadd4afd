"""Pictures inside HTML pages: JPEG as data URIs."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.files.images import write_jpeg
from ...core.files.pages import embed


def jpeg_uri(image: NDArray[np.uint8], quality: int) -> str:
    """An (H, W, 3) image as the data URI of a JPEG file with full chroma."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "picture.jpg"
        write_jpeg(file, image, quality)
        return embed(file, "image/jpeg")
