"""How long a file of Gaussians takes into a scene."""

from __future__ import annotations

import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy

from ...core.runtime.protocol import Reporter
from ...core.splats.io.files import read_gaussians
from ..scene.splats import add_gaussians

STAGE = "import"


def time_import(arguments: Mapping[str, Any], folder: Path, *, reporter: Reporter) -> dict[str, Any]:
    """Import a file several times into an empty scene; replaces the file that is open.

    Args:
        arguments: ``file``, its name; ``rounds``.
        folder: that it is in.

    Returns:
        ``rounds``: of each the seconds of ``read``, ``add`` (the object with its attributes and nodes) and
        ``evaluate`` (what the nodes make for the viewport).

    Raises:
        InputError: the file cannot be read.
    """
    rounds = int(arguments["rounds"])
    found = []
    for turn in range(rounds):
        reporter.progress(STAGE, turn / rounds, f"round {turn + 1} of {rounds}")
        bpy.ops.wm.read_homefile(use_empty=True)
        marks = [time.perf_counter()]
        gaussians = read_gaussians(folder / str(arguments["file"]))
        marks.append(time.perf_counter())
        add_gaussians(gaussians, {}, bpy.context.scene.collection)
        marks.append(time.perf_counter())
        bpy.context.view_layer.update()
        marks.append(time.perf_counter())
        seconds = [after - before for before, after in pairwise(marks)]
        found.append(dict(zip(("read", "add", "evaluate"), seconds, strict=True)))
    return {"rounds": found}
