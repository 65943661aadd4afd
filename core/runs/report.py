"""report.json of a finished run: written, checked, read again. Standard library only; `report_page` makes its page."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files.untrusted import is_file, is_there, read_json
from ..settings import Layer
from .layout import (
    CAMERAS_FILE,
    CAPTURE_FOLDER,
    GAUSSIANS_FILE,
    ORIGINAL,
    REPORT_FILE,
    layer_gaussians_file,
    layer_still_file,
)

SCHEMA = "cvdgs-report-1"
SCORED_PICTURES = {
    "input": "photographs",
    "enhanced": "enhanced photographs",
    "unenhanced": "scene, original colours",
    "rendered": "scene, enhanced colours",
}
"""What the metrics of a layer are computed on: key in the report, and what tables call it."""
SECOND_PHOTOGRAPHS = {"again": "second photographs", "again_enhanced": "second photographs, enhanced"}
"""Likewise, in captures that have them. They differ from the first ones by noise alone: a bound for any scene."""
ESTIMATED_PHOTOGRAPHS = {
    "again_estimated": "second photographs, estimated",
    "again_enhanced_estimated": "second photographs, enhanced, estimated",
}
"""What other captures say of themselves instead; CCPR alone."""

_TEXT, _NUMBER, _WHOLE = (str,), (int, float, type(None)), (int,)
_FIGURES = dict.fromkeys(SCORED_PICTURES, _NUMBER)
_LAYER_SHAPE = {
    "ccpr": {**_FIGURES, "tau": _NUMBER},
    "ccpr_mean": _FIGURES,
    "ssim_simulated": _FIGURES,
    "naturalness": {"ssim": _NUMBER, "delta_e": _NUMBER},
    "rwe": {"ratio": _NUMBER, "enhanced_ratio": _NUMBER},
    "psnr_to_enhanced": _NUMBER,
}
# What of a report is used again when layers are added to its run. A type in brackets is that of a list's entries, `...`
# stands for any key.
_SHAPE: Mapping[str, Any] = {
    "schema": _TEXT,
    "settings": {"capture": _TEXT, "layers": [{}]},
    "versions": {},
    "device": _TEXT,
    "capture": dict.fromkeys(("views", "train", "test", "width", "height"), _WHOLE),
    "gaussians": _WHOLE,
    "reconstruction": {"psnr": _NUMBER, "ssim": _NUMBER},
    "seconds": {...: _NUMBER, "total": _NUMBER},
    "peak_memory_mb": _NUMBER,
    "layers": {...: _LAYER_SHAPE},
    "views_shown": [_TEXT],
    "curve": [{...: _NUMBER, "seconds": (int, float)}],
    "notes": {...: _TEXT},
    "warnings": [{"name": _TEXT, "message": _TEXT}],
    "moving": {"views": [_TEXT], "share": _NUMBER},
}
_OPTIONAL = ("report.moving",)


def check_report(report: Any) -> None:
    """Make sure that `report` is what `write_report` wrote, as far as it is used again.

    Raises:
        ValueError: it is not; says where.
    """
    _check_shape(report, _SHAPE, "report")
    _check_names(report)


def _check_names(report: Mapping[str, Any]) -> None:
    """Of layers and views become files: those of a report from elsewhere must not lead out of its folder.

    Raises:
        ValueError: one is no such name.
    """
    layers = [ORIGINAL, *report["layers"]]
    blender, turntable = report.get("blender") or {}, report.get("turntable") or {}
    usable = {
        "layers": all(map(Layer.is_name, report["layers"])),
        "views_shown": all(map(_is_file_name, report.get("views_shown", ()))),
        "blender.stills": set(blender.get("stills", ())) <= set(map(layer_still_file, layers)),
        "turntable.layers": set(turntable.get("layers", ())) <= set(layers),
    }
    for path, is_usable in usable.items():
        if not is_usable:
            raise ValueError(f"report.{path} is unusable")


def _is_file_name(text: str) -> bool:
    """Whether `text` is a file's name in a folder, on whatever system."""
    return text not in ("", ".", "..") and not set(text) & set("/\\:\0")


def _check_shape(value: Any, shape: Any, path: str) -> None:
    if isinstance(shape, tuple):
        if type(value) not in shape:
            raise ValueError(f"{path} is unusable")
        return
    if not isinstance(value, list if isinstance(shape, list) else dict):
        raise ValueError(f"{path} is unusable")
    if isinstance(value, list):
        for index, entry in enumerate(value):
            _check_shape(entry, shape[0], f"{path}[{index}]")
        return
    for name in shape:
        if name is not ... and name not in value and f"{path}.{name}" not in _OPTIONAL:
            raise ValueError(f"{path}.{name} is missing")
    for name, entry in value.items():
        if name in shape or ... in shape:
            _check_shape(entry, shape.get(name, shape.get(...)), f"{path}.{name}")


