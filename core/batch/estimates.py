"""How long tasks take and how much memory they need, before anything is known better. Standard library only.

The figures were measured on two cores of an EPYC; progress corrects itself by what tasks really take, and a batch that
was begun is estimated by its own tasks.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..settings import Settings
from .done import read_record
from .task import Kind, Task

# The demo: 40 photographs of 480 x 360 (`make demo`).
_START_SECONDS = 16.0  # reading, enhancing, evaluating
_SECONDS_PER_ITERATION = 0.051
_LAYER_SECONDS = 20.0
LAYER_KEPT_SECONDS = 1.0  # for a layer that the run was made with
# 36,000 Gaussians in Cycles on one core; more cores share it.
_LOAD_SECONDS = 3.0
_SECONDS_PER_MEGAPIXEL = 170.0
_SIMULATION_SECONDS_PER_MEGAPIXEL = 0.3
_ENCODING_SECONDS_PER_MEGAPIXEL = 0.05
_SHEET_SECONDS = 3.0
_PAGE_SECONDS_PER_ITEM = 0.5


def train_seconds(settings: Mapping[str, Any], layers: int) -> float:
    """Of a run with `settings` as `Settings` names them."""
    iterations = settings.get("iterations", Settings.iterations)
    return _START_SECONDS + _SECONDS_PER_ITERATION * iterations + _LAYER_SECONDS * layers


def layer_seconds() -> float:
    """Of a layer that is added to a run."""
    return _START_SECONDS + _LAYER_SECONDS


def frames_seconds(frames: int, size: tuple[int, int], observers: int, cores: int) -> float:
    """Of a chunk of `frames` pictures that so many observers see."""
    megapixels = size[0] * size[1] / 1e6
    each = _SECONDS_PER_MEGAPIXEL / cores + _SIMULATION_SECONDS_PER_MEGAPIXEL * observers
    return _LOAD_SECONDS + frames * megapixels * each


def video_seconds(frames: int, size: tuple[int, int], sequences: int) -> float:
    """Of a video of sequences side by side."""
    return 1.0 + frames * sequences * size[0] * size[1] / 1e6 * _ENCODING_SECONDS_PER_MEGAPIXEL


def sheet_seconds() -> float:
    """Of a contact sheet."""
    return _SHEET_SECONDS


def page_seconds(items: int) -> float:
    """Of the page of so many items."""
    return 1.0 + _PAGE_SECONDS_PER_ITEM * items


def measured_pace(tasks: Iterable[Task], out: Path) -> dict[Kind, float]:
    """What tasks of a kind took, relative to their estimate, where the batch in `out` has done some of that kind."""
    taken: dict[Kind, float] = defaultdict(float)
    expected: dict[Kind, float] = defaultdict(float)
    for task in tasks:
        record = read_record(task, out)
        if record is not None and task.seconds > 0.0:
            taken[task.kind] += record.seconds
            expected[task.kind] += task.seconds
    return {kind: taken[kind] / expected[kind] for kind in taken}
