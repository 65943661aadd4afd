"""report.html, made from a run's report.json and its pictures. For the worker: it needs Jinja2."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from ..files.pages import write_page
from ..files.untrusted import read_json
from .layout import REPORT_FILE, REPORT_PAGE, evenly_spread, picture_name
from .report import SCORED_PICTURES, SECOND_PHOTOGRAPHS

_TURNTABLE_FRAMES = 4  # that the page shows
# Distinguishable for all kinds of colour vision by lightness (Okabe-Ito, ordered from dark to light).
_STAGE_COLORS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
_WIDTH, _HEIGHT, _MARGIN = 560, 220, 44  # of the chart, in pixels


def write_report_page(folder: Path) -> None:
    """Write ``report.html`` into a run's folder; its pictures are embedded, so that the page can be moved.

    Raises:
        InputError: there is no report.
        OSError: the page cannot be written.
    """
    report = read_json(folder / REPORT_FILE)
    count = (report.get("turntable") or {}).get("frames", 0)
    write_page(
        folder / REPORT_PAGE,
        Path(__file__).with_name("report.html"),
        folder=folder,
        report=report,
        title=f"cvdgs: {Path(report['settings']['capture']).name or 'capture'}",
        kinds=SCORED_PICTURES | SECOND_PHOTOGRAPHS,
        colors=_STAGE_COLORS,
        curve=_curve(report["curve"]),
        turntable_frames=[(number, picture_name(number)) for number in evenly_spread(count, _TURNTABLE_FRAMES)],
    )


def _curve(curve: list[dict[str, float]]) -> dict[str, Any]:
    """Held-out PSNR over seconds as points of a chart; empty without two of them."""
    measured = [(item["seconds"], item["psnr"]) for item in curve if item.get("psnr") is not None]
    if len(measured) < 2:
        return {}
    last = max(seconds for seconds, _ in measured)
    low = math.floor(min(psnr for _, psnr in measured))
    high = max(math.ceil(max(psnr for _, psnr in measured)), low + 1)

    def height_of(psnr: float) -> float:
        return 8 + (_HEIGHT - _MARGIN) * (1 - (psnr - low) / (high - low))

    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "left": _MARGIN,
        "seconds": last,
        "points": [(_MARGIN + (_WIDTH - _MARGIN - 8) * seconds / last, height_of(psnr)) for seconds, psnr in measured],
        "labels": [(psnr, height_of(psnr)) for psnr in (low, high)],
    }
