"""The modes of a run compared on one capture: contrast, view consistency and time, with an enhancer that may drift.

All modes are measured on the correspondences of one unenhanced reconstruction. `post` and `layers` share it as their
geometry too; `joint` trains its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..capture import Capture
from ..enhance import Enhancer, LutEnhancer
from ..enhance.teacher import TeacherSettings
from ..events import Reporter
from ..images import to_bytes
from ..settings import MODES, Layer, Settings
from ..splats import raster
from ..stages import Picture, Reconstruction, Stages
from .evaluation import Split
from .tables import markdown_table, number, write_csv

Result = TypeVar("Result")

BASELINE = "post"
# Of a LUT that is fitted to every view and every rendering anew: a third of the teacher's usual work.
_PER_VIEW_STEPS = 80
_PER_VIEW_PAIRS = 3000


@dataclass(frozen=True)
class ModeFigures:
    """One mode on one capture.

    Attributes:
        capture, enhancer, mode: what was run.
        gaussians: of the geometry.
        ccpr_input, ccpr_enhanced, ccpr: contrast that is left in held-out photographs, enhanced ones and pictures.
        rwe_enhanced: warping error of the enhanced photographs, relative to the photographs.
        rwe_unenhanced: of the renderings in original colours: what reconstruction and resampling leave of it even
            without any enhancement.
        rwe, rwe_long, rwe_normalised, rwe_absolute: of the mode's pictures; see `WarpingError`.
        rwe_to_post: `rwe` relative to the baseline's.
        added_to_post: the same of what enhancement added, `rwe` - `rwe_unenhanced`; resampling of fine texture, which
            no mode can remove, is left out.
        psnr_to_enhanced: of the pictures against the enhanced held-out photographs, dB.
        geometry_seconds, layer_seconds: wall time; `layers` and `post` have the geometry of one training.
    """

    capture: str
    enhancer: str
    mode: str
    gaussians: int
    ccpr_input: float
    ccpr_enhanced: float
    ccpr: float
    rwe_enhanced: float
    rwe_unenhanced: float
    rwe: float
    rwe_long: float
    rwe_normalised: float
    rwe_absolute: float
    rwe_to_post: float
    added_to_post: float
    psnr_to_enhanced: float
    geometry_seconds: float
    layer_seconds: float


class PerViewLut:
    """Fits a LUT to every image anew: what a method that knows single images only does to a scene.

    Two colours that look alike can be told apart in either direction. For a scene the teacher decides that once; here
    nothing ties the views together, and a coin decides for each image, thrown by its own pixels.

    Args:
        cvd, severity, simulation: the observer, as for `simulate`.
    """

    def __init__(self, cvd: str, severity: float, simulation: str) -> None:
        self._observer = (cvd, severity, simulation)

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Nothing is learnt of the scene."""

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The image, recoloured by a LUT of its own."""
        usual = TeacherSettings()
        direction = 1.0 if int(to_bytes(image).sum()) % 2 else -1.0
        settings = replace(
            usual,
            steps=_PER_VIEW_STEPS,
            pairs=_PER_VIEW_PAIRS,
            relaxations=0,
            initial_shift=direction * usual.initial_shift,
        )
        enhancer = LutEnhancer(*self._observer, settings=settings)
        enhancer.fit([image])
        return enhancer(image)


def compare_modes(
    capture: Capture, settings: Settings, enhancer: Enhancer, label: str, folder: Path, reporter: Reporter
) -> list[ModeFigures]:
    """Run every mode on `capture` with the first layer of `settings`.

    Args:
        settings: of the runs; its mode is set here.
        enhancer: fitted here to the training views.
        label: what the rows call it.
        folder: for the files of the runs; those of one mode overwrite those of another.
    """
    layer = settings.layers[0]
    test = list(range(0, len(capture.views), settings.holdout)) if settings.holdout else []
    split = Split([i for i in range(len(capture.views)) if i not in test], test)
    rasterizer = raster.Rasterizer("cpu")
    runs = {
        mode: Stages.of(replace(settings, mode=mode, sh_degree=0), folder, reporter, capture, split, rasterizer)
        for mode in MODES
    }
    runs[BASELINE].enhance({layer: enhancer})
    shared, shared_seconds = _timed(lambda: _reconstructed(runs[BASELINE]))
    together, joint_seconds = _timed(lambda: _reconstructed(runs["joint"]))
    rows: list[ModeFigures] = []
    unenhanced = _figures(runs["layers"], shared, {layer: lambda i: runs["layers"].scene.color(shared.original, i)})
    for mode in (BASELINE, *(mode for mode in MODES if mode != BASELINE)):
        made, seconds = (together, joint_seconds) if mode == "joint" else (shared, shared_seconds)
        pictures, layer_seconds = _timed(partial(runs[mode].fit_layers, made, {layer: enhancer}))
        measured = _figures(runs[mode], replace(made, correspondences=shared.correspondences), pictures)
        rwe, floor = measured["rwe"], unenhanced["rwe"]["ratio"]
        baseline = rows[0].rwe if rows else rwe["ratio"]
        rows.append(
            ModeFigures(
                capture=capture.source.name,
                enhancer=label,
                mode=mode,
                gaussians=len(made.original),
                ccpr_input=measured["ccpr"]["input"],
                ccpr_enhanced=measured["ccpr"]["enhanced"],
                ccpr=measured["ccpr"]["rendered"],
                rwe_enhanced=rwe["enhanced_ratio"],
                rwe_unenhanced=floor,
                rwe=rwe["ratio"],
                rwe_long=rwe["long_range_ratio"],
                rwe_normalised=rwe["normalised_ratio"],
                rwe_absolute=rwe["absolute"],
                rwe_to_post=rwe["ratio"] / baseline,
                added_to_post=(rwe["ratio"] - floor) / (baseline - floor) if baseline > floor else float("nan"),
                psnr_to_enhanced=measured["psnr_to_enhanced"],
                geometry_seconds=seconds,
                layer_seconds=layer_seconds,
            )
        )
    return rows


def write_modes(folder: Path, rows: Sequence[ModeFigures]) -> str:
    """Write ``modes.csv`` and ``modes.md``; returns the text of the latter."""
    write_csv(folder / "modes.csv", ModeFigures, rows)
    header = [
        "capture",
        "enhancer",
        "mode",
        "CCPR",
        "RWE",
        "to post",
        "added, to post",
        "RWE, 7 apart",
        "RWE / σ",
        "L1",
    ]
    header += ["RWE of enhanced photographs", "of unenhanced renderings", "PSNR to enhanced", "geometry s", "layer s"]
    body = [
        [row.capture, row.enhancer, row.mode]
        + [
            number(value, 3)
            for value in (row.ccpr, row.rwe, row.rwe_to_post, row.added_to_post, row.rwe_long, row.rwe_normalised)
        ]
        + [number(row.rwe_absolute, 4), number(row.rwe_enhanced, 3), number(row.rwe_unenhanced, 3)]
        + [number(value, 1) for value in (row.psnr_to_enhanced, row.geometry_seconds, row.layer_seconds)]
        for row in rows
    ]
    text = "\n".join(["# Modes", "", *markdown_table(header, body), ""])
    (folder / "modes.md").write_text(text, encoding="utf-8")
    return text


def _figures(stages: Stages, made: Reconstruction, pictures: dict[Layer, Picture]) -> dict[str, Any]:
    (figures,) = stages.evaluate(made, pictures)["layers"].values()
    return figures


def _reconstructed(stages: Stages) -> Reconstruction:
    return stages.reconstruct(stages.train())


def _timed(work: Callable[[], Result]) -> tuple[Result, float]:
    started = time.perf_counter()
    result = work()
    return result, time.perf_counter() - started
