"""The web page of a finished run: its layers, cameras, captions and stills. numpy only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...capture.folder import CaptureFolder, read_capture_folder
from ...errors import InputError
from ...files.untrusted import is_file
from ...rendering.requests import seen_by, vision
from ...runs.layout import (
    CAPTURE_FOLDER,
    GAUSSIANS_FILE,
    ORIGINAL,
    RENDERS_FOLDER,
    REPORT_FILE,
    SIMULATED_FOLDER,
    VIEWER_PAGE,
    layer_gaussians_file,
)
from ...runs.report import CAMERAS, check_finished_run, gained, read_report
from ...settings import SIMULATIONS
from ..io.files import most_important, read_layers
from .page import Still, Surroundings, write_web_page

_MOST_GAUSSIANS = 2_000_000  # of a page that nobody chose the size of: some 80 MB
_MOST_STILL_BYTES = 2 << 20


def write_viewer(folder: Path) -> None:
    """Write ``viewer.html`` into the folder of a finished run, in the place of an earlier one.

    Raises:
        InputError: the run is damaged, or the file cannot be written; then there is none.
    """
    (folder / VIEWER_PAGE).unlink(missing_ok=True)
    names = check_finished_run(folder)
    layers = read_layers(
        [folder / GAUSSIANS_FILE, *(folder / layer_gaussians_file(name) for name in names)], drop_damaged=True
    )
    layers = most_important(layers, _MOST_GAUSSIANS)
    write_web_page(folder / VIEWER_PAGE, layers, surroundings=surroundings_of(folder))


def is_finished_run(folder: Path) -> bool:
    """Whether `folder` holds a run with what a page of it needs."""
    return all(is_file(folder / name) for name in (REPORT_FILE, CAMERAS, GAUSSIANS_FILE))


def surroundings_of(folder: Path) -> Surroundings:
    """What the page of the run in `folder` says and shows.

    Raises:
        InputError: its report or its cameras cannot be used.
    """
    report = read_report(folder)
    capture = read_capture_folder(folder / CAPTURE_FOLDER)
    try:
        return _told_by(report, capture, folder)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        remedy = "make the run again, or copy the files into an empty folder for a page without cameras"
        raise InputError(f"{REPORT_FILE} of the finished run is damaged", where=folder, remedy=remedy) from None


def _told_by(report: dict[str, Any], capture: CaptureFolder, folder: Path) -> Surroundings:
    """As `surroundings_of`; a report that was changed raises whatever its values lead to."""
    shown = report["views_shown"]
    start = shown[len(shown) // 2] if shown else ""
    name = Path(report["settings"]["capture"]).name or "capture"
    model = report["settings"].get("simulation")
    return Surroundings(
        title=f"{name} in colours for everyone" if report["layers"] else name,
        lead=_lead(report),
        captions={layer: gained(layer, report["layers"][layer]) for layer in report["layers"]},
        names={layer: vision(layer) for layer in report["layers"]},
        credit=f"The scene belongs to whoever owns the photographs of {name}. "
        f"Made with cvdgs {report['versions'].get('cvdgs', '')}; the viewer in this page is free software "
        "under GPL-3.0-or-later.",
        views=capture.views,
        start=start,
        up=capture.up,
        background=(1.0, 1.0, 1.0) if capture.is_cut_out else (0.0, 0.0, 0.0),
        model=model if model in SIMULATIONS else SIMULATIONS[0],
        stills=_stills(folder, list(report["layers"]), start),
    )


def _lead(report: dict[str, Any]) -> str:
    views, psnr = report["capture"], report["reconstruction"]["psnr"]
    quality = "" if psnr is None else f"; {psnr:.1f} dB on {'held-out' if views['test'] else 'training'} views"
    return f"made from {views['views']} photographs{quality}"


def _stills(folder: Path, layers: list[str], view: str) -> list[Still]:
    renders, file = folder / RENDERS_FOLDER, f"{view}.png"
    stills = [Still(renders / ORIGINAL / file, "Original colours")]
    for layer in layers:
        stills += [
            Still(renders / layer / file, f"Enhanced for {vision(layer)}"),
            Still(renders / layer / SIMULATED_FOLDER / file, seen_by("Enhanced", layer)),
        ]
    return [still for still in stills if is_file(still.path) and still.path.stat().st_size <= _MOST_STILL_BYTES]
