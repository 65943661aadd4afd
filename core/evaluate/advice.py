"""Warnings about a finished run: what its photographs, training curve and figures show, and what to do about it.

A warning is only useful where it is true, so each threshold is well beyond what good captures show; its origin is given
beside it. Nothing here changes a result.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.model import Capture, CaptureWarning
from ..files.images import read_png
from ..intake.sampling import evenly_spread
from ..runs.layout import ORIGINAL, RENDERS_FOLDER
from ..settings import Layer
from .evaluation import Split
from .photograph_quality import PhotographQuality, image_shift

_MEASURED_PHOTOGRAPHS = 6


@dataclass(frozen=True)
class AdviceThresholds:
    """Thresholds beyond which a warning is given.

    Attributes:
        noise: levels of 255. Noise-free renderings show 0.5, real photographs scaled down 0.4; the demo with a
            thirtieth of its light shows 5.
        sharpness: see `PhotographQuality`; 0.6 to 0.85 for sharp photographs, 0.40 for frames of a phone video, below
            0.36 for the demo blurred over three pixels.
        blocks: 0.9 to 1.1 for good photographs, 1.4 for JPEG quality 30.
        brightness: median luma; 0.1 for a room at night.
        image_shift: pixels, root mean square over held-out views; at most 0.2 with accurate cameras.
        exposure_loss: dB that held-out views lose through their exposure alone.
        psnr: dB of held-out views; details can hardly be recognised below it.
        enhanced_ratio: RWE of the enhanced photographs; 1.0 to 1.2 for a LUT, because higher contrast means larger
            differences.
        rendered_ratio: RWE of the layer; above 1 its views are less consistent than the photographs.
        ccpr: of the enhanced photographs; a frame counts as hard below it.
        kept_contrast: CCPR of the scene relative to that of the photographs. Detail finer than the reconstruction is
            always lost: good scenes from 50 photographs keep at least 0.73, in some cases even after enhancement.
        least_severity: below it a layer has the photographs' own colours.
    """

    noise: float = 4.0
    sharpness: float = 0.37
    blocks: float = 1.3
    brightness: float = 0.1
    image_shift: float = 1.0
    exposure_loss: float = 1.0
    psnr: float = 20.0
    enhanced_ratio: float = 1.5
    rendered_ratio: float = 1.0
    ccpr: float = 0.8
    kept_contrast: float = 0.6
    least_severity: float = 0.05


def advise(
    capture: Capture,
    split: Split,
    folder: Path,
    curve: Sequence[Mapping[str, Any]],
    figures: Mapping[str, Any],
    thresholds: AdviceThresholds = AdviceThresholds(),
) -> list[CaptureWarning]:
    """Warnings to show the user after a run.

    Args:
        capture: with the camera poses after training.
        split: of its views.
        folder: of the run, with the renderings of its held-out views.
        curve: training curve; empty if nothing was trained.
        figures: the report's ``reconstruction`` and ``layers``.
    """
    found = [*_of_photographs(capture, thresholds), *_of_geometry(capture, split, folder, curve, figures, thresholds)]
    for name, layer in figures["layers"].items():
        found += _of_layer(name, layer, thresholds)
    return found


def note_exposure(curve: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """For the report's ``notes``: what PSNR means where exposures were corrected; empty where they were not.

    Args:
        curve: of the training.
    """
    last = curve[-1] if curve else {}
    if last.get("psnr_any_exposure") is None:
        return {}
    return {
        "exposure": "the scene is kept free of how the exposures of single photographs differ, which PSNR counts "
        f"against it: at the end of training held-out views had {last['psnr']:.1f} dB as they were exposed, and "
        f"{last['psnr_any_exposure']:.1f} dB with each one's exposure compensated"
    }


def _of_photographs(capture: Capture, limits: AdviceThresholds) -> Iterator[CaptureWarning]:
    chosen = evenly_spread(range(len(capture.views)), _MEASURED_PHOTOGRAPHS)
    views = [capture.views[i] for i in chosen]
    quality = PhotographQuality.of([view.image for view in views], [view.shown for view in views])
    if quality.noise > limits.noise:
        yield CaptureWarning(
            "noisy-photographs",
            f"the photographs are noisy (about {quality.noise:.0f} of 255 levels); use more light, a longer exposure "
            "on a tripod, or a lower ISO",
        )
    if quality.sharpness < limits.sharpness:
        yield CaptureWarning(
            "blurred-photographs",
            "the photographs have no detail at the scale of a pixel; if they are blurred, hold the camera still and "
            "check the focus, otherwise a smaller --max-size is faster and just as good",
        )
    if quality.blocks > limits.blocks:
        yield CaptureWarning(
            "jpeg-blocks",
            "the photographs show blocks from strong JPEG compression; use the camera's highest quality and its "
            "original files",
        )
    if quality.brightness < limits.brightness:
        yield CaptureWarning(
            "dark-photographs",
            f"half of the pixels are darker than {quality.brightness:.0%} of white, where anyone finds colours hard to "
            "tell apart; use more light or a longer exposure",
        )


def _of_geometry(
    capture: Capture,
    split: Split,
    folder: Path,
    curve: Sequence[Mapping[str, Any]],
    figures: Mapping[str, Any],
    limits: AdviceThresholds,
) -> Iterator[CaptureWarning]:
    last = curve[-1] if curve else {}
    psnr, any_exposure = last.get("psnr"), last.get("psnr_any_exposure")
    if psnr is not None and any_exposure is not None and any_exposure - psnr > limits.exposure_loss:
        yield CaptureWarning(
            "exposure-varies",
            "exposure or white balance varies between photographs; this was corrected, but it costs held-out views "
            f"{any_exposure - psnr:.1f} dB: lock both while photographing",
        )
    if split.test:
        moved = _rms_shift(capture, split, folder)
        if moved > limits.image_shift:
            yield CaptureWarning(
                "cameras-off",
                f"held-out photographs are about {moved:.1f} pixels off from the scene: the cameras are inaccurate; "
                "correct them (--refine-poses), or estimate them again if they are too far off for that",
            )
    reached = figures["reconstruction"]["psnr"]
    if reached < limits.psnr:
        yield CaptureWarning(
            "poor-reconstruction",
            f"{'held-out' if split.test else 'training'} views reach only {reached:.1f} dB: more or better "
            "photographs, or better cameras, are needed before the colours mean much",
        )


def _of_layer(name: str, layer: Mapping[str, Any], limits: AdviceThresholds) -> Iterator[CaptureWarning]:
    ccpr, rwe = layer["ccpr"], layer["rwe"]
    severity = Layer.from_name(name).severity
    if severity < limits.least_severity:
        yield CaptureWarning(
            "nothing-to-enhance",
            f"{name}: this severity is normal vision, which needs no enhancement; use a higher --severity",
        )
        return
    if rwe["enhanced_ratio"] > limits.enhanced_ratio:
        yield CaptureWarning(
            "enhancer-contradicts-itself",
            f"{name}: the enhanced photographs contradict each other {rwe['enhanced_ratio']:.1f} times as much as the "
            "originals; --enhancer lut maps a colour to the same new colour in every view",
        )
    if rwe["ratio"] > limits.rendered_ratio:
        yield CaptureWarning(
            "views-disagree",
            f"{name}: colours change more from view to view than in the photographs (RWE {rwe['ratio']:.2f}); "
            "the default mode (layers) gives each surface a single colour",
        )
    if ccpr["enhanced"] < limits.ccpr:
        yield CaptureWarning(
            "colours-not-separated",
            f"{name}: the enhanced photographs keep {ccpr['enhanced']:.0%} of the contrasts ({ccpr['input']:.0%} "
            "before): some colours cannot be separated this way; add labels or patterns",
        )
    if ccpr["rendered"] < limits.kept_contrast * ccpr["input"]:
        yield CaptureWarning(
            "contrast-lost",
            f"{name}: the scene keeps {ccpr['rendered']:.0%} of the contrasts, the original photographs "
            f"{ccpr['input']:.0%}: the reconstruction lost detail; use more steps, more photographs or better cameras",
        )


def _rms_shift(capture: Capture, split: Split, folder: Path) -> float:
    """Root mean square shift in pixels between held-out photographs and their renderings."""
    squares = []
    for view in (capture.views[i] for i in evenly_spread(split.test, _MEASURED_PHOTOGRAPHS)):
        rendered = folder / RENDERS_FOLDER / ORIGINAL / f"{view.key}.png"
        if view.shown is None and rendered.is_file():
            squares.append(image_shift(read_png(rendered), view.image) ** 2)
    return math.sqrt(float(np.mean(squares))) if squares else 0.0
