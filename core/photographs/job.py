"""The job "enhance": photographs alone, recoloured into a folder with a table of figures and a page to look at."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..color.simulation import Observer
from ..enhance import Enhancer, IdentityEnhancer, LutEnhancer, make_enhancer
from ..files.images import to_bytes, write_png
from ..runtime.devices import choose_device
from ..runtime.protocol import Reporter, StageSpan
from .find import Photograph, Survey, find_photographs, survey
from .front import METRICS_NAME, SHEET_NAME, EnhanceRequest
from .scores import PhotographScores, figures_of, mean_scores, write_table
from .sheet import Sheet

STAGE = "enhance"
_POINTWISE = (IdentityEnhancer, LutEnhancer)
"""Enhancers whose result is a function of the colour alone, so that rows can be done one after the other."""

_BLOCK_PIXELS = 4_000_000
"""Pixels that a pointwise enhancer does at once; it needs some 40 bytes for each."""

_FIT_PHOTOGRAPHS = 4
"""A fit takes about as long as so many photographs of 0.4 megapixels with their figures, for the progress bar."""

Pixels = NDArray[np.uint8]


def enhance_folder(request: EnhanceRequest, folder: Path, reporter: Reporter) -> dict[str, Any]:
    """Write the results of `request` into `folder`; returns a summary.

    Args:
        request: what to do.
        folder: where to write, usually a staging folder inside ``request.out``.
        reporter: receives the progress of the stages "read" and "enhance".

    Raises:
        InputError: an option, a photograph or the output folder cannot be used.
    """
    device = choose_device(request.device, has_cuda=torch.cuda.is_available())

    def make() -> Enhancer:
        return make_enhancer(
            request.enhancer, request.cvd, request.severity, request.simulation, request.strength, request.seed, device
        )

    enhancer = make()  # refuses what cannot be simulated before anything takes time
    reporter.status("read", "looking for photographs")
    photographs = find_photographs(request.inputs, Path(request.out), reporter)
    found = survey(photographs, reporter, keep_pixels=not request.separately, skip_unreadable=request.skip_unreadable)
    reporter.status(STAGE, "fitting the enhancer")
    readable = found.photographs
    count = len(readable)
    observer = Observer(request.cvd, request.severity, request.simulation)
    recolour: Callable[[Pixels, Pixels | None], Pixels]
    if request.separately:
        start, recolour = 0.0, _Separately(make)
    else:
        start = _FIT_PHOTOGRAPHS / (_FIT_PHOTOGRAPHS + count)
        recolour = _Scene(enhancer, found, StageSpan(reporter, STAGE, 0.0, start, "fitting the enhancer"))
    del found  # and with it the pixels that only the fit needs
    rows = []
    with Sheet(observer, request.enhancer) as sheet:
        for number, photograph in enumerate(readable):
            reporter.status(STAGE, f"photograph {number + 1} of {count}")
            reporter.progress(STAGE, start + (1.0 - start) * number / count)
            rows.append(_enhance_one(photograph, recolour, observer, sheet, folder))
        means = mean_scores(rows)
        sheet.write(folder / SHEET_NAME, means, count)
    write_table(folder / METRICS_NAME, rows)
    reporter.progress(STAGE, 1.0)
    return {"images": count, "ccpr": {kind: _finite(means[f"ccpr_{kind}"]) for kind in ("input", "enhanced")}}


def _enhance_one(
    photograph: Photograph,
    recolour: Callable[[Pixels, Pixels | None], Pixels],
    observer: Observer,
    sheet: Sheet,
    folder: Path,
) -> PhotographScores:
    """Write one result and its part of the sheet; returns its figures."""
    original, alpha = photograph.read()
    started = time.perf_counter()
    enhanced = recolour(original, alpha)
    seconds = time.perf_counter() - started
    write_png(folder / photograph.output, enhanced, alpha)
    figures, scale = figures_of(original, enhanced, alpha, observer)
    height, width = original.shape[:2]
    scores = PhotographScores(
        str(photograph.path), photograph.output, width, height, figures, seconds, scale, _notes(original, alpha)
    )
    sheet.add(original, enhanced, alpha, scores, folder / f"{photograph.key}.thumbnail.jpg")
    return scores


class _Scene:
    """All photographs are one scene: one fit, and one colour becomes the same everywhere."""

    def __init__(self, enhancer: Enhancer, found: Survey, reporter: Reporter) -> None:
        self._enhancer = enhancer
        colored = any(_has_colour(*pair) for pair in zip(found.images, found.alphas, strict=True))
        if colored:  # else every photograph is left as it is
            enhancer.fit(found.images, reporter, alphas=found.alphas)

    def __call__(self, image: Pixels, alpha: Pixels | None) -> Pixels:
        return _apply(self._enhancer, image) if _has_colour(image, alpha) else image


class _Separately:
    """Every photograph is a scene of its own."""

    def __init__(self, make: Callable[[], Enhancer]) -> None:
        self._make = make

    def __call__(self, image: Pixels, alpha: Pixels | None) -> Pixels:
        if not _has_colour(image, alpha):
            return image
        enhancer = self._make()
        enhancer.fit([image], alphas=[alpha])
        return _apply(enhancer, image)


def _apply(enhancer: Enhancer, image: Pixels) -> Pixels:
    """The enhanced (H, W, 3) image, in blocks of rows where memory can be saved that way."""
    if not isinstance(enhancer, _POINTWISE):
        return to_bytes(enhancer(image))
    rows = max(_BLOCK_PIXELS // image.shape[1], 1)
    enhanced = np.empty_like(image)
    for top in range(0, len(image), rows):
        enhanced[top : top + rows] = to_bytes(enhancer(image[top : top + rows]))
    return enhanced


def _has_colour(image: Pixels, alpha: Pixels | None) -> bool:
    """Whether a visible pixel is anything but grey. What is grey looks the same to everyone and stays as it is."""
    colored = (image[..., 0] != image[..., 1]) | (image[..., 1] != image[..., 2])
    return bool(colored.any() if alpha is None else (colored & (alpha > 0)).any())


def _notes(image: Pixels, alpha: Pixels | None) -> tuple[str, ...]:
    return () if _has_colour(image, alpha) else ("no visible colour: left unchanged",)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
