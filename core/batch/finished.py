"""What a finished run has, as far as its folder tells at a glance. Standard library only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..errors import InputError
from ..report import SCHEMA
from ..run_files import CAMERAS_FILE, CAPTURE_FOLDER, GAUSSIANS_FILE, REPORT_FILE, layer_gaussians_file
from ..untrusted import is_file, is_there, read_json

CAMERAS = f"{CAPTURE_FOLDER}/{CAMERAS_FILE}"
_REMEDY = "give the output folder of a finished run of scripts/run.py"


def check_finished_run(folder: Path) -> list[str]:
    """The layers of the run in `folder`; one whose file was lost is none, for it can be added again.

    Raises:
        InputError: there is no run, it is damaged, of another version, or its geometry or cameras are missing.
    """
    layers = list(read_report(folder)["layers"])
    for name in (GAUSSIANS_FILE, CAMERAS):
        if not is_file(folder / name):
            raise InputError(f"the run has no {name}", where=folder, remedy=_REMEDY)
    return [layer for layer in layers if (folder / layer_gaussians_file(layer)).is_file()]


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
        raise InputError("no finished run is there", where=folder, remedy=_REMEDY)
    report = read_json(folder / REPORT_FILE, remedy=_REMEDY)
    if not isinstance(report, dict) or "schema" not in report:
        raise InputError(f"{REPORT_FILE} of the finished run is damaged", where=folder, remedy=_REMEDY)
    if report["schema"] != SCHEMA:
        raise InputError(f"a run of another version ({report['schema']})", where=folder, remedy="make the run again")
    if not isinstance(report.get("layers"), dict) or not isinstance(report.get("settings"), dict):
        raise InputError(f"{REPORT_FILE} of the finished run is damaged", where=folder, remedy=_REMEDY)
    return report
