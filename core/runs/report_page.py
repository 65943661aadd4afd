"""report.html, made from a run's report.json and its pictures. For the worker: it needs Jinja2."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from ..files.pages import write_page
from ..files.untrusted import replacing
from .layout import ORIGINAL, RENDERS_FOLDER, REPORT_PAGE, VIEWER_PAGE, picture_name, spread_over_turn
from .report import bound, gained, read_report, scored_pictures

_TURNTABLE_FRAMES = 4  # that the page shows
_MOST_EMBEDDED_BYTES = 24 << 20  # of the scene's page; a larger one is loaded from its file
# Distinguishable for all kinds of colour vision by lightness (Okabe-Ito, ordered from dark to light).
_STAGE_COLORS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
_WIDTH, _HEIGHT, _MARGIN = 560, 220, 44  # of the chart, in pixels


def write_report_page(folder: Path) -> None:
    """Write ``report.html`` into a run's folder; its pictures are embedded, so that the page can be moved.

    Raises:
        InputError: there is no report, or it is damaged.
        OSError: the page cannot be written.
    """
    report = read_report(folder)
    shown = report["views_shown"]
    middle = shown[len(shown) // 2] if shown else ""
    layer = next(iter(report["layers"]), ORIGINAL)
    count = (report.get("turntable") or {}).get("frames", 0)
    with replacing(folder / REPORT_PAGE) as page:  # a run that was measured later has one already
        write_page(
            page,
            Path(__file__).with_name("report.html"),
            folder=folder,
            report=report,
            title=f"cvdgs: {Path(report['settings']['capture']).name or 'capture'}",
            kinds=scored_pictures(report["layers"]),
            colors=_STAGE_COLORS,
            gained=gained,
            bound=bound,
            viewer=_viewer(folder),
            viewer_file=VIEWER_PAGE,
            middle=middle,
            poster=folder / RENDERS_FOLDER / layer / f"{middle}.png",
            curve=_curve(report["curve"]),
            turntable_frames=[(number, picture_name(number)) for number in spread_over_turn(count, _TURNTABLE_FRAMES)],
        )


def _viewer(folder: Path) -> dict[str, Any]:
    """The page beside the report that shows the scene; empty where there is none, without text where it is large."""
    page = folder / VIEWER_PAGE
    if not page.is_file():
        return {}
    size = page.stat().st_size
    # Within a script, where "<" could end it.
    text = json.dumps(page.read_text(encoding="utf-8")).replace("<", "\\u003c") if size <= _MOST_EMBEDDED_BYTES else ""
    return {"file": VIEWER_PAGE, "megabytes": size / 1e6, "text": text}


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
        "summary": f"Held-out PSNR over training time, from {measured[0][1]:.1f} dB to {measured[-1][1]:.1f} dB after "
        f"{measured[-1][0]:.0f} s",
        "points": [(_MARGIN + (_WIDTH - _MARGIN - 8) * seconds / last, height_of(psnr)) for seconds, psnr in measured],
        "labels": [(psnr, height_of(psnr)) for psnr in (low, high)],
    }