def write_report(folder: Path, report: dict[str, Any]) -> None:
    """Write ``report.json`` into the run's folder; `report_page` makes its page."""
    (folder / REPORT_FILE).write_text(json.dumps(report, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def gained(layer: str, figures: Mapping[str, Any]) -> str:
    """What the observer of `layer` gained, as a sentence, by the layer's figures in the report; "" if not measured."""
    ccpr = figures["ccpr"]
    if ccpr["input"] is None or ccpr["rendered"] is None:
        return ""
    observer = layer.partition("-")[0]
    return (
        f"{'An' if observer == 'achromat' else 'A'} {observer} could tell apart {100 * ccpr['input']:.0f} of 100 "
        f"neighbouring colours in the photographs, {100 * ccpr['rendered']:.0f} in the finished scene."
    )


def bound(figures: Mapping[str, Any]) -> str:
    """What a second photograph, enhanced, would have of a layer's contrast, as a sentence; "" if it is not known."""
    ccpr = figures["ccpr"]
    for kind, how in (("again_enhanced", "has"), ("again_enhanced_estimated", "would have, by an estimate,")):
        if ccpr.get(kind) is not None:
            return f"A second photograph of the same, enhanced alike, {how} {100 * ccpr[kind]:.0f}; the rest is noise."
    return ""


def scored_pictures(layers: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """`SCORED_PICTURES`, and second photographs where there are any, else what is estimated of them."""
    measured = any(kind in layer["ccpr"] for layer in layers.values() for kind in SECOND_PHOTOGRAPHS)
    return SCORED_PICTURES | (SECOND_PHOTOGRAPHS if measured else ESTIMATED_PHOTOGRAPHS)


def latest_seconds(report: dict[str, Any]) -> dict[str, float | None]:
    """The seconds of each stage of the run that wrote the report last: the first, or one that added layers."""
    return (report.get("resumed") or [report])[-1]["seconds"]


def without_non_finite(report: dict[str, Any]) -> dict[str, Any]:
    """JSON has neither NaN nor infinity: such numbers become null, and ``notes`` says why, by the number's path."""
    notes = dict(report["notes"])
    return {**_clean(report, "", notes), "notes": notes}


def _clean(value: Any, path: str, notes: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {key: _clean(item, f"{path}.{key}" if path else str(key), notes) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_clean(item, f"{path}[{i}]", notes) for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        notes[path] = "there is nothing to measure it on" if math.isnan(value) else "infinite: the images are the same"
        return None
    return value


CAMERAS = f"{CAPTURE_FOLDER}/{CAMERAS_FILE}"
_REMEDY = "give the output folder of a finished run of scripts/run.py"


def check_finished_run(folder: Path) -> list[str]:
    """The layers of the run in `folder`; one whose file was lost is left out, because it can be added again.

    Raises:
        InputError: there is no run, it is damaged, of another version, or its geometry or cameras are missing.
    """
    layers = list(read_report(folder)["layers"])
    for name in (GAUSSIANS_FILE, CAMERAS):
        if not is_file(folder / name):
            raise InputError(f"the run has no {name}", where=folder, remedy=_REMEDY)
    return [layer for layer in layers if (folder / layer_gaussians_file(layer)).is_file()]


def is_run(folder: Path) -> bool:
    """Whether a run of any version has left its report in `folder`."""
    return str(report_or_nothing(folder).get("schema", "")).startswith(SCHEMA.rstrip("0123456789"))


def report_or_nothing(folder: Path) -> dict[str, Any]:
    """What the report of the run in `folder` says, for who can do without; empty where it cannot be read."""
    try:
        report = read_json(folder / REPORT_FILE)
    except InputError:
        return {}
    return report if isinstance(report, dict) else {}


def read_report(folder: Path) -> dict[str, Any]:
    """The report of the run in `folder`.

    Raises:
        InputError: there is none, or it is damaged or of another version.
    """
    if not is_there(folder / REPORT_FILE):
        raise InputError("there is no finished run", where=folder, remedy=_REMEDY)
    report = read_json(folder / REPORT_FILE, remedy=_REMEDY)
    if not isinstance(report, dict) or "schema" not in report:
        raise InputError(f"{REPORT_FILE} of the finished run is damaged", where=folder, remedy=_REMEDY)
    if report["schema"] != SCHEMA:
        raise InputError(
            f"the run was made by another version ({report['schema']})", where=folder, remedy="make the run again"
        )
    damaged = InputError(f"{REPORT_FILE} of the finished run is damaged", where=folder, remedy=_REMEDY)
    if not isinstance(report.get("layers"), dict) or not isinstance(report.get("settings"), dict):
        raise damaged
    try:
        _check_names(report)
    except (ValueError, TypeError, AttributeError):
        raise damaged from None
    return report
