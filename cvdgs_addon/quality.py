"""How fine a run becomes, and how long it takes on this machine. No bpy.

The times are those of `TIME_MODEL` on a reference machine; a machine's speed relative to that one is measured when its
worker is checked, and every run that it finishes or is cancelled corrects that stage by stage.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping

from ..core.settings import QUALITIES, Quality

_LEAST_SECONDS = 0.05  # of a stage
_TELLING_SECONDS = 0.5  # of a stage; shorter ones say nothing of how long they take elsewhere
REFERENCE_PROCESSORS = 2  # of the reference machine, an AMD EPYC without a GPU


def quality_called(name: str) -> Quality:
    """The quality of that name."""
    return next(quality for quality in QUALITIES if quality.name == name)


def likely_speed() -> float:
    """This machine's speed relative to the reference one as long as nothing was measured: by its processors alone.

    A step is in part serial, so that twice the processors are not twice as fast.
    """
    return math.sqrt((os.cpu_count() or REFERENCE_PROCESSORS) / REFERENCE_PROCESSORS)


def expected_seconds(reference: Mapping[str, float], speed: float, learned: Mapping[str, float]) -> dict[str, float]:
    """Seconds by stage on this machine.

    Args:
        reference: seconds of the stages on the reference machine.
        speed: relative to that, of stages that no run has timed yet.
        learned: speeds of those that one has.
    """
    return {stage: seconds / learned.get(stage, speed) for stage, seconds in reference.items()}


def learned_speeds(
    before: Mapping[str, float], reference: Mapping[str, float], taken: Mapping[str, float | None]
) -> dict[str, float]:
    """The speeds of the stages after a run: what the first one showed, then a mean in which later ones weigh most.

    Args:
        before: what was learned so far.
        reference: seconds of the stages on the reference machine.
        taken: seconds of those that were timed.
    """
    speeds = dict(before)
    for stage, seconds in taken.items():
        if seconds is None or stage not in reference or max(seconds, reference[stage]) < _TELLING_SECONDS:
            continue
        now = reference[stage] / max(seconds, _LEAST_SECONDS)
        speeds[stage] = math.sqrt(before[stage] * now) if before.get(stage, 0.0) > 0.0 else now
    return speeds


def in_words(seconds: float) -> str:
    """A rough time, as rough as an estimate is: "about 40 s", "about 5 min", "about 1.5 h"."""
    if seconds < 55.0:
        return f"about {max(round(seconds / 10.0), 1) * 10} s"
    if seconds < 5400.0:
        return f"about {max(round(seconds / 60.0), 1)} min"
    return f"about {seconds / 3600.0:.1f} h"
