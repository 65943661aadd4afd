"""The job "enhance": photographs alone, recoloured into a folder with a table of figures and a page to look at."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..color.simulation import Observer
from ..enhance import (
    Enhancer,
    IdentityEnhancer,
    LutEnhancer,
    enhance_bytes,
    enhance_finite,
    learns,
    make_enhancer,
    warn_not_finite,
)
from ..errors import InputError
from ..files.images import write_png
from ..runs.enhanced import METRICS_NAME, SHEET_NAME
from ..runtime.protocol import Reporter, StageSpan
from .find import Photograph, Survey, find_photographs, survey
from .front import EnhanceRequest
from .groups import group_by_palette
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
Recolouring = Callable[[Reporter, Pixels, Pixels | None], tuple[Pixels, int]]
"""A photograph and its coverage to the enhanced photograph, and how many pixels the enhancer gave no finite colour."""


def enhance_folder(request: EnhanceRequest, folder: Path, reporter: Reporter) -> dict[str, Any]:
    """Write the results of `request` into `folder`; returns a summary.

    Args:
        request: what to do.
        folder: where to write, usually a staging folder inside ``request.out``.
        reporter: receives the progress of the stages "read" and "enhance".

    Raises:
        InputError: an option, a photograph or the output folder cannot be used.
    """
    if request.separately and request.together:
        remedy = "leave one of them out"
        raise InputError("photographs cannot be enhanced together and separately", where="--together", remedy=remedy)

    def make() -> Enhancer:
        return make_enhancer(
            request.enhancer,
            request.cvd,
            request.severity,
            request.simulation,
            request.strength,
            request.seed,
            request.change_budget,
            request.fit,
        )

    fit_photographs = _FIT_PHOTOGRAPHS if learns(make()) else 0  # refuses what cannot be simulated before any work
    reporter.status("read", "looking for photographs")
    photographs = find_photographs(request.inputs, Path(request.out), reporter)
    found = survey(photographs, reporter, keep_pixels=not request.separately, skip_unreadable=request.skip_unreadable)
    reporter.status(STAGE, "fitting the enhancer")
    readable = found.photographs
    count = len(readable)
    observer = Observer(request.cvd, request.severity, request.simulation)
    recolours: Sequence[Recolouring]
    if request.separately:
        start, recolours = 0.0, [_Separately(make, fit_photographs / (fit_photographs + 1))] * count
    else:
        scenes = _scenes(found, reporter, together=request.together)
        fits = fit_photographs * len(scenes)
        start = fits / (fits + count)
        recolours = _fit_scenes(make, found, scenes, StageSpan(reporter, STAGE, 0.0, start, "fitting the enhancer"))
    del found  # and with it the pixels that only the fit needs
    rows, broken = [], 0
    with Sheet(observer, request.enhancer, folder) as sheet:
        for number, photograph in enumerate(readable):
            reporter.status(STAGE, f"photograph {number + 1} of {count}")
            begin, end = (start + (1.0 - start) * done / count for done in (number, number + 1))
            reporter.progress(STAGE, begin)
            recolour = partial(recolours[number], StageSpan(reporter, STAGE, begin, end, "fitting the enhancer"))
            scores, spoilt = _enhance_one(photograph, recolour, observer, sheet, folder)
            rows.append(scores)
            broken += spoilt
        means = mean_scores(rows)
        sheet.write(folder / SHEET_NAME, means, count)
    write_table(folder / METRICS_NAME, rows)
    warn_not_finite(reporter, request.enhancer, broken)
    reporter.progress(STAGE, 1.0)
    return {"images": count, "ccpr": {kind: _finite(means[f"ccpr_{kind}"]) for kind in ("input", "enhanced")}}


def _enhance_one(
    photograph: Photograph,
    recolour: Callable[[Pixels, Pixels | None], tuple[Pixels, int]],
    observer: Observer,
    sheet: Sheet,
    folder: Path,
) -> tuple[PhotographScores, int]:
    """Write one result and its part of the sheet; returns its figures, and how many pixels got no finite colour."""
    original, alpha = photograph.read()
    started = time.perf_counter()
    enhanced, broken = recolour(original, alpha)
    seconds = time.perf_counter() - started
    write_png(folder / photograph.output, enhanced, alpha)
    figures, scale = figures_of(original, enhanced, alpha, observer)
    height, width = original.shape[:2]
    scores = PhotographScores(
        str(photograph.path), photograph.output, width, height, figures, seconds, scale, _notes(original, alpha)
    )
    sheet.add(original, enhanced, alpha, scores, folder / f"{photograph.key}.thumbnail.jpg")
    return scores, broken


def _scenes(found: Survey, reporter: Reporter, *, together: bool) -> list[list[int]]:
    """The photographs in colour that belong together, by their numbers; says so where that is not all of them."""
    colored = [i for i, pair in enumerate(zip(found.images, found.alphas, strict=True)) if _has_colour(*pair)]
    if together or not colored:
        return [colored] if colored else []
    groups = group_by_palette([found.images[i] for i in colored], [found.alphas[i] for i in colored])
    scenes = [[i for i, group in zip(colored, groups, strict=True) if group == one] for one in range(max(groups) + 1)]
    if len(scenes) > 1:
        largest = max(map(len, scenes))
        sizes = f"the largest of {largest} photographs" if largest > 1 else "of one photograph each"
        reporter.warning(
            "several-scenes",
            f"by their colours the photographs are {len(scenes)} scenes, {sizes}, which are enhanced apart; --together "
            "makes them one",
        )
    return scenes


def _fit_scenes(
    make: Callable[[], Enhancer], found: Survey, scenes: Sequence[Sequence[int]], reporter: StageSpan
) -> list[Recolouring]:
    """For each photograph the recolouring of its scene: one fit, so that one colour becomes the same in all of it."""
    recolours: list[Recolouring] = [_unchanged] * len(found.photographs)
    for number, scene in enumerate(scenes):
        enhancer, share = make(), 1.0 / len(scenes)
        span = StageSpan(reporter, STAGE, number * share, (number + 1) * share, "fitting the enhancer")
        enhancer.fit([found.images[i] for i in scene], span, alphas=[found.alphas[i] for i in scene])
        for i in scene:
            recolours[i] = partial(_apply, enhancer)
    return recolours


def _unchanged(_reporter: Reporter, image: Pixels, _alpha: Pixels | None) -> tuple[Pixels, int]:
    return image, 0


class _Separately:
    """Every photograph is a scene of its own.

    Args:
        fit_share: of the time for a photograph.
    """

    def __init__(self, make: Callable[[], Enhancer], fit_share: float) -> None:
        self._make, self._fit_share = make, fit_share

    def __call__(self, reporter: Reporter, image: Pixels, alpha: Pixels | None) -> tuple[Pixels, int]:
        if not _has_colour(image, alpha):
            return image, 0
        enhancer = self._make()
        enhancer.fit([image], StageSpan(reporter, STAGE, 0.0, self._fit_share, None), alphas=[alpha])
        return _apply(enhancer, reporter, image, alpha)


def _apply(enhancer: Enhancer, _reporter: Reporter, image: Pixels, alpha: Pixels | None) -> tuple[Pixels, int]:
    """The enhanced (H, W, 3) image, in blocks of rows where memory can be saved that way."""
    if not isinstance(enhancer, _POINTWISE):
        return enhance_finite(enhancer, image, alpha)
    rows = max(_BLOCK_PIXELS // image.shape[1], 1)
    enhanced = np.empty_like(image)
    for top in range(0, len(image), rows):
        enhanced[top : top + rows] = enhance_bytes(enhancer, image[top : top + rows])
    return enhanced, 0


def _has_colour(image: Pixels, alpha: Pixels | None) -> bool:
    """Whether a visible pixel is anything but grey. What is grey looks the same to everyone and stays as it is."""
    colored = (image[..., 0] != image[..., 1]) | (image[..., 1] != image[..., 2])
    return bool(colored.any() if alpha is None else (colored & (alpha > 0)).any())


def _notes(image: Pixels, alpha: Pixels | None) -> tuple[str, ...]:
    return () if _has_colour(image, alpha) else ("no visible colour: left unchanged",)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
