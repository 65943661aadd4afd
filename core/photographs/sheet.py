"""sheet.html: every photograph before and after, as normal vision and as the observer see it, in one file."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ..capture.scaling import downscale_with_alpha, fit_size
from ..color.simulation import Observer
from ..color.srgb import simulate_bytes
from ..files.images import to_bytes, write_jpeg
from ..files.pages import embed, render, write_page
from .scores import PhotographScores

_THUMBNAIL = 400  # pixels of the longer side; sharp at the column's width on common displays
_JPEG_QUALITY = 85  # about 25 kB a picture

_PAGE = Path(__file__).with_name("sheet.html")
_PHOTOGRAPH = Path(__file__).with_name("sheet_photograph.html")


class Sheet:
    """Collects the photographs of a run and writes the page when it is complete.

    Pictures are embedded, so that the page can be moved and mailed; they wait in a temporary file, not in memory.

    Args:
        observer: for whom the photographs were enhanced.
        enhancer: its name, for the heading.
        folder: of the page, on whose disk there has to be room anyway.
    """

    def __init__(self, observer: Observer, enhancer: str, folder: Path) -> None:
        self._observer, self._enhancer = observer, enhancer
        self._sections: IO[str] = tempfile.TemporaryFile("w+", encoding="utf-8", dir=folder)  # noqa: SIM115 - closed in __exit__

    def __enter__(self) -> Sheet:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sections.close()

    def add(
        self,
        original: NDArray[np.uint8],
        enhanced: NDArray[np.uint8],
        alpha: NDArray[np.uint8] | None,
        scores: PhotographScores,
        scratch: Path,
    ) -> None:
        """Add a photograph.

        Args:
            original, enhanced: (H, W, 3).
            alpha: (H, W) coverage or None; thumbnails stand on white.
            scores: its figures.
            scratch: a file that may be written and is removed again.
        """
        before, after = _thumbnail(original, alpha), _thumbnail(enhanced, alpha)
        vision = f"{self._observer.cvd} vision"
        pictures = (
            ("before", _embedded(before, scratch)),
            ("after", _embedded(after, scratch)),
            (f"before, as {vision} sees it", _embedded(self._seen(before), scratch)),
            (f"after, as {vision} sees it", _embedded(self._seen(after), scratch)),
        )
        self._sections.write(render(_PHOTOGRAPH, scores=scores, pictures=pictures))

    def write(self, path: Path, means: Mapping[str, float], count: int) -> None:
        """Write the page: a table of the means of `count` photographs, then all of them."""
        self._sections.seek(0)
        values = {"observer": self._observer, "enhancer": self._enhancer, "means": means, "photographs": count}
        write_page(path, _PAGE, sections=self._sections, **values)

    def _seen(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        observer = self._observer
        return simulate_bytes(image, observer.cvd, observer.severity, observer.simulation)


def _thumbnail(image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    size = fit_size(image.shape[1], image.shape[0], _THUMBNAIL)
    image, alpha = downscale_with_alpha(image, alpha, *size)
    if alpha is None:
        return image
    coverage = alpha[..., None].astype(np.float32) / 255.0
    return to_bytes((image / np.float32(255.0)) * coverage + (1.0 - coverage))


def _embedded(image: NDArray[np.uint8], scratch: Path) -> tuple[int, int, str]:
    """Width, height, and the image as a data URI."""
    write_jpeg(scratch, image, _JPEG_QUALITY)
    source = embed(scratch, "image/jpeg")
    scratch.unlink()
    return image.shape[1], image.shape[0], source
