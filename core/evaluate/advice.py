"""Looks at a finished run - its photographs, its course, its figures - and says what is wrong and what to do about it.

A warning is only worth having where it is true, so each has a threshold well beyond what good captures show; where the
thresholds come from stands beside them. Nothing here changes a result.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..capture import Capture, CaptureWarning
from ..images import read_png
from ..run_files import ORIGINAL, RENDERS_FOLDER
from ..settings import Layer
from .evaluation import Split, spread
from .photograph_quality import PhotographQuality, image_shift

_MEASURED_PHOTOGRAPHS = 6


@dataclass(frozen=True)
class AdviceThresholds:
    """From where on something is worth a warning.

    Attributes:
        noise: levels of 255. Rendered photographs without noise show 0.5, real ones scaled down 0.4; with a thirtieth
            of the light the demo shows 5.
        sharpness: see `PhotographQuality`; 0.6 to 0.85 for sharp photographs, 0.40 for frames of a telephone's video,
            below 0.36 where the demo is blurred over three pixels.
        blocks: 0.9 to 1.1 for good photographs, 1.4 for JPEG quality 30.
        brightness: median luma; a room at night is at 0.1.
        image_shift: pixels, root mean square over held-out views; at most 0.2 where the cameras are exact.
        exposure_loss: dB that held-out views lose by their exposures alone.
        psnr: dB of held-out views below which a scene can hardly be recognised in its details.
        enhanced_ratio: RWE of the enhanced photographs; 1.0 to 1.2 for a LUT, which raises contrast and so differences.
        rendered_ratio: RWE of the layer; above 1 its views contradict each other more than the photographs do.
        ccpr: of the enhanced photographs; below it a frame counts as hard.
        kept_contrast: CCPR of the scene relative to that of the photographs. What is finer than a reconstruction can be
            is always lost: good scenes of 50 photographs keep 0.73 and more, some even with enhancement.
        least_severity: below it a layer is the photographs' colours.
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
    """What a user should know of a run.

    Args:
        capture: with the poses that training ended with.
        split: of its views.
        folder: of the run, with its renderings of the held-out views.
        curve: of the training; empty where there was none.
        figures: the report's ``reconstruction`` and ``layers``.
    """
    found = [*_of_photographs(capture, thresholds), *_of_geometry(capture, split, folder, curve, figures, thresholds)]
    for name, layer in figures["layers"].items():
        found += _of_layer(name, layer, thresholds)
    return found


def _of_photographs(capture: Capture, limits: AdviceThresholds) -> Iterator[CaptureWarning]:
    chosen = spread(range(len(capture.views)), _MEASURED_PHOTOGRAPHS)
    views = [capture.views[i] for i in chosen]
    quality = PhotographQuality.of([view.image for view in views], [view.alpha for view in views])
    if quality.noise > limits.noise:
        yield CaptureWarning(
            "noisy-photographs",
            f"the photographs are noisy (about {quality.noise:.0f} of 255 levels); give more light, a longer exposure "
            "on a tripod, or a lower ISO",
        )
    if quality.sharpness < limits.sharpness:
        yield CaptureWarning(
            "blurred-photographs",
            "the photographs show no detail near the size of a pixel; if they are blurred, hold the camera still and "
            "check the focus, else a smaller --max-size is as good and faster",
        )
    if quality.blocks > limits.blocks:
        yield CaptureWarning(
            "jpeg-blocks",
            "the photographs show the blocks of strong JPEG compression; use the camera's best quality, and the files "
            "as it wrote them",
        )
    if quality.brightness < limits.brightness:
        yield CaptureWarning(
            "dark-photographs",
            f"half of the pixels are darker than {quality.brightness:.0%} of white; colours are hard to tell there for "
            "anyone: give more light or a longer exposure",
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
            "exposure or white balance differ from photograph to photograph; this was corrected, but held-out views "
            f"compare {any_exposure - psnr:.1f} dB worse for it: lock both while photographing",
        )
    if split.test:
        moved = _rms_shift(capture, split, folder)
        if moved > limits.image_shift:
            yield CaptureWarning(
                "cameras-off",
                f"held-out photographs lie about {moved:.1f} pixels beside the scene: the cameras are not exact; let "
                "them be corrected (--refine-poses), or estimate them again where they are too far off for that",
            )
    reached = figures["reconstruction"]["psnr"]
    if reached < limits.psnr:
        yield CaptureWarning(
            "poor-reconstruction",
            f"the scene shows {'held-out' if split.test else 'its own'} views with {reached:.1f} dB only: more or "
            "better photographs, or better cameras, are needed before its colours mean much",
        )


def _of_layer(name: str, layer: Mapping[str, Any], limits: AdviceThresholds) -> Iterator[CaptureWarning]:
    ccpr, rwe = layer["ccpr"], layer["rwe"]
    severity = Layer.from_name(name).severity
    if severity < limits.least_severity:
        yield CaptureWarning(
            "nothing-to-enhance",
            f"{name}: this is normal vision, for which nothing is changed; give a higher --severity",
        )
        return
    if rwe["enhanced_ratio"] > limits.enhanced_ratio:
        yield CaptureWarning(
            "enhancer-contradicts-itself",
            f"{name}: the enhanced photographs contradict each other {rwe['enhanced_ratio']:.1f} times as much as the "
            "photographs; --enhancer lut gives a colour the same new one in every view",
        )
    if rwe["ratio"] > limits.rendered_ratio:
        yield CaptureWarning(
            "views-disagree",
            f"{name}: the colours of the pictures change from view to view more than those of the photographs (RWE "
            f"{rwe['ratio']:.2f}); --mode layers gives a surface one colour",
        )
    if ccpr["enhanced"] < limits.ccpr:
        yield CaptureWarning(
            "colours-not-separated",
            f"{name}: the enhanced photographs keep {ccpr['enhanced']:.0%} of the contrasts ({ccpr['input']:.0%} "
            "before): some colours cannot be told apart this way; labels or patterns help",
        )
    if ccpr["rendered"] < limits.kept_contrast * ccpr["input"]:
        yield CaptureWarning(
            "contrast-lost",
            f"{name}: the scene keeps {ccpr['rendered']:.0%} of the contrasts, the photographs as they are "
            f"{ccpr['input']:.0%}: detail was lost in the reconstruction; more steps, more photographs or better "
            "cameras bring it back",
        )


def _rms_shift(capture: Capture, split: Split, folder: Path) -> float:
    """Of the held-out photographs beside their renderings, in pixels."""
    squares = []
    for view in (capture.views[i] for i in spread(split.test, _MEASURED_PHOTOGRAPHS)):
        rendered = folder / RENDERS_FOLDER / ORIGINAL / f"{view.key}.png"
        if view.alpha is None and rendered.is_file():
            squares.append(image_shift(read_png(rendered), view.image) ** 2)
    return math.sqrt(float(np.mean(squares))) if squares else 0.0
