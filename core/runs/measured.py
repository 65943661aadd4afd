"""A size that was measured after a run: written where the run's readers and its exports look for it."""

from __future__ import annotations

import json
import math
from pathlib import Path

from ..errors import InputError
from ..files.untrusted import is_file, read_json, replacing
from .layout import CAMERAS_FILE, CAPTURE_FOLDER, REPORT_FILE

_KEY = "metres_per_unit"
_REMEDY = "run again"


def note_metres(folder: Path, metres_per_unit: float) -> bool:
    """Let the run in `folder` know how many metres a unit of its world has; whether there is a run to tell.

    Raises:
        InputError: a file of the run is damaged.
        OSError: one cannot be written.
    """
    if not 0.0 < metres_per_unit < math.inf:
        raise InputError(f"{metres_per_unit} metres a unit", where=folder, remedy="measure between two places")
    report, cameras = folder / REPORT_FILE, folder / CAPTURE_FOLDER / CAMERAS_FILE
    if not (is_file(report) and is_file(cameras)):
        return False
    told = read_json(report, remedy=_REMEDY)
    stated = read_json(cameras, remedy=_REMEDY)
    if not isinstance(stated, dict) or not isinstance(told, dict) or not isinstance(told.get("capture"), dict):
        raise InputError("not the files of a run", where=folder, remedy=_REMEDY)
    told["capture"][_KEY] = stated[_KEY] = metres_per_unit
    for path, document, indent in ((cameras, stated, 1), (report, told, 2)):
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(document, indent=indent, allow_nan=False) + "\n", encoding="utf-8")
    return True
